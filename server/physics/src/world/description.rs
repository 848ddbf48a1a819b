//! What a world is of: nothing of this changes while it is stepped.

use super::BodySlot;
use crate::Vec3;
use crate::grid::{Grid, MaterialPoint};
use crate::math::Aabb;
use crate::params::StepParams;
use crate::scene::wording::brief;
use crate::scene::{Scene, SceneError};
use crate::tool::part::{Carried, ToolPart};
use crate::walk;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// A material point that is followed.
pub(super) struct TrackedPoint {
    pub(super) body: usize,
    pub(super) point: MaterialPoint,
}

/// The constant part of a world, as the scene gave it, but for what its bodies are made of, which each has itself.
pub(super) struct Description {
    /// What a snapshot is known to be of the same scene by.
    pub(super) scene: Arc<SceneIdentity>,
    /// Time step, s.
    pub(super) dt_s: f64,
    /// See [`crate::SceneDesc::most_relative_residual`].
    pub(super) most_relative_residual: f64,
    /// The tools, and after them what they carry.
    pub(super) parts: Vec<ToolPart>,
    pub(super) tracked_points: Vec<TrackedPoint>,
    /// What leaves it is put away, scene frame.
    pub(super) reach: Aabb,
}

impl Description {
    /// What tools carry: the index of the part, and how it is carried.
    pub(super) fn carried(&self) -> impl Iterator<Item = (usize, &Carried)> {
        self.parts.iter().enumerate().filter_map(|(index, part)| Some((index, part.carried.as_ref()?)))
    }

    /// Indices of the parts that a tool consists of: of itself first.
    pub(super) fn parts_of(&self, tool: usize) -> impl Iterator<Item = usize> + Clone {
        let carried = self.parts.iter().enumerate().filter(move |(_, part)| part.carried.is_some_and(|c| c.by == tool));
        std::iter::once(tool).chain(carried.map(|(index, _)| index))
    }
}

/// By what a scene is known: its name, its steps, and hashes over all that it states.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct SceneIdentity {
    pub(super) name: String,
    pub(super) rate_hz: f64,
    /// By their paths, in the order of the scene.
    parts: Vec<(String, u64)>,
}

impl SceneIdentity {
    /// Path of the first part that only one of them has, or has otherwise.
    pub(super) fn difference<'a>(&'a self, other: &'a Self) -> Option<&'a str> {
        let first = self.parts.iter().zip(&other.parts).find(|(a, b)| a != b).map(|(a, _)| a);
        let beyond = || self.parts.get(other.parts.len()).or_else(|| other.parts.get(self.parts.len()));
        first.or_else(beyond).map(|(path, _)| path.as_str())
    }
}

/// Down to here a scene is told apart: `objects[0].material.young_modulus_pa`, and what is in it as a whole.
const DEPTH: usize = 4;

/// What a scene is known by: hashes over its description and its meshes, too.
pub(super) fn identity(scene: &Scene) -> SceneIdentity {
    let mut parts = walk::parts(&scene.desc, DEPTH);
    parts.extend(scene.meshes.iter().map(|(key, mesh)| {
        let hash = walk::hash(&(&mesh.positions, &mesh.triangles));
        (format!("meshes[{key:?}]"), hash)
    }));
    SceneIdentity { name: scene.desc.name.clone(), rate_hz: scene.desc.rate_hz, parts }
}

/// How a scene's steps are taken.
pub(super) fn params(scene: &Scene) -> Result<StepParams, SceneError> {
    let desc = &scene.desc;
    if let Some(dial) = &desc.dial {
        let message = format!("{dial} is not settled; a world is built of a setting");
        return Err(SceneError::Field { field: "dial".into(), message });
    }
    Ok(StepParams {
        dt_s: 1.0 / desc.rate_hz,
        relative_tolerance: desc.relative_tolerance(),
        max_iterations: desc.solver.max_iterations,
    })
}

/// The points of a scene that are followed, in these bodies.
pub(super) fn tracked_points(scene: &Scene, slots: &[BodySlot]) -> Result<Vec<TrackedPoint>, SceneError> {
    (0..scene.desc.tracked_points.len()).map(|index| tracked_point(scene, index, slots)).collect()
}

fn tracked_point(scene: &Scene, index: usize, slots: &[BodySlot]) -> Result<TrackedPoint, SceneError> {
    let error = |message: String| SceneError::Field { field: format!("tracked_points[{index}].position_m"), message };
    let desc = &scene.desc.tracked_points[index];
    let (object, position_m) = (&desc.object, Vec3::from(desc.position_m));
    let body = scene.desc.objects.iter().position(|o| o.name == *object);
    let body = body.ok_or_else(|| error(format!("there is no object named `{object}`")))?;
    let grid = &slots[body].body.state.grid;
    let voxel = grid.voxel_at(grid.cell_of(&position_m)).ok_or_else(|| error(outside(grid, object, &position_m)))?;
    Ok(TrackedPoint { body, point: MaterialPoint { position_m, voxel } })
}

/// What is said of a tracked point in no voxel: where the nearest one is.
fn outside(grid: &Grid, object: &str, position_m: &Vec3) -> String {
    let told = |point: Vec3| format!("[{}, {}, {}]", brief(point.x), brief(point.y), brief(point.z));
    let centres = grid.voxels().iter().map(|voxel| grid.centre_m(voxel.ijk));
    let away = |centre: &Vec3| (centre - position_m).norm_squared();
    let nearest = centres.min_by(|a, b| away(a).total_cmp(&away(b))).map_or("none".to_owned(), told);
    format!("{} lies in no voxel of `{object}`; the nearest voxel's centre is {nearest}", told(*position_m))
}
