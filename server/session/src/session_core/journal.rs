//! What a journal needs to bring a session back: states to go on from, and the way back to where it stood.

use std::sync::Arc;

use kerf_physics::StageClock;

use super::SessionCore;
use crate::error::SessionError;
use crate::past::Arrived;
use crate::reach::Placement;
use crate::status::Phase;
use crate::tape::{Base, TapeEntry, Wants};
use crate::view_message::SceneEvent;

/// A journal has the hash of the state after each so much of simulated time, s: about once a chunk. After every step it would
/// take 6 % of a liver's at 1 kHz.
const HASHED_S: f64 = 0.064;
/// Stepping that is taken once more when a session is brought back, ns, at most: it is back within two seconds.
const MOST_REPEATED_NS: u64 = 1_000_000_000;
/// Copying states takes at most one part in so many of the time of stepping: a huge scene is rather brought back slowly.
const LEAST_STEPPING: u64 = 200;

/// When a journal gets its next state to go on from.
#[derive(Default)]
pub(super) struct BaseSchedule {
    /// Time that steps have taken since the last one.
    stepped_ns: u64,
    /// Time that copying it took.
    copied_ns: u64,
}

impl SessionCore {
    /// Steps from one hash in a journal to the next.
    pub(super) fn hashed_steps(&self) -> u64 {
        ((HASHED_S / self.dt_s()).round() as u64).max(1)
    }

    /// Gives a journal a state to go on from where taking its steps once more would take too long by now. Each checkpoint
    /// that goes along takes as much of the disk again, so that they come less often then.
    pub(super) fn write_base_if_due(&mut self, elapsed_ns: u64, clock: &dyn StageClock) {
        self.bases.stepped_ns += elapsed_ns;
        let copies = 1 + self.checkpoints.count() as u64;
        if self.bases.stepped_ns < (copies * MOST_REPEATED_NS).max(LEAST_STEPPING * self.bases.copied_ns) {
            return;
        }
        let begun_ns = clock.now_ns();
        self.write_base();
        self.bases = BaseSchedule { stepped_ns: 0, copied_ns: clock.now_ns() - begun_ns };
    }

    /// Gives a journal a state to go on from, if there is one. Without room for it the journal goes on as it was.
    pub(super) fn write_base(&self) {
        if !self.publisher.tape.is_for(Wants::Bases) {
            return;
        }
        match self.base() {
            Ok(base) => self.publisher.tape.push(&TapeEntry::Base(base)),
            Err(error) => tracing::debug!(%error, "the journal gets no state to go on from now"),
        }
    }

    fn base(&self) -> Result<Arc<Base>, SessionError> {
        let (state, is_paused) = (self.copy()?, self.phase == Phase::Paused);
        Ok(Arc::new(Base { state, is_paused, checkpoints: self.checkpoints.all() }))
    }

    /// Stands, gives away all that the session goes on from elsewhere, and refuses what would change it.
    pub(super) fn leave(&mut self) -> Result<Arc<Base>, SessionError> {
        self.is_here()?;
        let base = self.base()?;
        self.leaves = Some(self.phase.clone());
        self.pause();
        Ok(base)
    }

    /// Goes on here, as before it was to leave.
    pub(super) fn stay(&mut self) -> Result<(), SessionError> {
        match self.leaves.take() {
            Some(Phase::Running) => self.resume().map(drop),
            _ => Ok(()),
        }
    }

    /// Whether the session may be changed: what changes while it is on its way would be lost.
    pub(super) fn is_here(&self) -> Result<(), SessionError> {
        match self.leaves {
            Some(_) => Err(SessionError::Leaving),
            None => Ok(()),
        }
    }

    /// Stands as a session of the same scene stood that did not come to its end, and whose world this has. Nobody holds a tool: the next step
    /// lifts those that somebody held.
    pub(super) fn arrive(&mut self, arrived: Arrived) -> Result<(), SessionError> {
        let Arrived { energy, placed_by_calls, checkpoints, is_paused } = arrived;
        self.tally.energy = energy;
        for (name, checkpoint) in checkpoints {
            self.checkpoints.save(name.to_string(), checkpoint)?;
        }
        let places = self.world.tool_places().map(|place| place.map(|(pose, opening)| Placement { pose, opening }));
        self.inbox.take_tools_back(places, &placed_by_calls);
        if is_paused && self.phase == Phase::Running {
            self.set_phase(Phase::Paused, SceneEvent::Paused);
        }
        self.write_base();
        Ok(())
    }
}
