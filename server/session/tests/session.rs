//! Sessions as their callers see them. The assertions hold for any scene that parts under a blade.

use std::collections::HashSet;
use std::sync::Arc;
use std::task::{Context, Waker};
use std::time::Duration;

use kerf_physics::scene::{GrasperDesc, ToolDesc};
use kerf_physics::step_io::Grasp;
use kerf_physics::{OPEN, Pose, Quat, Scene, SceneDesc, SoundScene, Vec3, Workers};
use kerf_scenes::dial::ParetoFronts;
use kerf_session::{
    Driver, Past, Phase, PoseRefusal, PoseSample, Registry, Resimulation, SceneEvent, Session, SessionError, SessionId,
    SessionLimits, SessionOptions, StepReport, TapeEntry, TapeState, ViewMessage, Viewer,
};

const BLOCK: &str = include_str!("block.toml");

fn recorded() -> SessionOptions {
    SessionOptions { is_recorded: true, ..SessionOptions::default() }
}

fn block() -> SoundScene {
    Scene { desc: toml::from_str::<SceneDesc>(BLOCK).unwrap(), meshes: Default::default() }.judge().unwrap()
}

fn limits() -> SessionLimits {
    SessionLimits { max_sessions: 2, max_viewers: 2, ..SessionLimits::default() }
}

async fn session_with(limits: SessionLimits) -> (Registry, Arc<Session>) {
    let registry = Registry::new(limits, ParetoFronts::default()).unwrap();
    let session = registry.create(block(), recorded()).await.unwrap();
    (registry, session)
}

/// Above the block, so that nothing is touched.
fn pose(seq: u64, x_m: f64) -> PoseSample {
    let pose = Pose { position_m: Vec3::new(x_m, 0.1, 0.0), ..Pose::default() };
    PoseSample { seq, client_ns: seq * 10, pose, opening: OPEN }
}

fn placed(position_m: [f64; 3], sample: PoseSample) -> PoseSample {
    PoseSample { pose: Pose { position_m: position_m.into(), ..sample.pose }, ..sample }
}

/// The edge turned and tilted: it crosses the links one after another.
fn askew(seq: u64) -> PoseSample {
    let orientation = Quat::from_axis_angle(&Vec3::y_axis(), 0.4) * Quat::from_axis_angle(&Vec3::z_axis(), 0.3);
    let sample = pose(seq, 0.0);
    PoseSample { pose: Pose { orientation, ..sample.pose }, ..sample }
}

/// Submits a pose and waits until a step has used it.
async fn use_pose(driver: &Driver, tool: usize, sample: &PoseSample) {
    driver.submit(tool, sample).unwrap();
    report_where(driver, |report| report.tools[tool].echo.is_some_and(|echo| echo.seq == sample.seq)).await;
}

pub async fn report_where(driver: &Driver, holds: impl Fn(&StepReport) -> bool) -> Arc<StepReport> {
    let mut reports = driver.reports();
    let search = async {
        loop {
            let report = reports.next().await.expect("the session lives");
            if holds(&report) {
                return report;
            }
        }
    };
    tokio::time::timeout(Duration::from_secs(60), search).await.expect("a report in time")
}

async fn message_where(viewer: &mut Viewer, holds: impl Fn(&ViewMessage) -> bool) -> ViewMessage {
    let search = async {
        loop {
            let message = viewer.next().await.expect("the session lives");
            if holds(&message) {
                return message;
            }
        }
    };
    tokio::time::timeout(Duration::from_secs(60), search).await.expect("a message in time")
}

fn is_event(message: &ViewMessage, event: &SceneEvent) -> bool {
    matches!(message, ViewMessage::Event(happened) if happened.event == *event)
}

#[tokio::test]
async fn a_report_echoes_the_pose_that_its_step_used() {
    let (_registry, session) = session_with(limits()).await;
    let driver = session.drive(&[1]).unwrap();
    driver.submit(1, &pose(7, 0.0)).unwrap();
    let report = report_where(&driver, |report| report.tools[1].echo.is_some()).await;
    let echo = report.tools[1].echo.unwrap();
    assert_eq!((echo.seq, echo.client_ns), (7, 70));
    assert_eq!(report.tools[0].echo, None);
}

#[tokio::test]
async fn a_driver_that_ends_frees_its_tools_at_once() {
    let (_registry, session) = session_with(limits()).await;
    drop(session.drive(&[0, 1]).unwrap());
    assert!(session.drive(&[1]).is_ok());
}

#[tokio::test]
async fn only_claimed_tools_of_the_scene_are_driven() {
    let (_registry, session) = session_with(limits()).await;
    let driver = session.drive(&[0]).unwrap();
    assert_eq!(driver.submit(1, &pose(1, 0.0)), Err(PoseRefusal::NotClaimed { tool: 1 }));
    assert_eq!(driver.submit(9, &pose(1, 0.0)), Err(PoseRefusal::NoTool { tool: 9, tools: 2 }));
    assert!(matches!(session.drive(&[9]), Err(SessionError::NoTool { .. })));
}

#[tokio::test]
async fn a_tool_that_jumps_is_put_down_where_it_went() {
    let (_registry, session) = session_with(limits()).await;
    let driver = session.drive(&[0]).unwrap();
    driver.submit(0, &pose(1, 0.0)).unwrap();
    report_where(&driver, |report| report.tools[0].echo.is_some()).await;
    assert!(matches!(driver.submit(0, &pose(2, 0.8)), Err(PoseRefusal::TooFast { .. })));
    driver.submit(0, &pose(3, 0.8)).unwrap();
    let report = report_where(&driver, |report| report.tools[0].jumps == 1).await;
    assert_eq!(report.tools[0].echo.map(|echo| echo.seq), Some(3));
}

#[tokio::test]
async fn a_viewer_gets_a_keyframe_then_a_state_of_its_version_then_more_states() {
    let (_registry, session) = session_with(limits()).await;
    let mut viewer = session.view().unwrap();
    let Some(ViewMessage::Keyframe(keyframe)) = viewer.next().await else { panic!("a keyframe comes first") };
    let Some(ViewMessage::State(first)) = viewer.next().await else { panic!("a state follows") };
    assert_eq!(first.topology_version, keyframe.topology_version);
    assert_eq!(first.node_displacements_m.len(), 1);
    let later = message_where(&mut viewer, |message| matches!(message, ViewMessage::State(_))).await;
    assert!(matches!(later, ViewMessage::State(state) if state.step > first.step && state.times.steps > 0));
}

#[tokio::test]
async fn a_viewer_of_a_standing_session_gets_keyframe_and_state() {
    let registry = Registry::new(limits(), ParetoFronts::default()).unwrap();
    let session =
        registry.create(block(), SessionOptions { start_paused: true, ..SessionOptions::default() }).await.unwrap();
    let mut viewer = session.view().unwrap();
    assert!(matches!(viewer.next().await, Some(ViewMessage::Keyframe(_))));
    assert!(matches!(viewer.next().await, Some(ViewMessage::State(state)) if state.step == 0));
    assert_eq!(session.describe().await.unwrap().step, 0);
}

#[tokio::test]
async fn viewers_hear_of_tools_that_change_hands() {
    let (_registry, session) = session_with(limits()).await;
    let mut viewer = session.view().unwrap();
    viewer.next().await;
    let driver = session.drive(&[1]).unwrap();
    message_where(&mut viewer, |message| is_event(message, &SceneEvent::ToolTaken(1))).await;
    drop(driver);
    message_where(&mut viewer, |message| is_event(message, &SceneEvent::ToolReleased(1))).await;
}

#[tokio::test]
async fn closing_ends_viewers_and_drivers_and_frees_the_place() {
    let (registry, session) = session_with(SessionLimits { max_sessions: 1, ..limits() }).await;
    let full = registry.create(block(), SessionOptions::default()).await;
    assert!(matches!(full, Err(SessionError::TooManySessions { limit: 1 })));
    let mut viewer = session.view().unwrap();
    let driver = session.drive(&[0]).unwrap();
    registry.close(&session.id().to_string()).await.unwrap();
    message_where(&mut viewer, |message| is_event(message, &SceneEvent::Closing)).await;
    assert!(viewer.next().await.is_none());
    let mut reports = driver.reports();
    while reports.next().await.is_some() {}
    assert_eq!(session.pause().await, Err(SessionError::Closed));
    assert!(registry.create(block(), SessionOptions::default()).await.is_ok());
}

/// A client that goes away when the scene is just built, and nobody has heard of that yet.
#[tokio::test]
async fn a_session_that_was_given_up_when_it_was_built_frees_its_place() {
    let registry = Registry::new(SessionLimits { max_sessions: 1, ..limits() }, ParetoFronts::default()).unwrap();
    let mut creation = Box::pin(registry.create(block(), SessionOptions::default()));
    let waits = Duration::from_secs(1);
    // The scene is judged, then built, each on a thread of its own while nobody looks.
    for _ in 0..2 {
        assert!(creation.as_mut().poll(&mut Context::from_waker(Waker::noop())).is_pending());
        tokio::time::sleep(waits).await;
    }
    drop(creation);
    let place = async {
        while registry.create(block(), SessionOptions::default()).await.is_err() {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    };
    tokio::time::timeout(Duration::from_secs(60), place).await.expect("the place is free again");
}

#[tokio::test]
async fn who_asks_for_a_session_that_comes_back_is_told_to_ask_again() {
    let registry = Registry::new(limits(), ParetoFronts::default()).unwrap();
    let id: SessionId = "session-0000002a-7".parse().unwrap();
    registry.expect([id]);
    let comes_back = || SessionError::ComesBack { id: id.to_string() };
    assert_eq!(registry.get(&id.to_string()).err(), Some(comes_back()));
    assert_eq!(registry.close(&id.to_string()).await, Err(comes_back()));
    assert_eq!(
        registry.get("session-0000002a-8").err(),
        Some(SessionError::NoSession { id: "session-0000002a-8".into() })
    );
    let unreadable = || Err(SessionError::Failed { message: "the journal is damaged".into() });
    assert!(registry.bring_back(id, unreadable, SessionOptions::default()).await.is_err());
    assert_eq!(registry.get(&id.to_string()).err(), Some(SessionError::NoSession { id: id.to_string() }));
    registry.expect([id]);
    registry
        .bring_back::<SessionError>(id, || Ok((block(), Past::default())), SessionOptions::default())
        .await
        .unwrap();
    assert!(registry.get(&id.to_string()).is_ok() && registry.expected() == 0);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_panic_fails_its_session_alone() {
    let registry = Registry::new(limits(), ParetoFronts::default()).unwrap();
    let broken = registry.create(block(), SessionOptions::default()).await.unwrap();
    let other = registry.create(block(), SessionOptions::default()).await.unwrap();
    let driver = broken.drive(&[0]).unwrap();
    let answer = broken.query(|_| -> u64 { panic!("a test's panic") }).await;
    assert!(matches!(answer, Err(SessionError::Failed { .. })));
    let report = report_where(&driver, |report| report.phase.failure().is_some()).await;
    assert_eq!(report.phase.failure(), Some("a test's panic"));
    assert!(matches!(broken.drive(&[1]), Err(SessionError::Failed { .. })));
    let witness = other.drive(&[0]).unwrap();
    let step = other.describe().await.unwrap().step;
    report_where(&witness, |report| report.step > step).await;
    broken.reset().await.unwrap();
    broken.resume().await.unwrap();
    // One that begins now hears nothing of the failure before its time.
    let later = broken.drive(&[1]).unwrap();
    assert!(later.reports().next().await.unwrap().phase.failure().is_none());
    report_where(&driver, |report| report.phase.failure().is_none() && report.step > 0).await;
}

#[tokio::test]
async fn viewers_are_limited_and_one_that_leaves_makes_room() {
    let (_registry, session) = session_with(limits()).await;
    let first = session.view().unwrap();
    let _second = session.view().unwrap();
    assert!(matches!(session.view(), Err(SessionError::TooManyViewers { limit: 2 })));
    drop(first);
    assert!(session.view().is_ok());
}

#[tokio::test]
async fn a_recorded_cut_leads_to_the_same_state_once_more() {
    let (_registry, session) = session_with(limits()).await;
    let driver = session.drive(&[0, 1]).unwrap();
    // What was before a reset is recorded too.
    use_pose(&driver, 1, &pose(1, 0.0)).await;
    session.reset().await.unwrap();
    for seq in 2..=70 {
        use_pose(&driver, 0, &placed([0.0, 0.012 - 2e-4 * seq as f64, 4e-4], askew(seq))).await;
        match seq {
            20 => use_pose(&driver, 1, &pose(seq, 0.05)).await,
            40 => driver.lift(1).unwrap(),
            50 => {
                // Tools go on while the session stands, and are put down where they are then.
                session.pause().await.unwrap();
                driver.submit(1, &pose(seq, 0.3)).unwrap();
                session.resume().await.unwrap();
            }
            60 => driver.lift(0).unwrap(),
            _ => {}
        }
    }
    session.pause().await.unwrap();
    let live = session.describe().await.unwrap();
    assert!(live.topology_version >= 4, "{} times links parted", live.topology_version);
    let (entries, state) = session.take_reel().unwrap().tape.take();
    assert_eq!(state, TapeState::Running);
    let steps = entries.iter().filter_map(|entry| match entry {
        TapeEntry::Step(taped) => Some(&taped.inputs),
        TapeEntry::Event(_) | TapeEntry::Checkpoint(..) | TapeEntry::Base(_) => None,
    });
    let kinds: HashSet<_> =
        steps.flat_map(|inputs| &inputs.tools).map(|input| std::mem::discriminant(&input.motion)).collect();
    assert_eq!(kinds.len(), 3, "tools enter, move and are lifted");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    let scene = block();
    for workers in [Workers::serial(), Workers::of(&pool)] {
        let mut again = Resimulation::new(&scene).unwrap();
        again.follow(&workers, &entries).unwrap();
        assert_eq!(again.world().output().topology_version, live.topology_version);
        assert_eq!(again.world().state_hash(), live.state_hash);
    }
}

/// The block with a grasper beside its blades.
fn block_with_a_grasper() -> SoundScene {
    let grasper = GrasperDesc::new(0.005);
    block().with(|desc| desc.tools.push(ToolDesc::grasper("grasper", grasper))).unwrap()
}

#[tokio::test]
async fn two_drivers_hold_and_cut_the_same_tissue() {
    let registry = Registry::new(limits(), ParetoFronts::default()).unwrap();
    let scene = block_with_a_grasper();
    let session = registry.create(scene.clone(), recorded()).await.unwrap();
    let (knife, hand) = (session.drive(&[0]).unwrap(), session.drive(&[2]).unwrap());
    let held_at = [0.008, 0.009, 0.0];
    let closed =
        |seq, x_m| PoseSample { opening: 0.0, ..placed([held_at[0] + x_m, held_at[1], held_at[2]], pose(seq, 0.0)) };
    use_pose(&hand, 2, &placed(held_at, pose(1, 0.0))).await;
    use_pose(&hand, 2, &closed(2, 0.0)).await;
    // Jaws take their time.
    report_where(&hand, |report| report.tools[2].output.grasp == Grasp::Holding).await;
    for seq in 3..=20 {
        use_pose(&hand, 2, &closed(seq, 5e-5 * seq as f64)).await;
        assert_eq!(hand.last_report().unwrap().tools[2].output.grasp, Grasp::Holding);
    }
    let pulled = hand.last_report().unwrap();
    assert!(pulled.tools[2].output.wrench.force_n.x < 0.0, "{:?}", pulled.tools[2].output.wrench);
    for seq in 2..=60 {
        let down = placed([-0.004, 0.012 - 2e-4 * seq as f64, 4e-4], askew(seq));
        use_pose(&knife, 0, &down).await;
        use_pose(&hand, 2, &closed(20 + seq, 1e-3)).await;
    }
    let cut = hand.last_report().unwrap();
    assert_eq!(cut.tools[2].output.grasp, Grasp::Holding);
    assert!(session.describe().await.unwrap().topology_version > 0, "the blade cuts meanwhile");
    assert_eq!((cut.tools[0].echo.unwrap().seq, cut.tools[2].echo.unwrap().seq), (60, 80));
    use_pose(&hand, 2, &PoseSample { opening: 1.0, ..closed(81, 1e-3) }).await;
    report_where(&hand, |report| report.tools[2].output.grasp == Grasp::Nothing).await;
    session.pause().await.unwrap();
    let (entries, _) = session.take_reel().unwrap().tape.take();
    Resimulation::new(&scene).unwrap().follow(&Workers::serial(), &entries).unwrap();
}

#[tokio::test]
async fn a_scene_with_a_rate_out_of_bounds_is_refused() {
    let limits = SessionLimits { max_rate_hz: 499.0, ..limits() };
    let registry = Registry::new(limits, ParetoFronts::default()).unwrap();
    let refused = registry.create(block(), SessionOptions::default()).await;
    assert!(matches!(refused, Err(SessionError::Rate { .. })));
}

#[tokio::test]
async fn a_server_that_shuts_down_creates_nothing_and_ends_everything() {
    let (registry, session) = session_with(limits()).await;
    registry.close_all().await;
    assert!(matches!(registry.create(block(), SessionOptions::default()).await, Err(SessionError::Draining { .. })));
    assert_eq!(session.phase(), Phase::Closing);
    assert!(registry.list().is_empty());
}
