//! Saving checkpoints and going back to them, between two steps.

use std::sync::Arc;

use super::SessionCore;
use crate::checkpoints::{Besides, Checkpoint};
use crate::error::SessionError;
use crate::inbox::CheckpointCommand;
use crate::reach::Placement;
use crate::status::Phase;
use crate::tape::TapeEntry;
use crate::view_message::SceneEvent;

impl SessionCore {
    pub(super) fn obey_checkpoint(&mut self, command: CheckpointCommand) {
        // A caller that has given up waiting is no error of the session's.
        match command {
            CheckpointCommand::Save(name, answer) => {
                let _ = answer.send(self.is_here().and_then(|()| self.save_checkpoint(name)));
            }
            CheckpointCommand::Restore(name, answer) => {
                let _ = answer.send(self.is_here().and_then(|()| self.restore_checkpoint(&name)));
            }
            CheckpointCommand::Read(name, answer) => {
                let _ = answer.send(self.checkpoints.get(&name).cloned());
            }
            CheckpointCommand::Copy(answer) => {
                let _ = answer.send(self.copy());
            }
            CheckpointCommand::Check(name, answer) => {
                let _ = answer.send(self.checkpoints.check(&name));
            }
            CheckpointCommand::Keep(name, checkpoint, answer) => {
                let _ = answer.send(self.is_here().and_then(|()| self.keep_checkpoint(name, checkpoint)));
            }
            CheckpointCommand::Delete(name, answer) => {
                let _ = answer.send(self.is_here().and_then(|()| self.delete_checkpoint(&name)));
            }
            CheckpointCommand::List(answer) => {
                let _ = answer.send(self.checkpoints.list());
            }
        }
    }

    /// A journal goes on from a state without it.
    fn delete_checkpoint(&mut self, name: &str) -> Result<(), SessionError> {
        self.checkpoints.delete(name)?;
        self.write_base();
        Ok(())
    }

    /// The state as it is.
    pub(super) fn copy(&self) -> Result<Checkpoint, SessionError> {
        // A step that panicked has left the world half changed.
        if let Phase::Failed { message } = &self.phase {
            return Err(SessionError::Failed { message: message.to_string() });
        }
        // Asked first: what there is no room for is not copied.
        let memory = Arc::new(self.admitted.memory.checkpoint()?);
        let besides = Besides { energy: self.tally.energy, placed_by_calls: self.inbox.placed_by_calls() };
        Ok(Checkpoint { snapshot: Arc::new(self.world.snapshot()), besides, memory })
    }

    /// Answers with the step that the checkpoint is of.
    fn save_checkpoint(&mut self, name: String) -> Result<u64, SessionError> {
        self.checkpoints.check(&name)?;
        let checkpoint = self.copy()?;
        let step = checkpoint.step();
        self.checkpoints.save(name.clone(), checkpoint)?;
        self.publisher.event(step, SceneEvent::CheckpointSaved(name.into()));
        Ok(step)
    }

    /// Keeps what another session saved, and answers with the step that it is of. A recording needs it whole: no step of
    /// this session leads there.
    fn keep_checkpoint(&mut self, name: String, checkpoint: Checkpoint) -> Result<u64, SessionError> {
        let step = checkpoint.step();
        self.checkpoints.save(name.clone(), checkpoint.clone())?;
        let name: Arc<str> = name.into();
        self.publisher.tape.push(&TapeEntry::Checkpoint(Arc::clone(&name), checkpoint));
        self.publisher.event(self.world.output().step, SceneEvent::CheckpointUploaded(name));
        Ok(step)
    }

    /// Back to a checkpoint; a failed session stands afterwards, others go on as they were. Hands are where they are now:
    /// a tool goes on in one that is where the tool was then, and is lifted from others. Answers with the step that the
    /// scene is at then.
    fn restore_checkpoint(&mut self, name: &str) -> Result<u64, SessionError> {
        let checkpoint = self.checkpoints.get(name)?;
        self.world.restore(&checkpoint.snapshot);
        self.tally.energy = checkpoint.besides.energy;
        let name: Arc<str> = name.into();
        self.tally.restores += 1;
        self.tally.last_restored = Some(Arc::clone(&name));
        let places = self.world.tool_places().map(|place| place.map(|(pose, opening)| Placement { pose, opening }));
        self.inbox.take_tools_back(places, &checkpoint.besides.placed_by_calls);
        self.begin_anew(SceneEvent::CheckpointRestored(name));
        Ok(self.world.output().step)
    }
}
