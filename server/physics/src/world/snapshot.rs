//! A world's state between two steps, to go back to.

use super::World;
use super::contact_model::ToolModel;
use super::description::SceneIdentity;
use super::state::State;
use crate::step_io::StepOutput;
use crate::walk;
use std::sync::Arc;

/// The state of a world as a step left it: [`World::snapshot`].
///
/// Deliberately absent: the surface, which follows from the state; what a body is made of, which never changes and which
/// the worlds share; and the room that a step works in. What of the solver follows the state with a lag is part of it:
/// made anew it would lead on to other bits.
#[derive(Clone)]
pub struct Snapshot {
    pub(super) scene: Arc<SceneIdentity>,
    pub(super) state: State,
    pub(super) output: StepOutput,
}

impl Snapshot {
    /// Steps taken when it was made.
    #[must_use]
    pub fn step(&self) -> u64 {
        self.state.step
    }

    /// Simulated time when it was made, s.
    #[must_use]
    pub fn sim_time_s(&self) -> f64 {
        self.output.sim_time_s
    }

    /// What [`World::state_hash`] was then.
    #[must_use]
    pub fn state_hash(&self) -> u64 {
        walk::hash(&self.state)
    }

    /// Path of the first number of the state, from its top, in which the two differ by their bits.
    #[must_use]
    pub fn difference(&self, other: &Self) -> Option<String> {
        walk::difference(&self.state, &other.state)
    }
}

impl World {
    /// A copy of the state, tools and their contacts included.
    #[must_use]
    pub fn snapshot(&self) -> Snapshot {
        let scene = Arc::clone(&self.description.scene);
        Snapshot { scene, state: self.state.clone(), output: self.output.clone() }
    }

    /// Goes back to a snapshot of this world, or of one of the same scene: the same inputs lead on to the
    /// same bits. The surface is forgotten.
    pub fn restore(&mut self, snapshot: &Snapshot) {
        self.state.clone_from(&snapshot.state);
        // A copy has room for what it holds and no more.
        self.state.reserve();
        self.scratch.models.iter_mut().for_each(|model| *model = ToolModel::default());
        self.output.clone_from(&snapshot.output);
        self.forget_surface();
    }
}
