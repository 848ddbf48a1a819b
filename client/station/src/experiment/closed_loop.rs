//! The whole loop: a simulated hand on a simulated Omni, the servo, gRPC through a network that is made worse on
//! purpose, and a server that cuts the liver. In real time.

use std::fmt::Write as _;
use std::net::SocketAddr;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use anyhow::{Context, anyhow};
use nalgebra::{Matrix3, Vector3};

use super::Rendering;
use super::network::{Network, Quality};
use crate::config::{DeviceConfig, HandConfig, LinkConfig, MappingConfig, ServerConfig, SimulatedConfig};
use crate::device::simulated::Simulated;
use crate::device::{Device, DeviceState, Servo, paced};
use crate::link::{Link, LinkSettings, SessionChoice, describe};
use crate::servo::core::Settings;
use crate::servo::limits::clamped;
use crate::servo::model::{Along, Update};
use crate::servo::runner::{Motion, Runner, Sample, Slots, settings};
use crate::servo::schedule::CouplingLimits;

/// More than this while the hand holds still is shaking, m.
const SWING_M: f64 = 0.5e-3;
/// More than this given out while the hand holds still is no passive tissue, J: the passivity observer leaves it 1 mJ.
const GIVEN_J: f64 = 2e-3;
/// The stroke: time, s, and height of the hand's goal above the tissue, m. It touches, leans in and waits, cuts and waits.
const STROKE: [[f64; 2]; 6] = [[0.0, 0.01], [0.6, 0.0], [1.0, -0.01], [2.0, -0.01], [3.0, -0.04], [4.2, -0.04]];
/// Spans of it in which the hand waits and is judged, s.
const WAITS_S: [[f64; 2]; 2] = [[1.3, 2.0], [3.5, 4.2]];
/// Height of the right lobe above the scene's floor, and its middle, m.
const TOP_M: [f64; 3] = [-0.042, 0.154, -0.021];
/// Grip of the hand: between a light one and a firm one.
const GRIP_N_PER_M: f64 = 150.0;
const GRIP_N_S_PER_M: f64 = 1.0;
/// A coupling that is none: the tool is in the hand.
const RIGID_N_PER_M: f64 = 1e9;

/// A tissue and how much of its forces is felt.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Tissue {
    name: &'static str,
    scene: &'static str,
    force_scale: f64,
}

/// The liver as soft as the real one, and as stiff as the paper's.
const TISSUES: [Tissue; 2] = [
    Tissue { name: "soft", scene: "liver-tissue", force_scale: 0.1 },
    Tissue { name: "stiff", scene: "liver", force_scale: 0.02 },
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
    /// How far the hand swings while it waits, m.
    swing_m: f64,
    /// Most energy that the device gave out while the hand waited, J.
    given_j: f64,
    /// Force on the hand less what the server found at the same pose, rms over rms.
    force_error: f64,
    /// Greatest force on the hand, N.
    greatest_n: f64,
}

impl Outcome {
    fn word(&self) -> &'static str {
        match (self.swing_m < SWING_M, self.given_j < GIVEN_J) {
            (true, true) => "calm",
            (true, false) => "gives energy",
            (false, _) => "shakes",
        }
    }
}

/// The servo, and what it saw.
struct Watched {
    runner: Runner,
    rendering: Rendering,
    came: triple_buffer::Output<Update>,
    passed_on: triple_buffer::Input<Update>,
    samples: rtrb::Consumer<Sample>,
    update: Update,
    /// When the device was read, ns, and the force on the tool that the hand felt, N.
    felt: Vec<(u64, Vector3<f64>)>,
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
            self.felt.push((sample.at_ns, sample.rendered.force_n));
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
    fn run(&self, server: SocketAddr) -> anyhow::Result<Outcome> {
        let network = Network::to(server, self.quality)?;
        let server = ServerConfig { url: format!("http://{}", network.address()), ..ServerConfig::default() };
        let session = SessionChoice::Create(self.tissue.scene.into());
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let (_, session_id) = runtime.block_on(describe(&server, &session)).map_err(|why| anyhow!(why))?;
        let config = DeviceConfig {
            mapping: MappingConfig {
                scene_origin_m: TOP_M,
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
            session_id: Some(session_id),
            tool_ids: [0].into(),
            link: LinkConfig::default(),
            force_scale: self.tissue.force_scale,
        };
        let link = Link::start(link, motion, from_link)?;
        let mut outcome = play(&mut device, &mut servo);
        let status = link.status();
        outcome.round_trip_s = status.round_trip_s.with_context(|| format!("no contact came: {status:?}"))?;
        outcome.force_error = force_error(&servo.felt, &servo.found, limits.peak_force_n);
        Ok(outcome)
    }
}

/// The stroke; what the hand does while it waits.
fn play(device: &mut Simulated, servo: &mut Watched) -> Outcome {
    let mut outcome = Outcome::default();
    let mut work_j = 0.0;
    let mut waits = WAITS_S.map(|span_s| (span_s, Wait::default()));
    let end_s = STROKE[STROKE.len() - 1][0];
    let rate_hz = device.info().rate_hz;
    paced::run(servo, &AtomicBool::new(false), rate_hz, |dt_s, force_n| {
        let before_m = device.truth().0;
        let state = device.step(dt_s, force_n);
        let now_m = device.truth().0;
        work_j += force_n.dot(&(now_m - before_m));
        outcome.greatest_n = outcome.greatest_n.max(force_n.norm());
        for ([from_s, to_s], wait) in &mut waits {
            if (*from_s..*to_s).contains(&device.time_s()) {
                wait.take(now_m.y, work_j);
            }
        }
        (device.time_s() < end_s).then_some(state)
    });
    for (_, wait) in waits {
        outcome.swing_m = outcome.swing_m.max(wait.heights_m[1] - wait.heights_m[0]);
        outcome.given_j = outcome.given_j.max(wait.given_j);
    }
    outcome
}

/// What a hand that waits goes through.
#[derive(Clone, Copy, Debug)]
struct Wait {
    heights_m: [f64; 2],
    least_work_j: f64,
    given_j: f64,
}

impl Default for Wait {
    fn default() -> Self {
        Self { heights_m: [f64::MAX, f64::MIN], least_work_j: f64::MAX, given_j: 0.0 }
    }
}

impl Wait {
    fn take(&mut self, height_m: f64, work_j: f64) {
        self.heights_m = [self.heights_m[0].min(height_m), self.heights_m[1].max(height_m)];
        self.least_work_j = self.least_work_j.min(work_j);
        self.given_j = self.given_j.max(work_j - self.least_work_j);
    }
}

/// What was felt at each pose that the server has answered, less what it found there, rms over rms; neither beyond
/// what the device renders.
fn force_error(felt: &[(u64, Vector3<f64>)], found: &[(u64, Vector3<f64>)], most_n: f64) -> f64 {
    let (mut wrong, mut right) = (0.0, 0.0);
    for (at_ns, found_n) in found {
        let found_n = clamped(*found_n, most_n);
        if let Ok(index) = felt.binary_search_by_key(at_ns, |(at_ns, _)| *at_ns) {
            wrong += (felt[index].1 - found_n).norm_squared();
            right += found_n.norm_squared();
        }
    }
    (wrong / right.max(f64::MIN_POSITIVE)).sqrt()
}

/// Plays every trial through a server, draws the plot into a folder and returns the report's text.
///
/// # Errors
/// The server does not answer, or a file cannot be written.
pub fn report(server: SocketAddr, folder: &Path) -> anyhow::Result<String> {
    let mut text = String::new();
    for tissue in TISSUES {
        for quality in qualities() {
            for rendering in Rendering::ALL {
                let outcome = Trial { tissue, quality, rendering }.run(server)?;
                let Quality { round_trip_s, jitter_s, stalled_share } = quality;
                let line = format!(
                    "| {} | {:.0} | {:.0} | {:.0} | {} | {:.0} | {:.1} | {:.2} | {:.2} | {:.2} | {} |",
                    tissue.name,
                    1e3 * round_trip_s,
                    1e3 * jitter_s,
                    100.0 * stalled_share,
                    rendering.name(),
                    1e3 * outcome.round_trip_s,
                    100.0 * outcome.force_error,
                    outcome.greatest_n,
                    1e3 * outcome.swing_m,
                    1e3 * outcome.given_j,
                    outcome.word(),
                );
                eprintln!("{line}");
                writeln!(text, "{line}")?;
            }
        }
    }
    let _ = folder;
    Ok(text)
}

fn qualities() -> Vec<Quality> {
    let even = [0.0, 0.005, 0.02, 0.05, 0.1, 0.2].map(|round_trip_s| Quality { round_trip_s, ..Quality::default() });
    let uneven = [(0.02, 0.01, 0.0), (0.02, 0.01, 0.1), (0.1, 0.01, 0.0), (0.1, 0.01, 0.1)]
        .map(|(round_trip_s, jitter_s, stalled_share)| Quality { round_trip_s, jitter_s, stalled_share });
    [even.as_slice(), &uneven].concat()
}
