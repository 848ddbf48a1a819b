//! Saving points and going back to them, between two steps.

use std::sync::Arc;

use super::SessionCore;
use crate::error::SessionError;
use crate::inbox::PointCommand;
use crate::outbox::SceneEvent;
use crate::points::Point;
use crate::status::Phase;

impl SessionCore {
    pub(super) fn obey_point(&mut self, command: PointCommand) {
        // A caller that has given up waiting is no error of the session's.
        match command {
            PointCommand::Save(name, answer) => {
                let _ = answer.send(self.save_point(name));
            }
            PointCommand::Restore(name, answer) => {
                let _ = answer.send(self.restore_point(&name));
            }
            PointCommand::Delete(name, answer) => {
                let _ = answer.send(self.points.delete(&name));
            }
            PointCommand::List(answer) => {
                let _ = answer.send(self.points.list());
            }
        }
    }

    /// Answers with the step that the point is of.
    fn save_point(&mut self, name: String) -> Result<u64, SessionError> {
        // A step that panicked has left the world half changed.
        if let Phase::Failed { message } = &self.phase {
            return Err(SessionError::Failed { message: message.to_string() });
        }
        // Asked first: a point that is refused is not copied.
        self.points.check(&name)?;
        let output = self.world.output();
        let (step, sim_time_s) = (output.step, output.sim_time_s);
        let point = Point {
            snapshot: self.world.snapshot(),
            sim_time_s,
            energy: self.tally.energy,
            relative_tolerance: self.tally.relative_tolerance,
            governor: self.governor.clone(),
            next_tolerance: self.next_tolerance,
            log: self.log.clone(),
        };
        self.points.save(name.clone(), point)?;
        self.publisher.event(step, SceneEvent::PointSaved(name.into()));
        Ok(step)
    }

    /// Back to a point, every tool lifted; a failed session stands afterwards, others go on as they
    /// were. Answers with the step that the scene is at then.
    fn restore_point(&mut self, name: &str) -> Result<u64, SessionError> {
        let point = self.points.get(name)?;
        self.world.restore(&point.snapshot);
        self.log = point.log.clone();
        self.tally.energy = point.energy;
        self.tally.relative_tolerance = point.relative_tolerance;
        self.governor = point.governor.clone();
        self.next_tolerance = point.next_tolerance;
        let name: Arc<str> = name.into();
        self.tally.restores += 1;
        self.tally.last_restored = Some(Arc::clone(&name));
        // Hands are where they are now, not where they were then.
        self.inbox.withdraw_tools();
        self.begin_anew(SceneEvent::PointRestored(name));
        Ok(self.world.output().step)
    }
}
