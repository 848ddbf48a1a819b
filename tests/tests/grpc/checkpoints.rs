//! Checkpoints that a session goes back to, over the wire.

use kerf_proto::v1::{self, control_response};
use tonic::{Code, Status};

use super::cut::{ABOVE_M, FOOT_M, MIDDLE_M, Stroke, Watcher};
use super::harness::{Harness, no_expiry};

async fn save(harness: &mut Harness, session_id: &str, name: &str) -> Result<u64, Status> {
    let request = v1::SaveCheckpointRequest { session_id: session_id.into(), name: name.into() };
    Ok(harness.sessions.save_checkpoint(request).await?.into_inner().step)
}

async fn restore(harness: &mut Harness, session_id: &str, name: &str) -> Result<u64, Status> {
    let request = v1::RestoreCheckpointRequest { session_id: session_id.into(), name: name.into() };
    Ok(harness.sessions.restore_checkpoint(request).await?.into_inner().step)
}

async fn checkpoints(harness: &mut Harness, session_id: &str) -> Vec<v1::Checkpoint> {
    let request = v1::ListCheckpointsRequest { session_id: session_id.into() };
    harness.sessions.list_checkpoints(request).await.unwrap().into_inner().checkpoints
}

#[tokio::test]
async fn a_cut_is_undone_for_the_replicas_too() {
    let mut harness = Harness::with(no_expiry).await;
    let session = harness.create().await.unwrap();
    let mut watcher = Watcher::join(&harness, harness.channel.clone(), &session).await;
    let mut stroke = Stroke::begin(&harness, &session).await;
    watcher.during(stroke.press(ABOVE_M, MIDDLE_M)).await;
    harness.pause(&session).await;
    let step = save(&mut harness, &session, "half way").await.unwrap();
    let saved = harness.describe(&session).await;
    assert!(saved.topology_version > 0);
    assert_eq!(
        checkpoints(&mut harness, &session).await,
        [v1::Checkpoint { name: "half way".into(), step, sim_time_s: saved.sim_time_s }]
    );
    let resume = v1::ResumeSessionRequest { session_id: session.clone() };
    harness.sessions.resume_session(resume.clone()).await.unwrap();
    // From above: a blade that stood in the tissue while the session did is put down there, and cuts nothing
    // before it has come out.
    watcher.during(stroke.press(ABOVE_M, FOOT_M)).await;
    harness.pause(&session).await;
    let gone = harness.describe(&session).await;
    assert!(gone.topology_version > saved.topology_version);
    watcher.until(|replica| replica.topology_version() == Some(gone.topology_version)).await;

    assert_eq!(restore(&mut harness, &session, "half way").await.unwrap(), step);
    let restored = harness.describe(&session).await;
    assert_eq!((restored.state_hash, restored.energy), (saved.state_hash, saved.energy));
    // The replica checks the surface's hash against the keyframe's.
    watcher.until(|replica| replica.moment().is_some_and(|moment| moment.step == step)).await;
    assert_eq!(watcher.replica.topology_version(), Some(saved.topology_version));
    harness.sessions.resume_session(resume).await.unwrap();
    let told = stroke.station.pick(|message| match message {
        control_response::Message::CheckpointRestored(restored) => Some(restored),
        _ => None,
    });
    let told = told.await;
    assert_eq!(told.name, "half way");
    assert!(told.step >= step, "{told:?}");
    let lifted = stroke.station.contact_where(|contact| contact.step >= told.step).await;
    assert_ne!(lifted.flags & v1::ContactFlag::Lifted as u32, 0, "{lifted:?}");
    watcher.during(stroke.press(ABOVE_M, FOOT_M)).await;
}

#[tokio::test]
async fn points_are_refused_with_the_field_and_the_limit() {
    let mut harness = Harness::with(|config| config.session.max_checkpoints = 1).await;
    let session = harness.create().await.unwrap();
    save(&mut harness, &session, "a").await.unwrap();
    let full = save(&mut harness, &session, "b").await.unwrap_err();
    assert_eq!(full.code(), Code::ResourceExhausted);
    assert!(full.message().contains("max_checkpoints"), "{}", full.message());
    for name in ["", &"x".repeat(65)] {
        let refused = save(&mut harness, &session, name).await.unwrap_err();
        assert_eq!(refused.code(), Code::InvalidArgument);
        assert!(refused.message().contains("name") && refused.message().contains("64"), "{}", refused.message());
    }
    let unknown = restore(&mut harness, &session, "b").await.unwrap_err();
    assert_eq!(unknown.code(), Code::NotFound);
    assert!(unknown.message().contains("\"b\""), "{}", unknown.message());
    let delete = |name: &str| v1::DeleteCheckpointRequest { session_id: session.clone(), name: name.into() };
    assert_eq!(harness.sessions.delete_checkpoint(delete("b")).await.unwrap_err().code(), Code::NotFound);
    harness.sessions.delete_checkpoint(delete("a")).await.unwrap();
    assert_eq!(checkpoints(&mut harness, &session).await, []);
    assert!(save(&mut harness, &session, "b").await.is_ok());
}
