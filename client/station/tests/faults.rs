//! Faults over real gRPC: in each the force goes to zero smoothly, nothing panics, and the station comes back or says
//! what to do.

use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use kerf_load::clock;
use kerf_station::config::{DeviceConfig, DeviceKind, HandConfig, SimulatedConfig, StationConfig};
use kerf_station::device::simulated::Simulated;
use kerf_station::device::{Device, DeviceError, DeviceInfo, DeviceState, Servo};
use kerf_station::link::{LinkState, LinkStatus, SharedSession};
use kerf_station::servo::core::State;
use kerf_station::servo::fault::Fault;
use kerf_station::servo::runner::Sample;
use kerf_station::station::{Opener, Station};
use nalgebra::Vector3;
use tonic::transport::Identity;

use super::server::{Does, Server};

/// Longer than anything here takes on a busy machine.
const PATIENCE: Duration = Duration::from_secs(60);
/// The servo's slew limit, N/s, and the longest step that it counts, s.
const SLEW_N_PER_S: f64 = 500.0;
const SLEW_STEP_S: f64 = 2e-3;

/// A hand that leans 5 mm into the floor.
fn device_config() -> DeviceConfig {
    let hand = HandConfig { path: vec![[0.0, 0.0, -5e-3, 0.0]], ..HandConfig::default() };
    let mut config = DeviceConfig {
        kind: DeviceKind::Simulated(SimulatedConfig { hand, ..SimulatedConfig::default() }),
        ..DeviceConfig::default()
    };
    config.servo.ramp_s = 0.1;
    config
}

fn simulated() -> Simulated {
    match device_config().kind {
        DeviceKind::Simulated(config) => Simulated::new(&config),
        _ => unreachable!("it is simulated"),
    }
}

fn config(server: &Server) -> StationConfig {
    let mut config = StationConfig::default();
    config.server.url = format!("http://{}", server.address);
    config.link.silence_s = 0.3;
    config
}

fn start(config: &StationConfig, open: Opener) -> Station {
    let session = SharedSession::join("one");
    Station::start(config, &device_config(), open, [0].into(), session).expect("it starts")
}

fn station(server: &Server) -> Station {
    start(&config(server), Box::new(|| Ok(Box::new(simulated()))))
}

/// The link once it has failed for good, or when patience ends.
fn failed(station: &Station) -> LinkStatus {
    let end = Instant::now() + PATIENCE;
    while station.link().state != LinkState::Failed && Instant::now() < end {
        std::thread::sleep(Duration::from_millis(10));
    }
    station.link()
}

/// Reads samples until one is as wanted; every change of the force on the way was within the slew limit.
fn until(station: &mut Station, what: &str, holds: impl Fn(&Sample) -> bool) -> Sample {
    let end = Instant::now() + PATIENCE;
    let mut before: Option<Sample> = None;
    while Instant::now() < end {
        while let Ok(sample) = station.samples.pop() {
            assert!(sample.force_n.iter().all(|n| n.is_finite()));
            if let Some(before) = before.filter(|before| before.at_ns + 1_000_000_000 > sample.at_ns) {
                let jump_n = (sample.force_n - before.force_n).norm();
                let most_n = SLEW_N_PER_S * sample.dt_s.min(SLEW_STEP_S) + 1e-9;
                assert!(jump_n <= most_n, "{what}: {jump_n} N within {} s", sample.dt_s);
            }
            if holds(&sample) {
                return sample;
            }
            before = Some(sample);
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    panic!("{what}: not within {PATIENCE:?}; {:?}, {:?}, {:?}", station.link(), station.thread(), before);
}

fn feels(sample: &Sample) -> bool {
    sample.force_n.y > 0.4 && sample.rendered.state == State::Rendering
}

fn feels_nothing(sample: &Sample) -> bool {
    sample.force_n.norm() == 0.0 && sample.rendered.state != State::Rendering
}

/// A network that comes back after so long.
fn stall(stalled_for: Duration) {
    let server = Server::start();
    let mut station = station(&server);
    until(&mut station, "contact", feels);
    server.set(Does::Stalls);
    until(&mut station, "the stall", feels_nothing);
    std::thread::sleep(stalled_for);
    assert_eq!(station.link().state, LinkState::Connecting);
    while station.samples.pop().is_ok() {}
    server.set(Does::Well);
    let back = Instant::now();
    while station.link().state != LinkState::Connected {
        assert!(back.elapsed() < Duration::from_secs(2), "{:?}", station.link());
        std::thread::sleep(Duration::from_millis(5));
    }
    until(&mut station, "little force at first", |sample| sample.rendered.state == State::Ramping);
    until(&mut station, "the return", feels);
    assert_eq!(station.link().connections, 2);
}

#[test]
fn a_network_that_stalls_for_a_second_is_found_again_within_two_of_its_return() {
    stall(Duration::from_secs(1));
}

#[test]
#[ignore = "slow: it waits for half a minute"]
fn a_network_that_stalls_for_half_a_minute_is_found_again_within_two_seconds_of_its_return() {
    stall(Duration::from_secs(30));
}

#[test]
fn a_server_that_is_killed_mid_contact_and_started_again_is_found_again() {
    let server = Server::start();
    let address = server.address;
    let mut station = station(&server);
    until(&mut station, "contact", feels);
    drop(server);
    until(&mut station, "the kill", feels_nothing);
    let again = Server::at(address, None, None);
    until(&mut station, "the second server", feels);
    assert!(again.streams() >= 1);
}

#[test]
fn a_contact_that_is_no_number_lets_go_with_a_word_and_good_ones_bring_the_force_back() {
    let server = Server::start();
    let mut station = station(&server);
    until(&mut station, "contact", feels);
    server.set(Does::NotANumber);
    let tripped = until(&mut station, "the trip", feels_nothing);
    assert!(matches!(tripped.rendered.state, State::Tripped(fault) if fault.words().contains("no number")));
    server.set(Does::Well);
    until(&mut station, "good contacts", feels);
}

#[test]
fn a_session_that_is_gone_ends_in_words_that_say_what_to_do() {
    let server = Server::start();
    let mut station = station(&server);
    until(&mut station, "contact", feels);
    server.set(Does::SessionGone);
    until(&mut station, "the end", feels_nothing);
    let link = failed(&station);
    assert_eq!(link.state, LinkState::Failed);
    assert!(link.last_fault.as_ref().unwrap().contains("start the station with another session"), "{link:?}");
}

#[test]
fn a_token_is_sent_and_a_wrong_one_is_told_of() {
    let server = Server::at("127.0.0.1:0".parse().unwrap(), Some("Bearer secret"), None);
    let folder = tempfile::tempdir().unwrap();
    let mut with_token = config(&server);
    let token_file = folder.path().join("token");
    std::fs::write(&token_file, "secret\n").unwrap();
    with_token.server.token_file = Some(token_file);
    let mut knows = start(&with_token, Box::new(|| Ok(Box::new(simulated()))));
    until(&mut knows, "contact", feels);
    let guesses = station(&server);
    assert!(failed(&guesses).last_fault.unwrap().contains("server.token_file"));
}

#[test]
fn over_tls_a_server_is_believed_by_its_certificate_alone() {
    let certified = rcgen::generate_simple_self_signed(["localhost".to_owned()]).unwrap();
    let identity = Identity::from_pem(certified.cert.pem(), certified.signing_key.serialize_pem());
    let server = Server::at("127.0.0.1:0".parse().unwrap(), None, Some(identity));
    let folder = tempfile::tempdir().unwrap();
    let ca_file = folder.path().join("ca.pem");
    std::fs::write(&ca_file, certified.cert.pem()).unwrap();
    let mut config = config(&server);
    config.server.url = format!("https://localhost:{}", server.address.port());
    let mut stranger = start(&config, Box::new(|| Ok(Box::new(simulated()))));
    config.server.ca_file = Some(ca_file);
    let mut knows = start(&config, Box::new(|| Ok(Box::new(simulated()))));
    until(&mut knows, "contact", feels);
    assert!(until(&mut stranger, "no contact", |_| true).force_n.norm() == 0.0);
    let end = Instant::now() + PATIENCE;
    while stranger.link().last_fault.is_none() && Instant::now() < end {
        std::thread::sleep(Duration::from_millis(10));
    }
    let link = stranger.link();
    assert!(link.state == LinkState::Connecting && link.last_fault.as_ref().unwrap().contains("no server"), "{link:?}");
}

/// What is done to a servo's clock, once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
enum Meddling {
    None,
    /// Nobody calls it for 0.3 s.
    Starves,
    /// The clock is an hour ahead for a call.
    Jumps,
}

/// A device whose servo is called at other times.
struct Meddled {
    device: Simulated,
    meddling: Arc<AtomicU8>,
}

struct MeddledServo<'a>(&'a mut dyn Servo, &'a AtomicU8);

impl Servo for MeddledServo<'_> {
    fn tick(&mut self, now_ns: u64, state: &DeviceState) -> Vector3<f64> {
        let meddling = self.1.swap(Meddling::None as u8, Ordering::Relaxed);
        if meddling == Meddling::Starves as u8 {
            std::thread::sleep(Duration::from_millis(300));
            return self.0.tick(clock::now_ns(), state);
        }
        let ahead_s = if meddling == Meddling::Jumps as u8 { 3600 } else { 0 };
        self.0.tick(now_ns + ahead_s * 1_000_000_000, state)
    }
}

impl Device for Meddled {
    fn info(&self) -> &DeviceInfo {
        self.device.info()
    }

    fn run(&mut self, servo: &mut dyn Servo, stop: &AtomicBool) -> Result<(), DeviceError> {
        self.device.run(&mut MeddledServo(servo, &self.meddling), stop)
    }
}

#[test]
fn a_servo_that_starves_and_a_clock_that_jumps_let_go_with_a_word_and_come_back() {
    let server = Server::start();
    for meddling in [Meddling::Starves, Meddling::Jumps] {
        let told = Arc::new(AtomicU8::new(Meddling::None as u8));
        let of_device = Arc::clone(&told);
        let open: Opener =
            Box::new(move || Ok(Box::new(Meddled { device: simulated(), meddling: Arc::clone(&of_device) })));
        let mut station = start(&config(&server), open);
        until(&mut station, "contact", feels);
        told.store(meddling as u8, Ordering::Relaxed);
        let tripped = until(&mut station, "the gap", |sample| matches!(sample.rendered.state, State::Tripped(_)));
        assert_eq!(tripped.rendered.faults.0.map(Fault::words), Some(Fault::Gap.words()), "{meddling:?}");
        until(&mut station, "no force", feels_nothing);
        until(&mut station, "contact again", feels);
        assert_eq!(station.link().connections, 1, "the link goes on meanwhile");
    }
}

/// A device whose plug can be pulled.
struct Pluggable {
    device: Simulated,
    is_out: Arc<AtomicBool>,
}

impl Device for Pluggable {
    fn info(&self) -> &DeviceInfo {
        self.device.info()
    }

    fn run(&mut self, servo: &mut dyn Servo, stop: &AtomicBool) -> Result<(), DeviceError> {
        struct Watched<'a>(&'a mut dyn Servo, &'a AtomicBool);
        impl Servo for Watched<'_> {
            fn tick(&mut self, now_ns: u64, state: &DeviceState) -> Vector3<f64> {
                if self.1.load(Ordering::Relaxed) { Vector3::zeros() } else { self.0.tick(now_ns, state) }
            }
        }
        // The plug stops the loop as `stop` does.
        let either = Arc::new(AtomicBool::new(false));
        std::thread::scope(|scope| {
            let is_out = Arc::clone(&self.is_out);
            let ends = Arc::clone(&either);
            scope.spawn(move || {
                while !stop.load(Ordering::Relaxed) && !is_out.load(Ordering::Relaxed) {
                    std::thread::sleep(Duration::from_millis(1));
                }
                ends.store(true, Ordering::Relaxed);
            });
            let is_out = Arc::clone(&self.is_out);
            self.device.run(&mut Watched(servo, &is_out), &either)
        })?;
        match self.is_out.load(Ordering::Relaxed) {
            true => Err(unplugged()),
            false => Ok(()),
        }
    }
}

fn unplugged() -> DeviceError {
    DeviceError { device: "Omni".into(), what: "it does not answer".into(), remedy: "plug it in".into() }
}

#[test]
fn a_device_that_is_unplugged_is_taken_up_again_without_force_at_first() {
    let server = Server::start();
    let is_out = Arc::new(AtomicBool::new(false));
    let plug = Arc::clone(&is_out);
    let open: Opener = Box::new(move || match plug.load(Ordering::Relaxed) {
        true => Err(unplugged()),
        false => Ok(Box::new(Pluggable { device: simulated(), is_out: Arc::clone(&plug) })),
    });
    let mut config = config(&server);
    config.link.deadband = 0.0;
    let mut station = start(&config, open);
    until(&mut station, "contact", feels);
    is_out.store(true, Ordering::Relaxed);
    std::thread::sleep(Duration::from_millis(700));
    let poses = station.link().poses;
    std::thread::sleep(Duration::from_millis(100));
    assert_eq!(station.link().poses, poses, "nobody tells the server for long that a tool is where nobody holds it");
    assert_eq!(station.thread().device_fault.as_deref(), Some("Omni: it does not answer; plug it in"));
    while station.samples.pop().is_ok() {}
    is_out.store(false, Ordering::Relaxed);
    until(&mut station, "the first tick with the device back", feels_nothing);
    until(&mut station, "contact again", feels);
}

/// A device that keeps the forces that it was told.
struct Keeping {
    device: Simulated,
    forces_n: Arc<Mutex<Vec<Vector3<f64>>>>,
}

struct KeepingServo<'a>(&'a mut dyn Servo, &'a Mutex<Vec<Vector3<f64>>>);

impl Servo for KeepingServo<'_> {
    fn tick(&mut self, now_ns: u64, state: &DeviceState) -> Vector3<f64> {
        let force_n = self.0.tick(now_ns, state);
        self.1.lock().unwrap().push(force_n);
        force_n
    }
}

impl Device for Keeping {
    fn info(&self) -> &DeviceInfo {
        self.device.info()
    }

    fn run(&mut self, servo: &mut dyn Servo, stop: &AtomicBool) -> Result<(), DeviceError> {
        self.device.run(&mut KeepingServo(servo, &self.forces_n), stop)
    }
}

#[test]
fn a_station_that_ends_mid_contact_takes_the_force_out_before_it_lets_go_of_the_device() {
    let server = Server::start();
    let forces_n = Arc::new(Mutex::new(Vec::new()));
    let kept = Arc::clone(&forces_n);
    let open: Opener = Box::new(move || Ok(Box::new(Keeping { device: simulated(), forces_n: Arc::clone(&kept) })));
    let mut station = start(&config(&server), open);
    until(&mut station, "contact", feels);
    drop(station);
    assert_eq!(forces_n.lock().unwrap().last(), Some(&Vector3::zeros()));
}
