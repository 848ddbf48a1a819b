//! Who uses the server: a script that drives a blade, a haptic station with another, and a viewer. All come back by
//! themselves.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use fastrand::Rng;
use kerf_proto::PROTOCOL_VERSION;
use kerf_proto::v1::control_service_client::ControlServiceClient;
use kerf_proto::v1::view_response::Message;
use kerf_proto::v1::view_service_client::ViewServiceClient;
use kerf_proto::v1::{self, control_request, control_response};
use kerf_replica::{Assembler, Replica};
use kerf_session::clock::MonotonicClock;
use kerf_station::config::{DeviceConfig, DeviceKind, HandConfig, MappingConfig, SimulatedConfig, StationConfig};
use kerf_station::link::LinkStatus;
use kerf_station::servo::core::State;
use kerf_station::servo::runner::Sample;
use kerf_station::virtual_time::drive as drive_virtually;
use tokio::sync::mpsc;
use tokio::time::{Instant, sleep, timeout};
use tokio_stream::wrappers::ReceiverStream;
use tonic::Streaming;
use tonic::transport::Channel;

use super::network::Network;

/// A client that hears nothing for so long takes its connection for broken.
const SILENCE: Duration = Duration::from_millis(500);
/// And waits so long before it tries again.
const PAUSE: Duration = Duration::from_millis(50);
/// Poses come so often: 250 Hz.
const POSES: Duration = Duration::from_millis(4);
/// Speed of the hand, m/s.
const SPEED_M_PER_S: f64 = 0.1;
/// Heights that the hand goes to, m: the block reaches from -0.01 to 0.01, its lower quarter is held.
const HEIGHTS_M: [f64; 2] = [-0.002, 0.02];
/// Ten times what a steady cut of the block takes, Gc w. Ours: a hand that catches up presses harder than one that cuts.
const HARDEST_N: f64 = 1.0;
/// What the simulated Omni can push with, N.
const PEAK_N: f64 = 3.3;
/// So high over the place where the block begins a hand is in the air, m, and after so many ticks all is faded out.
const IN_THE_AIR: (f64, u32) = (0.006, 100);

/// Less than a hand feels, N.
const UNFELT_N: f64 = 0.01;

/// Clients, by their traces.
const DRIVER: usize = 0;
const STATION: usize = 1;
const VIEWER: usize = 2;

/// What clients have seen; clones are the same.
#[derive(Clone, Default)]
pub struct Seen(Arc<Mutex<Sights>>);

#[derive(Default)]
pub struct Sights {
    /// Streams of the driver that stood.
    pub streams: u64,
    /// Contacts that came, when the last one came, and how strong the strongest was.
    pub contacts: u64,
    pub felt_at: Option<Instant>,
    pub hardest_n: f64,
    /// Contacts with a force.
    pub forces: u64,
    /// The viewer's picture, when it last changed, and pictures that were begun anew.
    pub replica: Replica,
    pub drawn_at: Option<Instant>,
    pub views: u64,
    /// When the station's servo last rendered a contact's model, or the absence of one, and the link's streams.
    pub rendered_at: Option<Instant>,
    pub dialled: u64,
    /// How the station is doing, for people.
    pub station: Option<(State, LinkStatus)>,
    /// Ticks of the station in which the hand felt something.
    pub felt: u64,
    /// Everything that came to the driver, the station and the viewer, folded: another run of the seed has the same.
    pub traces: [u64; 3],
    /// What must not be.
    pub wrong: Vec<String>,
}

impl Sights {
    fn trace(&mut self, client: usize, words: impl IntoIterator<Item = u64>) {
        let trace = &mut self.traces[client];
        for word in words {
            *trace = (*trace ^ word).wrapping_mul(0x0000_0100_0000_01B3).rotate_left(17);
        }
    }

    fn demand(&mut self, holds: bool, what: impl FnOnce() -> String) {
        if !holds {
            self.wrong.push(what());
        }
    }
}

impl Seen {
    pub fn lock(&self) -> MutexGuard<'_, Sights> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A hand that goes up and down over the block, by seed.
struct Hand {
    random: Rng,
    height_m: f64,
    target_m: f64,
    off_m: f64,
}

impl Hand {
    fn new(random: Rng) -> Self {
        Self { random, height_m: 0.02, target_m: 0.02, off_m: 4e-4 }
    }

    /// What it does next; `None`: it lifts the tool.
    fn next(&mut self) -> Option<v1::Pose> {
        let most_m = SPEED_M_PER_S * POSES.as_secs_f64();
        self.height_m += (self.target_m - self.height_m).clamp(-most_m, most_m);
        if (self.target_m - self.height_m).abs() < 1e-9 {
            let [low, high] = HEIGHTS_M;
            self.target_m = low + (high - low) * self.random.f64();
            if self.height_m > 0.012 {
                self.off_m = 0.006 * (self.random.f64() - 0.5);
            }
        }
        match self.random.u32(0..400) {
            0 => return None,
            // A glitch of its tracking, or another's hand.
            1 => self.height_m += 0.04 * (self.random.f64() - 0.5),
            _ => {}
        }
        let position_m = Some(v1::Vec3 { x: 0.0, y: self.height_m as f32, z: self.off_m as f32 });
        Some(v1::Pose { position_m, orientation: Some(v1::Quat { w: 1.0, ..Default::default() }) })
    }
}

/// Drives the first tool as long as it lives.
pub async fn drive(network: Network, session_id: String, random: Rng, seen: Seen) {
    let mut hand = Hand::new(random);
    loop {
        if let Ok(Ok(channel)) = timeout(SILENCE, network.channel()).await {
            let _ = drive_over(channel, &session_id, &mut hand, &seen).await;
        }
        sleep(PAUSE).await;
    }
}

async fn drive_over(channel: Channel, session_id: &str, hand: &mut Hand, seen: &Seen) -> Option<()> {
    let (up, queue) = mpsc::channel(64);
    let hello = v1::ClientHello {
        protocol_version: PROTOCOL_VERSION,
        session_id: session_id.into(),
        tool_ids: vec![0],
        client_key: "the driver".into(),
        ..Default::default()
    };
    up.try_send(v1::ControlRequest { message: Some(control_request::Message::Hello(hello)), received: 0 }).ok()?;
    let mut client = ControlServiceClient::new(channel);
    let opening = timeout(SILENCE, client.control(ReceiverStream::new(queue))).await.ok()?;
    let mut down = opening.ok()?.into_inner();
    seen.lock().streams += 1;
    let mut stream = Driven::default();
    let mut poses = tokio::time::interval(POSES);
    let mut heard = Instant::now();
    loop {
        tokio::select! {
            biased;
            message = down.message() => {
                heard = Instant::now();
                stream.take(message.ok()??.message?, seen);
            }
            _ = poses.tick() => {
                if heard.elapsed() > SILENCE && !stream.is_paused {
                    return None;
                }
                let message = match hand.next() {
                    Some(pose) => {
                        stream.sent += 1;
                        let (seq, client_ns) = (stream.sent, MonotonicClock::now_ns());
                        control_request::Message::Pose(v1::ToolPose { seq, client_ns, pose: Some(pose), ..Default::default() })
                    }
                    None => control_request::Message::Lift(v1::LiftTool { tool_id: 0 }),
                };
                // Full: the network does not keep up.
                let _ = up.try_send(v1::ControlRequest { message: Some(message), received: stream.number });
            }
        }
    }
}

/// One control stream: what came over it.
#[derive(Default)]
struct Driven {
    sent: u64,
    number: u64,
    server_ns: u64,
    echo_seq: u64,
    is_paused: bool,
}

impl Driven {
    fn take(&mut self, message: control_response::Message, seen: &Seen) {
        let mut seen = seen.lock();
        match message {
            control_response::Message::Contact(contact) => self.feel(&contact, &mut seen),
            control_response::Message::Event(event) => {
                self.is_paused = match event.kind() {
                    v1::EventKind::Paused => true,
                    v1::EventKind::Resumed => false,
                    _ => self.is_paused,
                };
                seen.trace(DRIVER, [1, event.step, event.kind as u64]);
            }
            control_response::Message::Fault(fault) => seen.wrong.push(format!("rolled back: {fault:?}")),
            _ => seen.trace(DRIVER, [2]),
        }
    }

    fn feel(&mut self, contact: &v1::Contact, seen: &mut Sights) {
        let force_n = contact.wrench.and_then(|wrench| wrench.force_n).unwrap_or_default();
        let norm_n = f64::from(force_n.x.hypot(force_n.y).hypot(force_n.z));
        (seen.contacts, seen.felt_at) = (seen.contacts + 1, Some(Instant::now()));
        seen.hardest_n = seen.hardest_n.max(norm_n);
        seen.forces += u64::from(norm_n > 0.0);
        seen.trace(
            DRIVER,
            [3, contact.number, contact.step, contact.echo_seq, norm_n.to_bits(), MonotonicClock::now_ns()],
        );
        let waits = contact.flags & v1::ContactFlag::WaitsUntilClear as u32 != 0;
        seen.demand(contact.number > self.number, || format!("contact {} after {}", contact.number, self.number));
        seen.demand(contact.server_ns > self.server_ns, || "a contact of an earlier step".into());
        seen.demand((self.echo_seq..=self.sent).contains(&contact.echo_seq) || contact.echo_seq == 0, || {
            format!("pose {} is echoed after {}, of {} sent", contact.echo_seq, self.echo_seq, self.sent)
        });
        seen.demand(norm_n <= HARDEST_N, || format!("{norm_n} N at step {}", contact.step));
        seen.demand(!waits || norm_n == 0.0, || format!("{norm_n} N on a hand that waits until it is clear"));
        (self.number, self.server_ns) = (contact.number, contact.server_ns);
        self.echo_seq = self.echo_seq.max(contact.echo_seq);
    }
}

/// Drives the second tool with a haptic station as long as it lives: its hand touches the block again and again.
pub async fn touch(session_id: String, seen: Seen) {
    let mut config = StationConfig::default();
    config.link.silence_s = SILENCE.as_secs_f64();
    let path = vec![[0.0, 0.0, 0.008, 0.0], [0.4, 0.0, -4e-4, 0.0], [0.8, 0.0, 0.008, 0.0]];
    let simulated =
        SimulatedConfig { hand: HandConfig { path, ..HandConfig::default() }, ..SimulatedConfig::default() };
    let device = DeviceConfig {
        kind: DeviceKind::Simulated(simulated.clone()),
        mapping: MappingConfig { scene_origin_m: [0.0, 0.01, 0.005], turns_tool: false, ..MappingConfig::default() },
        ..DeviceConfig::default()
    };
    let mut in_the_air = 0;
    let tell = |sample: &Sample, link: &LinkStatus| {
        let mut seen = seen.lock();
        let force_n = sample.force_n.norm();
        let (air_m, ticks) = IN_THE_AIR;
        // A piece that was cut off may float there.
        let is_free = sample.device.position_m.y > air_m && sample.rendered.contact_n.norm() == 0.0;
        in_the_air = if is_free { in_the_air + 1 } else { 0 };
        if matches!(sample.rendered.state, State::Rendering | State::Ramping) {
            seen.rendered_at = Some(Instant::now());
        }
        seen.dialled = link.connections;
        seen.station = Some((sample.rendered.state, link.clone()));
        seen.felt += u64::from(force_n > 0.0);
        seen.demand(force_n <= PEAK_N, || format!("the station pushes with {force_n} N"));
        seen.demand(in_the_air < ticks || force_n < UNFELT_N, || {
            format!("{force_n} N in the air: {:?}", sample.rendered)
        });
        seen.trace(STATION, [force_n.to_bits()]);
    };
    drive_virtually(config, (device, simulated), (&session_id, 1), tell).await;
}

/// Watches as long as it lives.
pub async fn watch(network: Network, session_id: String, seen: Seen) {
    loop {
        if let Ok(Ok(channel)) = timeout(SILENCE, network.channel()).await {
            let _ = watch_over(channel, &session_id, &seen).await;
        }
        sleep(PAUSE).await;
    }
}

async fn watch_over(channel: Channel, session_id: &str, seen: &Seen) -> Option<()> {
    let mut view = View::open(channel, session_id).await?;
    {
        let mut seen = seen.lock();
        (seen.replica, seen.views) = (Replica::default(), seen.views + 1);
    }
    loop {
        let (number, message) = view.next().await?;
        let mut seen = seen.lock();
        let before = seen.replica.topology_version();
        if let Err(error) = seen.replica.apply(&message) {
            seen.wrong.push(format!("the viewer cannot follow: {error}, at topology {before:?}"));
        }
        let step = seen.replica.moment().map_or(0, |moment| moment.step);
        let version = seen.replica.topology_version().unwrap_or_default();
        seen.drawn_at = Some(Instant::now());
        seen.trace(VIEWER, [number, step, version]);
    }
}

/// A view stream that acknowledges what it reads.
pub struct View {
    stream: Streaming<v1::ViewResponse>,
    viewer: String,
    assembler: Assembler,
    client: ViewServiceClient<Channel>,
}

impl View {
    /// Opens one; `None` where that fails.
    pub async fn open(channel: Channel, session_id: &str) -> Option<Self> {
        let request =
            v1::ViewRequest { protocol_version: PROTOCOL_VERSION, session_id: session_id.into(), ..Default::default() };
        let mut client = ViewServiceClient::new(channel);
        let mut stream = timeout(SILENCE, client.view(request)).await.ok()?.ok()?.into_inner();
        match timeout(SILENCE, stream.message()).await.ok()?.ok()??.message? {
            Message::Hello(v1::ViewHello { viewer, .. }) => {
                Some(Self { stream, viewer, assembler: Assembler::default(), client })
            }
            _ => None,
        }
    }

    /// What comes next, with its number; `None` where the stream has ended. A session that stands says nothing.
    pub async fn next(&mut self) -> Option<(u64, Message)> {
        loop {
            let came = self.stream.message().await.ok()??;
            let Some(v1::ViewResponse { message, number }) = self.assembler.take(came).expect("fragments that fit")
            else {
                continue;
            };
            if number > 0 {
                let (mut client, viewer) = (self.client.clone(), self.viewer.clone());
                tokio::spawn(async move { drop(client.acknowledge(v1::AcknowledgeRequest { viewer, number }).await) });
            }
            return Some((number, message?));
        }
    }
}
