//! The state of one scene and the order of its step.

use crate::scene::{Scene, SceneError};
use crate::stage::StageClock;
use crate::step_io::{StepInputs, StepOutput};
use crate::surface::delta::{Keyframe, TopologyPatch};
use crate::workers::Workers;

/// What an object of a scene consists of at rest.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ObjectStats {
    /// Lower corner of its bounding box, m.
    pub rest_min_m: [f64; 3],
    /// Upper corner of its bounding box, m.
    pub rest_max_m: [f64; 3],
    /// Edge length of a fine voxel, m.
    pub voxel_size_m: f64,
    /// Fine voxels.
    pub voxels: u32,
    /// Composite elements.
    pub composite_elements: u32,
}

/// One scene: its objects, its tools and their state.
pub struct World {
    output: StepOutput,
}

impl World {
    /// Builds the scene at rest.
    ///
    /// # Errors
    /// A field of the scene whose value is not supported, with the field and the limit named.
    pub fn new(_scene: &Scene) -> Result<Self, SceneError> {
        Ok(Self { output: StepOutput::default() })
    }

    /// Advances the scene by one time step.
    pub fn step(&mut self, _workers: &Workers<'_>, _clock: &dyn StageClock, _inputs: &StepInputs<'_>) -> &StepOutput {
        self.output.step += 1;
        &self.output
    }

    /// What the last step reported.
    #[must_use]
    pub fn output(&self) -> &StepOutput {
        &self.output
    }

    /// What each object consisted of at rest.
    #[must_use]
    pub fn object_stats(&self) -> Vec<ObjectStats> {
        Vec::new()
    }

    /// Structure of the scene as it is now.
    #[must_use]
    pub fn keyframe(&mut self) -> Keyframe {
        Keyframe::default()
    }

    /// What the last step changed in the structure; `None` where no link parted, or where nobody
    /// has asked for a keyframe yet.
    #[must_use]
    pub fn topology_patch(&self) -> Option<&TopologyPatch> {
        None
    }

    /// Displacements of an object's nodes, xyz interleaved, m, scene frame, appended to `out`.
    pub fn node_displacements_m(&self, _object: usize, _out: &mut Vec<f32>) {}

    /// Hash of positions, velocities, fronts and topology.
    #[must_use]
    pub fn state_hash(&self) -> u64 {
        0
    }

    /// Hash of the surface's structure; see [`crate::surface::delta::hash_body`].
    #[must_use]
    pub fn surface_hash(&mut self) -> u64 {
        0
    }
}
