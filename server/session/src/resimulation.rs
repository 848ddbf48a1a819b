//! A recorded session once more: its steps and events, from the scene at rest to the same bits.

use std::collections::BTreeMap;
use std::sync::Arc;

use kerf_physics::step_io::EnergyStep;
use kerf_physics::world::{LoadError, Snapshot};
use kerf_physics::{NoClock, Scene, SceneError, Workers, World};

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
    Scene(#[from] SceneError),
}

/// A world that follows a recording.
pub struct Resimulation<'a> {
    scene: &'a Scene,
    world: World,
    /// Booked since the session began or was reset.
    energy: EnergyStep,
    checkpoints: BTreeMap<Arc<str>, Resimulated>,
}

/// A checkpoint that a recording led to, or had.
#[derive(Clone)]
pub(crate) struct Resimulated {
    pub snapshot: Arc<Snapshot>,
    pub energy: EnergyStep,
}

impl<'a> Resimulation<'a> {
    /// The scene at rest.
    ///
    /// # Errors
    /// It cannot be built.
    pub fn new(scene: &'a Scene) -> Result<Self, Difference> {
        Ok(Self::of(scene, World::new(scene)?))
    }

    /// The scene as `world` is, which was built of it.
    pub(crate) fn of(scene: &'a Scene, world: World) -> Self {
        Self { scene, world, energy: EnergyStep::default(), checkpoints: BTreeMap::new() }
    }

    /// Goes on from the state in the file of a checkpoint; returns by tool whether calls had placed it.
    ///
    /// # Errors
    /// The file is not taken.
    pub fn go_on_from(&mut self, file: &[u8]) -> Result<Vec<bool>, LoadError> {
        let (snapshot, Besides { energy, placed_by_calls }) = self.world.snapshot().load_with(file)?;
        self.world.restore(&snapshot);
        self.energy = energy;
        Ok(placed_by_calls)
    }

    /// The world, what was booked, and the checkpoints.
    pub(crate) fn end(self) -> (World, EnergyStep, BTreeMap<Arc<str>, Resimulated>) {
        (self.world, self.energy, self.checkpoints)
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
                let saved = Resimulated { snapshot: Arc::new(self.world.snapshot()), energy: self.energy };
                self.checkpoints.insert(Arc::clone(name), saved);
            }
            SceneEvent::CheckpointRestored(name) => {
                let saved = self.checkpoints.get(name);
                let saved = saved.ok_or_else(|| Difference::NoCheckpoint { name: Arc::clone(name) })?;
                self.world.restore(&saved.snapshot);
                self.energy = saved.energy;
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
        let (snapshot, besides) = self.world.snapshot().load_with::<Besides>(file)?;
        let taken = Resimulated { snapshot: Arc::new(snapshot), energy: besides.energy };
        self.checkpoints.insert(name.into(), taken);
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
                let taken = Resimulated { snapshot: Arc::clone(snapshot), energy: besides.energy };
                self.checkpoints.insert(Arc::clone(name), taken);
                Ok(())
            }
            // The steps lead there.
            TapeEntry::Base(_) => Ok(()),
        })
    }
}
