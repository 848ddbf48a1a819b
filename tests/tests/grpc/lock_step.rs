//! A session whose steps wait for its client.

use std::time::Instant;

use kerf_proto::v1::{self, tool_motion};
use tonic::Code;
use tonic_types::StatusExt;

use super::harness::Harness;

fn at(height_m: f32) -> v1::StepInput {
    let position_m = Some(v1::Vec3 { x: 0.0, y: height_m, z: 4e-4 });
    let pose = v1::Pose { position_m, orientation: Some(v1::Quat { w: 1.0, ..Default::default() }) };
    motion(tool_motion::Motion::Pose(v1::ToolPose { pose: Some(pose), ..Default::default() }))
}

fn lift() -> v1::StepInput {
    motion(tool_motion::Motion::Lift(v1::LiftTool { tool_id: 0 }))
}

fn motion(motion: tool_motion::Motion) -> v1::StepInput {
    v1::StepInput { motions: vec![v1::ToolMotion { motion: Some(motion) }] }
}

/// Down through the block and out.
fn stroke() -> Vec<v1::StepInput> {
    (0..100).map(|step| at(0.012 - 2e-4 * step as f32)).chain([lift()]).collect()
}

fn request(session_id: &str, inputs: &[v1::StepInput]) -> v1::StepSessionRequest {
    v1::StepSessionRequest { session_id: session_id.into(), steps: inputs.len() as u32, inputs: inputs.to_vec() }
}

async fn stand(harness: &mut Harness) -> String {
    let session_id = harness.create().await.unwrap();
    harness.pause(&session_id).await;
    harness.reset(&session_id).await;
    session_id
}

#[tokio::test]
async fn an_answer_has_what_each_step_led_to_and_the_same_calls_have_the_same_answers() {
    let mut harness = Harness::start().await;
    let session_id = stand(&mut harness).await;
    let stepped = harness.sessions.step_session(request(&session_id, &stroke())).await.unwrap().into_inner();
    let described = harness.describe(&session_id).await;
    assert_eq!((stepped.step, stepped.outcomes.len(), described.step), (101, 101, 101));
    assert_eq!((stepped.state_hash, stepped.topology_version), (described.state_hash, described.topology_version));
    assert_eq!((stepped.outcomes[100].energy, described.late_steps), (described.energy, 0));
    assert!(stepped.topology_version > 0, "it cuts");
    let felt = |step: usize| stepped.outcomes[step].contacts[0].wrench.unwrap().force_n.unwrap().y;
    assert!(felt(50) > 0.01);
    let flags = |step: usize| stepped.outcomes[step].contacts[0].flags;
    assert_eq!([flags(50), flags(100)], [0, v1::ContactFlag::Lifted as u32]);

    harness.reset(&session_id).await;
    let mut parts = Vec::new();
    for inputs in stroke().chunks(40) {
        let part = harness.sessions.step_session(request(&session_id, inputs)).await.unwrap().into_inner();
        // A blade in the tissue answers with its model after the last step alone.
        let models = part.outcomes.iter().map(|outcome| outcome.contacts[0].model.is_some());
        assert!(models.rev().skip(1).all(|has_model| !has_model));
        parts.extend(part.outcomes);
    }
    let bare = |outcomes: Vec<v1::StepOutcome>| {
        let mut outcomes = outcomes;
        outcomes.iter_mut().flat_map(|outcome| &mut outcome.contacts).for_each(|contact| contact.model = None);
        outcomes
    };
    assert_eq!(bare(parts), bare(stepped.outcomes));
    assert_eq!(harness.describe(&session_id).await.state_hash, stepped.state_hash);
}

#[tokio::test]
async fn many_sessions_step_in_one_call_as_each_does_by_itself() {
    let mut harness = Harness::start().await;
    let ids = [stand(&mut harness).await, stand(&mut harness).await, stand(&mut harness).await];
    let alone = harness.sessions.step_session(request(&ids[0], &stroke())).await.unwrap().into_inner();
    let mut together = async |sessions: Vec<v1::StepSessionRequest>| {
        let answer = harness.sessions.step_sessions(v1::StepSessionsRequest { sessions }).await;
        answer.map(|answer| answer.into_inner().sessions)
    };
    // The second has its stroke in two entries; the third only rests.
    let stroke = stroke();
    let (begin, end) = stroke.split_at(40);
    let resting = v1::StepSessionRequest { session_id: ids[2].clone(), steps: 3, inputs: Vec::new() };
    let entries = vec![request(&ids[1], begin), resting.clone(), request(&ids[1], end)];
    let stepped = together(entries).await.unwrap();
    let steps = |of: &[v1::StepSessionResponse]| of.iter().map(|one| one.step).collect::<Vec<_>>();
    assert_eq!(steps(&stepped), [40, 3, 101]);
    assert_eq!(stepped[2].state_hash, alone.state_hash);

    // Whatever is wrong with one, none moves.
    let mut refused = async |second: v1::StepSessionRequest| {
        let status = together(vec![resting.clone(), second]).await.unwrap_err();
        let details = status.get_error_details();
        let field = details.bad_request().map_or(String::new(), |bad| bad.field_violations[0].field.clone());
        (status.code(), field, status.message().to_owned())
    };
    let (code, field, _) = refused(v1::StepSessionRequest { steps: 0, ..resting.clone() }).await;
    assert_eq!((code, &field[..]), (Code::InvalidArgument, "sessions[1].steps"));
    let (code, field, _) = refused(request(&ids[1], &[at(f32::NAN)])).await;
    assert_eq!((code, &field[..]), (Code::InvalidArgument, "sessions[1].inputs[0].motions[0].pose.pose.position_m"));
    let (code, _, words) = refused(v1::StepSessionRequest { session_id: "none".into(), ..resting.clone() }).await;
    assert!(code == Code::NotFound && words.contains("sessions[1]"), "{code}: {words}");
    let (code, field, words) = refused(v1::StepSessionRequest { steps: 9_998, ..resting.clone() }).await;
    assert!(code == Code::InvalidArgument && words.contains("10000"), "{field}: {words}");
    let nothing = together(Vec::new()).await.unwrap_err();
    assert_eq!(nothing.code(), Code::InvalidArgument);
    assert_eq!(harness.describe(&ids[2]).await.step, 3);
}

#[tokio::test]
async fn inputs_that_are_not_valid_are_refused_by_their_path_and_nothing_moves() {
    let mut harness = Harness::start().await;
    let session_id = stand(&mut harness).await;
    let mut refused = async |inputs: &[v1::StepInput], steps| {
        let request = v1::StepSessionRequest { steps, ..request(&session_id, inputs) };
        let status = harness.sessions.step_session(request).await.unwrap_err();
        assert_eq!(status.code(), Code::InvalidArgument, "{status}");
        status.get_details_bad_request().unwrap().field_violations[0].field.clone()
    };
    assert_eq!(refused(&[at(0.012), at(f32::NAN)], 2).await, "inputs[1].motions[0].pose.pose.position_m");
    assert_eq!(refused(&[at(0.012), at(-0.012)], 2).await, "inputs[1].motions[0].pose.pose.position_m");
    assert_eq!(
        refused(&[v1::StepInput { motions: vec![v1::ToolMotion::default()] }], 1).await,
        "inputs[0].motions[0].motion"
    );
    assert_eq!(refused(&[at(0.012), at(0.012)], 1).await, "inputs");
    assert_eq!(refused(&[], 1001).await, "steps");
    assert_eq!(harness.describe(&session_id).await.step, 0);
    let _station = harness.drive(&session_id, &[0]).await.unwrap();
    let taken = harness.sessions.step_session(request(&session_id, &[at(0.012)])).await.unwrap_err();
    assert_eq!(taken.code(), Code::FailedPrecondition);
}

/// Prints what a call costs beside its steps: steps of the block at rest, one a call and a hundred.
#[tokio::test]
async fn a_step_a_call_costs_a_round_trip() {
    const STEPS: u32 = 1000;
    let mut harness = Harness::start().await;
    let session_id = stand(&mut harness).await;
    for steps_per_call in [1, 100] {
        let began = Instant::now();
        for _ in 0..STEPS / steps_per_call {
            let request = v1::StepSessionRequest { steps: steps_per_call, ..request(&session_id, &[]) };
            harness.sessions.step_session(request).await.unwrap();
        }
        let us = began.elapsed().as_secs_f64() * 1e6 / f64::from(STEPS);
        println!("{steps_per_call} steps a call: {us:.1} us a step");
    }
    assert_eq!(harness.describe(&session_id).await.step, u64::from(2 * STEPS));
}
