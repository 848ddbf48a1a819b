//! One view stream: what its viewer gets, no faster than it reads.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use kerf_proto::v1;
use kerf_proto::v1::view_response::Message;
use kerf_session::clock::MonotonicClock;
use kerf_session::{ViewMessage, Viewer};
use prost::Message as _;
use tokio::sync::watch;

use super::in_flight::InFlight;
use crate::config::ViewLimits;
use crate::convert::view;
use crate::encode::{Encoder, HeldReference};

/// A viewer, and how far its client has read.
pub struct ViewStream {
    viewer: Viewer,
    acknowledged: watch::Receiver<u64>,
    in_flight: InFlight,
    encoder: Arc<Mutex<Encoder>>,
    reference: Option<HeldReference>,
    wants_energy: bool,
    max_message_bytes: usize,
    /// The hello, or the fragments of a message.
    ready: VecDeque<v1::ViewResponse>,
}

impl ViewStream {
    pub fn new(
        hello: v1::ViewHello,
        viewer: Viewer,
        acknowledged: watch::Receiver<u64>,
        encoder: Arc<Mutex<Encoder>>,
        wants_energy: bool,
        limits: &ViewLimits,
    ) -> Self {
        Self {
            viewer,
            acknowledged,
            in_flight: InFlight::new((limits.max_age_s * 1e9) as u64),
            encoder,
            reference: None,
            wants_energy,
            max_message_bytes: limits.max_message_bytes,
            ready: VecDeque::from([v1::ViewResponse { message: Some(Message::Hello(hello)), number: 0 }]),
        }
    }

    /// What comes next, as soon as there is something and room for it; `None` once the session has ended.
    pub async fn next(&mut self) -> Option<v1::ViewResponse> {
        if let Some(ready) = self.ready.pop_front() {
            return Some(ready);
        }
        while !self.in_flight.has_room() {
            tokio::select! {
                biased;
                Ok(()) = self.acknowledged.changed() => self.note_acknowledged(),
                // The end of the session is told to who has read nothing too.
                () = self.viewer.closed() => break,
            }
        }
        let (message, is_numbered) = loop {
            let message = tokio::select! {
                biased;
                Ok(()) = self.acknowledged.changed() => {
                    self.note_acknowledged();
                    continue;
                }
                message = self.viewer.next() => message?,
            };
            if let Some(encoded) = self.encode(&message) {
                break (encoded, !matches!(message, ViewMessage::Event(_)));
            }
        };
        let number = if is_numbered { self.in_flight.send(MonotonicClock::now_ns()) } else { 0 };
        let event = v1::ViewResponse { message: Some(message), number };
        if event.encoded_len() <= self.max_message_bytes {
            return Some(event);
        }
        self.ready.extend(fragments(&event, self.max_message_bytes));
        self.ready.pop_front()
    }

    /// What the viewer is told; nothing of what is out of date already.
    fn encode(&mut self, message: &ViewMessage) -> Option<Message> {
        let epoch = self.viewer.epoch();
        let mut encoder = self.encoder.lock().unwrap_or_else(PoisonError::into_inner);
        match message {
            ViewMessage::Keyframe(structure) => {
                // The viewer forgets what it had.
                self.reference = None;
                encoder.keyframe(epoch, structure).map(Message::Keyframe)
            }
            ViewMessage::Patch(change) => encoder.patch(epoch, change).map(Message::Patch),
            ViewMessage::State(state) => {
                let encoded = encoder.encode(state)?;
                drop(encoder);
                Some(Message::State(encoded.message(&mut self.reference, self.wants_energy)))
            }
            ViewMessage::Event(happened) => Some(view::event(happened)),
        }
    }

    fn note_acknowledged(&mut self) {
        let number = *self.acknowledged.borrow_and_update();
        self.in_flight.acknowledge(number, MonotonicClock::now_ns());
    }
}

/// An event in pieces that hold at most so many bytes of it.
fn fragments(event: &v1::ViewResponse, max_bytes: usize) -> impl Iterator<Item = v1::ViewResponse> {
    let data = event.encode_to_vec();
    let count = data.len().div_ceil(max_bytes);
    (0..count).map(move |index| {
        let data = data[index * max_bytes..data.len().min((index + 1) * max_bytes)].to_vec();
        let fragment = v1::Fragment { data, remaining: (count - 1 - index) as u32 };
        v1::ViewResponse { message: Some(Message::Fragment(fragment)), number: 0 }
    })
}
