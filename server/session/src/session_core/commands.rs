//! What a session is told to do between two steps.

use super::{SessionCore, Tally, ViewSchedule, build_world, guard, pacer};
use crate::error::SessionError;
use crate::governor::Governor;
use crate::inbox::{Command, Inspection};
use crate::limits::to_ns;
use crate::status::{Phase, SessionStatus};
use crate::view_message::SceneEvent;

impl SessionCore {
    /// Obeys the commands that wait. A command that panics fails the session as a step does; it and those behind
    /// it are dropped unanswered, as are all once the session is to end.
    pub fn obey_commands(&mut self) {
        let mut commands = std::mem::take(&mut self.commands);
        match self.inbox.take_commands(&mut commands) {
            true => {
                let obeyed = guard(|| commands.drain(..).for_each(|command| self.obey(command)));
                if let Err(message) = obeyed {
                    self.fail(&message);
                }
            }
            false => {
                commands.clear();
                self.set_phase(Phase::Closing, SceneEvent::Closing);
            }
        }
        self.commands = commands;
    }

    fn obey(&mut self, command: Command) {
        // A caller that has given up waiting is no error of the session's.
        match command {
            Command::Pause(answer) => {
                self.pause();
                let _ = answer.send(self.world.output().step);
            }
            Command::Resume(answer) => {
                let _ = answer.send(self.is_here().and_then(|()| self.resume()));
            }
            Command::Step(steps, answer) => match self.is_here() {
                Ok(()) => self.owe(steps, answer),
                Err(error) => drop(answer.send(Err(error))),
            },
            Command::Reset(answer) => {
                let _ = answer.send(self.is_here().and_then(|()| self.reset()));
            }
            Command::Describe(answer) => {
                let _ = answer.send(self.describe());
            }
            Command::Leave(answer) => {
                let _ = answer.send(self.leave());
            }
            Command::Stay(answer) => {
                let _ = answer.send(self.stay());
            }
            Command::Checkpoint(command) => self.obey_checkpoint(command),
            Command::Seek(_, answer) => {
                let _ = answer.send(Err(SessionError::NotReplay));
            }
            Command::Query(inspect) => {
                inspect(&mut Inspection { world: &mut self.world, scene: &self.scene, steps: &self.tally.steps });
            }
        }
    }

    /// Stands, and takes no step that it still owes.
    pub(super) fn pause(&mut self) {
        self.forget_owed();
        if self.phase == Phase::Running {
            self.set_phase(Phase::Paused, SceneEvent::Paused);
        }
    }

    pub(super) fn resume(&mut self) -> Result<u64, SessionError> {
        match &self.phase {
            Phase::Failed { message } => return Err(SessionError::Failed { message: message.to_string() }),
            Phase::Paused => {
                self.forget_owed();
                self.inbox.tools_stood();
                self.interrupted = true;
                self.set_phase(Phase::Running, SceneEvent::Resumed);
            }
            Phase::Running | Phase::Closing => {}
        }
        Ok(self.world.output().step)
    }

    /// Back to rest; a failed session stands afterwards, others go on as they were.
    fn reset(&mut self) -> Result<(), SessionError> {
        self.publisher.vitals().ask_for_patience(to_ns(self.limits.max_setup_s));
        // Both worlds are there until the new one is whole.
        let _both = self.admitted.memory.another()?;
        self.world = build_world(&self.scene, &mut |_| ())?;
        self.tally = Tally::of(&self.scene);
        self.governor = Governor::of(&self.scene.desc);
        self.pacer = pacer(&self.scene, &self.limits);
        self.resets += 1;
        self.inbox.reset_tools();
        self.begin_anew(SceneEvent::Reset);
        Ok(())
    }

    /// The world is another than viewers and drivers know.
    pub(super) fn begin_anew(&mut self, event: SceneEvent) {
        self.feed.forget();
        self.views = ViewSchedule::of_epoch(self.publisher.start_over());
        self.interrupted = true;
        // No step has led here: what tools felt before is of another world.
        self.tally.ended_ns = 0;
        self.waits.fill(false);
        self.forget_owed();
        self.publisher.event(self.world.output().step, event);
        if matches!(self.phase, Phase::Failed { .. }) {
            self.set_phase(Phase::Paused, SceneEvent::Paused);
        }
        self.publisher.report(self.report());
    }

    fn describe(&self) -> SessionStatus {
        let output = self.world.output();
        let counts = self.pacer.counts();
        SessionStatus {
            phase: self.phase.clone(),
            step: output.step,
            sim_time_s: output.sim_time_s,
            topology_version: output.topology_version,
            late_steps: counts.late_steps,
            relative_tolerance: self.tally.relative_tolerance,
            reanchors: counts.reanchors,
            energy: self.tally.energy,
            tracked_displacement_m: output.tracked_displacement_m.clone(),
            state_hash: self.world.state_hash(),
        }
    }
}
