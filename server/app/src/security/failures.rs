//! Tokens that were wrong, by the peer that sent them. Nobody guesses 256 bits: what is bounded is the work and the log
//! that somebody makes who tries. Right tokens pass all the same, so that nobody is kept out by a neighbour.

use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// The time that failures are counted over.
const PERIOD: Duration = Duration::from_secs(60);
/// Peers that are counted at a time; those beyond share a count.
const MAX_PEERS: usize = 1024;

/// Counts failures.
pub struct Failures {
    max: u32,
    peers: Mutex<HashMap<Option<IpAddr>, Count>>,
}

struct Count {
    since: Instant,
    failures: u32,
}

impl Failures {
    /// None yet, and so many a minute.
    pub fn new(max: u32) -> Self {
        Self { max, peers: Mutex::default() }
    }

    /// Counts one more; whether it is within the limit.
    pub fn count(&self, peer: Option<IpAddr>, now: Instant) -> bool {
        let mut peers = self.peers.lock().unwrap_or_else(PoisonError::into_inner);
        peers.retain(|_, count| now.duration_since(count.since) < PERIOD);
        let peer = peer.filter(|peer| peers.contains_key(&Some(*peer)) || peers.len() < MAX_PEERS);
        let count = peers.entry(peer).or_insert(Count { since: now, failures: 0 });
        count.failures = count.failures.saturating_add(1);
        count.failures <= self.max
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn failures_are_counted_by_peer_and_forgotten_after_a_minute() {
        let failures = Failures::new(2);
        let (begun, peer) = (Instant::now(), Some(IpAddr::from([10, 0, 0, 1])));
        assert_eq!([0, 1, 2].map(|_| failures.count(peer, begun)), [true, true, false]);
        assert!(failures.count(Some(IpAddr::from([10, 0, 0, 2])), begun));
        assert!(failures.count(peer, begun + PERIOD));
    }

    #[test]
    fn however_many_peers_fail_no_more_are_kept() {
        let failures = Failures::new(1);
        let begun = Instant::now();
        for peer in 0..4 * MAX_PEERS as u32 {
            failures.count(Some(IpAddr::from(peer.to_be_bytes())), begun);
        }
        assert_eq!(failures.peers.lock().unwrap().len(), MAX_PEERS + 1);
    }
}
