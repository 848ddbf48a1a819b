//! A Phantom Omni and the hand on it, both simulated; in real time as a [`Device`], in virtual time by [`Simulated::step`].

use std::sync::atomic::AtomicBool;

use nalgebra::{UnitQuaternion, Vector3};

use super::{Device, DeviceError, DeviceInfo, DeviceState, Servo, paced};
use crate::config::{HandConfig, SimulatedConfig};

/// Corners of the Omni's usable workspace about its middle, m.
const WORKSPACE_M: [[f64; 3]; 2] = [[-0.08, -0.06, -0.035], [0.08, 0.06, 0.035]];
/// Greatest force of the Omni, N, and what it renders without buzzing, N/m and N s/m.
const PEAK_FORCE_N: f64 = 3.3;
const MAX_STIFFNESS_N_PER_M: f64 = 500.0;
const MAX_DAMPING_N_S_PER_M: f64 = 5.0;
const RATE_HZ: f64 = 1000.0;
/// Longest step of the simulation, s.
const STEP_S: f64 = 1e-4;
/// Speed below which friction fades, m/s: dry friction without a jump.
const FRICTION_SPEED_M_PER_S: f64 = 1e-3;
/// Time constant of the device's speed, s, which it takes from quantised positions.
const SPEED_FILTER_S: f64 = 2e-3;
/// What a trembling hand trembles at, rad/s, for each axis.
const TREMOR_RAD_PER_S: [f64; 3] = [52.0, 61.0, 70.0];

/// A device and a hand.
#[derive(Clone, Debug)]
pub struct Simulated {
    info: DeviceInfo,
    config: SimulatedConfig,
    time_s: f64,
    position_m: Vector3<f64>,
    velocity_m_per_s: Vector3<f64>,
    /// What the device says, from quantised positions.
    told_m: Vector3<f64>,
    told_m_per_s: Vector3<f64>,
}

impl Simulated {
    /// Begins at rest where the hand's path begins.
    #[must_use]
    pub fn new(config: &SimulatedConfig) -> Self {
        let position_m = config.hand.at(0.0).0;
        Self {
            info: DeviceInfo {
                name: "simulated Omni".into(),
                rate_hz: RATE_HZ,
                peak_force_n: PEAK_FORCE_N,
                max_stiffness_n_per_m: MAX_STIFFNESS_N_PER_M,
                max_damping_n_s_per_m: MAX_DAMPING_N_S_PER_M,
                apparent_mass_kg: config.mass_kg,
                workspace_m: WORKSPACE_M.map(Vector3::from),
            },
            config: config.clone(),
            time_s: 0.0,
            position_m,
            velocity_m_per_s: Vector3::zeros(),
            told_m: position_m,
            told_m_per_s: Vector3::zeros(),
        }
    }

    /// Where the tip really is, m, and how fast, m/s.
    #[must_use]
    pub fn truth(&self) -> (Vector3<f64>, Vector3<f64>) {
        (self.position_m, self.velocity_m_per_s)
    }

    /// Time since it began, s.
    #[must_use]
    pub fn time_s(&self) -> f64 {
        self.time_s
    }

    /// Time passes while the device pushes the hand with a force, which is cut off at what its motors have.
    pub fn step(&mut self, dt_s: f64, force_n: &Vector3<f64>) -> DeviceState {
        let force_n = force_n * (PEAK_FORCE_N / force_n.norm().max(PEAK_FORCE_N));
        let steps = (dt_s / STEP_S).ceil().max(1.0);
        let h_s = dt_s / steps;
        for _ in 0..steps as usize {
            self.time_s += h_s;
            self.advance(h_s, &force_n);
        }
        let resolution_m = self.config.resolution_m;
        let told_m = match resolution_m > 0.0 {
            true => self.position_m.map(|x| (x / resolution_m).round() * resolution_m),
            false => self.position_m,
        };
        let raw_m_per_s = (told_m - self.told_m) / dt_s.max(1e-6);
        self.told_m_per_s += (raw_m_per_s - self.told_m_per_s) * (dt_s / (SPEED_FILTER_S + dt_s));
        self.told_m = told_m;
        let is_down = |at: &&crate::config::PressConfig| {
            (at.from_s..at.to_s).contains(&self.config.hand.path_time_s(self.time_s))
        };
        let buttons = self.config.hand.presses.iter().filter(is_down).fold(0, |all, press| all | 1 << press.button);
        DeviceState {
            position_m: told_m,
            orientation: UnitQuaternion::identity(),
            velocity_m_per_s: self.told_m_per_s,
            buttons,
            hold: None,
        }
    }

    /// A step of the motion: the hand's spring and damper implicit, all else explicit.
    fn advance(&mut self, h_s: f64, force_n: &Vector3<f64>) {
        let SimulatedConfig { mass_kg, friction_n, hand, .. } = &self.config;
        let (wanted_m, wanted_m_per_s) = hand.at(self.time_s);
        let speed = self.velocity_m_per_s.norm();
        let friction = self.velocity_m_per_s * (-friction_n / (speed + FRICTION_SPEED_M_PER_S));
        let pull = (wanted_m - self.position_m) * hand.stiffness_n_per_m + wanted_m_per_s * hand.damping_n_s_per_m;
        let own = hand.damping_n_s_per_m + h_s * hand.stiffness_n_per_m;
        self.velocity_m_per_s =
            (self.velocity_m_per_s * *mass_kg + (force_n + friction + pull) * h_s) / (mass_kg + h_s * own);
        self.position_m += self.velocity_m_per_s * h_s;
        for axis in 0..3 {
            let inside_m = self.position_m[axis].clamp(WORKSPACE_M[0][axis], WORKSPACE_M[1][axis]);
            if inside_m != self.position_m[axis] {
                (self.position_m[axis], self.velocity_m_per_s[axis]) = (inside_m, 0.0);
            }
        }
    }
}

impl Device for Simulated {
    fn info(&self) -> &DeviceInfo {
        &self.info
    }

    fn run(&mut self, servo: &mut dyn Servo, stop: &AtomicBool) -> Result<(), DeviceError> {
        paced::run(servo, stop, RATE_HZ, |dt_s, force_n| {
            let has_ended = self.config.hand.ends && self.time_s > self.config.hand.end_s();
            (!has_ended).then(|| self.step(dt_s, force_n))
        });
        Ok(())
    }
}

impl HandConfig {
    /// Time along the path after a time, s: it is gone over again and again unless it ends.
    fn path_time_s(&self, time_s: f64) -> f64 {
        if self.ends || self.end_s() == 0.0 { time_s } else { time_s % self.end_s() }
    }

    /// Time of the path's last point, s.
    #[must_use]
    pub fn end_s(&self) -> f64 {
        self.path.last().map_or(0.0, |[time_s, ..]| *time_s)
    }

    /// Where the hand wants to be after a time, m, and how fast it wants to move, m/s.
    fn at(&self, time_s: f64) -> (Vector3<f64>, Vector3<f64>) {
        let along_s = self.path_time_s(time_s);
        let point = |[_, x, y, z]: &[f64; 4]| Vector3::new(*x, *y, *z);
        let next = self.path.partition_point(|[at_s, ..]| *at_s <= along_s);
        let (mut position_m, mut velocity_m_per_s) = match (self.path[..next].last(), self.path.get(next)) {
            (Some(from), Some(to)) => {
                let velocity_m_per_s = (point(to) - point(from)) / (to[0] - from[0]);
                (point(from) + velocity_m_per_s * (along_s - from[0]), velocity_m_per_s)
            }
            (Some(only), None) | (None, Some(only)) => (point(only), Vector3::zeros()),
            (None, None) => (Vector3::zeros(), Vector3::zeros()),
        };
        for (axis, rate) in TREMOR_RAD_PER_S.iter().enumerate() {
            position_m[axis] += self.tremor_m * (rate * time_s).sin();
            velocity_m_per_s[axis] += self.tremor_m * rate * (rate * time_s).cos();
        }
        (position_m, velocity_m_per_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config() -> SimulatedConfig {
        let hand = HandConfig { path: vec![[0.0; 4]], ..HandConfig::default() };
        SimulatedConfig { hand, friction_n: 0.0, resolution_m: 0.0, ..SimulatedConfig::default() }
    }

    #[test]
    fn a_force_pushes_the_device_out_of_the_hand_by_the_grips_stiffness() {
        let mut device = Simulated::new(&config());
        (0..3000).for_each(|_| {
            device.step(1e-3, &Vector3::y());
        });
        let expected_m = 1.0 / device.config.hand.stiffness_n_per_m;
        assert!((device.truth().0.y - expected_m).abs() < 1e-6, "{:?}", device.truth());
    }

    #[test]
    fn a_free_device_swings_as_a_mass_on_a_spring() {
        let mut config = config();
        config.hand.damping_n_s_per_m = 0.0;
        config.hand.stiffness_n_per_m = 100.0;
        let mut device = Simulated::new(&config);
        device.position_m.x = 0.01;
        let mut crossings = Vec::new();
        let mut before = 0.01;
        for tick in 1..2000 {
            let x = device.step(1e-3, &Vector3::zeros()).position_m.x;
            if x < 0.0 && before >= 0.0 {
                crossings.push(f64::from(tick) * 1e-3);
            }
            before = x;
        }
        let period_s = crossings[1] - crossings[0];
        let expected_s = 2.0 * std::f64::consts::PI * (config.mass_kg / 100.0).sqrt();
        assert!((period_s - expected_s).abs() < 0.01 * expected_s, "{period_s} s, not {expected_s} s");
    }

    #[test]
    fn the_motors_and_the_workspace_have_their_limits() {
        let mut config = config();
        config.hand.stiffness_n_per_m = 100.0;
        let mut device = Simulated::new(&config);
        let state = (0..3000).map(|_| device.step(1e-3, &(Vector3::y() * 50.0))).last().unwrap();
        assert!((state.position_m.y - PEAK_FORCE_N / 100.0).abs() < 1e-5, "{state:?}");
        device.config.hand.path = vec![[0.0, 1.0, 0.0, 0.0]];
        let state = (0..3000).map(|_| device.step(1e-3, &Vector3::zeros())).last().unwrap();
        assert_eq!(state.position_m.x, WORKSPACE_M[1][0]);
    }

    #[test]
    fn buttons_are_pressed_by_the_script() {
        let mut config = config();
        config.hand.presses = vec![crate::config::PressConfig { button: 1, from_s: 0.1, to_s: 0.2 }];
        let mut device = Simulated::new(&config);
        let pressed = (0..300).filter(|_| device.step(1e-3, &Vector3::zeros()).buttons == 2).count();
        assert!(pressed.abs_diff(100) <= 1, "{pressed}");
    }
}
