//! Whether a tool could be put down without touching anything.

use super::World;
use crate::Vec3;
use crate::body::Body;
use crate::contact::broad::NearElements;
use crate::contact::{ON_SURFACE_VOXELS, narrow};
use crate::math::Aabb;
use crate::tool::blade::Blade;
use crate::tool::capsule::Capsule;
use crate::tool::scissors::Mount;
use crate::tool::{Pose, ToolShape};

/// Distance between the points of a tool that are looked at, voxels. Half of it finds corners of tissue of half a
/// voxel, which no contact resolves; twice misses a voxel that a blade stands in.
const SPACING_VOXELS: f64 = 1.0;

impl World {
    /// Whether a tool that is put down at a pose, its jaws open by the fraction `opening` of their full opening, has no
    /// tissue where its blades or its surface are, but for half a voxel. Jaws take hold of nothing before they close.
    #[must_use]
    pub fn is_clear(&self, tool: usize, pose: &Pose, opening: f64) -> bool {
        self.description.parts_of(tool).all(|index| {
            let part = &self.description.parts[index];
            self.is_clear_of(&part.shape, &part.carried.map_or(*pose, |c| pose.of_carried(&c.place)), opening)
        })
    }

    fn is_clear_of(&self, shape: &ToolShape, pose: &Pose, opening: f64) -> bool {
        let bodies = || self.state.slots.iter().map(|slot| &slot.body);
        match shape {
            ToolShape::Grasper(_) => true,
            ToolShape::Probe(capsule) => bodies().all(|body| is_clear_of_probe(body, capsule, pose)),
            ToolShape::Blade(blade) => bodies().all(|body| is_clear_of_blade(body, blade, pose)),
            ToolShape::Scissors(scissors) => {
                let poses = scissors.mounts().map(|mount: Mount| mount.edge_pose(pose, opening));
                bodies().all(|body| poses.iter().all(|pose| is_clear_of_blade(body, &scissors.blade, pose)))
            }
        }
    }
}

/// Whether no point between a blade's edge and its spine is in tissue.
fn is_clear_of_blade(body: &Body, blade: &Blade, pose: &Pose) -> bool {
    let spacing_m = SPACING_VOXELS * body.state.grid.voxel_size_m();
    let height_m = blade.flanks.height_m();
    let rises = (height_m / spacing_m).ceil() as u32;
    let along = blade.edge.segments(spacing_m);
    let ends = [blade.edge.points_m().first(), blade.edge.points_m().last()];
    let edge_m = along.iter().map(|segment| segment.middle_m).chain(ends.into_iter().flatten().copied());
    let rise_m = |i: u32| Vec3::y() * (height_m * f64::from(i) / f64::from(rises.max(1)));
    let sheet_m = (0..=rises).flat_map(|i| edge_m.clone().map(move |at| at + rise_m(i)));
    is_free(body, sheet_m.map(|local| pose.transform(&local)))
}

/// Whether a smooth tool is on no patch of the surface, nor wholly within.
fn is_clear_of_probe(body: &Body, capsule: &Capsule, pose: &Pose) -> bool {
    let spacing_m = SPACING_VOXELS * body.state.grid.voxel_size_m();
    let pieces = (2.0 * capsule.half_length_m / spacing_m).ceil().max(1.0) as u32;
    let along = |i: u32| capsule.half_length_m * (2.0 * f64::from(i) / f64::from(pieces) - 1.0);
    let axis_m = (0..=pieces).map(|i| pose.transform(&(Vec3::x() * along(i))));
    let near = Aabb::around(axis_m.clone()).grown(capsule.radius_m);
    let skin = body.boundary().skin().into_iter();
    let patches = skin.flat_map(|skin| body.elements_near([near]).flat_map(|element| skin.of_element(element as u32)));
    let is_in = |at_m: Vec3| capsule.nearest(&pose.to_local(&at_m)).distance_m < -on_surface_m(body);
    !patches.map(|patch| body.current_m(&patch.point)).any(is_in) && is_free(body, axis_m)
}

/// Whether none of some points, scene frame, is deep in tissue.
fn is_free(body: &Body, mut points_m: impl Iterator<Item = Vec3> + Clone) -> bool {
    let near = Aabb::around(points_m.clone());
    if !near.meets(&body.bounds()) {
        return true;
    }
    let mut elements = NearElements::default();
    elements.find(body, [near]);
    let depth_m = |at_m: Vec3| {
        let point = narrow::locate(body, &elements, &at_m)?;
        Some(-body.state.grid.signed_distance_m(&point.position_m))
    };
    !points_m.any(|at_m| depth_m(at_m).is_some_and(|depth_m| depth_m > on_surface_m(body)))
}

fn on_surface_m(body: &Body) -> f64 {
    ON_SURFACE_VOXELS * body.state.grid.voxel_size_m()
}
