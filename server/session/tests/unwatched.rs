//! A scene that nobody watches any more.

use std::time::Duration;

use kerf_physics::tool::{OPEN, Pose};
use kerf_physics::{Scene, SceneDesc, Stage, Vec3, Workers};
use kerf_scenes::dial::Fronts;
use kerf_session::{PoseSample, Registry, SessionLimits, SessionOptions, ViewMessage};

const BLOCK: &str = r#"
version = 1
name = "block"
rate_hz = 500.0

[[objects]]
name = "block"
shape = { box = { min_m = [-0.01, -0.01, -0.01], max_m = [0.01, 0.01, 0.01] } }
resolution = 4
level = 1
material = { young_modulus_pa = 3000.0, poisson_ratio = 0.4, fracture_energy_j_per_m2 = 5.0 }
fixed = [{ box = { min_m = [-0.02, -0.02, -0.02], max_m = [0.02, -0.005, 0.02] } }]

[[tools]]
name = "blade"
shape = { blade = { width_m = 0.03, height_m = 0.02 } }
"#;

#[tokio::test]
async fn after_the_last_viewer_nothing_is_contoured_and_the_next_one_sees_the_surface_as_it_is() {
    let registry = Registry::new(SessionLimits::default(), Fronts::default()).unwrap();
    let scene = Scene { desc: toml::from_str::<SceneDesc>(BLOCK).unwrap(), meshes: Default::default() };
    let session = registry.create(scene, SessionOptions::default()).await.unwrap();
    let mut first = session.view().unwrap();
    assert!(matches!(first.next().await, Some(ViewMessage::Keyframe(_))));
    drop(first);
    // An answer comes at the start of a step, so the second one after a whole step without a viewer.
    session.describe().await.unwrap();
    session.describe().await.unwrap();

    let driver = session.drive(&[0]).unwrap();
    for seq in 1..100 {
        let pose = Pose { position_m: Vec3::new(0.0, 0.012 - 3e-4 * seq as f64, 0.0), ..Pose::default() };
        driver.submit(0, &PoseSample { seq, client_ns: 0, pose, opening: OPEN }).unwrap();
        tokio::time::sleep(Duration::from_millis(4)).await;
        if session.describe().await.unwrap().topology_version > 2 {
            break;
        }
    }
    session.pause().await.unwrap();

    let mut second = session.view().unwrap();
    let Some(ViewMessage::Keyframe(keyframe)) = second.next().await else { panic!("a keyframe comes first") };
    assert!(keyframe.topology_version > 2, "the block was cut");
    let Some(ViewMessage::State(state)) = second.next().await else { panic!("a state follows") };
    // The first state sums up all steps since the one that the first viewer saw.
    assert!(state.times.stage_ns[Stage::Topology as usize] > 0);
    assert_eq!(state.times.stage_ns[Stage::Surface as usize], 0);
    let log = session.query(|probe| probe.log.clone()).await.unwrap();
    let mut replayed = log.replay(session.scene(), &Workers::serial()).unwrap();
    assert_eq!(replayed.surface_hash(), keyframe.surface_hash);
}
