//! A recorded session once more: its steps and events, from the scene at rest to the same bits.

use std::sync::Arc;

use kerf_physics::step_io::EnergyStep;
use kerf_physics::world::{LoadError, Snapshot};
use kerf_physics::{NoClock, SceneProblems, SoundScene, Workers, World};

use crate::checkpoints::{Besides, Checkpoint};
use crate::tape::{LoggedInputs, TapeEntry};
use crate::view_message::SceneEvent;

/// Why a session is not what its recording says.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum Difference {
    /// A step led elsewhere.
    #[error("step {step}: the state that it leads to has the hash {simulated:016x}, recorded is {recorded:016x}")]
    State {
        /// The step.
        step: u64,
        /// Hash of the state that was simulated.
        simulated: u64,
        /// Hash that the recording has.
        recorded: u64,
    },
    /// A step is missing or out of order.
    #[error("step {recorded} is recorded where step {simulated} should be")]
    Order {
        /// The step that follows in the simulation.
        simulated: u64,
        /// The step that follows in the recording.
        recorded: u64,
    },
    /// A way back to nowhere.
    #[error("the recording goes back to checkpoint {name:?}, which it has not saved")]
    NoCheckpoint {
        /// Its name.
        name: Arc<str>,
    },
    /// A step has an input of a tool that the scene does not have.
    #[error("step {step}: it has an input of tool {tool}, and the scene has {tools}")]
    NoTool {
        /// The step.
        step: u64,
        /// The tool.
        tool: usize,
        /// Tools of the scene.
        tools: usize,
    },
    /// The scene cannot be built.
    #[error(transparent)]
    Scene(#[from] SceneProblems),
}

/// A world that follows a recording.
pub struct Resimulation<'a> {
    scene: &'a SoundScene,
    world: World,
    /// Booked since the session began or was reset.
    energy: EnergyStep,
    /// By tool: somebody holds it, or did where the recording begins.
    is_held: Vec<bool>,
    /// In the order of saving.
    checkpoints: Vec<(Arc<str>, Resimulated)>,
}

/// A checkpoint that a recording led to, or had.
#[derive(Clone)]
pub(crate) struct Resimulated {
    pub snapshot: Arc<Snapshot>,
    pub besides: Besides,
}

impl<'a> Resimulation<'a> {
    /// The scene at rest.
    ///
    /// # Errors
    /// It cannot be built.
    pub fn new(scene: &'a SoundScene) -> Result<Self, Difference> {
        Ok(Self::of(scene, World::new(scene)?))
    }

    /// The scene as `world` is, which was built of it.
    pub(crate) fn of(scene: &'a SoundScene, world: World) -> Self {
        let is_held = vec![false; scene.desc.tools.len()];
        Self { scene, world, energy: EnergyStep::default(), is_held, checkpoints: Vec::new() }
    }

    /// Goes on from the state in the file of a checkpoint.
    ///
    /// # Errors
    /// The file is not taken.
    pub fn go_on_from(&mut self, file: &[u8]) -> Result<(), LoadError> {
        let (snapshot, Besides { energy, placed_by_calls }) = self.world.snapshot().load_with(file)?;
        self.world.restore(&snapshot);
        self.energy = energy;
        let places = self.world.tool_places();
        self.is_held = places.zip(placed_by_calls).map(|(at, by_calls)| at.is_some() && !by_calls).collect();
        Ok(())
    }

    /// The world, what it has besides, and the checkpoints in the order of saving.
    pub(crate) fn end(self) -> (World, Besides, Vec<(Arc<str>, Resimulated)>) {
        let besides = self.besides();
        (self.world, besides, self.checkpoints)
    }

    fn besides(&self) -> Besides {
        let places = self.world.tool_places();
        let placed_by_calls = places.zip(&self.is_held).map(|(at, is_held)| at.is_some() && !is_held).collect();
        Besides { energy: self.energy, placed_by_calls }
    }

    fn keep(&mut self, name: &Arc<str>, kept: Resimulated) {
        self.checkpoints.retain(|(known, _)| known != name);
        self.checkpoints.push((Arc::clone(name), kept));
    }

    /// The world after what it has followed.
    #[must_use]
    pub fn world(&self) -> &World {
        &self.world
    }

    /// Takes a step, and compares its state where its hash is known.
    ///
    /// # Errors
    /// The step led elsewhere, or is not the next one.
    pub fn step(
        &mut self,
        workers: &Workers<'_>,
        step: u64,
        inputs: &LoggedInputs,
        state_hash: Option<u64>,
    ) -> Result<(), Difference> {
        let next = self.world.output().step + 1;
        if step != next {
            return Err(Difference::Order { simulated: next, recorded: step });
        }
        let tools = self.scene.desc.tools.len();
        if let Some(input) = inputs.tools.iter().find(|input| input.tool >= tools) {
            return Err(Difference::NoTool { step, tool: input.tool, tools });
        }
        let output = self.world.step(workers, &NoClock, &inputs.as_inputs());
        self.energy.book(&output.energy);
        let Some(recorded) = state_hash else { return Ok(()) };
        let simulated = self.world.state_hash();
        match simulated == recorded {
            true => Ok(()),
            false => Err(Difference::State { step, simulated, recorded }),
        }
    }

    /// Does what an event did to the world: a reset, a checkpoint, a way back to one. Others did nothing.
    ///
    /// # Errors
    /// The scene cannot be built, or there is no such checkpoint.
    pub fn event(&mut self, event: &SceneEvent) -> Result<(), Difference> {
        match event {
            SceneEvent::Reset => (self.world, self.energy) = (World::new(self.scene)?, EnergyStep::default()),
            SceneEvent::CheckpointSaved(name) => {
                let saved = Resimulated { snapshot: Arc::new(self.world.snapshot()), besides: self.besides() };
                self.keep(name, saved);
            }
            SceneEvent::CheckpointRestored(name) => {
                let saved = self.checkpoints.iter().find(|(known, _)| known == name);
                let (_, saved) = saved.ok_or_else(|| Difference::NoCheckpoint { name: Arc::clone(name) })?;
                self.world.restore(&saved.snapshot);
                self.energy = saved.besides.energy;
            }
            SceneEvent::ToolTaken(tool) | SceneEvent::ToolReleased(tool) => {
                let is_taken = matches!(event, SceneEvent::ToolTaken(_));
                self.is_held.get_mut(*tool).into_iter().for_each(|is_held| *is_held = is_taken);
            }
            _ => {}
        }
        Ok(())
    }

    /// Keeps a checkpoint that came as a file.
    ///
    /// # Errors
    /// The file is not taken.
    pub fn take_checkpoint(&mut self, name: &str, file: &[u8]) -> Result<(), LoadError> {
        let (snapshot, besides) = self.world.snapshot().load_with(file)?;
        self.keep(&name.into(), Resimulated { snapshot: Arc::new(snapshot), besides });
        Ok(())
    }

    /// Follows what a tape has.
    ///
    /// # Errors
    /// As above.
    pub fn follow<'e>(
        &mut self,
        workers: &Workers<'_>,
        entries: impl IntoIterator<Item = &'e TapeEntry>,
    ) -> Result<(), Difference> {
        entries.into_iter().try_for_each(|entry| match entry {
            TapeEntry::Step(taped) => self.step(workers, taped.report.step, &taped.inputs, taped.state_hash),
            TapeEntry::Event(happened) => self.event(&happened.event),
            TapeEntry::Checkpoint(name, Checkpoint { snapshot, besides, .. }) => {
                self.keep(name, Resimulated { snapshot: Arc::clone(snapshot), besides: besides.clone() });
                Ok(())
            }
            // The steps lead there.
            TapeEntry::Base(_) => Ok(()),
        })
    }
}
