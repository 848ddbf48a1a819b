//! Drivers that render no forces from models: they are told wrenches and where the tool is, and no step makes models for
//! them.

use kerf_proto::v1;

use super::harness::{Harness, Station, hello, no_expiry, pose};
use super::metrics::{scrape, with_metrics};

const ABOVE_M: f32 = 0.015;
const DEEP_M: f32 = 0.005;

fn at_height(tool_id: u32, seq: u64, height_m: f32) -> v1::ToolPose {
    let mut at = pose(tool_id, seq, 0.0);
    // The two blades beside each other, between planes of the block's voxels.
    let z = if tool_id == 0 { 4e-4 } else { -6e-3 };
    at.pose.as_mut().unwrap().position_m = Some(v1::Vec3 { x: 0.0, y: height_m, z });
    at
}

fn force_n(contact: &v1::Contact) -> f32 {
    let force = contact.wrench.unwrap().force_n.unwrap();
    (force.x * force.x + force.y * force.y + force.z * force.z).sqrt()
}

/// Presses into the block; the contacts on the way, the last of which bears a force.
async fn press(station: &mut Station, tool_id: u32) -> Vec<v1::Contact> {
    let mut told = Vec::new();
    for seq in 1..=20 {
        let height_m = ABOVE_M + (DEEP_M - ABOVE_M) * seq as f32 / 20.0;
        station.send(at_height(tool_id, seq, height_m)).await;
        told.push(station.contact_where(|contact| contact.echo_seq == seq).await);
    }
    told.push(station.contact_where(|contact| force_n(contact) > 0.02).await);
    told
}

async fn open(harness: &Harness, session: &str, tool_id: u32, without_models: bool) -> Station {
    let hello = v1::ClientHello { without_models, ..hello(session, &[tool_id]) };
    Station::open(harness.channel.clone(), hello).await.unwrap()
}

/// Time that all steps have taken for models, s.
async fn models_s(harness: &Harness) -> f64 {
    scrape(harness).await.value("kerf_step_stage_seconds_total{stage=\"contact_model\"}")
}

#[tokio::test(flavor = "multi_thread")]
async fn models_are_made_for_the_driver_that_wants_them_and_for_no_other() {
    let mut harness = Harness::with(with_metrics).await;
    let session = harness.create().await.unwrap();
    let mut reader = open(&harness, &session, 0, true).await;
    assert_eq!(reader.hello.contact_rate_hz, 250.0, "the rate is that of others");
    let told = press(&mut reader, 0).await;
    assert!(told.iter().all(|contact| contact.model.is_none()));
    for contact in &told {
        let expected = at_height(0, 0, ABOVE_M + (DEEP_M - ABOVE_M) * contact.echo_seq as f32 / 20.0);
        assert_eq!(contact.reference, expected.pose, "the tool is where its pose has it");
    }
    assert_eq!(models_s(&harness).await, 0.0, "no step has made a model");

    let mut station = open(&harness, &session, 1, false).await;
    press(&mut station, 1).await;
    let felt = station.contact_where(|contact| contact.model.is_some()).await;
    assert!(felt.model.unwrap().stiffness.len() == 21 && felt.reference.is_none());
    assert!(models_s(&harness).await > 0.0);
    for _ in 0..50 {
        assert_eq!(reader.contact_where(|_| true).await.model, None);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_tool_has_models_as_the_hello_of_whoever_drives_it_says_and_a_lifted_one_has_no_reference() {
    let mut harness = Harness::with(no_expiry).await;
    let session = harness.create().await.unwrap();
    for without_models in [false, true, false] {
        let mut station = open(&harness, &session, 0, without_models).await;
        press(&mut station, 0).await;
        let told = station.contact_where(|contact| contact.model.is_some() != contact.reference.is_some()).await;
        assert_eq!((told.model.is_none(), told.reference.is_some()), (without_models, without_models));
        station.say(v1::control_request::Message::Lift(v1::LiftTool { tool_id: 0 })).await;
        let lifted = station.contact_where(|contact| contact.flags & v1::ContactFlag::Lifted as u32 != 0).await;
        assert_eq!((lifted.model, lifted.reference), (None, None));
        drop(station);
        harness.until(&session, |described| described.leased_tool_ids.is_empty()).await;
    }
}
