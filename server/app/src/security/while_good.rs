//! Answers that go on, as streams do, while the token of their call is good.

use std::io;
use std::pin::Pin;
use std::task::{Context, Poll};
use std::time::Duration;

use axum::body::{Body, Bytes, HttpBody};
use http_body::{Frame, SizeHint};
use tokio::time::{Instant, Sleep};

/// How often a stream's token is looked at: as often as the file of tokens is.
const LOOK_INTERVAL: Duration = Duration::from_secs(1);

/// The body of an answer, which breaks off once its token is good no more.
pub struct WhileGood<F> {
    body: Body,
    is_good: F,
    next_look: Pin<Box<Sleep>>,
}

impl<F> WhileGood<F> {
    /// Goes on while `is_good` says so.
    pub fn new(body: Body, is_good: F) -> Self {
        Self { body, is_good, next_look: Box::pin(tokio::time::sleep(LOOK_INTERVAL)) }
    }
}

impl<F: Fn() -> bool + Unpin> HttpBody for WhileGood<F> {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        while self.next_look.as_mut().poll(context).is_ready() {
            if !(self.is_good)() {
                return Poll::Ready(Some(Err(axum::Error::new(io::Error::from(io::ErrorKind::PermissionDenied)))));
            }
            self.next_look.as_mut().reset(Instant::now() + LOOK_INTERVAL);
        }
        Pin::new(&mut self.body).poll_frame(context)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}
