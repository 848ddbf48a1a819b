//! What is cut: the first object of a built-in scene, or a mesh of the liver's size and material.

use std::path::Path;

use anyhow::{Context, Result};
use kerf_physics::scene::{BladeDesc, EdgeDesc, Meshes, ShapeDesc, ToolDesc, TriangleMesh};
use kerf_physics::{SoundScene, Vec3};
use kerf_scenes::catalog;
use kerf_scenes::file::read_mesh;

use crate::extremes::scenes::below;

/// Longest edge of a mesh's bounding box in the scene, m: the liver's.
const LONGEST_M: f64 = 0.2;
/// Fraction of a mesh's extent along y, from its lower end, that is held: what is held by less gives way before it
/// is cut.
const HELD_SHARE: f64 = 0.3;
/// Slow enough for many strokes; with 20 voxels to a model one of 1 m/s goes on by less than a voxel in a step.
const RATE_HZ: f64 = 125.0;
/// What the solver leaves is what the ledger leaves unexplained: at this rate's default, 4.8e-3, up to 3e-2 of the
/// tools' work.
const TOLERANCE: f64 = 1e-3;
/// Every edge reaches so far, m: half a model.
const WIDTH_M: f64 = 0.1;

/// A model ready to be cut.
#[derive(Clone)]
pub struct Model {
    /// What it is called in reports.
    pub name: String,
    /// One object and [`BLADES`].
    pub scene: SoundScene,
}

/// Names of the blades of every scene, in the order of its tools.
pub const BLADES: [&str; 3] = ["straight", "sine", "arc"];

impl Model {
    /// The first object of a built-in scene, or the mesh of a file scaled to the liver's length and of its material, with
    /// `resolution` voxels along its longest edge. Pieces that are cut off stay where they are: gravity and loads are taken
    /// away.
    ///
    /// # Errors
    /// The file cannot be read, or its mesh is refused.
    pub fn new(name_or_path: &str, resolution: u32) -> Result<Self> {
        let path = Path::new(name_or_path);
        let mesh = if path.extension().is_some() { Some(read_mesh(path)?) } else { None };
        let mut scene = catalog::builtin(if mesh.is_some() { "liver" } else { name_or_path })?.into_scene();
        scene.desc.objects.truncate(1);
        let object = &mut scene.desc.objects[0];
        (object.voxel_size_m, object.resolution) = (None, Some(resolution));
        object.loads.clear();
        let mut name = name_or_path.to_owned();
        if let Some(mesh) = mesh {
            name = path.file_stem().context("a mesh has a name")?.to_string_lossy().into_owned();
            let [min, max] = corners(&mesh);
            let scale_m_per_unit = LONGEST_M / (max - min).max();
            object.name.clone_from(&name);
            object.shape = ShapeDesc::Mesh { file: name.clone(), scale_m_per_unit, offset_m: [0.0; 3] };
            object.fixed = vec![below(scale_m_per_unit * (min.y + HELD_SHARE * (max.y - min.y)))];
            scene.meshes = Meshes::from([(name.clone(), mesh)]);
        }
        scene.desc.rate_hz = RATE_HZ;
        scene.desc.solver.relative_tolerance = Some(TOLERANCE);
        scene.desc.gravity_m_per_s2 = [0.0; 3];
        scene.desc.tracked_points.clear();
        scene.desc.tools = BLADES.iter().map(|blade| ToolDesc::blade(blade, self::blade(blade))).collect();
        Ok(Self { name, scene: scene.judge()? })
    }
}

fn blade(name: &str) -> BladeDesc {
    let edge = match name {
        "sine" => EdgeDesc::Sine { amplitude_m: 0.1 * WIDTH_M, wavelength_m: 0.5 * WIDTH_M },
        "arc" => EdgeDesc::Arc { sagitta_m: 0.2 * WIDTH_M },
        _ => EdgeDesc::Straight,
    };
    BladeDesc { edge, thickness_m: 1e-3, ..BladeDesc::straight(WIDTH_M, WIDTH_M) }
}

/// Corners of a mesh's bounding box, in its units.
fn corners(mesh: &TriangleMesh) -> [Vec3; 2] {
    let points =
        || mesh.triangles.iter().flatten().filter_map(|v| mesh.positions.get(*v as usize)).map(|p| Vec3::from(*p));
    let far = Vec3::repeat(f64::INFINITY);
    [points().fold(far, |low, p| low.inf(&p)), points().fold(-far, |high, p| high.sup(&p))]
}
