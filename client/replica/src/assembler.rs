//! Puts messages together that were too large for one.

use kerf_proto::v1::{Fragment, ViewResponse, view_response};
use prost::Message;

use crate::error::ReplicaError;

/// Collects the fragments of a view stream.
#[derive(Clone, Debug, Default)]
pub struct Assembler {
    data: Vec<u8>,
    /// Fragments that are still to come; 0 where none was begun.
    remaining: u32,
}

impl Assembler {
    /// Takes the stream's next event; answers with one that is whole, once there is one.
    ///
    /// # Errors
    /// A fragment is missing, they hold more than [`kerf_proto::MAX_MESSAGE_BYTES`], or are not an event in the end.
    pub fn take(&mut self, event: ViewResponse) -> Result<Option<ViewResponse>, ReplicaError> {
        let Some(view_response::Message::Fragment(Fragment { data, remaining })) = event.message else {
            return if self.remaining == 0 { Ok(Some(event)) } else { Err(self.fail()) };
        };
        let follows = self.remaining.checked_sub(1).is_none_or(|next| remaining == next);
        if !follows || self.data.len() + data.len() > kerf_proto::MAX_MESSAGE_BYTES {
            return Err(self.fail());
        }
        self.data.extend(data);
        self.remaining = remaining;
        if remaining > 0 {
            return Ok(None);
        }
        let whole = ViewResponse::decode(std::mem::take(&mut self.data).as_slice());
        whole.map(Some).map_err(|_| ReplicaError::Fragments)
    }

    fn fail(&mut self) -> ReplicaError {
        *self = Self::default();
        ReplicaError::Fragments
    }
}

#[cfg(test)]
mod tests {
    use kerf_proto::v1::{Keyframe, ViewHello};

    use super::*;

    fn event(message: view_response::Message) -> ViewResponse {
        ViewResponse { message: Some(message), number: 0 }
    }

    fn fragments(of: &ViewResponse, bytes: usize) -> Vec<ViewResponse> {
        let data = of.encode_to_vec();
        let count = data.chunks(bytes).count();
        let fragment = |(index, data): (usize, &[u8])| {
            event(view_response::Message::Fragment(Fragment {
                data: data.to_vec(),
                remaining: (count - 1 - index) as u32,
            }))
        };
        data.chunks(bytes).enumerate().map(fragment).collect()
    }

    #[test]
    fn fragments_become_the_message_they_were_cut_from() {
        let whole = event(view_response::Message::Keyframe(Keyframe { topology_version: 300, ..Keyframe::default() }));
        let mut assembler = Assembler::default();
        for bytes in [1, 2, 100] {
            let mut parts = fragments(&whole, bytes);
            let last = parts.pop().unwrap();
            assert!(parts.into_iter().all(|part| assembler.take(part) == Ok(None)));
            assert_eq!(assembler.take(last), Ok(Some(whole.clone())));
        }
    }

    #[test]
    fn a_fragment_that_says_as_many_as_can_be_said_are_to_come_does_not_follow() {
        let fragment = |remaining| event(view_response::Message::Fragment(Fragment { data: Vec::new(), remaining }));
        let mut assembler = Assembler::default();
        assert_eq!(assembler.take(fragment(3)), Ok(None));
        assert_eq!(assembler.take(fragment(u32::MAX)), Err(ReplicaError::Fragments));
        assert_eq!(assembler.take(fragment(u32::MAX)), Ok(None), "it begins another message");
    }

    #[test]
    fn a_fragment_that_is_missing_is_noticed() {
        let whole = event(view_response::Message::Keyframe(Keyframe { topology_version: 300, ..Keyframe::default() }));
        let mut parts = fragments(&whole, 1);
        parts.remove(1);
        let mut assembler = Assembler::default();
        assert_eq!(assembler.take(parts.remove(0)), Ok(None));
        assert_eq!(assembler.take(parts.remove(0)), Err(ReplicaError::Fragments));
        let hello = event(view_response::Message::Hello(ViewHello::default()));
        assert_eq!(assembler.take(hello.clone()), Ok(Some(hello)), "it goes on");
    }
}
