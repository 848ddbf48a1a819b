//! What is counted of connections.

use std::sync::atomic::{AtomicUsize, Ordering};

use kerf_session::counts::Count;

use crate::config::setting;

/// Why a connection is closed as it comes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Full {
    /// Its address has as many as one may.
    Address,
    /// All places are taken, and no address has so many more that it gives one up.
    Server,
}

impl Full {
    /// All that there are.
    pub const ALL: [Self; 2] = [Self::Address, Self::Server];

    /// The setting that is in the way.
    pub fn setting(self) -> &'static str {
        match self {
            Self::Address => setting!(transport.max_connections_per_peer),
            Self::Server => setting!(transport.max_connections),
        }
    }
}

/// Connections of a listener, and what went over them.
#[derive(Debug, Default)]
pub struct Traffic {
    /// Connections that have not ended yet.
    open: AtomicUsize,
    /// Those that were closed as they came, by the place of the reason in [`Full::ALL`].
    refused: [Count; Full::ALL.len()],
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

    /// One was closed as it came.
    pub fn refuse(&self, full: Full) {
        self.refused[full as usize].add(1);
    }

    /// Those that were closed as they came for this reason.
    pub fn refused(&self, full: Full) -> u64 {
        self.refused[full as usize].get()
    }

    /// Connections that have not ended yet.
    pub fn open(&self) -> usize {
        self.open.load(Ordering::Acquire)
    }
}
