//! What a journal says of a session, and the way to where the session stood.

use std::sync::Arc;

use kerf_physics::step_io::EnergyStep;
use kerf_physics::{SoundScene, Workers, World};

use crate::admission::Reservation;
use crate::checkpoints::{Besides, Checkpoint};
use crate::error::SessionError;
use crate::resimulation::{Resimulated, Resimulation};
use crate::session_options::Owner;
use crate::tape::LoggedInputs;
use crate::view_message::SceneEvent;

/// What a journal says of a session that did not come to its end.
#[derive(Debug, Default)]
pub struct Past {
    /// The file of the state that it goes on from; `None`: the scene at rest.
    pub base: Option<Vec<u8>>,
    /// Whether the session stood there.
    pub is_paused: bool,
    /// Whose it is.
    pub owner: Option<Owner>,
    /// What happened then, in order.
    pub entries: Vec<PastEntry>,
}

/// One thing that happened to a session.
#[derive(Debug)]
pub enum PastEntry {
    /// A step was taken.
    Step {
        /// Steps taken, this one included.
        step: u64,
        /// What went into it.
        inputs: LoggedInputs,
        /// Hash of the state after it, where it is known.
        state_hash: Option<u64>,
    },
    /// Something happened between two steps, or in the last one.
    Event(SceneEvent),
    /// There is a checkpoint of this name, in this file.
    Checkpoint(Arc<str>, Vec<u8>),
}

/// How a session stood, besides its world.
pub(crate) struct Arrived {
    pub energy: EnergyStep,
    /// By tool: steps that were asked for had placed it, and nobody held it.
    pub placed_by_calls: Vec<bool>,
    pub checkpoints: Vec<(Arc<str>, Checkpoint)>,
    pub is_paused: bool,
}

impl Past {
    /// Steps taken where the session stood at last, as far as its entries tell.
    #[must_use]
    pub fn last_step(&self) -> Option<u64> {
        self.entries.iter().rev().find_map(|entry| match entry {
            PastEntry::Step { step, .. } => Some(*step),
            _ => None,
        })
    }

    /// Whether the session stood at last.
    pub(crate) fn stands(&self) -> bool {
        let told = |entry: &PastEntry| match entry {
            PastEntry::Event(SceneEvent::Paused | SceneEvent::Failed) => Some(true),
            PastEntry::Event(SceneEvent::Resumed) => Some(false),
            _ => None,
        };
        self.entries.iter().rev().find_map(told).unwrap_or(self.is_paused)
    }

    /// Takes the steps once more, from `world`, which is the scene at rest. Checkpoints take as much memory as `memory`.
    ///
    /// # Errors
    /// A file is not of this scene, program and machine, a step leads elsewhere, or there is no room for a checkpoint.
    pub(crate) fn follow(
        self,
        scene: &SoundScene,
        world: World,
        memory: &Reservation,
        workers: &Workers<'_>,
    ) -> Result<(World, Arrived), SessionError> {
        let is_paused = self.stands();
        let Self { base, entries, .. } = self;
        let mut again = Resimulation::of(scene, world);
        if let Some(file) = base {
            again.go_on_from(&file).map_err(lost)?;
        }
        for entry in entries {
            match entry {
                PastEntry::Step { step, inputs, state_hash } => {
                    again.step(workers, step, &inputs, state_hash).map_err(lost)?;
                }
                PastEntry::Checkpoint(name, file) => again.take_checkpoint(&name, &file).map_err(lost)?,
                PastEntry::Event(event) => again.event(&event).map_err(lost)?,
            }
        }
        let (world, Besides { energy, placed_by_calls }, checkpoints) = again.end();
        let keep = |(name, Resimulated { snapshot, besides }): (Arc<str>, Resimulated)| {
            Ok((name, Checkpoint { snapshot, besides, memory: Arc::new(memory.checkpoint()?) }))
        };
        let checkpoints = checkpoints.into_iter().map(keep).collect::<Result<_, SessionError>>()?;
        Ok((world, Arrived { energy, placed_by_calls, checkpoints, is_paused }))
    }
}

fn lost(error: impl std::error::Error) -> SessionError {
    SessionError::Unrecoverable { message: error.to_string() }
}
