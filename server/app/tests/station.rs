//! A station whose server is killed in mid-contact, and comes back with the journal.

use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use kerf_station::config::{DeviceConfig, DeviceKind, HandConfig, MappingConfig, SimulatedConfig, StationConfig};
use kerf_station::device::simulated::Simulated;
use kerf_station::link::SharedSession;
use kerf_station::servo::core::State;
use kerf_station::station::Station;

use super::process::{Process, soon};

/// What a surgeon waits before asking whether something is broken.
pub const BACK_WITHIN: Duration = Duration::from_secs(2);

/// A station whose hand touches the top of the block again and again.
pub fn touch(session_id: &str, url: String) -> Station {
    let mut config = StationConfig::default();
    (config.server.url, config.link.silence_s) = (url, 0.3);
    // Less than what makes the block part; up again, for a tool that is put down within tissue touches none.
    let path = vec![[0.0, 0.0, 0.002, 0.0], [0.3, 0.0, -4e-4, 0.0], [0.6, 0.0, 0.002, 0.0]];
    let simulated =
        SimulatedConfig { hand: HandConfig { path, ..HandConfig::default() }, ..SimulatedConfig::default() };
    let mut device = DeviceConfig {
        kind: DeviceKind::Simulated(simulated.clone()),
        mapping: MappingConfig { scene_origin_m: [0.0, 0.01, 4e-4], turns_tool: false, ..MappingConfig::default() },
        ..DeviceConfig::default()
    };
    device.servo.ramp_s = 0.1;
    let open = Box::new(move || Ok(Box::new(Simulated::new(&simulated)) as _));
    Station::start(&config, &device, open, [0].into(), SharedSession::join(session_id)).expect("it starts")
}

/// Waits until the hand feels the block.
pub async fn feels(station: &mut Station) {
    while station.samples.pop().is_ok() {}
    soon("contact", async {
        loop {
            while let Ok(sample) = station.samples.pop() {
                if sample.force_n.norm() > 0.005 && sample.rendered.state == State::Rendering {
                    return;
                }
            }
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    })
    .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_station_feels_its_session_again_two_seconds_after_a_killed_server_is_started_anew() {
    let folder = tempfile::tempdir().unwrap();
    let set = format!("journal_dir={}", folder.path().display());
    let arguments = ["--set", &set, "--log-filter", "warn"];
    let mut process = Process::serve(&arguments, Stdio::inherit()).await;
    let session_id = process.create().await.session.unwrap().session_id;
    let mut station = touch(&session_id, format!("http://{}", process.address));
    feels(&mut station).await;
    // What is felt is in the journal by then.
    tokio::time::sleep(Duration::from_millis(500)).await;
    let step = process.until(&session_id, |_| true).await.step;
    process.server.kill().unwrap();
    process.server.wait().unwrap();

    let began = Instant::now();
    let command = Command::new(env!("CARGO_BIN_EXE_kerf-server"));
    let mut process = Process::start_at(process.address, command, &arguments, Stdio::inherit()).await;
    feels(&mut station).await;
    let elapsed = began.elapsed();
    println!("felt again {:.2} s after the server was started anew", elapsed.as_secs_f64());
    assert!(elapsed < BACK_WITHIN, "{elapsed:?}; {:?}", station.link());
    let link = station.link();
    assert_eq!((link.session_id.as_str(), link.connections), (session_id.as_str(), 2));
    let described = process.until(&session_id, |described| described.step > step).await;
    assert_eq!(described.leased_tool_ids, [0]);
    tokio::task::spawn_blocking(|| drop(station)).await.unwrap();
}
