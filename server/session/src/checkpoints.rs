//! Named checkpoints that a session can go back to.

use kerf_physics::scene::text::{is_hidden, shortened};
use kerf_physics::step_io::EnergyStep;
use kerf_physics::world::{LoadError, Snapshot};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::sync::Arc;

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

/// A state that a session goes back to, apart from the session: copies share it. Counts of what happened to the session
/// (late steps, faults) are not in it: they did happen.
#[derive(Clone)]
pub struct Checkpoint {
    pub(crate) snapshot: Arc<Snapshot>,
    pub(crate) besides: Besides,
    /// Held as long as anybody has the state.
    pub(crate) memory: Arc<Reservation>,
}

/// What a checkpoint has besides the world's state.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Besides {
    /// Booked since the session began or was reset.
    pub energy: EnergyStep,
    /// By tool: steps that were asked for had placed it, and nobody held it.
    pub placed_by_calls: Vec<bool>,
}

/// Why a file is not taken as a checkpoint.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum FileError {
    /// The file is not one of a checkpoint of this scene.
    #[error(transparent)]
    File(#[from] LoadError),
    /// There is no room for what is in it.
    #[error(transparent)]
    Session(#[from] SessionError),
}

impl fmt::Debug for Checkpoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Checkpoint").field("step", &self.step()).finish_non_exhaustive()
    }
}

impl Checkpoint {
    /// Step that it is of.
    #[must_use]
    pub fn step(&self) -> u64 {
        self.snapshot.step()
    }

    /// The checkpoint as a file, for another session of the scene. It takes some milliseconds: not on a thread that steps.
    #[must_use]
    pub fn save(&self) -> Vec<u8> {
        self.snapshot.save_with(&self.besides)
    }

    /// The checkpoint in a file, of the scene of this one. It takes about as long as building the scene does.
    ///
    /// # Errors
    /// The file is none of a checkpoint, of another format, program, machine or scene, or has come to harm; or there is no
    /// room for another checkpoint.
    pub fn load(&self, file: &[u8]) -> Result<Self, FileError> {
        let memory = Arc::new(self.memory.another()?);
        let (snapshot, besides) = self.snapshot.load_with::<Besides>(file)?;
        if besides.placed_by_calls.len() != self.besides.placed_by_calls.len() {
            return Err(LoadError::Broken("its tools are not the scene's".into()).into());
        }
        Ok(Self { snapshot: Arc::new(snapshot), besides, memory })
    }
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

    pub fn count(&self) -> usize {
        self.checkpoints.len()
    }

    /// Copies of all, which share their states, in the order of saving.
    pub fn all(&self) -> Vec<(Arc<str>, Checkpoint)> {
        self.checkpoints.iter().map(|(name, checkpoint)| (name.as_str().into(), checkpoint.clone())).collect()
    }

    pub fn list(&self) -> Vec<CheckpointInfo> {
        let info = |(name, checkpoint): &(String, Checkpoint)| CheckpointInfo {
            name: name.clone(),
            step: checkpoint.snapshot.step(),
            sim_time_s: checkpoint.snapshot.sim_time_s(),
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
