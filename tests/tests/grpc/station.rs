//! Whole stations, a simulated device and its servo included, through a network that fails: what they do to each other, and
//! that nobody else's simulation knows of it.

use std::sync::Arc;
use std::time::{Duration, Instant};

use kerf_proto::v1;
use kerf_station::config::{
    DeviceConfig, DeviceKind, HandConfig, MappingConfig, ServerConfig as StationServer, SimulatedConfig, StationConfig,
};
use kerf_station::device::simulated::Simulated;
use kerf_station::experiment::network::{Network, Quality};
use kerf_station::link::{LinkState, LinkStatus, SharedSession};
use kerf_station::servo::core::State;
use kerf_station::servo::runner::Sample;
use kerf_station::station::Station;

use super::bystander::Bystander;
use super::harness::{BLOCK, Harness, PATIENCE};

/// The station's slew limit, N/s, and the longest step that it counts, s.
const SLEW_N_PER_S: f64 = 500.0;
const SLEW_STEP_S: f64 = 2e-3;

/// A station whose hand touches the top of the block again and again.
fn touch(session_id: &str, url: String) -> Station {
    drive(&SharedSession::join(session_id), 0, url)
}

/// The same hand at a tool of a session.
fn drive(session: &Arc<SharedSession>, tool_id: u32, url: String) -> Station {
    drive_at(session, tool_id, StationServer { url, ..StationServer::default() })
}

/// The same, let in as it is told.
pub fn drive_at(session: &Arc<SharedSession>, tool_id: u32, server: StationServer) -> Station {
    let mut config = StationConfig::default();
    (config.server, config.link.silence_s) = (server, 0.3);
    // Less than what makes it part; up again, for a tool that is put down within tissue touches none.
    let path = vec![[0.0, 0.0, 0.002, 0.0], [0.3, 0.0, -4e-4, 0.0], [0.6, 0.0, 0.002, 0.0]];
    let hand = HandConfig { path, ..HandConfig::default() };
    let simulated = SimulatedConfig { hand, ..SimulatedConfig::default() };
    let mut device = DeviceConfig {
        kind: DeviceKind::Simulated(simulated.clone()),
        mapping: MappingConfig { scene_origin_m: [0.0, 0.01, 4e-4], turns_tool: false, ..MappingConfig::default() },
        ..DeviceConfig::default()
    };
    device.servo.ramp_s = 0.1;
    let open = Box::new(move || Ok(Box::new(Simulated::new(&simulated)) as _));
    Station::start(&config, &device, open, [tool_id].into(), Arc::clone(session)).expect("it starts")
}

/// Reads samples until one is as wanted; the force changes no faster than it may on the way.
pub async fn until(station: &mut Station, what: &str, holds: impl Fn(&Sample) -> bool) {
    let end = Instant::now() + PATIENCE;
    let mut before: Option<Sample> = None;
    while Instant::now() < end {
        while let Ok(sample) = station.samples.pop() {
            if let Some(before) = before.filter(|before| before.at_ns + 1_000_000_000 > sample.at_ns) {
                let jump_n = (sample.force_n - before.force_n).norm();
                assert!(jump_n <= SLEW_N_PER_S * sample.dt_s.min(SLEW_STEP_S) + 1e-9, "{what}: {jump_n} N");
            }
            if holds(&sample) {
                return;
            }
            before = Some(sample);
        }
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    panic!("{what}: not within {PATIENCE:?}; {:?}, {before:?}", station.link());
}

/// What the link says once it says what is wanted.
pub async fn link_where(station: &Station, what: &str, holds: impl Fn(&LinkStatus) -> bool) -> LinkStatus {
    let end = Instant::now() + PATIENCE;
    while !holds(&station.link()) {
        assert!(Instant::now() < end, "{what}: {:?}", station.link());
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    station.link()
}

pub fn feels(sample: &Sample) -> bool {
    sample.force_n.norm() > 0.005 && sample.rendered.state == State::Rendering
}

fn feels_nothing(sample: &Sample) -> bool {
    sample.force_n.norm() == 0.0 && sample.rendered.state != State::Rendering
}

pub fn says(status: &LinkStatus, word: &str) -> bool {
    status.last_fault.as_ref().is_some_and(|fault| fault.contains(word))
}

#[tokio::test(flavor = "multi_thread")]
async fn a_driven_tool_is_nobody_elses_until_its_lease_has_run_out_behind_a_dead_network() {
    let mut harness = Harness::with(|config| config.session.lease_s = 1.0).await;
    // Nothing parts in it: in a cut that the first one has made the second would feel nothing.
    let whole = BLOCK.replace(", fracture_energy_j_per_m2 = 5.0", "");
    assert_ne!(whole, BLOCK);
    let session = harness.create_of(whole).await.unwrap();
    let bystander = Bystander::start(&mut harness).await;
    let network = Network::to(harness.server.address(), Quality::default()).unwrap();
    let mut first = touch(&session, format!("http://{}", network.address()));
    until(&mut first, "contact", feels).await;
    let mut second = touch(&session, format!("http://{}", harness.server.address()));
    link_where(&second, "the refusal", |link| says(link, "driven by another client")).await;
    assert_eq!(first.link().connections, 1);

    network.set_down(true);
    until(&mut first, "the dead network", feels_nothing).await;
    until(&mut second, "the second one's contact", feels).await;
    drop(second);
    harness.until(&session, |described| described.leased_tool_ids.is_empty()).await;

    network.set_down(false);
    let back = Instant::now();
    while first.samples.pop().is_ok() {}
    until(&mut first, "contact again", feels).await;
    assert!(back.elapsed() < Duration::from_secs(3), "{:?}, ramp included", back.elapsed());
    bystander.check(&mut harness).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_session_that_is_closed_mid_contact_takes_the_force_out_and_says_what_to_do() {
    let mut harness = Harness::start().await;
    let session = harness.create().await.unwrap();
    let bystander = Bystander::start(&mut harness).await;
    let mut station = touch(&session, format!("http://{}", harness.server.address()));
    until(&mut station, "contact", feels).await;
    let request = v1::CloseSessionRequest { session_id: session };
    harness.sessions.close_session(request).await.unwrap();
    until(&mut station, "the end", feels_nothing).await;
    let link = link_where(&station, "the end", |link| link.state == LinkState::Failed).await;
    assert!(says(&link, "start the station with another session"), "{link:?}");
    bystander.check(&mut harness).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn several_devices_drive_the_tools_of_one_session_and_go_to_the_next_one_together() {
    let mut harness = Harness::start().await;
    let url = format!("http://{}", harness.server.address());
    let session = SharedSession::create("hepatectomy");
    let stations = [0, 1].map(|tool_id| drive(&session, tool_id, url.clone()));
    drop(session);
    let mut first = String::new();
    for station in &stations {
        let joined = link_where(station, "the session", |link| link.state == LinkState::Connected).await.session_id;
        assert!(first.is_empty() || joined == first, "{joined} is not {first}");
        first = joined;
    }
    harness.until(&first, |described| described.leased_tool_ids == [0, 1]).await;
    let request = v1::CloseSessionRequest { session_id: first.clone() };
    harness.sessions.close_session(request).await.unwrap();
    let mut next = Vec::new();
    for station in &stations {
        next.push(link_where(station, "the next one", |link| link.connections > 1).await.session_id);
    }
    assert!(next[0] == next[1] && next[0] != first, "{first}, then {next:?}");
    let [one, other] = stations;
    tokio::task::spawn_blocking(|| drop(one)).await.unwrap();
    let list = async |harness: &mut Harness| {
        let listed = harness.sessions.list_sessions(v1::ListSessionsRequest {}).await.unwrap();
        listed.into_inner().sessions.len()
    };
    assert_eq!(list(&mut harness).await, 1, "it is still driven");
    tokio::task::spawn_blocking(|| drop(other)).await.unwrap();
    assert_eq!(list(&mut harness).await, 0);
}
