//! A server that the machine stops for a second while a hand moves on.

use std::process::Stdio;
use std::time::Duration;

use kerf_proto::PROTOCOL_VERSION;
use kerf_proto::v1::control_service_client::ControlServiceClient;
use kerf_proto::v1::{self, control_request, control_response};
use tokio::sync::mpsc;
use tokio::time::{MissedTickBehavior, interval};

use super::process::{Process, soon};

/// Gc times the block's width, N: what cutting takes once it has begun.
const CUTTING_N: f64 = 5.0 * 0.02;
/// Slow enough that no pose alone is a jump.
const SPEED_M_PER_S: f64 = 0.015;
const TOP_M: f64 = 0.01;
const STOPPED: Duration = Duration::from_secs(1);

fn pose(milliseconds: u64) -> v1::ControlRequest {
    let y_m = TOP_M + 5e-4 - SPEED_M_PER_S * 1e-3 * milliseconds as f64;
    let position_m = Some(v1::Vec3 { x: 0.0, y: y_m as f32, z: 4e-4 });
    let pose = Some(v1::Pose { position_m, orientation: Some(v1::Quat { w: 1.0, ..Default::default() }) });
    let pose = v1::ToolPose { seq: milliseconds + 1, client_ns: milliseconds * 1_000_000, pose, ..Default::default() };
    v1::ControlRequest { message: Some(control_request::Message::Pose(pose)), received: 0 }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_hand_that_moves_on_while_the_server_is_stopped_feels_no_more_than_the_cut_after_it() {
    let mut process = Process::serve(&["--log-filter", "warn"], Stdio::inherit()).await;
    let session_id = process.create().await.session.unwrap().session_id;
    let hello =
        v1::ClientHello { protocol_version: PROTOCOL_VERSION, session_id, tool_ids: vec![0], ..Default::default() };
    let hello = v1::ControlRequest { message: Some(control_request::Message::Hello(hello)), received: 0 };
    let (up, messages) = mpsc::channel(64);
    up.send(hello).await.unwrap();
    let hand = up.clone();
    tokio::spawn(async move {
        // What it could not say while the server stood it says at once afterwards.
        let mut ticks = interval(Duration::from_millis(1));
        ticks.set_missed_tick_behavior(MissedTickBehavior::Burst);
        for milliseconds in 0.. {
            ticks.tick().await;
            if hand.send(pose(milliseconds)).await.is_err() {
                break;
            }
        }
    });
    let messages = futures_util::stream::unfold(messages, |mut messages| async {
        messages.recv().await.map(|message| (message, messages))
    });
    let url = format!("http://{}", process.address);
    let mut client = ControlServiceClient::connect(url).await.unwrap();
    let mut down = client.control(messages).await.unwrap().into_inner();

    let (mut most_n, mut last_ns, mut longest_gap_ns, mut resumes_at) = ([0.0f64; 2], 0, 0, None);
    // The cut has begun when the machine stops the server, and would be three quarters through when it goes on.
    let depth_m = |echo_seq: u64| SPEED_M_PER_S * 1e-3 * echo_seq as f64 - 5e-4;
    soon("the way through the block", async {
        loop {
            let Some(control_response::Message::Contact(contact)) = down.message().await.unwrap().unwrap().message
            else {
                continue;
            };
            up.send(v1::ControlRequest { message: None, received: contact.number }).await.unwrap();
            let force_n = contact.wrench.unwrap().force_n.unwrap();
            let force_n = f64::from(force_n.x).hypot(f64::from(force_n.y)).hypot(f64::from(force_n.z));
            let after = usize::from(resumes_at.is_some());
            most_n[after] = most_n[after].max(force_n);
            if last_ns > 0 {
                longest_gap_ns = longest_gap_ns.max(contact.server_ns - last_ns);
            }
            last_ns = contact.server_ns;
            if resumes_at.is_none() && depth_m(contact.echo_seq) > 4e-3 {
                process.signal("-STOP");
                tokio::time::sleep(STOPPED).await;
                process.signal("-CONT");
                resumes_at = Some(contact.echo_seq);
            }
            if depth_m(contact.echo_seq) > 0.022 {
                break;
            }
        }
    })
    .await;
    println!("at most {most_n:?} N before and after, {:.2} s without a step", 1e-9 * longest_gap_ns as f64);
    assert!(longest_gap_ns > 900_000_000, "it was not stopped: {longest_gap_ns} ns");
    assert!(most_n[0] > 0.5 * CUTTING_N, "the block was not felt before: {most_n:?} N");
    assert!(most_n[1] < 4.0 * CUTTING_N, "{most_n:?} N, cutting takes {CUTTING_N} N");
}
