//! The recorded view streams of proto/vectors, which decoders in every language are checked by.

use std::path::PathBuf;

use kerf_proto::v1::{self, ViewResponse, view_response};
use kerf_replica::{Assembler, Replica};
use prost::Message;
use serde::{Deserialize, Serialize};

use super::cut::{ABOVE_M, FOOT_M, Stroke};
use super::harness::{Harness, View, no_expiry, soon, view_request};

/// So that the keyframe comes in several.
const MAX_MESSAGE_BYTES: usize = 4096;
/// Of each object, in the order of their ids, these are told.
const EVERY_VERTEX: usize = 37;

/// What a decoder has to make of a message, once it is whole.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Expected {
    message: String,
    topology_version: Option<u64>,
    /// Of a keyframe or patch, in hexadecimal digits; not of plain vertices.
    #[serde(skip_serializing_if = "Option::is_none")]
    surface_hash: Option<String>,
    /// Vertices and quads of all objects.
    counts: (usize, usize),
    /// Present after a state.
    #[serde(skip_serializing_if = "Option::is_none")]
    shown: Option<Vec<Vertex>>,
}

#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Vertex {
    object: usize,
    id: u32,
    position_m: [f32; 3],
}

fn path(name: &str) -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../proto/vectors")).join(name)
}

fn messages(mut file: &[u8]) -> Vec<ViewResponse> {
    let mut messages = Vec::new();
    while let Some((length, rest)) = file.split_first_chunk::<4>() {
        let (message, rest) = rest.split_at(u32::from_le_bytes(*length) as usize);
        messages.push(ViewResponse::decode(message).expect("a message"));
        file = rest;
    }
    messages
}

fn replayed(messages: &[ViewResponse]) -> Vec<Expected> {
    let (mut assembler, mut replica) = (Assembler::default(), Replica::default());
    let wholes = messages.iter().filter_map(|part| assembler.take(part.clone()).expect("fragments that fit"));
    let wholes: Vec<ViewResponse> = wholes.collect();
    wholes
        .iter()
        .map(|whole| {
            let message = whole.message.as_ref().expect("a message that says something");
            replica.apply(message).expect("a message that applies");
            expected(message, &replica)
        })
        .collect()
}

fn expected(message: &view_response::Message, replica: &Replica) -> Expected {
    let (name, stated_hash) = match message {
        view_response::Message::Keyframe(keyframe) => ("keyframe", Some(keyframe.surface_hash)),
        view_response::Message::Patch(patch) => ("patch", Some(patch.surface_hash)),
        view_response::Message::State(_) => ("state", None),
        view_response::Message::Hello(_) => ("hello", None),
        view_response::Message::Event(_) => ("event", None),
        view_response::Message::Fault(_) => ("fault", None),
        view_response::Message::Fragment(_) => unreachable!("it was put together"),
    };
    let bodies = replica.bodies();
    Expected {
        message: name.into(),
        topology_version: replica.topology_version(),
        surface_hash: stated_hash.filter(|hash| *hash != 0).map(|hash| format!("{hash:016x}")),
        counts: (
            bodies.iter().map(|body| body.vertices().len()).sum(),
            bodies.iter().map(|body| body.quads().len()).sum(),
        ),
        shown: (name == "state").then(|| shown(replica)),
    }
}

/// Some vertices of each object, and some of those that are adapted.
fn shown(replica: &Replica) -> Vec<Vertex> {
    let of_object = |(object, body): (usize, &kerf_replica::Body)| {
        let some = body.vertices().keys().copied().step_by(EVERY_VERTEX);
        let adapted = body.adapted_offsets_m().keys().copied().step_by(11);
        let mut ids: Vec<u32> = some.chain(adapted).collect();
        ids.sort_unstable();
        ids.dedup();
        let vertex = |id| Vertex { object, id, position_m: body.position_m(id, &body.vertices()[&id]) };
        ids.into_iter().map(vertex).collect::<Vec<_>>()
    };
    replica.bodies().iter().enumerate().flat_map(of_object).collect()
}

/// A stroke through the block, as a viewer gets it.
async fn record(encoding: v1::SurfaceEncoding) -> Vec<ViewResponse> {
    let mut harness = Harness::with(|config| {
        no_expiry(config);
        config.view.max_message_bytes = MAX_MESSAGE_BYTES;
    })
    .await;
    let session = harness.create().await.unwrap();
    let request = v1::ViewRequest { encoding: encoding.into(), ..view_request(&session) };
    let mut view = harness.view_as(harness.channel.clone(), request).await.unwrap();
    let mut messages = vec![ViewResponse {
        message: Some(view_response::Message::Hello(v1::ViewHello {
            protocol_version: kerf_proto::PROTOCOL_VERSION,
            viewer: view.viewer.clone(),
            ..v1::ViewHello::default()
        })),
        number: 0,
    }];
    let mut assembler = Assembler::default();
    let mut stroke = Stroke::begin(&harness, &session).await;
    let mut press = std::pin::pin!(stroke.press(ABOVE_M, FOOT_M));
    loop {
        tokio::select! {
            () = &mut press => return messages,
            part = part(&mut view, &mut assembler) => messages.push(part),
        }
    }
}

/// What comes next, acknowledged once it is whole.
async fn part(view: &mut View, assembler: &mut Assembler) -> ViewResponse {
    let part = soon("a part", view.stream.message()).await.expect("no error").expect("the stream goes on");
    if let Some(whole) = assembler.take(part.clone()).expect("fragments that fit")
        && whole.number > 0
    {
        view.acknowledge(whole.number).await.expect("a viewer that is known");
    }
    part
}

/// What is recorded under this name says what is written beside it, and has all that a decoder has to know of.
async fn check(name: &str, encoding: v1::SurfaceEncoding) -> Vec<v1::State> {
    let (stream, beside) = (path(&format!("{name}.bin")), path(&format!("{name}.json")));
    if std::env::var_os("KERF_WRITE_VECTORS").is_some() {
        let messages = record(encoding).await;
        let file: Vec<u8> = messages
            .iter()
            .flat_map(|message| [&(message.encoded_len() as u32).to_le_bytes()[..], &message.encode_to_vec()].concat())
            .collect();
        std::fs::write(&stream, file).unwrap();
        std::fs::write(&beside, serde_json::to_string(&replayed(&messages)).unwrap()).unwrap();
    }
    let messages = messages(&std::fs::read(stream).unwrap());
    let written: Vec<Expected> = serde_json::from_slice(&std::fs::read(beside).unwrap()).unwrap();
    assert_eq!(replayed(&messages), written);

    let kinds = |kind: &str| written.iter().filter(|expected| expected.message == kind).count();
    assert!(kinds("keyframe") == 1 && kinds("patch") > 3 && kinds("state") > 10, "{}", written.len());
    assert!(messages.len() > written.len(), "fragments");
    let states = messages.into_iter().filter_map(|whole| match whole.message {
        Some(view_response::Message::State(state)) => Some(state),
        _ => None,
    });
    let states: Vec<_> = states.collect();
    assert!(states.iter().filter(|state| state.has_reference).count() > 1, "references");
    assert!(states.iter().any(|state| !state.has_reference), "differences to an earlier one");
    states
}

#[tokio::test]
async fn the_recorded_stream_says_what_is_written_beside_it() {
    let states = check("cut", v1::SurfaceEncoding::Lattice).await;
    assert!(states.iter().any(|state| !state.bodies[0].adapted_ids.is_empty()), "adapted vertices");
}

#[tokio::test]
async fn the_recorded_stream_of_plain_vertices_says_what_is_written_beside_it() {
    check("cut-vertices", v1::SurfaceEncoding::Vertices).await;
}
