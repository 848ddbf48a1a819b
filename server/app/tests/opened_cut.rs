//! A cut half way through a solid, opened and written as a viewer would get it.

use kerf_physics::surface::Surface;
use kerf_physics::{Crossing, Grid, Ijk, LinkId, Vec3, Voxel};
use kerf_replica::{Face, glb};
use kerf_server::simulate::surface::triangles;

const VOXEL_SIZE_M: f64 = 0.004;
const CELLS: [i32; 3] = [34, 22, 28];
const SEMI_AXES_M: [f64; 3] = [0.064, 0.04, 0.052];
/// Height the blade has come down to.
const FRONT_HEIGHT_M: f64 = 0.035;

fn middle_m() -> Vec3 {
    Vec3::from(CELLS.map(f64::from)) * (VOXEL_SIZE_M / 2.0)
}

/// Distance to the oblique plane of the cut, m, and its normal.
fn plane_distance_m(x: &Vec3) -> (f64, Vec3) {
    let normal = Vec3::new(1.0, 0.15, 0.35).normalize();
    (normal.dot(&(x - middle_m())), normal)
}

/// An ellipsoid in the middle of the grid.
fn ellipsoid() -> Grid {
    let centre_m = |cell: Ijk| Vec3::from_fn(|a, _| (f64::from(cell[a]) + 0.5) * VOXEL_SIZE_M);
    let scaled = |x: &Vec3| (x - middle_m()).component_div(&Vec3::from(SEMI_AXES_M));
    let mut voxels = Vec::new();
    for k in 0..CELLS[2] {
        for j in 0..CELLS[1] {
            voxels.extend((0..CELLS[0]).map(|i| Voxel { ijk: [i, j, k], material: 0 }));
        }
    }
    voxels.retain(|voxel| scaled(&centre_m(voxel.ijk)).norm() < 1.0);
    let boundary = |link: LinkId| {
        let (lower, upper) = (centre_m(link.cell), centre_m(link.upper()));
        // |scaled(lower + t (upper - lower))| = 1 has one root on a link with one end inside.
        let (from, along) = (scaled(&lower), scaled(&upper) - scaled(&lower));
        let (a, b, c) = (along.norm_squared(), from.dot(&along), from.norm_squared() - 1.0);
        let root = (b * b - a * c).sqrt();
        let t = if c < 0.0 { (-b + root) / a } else { (-b - root) / a };
        let normal = scaled(&lower.lerp(&upper, t)).component_div(&Vec3::from(SEMI_AXES_M)).normalize();
        Crossing { t: t as f32, normal: normal.map(|c| c as f32).into() }
    };
    Grid::new(VOXEL_SIZE_M, Vec3::zeros(), CELLS, voxels, |c| (scaled(&centre_m(c)).norm() - 1.0) as f32, boundary)
}

/// Parts the links that cross the plane above the front.
fn cut_from_above(grid: &mut Grid) -> usize {
    let mut parted = 0;
    for voxel in grid.voxels().to_vec() {
        for axis in 0..3 {
            let link = LinkId { cell: voxel.ijk, axis };
            let (lower, upper) = (grid.centre_m(link.cell), grid.centre_m(link.upper()));
            let ((at_lower, normal), (at_upper, _)) = (plane_distance_m(&lower), plane_distance_m(&upper));
            let t = at_lower / (at_lower - at_upper);
            if (at_lower < 0.0) != (at_upper < 0.0) && lower.lerp(&upper, t).y > FRONT_HEIGHT_M {
                let normal = normal * (at_upper - at_lower).signum();
                parted +=
                    usize::from(grid.part(link, Crossing { t: t as f32, normal: normal.map(|c| c as f32).into() }));
            }
        }
    }
    parted
}

/// Pulls the lips apart as a wedge would, more the higher; nothing moves below the front.
fn opened_m(position_m: [f32; 3], voxel_centre_m: &Vec3) -> [f32; 3] {
    let x = Vec3::from(position_m.map(f64::from));
    let (distance_m, normal) = plane_distance_m(&x);
    let side = if plane_distance_m(voxel_centre_m).0 < 0.0 { -1.0 } else { 1.0 };
    let height_m = (x.y - FRONT_HEIGHT_M - VOXEL_SIZE_M).max(0.0);
    let opening_m = 0.3 * height_m * (-(distance_m / 0.04).powi(2)).exp();
    (x + normal * (side * opening_m)).map(|c| c as f32).into()
}

#[test]
fn an_opened_cut_has_clean_lips_and_no_spikes() {
    let mut grid = ellipsoid();
    let skin_triangles = Surface::build(&grid).quads().len() * 2;
    let parted = cut_from_above(&mut grid);
    let surface = Surface::build(&grid);
    let mesh = triangles(&grid, &surface, |_, vertex| {
        opened_m(vertex.position_m, &grid.centre_m(grid.voxels()[vertex.voxel.index()].ijk))
    });
    let path = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("opened_cut.glb");
    glb::write(&path, &[glb::Object { name: "opened cut".into(), surface: mesh.clone(), ..glb::Object::default() }])
        .unwrap();

    let cut_triangles = mesh.triangles.iter().filter(|t| t.face == Face::Cut).count();
    assert_eq!((cut_triangles, mesh.triangles.len()), (parted * 4, skin_triangles + parted * 4));
    let at = |index: u32| Vec3::from(mesh.positions_m[index as usize].map(f64::from));
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.vertices.map(at);
        let longest_m = (a - b).norm().max((b - c).norm()).max((c - a).norm());
        assert!(longest_m < 2.5 * VOXEL_SIZE_M, "a spike of {longest_m} m at {a}");
    }
}
