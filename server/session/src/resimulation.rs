//! A recorded session once more: its steps and events, from the scene at rest to the same bits.

use std::collections::BTreeMap;
use std::sync::Arc;

use kerf_physics::world::{LoadError, Snapshot};
use kerf_physics::{NoClock, Scene, SceneError, Workers, World};

use crate::checkpoints::Besides;
use crate::outbox::SceneEvent;
use crate::tape::{LoggedInputs, TapeEntry};

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
    checkpoints: BTreeMap<Arc<str>, Arc<Snapshot>>,
}

impl<'a> Resimulation<'a> {
    /// The scene at rest.
    ///
    /// # Errors
    /// It cannot be built.
    pub fn new(scene: &'a Scene) -> Result<Self, Difference> {
        Ok(Self { scene, world: World::new(scene)?, checkpoints: BTreeMap::new() })
    }

    /// The world after what it has followed.
    #[must_use]
    pub fn world(&self) -> &World {
        &self.world
    }

    /// Takes a step and compares.
    ///
    /// # Errors
    /// The step led elsewhere, or is not the next one.
    pub fn step(
        &mut self,
        workers: &Workers<'_>,
        step: u64,
        inputs: &LoggedInputs,
        state_hash: u64,
    ) -> Result<(), Difference> {
        let next = self.world.output().step + 1;
        if step != next {
            return Err(Difference::Order { simulated: next, recorded: step });
        }
        let tools = self.scene.desc.tools.len();
        if let Some(input) = inputs.tools.iter().find(|input| input.tool >= tools) {
            return Err(Difference::NoTool { step, tool: input.tool, tools });
        }
        self.world.step(workers, &NoClock, &inputs.as_inputs());
        let simulated = self.world.state_hash();
        match simulated == state_hash {
            true => Ok(()),
            false => Err(Difference::State { step, simulated, recorded: state_hash }),
        }
    }

    /// Does what an event did to the world: a reset, a checkpoint, a way back to one. Others did nothing.
    ///
    /// # Errors
    /// The scene cannot be built, or there is no such checkpoint.
    pub fn event(&mut self, event: &SceneEvent) -> Result<(), Difference> {
        match event {
            SceneEvent::Reset => self.world = World::new(self.scene)?,
            SceneEvent::CheckpointSaved(name) => {
                self.checkpoints.insert(Arc::clone(name), Arc::new(self.world.snapshot()));
            }
            SceneEvent::CheckpointRestored(name) => {
                let snapshot = self.checkpoints.get(name);
                let snapshot = snapshot.ok_or_else(|| Difference::NoCheckpoint { name: Arc::clone(name) })?;
                self.world.restore(snapshot);
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
        let (snapshot, _) = self.world.snapshot().load_with::<Besides>(file)?;
        self.checkpoints.insert(name.into(), Arc::new(snapshot));
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
            TapeEntry::Checkpoint(name, checkpoint) => {
                self.checkpoints.insert(Arc::clone(name), Arc::clone(&checkpoint.snapshot));
                Ok(())
            }
        })
    }
}
