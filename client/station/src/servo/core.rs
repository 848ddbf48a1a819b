//! The servo as a function of what it is given.

use kerf_script::Pose;
use nalgebra::Vector3;

use super::coupling::Coupling;
use super::fault::{Fault, FaultLimits, Trip};
use super::limits::{Ramp, Slew, clamped, fresh_share};
use super::model::Reaction;
use super::passivity::{Passivity, PassivityLimits};
use super::recovery::Recovery;
use super::schedule::{CouplingLimits, Schedule};
use super::{Hand, Newest};

/// Everything the servo is held to, in the scene's frame and scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Greatest force, N.
    pub peak_force_n: f64,
    /// Fastest change of the force, N/s.
    pub slew_n_per_s: f64,
    /// Time in which force is let in when it may be, s.
    pub ramp_s: f64,
    /// Time in which force is taken out when it may no longer be, s.
    pub fade_s: f64,
    /// The coupling.
    pub coupling: CouplingLimits,
    /// `None`: nothing watches over the energy.
    pub passivity: Option<PassivityLimits>,
    /// Faults.
    pub fault: FaultLimits,
}

/// Why no force may be rendered though all is well.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Hold {
    /// The dead man's button is up.
    DeadMan,
    /// The clutch is pressed: the device moves and the tool stands.
    Clutch,
    /// The device says so, in these words.
    Device(&'static str),
    /// The station is about to let go of the device.
    Leaving,
}

/// What the servo is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum State {
    /// Nothing has come from the server, or not for too long.
    Stale,
    /// Held back.
    Held(Hold),
    /// Let go after a fault.
    Tripped(Fault),
    /// Force is let in or taken out.
    Ramping,
    /// Force is rendered.
    Rendering,
}

/// What comes out of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rendered {
    /// Force on the hand, N.
    pub force_n: Vector3<f64>,
    /// Where the tool is to be; `None` where the hand is nowhere.
    pub tool: Option<Pose>,
    /// Force of the contact on the tool there, as the model has it, N: before anything is held back.
    pub contact_n: Vector3<f64>,
    /// What the servo is doing.
    pub state: State,
    /// Stiffness of the coupling, N/m.
    pub coupling_n_per_m: f64,
    /// The last fault, and how many there were.
    pub faults: (Option<Fault>, u64),
    /// Greatest energy that was given out and never taken in, J.
    pub generated_j: f64,
}

/// The servo.
#[derive(Clone, Copy, Debug)]
pub struct Core {
    settings: Settings,
    trip: Trip,
    recovery: Recovery,
    schedule: Schedule,
    coupling: Coupling,
    passivity: Option<Passivity>,
    ramp: Ramp,
    slew: Slew,
    /// Where the hand was at the last step that it was anywhere.
    before: Option<Hand>,
    /// What the springs hold since the last step, J.
    stored_j: f64,
}

impl Core {
    /// Begins without force.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        Self {
            trip: Trip::new(settings.fault),
            recovery: Recovery::default(),
            schedule: Schedule::new(settings.coupling),
            coupling: Coupling::default(),
            passivity: settings.passivity.map(Passivity::new),
            ramp: Ramp::new(settings.ramp_s, settings.fade_s),
            slew: Slew::new(settings.slew_n_per_s),
            before: None,
            stored_j: 0.0,
            settings,
        }
    }

    /// One step: `dt_s` after the last one the hand is here, and this is what the server said last.
    pub fn tick(&mut self, dt_s: f64, hand: &Hand, hold: Option<Hold>, newest: Option<Newest<'_>>) -> Rendered {
        let found = self.trip.examine(dt_s, hand, self.before.as_ref(), newest.as_ref());
        if let Some(fault) = found {
            self.trip.trip(fault);
        }
        let dt_s = if dt_s > 0.0 { dt_s.min(self.settings.fault.max_gap_s) } else { 0.0 };
        let tripped = self.trip.advance(dt_s);
        let (force_n, tool, state) = match found {
            // What the chain below would make of these is worth nothing.
            Some(fault @ (Fault::HandNotFinite | Fault::ModelNotFinite)) => {
                self.forget();
                (Vector3::zeros(), None, State::Tripped(fault))
            }
            Some(fault) if dt_s == 0.0 => (Vector3::zeros(), None, State::Tripped(fault)),
            _ => self.render(dt_s, hand, hold, newest, tripped),
        };
        let force_n = self.slew.toward(dt_s, force_n);
        if let Some(passivity) = self.passivity.as_mut().filter(|_| found != Some(Fault::HandNotFinite)) {
            passivity.rendered(hand.pose.position_m, force_n);
        }
        self.before = Some(*hand).filter(|_| found != Some(Fault::HandNotFinite)).or(self.before);
        Rendered {
            force_n,
            tool,
            contact_n: tool.map_or_else(Vector3::zeros, |tool| self.recovery.reaction(&tool).force_n),
            state,
            coupling_n_per_m: self.schedule.gains().stiffness_n_per_m,
            faults: self.trip.history(),
            generated_j: self.passivity.map_or(0.0, |passivity| passivity.generated_j()),
        }
    }

    /// The force that is wanted, where the tool is, and what the servo is doing.
    fn render(
        &mut self,
        dt_s: f64,
        hand: &Hand,
        hold: Option<Hold>,
        newest: Option<Newest<'_>>,
        tripped: Option<Fault>,
    ) -> (Vector3<f64>, Option<Pose>, State) {
        let fresh = newest.map_or(0.0, |newest| fresh_share(newest.age_s, newest.update.max_age_s));
        self.recovery.advance(dt_s);
        match newest {
            Some(newest) if fresh > 0.0 => {
                self.recovery.take(newest.update, &self.coupling.tool(hand), newest.pose_age_s);
            }
            // No force is rendered from what is so old, but the tool stands on it still: the hand is not to press it into tissue
            // that it does not feel, for the server to find it there and throw it out.
            Some(_) => {}
            None => self.recovery = Recovery::default(),
        }
        let gains = match newest {
            Some(newest) => self.schedule.advance(dt_s, newest.update.round_trip_s),
            None => self.schedule.gains(),
        };
        let advance = |coupling: &mut Coupling, recovery: &Recovery| {
            let force_n = coupling.advance(dt_s, hand, gains, |pose| recovery.reaction(pose));
            (force_n, coupling.tool(hand), *coupling.velocity_m_per_s())
        };
        let before = self.coupling;
        let (mut contact_n, mut tool, mut velocity_m_per_s) = advance(&mut self.coupling, &self.recovery);
        if self.recovery.gives(&tool, &velocity_m_per_s) {
            // The force falls within the step, as it does in the server's.
            self.coupling = before;
            (contact_n, tool, velocity_m_per_s) = advance(&mut self.coupling, &self.recovery);
        }
        self.recovery.slip(&tool, &velocity_m_per_s);
        let braked_n = match &mut self.passivity {
            Some(passivity) => {
                passivity.observe(&hand.pose.position_m, self.stored_j);
                passivity.control(dt_s, contact_n, &hand.velocity_m_per_s)
            }
            None => contact_n,
        };
        let may = hold.is_none() && tripped.is_none();
        let level = self.ramp.toward(dt_s, if may { fresh } else { 0.0 });
        let force_n = clamped(braked_n * level, self.settings.peak_force_n);
        if !(force_n.iter().chain(tool.position_m.iter()).all(|number| number.is_finite())) {
            self.forget();
            self.trip.trip(Fault::ForceNotFinite);
            return (Vector3::zeros(), None, State::Tripped(Fault::ForceNotFinite));
        }
        self.stored_j = stored_j(&force_n, gains.stiffness_n_per_m, &self.recovery.reaction(&tool));
        let state = match (tripped, hold) {
            (Some(fault), _) => State::Tripped(fault),
            (None, Some(hold)) => State::Held(hold),
            (None, None) if fresh == 0.0 => State::Stale,
            (None, None) if level < 1.0 => State::Ramping,
            (None, None) => State::Rendering,
        };
        (force_n, Some(tool), state)
    }

    /// Begins anew, but for the force that the hand feels now and what is remembered of faults.
    fn forget(&mut self) {
        *self = Self { trip: self.trip, slew: self.slew, before: self.before, ..Self::new(self.settings) };
    }
}

/// What the coupling and the contact give back when the force goes to zero, J: two springs in series.
fn stored_j(force_n: &Vector3<f64>, coupling_n_per_m: f64, contact: &Reaction) -> f64 {
    let squared_n2 = force_n.norm_squared();
    if squared_n2 == 0.0 {
        return 0.0;
    }
    let contact_n_per_m = force_n.dot(&(contact.stiffness_n_per_m * force_n)) / squared_n2;
    // A contact without stiffness holds nothing that could be counted; a tenth of the coupling's is its least.
    0.5 * squared_n2 * (1.0 / coupling_n_per_m + 1.0 / contact_n_per_m.max(0.1 * coupling_n_per_m))
}

#[cfg(test)]
#[path = "core_tests.rs"]
mod tests;
