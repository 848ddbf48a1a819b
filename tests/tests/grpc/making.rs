//! What is told of a session that is being made.

use kerf_proto::v1::create_session_request::Scene;
use kerf_proto::v1::make_session_response::State;
use kerf_proto::v1::{self, MakingStage};
use tonic::Code;

use super::harness::{BLOCK, Harness, soon};

fn request(scene_toml: String) -> v1::MakeSessionRequest {
    let scene = Some(Scene::SceneToml(scene_toml));
    v1::MakeSessionRequest { request: Some(v1::CreateSessionRequest { scene, ..Default::default() }) }
}

/// Under prestrain, and so fine that a stage takes its time.
fn taut_block() -> String {
    let finer = BLOCK.replace("resolution = 6", "resolution = 32");
    finer.replace("poisson_ratio = 0.4,", "poisson_ratio = 0.4, prestrain = { strain = 0.05 },")
}

#[tokio::test(flavor = "multi_thread")]
async fn a_session_that_is_made_tells_how_far_it_is_and_comes_last() {
    let mut harness = Harness::start().await;
    let mut told = harness.sessions.make_session(request(taut_block())).await.unwrap().into_inner();
    let mut progress: Vec<v1::MakingProgress> = Vec::new();
    let created = loop {
        match soon("progress", told.message()).await.unwrap().expect("the session is last").state.unwrap() {
            State::Progress(next) => progress.push(next),
            State::Created(created) => break created,
        }
    };
    assert!(soon("the end", told.message()).await.unwrap().is_none());
    // Of what follows fast upon another, the last is told.
    assert_eq!(progress[0].stage(), MakingStage::Reading);
    assert!(progress.is_sorted_by_key(|made| made.stage) && progress.is_sorted_by(|a, b| a.share <= b.share));
    let last = progress.last().unwrap();
    let object = &created.session.unwrap().scene.unwrap().objects[0];
    assert_eq!((last.stage(), last.objects, last.object), (MakingStage::Equilibrium, 1, 0), "{progress:?}");
    assert_eq!(last.voxels, u64::from(object.voxels));
    assert_eq!(last.composite_elements, u64::from(object.composite_elements));
    let settling = progress.iter().filter(|made| made.stage() == MakingStage::Equilibrium).count();
    assert!(settling > 2 && last.share > 0.65, "{progress:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_scene_that_is_none_is_refused_as_by_create_session_and_who_stops_listening_creates_nothing() {
    let mut harness = Harness::start().await;
    let none = BLOCK.replace("poisson_ratio = 0.4", "poisson_ratio = 0.6");
    let mut told = harness.sessions.make_session(request(none.clone())).await.unwrap().into_inner();
    let refused = loop {
        match told.message().await {
            Ok(message) => assert!(matches!(message.unwrap().state, Some(State::Progress(_)))),
            Err(refused) => break refused,
        }
    };
    let by_create = harness.create_of(none).await.unwrap_err();
    assert_eq!((refused.code(), refused.message()), (Code::InvalidArgument, by_create.message()));

    let nothing = harness.sessions.make_session(v1::MakeSessionRequest::default()).await.unwrap_err();
    assert!(nothing.code() == Code::InvalidArgument && nothing.message().contains("request"), "{nothing}");

    let mut told = harness.sessions.make_session(request(taut_block())).await.unwrap().into_inner();
    soon("the first word", told.message()).await.unwrap();
    drop(told);
    // Whoever takes the place that it had is built after it.
    soon("a session", harness.create()).await.unwrap();
    assert_eq!(harness.server.registry().list().len(), 1);
}
