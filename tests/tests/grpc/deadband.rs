//! What the deadbands of a station and its server keep home, and what that does to the force.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use kerf_station::config::{DeviceConfig, HandConfig, LinkConfig, MappingConfig, ServerConfig, SimulatedConfig};
use kerf_station::device::simulated::Simulated;
use kerf_station::device::{Device, DeviceState, Servo};
use kerf_station::link::{Link, LinkSettings, LinkStatus, SharedSession};
use kerf_station::servo::model::Update;
use kerf_station::servo::runner::{Motion, Runner, Sample, Slots, settings};
use nalgebra::Vector3;

use super::harness::Harness;

/// Share of the messages that may be sent, and by which the force may be off.
const MOST_SENT: f64 = 0.4;
const MOST_OFF: f64 = 0.05;
/// Age of the newest contact's motion, s, above which the machine was late, and not the deadband: it is 57 ms at most while
/// nothing else runs.
const LATE_S: f64 = 0.08;
/// Time of a stroke, s.
const STROKE_S: f64 = 2.0;

/// A servo that keeps what it rendered, and what the server said of the same poses.
struct Watched {
    runner: Runner,
    came: triple_buffer::Output<Update>,
    passed_on: triple_buffer::Input<Update>,
    samples: rtrb::Consumer<Sample>,
    newest: Update,
    felt: Vec<Sample>,
    /// When the pose was taken, ns, and the force on the tool there, N.
    found: Vec<(u64, Vector3<f64>)>,
}

impl Servo for Watched {
    fn tick(&mut self, now_ns: u64, state: &DeviceState) -> Vector3<f64> {
        let update = *self.came.read();
        if update.number != self.newest.number {
            if update.echo_ns != self.newest.echo_ns {
                self.found.push((update.echo_ns, update.model.map_or_else(Vector3::zeros, |model| model.force_n)));
            }
            self.newest = update;
            self.passed_on.write(update);
        }
        let force_n = self.runner.tick(now_ns, state);
        self.felt.extend(self.samples.pop());
        force_n
    }
}

/// What came of a stroke of the hand.
struct Outcome {
    status: LinkStatus,
    felt: Vec<Sample>,
    found: Vec<(u64, Vector3<f64>)>,
}

/// Moves a simulated hand at the block's first blade along heights above its top; time, s, and height, m.
fn stroke(server: SocketAddr, session_id: &str, heights: &[[f64; 2]], deadband: f64) -> Outcome {
    let path = heights.iter().map(|[time_s, y_m]| [*time_s, 0.0, *y_m, 0.0]).collect();
    let hand = HandConfig { path, ends: true, ..HandConfig::default() };
    let mut device = Simulated::new(&SimulatedConfig { hand, ..SimulatedConfig::default() });
    let mapping = MappingConfig { scene_origin_m: [0.0, 0.01, 4e-4], turns_tool: false, ..MappingConfig::default() };
    let config = DeviceConfig { mapping, ..DeviceConfig::default() };
    let (from_link, came) = triple_buffer::triple_buffer(&Update::default());
    let (passed_on, updates) = triple_buffer::triple_buffer(&Update::default());
    let (motions, motion) = triple_buffer::triple_buffer(&Motion::default());
    let (sample, samples) = rtrb::RingBuffer::new(4);
    let slots = Slots { updates, motions, samples: sample, is_leaving: Arc::default() };
    let link = LinkSettings {
        server: ServerConfig { url: format!("http://{server}"), ..ServerConfig::default() },
        session: SharedSession::join(session_id),
        tool_ids: [0].into(),
        link: LinkConfig { deadband, ..LinkConfig::default() },
        force_scale: 1.0,
    };
    let link = Link::start(link, motion, from_link).expect("it starts");
    let mut servo = Watched {
        runner: Runner::new(settings(device.info(), &config), &config, [0].into(), slots),
        came,
        passed_on,
        samples,
        newest: Update::default(),
        felt: Vec::new(),
        found: Vec::new(),
    };
    device.run(&mut servo, &AtomicBool::new(false)).expect("a simulated device does not fail");
    Outcome { status: link.status(), felt: servo.felt, found: servo.found }
}

impl Outcome {
    /// Of the poses that were due.
    fn poses(&self) -> f64 {
        self.status.poses as f64 / self.status.poses_due as f64
    }

    /// Force that was rendered less what the server found at the same pose, rms over rms, where contacts came in time.
    fn force_error(&self) -> f64 {
        let (mut wrong, mut right, mut compared) = (0.0, 0.0, 0);
        for (at_ns, found_n) in &self.found {
            let Ok(index) = self.felt.binary_search_by_key(at_ns, |sample| sample.at_ns) else { continue };
            let sample = &self.felt[index];
            if sample.motion_age_s.is_some_and(|age_s| age_s < LATE_S) {
                wrong += (sample.rendered.contact_n - found_n).norm_squared();
                right += found_n.norm_squared();
                compared += 1;
            }
        }
        assert!(2 * compared > self.found.len(), "{compared} of {} contacts came in time", self.found.len());
        (wrong / right).sqrt()
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn deadbands_keep_most_messages_home_and_the_force_what_it_is() {
    let mut harness = Harness::start().await;
    let server = harness.server.address();
    // Less deep than what makes it part.
    let cases = [("free", [[0.0, 0.002], [STROKE_S, 0.022]]), ("slow contact", [[0.0, 2e-4], [STROKE_S, -4e-4]])];
    for (case, heights) in cases {
        let mut outcomes = Vec::new();
        for deadband in [0.0, LinkConfig::default().deadband] {
            let session = harness.create().await.unwrap();
            let played = tokio::task::spawn_blocking(move || stroke(server, &session, &heights, deadband));
            outcomes.push(played.await.unwrap());
        }
        let [all, few] = &outcomes[..] else { unreachable!("two were played") };
        let (poses, contacts) = (few.poses(), few.status.contacts as f64 / all.status.contacts as f64);
        println!("{case}: {:.1} % of the poses, {:.1} % of the contacts", 100.0 * poses, 100.0 * contacts);
        // But for those that a busy machine does not take off the stream in time.
        assert!(all.poses() > 2.0 * MOST_SENT, "{case}: without a deadband all go out, {}", all.poses());
        assert!(poses < MOST_SENT && contacts < MOST_SENT, "{case}: {poses} of the poses, {contacts} of the contacts");
        if case == "slow contact" {
            let error = few.force_error();
            println!("{case}: force off by {:.2} %", 100.0 * error);
            assert!(few.found.iter().any(|(_, force_n)| force_n.norm() > 0.005), "it touches");
            assert!(error < MOST_OFF, "{case}: {error}");
        }
    }
}
