//! What a report says, in words, in JSON and against limits.

use kerf_load::limits::LimitArgs;
use kerf_load::metrics::ContactMetrics;
use kerf_load::pacer::Punctuality;
use kerf_load::report::{Refusal, Report, Resting, Run, Sessions, Steps, bytes};
use kerf_load::script::Script;
use kerf_load::sender::SendTotals;
use kerf_load::timetable::Timetable;
use kerf_load::viewer::{ServerSteps, ViewTotals};
use kerf_proto::v1;
use kerf_script::{Key, Pose, Track};
use nalgebra::{UnitQuaternion, Vector3};

fn contacts() -> ContactMetrics {
    let mut contacts = ContactMetrics::default();
    (contacts.received, contacts.bytes, contacts.max_force_n) = (500, 40_000, 1.25);
    (1..=1000).for_each(|n| contacts.round_trip_ns.saturating_record(n * 10_000));
    let (script, timetable) = (still(), Timetable { start_ns: 0, rate_hz: 1000.0, duration_s: 1.0 });
    for step in 1..=1000 {
        let contact = v1::Contact {
            step,
            sim_time_s: step as f64 * 1e-3,
            server_ns: step * 1_250_000,
            lag_ns: step * 1000,
            echo_seq: step,
            ..Default::default()
        };
        contacts.timing.contact(&contact);
        contacts.force_age.contact(&contact, step * 1_000_000 + 2_500_000, &script, &timetable);
    }
    contacts
}

/// A tool that stays where it is.
fn still() -> Script {
    let pose = Pose { position_m: Vector3::zeros(), orientation: UnitQuaternion::identity() };
    let keys = vec![Key { time_s: 0.0, placement: Some(pose.into()) }];
    Script { tracks: vec![Track { tool_id: 0, keys }], datums: Vec::new() }
}

fn view() -> ViewTotals {
    let server = ServerSteps {
        first: (100, 1),
        last: (2100, 51),
        topology_version: 9,
        profiled_steps: 2000,
        profiled_s: 1.5,
        step_max_s: 0.004,
    };
    ViewTotals {
        keyframes: 2,
        patches: 9,
        states: 240,
        bytes: 3_000_000,
        server: Some(server),
        energy: Some(v1::EnergyLedger {
            tool_work_j: 0.02,
            fracture_j: 0.012,
            residual_j: -1e-7,
            ..Default::default()
        }),
        ..ViewTotals::default()
    }
}

fn report(contacts: &ContactMetrics, view: &ViewTotals) -> Report {
    Report::of(&Run {
        server_address: "http://127.0.0.1:1",
        scene: "liver",
        session_id: "s1",
        sessions: Sessions { asked: 1, driven: 1, ..Sessions::default() },
        step_rate_hz: 1000.0,
        script: "2 strokes (random seed 1)".to_owned(),
        duration_s: 2.0,
        watched_s: 2.0,
        interrupted: false,
        viewers: 2,
        reference_n: Some(0.8),
        sent: SendTotals { sent: 495, dropped: 1, kept: Punctuality { ticks: 496, late: 3, skipped: 4 } },
        contacts,
        view,
    })
}

#[test]
fn text_has_every_number_that_was_asked_for() {
    let text = report(&contacts(), &view()).to_string();
    let expected = "\
2 strokes (random seed 1) on liver, 2.0 s
round trip   p50 5.00 ms, p99 9.90 ms, p99.9 9.99 ms, max 10.00 ms (1000 poses, 0 unanswered)
force age    p50 4.00 ms, p99 4.00 ms, p99.9 4.00 ms, max 4.00 ms
poses        495 sent, 247.5 Hz; 3 late, 4 skipped, 1 dropped, 0 rejected
contacts     500 received, 250.0 Hz, 20.0 kB/s
view         2 viewer(s): 2 keyframes, 9 patches, 240 states at 60.0 Hz, 750.0 kB/s each; 0 mismatches
server       2000 steps at 1000 Hz, 50 late (2.5 %), mean 0.75 ms, max 4.00 ms; topology version 9, 0 faults
pace         0.800 of real time; steps ended p50 0.50 ms, p99 0.99 ms, p99.9 1.00 ms, max 1.00 ms after they were due
OVERLOAD     2.5 % of the steps were late: forces and depths are not those of the script's speed. Ask for a lower step \
rate, a coarser level or a smaller scene.
energy       tool work 2.000e-2 J, fracture 1.200e-2 J, residual -1.0e-7 J (-5.0e-6 of the tool work)
force        max 1.250 N, against the cut 0.000 N (steady cut: 0.800 N), 0.0 mm deep

1000 steps a second, 2.5 % of them late. The force in the hand was 4.0 ms old half of the time, and older than 4.0 ms \
a thousandth of it.";
    assert_eq!(text, expected);
}

#[test]
fn several_sessions_are_told_of_with_those_at_rest_and_the_servers_words_to_others() {
    let steps = Steps { steps: 1000, late_steps: 5, late_step_share: 0.005, step_mean_ms: 0.02, step_max_ms: 1.0 };
    let refusals = vec![Refusal { count: 2, words: "load: full".to_owned() }];
    let resting = Some(Resting { sessions: 3, steps, bytes_per_s: 1500.0 });
    let sessions = Sessions { asked: 6, driven: 1, resting, refusals };
    let expected = "\
sessions     6 asked for, 1 driven
             3 at rest: 0.5 % late, mean 0.020 ms, 1.5 kB/s a viewer
             2 refused: load: full
";
    assert_eq!(sessions.to_string(), expected);
}

#[test]
fn empty_run_is_reported_without_nonsense() {
    let text = report(&ContactMetrics::default(), &ViewTotals::default()).to_string();
    assert!(text.contains("no pose came back"), "{text}");
    assert!(!text.contains("NaN") && !text.contains("inf"), "{text}");
}

#[test]
fn json_has_the_same_numbers() {
    let json = serde_json::to_value(report(&contacts(), &view())).expect("a report is JSON");
    assert_eq!(json["scene"], "liver");
    assert_eq!(json["poses"]["skipped"], 4);
    assert_eq!(json["server"]["late_step_share"], 0.025);
    assert!((json["server"]["pace"].as_f64().expect("a number") - 0.8).abs() < 1e-9);
    assert_eq!((&json["server"]["lag_ms"]["count"], &json["poses"]["unanswered"]), (&1000.into(), &0.into()));
    assert_eq!(json["view"]["topology_version"], 9);
    assert_eq!(json["energy"]["residual_over_tool_work"], -1e-7 / 0.02);
    assert_eq!(json["round_trip_ms"]["count"], 1000);
}

#[test]
fn limits_name_what_was_exceeded_with_both_numbers() {
    let report = report(&contacts(), &view());
    assert_eq!(report.exceeded(&LimitArgs::default()), Vec::<String>::new());
    let limits = LimitArgs {
        max_p99_ms: Some(5.0),
        max_late_step_share: Some(0.5),
        max_late_send_share: Some(0.0),
        min_contact_rate: Some(300.0),
        max_mismatches: 0,
    };
    let exceeded = report.exceeded(&limits);
    assert_eq!(exceeded.len(), 3, "{exceeded:?}");
    assert!(exceeded[0].starts_with("round trip p99 in ms is 9.9"), "{exceeded:?}");
    assert!(exceeded[0].ends_with("at most 5 was asked for"), "{exceeded:?}");
    assert!(exceeded[1].starts_with("share of late sends is 0.0140"), "{exceeded:?}");
    assert_eq!(exceeded[2], "contacts a second are 250.0, at least 300 were asked for");
}

#[test]
fn mismatches_exceed_the_default_limits() {
    let view = ViewTotals { mismatches: 1, ..view() };
    assert_eq!(report(&contacts(), &view).exceeded(&LimitArgs::default()).len(), 1);
}

#[test]
fn run_without_round_trips_exceeds_a_limit_on_them() {
    let limits = LimitArgs { max_p99_ms: Some(1e9), ..LimitArgs::default() };
    assert_eq!(report(&ContactMetrics::default(), &view()).exceeded(&limits).len(), 1);
}

#[test]
fn bytes_get_a_unit_that_suits_them() {
    assert_eq!([0.0, 999.0, 1000.0, 1.5e6, 2e9].map(bytes), ["0 B", "999 B", "1.0 kB", "1.5 MB", "2.0 GB"]);
}
