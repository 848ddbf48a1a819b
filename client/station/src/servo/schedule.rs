//! How stiff the coupling may be at a round trip.
//!
//! A mass m on a spring whose other end answers after a time t swings up where t comes near pi sqrt(m / k). So the
//! stiffness is kept at a share of m (pi / t)^2: softer contact on a slow network rather than one that shakes.

use super::coupling::Gains;

/// Share of the stiffness at which the coupling would begin to swing up.
const MARGIN: f64 = 0.5;
/// Beside the round trip: a period of the servo and half of one of the tissue's steps, s.
const OWN_DELAY_S: f64 = 1.5e-3;
/// Damping of the coupling, as a share of the critical one.
const DAMPING_RATIO: f64 = 0.4;
/// The stiffness follows a rising round trip in this time and a falling one more slowly, s: a spring that becomes
/// stiffer while it is stretched adds energy.
const FALL_S: f64 = 0.1;
const RISE_S: f64 = 1.0;

/// What the coupling may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CouplingLimits {
    /// Least stiffness, however slow the network, N/m.
    pub min_stiffness_n_per_m: f64,
    /// Greatest stiffness, N/m.
    pub max_stiffness_n_per_m: f64,
    /// Greatest damping, N s/m.
    pub max_damping_n_s_per_m: f64,
    /// Mass that the hand feels at the device's tip, kg.
    pub mass_kg: f64,
}

/// The coupling's stiffness now.
#[derive(Clone, Copy, Debug)]
pub struct Schedule {
    limits: CouplingLimits,
    stiffness_n_per_m: f64,
}

impl Schedule {
    /// Begins as soft as it gets.
    #[must_use]
    pub fn new(limits: CouplingLimits) -> Self {
        Self { limits, stiffness_n_per_m: limits.min_stiffness_n_per_m }
    }

    /// Stiffness for a round trip, N/m.
    #[must_use]
    pub fn stiffness_n_per_m(limits: &CouplingLimits, round_trip_s: f64) -> f64 {
        let rate_per_s = std::f64::consts::PI / (round_trip_s + OWN_DELAY_S);
        let stable_n_per_m = MARGIN * limits.mass_kg * rate_per_s * rate_per_s;
        stable_n_per_m.max(limits.min_stiffness_n_per_m).min(limits.max_stiffness_n_per_m)
    }

    /// Follows the round trip; returns the coupling for the next step.
    pub fn advance(&mut self, dt_s: f64, round_trip_s: f64) -> Gains {
        let wanted = Self::stiffness_n_per_m(&self.limits, round_trip_s);
        let time_s = if wanted < self.stiffness_n_per_m { FALL_S } else { RISE_S };
        self.stiffness_n_per_m += (wanted - self.stiffness_n_per_m) * (dt_s / time_s).min(1.0);
        self.gains()
    }

    /// The coupling as it is.
    #[must_use]
    pub fn gains(&self) -> Gains {
        let critical = 2.0 * (self.limits.mass_kg * self.stiffness_n_per_m).sqrt();
        Gains {
            stiffness_n_per_m: self.stiffness_n_per_m,
            damping_n_s_per_m: (DAMPING_RATIO * critical).min(self.limits.max_damping_n_s_per_m),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: CouplingLimits = CouplingLimits {
        min_stiffness_n_per_m: 20.0,
        max_stiffness_n_per_m: 500.0,
        max_damping_n_s_per_m: 5.0,
        mass_kg: 0.1,
    };

    #[test]
    fn the_coupling_is_softer_the_longer_the_round_trip() {
        let stiffness = |round_trip_s| Schedule::stiffness_n_per_m(&LIMITS, round_trip_s);
        assert_eq!(stiffness(2e-3), 500.0, "what the device bears");
        // pi sqrt(m / k) is 50 ms at 395 N/m.
        assert!((stiffness(0.0485) - 0.5 * 394.78).abs() < 0.1);
        assert!(stiffness(0.1) < 60.0);
        assert_eq!(stiffness(1.0), 20.0);
    }

    #[test]
    fn a_heavy_device_is_damped_no_more_than_it_bears() {
        let mut schedule = Schedule::new(CouplingLimits { mass_kg: 10.0, ..LIMITS });
        let gains = (0..10_000).map(|_| schedule.advance(1e-3, 2e-3)).last().unwrap();
        assert_eq!(gains.damping_n_s_per_m, 5.0, "not 0.8 sqrt(m k) = 57");
    }

    #[test]
    fn it_gives_way_at_once_and_stiffens_slowly() {
        let mut schedule = Schedule::new(LIMITS);
        let mut after = |steps, round_trip_s| {
            (0..steps).map(|_| schedule.advance(1e-3, round_trip_s).stiffness_n_per_m).last().unwrap()
        };
        let risen = after(500, 2e-3);
        assert!(risen > 150.0 && risen < 250.0, "{risen}");
        assert!(after(500, 0.2) < 25.0);
    }
}
