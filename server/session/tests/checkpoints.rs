//! A session goes back to a named checkpoint: the state, what viewers and drivers learn, what is recorded.

use std::sync::Arc;
use std::time::Duration;

use super::session::report_where;
use kerf_physics::scene::text::is_hidden;
use kerf_physics::{OPEN, Pose, Quat, Scene, SceneDesc, Vec3, Workers};
use kerf_scenes::dial::ParetoFronts;
use kerf_session::stepping::Steps;
use kerf_session::{
    Driver, MAX_CHECKPOINT_NAME_BYTES, Phase, PoseSample, Registry, Resimulation, SceneEvent, Session, SessionError,
    SessionLimits, SessionOptions, ViewMessage, Viewer,
};

const PATIENCE: Duration = Duration::from_secs(60);

async fn session_with(limits: SessionLimits) -> (Registry, Arc<Session>) {
    let scene =
        Scene { desc: toml::from_str::<SceneDesc>(include_str!("block.toml")).unwrap(), meshes: Default::default() };
    let registry = Registry::new(limits, ParetoFronts::default()).unwrap();
    let session = registry
        .create(scene.judge().unwrap(), SessionOptions { is_recorded: true, ..SessionOptions::default() })
        .await
        .unwrap();
    (registry, session)
}

async fn session() -> (Registry, Arc<Session>) {
    session_with(SessionLimits { lease_s: 600.0, threads_per_session: 2, ..SessionLimits::default() }).await
}

/// The edge turned about the vertical and tilted: it crosses the links one after another.
fn askew(seq: u64, height_m: f64) -> PoseSample {
    let orientation = Quat::from_axis_angle(&Vec3::y_axis(), 0.4) * Quat::from_axis_angle(&Vec3::z_axis(), 0.3);
    let pose = Pose { position_m: Vec3::new(0.0, height_m, 4e-4), orientation };
    PoseSample { seq, client_ns: 0, pose, opening: OPEN }
}

/// Puts the edge down over the block and moves it down step by step; each pose waits until a step has used
/// the one before.
async fn press(driver: &Driver, seqs: std::ops::Range<u64>) {
    let first = seqs.start;
    for seq in seqs {
        driver.submit(0, &askew(seq, 0.012 - 2e-4 * (seq - first) as f64)).unwrap();
        report_where(driver, |report| report.tools[0].echo.is_some_and(|echo| echo.seq == seq)).await;
    }
}

async fn message_where<T>(viewer: &mut Viewer, pick: impl Fn(ViewMessage) -> Option<T>) -> T {
    let search = async {
        loop {
            if let Some(picked) = pick(viewer.next().await.expect("the session lives")) {
                return picked;
            }
        }
    };
    tokio::time::timeout(PATIENCE, search).await.expect("a message in time")
}

fn event(message: ViewMessage) -> Option<(u64, SceneEvent)> {
    match message {
        ViewMessage::Event(happened) => Some((happened.step, happened.event)),
        _ => None,
    }
}

#[tokio::test]
async fn viewers_hear_of_checkpoints_and_get_the_structure_of_the_checkpoint() {
    let (_registry, session) = session().await;
    let mut viewer = session.view().unwrap();
    viewer.next().await;
    let driver = session.drive(&[0]).unwrap();
    let step = session.save_checkpoint("whole").await.unwrap();
    let (at, _) =
        message_where(&mut viewer, |m| event(m).filter(|(_, e)| *e == SceneEvent::CheckpointSaved("whole".into())))
            .await;
    assert_eq!(at, step);
    press(&driver, 1..60).await;
    let cut = session.describe().await.unwrap();
    assert!(cut.topology_version > 0);
    session.pause().await.unwrap();
    session.restore_checkpoint("whole").await.unwrap();
    message_where(&mut viewer, |m| event(m).filter(|(_, e)| *e == SceneEvent::CheckpointRestored("whole".into())))
        .await;
    let keyframe = message_where(&mut viewer, |message| match message {
        ViewMessage::Keyframe(keyframe) => Some(keyframe),
        ViewMessage::Patch(_) => panic!("patches do not lead back"),
        _ => None,
    })
    .await;
    assert_eq!(keyframe.topology_version, 0);
    assert!(matches!(viewer.next().await, Some(ViewMessage::State(state)) if state.step == step));
}

#[tokio::test]
async fn points_outlive_a_reset_and_lead_to_a_way_that_was_left() {
    let (_registry, session) = session().await;
    let driver = session.drive(&[0]).unwrap();
    session.save_checkpoint("rest").await.unwrap();
    press(&driver, 1..50).await;
    session.pause().await.unwrap();
    session.save_checkpoint("cut").await.unwrap();
    let cut = session.describe().await.unwrap().state_hash;
    session.restore_checkpoint("rest").await.unwrap();
    session.reset().await.unwrap();
    session.restore_checkpoint("cut").await.unwrap();
    assert_eq!(session.describe().await.unwrap().state_hash, cut);
    session.step(Steps { count: 1, inputs: Vec::new() }).await.unwrap();
    session.pause().await.unwrap();
    let (entries, _) = session.take_reel().unwrap().tape.take();
    let scene = session.scene().clone().judge().unwrap();
    let mut again = Resimulation::new(&scene).unwrap();
    again.follow(&Workers::serial(), &entries).unwrap();
    let hash = session.describe().await.unwrap().state_hash;
    assert!(hash != cut && again.world().state_hash() == hash);
}

#[tokio::test]
async fn points_are_limited_listed_replaced_and_deleted() {
    let (_registry, session) = session_with(SessionLimits { max_checkpoints: 2, ..SessionLimits::default() }).await;
    session.pause().await.unwrap();
    let names =
        async || session.checkpoints().await.unwrap().into_iter().map(|checkpoint| checkpoint.name).collect::<Vec<_>>();
    session.save_checkpoint("a").await.unwrap();
    session.save_checkpoint("b").await.unwrap();
    assert_eq!(session.save_checkpoint("c").await, Err(SessionError::TooManyCheckpoints { limit: 2 }));
    session.save_checkpoint("a").await.unwrap();
    assert_eq!(names().await, ["b", "a"], "in the order of saving");
    session.delete_checkpoint("b").await.unwrap();
    session.save_checkpoint("c").await.unwrap();
    assert_eq!(names().await, ["a", "c"]);
    let unknown = Err(SessionError::NoCheckpoint { name: "b".into() });
    assert_eq!(
        (session.restore_checkpoint("b").await, session.delete_checkpoint("b").await.map(|()| 0)),
        (unknown, Err(SessionError::NoCheckpoint { name: "b".into() }))
    );
    let long = "x".repeat(MAX_CHECKPOINT_NAME_BYTES + 1);
    for name in ["", &long, "two\nlines", "end\0", "turned \u{202e}round", "\u{2066}inside"] {
        let refused = session.save_checkpoint(name).await;
        assert!(
            matches!(&refused, Err(SessionError::PointName { limit: MAX_CHECKPOINT_NAME_BYTES, .. })),
            "{refused:?}"
        );
        let said = refused.unwrap_err().to_string();
        assert!(said.starts_with("name: ") && !said.contains(is_hidden), "{said}");
    }
}

#[tokio::test]
async fn a_failed_session_saves_nothing_and_is_mended_by_a_checkpoint() {
    let (_registry, session) = session().await;
    session.pause().await.unwrap();
    session.save_checkpoint("good").await.unwrap();
    let good = session.describe().await.unwrap().state_hash;
    let answer = session.query(|_| -> u64 { panic!("a test's panic") }).await;
    assert!(matches!(answer, Err(SessionError::Failed { .. })));
    assert!(matches!(session.save_checkpoint("bad").await, Err(SessionError::Failed { .. })));
    session.restore_checkpoint("good").await.unwrap();
    assert_eq!((session.phase(), session.describe().await.unwrap().state_hash), (Phase::Paused, good));
    assert!(session.resume().await.is_ok());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_session_on_its_way_elsewhere_refuses_what_would_be_lost_and_runs_on_if_it_stays() {
    let (_registry, session) = session().await;
    session.save_checkpoint("before").await.unwrap();
    let left = session.leave().await.unwrap();
    assert!(!left.is_paused);
    let step = session.describe().await.unwrap().step;
    assert_eq!(left.state.step(), step);
    let copy = session.copy().await.unwrap();
    let refused = [
        session.resume().await.map(drop),
        session.step(Steps { count: 1, inputs: Vec::new() }).await.map(drop),
        session.reset().await,
        session.save_checkpoint("after").await.map(drop),
        session.keep_checkpoint("after", copy).await.map(drop),
        session.restore_checkpoint("before").await.map(drop),
        session.delete_checkpoint("before").await,
        session.leave().await.map(drop),
    ];
    assert_eq!(refused, [const { Err(SessionError::Leaving) }; 8]);
    let described = session.describe().await.unwrap();
    assert_eq!((described.phase, described.step), (Phase::Paused, step), "it stands");
    session.stay().await.unwrap();
    assert_eq!(session.describe().await.unwrap().phase, Phase::Running);
    session.save_checkpoint("after").await.unwrap();

    session.pause().await.unwrap();
    assert!(session.leave().await.unwrap().is_paused);
    session.stay().await.unwrap();
    assert_eq!(session.describe().await.unwrap().phase, Phase::Paused, "it stood before, too");
}
