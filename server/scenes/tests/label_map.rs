//! Objects from NIfTI label maps that the tests write: volumes, places and handedness against geometry
//! that is known in the patient's axes; files that are broken.

use std::io::Write;
use std::path::Path;

use flate2::Compression;
use flate2::write::GzEncoder;
use kerf_physics::{Grid, Vec3, voxelize};
use kerf_scenes::catalog;
use kerf_scenes::examine::examine;
use nalgebra::{Matrix3, Rotation3};

const HEADER_BYTES: usize = 352;

/// A file to be written: axes right, anterior, superior in mm.
struct Nifti {
    dims: [usize; 3],
    edges_mm: Matrix3<f64>,
    first_mm: Vec3,
    labels: Vec<i16>,
}

impl Nifti {
    /// A map centred on `center_mm`, each voxel labelled by where its centre is.
    fn of(dims: [usize; 3], edges_mm: Matrix3<f64>, center_mm: Vec3, label: impl Fn(Vec3) -> i16) -> Self {
        let middle = Vec3::from(dims.map(|n| (n as f64 - 1.0) / 2.0));
        let first_mm = center_mm - edges_mm * middle;
        let mut labels = Vec::new();
        for k in 0..dims[2] {
            for j in 0..dims[1] {
                for i in 0..dims[0] {
                    labels.push(label(first_mm + edges_mm * Vec3::new(i as f64, j as f64, k as f64)));
                }
            }
        }
        Self { dims, edges_mm, first_mm, labels }
    }

    /// The file with its orientation as an sform.
    fn bytes(&self) -> Vec<u8> {
        let mut bytes = vec![0u8; HEADER_BYTES];
        let mut put = |at: usize, value: &[u8]| bytes[at..at + value.len()].copy_from_slice(value);
        put(0, &348i32.to_le_bytes());
        for (index, n) in [3, self.dims[0], self.dims[1], self.dims[2], 1, 1, 1, 1].into_iter().enumerate() {
            put(40 + 2 * index, &(n as i16).to_le_bytes());
        }
        put(70, &4i16.to_le_bytes());
        put(72, &16i16.to_le_bytes());
        // Spacings that contradict the sform, which goes before them.
        (0..4).for_each(|i| put(76 + 4 * i, &9.0f32.to_le_bytes()));
        put(108, &(HEADER_BYTES as f32).to_le_bytes());
        put(123, &[2]);
        put(254, &1i16.to_le_bytes());
        for row in 0..3 {
            for column in 0..3 {
                put(280 + 16 * row + 4 * column, &(self.edges_mm[(row, column)] as f32).to_le_bytes());
            }
            put(292 + 16 * row, &(self.first_mm[row] as f32).to_le_bytes());
        }
        put(344, b"n+1\0");
        bytes.extend(self.labels.iter().flat_map(|label| label.to_le_bytes()));
        bytes
    }
}

/// A rotated lattice of oblong voxels, its first axis mirrored.
fn oblique() -> Matrix3<f64> {
    let turn = Rotation3::from_euler_angles(0.4, -0.3, 0.7);
    turn.matrix() * Matrix3::from_diagonal(&Vec3::new(-1.0, 1.3, 1.9))
}

/// Scene position, m, of a point of the patient, mm: on the back, seen from the feet.
fn in_scene_m(patient_mm: Vec3) -> Vec3 {
    Vec3::new(-patient_mm.x, patient_mm.y, -patient_mm.z) * 1e-3
}

const MATERIAL: &str = "{ young_modulus_pa = 1e4, poisson_ratio = 0.4 }";

/// The text of a scene of the file `m.nii.gz` with its label 2 as a region.
fn scene_text(fields: &str) -> String {
    format!(
        "version = 1\nname = \"map\"\n[[objects]]\nname = \"organ\"\nvoxel_size_m = 0.0015\n\
         shape = {{ label_map = {{ file = \"m.nii.gz\"{fields} }} }}\nmaterial = {MATERIAL}\n"
    )
}

const INNER: &str = "[[objects.regions]]\nname = \"inner\"\n\
                     shape = { label_map = { file = \"m.nii.gz\", labels = [2] } }\n";

fn load(folder: &Path, bytes: &[u8], scene: &str) -> Result<Grid, String> {
    std::fs::write(folder.join("m.nii.gz"), bytes).unwrap();
    let path = folder.join("scene.toml");
    std::fs::write(&path, scene).unwrap();
    let scene = catalog::load(path.to_str().unwrap()).map_err(|e| e.to_string())?;
    voxelize(&scene.desc.objects[0], &scene.meshes).map_err(|e| e.to_string())
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// Volume, m^3, and mean of the centres, m, of the voxels of a material.
fn moments(grid: &Grid, is_counted: impl Fn(u16) -> bool) -> (f64, Vec3) {
    let centres: Vec<Vec3> =
        grid.voxels().iter().filter(|v| is_counted(v.material)).map(|v| grid.centre_m(v.ijk)).collect();
    let count = centres.len() as f64;
    (count * grid.voxel_size_m().powi(3), centres.iter().sum::<Vec3>() / count)
}

fn ball_m3(radius_mm: f64) -> f64 {
    4.0 / 3.0 * std::f64::consts::PI * (radius_mm * 1e-3).powi(3)
}

const CENTER_MM: Vec3 = Vec3::new(30.0, -50.0, 120.0);
const INNER_MM: Vec3 = Vec3::new(36.0, -47.0, 118.0);

fn ball_in_ball() -> Nifti {
    Nifti::of([70, 60, 50], oblique(), CENTER_MM, |p| match ((p - INNER_MM).norm(), (p - CENTER_MM).norm()) {
        (inner, _) if inner < 9.0 => 2,
        (_, outer) if outer < 25.0 => 1,
        _ => 0,
    })
}

#[test]
fn a_ball_within_a_ball_has_its_volumes_where_the_patient_has_them() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene_text("") + INNER + &format!("material = {MATERIAL}\n");
    let map = ball_in_ball().bytes();
    for bytes in [gzip(&map), map] {
        let grid = load(folder.path(), &bytes, &scene).unwrap();
        let (volume, mean_m) = moments(&grid, |_| true);
        let (inner_volume, inner_mean_m) = moments(&grid, |material| material == 1);
        let ratios = [volume / ball_m3(25.0), inner_volume / ball_m3(9.0)];
        let offsets_mm =
            [(mean_m - in_scene_m(CENTER_MM)).norm() * 1e3, (inner_mean_m - in_scene_m(INNER_MM)).norm() * 1e3];
        println!("volumes over the balls' {ratios:?}, centres off by {offsets_mm:?} mm");
        assert!((ratios[0] - 1.0).abs() < 0.02 && (ratios[1] - 1.0).abs() < 0.05, "{ratios:?}");
        assert!(offsets_mm.iter().all(|off| *off < 0.2), "{offsets_mm:?}");
    }
}

#[test]
fn the_surface_of_a_ball_has_the_balls_normals_and_no_steps() {
    use kerf_physics::Link;
    let folder = tempfile::tempdir().unwrap();
    let grid = load(folder.path(), &ball_in_ball().bytes(), &scene_text("")).unwrap();
    let center_m = in_scene_m(CENTER_MM);
    let (mut count, mut normals, mut highest) = (0.0, 0.0, 0.0f64);
    for voxel in grid.voxels() {
        for (link, _) in Grid::links_of(voxel.ijk) {
            let Link::Boundary(crossing) = grid.link(link) else { continue };
            let mut at_m = grid.centre_m(link.cell);
            at_m[link.axis as usize] += f64::from(crossing.t) * grid.voxel_size_m();
            let out = at_m - center_m;
            count += 1.0;
            normals += Vec3::from(crossing.normal.map(f64::from)).dot(&out.normalize());
            highest = highest.max((out.norm() - 25e-3).abs());
            let distance_m = grid.signed_distance_m(&(center_m + out * (24e-3 / out.norm())));
            assert!((distance_m + 1e-3).abs() < 0.8e-3, "1 mm deep is {distance_m} m");
        }
    }
    println!("mean cosine {}, farthest {} mm off the ball", normals / count, highest * 1e3);
    assert!(count > 1000.0 && normals / count > 0.99, "mean cosine {} of {count}", normals / count);
    // Half of the longest diagonal of a voxel, 2.5 mm.
    assert!(highest < 1.25e-3, "{highest} m off the ball");
}

#[test]
fn a_handed_shape_keeps_its_hand_in_every_orientation_of_the_file() {
    // Arms to the right, to the front and to the head, each of its own length.
    let arms = |p: Vec3| {
        let within = |along: usize, length: f64| {
            (0..3).all(|a| if a == along { (-5.0..length).contains(&p[a]) } else { p[a].abs() < 5.0 })
        };
        i16::from(within(0, 35.0) || within(1, 25.0) || within(2, 15.0))
    };
    let mirrored = Matrix3::from_diagonal(&Vec3::new(-1.0, 1.0, 1.0));
    let swapped = Matrix3::new(0.0, 1.2, 0.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0);
    let folder = tempfile::tempdir().unwrap();
    for edges_mm in [Matrix3::identity(), mirrored, swapped, oblique()] {
        let map = Nifti::of([84, 84, 84], edges_mm, Vec3::new(10.0, 8.0, 3.0), arms);
        let grid = load(folder.path(), &map.bytes(), &scene_text(", offset_m = [0.0, 0.1, 0.0], scale = 2.0")).unwrap();
        let is_inside = |x_mm: f64, y_mm: f64, z_mm: f64| {
            let at_m = in_scene_m(Vec3::new(x_mm, y_mm, z_mm)) * 2.0 + Vec3::new(0.0, 0.1, 0.0);
            grid.voxel_at(grid.cell_of(&at_m)).is_some()
        };
        let ends = [is_inside(32.0, 0.0, 0.0), is_inside(0.0, 22.0, 0.0), is_inside(0.0, 0.0, 12.0)];
        let beyond = [is_inside(0.0, 30.0, 0.0), is_inside(0.0, 0.0, 20.0), is_inside(-10.0, 0.0, 0.0)];
        assert_eq!((ends, beyond), ([true; 3], [false; 3]), "{edges_mm}");
        assert!(!is_inside(0.0, -10.0, 0.0) && !is_inside(0.0, 0.0, -10.0), "{edges_mm}");
    }
}

#[test]
fn broken_files_are_refused_with_the_field() {
    let good = ball_in_ball().bytes();
    let changed = |at: usize, value: &[u8]| {
        let mut bytes = good.clone();
        bytes[at..at + value.len()].copy_from_slice(value);
        bytes
    };
    let mut not_whole = changed(70, &16i16.to_le_bytes());
    not_whole.truncate(HEADER_BYTES);
    not_whole.extend(0.5f32.to_le_bytes().repeat(70 * 60 * 50));
    let nowhere = changed(HEADER_BYTES, &vec![0; good.len() - HEADER_BYTES]);
    let folder = tempfile::tempdir().unwrap();
    for (bytes, fields, expected) in [
        (vec![0; 10], "", "is neither a NIfTI file (.nii, .nii.gz) nor an NRRD file (.nrrd, .seg.nrrd)"),
        (changed(0, &5i32.to_le_bytes()), "", "is neither a NIfTI file"),
        (changed(0, &540i32.to_le_bytes()), "", "magic"),
        (good[..100].to_vec(), "", "its header has 348 bytes"),
        (changed(344, b"ni1\0"), "", ".img"),
        (changed(42, &0i16.to_le_bytes()), "", "dim = [0, 60, 50]"),
        (changed(40, &2i16.to_le_bytes()), "", "dim = [2, 70"),
        (changed(42, &[0xff, 0x7f, 0xff, 0x7f, 0xff, 0x7f]), "", "limit of"),
        (changed(70, &128i16.to_le_bytes()), "", "datatype = 128"),
        (changed(112, &2.5f32.to_le_bytes()), "", "scl_slope = 2.5"),
        (changed(123, &[4]), "", "xyzt_units = 4"),
        (changed(296, &[0; 12]), "", "without a volume"),
        (changed(280, &f32::NAN.to_le_bytes()), "", "not finite"),
        (changed(HEADER_BYTES, &(-3i16).to_le_bytes()), "", "no whole number"),
        (not_whole, "", "no whole number"),
        (good[..5000].to_vec(), "", "it ends before its [70, 60, 50] voxels"),
        (gzip(&good)[..5000].to_vec(), "", "it ends before"),
        (nowhere, "", "every voxel has the label 0"),
        (good.clone(), ", labels = [0]", "no voxel has the label 0 that is inside"),
        (good.clone(), ", labels = [1, 7]", "no voxel has the label 7; the file's labels are 1, 2"),
    ] {
        let message = load(folder.path(), &bytes, &scene_text(fields)).unwrap_err();
        assert!(message.contains(expected) && message.contains("m.nii.gz"), "{expected:?}: {message}");
    }
    assert!(load(folder.path(), &good, &scene_text(", labels = [1, 2]")).is_ok());
}

#[test]
fn strays_of_a_segmentation_do_not_stretch_the_object_and_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let alone = ball_in_ball();
    let mut strewn = ball_in_ball();
    let [nx, ny, nz] = strewn.dims;
    // The map's corners, and eight voxels in a row along its rim.
    for (i, j, k) in [(0, 0, 0), (nx - 1, 0, nz - 1), (0, ny - 1, nz - 1)].into_iter().chain((5..13).map(|i| (i, 1, 1)))
    {
        strewn.labels[(k * ny + j) * nx + i] = 1;
    }
    let [alone, strewn] = [alone, strewn].map(|map| load(folder.path(), &map.bytes(), &scene_text("")).unwrap());
    assert_eq!((strewn.dims(), strewn.voxels().len()), (alone.dims(), alone.voxels().len()));
    assert!((strewn.origin_m() - alone.origin_m()).norm() < 1e-12);
    let scene = catalog::load(folder.path().join("scene.toml").to_str().unwrap()).unwrap();
    let warnings = examine(&scene, &mut |_| ()).unwrap().warnings;
    let told: Vec<String> = warnings.iter().map(ToString::to_string).filter(|text| text.contains("left out")).collect();
    assert!(
        matches!(&told[..], [one] if one.contains("m.nii.gz: 4 of the labels' pieces") && one.contains("11 of the file's voxels")),
        "{told:?}"
    );
}
