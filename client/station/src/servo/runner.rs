//! The core behind a device: its clock, its slots, its buttons.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use kerf_load::clock;
use kerf_script::Placement;
use nalgebra::Vector3;

use super::Newest;
use super::core::{Core, Hold, Rendered, Settings};
use super::fault::FaultLimits;
use super::model::{LocalModel, Update};
use super::passivity::PassivityLimits;
use super::schedule::CouplingLimits;
use crate::config::{Action, ButtonConfig, DeviceConfig};
use crate::device::{DeviceInfo, DeviceState, Servo};
use crate::mapping::Mapping;

/// Longest time between two calls, s: real devices now and then take 3 ms, a busy machine 10.
const MAX_GAP_S: f64 = 0.05;
/// Greatest speed of a hand, m/s; what is faster is a device that has lost its place.
const MAX_HAND_SPEED_M_PER_S: f64 = 10.0;
/// How long after a fault nothing is rendered, s.
const FAULT_HOLD_S: f64 = 0.25;
/// Credit of the passivity observer beside what springs hold, J: the work of 1 N over 1 mm.
const PASSIVITY_MARGIN_J: f64 = 1e-3;
/// Debt that it remembers, J.
const PASSIVITY_DEBT_J: f64 = 0.02;
/// The tick that a servo which was never called before is taken to have had, s.
const FIRST_DT_S: f64 = 1e-3;

/// What the servo leaves for the link: the newest wins.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// When the device was read, ns.
    pub sampled_ns: u64,
    /// The tool, an index into the station's list.
    pub tool: usize,
    /// Where it is to be; `None`: out of the scene.
    pub placement: Option<Placement>,
    /// Force of the contact there, as the model has it, N.
    pub contact_n: Vector3<f64>,
    /// Speed of the hand, m/s.
    pub speed_m_per_s: f64,
}

/// What the servo tells of a tick.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// When it was called, ns.
    pub at_ns: u64,
    /// Time since the call before, s.
    pub dt_s: f64,
    /// Time that it took, ns.
    pub spent_ns: u64,
    /// The device.
    pub device: DeviceState,
    /// Force on the device, N, in its own frame.
    pub force_n: Vector3<f64>,
    /// What came out of the core, in the scene's frame.
    pub rendered: Rendered,
    /// Contacts that came in so far.
    pub contacts: u64,
    /// Age of the motion that the newest contact reflects, s; absent before the first.
    pub motion_age_s: Option<f64>,
    /// The newest contact; `None`: nothing is touched.
    pub model: Option<LocalModel>,
}

/// The slots that a servo shares with other threads; none of them ever makes it wait.
pub struct Slots {
    /// Newest contact.
    pub updates: triple_buffer::Output<Update>,
    /// Newest motion.
    pub motions: triple_buffer::Input<Motion>,
    /// What the monitor reads; ticks are left out where it does not keep up.
    pub samples: rtrb::Producer<Sample>,
    /// Set when the force is to be taken out for good.
    pub is_leaving: Arc<AtomicBool>,
}

/// A servo behind a device.
pub struct Runner {
    core: Core,
    mapping: Mapping,
    buttons: Vec<ButtonConfig>,
    /// Ids in the scene of the tools that it drives in turn; at least one.
    tool_ids: Arc<[u32]>,
    tool: usize,
    was_down: u32,
    last_ns: Option<u64>,
    slots: Slots,
}

impl Runner {
    /// A servo with these settings for a device's configuration and its tools' ids in the scene.
    #[must_use]
    pub fn new(settings: Settings, config: &DeviceConfig, tool_ids: Arc<[u32]>, slots: Slots) -> Self {
        Self {
            core: Core::new(settings),
            mapping: Mapping::new(&config.mapping),
            buttons: config.buttons.clone(),
            tool_ids,
            tool: 0,
            was_down: 0,
            last_ns: None,
            slots,
        }
    }

    fn is_down(&self, action: Action, buttons: u32) -> bool {
        self.buttons.iter().any(|button| button.action == action && buttons & (1 << button.button) != 0)
    }

    /// Why no force may be rendered, if there is a reason.
    fn hold(&self, state: &DeviceState) -> Option<Hold> {
        let has_dead_man = self.buttons.iter().any(|button| button.action == Action::DeadMan);
        if self.slots.is_leaving.load(Ordering::Relaxed) {
            Some(Hold::Leaving)
        } else if let Some(reason) = state.hold {
            Some(Hold::Device(reason))
        } else if self.is_down(Action::Clutch, state.buttons) {
            Some(Hold::Clutch)
        } else if has_dead_man && !self.is_down(Action::DeadMan, state.buttons) {
            Some(Hold::DeadMan)
        } else {
            None
        }
    }

    fn next_tool(&mut self, buttons: u32) {
        let went_down = buttons & !self.was_down;
        if self.is_down(Action::NextTool, went_down) {
            self.tool = (self.tool + 1) % self.tool_ids.len();
        }
        self.was_down = buttons;
    }
}

impl Servo for Runner {
    fn tick(&mut self, now_ns: u64, state: &DeviceState) -> Vector3<f64> {
        // Backwards is told as such: the core has to know.
        let dt_s = self.last_ns.map_or(FIRST_DT_S, |last_ns| (now_ns as i64 - last_ns as i64) as f64 * 1e-9);
        self.last_ns = Some(now_ns);
        self.next_tool(state.buttons);
        let hold = self.hold(state);
        let hand = self.mapping.hand(state, hold == Some(Hold::Clutch));
        let update = *self.slots.updates.read();
        // What came of another tool, or before anything came, is no contact of this one.
        let is_ours = update.number > 0 && update.tool_id == self.tool_ids[self.tool];
        let age_s = now_ns.saturating_sub(update.arrived_ns) as f64 * 1e-9;
        let motion_age_s = (update.echo_ns > 0).then(|| now_ns.saturating_sub(update.echo_ns) as f64 * 1e-9);
        let pose_age_s = motion_age_s.unwrap_or(f64::INFINITY);
        let newest = is_ours.then_some(Newest { update: &update, age_s, pose_age_s });
        let rendered = self.core.tick(dt_s, &hand, hold, newest);
        let force_n = self.mapping.force_on_device(&rendered.force_n);
        let opening = if self.is_down(Action::Grasp, state.buttons) { 0.0 } else { 1.0 };
        let believed = rendered.tool.filter(|_| !matches!(hold, Some(Hold::Device(_) | Hold::Leaving)));
        self.slots.motions.write(Motion {
            sampled_ns: now_ns,
            tool: self.tool,
            placement: believed.map(|pose| Placement { pose, opening }),
            contact_n: rendered.contact_n,
            speed_m_per_s: hand.velocity_m_per_s.norm(),
        });
        let sample = Sample {
            at_ns: now_ns,
            dt_s,
            spent_ns: clock::now_ns().saturating_sub(now_ns),
            device: *state,
            force_n,
            rendered,
            contacts: update.number,
            motion_age_s,
            model: update.model.filter(|_| is_ours),
        };
        // Full: the monitor misses a tick, the hand none.
        let _ = self.slots.samples.push(sample);
        force_n
    }
}

/// What a device bears, as the scene sees it: lengths and forces are scaled on their way there.
#[must_use]
pub fn settings(info: &DeviceInfo, config: &DeviceConfig) -> Settings {
    let (servo, mapping) = (&config.servo, &config.mapping);
    let force = 1.0 / mapping.force_scale;
    let stiffness = force / mapping.scale;
    let energy = force * mapping.scale;
    Settings {
        peak_force_n: force * servo.max_force_n.map_or(info.peak_force_n, |most_n| most_n.min(info.peak_force_n)),
        slew_n_per_s: force * servo.slew_n_per_s,
        ramp_s: servo.ramp_s,
        fade_s: servo.fade_s,
        coupling: CouplingLimits {
            min_stiffness_n_per_m: stiffness * servo.min_stiffness_n_per_m,
            max_stiffness_n_per_m: stiffness
                * servo
                    .max_stiffness_n_per_m
                    .map_or(info.max_stiffness_n_per_m, |most| most.min(info.max_stiffness_n_per_m)),
            max_damping_n_s_per_m: stiffness * info.max_damping_n_s_per_m,
            mass_kg: stiffness * info.apparent_mass_kg,
        },
        passivity: Some(PassivityLimits {
            max_damping_n_s_per_m: stiffness * info.max_damping_n_s_per_m,
            margin_j: energy * PASSIVITY_MARGIN_J,
            max_debt_j: energy * PASSIVITY_DEBT_J,
        }),
        fault: FaultLimits {
            max_gap_s: MAX_GAP_S,
            max_speed_m_per_s: mapping.scale * MAX_HAND_SPEED_M_PER_S,
            hold_s: FAULT_HOLD_S,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::super::core::State;
    use super::super::model::tests::floor;
    use super::*;
    use crate::config::MappingConfig;
    use crate::device::{Device, simulated::Simulated};

    struct Bench {
        runner: Runner,
        updates: triple_buffer::Input<Update>,
        motions: triple_buffer::Output<Motion>,
        samples: rtrb::Consumer<Sample>,
        now_ns: u64,
        number: u64,
    }

    fn bench(config: &DeviceConfig, tool_ids: &[u32]) -> Bench {
        let info = Simulated::new(&crate::config::SimulatedConfig::default()).info().clone();
        let (updates, contacts) = triple_buffer::triple_buffer(&Update::default());
        let (motions, motion) = triple_buffer::triple_buffer(&Motion::default());
        let (samples, sample) = rtrb::RingBuffer::new(4096);
        let slots = Slots { updates: contacts, motions, samples, is_leaving: Arc::default() };
        let runner = Runner::new(settings(&info, config), config, tool_ids.into(), slots);
        Bench { runner, updates, motions: motion, samples: sample, now_ns: 1_000_000_000, number: 0 }
    }

    impl Bench {
        /// Ticks with a contact of a tool that is always new.
        fn ticks(&mut self, count: usize, state: &DeviceState, tool_id: u32) -> Vector3<f64> {
            let mut force_n = Vector3::zeros();
            for _ in 0..count {
                self.now_ns += 1_000_000;
                self.number += 1;
                let model = Some(floor());
                let update =
                    Update { number: self.number, tool_id, arrived_ns: self.now_ns, model, ..Update::default() };
                self.updates.write(Update { blend_s: 4e-3, max_age_s: 0.1, round_trip_s: 2e-3, ..update });
                force_n = self.runner.tick(self.now_ns, state);
            }
            force_n
        }

        fn last(&mut self) -> Sample {
            std::iter::from_fn(|| self.samples.pop().ok()).last().expect("a sample")
        }
    }

    fn deep(buttons: u32) -> DeviceState {
        DeviceState { position_m: Vector3::new(0.0, -4e-3, 0.0), buttons, ..DeviceState::default() }
    }

    #[test]
    fn a_scaled_scene_is_felt_within_the_devices_own_limits() {
        // Ten times as large and as stiff as the hand is to feel it.
        let mapping = MappingConfig { scale: 1.0, force_scale: 0.1, ..MappingConfig::default() };
        let mut bench = bench(&DeviceConfig { mapping, ..DeviceConfig::default() }, &[0]);
        let force_n = bench.ticks(10_000, &deep(0), 0);
        // 1 N and 500 N/m in the scene are 0.1 N and 50 N/m to the hand, with a coupling of 500 N/m.
        let expected_n = (0.1 + 50.0 * 4e-3) * 500.0 / 550.0;
        assert!((force_n.y - expected_n).abs() < 1e-4, "{force_n}, not {expected_n}");
    }

    #[test]
    fn no_more_force_is_asked_for_than_the_device_has() {
        let info = Simulated::new(&crate::config::SimulatedConfig::default()).info().clone();
        let most_n = |max_force_n| {
            let servo = crate::config::ServoConfig { max_force_n, ..Default::default() };
            settings(&info, &DeviceConfig { servo, ..DeviceConfig::default() }).peak_force_n
        };
        assert_eq!([most_n(None), most_n(Some(2.0)), most_n(Some(100.0))], [3.3, 2.0, 3.3]);
    }

    #[test]
    fn before_anything_has_come_the_coupling_stays_as_soft_as_it_gets() {
        let mut bench = bench(&DeviceConfig::default(), &[0]);
        for _ in 0..2000 {
            bench.now_ns += 1_000_000;
            assert_eq!(bench.runner.tick(bench.now_ns, &deep(0)).norm(), 0.0);
        }
        let rendered = bench.last().rendered;
        assert_eq!((rendered.state, rendered.coupling_n_per_m), (State::Stale, 20.0));
    }

    #[test]
    fn a_station_that_leaves_takes_the_force_out_and_its_tool_too() {
        let mut bench = bench(&DeviceConfig::default(), &[0]);
        assert!(bench.ticks(3000, &deep(0), 0).y > 1.0);
        bench.runner.slots.is_leaving.store(true, Ordering::Relaxed);
        assert_eq!(bench.ticks(200, &deep(0), 0).norm(), 0.0);
        assert_eq!(bench.motions.read().placement, None);
    }

    #[test]
    fn the_clutch_holds_the_tool_and_takes_the_force_out() {
        let mut bench = bench(&DeviceConfig::default(), &[0]);
        assert!(bench.ticks(3000, &deep(0), 0).y > 1.0);
        let before = bench.motions.read().placement;
        bench.ticks(1, &deep(2), 0);
        let moved = DeviceState { position_m: Vector3::new(0.02, 0.0, 0.0), ..deep(2) };
        assert_eq!(bench.ticks(200, &moved, 0).norm(), 0.0);
        assert_eq!(bench.last().rendered.state, State::Held(Hold::Clutch));
        let during = bench.motions.read().placement;
        assert!((during.unwrap().pose.position_m - before.unwrap().pose.position_m).norm() < 1e-3);
    }

    #[test]
    fn buttons_close_jaws_and_take_the_next_tool_whose_contacts_alone_are_felt() {
        let mut config = DeviceConfig::default();
        config.buttons.push(ButtonConfig { button: 2, action: Action::NextTool });
        let mut bench = bench(&config, &[5, 7]);
        assert!(bench.ticks(3000, &deep(0), 5).y > 1.0);
        bench.ticks(1, &deep(1), 5);
        assert_eq!(bench.motions.read().placement.unwrap().opening, 0.0);
        assert_eq!(bench.ticks(200, &deep(4), 5).norm(), 0.0, "a contact of the tool before");
        assert_eq!(bench.motions.read().tool, 1);
        assert!(bench.ticks(3000, &deep(4), 7).y > 1.0);
        bench.ticks(1, &deep(0), 7);
        bench.ticks(1, &deep(4), 7);
        assert_eq!(bench.motions.read().tool, 0);
    }

    #[test]
    fn a_dead_mans_button_has_to_be_down_and_a_device_that_is_not_ready_takes_its_tool_out() {
        let dead_man = ButtonConfig { button: 3, action: Action::DeadMan };
        let mut bench = bench(&DeviceConfig { buttons: vec![dead_man], ..DeviceConfig::default() }, &[0]);
        assert_eq!(bench.ticks(1000, &deep(0), 0).norm(), 0.0);
        assert!(bench.ticks(3000, &deep(8), 0).y > 1.0);
        bench.ticks(1, &DeviceState { hold: Some("not calibrated"), ..deep(8) }, 0);
        assert_eq!(bench.last().rendered.state, State::Held(Hold::Device("not calibrated")));
        assert_eq!(bench.motions.read().placement, None);
    }

    #[test]
    fn a_clock_that_jumps_and_a_servo_that_starved_let_go_and_come_back() {
        for jump_ns in [-50_000_000_i64, 3_600_000_000_000, 500_000_000] {
            let mut bench = bench(&DeviceConfig::default(), &[0]);
            let before_n = bench.ticks(8000, &deep(0), 0);
            bench.now_ns = bench.now_ns.checked_add_signed(jump_ns).unwrap();
            let (mut last_n, mut least_n) = (before_n, before_n.norm());
            for _ in 0..100 {
                let force_n = bench.ticks(1, &deep(0), 0);
                // 500 N/s: half a newton a tick, one where the servo was away.
                assert!((force_n - last_n).norm() < 1.01, "{jump_ns}");
                (last_n, least_n) = (force_n, least_n.min(force_n.norm()));
            }
            assert_eq!(least_n, 0.0, "{jump_ns}");
            assert!((bench.ticks(8000, &deep(0), 0) - before_n).norm() < 0.01, "{jump_ns}");
        }
    }
}
