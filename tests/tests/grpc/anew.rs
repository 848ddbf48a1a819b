//! Hands that are deep in tissue when the organ is made anew: they feel nothing until they are clear, and are told so.

use kerf_proto::v1;

use super::harness::{Harness, Station, no_expiry, pose};

const WAITS: u32 = v1::ContactFlag::WaitsUntilClear as u32;

fn at_height(seq: u64, height_m: f32) -> v1::ToolPose {
    let mut at = pose(0, seq, 0.0);
    at.pose.as_mut().unwrap().position_m.as_mut().unwrap().y = height_m;
    at
}

fn force_n(contact: &v1::Contact) -> f32 {
    let force = contact.wrench.unwrap().force_n.unwrap();
    (force.x * force.x + force.y * force.y + force.z * force.z).sqrt()
}

/// Goes down into the block in steps that a hand takes; again from above where a busy machine stood still meanwhile, as what
/// moved on without it waits until it is clear.
async fn press(station: &mut Station, first_seq: u64) {
    for first_seq in (first_seq..).step_by(11).take(6) {
        for i in 0..=10 {
            station.send(at_height(first_seq + i, 0.015 - 1e-3 * i as f32)).await;
            station.contact_where(|contact| contact.echo_seq == first_seq + i).await;
        }
        let told = station.contact_where(|contact| contact.flags & WAITS != 0 || force_n(contact) > 0.05).await;
        if told.flags & WAITS == 0 {
            return;
        }
    }
    panic!("it waits each time that it comes");
}

/// What a hand that stays deep is told: nothing is felt.
async fn waits(station: &mut Station, seq: u64) {
    station.send(at_height(seq, 0.0049)).await;
    let told = station.contact_where(|contact| contact.flags & WAITS != 0 && contact.echo_seq == seq).await;
    assert!(force_n(&told) == 0.0 && told.model.is_none(), "{told:?}");
    assert_ne!(told.flags & v1::ContactFlag::Lifted as u32, 0);
}

#[tokio::test]
async fn a_hand_that_is_deep_in_the_organ_feels_nothing_after_a_reset_and_in_a_new_session_until_it_is_clear() {
    let mut harness = Harness::with(no_expiry).await;
    let session = harness.create().await.unwrap();
    let mut station = harness.drive(&session, &[0]).await.unwrap();
    press(&mut station, 1).await;
    harness.reset(&session).await;
    waits(&mut station, 100).await;
    station.send(at_height(200, 0.0095)).await;
    station.contact_where(|contact| contact.echo_seq == 200 && contact.flags & WAITS == 0).await;
    press(&mut station, 300).await;
    // Its server has gone, and it makes a session on the next one: the hand is where it was.
    let next = harness.create().await.unwrap();
    let mut station = harness.drive(&next, &[0]).await.unwrap();
    waits(&mut station, 1).await;
    station.send(at_height(2, 0.0095)).await;
    station.contact_where(|contact| contact.echo_seq == 2 && contact.flags & WAITS == 0).await;
    press(&mut station, 3).await;
}
