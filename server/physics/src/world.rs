//! The state of one scene and the order of its step.

use crate::scene::{Scene, SceneError};
use crate::stage::StageClock;
use crate::step_io::{StepInputs, StepOutput};
use crate::surface::delta::{Keyframe, TopologyPatch};
use crate::workers::Workers;

/// Sizes of a scene as it is now, over all its objects.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WorldCounts {
    /// Fine voxels.
    pub voxels: usize,
    /// Composite elements.
    pub composite_elements: usize,
    /// Nodes of the composite elements.
    pub nodes: usize,
    /// Vertices of the surface.
    pub surface_vertices: usize,
    /// Triangles of the surface.
    pub surface_triangles: usize,
    /// Pieces that hang together.
    pub parts: usize,
}

/// How a search for rest ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Relaxation {
    /// Solves that were made.
    pub solves: u32,
    /// Relative residual of the forces at the end.
    pub relative_residual: f64,
    /// Whether the residual came below the scene's tolerance.
    pub converged: bool,
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
    pub fn new(scene: &Scene) -> Result<Self, SceneError> {
        let output = StepOutput {
            tools: vec![Default::default(); scene.desc.tools.len()],
            probe_displacement_m: vec![Default::default(); scene.desc.probes.len()],
            ..StepOutput::default()
        };
        Ok(Self { output })
    }

    /// Advances the scene by one time step.
    pub fn step(&mut self, _workers: &Workers<'_>, _clock: &dyn StageClock, _inputs: &StepInputs<'_>) -> &StepOutput {
        self.output.step += 1;
        &self.output
    }

    /// Takes the scene to rest under its loads, tools lifted, whatever the way there. `progress` is
    /// told the relative residual after each solve.
    pub fn relax(&mut self, _workers: &Workers<'_>, progress: &mut dyn FnMut(f64)) -> Relaxation {
        progress(0.0);
        Relaxation { solves: 0, relative_residual: 0.0, converged: true }
    }

    /// Sizes of the scene as it is now.
    #[must_use]
    pub fn counts(&mut self) -> WorldCounts {
        WorldCounts::default()
    }

    /// What the last step reported.
    #[must_use]
    pub fn output(&self) -> &StepOutput {
        &self.output
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
