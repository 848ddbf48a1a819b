//! The whole loop: a simulated hand on a simulated Omni, the servo, gRPC through a network that is made worse on
//! purpose, and a server that cuts the liver. In real time.

mod report;
mod row;

use std::net::SocketAddr;
use std::sync::atomic::AtomicBool;

use anyhow::{Context, anyhow};
use nalgebra::{Matrix3, Vector3};

pub use self::report::report;
pub use self::row::Row;
use super::Rendering;
use super::network::{Network, Quality};
use crate::config::{DeviceConfig, HandConfig, LinkConfig, MappingConfig, ServerConfig, SimulatedConfig};
use crate::device::simulated::Simulated;
use crate::device::{Device, DeviceState, Servo, paced};
use crate::link::{Link, LinkSettings, SharedSession};
use crate::servo::core::{Settings, State};
use crate::servo::limits::clamped;
use crate::servo::model::{Along, Update};
use crate::servo::runner::{Motion, Runner, Sample, Slots, settings};
use crate::servo::schedule::CouplingLimits;

/// More than this while the hand holds still is shaking, m.
const SWING_M: f64 = 0.5e-3;
/// More than this given out while the hand holds still is no passive tissue, J: the passivity observer leaves it 1 mJ.
const GIVEN_J: f64 = 2e-3;
/// The stroke: time, s, and height of the hand's goal above the tissue, m. It touches, leans in and waits, leans in further
/// and waits.
const STROKE: [[f64; 2]; 6] = [[0.0, 0.01], [0.6, 0.0], [1.0, -0.005], [2.0, -0.005], [2.6, -0.016], [4.2, -0.016]];
/// Spans of it in which the hand waits and is judged, s.
const WAITS_S: [[f64; 2]; 2] = [[1.3, 2.0], [3.2, 4.2]];
/// Grip of the hand: between a light one and a firm one.
const GRIP_N_PER_M: f64 = 200.0;
const GRIP_N_S_PER_M: f64 = 1.0;
/// A coupling that is none: the tool is in the hand.
const RIGID_N_PER_M: f64 = 1e9;

/// A tissue and how much of its forces is felt.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Tissue {
    name: &'static str,
    scene: &'static str,
    /// Middle of the right lobe's top in the scene, as it is at rest.
    top_m: [f64; 3],
    force_scale: f64,
}

/// The liver as soft as the real one, and as stiff as the paper's.
const TISSUES: [Tissue; 2] = [
    Tissue { name: "soft", scene: "liver-tissue", top_m: [-0.042, 0.1435, -0.021], force_scale: 0.3 },
    Tissue { name: "stiff", scene: "liver", top_m: [-0.042, 0.154, -0.021], force_scale: 0.02 },
];

/// A stroke.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Trial {
    tissue: Tissue,
    quality: Quality,
    rendering: Rendering,
}

/// What came of it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Outcome {
    /// Round trip as the link measured it, s.
    round_trip_s: f64,
    /// Share of the time that the hand waits in which force is rendered in full.
    rendered_share: f64,
    /// How far the hand goes both forth and back in that time, m.
    swing_m: f64,
    /// Most energy that the device gave out in that time, J.
    given_j: f64,
    /// Force on the hand less what the server found at the same pose, rms over rms.
    force_error: f64,
    /// The same while force is rendered in full.
    full_error: f64,
    /// Greatest force on the hand, N.
    greatest_n: f64,
    /// Poses and contacts that the deadbands leave of what they might be.
    sent_shares: [f64; 2],
}

impl Outcome {
    fn is_calm(&self) -> bool {
        self.swing_m < SWING_M && self.given_j < GIVEN_J
    }

    fn word(&self) -> &'static str {
        match (self.swing_m < SWING_M, self.given_j < GIVEN_J) {
            (true, true) => "calm",
            (true, false) => "gives energy",
            (false, _) => "shakes",
        }
    }
}

/// A stroke that was played, tick by tick.
struct Played {
    outcome: Outcome,
    moments: Vec<Moment>,
    felt: Vec<Sample>,
}

/// The servo, and what it saw.
struct Watched {
    runner: Runner,
    rendering: Rendering,
    came: triple_buffer::Output<Update>,
    passed_on: triple_buffer::Input<Update>,
    samples: rtrb::Consumer<Sample>,
    update: Update,
    /// By tick.
    felt: Vec<Sample>,
    /// When the pose was taken, ns, and the force on the tool that the server found there, N.
    found: Vec<(u64, Vector3<f64>)>,
}

impl Servo for Watched {
    fn tick(&mut self, now_ns: u64, state: &DeviceState) -> Vector3<f64> {
        let update = *self.came.read();
        if update.number != self.update.number {
            if update.echo_ns != self.update.echo_ns {
                let force_n = update.model.map_or_else(Vector3::zeros, |model| model.force_n);
                self.found.push((update.echo_ns, force_n));
            }
            self.update = update;
            self.passed_on.write(if self.rendering == Rendering::Held { bare(update) } else { update });
        }
        let force_n = self.runner.tick(now_ns, state);
        while let Ok(sample) = self.samples.pop() {
            self.felt.push(sample);
        }
        force_n
    }
}

/// The force alone, for as long as no other comes.
fn bare(update: Update) -> Update {
    let model = update.model.map(|mut model| {
        (model.stiffness_n_per_m, model.turning_n_per_rad, model.damping_n_s_per_m) =
            (Matrix3::zeros(), Matrix3::zeros(), Matrix3::zeros());
        model.along = Along::Holds;
        model
    });
    Update { model, blend_s: 0.0, max_age_s: 1e9, ..update }
}

fn limits(info: &crate::device::DeviceInfo, config: &DeviceConfig, rendering: Rendering) -> Settings {
    let full = settings(info, config);
    match rendering {
        Rendering::Passive => full,
        Rendering::Model => Settings { passivity: None, ..full },
        Rendering::Held => Settings {
            passivity: None,
            slew_n_per_s: 1e9,
            ramp_s: 1e-3,
            coupling: CouplingLimits {
                min_stiffness_n_per_m: RIGID_N_PER_M,
                max_stiffness_n_per_m: RIGID_N_PER_M,
                max_damping_n_s_per_m: 0.0,
                ..full.coupling
            },
            ..full
        },
    }
}

impl Trial {
    fn run(&self, server: SocketAddr) -> anyhow::Result<Played> {
        let network = Network::to(server, self.quality)?;
        let server = ServerConfig { url: format!("http://{}", network.address()), ..ServerConfig::default() };
        let session = SharedSession::create(self.tissue.scene);
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        runtime.block_on(session.describe(&server)).map_err(|why| anyhow!(why))?;
        let config = DeviceConfig {
            mapping: MappingConfig {
                scene_origin_m: self.tissue.top_m,
                force_scale: self.tissue.force_scale,
                turns_tool: false,
                ..MappingConfig::default()
            },
            ..DeviceConfig::default()
        };
        let path = STROKE.map(|[time_s, height_m]| [time_s, 0.0, height_m, 0.0]).to_vec();
        let hand = HandConfig {
            stiffness_n_per_m: GRIP_N_PER_M,
            damping_n_s_per_m: GRIP_N_S_PER_M,
            path,
            ends: true,
            ..HandConfig::default()
        };
        let mut device = Simulated::new(&SimulatedConfig { hand, ..SimulatedConfig::default() });
        let limits = limits(device.info(), &config, self.rendering);
        let (from_link, came) = triple_buffer::triple_buffer(&Update::default());
        let (passed_on, updates) = triple_buffer::triple_buffer(&Update::default());
        let (motions, motion) = triple_buffer::triple_buffer(&Motion::default());
        let (sample, samples) = rtrb::RingBuffer::new(4);
        let slots = Slots { updates, motions, samples: sample, is_leaving: Default::default() };
        let ticks = 2 * (1e3 * STROKE[STROKE.len() - 1][0]) as usize;
        let mut servo = Watched {
            runner: Runner::new(limits, &config, [0].into(), slots),
            rendering: self.rendering,
            came,
            passed_on,
            samples,
            update: Update::default(),
            felt: Vec::with_capacity(ticks),
            found: Vec::with_capacity(ticks),
        };
        let link = LinkSettings {
            server,
            session,
            tool_ids: [0].into(),
            link: LinkConfig::default(),
            force_scale: self.tissue.force_scale,
        };
        let link = Link::start(link, motion, from_link)?;
        let moments = play(&mut device, &mut servo);
        let mut outcome = judge(&moments, &servo.felt);
        let status = link.status();
        outcome.round_trip_s = status.round_trip_s.with_context(|| format!("no contact came: {status:?}"))?;
        let contacts_due = LinkConfig::default().contact_rate_hz * STROKE[STROKE.len() - 1][0];
        outcome.sent_shares =
            [status.poses as f64 / status.poses_due.max(1) as f64, status.contacts as f64 / contacts_due];
        let error = |in_full| force_error(&servo.felt, &servo.found, limits.peak_force_n, in_full);
        [outcome.force_error, outcome.full_error] = [false, true].map(error);
        Ok(Played { outcome, moments, felt: servo.felt })
    }
}

/// The stroke.
fn play(device: &mut Simulated, servo: &mut Watched) -> Vec<Moment> {
    let mut work_j = 0.0;
    let mut moments = Vec::with_capacity(servo.felt.capacity());
    let end_s = STROKE[STROKE.len() - 1][0];
    paced::run(servo, &AtomicBool::new(false), device.info().rate_hz, |dt_s, force_n| {
        let before_m = device.truth().0;
        let state = device.step(dt_s, force_n);
        let now_m = device.truth().0;
        work_j += force_n.dot(&(now_m - before_m));
        (device.time_s() < end_s).then(|| {
            moments.push(Moment { time_s: device.time_s(), height_m: now_m.y, work_j });
            state
        })
    });
    moments
}

/// What the hand does while it waits.
fn judge(moments: &[Moment], felt: &[Sample]) -> Outcome {
    let is_waiting = |time_s: f64| WAITS_S.iter().any(|[from_s, to_s]| (*from_s..*to_s).contains(&time_s));
    let ticks = moments.iter().zip(felt.iter().map(|sample| sample.rendered.state));
    let waiting: Vec<_> = ticks.filter(|(moment, _)| is_waiting(moment.time_s)).collect();
    let is_rendered = |state: &State| *state == State::Rendering;
    let rendered = waiting.iter().filter(|(_, state)| is_rendered(state)).count();
    let mut outcome = Outcome {
        greatest_n: felt.iter().map(|sample| sample.force_n.norm()).fold(0.0, f64::max),
        rendered_share: rendered as f64 / waiting.len() as f64,
        ..Outcome::default()
    };
    // One wait is not the other, and a force that was taken out and let in again is no swing.
    let goes_on = |one: &(&Moment, State), next: &(&Moment, State)| {
        is_rendered(&one.1) == is_rendered(&next.1) && next.0.time_s - one.0.time_s < 0.1
    };
    for span in waiting.chunk_by(goes_on).filter(|span| is_rendered(&span[0].1)) {
        let (mut lowest_m, mut highest_m, mut least_j) = (f64::MAX, f64::MIN, f64::MAX);
        let (mut rise_m, mut fall_m) = (0.0_f64, 0.0_f64);
        for (Moment { height_m, work_j, .. }, _) in span {
            (lowest_m, highest_m) = (lowest_m.min(*height_m), highest_m.max(*height_m));
            (rise_m, fall_m) = (rise_m.max(height_m - lowest_m), fall_m.max(highest_m - height_m));
            least_j = least_j.min(*work_j);
            outcome.given_j = outcome.given_j.max(work_j - least_j);
        }
        // What goes one way alone is a hand that follows tissue or coupling as they give.
        outcome.swing_m = outcome.swing_m.max(rise_m.min(fall_m));
    }
    outcome
}

/// The device at a tick.
#[derive(Clone, Copy, Debug)]
struct Moment {
    time_s: f64,
    height_m: f64,
    /// Of the device on the hand so far, J.
    work_j: f64,
}

/// What was felt at each pose that the server has answered, less what it found there, rms over rms; neither beyond
/// what the device renders.
fn force_error(felt: &[Sample], found: &[(u64, Vector3<f64>)], most_n: f64, in_full: bool) -> f64 {
    let (mut wrong, mut right) = (0.0, 0.0);
    for (at_ns, found_n) in found {
        let found_n = clamped(*found_n, most_n);
        let index = felt.binary_search_by_key(at_ns, |sample| sample.at_ns);
        let rendered = index.ok().map(|index| &felt[index].rendered);
        if let Some(rendered) = rendered.filter(|rendered| !in_full || rendered.state == State::Rendering) {
            wrong += (rendered.force_n - found_n).norm_squared();
            right += found_n.norm_squared();
        }
    }
    (wrong / right.max(f64::MIN_POSITIVE)).sqrt()
}
