//! A session that cannot keep its deadlines gives up accuracy within its scene's bounds, and replays.

use std::sync::Arc;
use std::time::Duration;

use kerf_physics::scene::GovernorDesc;
use kerf_physics::{NoClock, Scene, SceneDesc, Workers, World};
use kerf_scenes::dial::Fronts;
use kerf_session::{Registry, SceneEvent, Session, SessionLimits, SessionOptions, ViewMessage};

/// The block as full FEM on more voxels, at a rate that no machine keeps, sagging.
fn costly() -> Scene {
    let mut desc: SceneDesc = toml::from_str(include_str!("block.toml")).unwrap();
    desc.rate_hz = 4000.0;
    desc.gravity_m_per_s2 = [0.0, -9.81, 0.0];
    desc.governor = Some(GovernorDesc { max_relative_tolerance: 0.02 });
    desc.objects[0].resolution = Some(9);
    desc.objects[0].level = 0;
    Scene { desc, meshes: Default::default() }
}

async fn start(scene: Scene) -> (Registry, Arc<Session>) {
    let registry = Registry::new(SessionLimits::default(), Fronts::default()).unwrap();
    let session = registry.create(scene, SessionOptions::default()).await.unwrap();
    (registry, session)
}

#[tokio::test]
async fn late_steps_are_met_with_less_accuracy_which_clients_are_told_and_a_replay_repeats() {
    let (_registry, session) = start(costly()).await;
    let mut viewer = session.view().unwrap();
    let mut told = Vec::new();
    let wait = async {
        while told.last() != Some(&0.02) {
            if let ViewMessage::Event(happened) = viewer.next().await.expect("the session lives")
                && let SceneEvent::ToleranceChanged(tolerance) = happened.event
            {
                told.push(tolerance);
            }
        }
    };
    tokio::time::timeout(Duration::from_secs(60), wait).await.expect("the bound is reached");
    assert!(told.len() >= 2 && told.windows(2).all(|pair| pair[0] < pair[1]), "rung by rung: {told:?}");

    session.pause().await.unwrap();
    assert_eq!(session.describe().await.unwrap().relative_tolerance, 0.02);
    let (log, hash) = session.query(|probe| (probe.log.clone(), probe.world.state_hash())).await.unwrap();
    assert_eq!(log.replay(session.scene(), &Workers::serial()).unwrap().state_hash(), hash);
    let mut exact = World::new(session.scene()).unwrap();
    for inputs in log.inputs() {
        exact.step(&Workers::serial(), &NoClock, &kerf_physics::StepInputs::of(&inputs.tools));
    }
    assert_ne!(exact.state_hash(), hash, "what the governor did is part of the log");

    session.reset().await.unwrap();
    assert_eq!(session.describe().await.unwrap().relative_tolerance, 1e-3);
}

#[tokio::test]
async fn without_bounds_nothing_is_given_up() {
    let mut scene = costly();
    scene.desc.governor = None;
    let (_registry, session) = start(scene).await;
    while session.describe().await.unwrap().late_steps < 1000 {
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    assert_eq!(session.describe().await.unwrap().relative_tolerance, 1e-3);
    session.pause().await.unwrap();
    let log = session.query(|probe| probe.log.clone()).await.unwrap();
    assert!(log.inputs().all(|inputs| inputs.relative_tolerance.is_none()));
}
