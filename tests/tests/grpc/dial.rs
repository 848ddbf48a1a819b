//! What a client asks of the dial over the network, and what it is told.

use kerf_physics::scene::ElementKind;
use kerf_physics::{Scene, SceneDesc};
use kerf_proto::v1::create_session_request::{Dial, Scene as Source};
use kerf_proto::v1::{self};
use kerf_scenes::dial::{FinerRegions, ParetoFront, ParetoPoint};
use tonic::{Code, Status};

use super::harness::{BLOCK, Harness};

/// A folder with a Pareto front of the block: level 1 in 0.1 ms with 8 %, level 0 in 0.9 ms with 1 %.
fn measured() -> tempfile::TempDir {
    let scene = Scene { desc: SceneDesc::from_toml("block", BLOCK).unwrap(), meshes: Default::default() };
    let point = |level, median_ms, error| ParetoPoint {
        level,
        voxel_scale: 1.0,
        rate_hz: scene.desc.rate_hz,
        relative_tolerance: 1e-4,
        element: ElementKind::IncompatibleModes,
        finer: FinerRegions::LeftOut,
        elements: 1,
        displacement_rms_error: error,
        displacement_max_error: 0.0,
        force_rms_error: error / 2.0,
        cut_depth_error: 0.0,
        cut_area_error: 0.0,
        energy_residual: 0.0,
        median_ms,
        p99_ms: 2.0 * median_ms,
        memory_mib: 10.0,
    };
    let mut pareto = ParetoFront { points: vec![point(1, 0.1, 0.08), point(0, 0.9, 0.01)], ..ParetoFront::of(&scene) };
    pareto.notes.insert("hardware".into(), "an abacus".into());
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("block.csv"), pareto.to_csv()).unwrap();
    folder
}

async fn create(harness: &mut Harness, scene: String, dial: Option<Dial>) -> Result<v1::SessionDescription, Status> {
    let request = v1::CreateSessionRequest {
        scene: Some(Source::SceneToml(scene)),
        start_paused: true,
        dial,
        ..Default::default()
    };
    Ok(harness.sessions.create_session(request).await?.into_inner().session.unwrap())
}

#[tokio::test]
async fn a_budget_or_an_error_chooses_on_the_measured_pareto_front_and_is_told() {
    let folder = measured();
    let mut harness = Harness::with(|config| config.pareto_dir = Some(folder.path().into())).await;
    let level_of =
        |described: &v1::SessionDescription| described.dial.as_ref().unwrap().setting.as_ref().unwrap().level;
    let coarse = create(&mut harness, BLOCK.into(), Some(Dial::BudgetMs(0.5))).await.unwrap();
    assert_eq!((level_of(&coarse), coarse.relative_tolerance), (1, 1e-4));
    let exact = create(&mut harness, BLOCK.into(), Some(Dial::MaxError(0.02))).await.unwrap();
    assert_eq!(level_of(&exact), 0);
    let elements = |described: &v1::SessionDescription| described.scene.as_ref().unwrap().objects[0].composite_elements;
    assert!(elements(&exact) > 4 * elements(&coarse), "{} and {}", elements(&exact), elements(&coarse));
    let expected = exact.dial.unwrap().expected.unwrap();
    assert_eq!((expected.median_ms, expected.displacement_error, expected.force_error), (0.9, 0.01, 0.005));
    assert_eq!(expected.hardware, "an abacus");
    // The scene itself may ask, too.
    let asking = BLOCK.replacen("rate_hz", "dial = { max_error = 0.05 }\nrate_hz", 1);
    assert_eq!(level_of(&create(&mut harness, asking, None).await.unwrap()), 0);
    assert_eq!(create(&mut harness, BLOCK.into(), None).await.unwrap().dial, None);
}

#[tokio::test]
async fn wishes_that_cannot_be_fulfilled_are_refused_with_what_could() {
    let folder = measured();
    let mut harness = Harness::with(|config| config.pareto_dir = Some(folder.path().into())).await;
    let mut refused = async |scene: String, dial, code, words: &str| {
        let status = create(&mut harness, scene, Some(dial)).await.unwrap_err();
        assert_eq!(status.code(), code);
        assert!(status.message().contains(words), "{}", status.message());
    };
    refused(BLOCK.into(), Dial::BudgetMs(0.05), Code::FailedPrecondition, "nearest that can be had is 0.1000").await;
    refused(BLOCK.into(), Dial::MaxError(1e-3), Code::FailedPrecondition, "max_error = 0.001").await;
    refused(BLOCK.into(), Dial::MaxError(f64::NAN), Code::InvalidArgument, "max_error = NaN").await;
    refused(BLOCK.into(), Dial::Level(9), Code::InvalidArgument, "objects[0].level: 9 is not between 0 and 4").await;
    let other = BLOCK.replace("3.0e4", "3.1e4");
    refused(other, Dial::MaxError(0.5), Code::FailedPrecondition, "no Pareto front was measured for scene `block`")
        .await;
}

#[tokio::test]
async fn a_level_needs_no_pareto_front() {
    let mut harness = Harness::start().await;
    let described = create(&mut harness, BLOCK.into(), Some(Dial::Level(0))).await.unwrap();
    let dial = described.dial.unwrap();
    assert_eq!((dial.setting.unwrap().level, dial.expected), (0, None));
}
