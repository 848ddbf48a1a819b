//! A world's state between two steps, to go back to.

use super::World;
use super::contact_model::ToolModel;
use super::state::State;
use crate::step_io::StepOutput;

/// The state of a world as a step left it: [`World::snapshot`].
///
/// Deliberately absent: the surface, which follows from the state; what a body is made of, which never changes and which
/// the worlds share; and the room that a step works in. The solver's matrices are kept, for they follow the state with a
/// lag: made anew they would lead on to other bits.
pub struct Snapshot {
    state: State,
    output: StepOutput,
}

impl Snapshot {
    /// Steps taken when it was made.
    #[must_use]
    pub fn step(&self) -> u64 {
        self.state.step
    }
}

impl World {
    /// A copy of the state, tools and their contacts included.
    #[must_use]
    pub fn snapshot(&self) -> Snapshot {
        Snapshot { state: self.state.clone(), output: self.output.clone() }
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
