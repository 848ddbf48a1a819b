//! Whole runs against a server of a few lines, over gRPC on loopback.

mod server;

use std::io::{BufRead, BufReader, Write};
use std::process::Stdio;
use std::time::Duration;

use self::server::{Behaviour, LAG_NS, STIFFNESS_N_PER_M};
use clap::Parser;
use kerf_load::args::Args;
use kerf_load::output;
use kerf_load::run::{Finished, run};

/// A short stroke of 10 mm: half a second down and up.
const STROKE: &[&str] =
    &["--strokes", "1", "--depth", "0.01", "--speed", "0.1", "--travel-speed", "0.5", "--hold", "0.1"];

async fn load(server: &str, extra: &[&str]) -> anyhow::Result<Finished> {
    let fixed = ["kerf-load", "--server", server, "--progress", "off"];
    run(&Args::try_parse_from(fixed.iter().chain(extra))?).await
}

async fn stroke(behaviour: Behaviour, extra: &[&str]) -> anyhow::Result<Finished> {
    let server = server::start(behaviour).await;
    load(&server, &[&["--scene", "box"], STROKE, extra].concat()).await
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn stroke_measures_force_depth_and_round_trip() {
    let finished = stroke(Behaviour::Good, &["--rate", "500"]).await.expect("the run succeeds");
    let report = &finished.report;
    let expected_n = f64::from(STIFFNESS_N_PER_M) * 0.01;
    assert!((report.force.max_n - expected_n).abs() < 1e-3 * expected_n, "{report}");
    assert!((report.force.max_resistance_n - expected_n).abs() < 1e-3 * expected_n, "{report}");
    assert!((report.force.max_depth_m - 0.01).abs() < 1e-5, "{report}");
    assert_eq!(report.force.reference_n, Some(2.0));
    assert_eq!(report.contacts.received, report.poses.sent, "this server answers each pose: {report}");
    let due = report.poses.sent + report.poses.skipped + report.poses.dropped;
    let round_trips = report.round_trip_ms.expect("poses came back");
    assert!(round_trips.count.abs_diff(due) <= 1, "each pose that was due is told of: {report}");
    for sample in &finished.contacts.samples {
        let expected_n = f64::from(STIFFNESS_N_PER_M) * sample.depth_m.max(0.0);
        assert!((sample.resistance_n - expected_n).abs() < 1e-4, "the echo tells which pose: {sample:?}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn pace_lag_and_the_age_of_forces_are_told_beside_lateness() {
    let finished = stroke(Behaviour::Good, &["--rate", "500"]).await.expect("the run succeeds");
    let report = &finished.report;
    assert!((report.server.pace.expect("steps were told of") - 0.5).abs() < 1e-6, "{report}");
    let lag_ms = report.server.lag_ms.expect("steps were told of");
    assert!((lag_ms.p50 - LAG_NS as f64 * 1e-6).abs() < 0.01 && lag_ms.count == report.contacts.received, "{report}");
    let (ages, round_trips) = (report.force_age_ms.expect("forces"), report.round_trip_ms.expect("round trips"));
    assert!(
        2 * ages.count > 3 * report.contacts.received && ages.p50 >= round_trips.p50,
        "a force ages from when it comes in: {report}"
    );
    assert!(report.to_string().contains("The force in the hand was"), "{report}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn viewers_follow_the_structure_and_the_first_one_keeps_its_surface() {
    // More than a connection has streams for.
    let finished = stroke(Behaviour::Good, &["--viewers", "6"]).await.expect("the run succeeds");
    let (view, server) = (&finished.report.view, &finished.report.server);
    assert_eq!((view.keyframes, view.patches, view.mismatches, view.topology_version), (6, 6, 0, 1));
    assert!(view.states > 30 && view.bytes_per_s > 1000.0, "{view:?}");
    assert!(server.steps.steps > 100 && server.steps.late_steps.abs_diff(server.steps.steps / 10) <= 1, "{server:?}");
    assert!(
        (server.steps.step_mean_ms - 0.5).abs() < 1e-6 && (server.steps.step_max_ms - 2.0).abs() < 1e-6,
        "{server:?}"
    );
    assert_eq!(finished.objects.len(), 1);
    assert_eq!(finished.objects[0].surface.triangles.len(), 6);
    assert!(finished.report.limits_exceeded.is_empty());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn some_of_several_sessions_are_driven_and_those_that_a_full_server_refuses_are_counted() {
    let extra = ["--sessions", "5", "--stations", "2", "--viewers", "2"];
    let finished = stroke(Behaviour::TakesFourSessions, &extra).await.expect("the run succeeds");
    let report = &finished.report;
    let sessions = &report.sessions;
    assert_eq!((sessions.asked, sessions.driven), (5, 2), "{report}");
    let resting = sessions.resting.expect("two are not driven");
    assert_eq!(resting.sessions, 2);
    assert!(resting.steps.steps > 100 && resting.bytes_per_s > 1000.0, "{report}");
    let refusals: Vec<_> = sessions.refusals.iter().map(|refusal| (refusal.count, refusal.words.as_str())).collect();
    assert_eq!(refusals, [(1, "four sessions")]);
    // Both drivers' poses, and all viewers of driven sessions.
    let once = stroke(Behaviour::Good, &[]).await.expect("the run succeeds").report;
    assert!(report.poses.sent > once.poses.sent * 3 / 2, "{report}");
    assert_eq!((report.view.viewers, report.view.keyframes), (4, 4), "{report}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn replica_that_keeps_coming_apart_ends_the_run() {
    let server = server::start(Behaviour::WrongHash).await;
    // Of so many strokes, which would take minutes.
    let driven = load(&server, &["--scene", "box", "--strokes", "100", "--depth", "0.01"]);
    let ended = tokio::time::timeout(Duration::from_secs(60), driven).await;
    let error = ended.expect("it does not wait for the strokes' end").err().expect("the hash never matches");
    assert!(format!("{error:#}").contains("the replica came apart more than 10 times"), "{error:#}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn rejected_poses_are_counted_and_do_not_end_the_run() {
    let finished = stroke(Behaviour::RejectsPoses, &[]).await.expect("the run succeeds");
    let report = &finished.report;
    assert!(report.poses.rejected > 0, "{report}");
    assert_eq!(report.contacts.received + report.poses.rejected, report.poses.sent, "{report}");
    assert_eq!(report.contacts.first_rejection.as_deref(), Some("pose 5 of tool 0: pose.position_m.x: at most 1 m"));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn lost_stream_is_an_error_that_says_so() {
    let error = stroke(Behaviour::DropsDriver, &[]).await.err().expect("the stream ends");
    assert_eq!(format!("{error:#}"), "the server ended the control stream");
}

#[tokio::test]
async fn absent_server_is_an_error_that_names_the_address() {
    let error = load("127.0.0.1:1", &["--scene", "box"]).await.err().expect("nobody listens there");
    assert!(format!("{error:#}").starts_with("no Kerf server answers at 127.0.0.1:1"), "{error:#}");
}

#[tokio::test]
async fn refused_scene_is_an_error_with_the_servers_words() {
    let server = server::start(Behaviour::Good).await;
    let error = load(&server, &["--scene", "moon"]).await.err().expect("unknown scene");
    assert!(format!("{error:#}").starts_with("creating a session of moon:"), "{error:#}");
    assert!(format!("{error:#}").contains("no scene"), "{error:#}");
}

#[tokio::test]
async fn script_faster_than_the_server_allows_is_refused_before_it_starts() {
    let server = server::start(Behaviour::Good).await;
    let error = load(&server, &["--scene", "box", "--travel-speed", "1.5"]).await.err().expect("too fast");
    assert_eq!(error.to_string(), "the script moves a tool at 1.500 m/s, the server takes 1.000 m/s");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn csv_script_drives_a_session_that_is_joined_and_leaves_its_files() {
    let dir = tempfile::tempdir().expect("temporary directory");
    let script = dir.path().join("script.csv");
    let mut file = std::fs::File::create(&script).expect("writable");
    write!(file, "time_s,tool,x_m,y_m,z_m,qx,qy,qz,qw\n0,scalpel,0,0.06,0,0,0,0,1\n0.2,scalpel,0,0.045,0,0,0,0,1\n")
        .expect("writable");
    let server = server::start(Behaviour::Good).await;
    let script = script.to_str().expect("UTF-8");
    let finished = load(&server, &["--session", "one", "--script", script]).await.expect("the run succeeds");
    assert!((finished.report.force.max_n - 0.5).abs() < 0.02, "{}", finished.report);

    let out = dir.path().join("out");
    for path in output::write(&out, &finished).expect("writable") {
        assert!(path.metadata().expect("exists").len() > 0, "{}", path.display());
    }
    let lines = std::fs::read_to_string(out.join("force.csv")).expect("readable");
    assert!(lines.starts_with("time_s,sim_time_s,step,tool,x_m,"), "{lines}");
    assert_eq!(lines.lines().count(), finished.contacts.samples.len() + 1);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn duration_bounds_the_run() {
    let finished = stroke(Behaviour::Good, &["--duration", "0.1"]).await.expect("the run succeeds");
    assert!(finished.report.duration_s <= 0.1 + 1e-9);
    assert!(finished.report.poses.sent <= 26, "{}", finished.report);
}

/// The program itself, as a user starts it.
fn program(server: &str, extra: &[&str]) -> std::process::Command {
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_kerf-load"));
    command.args(["--server", server, "--scene", "box"]).args(STROKE).args(extra);
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn program_exits_with_3_when_a_limit_is_exceeded() {
    let server = server::start(Behaviour::Good).await;
    let output = program(&server, &["--max-p99-ms", "0.000001"]).output().expect("the program runs");
    let text = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(3), "{output:?}");
    assert!(text.contains("EXCEEDED     round trip p99 in ms is "), "{text}");
    assert!(String::from_utf8_lossy(&output.stderr).contains("% of steps late"), "progress as lines: {output:?}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn interrupted_program_still_reports() {
    let server = server::start(Behaviour::Good).await;
    let mut child = program(&server, &["--clearance", "1"]).spawn().expect("the program runs");
    let progress = BufReader::new(child.stderr.take().expect("piped")).lines().next();
    assert!(progress.is_some_and(|line| line.is_ok()), "it has begun to send");
    let pid = rustix::process::Pid::from_child(&child);
    rustix::process::kill_process(pid, rustix::process::Signal::INT).expect("still running");
    let output = child.wait_with_output().expect("it ends");
    assert_eq!(output.status.code(), Some(130), "{output:?}");
    assert!(String::from_utf8_lossy(&output.stdout).contains("s, interrupted"), "{output:?}");
}
