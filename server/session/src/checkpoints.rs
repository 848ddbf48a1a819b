//! Named checkpoints that a session can go back to.

use kerf_physics::scene::text::{is_hidden, shortened};
use kerf_physics::step_io::EnergyStep;
use kerf_physics::world::Snapshot;

use crate::admission::Reservation;
use crate::error::SessionError;

/// Longest name of a checkpoint, bytes: a sentence. Names go into events, logs and lists.
pub const MAX_CHECKPOINT_NAME_BYTES: usize = 64;

/// A checkpoint as its callers see it.
#[derive(Clone, Debug, PartialEq)]
pub struct CheckpointInfo {
    /// Its name.
    pub name: String,
    /// Steps taken when it was saved.
    pub step: u64,
    /// Simulated time when it was saved, s.
    pub sim_time_s: f64,
}

/// What a session goes back to. Counts of what happened to the session (late steps, faults) are not in
/// it: they did happen.
pub(crate) struct Checkpoint {
    pub snapshot: Snapshot,
    pub sim_time_s: f64,
    pub energy: EnergyStep,
    /// By tool: steps that were asked for had placed it, and nobody held it.
    pub placed_by_calls: Vec<bool>,
    /// Held as long as the checkpoint is kept.
    pub _memory: Reservation,
}

/// The checkpoints of a session, in the order of saving.
pub(crate) struct Checkpoints {
    checkpoints: Vec<(String, Checkpoint)>,
    max_checkpoints: usize,
}

impl Checkpoints {
    pub fn new(max_checkpoints: usize) -> Self {
        Self { checkpoints: Vec::new(), max_checkpoints }
    }

    /// Refuses a name that [`Self::save`] would not take.
    pub fn check(&self, name: &str) -> Result<(), SessionError> {
        if name.is_empty() || name.len() > MAX_CHECKPOINT_NAME_BYTES || name.chars().any(is_hidden) {
            let name = shortened(name, MAX_CHECKPOINT_NAME_BYTES);
            return Err(SessionError::PointName { name, limit: MAX_CHECKPOINT_NAME_BYTES });
        }
        let is_known = self.index(name).is_some();
        match self.checkpoints.len() < self.max_checkpoints || is_known {
            true => Ok(()),
            false => Err(SessionError::TooManyCheckpoints { limit: self.max_checkpoints }),
        }
    }

    /// Keeps a checkpoint, in place of one of the same name.
    pub fn save(&mut self, name: String, checkpoint: Checkpoint) -> Result<(), SessionError> {
        self.check(&name)?;
        self.checkpoints.retain(|(known, _)| *known != name);
        self.checkpoints.push((name, checkpoint));
        Ok(())
    }

    pub fn get(&self, name: &str) -> Result<&Checkpoint, SessionError> {
        self.index(name).map(|index| &self.checkpoints[index].1).ok_or_else(|| Self::unknown(name))
    }

    pub fn delete(&mut self, name: &str) -> Result<(), SessionError> {
        let index = self.index(name).ok_or_else(|| Self::unknown(name))?;
        self.checkpoints.remove(index);
        Ok(())
    }

    pub fn list(&self) -> Vec<CheckpointInfo> {
        let info = |(name, checkpoint): &(String, Checkpoint)| CheckpointInfo {
            name: name.clone(),
            step: checkpoint.snapshot.step(),
            sim_time_s: checkpoint.sim_time_s,
        };
        self.checkpoints.iter().map(info).collect()
    }

    fn index(&self, name: &str) -> Option<usize> {
        self.checkpoints.iter().position(|(known, _)| known == name)
    }

    fn unknown(name: &str) -> SessionError {
        SessionError::NoCheckpoint { name: shortened(name, MAX_CHECKPOINT_NAME_BYTES) }
    }
}
