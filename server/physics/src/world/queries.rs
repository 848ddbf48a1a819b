//! What a world tells of itself between steps: its size, its surface, its hashes.

use super::World;
use super::body_slot::BodySlot;
use crate::Vec3;
use crate::grid::LeftOut;
use crate::math::Aabb;
use crate::tool::Pose;
use crate::walk;

/// What an object of a scene consists of.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ObjectStats {
    /// Lower corner of its bounding box at rest, m.
    pub rest_min_m: [f64; 3],
    /// Upper corner of its bounding box at rest, m.
    pub rest_max_m: [f64; 3],
    /// Edge length of a fine voxel, m.
    pub voxel_size_m: f64,
    /// Fine voxels.
    pub voxels: u32,
    /// Composite elements as they are now.
    pub composite_elements: u32,
    /// What of its shape was left out.
    pub left_out: LeftOut,
}

/// Numbers of things in a scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WorldCounts {
    /// Fine voxels.
    pub voxels: usize,
    /// Composite elements of the levels solved on.
    pub composite_elements: usize,
    /// Nodes of the levels solved on.
    pub nodes: usize,
    /// Vertices of the surface.
    pub surface_vertices: usize,
    /// Triangles of the surface.
    pub surface_triangles: usize,
    /// Separate pieces.
    pub parts: usize,
}

/// A place where tissue presses on tissue.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TissuePress {
    /// The object that is pressed, and the one that presses; the same where parts of one meet.
    pub objects: [usize; 2],
    /// Normal force on the first, N, scene frame; the second takes the opposite.
    pub force_n: Vec3,
    /// How far the second has come into the first, m.
    pub depth_m: f64,
}

impl World {
    /// Numbers of things in the scene as it is now; contours the surface if nobody has yet.
    #[must_use]
    pub fn counts(&mut self) -> WorldCounts {
        let mut counts = WorldCounts::default();
        for (_, surface) in self.bodies_and_surfaces() {
            counts.surface_vertices += surface.vertices().len();
            counts.surface_triangles += 2 * surface.quads().len();
        }
        for slot in &self.state.slots {
            counts.voxels += slot.body.state.grid.voxels().len();
            counts.composite_elements += slot.body.element_count();
            counts.nodes += slot.body.node_count();
            counts.parts += slot.body.part_count() as usize;
        }
        counts
    }

    /// What each object consists of.
    #[must_use]
    pub fn object_stats(&self) -> Vec<ObjectStats> {
        let stats = |slot: &BodySlot| {
            let grid = &slot.body.state.grid;
            let centres = grid.voxels().iter().map(|v| grid.centre_m(v.ijk));
            let aabb = Aabb::around(centres).grown(0.5 * grid.voxel_size_m());
            ObjectStats {
                left_out: grid.left_out(),
                rest_min_m: aabb.min_m.into(),
                rest_max_m: aabb.max_m.into(),
                voxel_size_m: grid.voxel_size_m(),
                voxels: grid.voxels().len() as u32,
                composite_elements: slot.body.element_count() as u32,
            }
        };
        self.state.slots.iter().map(stats).collect()
    }

    /// Where each tool is, and the fraction of their full opening that its jaws take; `None`: it is lifted.
    pub fn tool_places(&self) -> impl Iterator<Item = Option<(Pose, f64)>> + '_ {
        self.state.tools[..self.output.tools.len()].iter().map(|tool| tool.pose.map(|pose| (pose, tool.opening)))
    }

    /// Whether an object sleeps: it was at rest, and steps leave it as it is until something wakes it.
    #[cfg(test)]
    pub(crate) fn is_asleep(&self, object: usize) -> bool {
        self.state.slots[object].is_asleep()
    }

    /// Where tissue presses on tissue, as the last step left it; nowhere where links parted in it.
    pub fn tissue_presses(&self) -> impl Iterator<Item = TissuePress> + '_ {
        let springs = self.state.tissue.iter().flat_map(|tissue| tissue.springs());
        springs.map(|spring| TissuePress {
            objects: spring.ends.ends.each_ref().map(|end| end.body as usize),
            force_n: spring.direction * spring.force_n,
            depth_m: spring.gap_m,
        })
    }

    /// Springs between tissue and tissue as the last step left them; none where links parted in it.
    #[cfg(test)]
    pub(crate) fn tissue_springs(&self) -> &[crate::contact::TissueContact] {
        self.state.tissue.as_ref().map_or(&[], |tissue| tissue.springs())
    }

    /// Displacements of an object's nodes, xyz interleaved, m, scene frame, appended to `out`.
    pub fn node_displacements_m(&self, object: usize, out: &mut Vec<f32>) {
        let body = &self.state.slots[object].body;
        for (node, x) in body.state.position_m.iter().enumerate() {
            let rest = body.rest_position_m(node);
            out.extend((0..3).map(|i| (x[i] - rest[i]) as f32));
        }
    }

    /// Hash of all that the next step depends on, by its bits: two worlds of a scene whose hashes agree go on to the
    /// same bits.
    #[must_use]
    pub fn state_hash(&self) -> u64 {
        walk::hash(&self.state)
    }
}
