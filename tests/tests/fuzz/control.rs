//! What drivers send: messages of control streams, and poses one a call. Their fields take any value, and then their bytes
//! are changed; what is no message any more is sent as it is.

use std::cell::{Cell, RefCell};
use std::marker::PhantomData;
use std::ops::Range;
use std::time::Duration;

use kerf_proto::PROTOCOL_VERSION;
use kerf_proto::codec::{StrictCodec, StrictDecoder};
use kerf_proto::v1::{self, control_request, control_response, send_pose_request};
use kerf_system_tests::readers::messages::messages_of;
use proptest::prelude::*;
use proptest::sample::select;
use prost::Message;
use prost::bytes::BufMut;
use tokio::runtime::Runtime;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::client::Grpc;
use tonic::codec::{Codec, EncodeBuf, Encoder};
use tonic::{Code, Request, Status};
use tonic_types::StatusExt;

use super::changes::{Change, changes};
use super::{changed, fuzz_made};
use crate::grpc::harness::{Harness, soon};

/// What inputs call the session that is driven and the one beside it, whose ids differ from run to run, and the lease of the
/// last answer.
const DRIVEN: &str = "driven";
const OTHER: &str = "other";
const GIVEN: &str = "given";
/// Messages of one input.
const MESSAGES: Range<usize> = 1..12;
/// Most that are sent of an input whose changes have made more of them.
const MAX_MESSAGES: usize = 64;
/// Changes of its bytes.
const CHANGES: Range<usize> = 0..3;
/// How long a stream stays open after its last message: two steps.
const MOMENT: Duration = Duration::from_millis(4);

/// Sends bytes, whether they are a message or not.
struct AnyBytes<T>(PhantomData<T>);

impl<T: Message + Default + Send + 'static> Codec for AnyBytes<T> {
    type Encode = Vec<u8>;
    type Decode = T;
    type Encoder = BytesEncoder;
    type Decoder = StrictDecoder<T>;

    fn encoder(&mut self) -> BytesEncoder {
        BytesEncoder
    }

    fn decoder(&mut self) -> StrictDecoder<T> {
        StrictCodec::<T, T>::default().decoder()
    }
}

struct BytesEncoder;

impl Encoder for BytesEncoder {
    type Item = Vec<u8>;
    type Error = Status;

    fn encode(&mut self, bytes: Vec<u8>, into: &mut EncodeBuf<'_>) -> Result<(), Status> {
        into.put_slice(&bytes);
        Ok(())
    }
}

/// A server with a session that is driven and another.
struct Bench {
    runtime: Runtime,
    harness: Harness,
    driven: String,
    other: String,
    /// Steps that the other session had taken.
    step: Cell<u64>,
    lease: RefCell<String>,
}

impl Bench {
    fn new() -> Self {
        let runtime = kerf_system_tests::readers::runtime();
        let (harness, driven, other) = runtime.block_on(async {
            let mut harness = Harness::with(|config| {
                // Whoever has a lease and forgets it keeps a tool from few inputs.
                config.session.lease_s = 0.02;
                config.control.max_rejected_in_a_row = 6;
            })
            .await;
            let [driven, other] = [harness.create().await, harness.create().await];
            (harness, driven.expect("a session"), other.expect("another"))
        });
        Self { runtime, harness, driven, other, step: Cell::default(), lease: RefCell::default() }
    }

    /// The id of a session that an input names.
    fn id_of(&self, name: &str) -> String {
        match name {
            DRIVEN => self.driven.clone(),
            OTHER => self.other.clone(),
            name => name.to_owned(),
        }
    }

    async fn client(&self) -> Grpc<tonic::transport::Channel> {
        let mut client = Grpc::new(self.harness.channel.clone());
        client.ready().await.expect("a connection");
        client
    }

    /// Opens a control stream, sends messages and reads to the end.
    async fn control(&self, messages: Vec<Vec<u8>>) -> Result<(), Status> {
        let (up, requests) = mpsc::channel(MAX_MESSAGES);
        for message in messages {
            up.try_send(message).expect("room for all messages");
        }
        tokio::spawn(async move {
            tokio::time::sleep(MOMENT).await;
            drop(up);
        });
        let path = "/kerf.v1.ControlService/Control".parse().expect("a path");
        let request = Request::new(ReceiverStream::new(requests));
        let answer = self.client().await.streaming(request, path, AnyBytes::<v1::ControlResponse>(PhantomData)).await?;
        let mut answers = answer.into_inner();
        while let Some(answer) = answers.message().await? {
            match answer.message.expect("a message that says something") {
                control_response::Message::Rejected(rejected) => judge_rejection(&rejected),
                control_response::Message::Contact(contact) => judge_contact(&contact),
                _ => {}
            }
        }
        Ok(())
    }

    /// Sends one pose and keeps the lease.
    async fn send_pose(&self, bytes: Vec<u8>) -> Result<(), Status> {
        let path = "/kerf.v1.ControlService/SendPose".parse().expect("a path");
        let codec = AnyBytes::<v1::SendPoseResponse>(PhantomData);
        let answer = self.client().await.unary(Request::new(bytes), path, codec).await;
        match &answer {
            Ok(answer) => self.lease.borrow_mut().clone_from(&answer.get_ref().lease),
            Err(refused) if refused.message().starts_with("lease:") => self.lease.borrow_mut().clear(),
            Err(_) => {}
        }
        let answer = answer?.into_inner();
        assert!(!answer.lease.is_empty());
        answer.rejected.iter().for_each(judge_rejection);
        answer.contact.iter().for_each(judge_contact);
        Ok(())
    }

    /// The driven session is sound, and the other one goes on.
    async fn check(&self) {
        let described = async |session_id: &str| {
            let request = v1::DescribeSessionRequest { session_id: session_id.into() };
            let described = self.harness.sessions.clone().describe_session(request).await.expect("the session lives");
            let described = described.into_inner().session.expect("a description");
            assert_eq!(described.state(), v1::SessionState::Running, "{}", described.failure);
            described
        };
        let driven = described(&self.driven).await;
        assert!(driven.energy.is_some_and(|energy| energy.residual_j.is_finite()), "{driven:?}");
        soon("a step of the other session", async {
            while described(&self.other).await.step <= self.step.get() {
                tokio::time::sleep(Duration::from_millis(1)).await;
            }
        })
        .await;
        self.step.set(described(&self.other).await.step);
    }
}

/// A pose that is refused is so by its field and limit.
fn judge_rejection(rejected: &v1::PoseRejected) {
    let fields = ["tool_id", "seq", "pose", "pose.position_m", "pose.orientation", "opening"];
    assert!(fields.contains(&rejected.field.as_str()) && !rejected.limit.is_empty(), "{rejected:?}");
}

fn judge_contact(contact: &v1::Contact) {
    let wrench = contact.wrench.expect("a wrench");
    let numbers = [wrench.force_n, wrench.torque_nm].map(|vector| vector.expect("a vector"));
    assert!(numbers.iter().all(|vector| (vector.x + vector.y + vector.z).is_finite()), "{contact:?}");
}

/// A call or a stream that is refused is so by the name of what is wrong.
fn judge(outcome: Result<(), Status>) {
    let Err(refused) = outcome else { return };
    let (message, details) = (refused.message(), refused.get_error_details());
    let is_named = match refused.code() {
        Code::InvalidArgument => {
            let field = details.bad_request().map_or("", |request| &request.field_violations[0].field);
            // These name what the protocol says of the stream's messages.
            let of_stream = ["failed to decode Protobuf message", "poses in a row were rejected, the last for"];
            !field.is_empty() || of_stream.iter().any(|words| message.contains(words))
        }
        Code::NotFound => ["no session ", "tool ", "hello.tool_ids["].iter().any(|name| message.starts_with(name)),
        Code::FailedPrecondition => {
            ["hello.protocol_version = ", "tool ", "lease:"].iter().any(|name| message.starts_with(name))
        }
        Code::ResourceExhausted => details.quota_failure().is_some_and(|quota| !quota.violations[0].subject.is_empty()),
        // tonic's own word on a message that is larger than any of them is.
        Code::OutOfRange => message.contains("decoded message length too large"),
        _ => false,
    };
    assert!(is_named, "{refused:?}");
}

/// Lengths and shares: most are of the scene's size.
fn floats() -> impl Strategy<Value = f32> {
    let odd = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN, f32::MIN_POSITIVE, -0.0, 1.0];
    prop_oneof![12 => -0.015f32..0.015, 1 => select(odd.to_vec())]
}

fn doubles() -> impl Strategy<Value = f64> {
    select(vec![0.0, 0.1, 60.0, 1e308, 5e-324, -1.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY])
}

/// Numbers that count something; -1 is what a client with signed ones would send.
fn counts() -> impl Strategy<Value = u64> {
    prop_oneof![6 => 0..40u64, 1 => select(vec![i64::MAX as u64, i64::MIN as u64, -1i64 as u64])]
}

fn tools() -> impl Strategy<Value = u32> {
    prop_oneof![10 => 0..2u32, 1 => select(vec![2, 77, i32::MAX as u32, u32::MAX])]
}

fn sessions() -> impl Strategy<Value = String> {
    let odd = [OTHER, "", "session-00000000-1", "session-", "\u{202e}\0\n"].map(str::to_owned);
    prop_oneof![12 => Just(DRIVEN.to_owned()), 1 => select(odd.to_vec()), 1 => Just("\u{fffd}".repeat(3000))]
}

fn poses() -> impl Strategy<Value = v1::ToolPose> {
    let position = (floats(), floats(), floats()).prop_map(|(x, y, z)| v1::Vec3 { x, y, z });
    let turned = (floats(), floats(), floats(), floats()).prop_map(|(x, y, z, w)| v1::Quat { x, y, z, w });
    let orientation = prop_oneof![8 => Just(v1::Quat { w: 1.0, ..Default::default() }), 1 => turned];
    let pose = (prop::option::weighted(0.95, position), prop::option::weighted(0.95, orientation))
        .prop_map(|(position_m, orientation)| v1::Pose { position_m, orientation });
    let opening = prop::option::of(prop_oneof![0.0f32..=1.0, floats()]);
    (tools(), counts(), counts(), prop::option::weighted(0.95, pose), any::<u32>(), opening).prop_map(
        |(tool_id, seq, client_ns, pose, buttons, opening)| v1::ToolPose {
            tool_id,
            seq,
            client_ns,
            pose,
            buttons,
            opening,
        },
    )
}

fn lifts() -> impl Strategy<Value = v1::LiftTool> {
    tools().prop_map(|tool_id| v1::LiftTool { tool_id })
}

/// Most are sound: what follows another is not read.
fn hellos() -> impl Strategy<Value = v1::ClientHello> {
    let sound = |session_id: &str| v1::ClientHello {
        protocol_version: PROTOCOL_VERSION,
        session_id: session_id.into(),
        tool_ids: vec![0, 1],
        // So that it takes the tools over that the stream before still has.
        client_key: "fuzz".into(),
        ..v1::ClientHello::default()
    };
    let tool_ids = prop::collection::vec(tools(), 0..4);
    let key = select(vec![String::new(), "fuzz".into(), "k".repeat(65)]);
    let version = prop_oneof![8 => Just(PROTOCOL_VERSION), 1 => any::<u32>()];
    let names = (version, sessions(), tool_ids, key);
    let odd = (names, [doubles(), doubles(), doubles()], any::<bool>()).prop_map(|(names, numbers, without_models)| {
        let (protocol_version, session_id, tool_ids, client_key) = names;
        let [contact_rate_hz, contact_deadband, contact_keep_alive_s] = numbers;
        v1::ClientHello {
            protocol_version,
            session_id,
            tool_ids,
            contact_rate_hz,
            contact_deadband,
            contact_keep_alive_s,
            client_key,
            without_models,
        }
    });
    prop_oneof![3 => Just(sound(DRIVEN)), 2 => odd]
}

/// The messages of a control stream.
fn streams() -> impl Strategy<Value = Vec<v1::ControlRequest>> {
    use control_request::Message::{Hello, Lift, Pose};
    let message = prop_oneof![
        12 => poses().prop_map(|pose| Some(Pose(pose))),
        2 => lifts().prop_map(|lift| Some(Lift(lift))),
        1 => hellos().prop_map(|hello| Some(Hello(hello))),
        1 => Just(None),
    ];
    let received = prop_oneof![3 => Just(0), 1 => counts()];
    let request = (message, received).prop_map(|(message, received)| v1::ControlRequest { message, received });
    let first = prop::option::weighted(0.95, hellos());
    (first, prop::collection::vec(request, MESSAGES)).prop_map(|(first, rest)| {
        let first = first.map(|hello| v1::ControlRequest { message: Some(Hello(hello)), received: 0 });
        first.into_iter().chain(rest).collect()
    })
}

/// Calls of a browser, one after another.
fn calls() -> impl Strategy<Value = Vec<v1::SendPoseRequest>> {
    use send_pose_request::Motion::{Lift, Pose};
    let motion = prop_oneof![
        12 => poses().prop_map(|pose| Some(Pose(pose))),
        2 => lifts().prop_map(|lift| Some(Lift(lift))),
        1 => Just(None),
    ];
    let lease = prop_oneof![10 => Just(GIVEN), 1 => Just(""), 1 => Just("of nobody")].prop_map(str::to_owned);
    let call = (sessions(), lease, motion).prop_map(|(session_id, lease, motion)| v1::SendPoseRequest {
        session_id,
        lease,
        motion,
    });
    prop::collection::vec(call, MESSAGES)
}

fn file_of(messages: &[impl Message]) -> Vec<u8> {
    let messages = messages.iter().map(Message::encode_to_vec);
    messages.flat_map(|message| [&(message.len() as u32).to_le_bytes(), message.as_slice()].concat()).collect()
}

/// Inputs of what a strategy gives, some with other bytes then. What is spliced in is the input itself.
fn fuzz_messages<M: Message>(target: &str, messages: impl Strategy<Value = Vec<M>>, read: impl Fn(&[u8])) {
    let strategy = (messages, prop::collection::vec(changes(), CHANGES));
    let make = |(messages, changes): (Vec<M>, Vec<Change>)| {
        let file = file_of(&messages);
        changed(file.clone(), &changes, &[file])
    };
    fuzz_made(target, &strategy, make, read);
}

#[test]
fn control_streams() {
    let bench = Bench::new();
    let named = |bytes: &[u8]| {
        let mut request = v1::ControlRequest::decode(bytes).ok()?;
        let Some(control_request::Message::Hello(hello)) = &mut request.message else { return None };
        hello.session_id = bench.id_of(&hello.session_id);
        Some(request.encode_to_vec())
    };
    fuzz_messages("control", streams(), |file| {
        let messages = messages_of(file).into_iter().take(MAX_MESSAGES);
        let messages = messages.map(|bytes| named(bytes).unwrap_or_else(|| bytes.to_vec())).collect();
        bench.runtime.block_on(async {
            judge(soon("an end", bench.control(messages)).await);
            bench.check().await;
        });
    });
}

#[test]
fn sent_poses() {
    let bench = Bench::new();
    let named = |bytes: &[u8]| {
        let mut request = v1::SendPoseRequest::decode(bytes).ok()?;
        request.session_id = bench.id_of(&request.session_id);
        if request.lease == GIVEN {
            request.lease.clone_from(&bench.lease.borrow());
        }
        Some(request.encode_to_vec())
    };
    fuzz_messages("sent-poses", calls(), |file| {
        bench.runtime.block_on(async {
            for bytes in messages_of(file).into_iter().take(MAX_MESSAGES) {
                let request = named(bytes).unwrap_or_else(|| bytes.to_vec());
                judge(soon("an answer", bench.send_pose(request)).await);
            }
            bench.check().await;
        });
    });
}
