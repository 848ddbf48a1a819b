//! What is counted of connections.

use std::sync::atomic::{AtomicUsize, Ordering};

use kerf_session::counts::Count;

/// Connections of a listener, and what went over them.
#[derive(Debug, Default)]
pub struct Traffic {
    /// Connections that have not ended yet.
    open: AtomicUsize,
    /// Those that were closed as they came.
    pub refused: Count,
    /// Bytes of the connections' contents: TLS adds to them.
    pub sent_bytes: Count,
    /// See `sent_bytes`.
    pub received_bytes: Count,
}

impl Traffic {
    /// Another connection.
    pub fn begin(&self) {
        self.open.fetch_add(1, Ordering::AcqRel);
    }

    /// One has ended.
    pub fn end(&self) {
        self.open.fetch_sub(1, Ordering::AcqRel);
    }

    /// Connections that have not ended yet.
    pub fn open(&self) -> usize {
        self.open.load(Ordering::Acquire)
    }
}
