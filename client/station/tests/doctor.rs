//! What the doctor says.

use std::time::Duration;

use kerf_stand_in_hd::{Device as Simulated, code};
use kerf_station::config::{DeviceConfig, DeviceKind, ServerConfig, StationConfig};
use kerf_station::doctor::{Diagnosis, Finding, Outcome};

use crate::openhaptics::library::StandIn;

/// Long enough for the first 50 ms to be over.
const RUN_FOR: Duration = Duration::from_millis(150);

fn diagnose(kind: DeviceKind) -> Diagnosis {
    let config = StationConfig {
        server: ServerConfig { url: "http://127.0.0.1:1".into(), ..ServerConfig::default() },
        devices: vec![DeviceConfig { kind, ..DeviceConfig::default() }],
        ..StationConfig::default()
    };
    Diagnosis::make(&config, RUN_FOR)
}

fn find<'a>(diagnosis: &'a Diagnosis, words: &str) -> &'a Finding {
    let found = diagnosis.findings.iter().find(|finding| finding.text.contains(words));
    found.unwrap_or_else(|| panic!("`{words}`: {diagnosis}"))
}

#[test]
fn a_device_that_is_well_is_described_and_run_without_force() {
    let library = StandIn::new(&[Simulated::new("Default Device")]);
    let diagnosis = diagnose(DeviceKind::OpenHaptics(library.config(None)));
    let expected = [
        "version 3.4.0 stand-in, driver 4.0.0",
        "PHANTOM Omni 10402100017: at most 3.3 N, 500 N/m, 5 N s/m; reaches 160 x 120 x 70 mm",
        "times a second, aimed at 1000",
        "tip at 0.0, -65.5, -88.1 mm",
    ];
    expected.iter().for_each(|words| {
        find(&diagnosis, words);
    });
    assert_eq!(find(&diagnosis, expected[3]).outcome, Outcome::Good);
    assert_eq!(library.world().devices[0].greatest_force_n, 0.0);
    // The server is missing, and nothing else.
    assert!(!diagnosis.is_well());
    let bad: Vec<_> = diagnosis.findings.iter().filter(|finding| finding.outcome == Outcome::Bad).collect();
    assert_eq!(bad.len(), 1, "{diagnosis}");
    assert_eq!(bad[0].subject, "server http://127.0.0.1:1");
    assert!(bad[0].remedy.as_ref().unwrap().contains("kerf-server serve"));
}

#[test]
fn a_device_that_is_not_calibrated_is_bad_with_what_to_do() {
    let mut simulated = Simulated::new("Default Device");
    simulated.calibration = code::CALIBRATION_NEEDS_MANUAL_INPUT;
    let library = StandIn::new(&[simulated]);
    let diagnosis = diagnose(DeviceKind::OpenHaptics(library.config(None)));
    let finding = find(&diagnosis, "not calibrated");
    assert_eq!(finding.outcome, Outcome::Bad);
    assert!(finding.remedy.as_ref().unwrap().contains("inkwell"), "{finding:?}");
}

#[cfg(target_os = "linux")]
#[test]
fn a_missing_library_is_bad_where_it_is_configured_and_a_note_where_not() {
    let configured = diagnose(DeviceKind::OpenHaptics(kerf_station::config::OpenHapticsConfig::default()));
    assert_eq!(find(&configured, "libHD.so.3.4: ").outcome, Outcome::Bad);
    let other = diagnose(DeviceKind::default());
    assert_eq!(find(&other, "libHD.so.3.4: ").outcome, Outcome::Note);
    assert_eq!(find(&other, "simulated Omni").outcome, Outcome::Good);
    let json = serde_json::to_value(&other).unwrap();
    assert_eq!(json["findings"][0]["subject"], "real-time priority");
}
