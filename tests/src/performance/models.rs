//! The paper's horse, armadillo and bunny, from scanned meshes.

use anyhow::Result;
use kerf_physics::scene::{Meshes, ShapeDesc};
use kerf_physics::{Scene, SceneDesc, SoundScene, voxelize};
use kerf_scenes::file::read_mesh;

use crate::shared;

/// How a file becomes a row of the paper's Table 1: about as many voxels, and the level whose number of elements is
/// nearest (`cargo test -p kerf-system-tests paper_models`). As scanned, none turned: y is up, and all stand on
/// their feet. The paper has as many voxels in smaller boxes, 28 x 23 x 14, 46 x 54 x 40 and 56 x 56 x 44; in those
/// these meshes would have 932, 10,834 and 35,112: its own are fatter, or it counts voxels that are not inside.
pub struct Model {
    /// Name of the mesh's file.
    pub file: &'static str,
    /// Metres per unit of the file: 15 to 18 cm the longest way, as the scans are.
    scale_m_per_unit: f64,
    /// Voxels along the longest edge of the mesh's box.
    resolution: u32,
    /// Layers of voxels that are held.
    held_layers: f64,
}

/// A horse, held up to its knees: on its hooves alone its legs buckle under the blade at 16 N, before it is cut.
pub const HORSE: Model = Model { file: "horse.ply", scale_m_per_unit: 1.0, resolution: 48, held_layers: 8.0 };
/// An armadillo.
pub const ARMADILLO: Model = Model { file: "armadillo.obj", scale_m_per_unit: 0.15, resolution: 63, held_layers: 3.0 };
/// A bunny.
pub const BUNNY: Model = Model { file: "bunny.obj", scale_m_per_unit: 1.0, resolution: 60, held_layers: 3.0 };

impl Model {
    /// The scene, its lowest layers held, under a blade that reaches over it; `None` where no folder of meshes is
    /// named. The modulus is the paper's, the fracture energy one that linear elements carry. They have no weight: at
    /// this modulus a horse's legs buckle under it, at level 0 as at level 3.
    ///
    /// # Errors
    /// The mesh is missing in the folder that is named, or cannot be read.
    pub fn scene(&self) -> Result<Option<SoundScene>> {
        let Some(path) = shared::model(self.file)? else { return Ok(None) };
        let Self { file, scale_m_per_unit, resolution, held_layers } = self;
        let text = format!(
            "version = 1\nname = \"{file}\"\nrate_hz = 1000.0\ngravity_m_per_s2 = [0.0, 0.0, 0.0]\n\
             [[objects]]\nname = \"body\"\nresolution = {resolution}\nlevel = 3\n\
             shape = {{ mesh = {{ file = \"{file}\", scale_m_per_unit = {scale_m_per_unit} }} }}\n\
             [objects.material]\nyoung_modulus_pa = 2.0e6\npoisson_ratio = 0.45\nrayleigh_alpha_per_s = 1.0\n\
             rayleigh_beta_s = 2.0e-4\nfracture_energy_j_per_m2 = 1000.0\n\
             [[tools]]\nname = \"blade\"\nshape = {{ blade = {{ width_m = 0.3, height_m = 0.2 }} }}\n"
        );
        let meshes = Meshes::from([((*file).to_owned(), read_mesh(&path)?)]);
        let mut scene = Scene { desc: SceneDesc::from_toml(file, &text)?, meshes };
        let grid = voxelize(&scene.desc.objects[0], &scene.meshes)?;
        let held_m = grid.origin_m().y + held_layers * grid.voxel_size_m();
        scene.desc.objects[0].fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, held_m, 1.0] }];
        Ok(Some(scene.judge()?))
    }
}
