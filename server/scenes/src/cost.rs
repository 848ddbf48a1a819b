//! What a scene will cost, told before it is built: from its volume, which a lattice of few cells gives.
//!
//! Deliberately absent: exactness. A scene is refused or admitted by these figures, nothing is sized by them.

use kerf_physics::scene::{Meshes, ObjectDesc};
use kerf_physics::{SceneError, SceneProblems, SoundScene, measures, voxelize, wanted_levels};

/// Cells along the longest side of the lattice that volumes are taken from.
const COARSE_RESOLUTION: u32 = 24;
/// Memory of a voxel: its links, its surface and its share of the multigrid's levels. Blocks of 16 to 48 voxels a side
/// at levels 0 to 3 take 110 B; a cut and a viewer add to that.
const BYTES_PER_VOXEL: f64 = 250.0;
/// Memory of a composite element: matrices, factors and state. The same blocks take 8.9 kB.
const BYTES_PER_ELEMENT: f64 = 10_000.0;
/// Memory of a cell of the lattice that a shape is sampled on, while the scene is built.
const BYTES_PER_CELL: f64 = 24.0;
/// Time of a step per element on one thread, s: the liver under a blade, 0.86 ms of 677 elements; the same
/// at level 0, 58 ms of 30,420.
const STEP_S_PER_ELEMENT: f64 = 1.3e-6;
/// Time that an element takes to be built, s.
const SETUP_S_PER_ELEMENT: f64 = 4e-5;
/// Time that a cell of the lattice takes to be sampled, s.
const SETUP_S_PER_CELL: f64 = 2e-6;

/// What a scene will cost.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cost {
    /// Memory at its highest, bytes.
    pub bytes: f64,
    /// Time to build it, s.
    pub setup_s: f64,
    /// Time of a step in which a tool works, on one thread, s.
    pub step_s: f64,
}

impl Cost {
    /// What a scene costs.
    ///
    /// # Errors
    /// A shape that cannot be voxelized.
    pub fn of(scene: &SoundScene) -> Result<Self, SceneProblems> {
        let mut cost = Self::default();
        for object in &scene.desc.objects {
            let Counts { cells, voxels, elements } = Counts::of(object, &scene.meshes)?;
            cost.bytes += BYTES_PER_CELL * cells + BYTES_PER_VOXEL * voxels + BYTES_PER_ELEMENT * elements;
            cost.setup_s += SETUP_S_PER_CELL * cells + SETUP_S_PER_ELEMENT * elements;
            cost.step_s += STEP_S_PER_ELEMENT * elements;
        }
        Ok(cost)
    }
}

/// How many there will be of what an object consists of.
struct Counts {
    cells: f64,
    voxels: f64,
    elements: f64,
}

impl Counts {
    fn of(object: &ObjectDesc, meshes: &Meshes) -> Result<Self, SceneError> {
        let measures = measures(object, meshes)?;
        let size_m = measures.map_or(f64::INFINITY, |measures| measures.voxel_size_m);
        let extent_m = measures.and_then(|measures| measures.extent_m).unwrap_or_default();
        let across = extent_m.map(|length_m| (length_m / size_m).ceil());
        let (cells, in_box) = (across.add_scalar(2.0).product(), across.product());
        let coarse_size_m = size_m.max(extent_m.max() / f64::from(COARSE_RESOLUTION));
        let coarse = ObjectDesc { voxel_size_m: Some(coarse_size_m), resolution: None, ..object.clone() };
        let Ok(grid) = voxelize(&coarse, meshes) else {
            // Thinner than the coarse cells: no more is known than its box.
            return Ok(Self { cells, voxels: in_box, elements: in_box / voxels_of_element(lowest_level(object)) });
        };
        let voxels_per_coarse = (coarse_size_m / size_m).powi(3);
        let levels = wanted_levels(&grid, object, meshes, size_m)?;
        // Elements that the surface cuts are counted whole: half an element's edge more on each side.
        let coarse_side = (levels.len() as f64).cbrt();
        let elements = |level: &u8| {
            let edge = size_m * f64::from(1 << level) / coarse_size_m;
            (1.0 + edge / coarse_side).powi(3) * voxels_per_coarse / voxels_of_element(*level)
        };
        Ok(Self { cells, voxels: voxels_per_coarse * levels.len() as f64, elements: levels.iter().map(elements).sum() })
    }
}

/// Voxels of an element that is full.
fn voxels_of_element(level: u8) -> f64 {
    8_f64.powi(i32::from(level))
}

fn lowest_level(object: &ObjectDesc) -> u8 {
    object.finer.iter().map(|finer| finer.level).fold(object.level, u8::min)
}

#[cfg(test)]
mod tests {
    use kerf_physics::World;

    use super::*;
    use crate::catalog;

    #[test]
    fn counts_are_those_of_the_scene_that_is_built() {
        for name in ["liver", "cuboid", "hepatectomy", "two-organs"] {
            let scene = catalog::builtin(name).unwrap();
            let built = World::new(&scene).unwrap().object_stats();
            for (object, built) in scene.desc.objects.iter().zip(built) {
                let told = Counts::of(object, &scene.meshes).unwrap();
                let (voxels, elements) =
                    (told.voxels / f64::from(built.voxels), told.elements / f64::from(built.composite_elements));
                assert!((0.8..1.3).contains(&voxels), "{name}: {voxels} of the voxels");
                assert!((0.6..2.0).contains(&elements), "{name}: {elements} of the elements");
            }
        }
    }
}
