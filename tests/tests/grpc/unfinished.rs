//! Calls that are begun and not ended: they hold nothing that others need.

use kerf_proto::v1::{self, create_session_request};
use prost::Message;

use super::frames::Frames;
use super::harness::{BLOCK, Harness, soon};

const CREATE: &str = "/kerf.v1.SessionService/CreateSession";

/// The message of a call that creates a session, with what gRPC puts before it.
fn create() -> Vec<u8> {
    let scene = Some(create_session_request::Scene::SceneToml(BLOCK.into()));
    let message = v1::CreateSessionRequest { scene, ..Default::default() }.encode_to_vec();
    [&[0], &(message.len() as u32).to_be_bytes()[..], &message].concat()
}

#[tokio::test]
async fn messages_that_never_end_hold_up_no_call() {
    let mut harness = Harness::start().await;
    let mut frames = Frames::open(harness.server.address()).await;
    let whole = create();
    for call in 0..32 {
        frames.call(2 * call + 1, CREATE);
        frames.data(2 * call + 1, &whole[..whole.len() / 2], false);
    }
    assert!(frames.is_answered().await);
    assert!(soon("a list", harness.sessions.list_sessions(v1::ListSessionsRequest {})).await.is_ok());
    let session = soon("a session", harness.create()).await.unwrap();
    assert_eq!(harness.describe(&session).await.scene.unwrap().name, "block");
}

#[tokio::test]
async fn large_messages_that_never_end_give_way_and_those_of_others_do_not() {
    let mut harness = Harness::with(|config| {
        config.transport.max_incoming_bytes = 64;
        config.transport.max_large_requests = 4;
    })
    .await;
    let address = harness.server.address();
    let (whole, mut greedy) = (create(), Frames::open(address).await);
    let half = whole.len() / 2;
    let mut begin = async |calls: std::ops::Range<u32>| {
        for call in calls {
            greedy.call(2 * call + 1, CREATE);
            greedy.data(2 * call + 1, &whole[..half], false);
        }
        assert!(greedy.is_answered().await);
    };
    begin(0..4).await;
    let mut other = Frames::open(address).await;
    other.call(1, CREATE);
    other.data(1, &whole[..half], false);
    assert!(other.is_answered().await);
    begin(4..12).await;
    soon("a session beside them", harness.create()).await.unwrap();
    other.data(1, &whole[half..], true);
    other.send().await;
    assert!(other.answer(1).await.begins_an_answer(), "a session, and no error");
}

#[tokio::test]
async fn a_large_message_that_gives_way_is_told_so() {
    let harness = Harness::with(|config| {
        config.transport.max_incoming_bytes = 64;
        config.transport.max_large_requests = 1;
    })
    .await;
    let (whole, mut frames) = (create(), Frames::open(harness.server.address()).await);
    frames.call(1, CREATE);
    frames.data(1, &whole[..whole.len() / 2], false);
    assert!(frames.is_answered().await);
    frames.call(3, CREATE);
    frames.data(3, &whole, true);
    frames.send().await;
    assert!(!frames.answer(1).await.begins_an_answer(), "it is refused");
}

#[tokio::test]
async fn a_hundred_calls_that_are_cancelled_at_once_end_no_other() {
    let harness = Harness::start().await;
    let mut frames = Frames::open(harness.server.address()).await;
    for call in 0..100 {
        frames.call(2 * call + 1, "/kerf.v1.ViewService/Acknowledge");
        frames.cancel(2 * call + 1);
    }
    assert!(frames.is_answered().await, "the connection ended");
    frames.call(1001, "/kerf.v1.SessionService/ListScenes");
    frames.data(1001, &[0; 5], true);
    frames.send().await;
    assert!(frames.answer(1001).await.begins_an_answer());
}
