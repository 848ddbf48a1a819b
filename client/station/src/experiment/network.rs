//! A network between a station and its server: it delays what goes through it, and stalls.
//!
//! TCP delivers in order, whatever the network loses: what is lost is sent again, and all that came after it waits. So
//! loss is a pause here, after which everything comes at once.

use std::io::{Read, Write};
use std::net::{Ipv4Addr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::time::Duration;

use kerf_load::clock;

/// Time after which TCP sends again what was not acknowledged, at the least (Linux), ns: the length of a stall.
const STALL_NS: u64 = 200_000_000;
/// How often a network that is down looks whether it is up again.
const DOWN_PAUSE: Duration = Duration::from_millis(5);
/// Bytes that are read at once: some hundred messages.
const CHUNK: usize = 16_384;

/// What a network does to what goes through it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Quality {
    /// There and back, s.
    pub round_trip_s: f64,
    /// Delay beside it, each way, from none to this, s.
    pub jitter_s: f64,
    /// Share of the time that it stalls, each way.
    pub stalled_share: f64,
}

/// A network on this machine. Its connections end when it is dropped.
pub struct Network {
    address: SocketAddr,
    shared: Arc<Shared>,
}

#[derive(Debug, Default)]
struct Shared {
    is_down: AtomicBool,
    is_over: AtomicBool,
    /// Ends of connections, to be closed at the end.
    ends: Mutex<Vec<TcpStream>>,
}

impl Network {
    /// A network to a server.
    ///
    /// # Errors
    /// No port is free.
    pub fn to(server: SocketAddr, quality: Quality) -> std::io::Result<Self> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
        let address = listener.local_addr()?;
        let shared = Arc::new(Shared::default());
        let accepting = Arc::clone(&shared);
        std::thread::Builder::new().name("network".into()).spawn(move || {
            for near in listener.incoming().map_while(Result::ok) {
                if accepting.is_over.load(Ordering::Relaxed) {
                    return;
                }
                // A server that is not there closes the connection.
                if let Ok(far) = TcpStream::connect(server) {
                    let _ = accepting.connect(&near, &far, quality);
                }
            }
        })?;
        Ok(Self { address, shared })
    }

    /// Where stations find it.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// While it is down nothing comes through, and nothing is lost.
    pub fn set_down(&self, is_down: bool) {
        self.shared.is_down.store(is_down, Ordering::Relaxed);
    }
}

impl Drop for Network {
    fn drop(&mut self) {
        self.shared.is_over.store(true, Ordering::Relaxed);
        // Wakes the listener.
        let _ = TcpStream::connect(self.address);
        for end in self.shared.ends().drain(..) {
            let _ = end.shutdown(Shutdown::Both);
        }
    }
}

impl Shared {
    fn ends(&self) -> std::sync::MutexGuard<'_, Vec<TcpStream>> {
        self.ends.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn connect(self: &Arc<Self>, near: &TcpStream, far: &TcpStream, quality: Quality) -> std::io::Result<()> {
        for end in [near, far] {
            end.set_nodelay(true)?;
            self.ends().push(end.try_clone()?);
        }
        for (seed, from, to) in [(1, near, far), (2, far, near)] {
            let (from, to, shared) = (from.try_clone()?, to.try_clone()?, Arc::clone(self));
            let (on_the_way, arriving) = mpsc::channel();
            let thread = || std::thread::Builder::new().name("network".into());
            let delay = Delay::new(quality, clock::now_ns(), seed);
            thread().spawn(move || take(from, delay, &on_the_way))?;
            thread().spawn(move || shared.deliver(to, &arriving))?;
        }
        Ok(())
    }

    fn deliver(&self, mut to: TcpStream, arriving: &mpsc::Receiver<(u64, Vec<u8>)>) {
        for (due_ns, chunk) in arriving {
            clock::sleep_until_ns(due_ns);
            while self.is_down.load(Ordering::Relaxed) && !self.is_over.load(Ordering::Relaxed) {
                std::thread::sleep(DOWN_PAUSE);
            }
            if to.write_all(&chunk).is_err() {
                return;
            }
        }
        let _ = to.shutdown(Shutdown::Write);
    }
}

fn take(mut from: TcpStream, mut delay: Delay, on_the_way: &mpsc::Sender<(u64, Vec<u8>)>) {
    let mut chunk = vec![0; CHUNK];
    while let Ok(read @ 1..) = from.read(&mut chunk) {
        if on_the_way.send((delay.due_ns(clock::now_ns()), chunk[..read].to_vec())).is_err() {
            return;
        }
    }
}

/// When what is sent now arrives.
struct Delay {
    quality: Quality,
    begun_ns: u64,
    newest_ns: u64,
    random: u64,
}

impl Delay {
    fn new(quality: Quality, begun_ns: u64, seed: u64) -> Self {
        Self { quality, begun_ns, newest_ns: 0, random: seed }
    }

    fn due_ns(&mut self, now_ns: u64) -> u64 {
        let way_s = self.quality.round_trip_s / 2.0 + self.quality.jitter_s * self.uniform();
        let due_ns = now_ns + self.stalled_ns(now_ns) + (way_s * 1e9) as u64;
        // In order: nothing overtakes.
        self.newest_ns = self.newest_ns.max(due_ns);
        self.newest_ns
    }

    /// How much longer the network stalls: each stall ends a period of its own.
    fn stalled_ns(&self, now_ns: u64) -> u64 {
        if self.quality.stalled_share == 0.0 {
            return 0;
        }
        let period_ns = (STALL_NS as f64 / self.quality.stalled_share) as u64;
        let left_ns = period_ns - now_ns.saturating_sub(self.begun_ns) % period_ns;
        if left_ns <= STALL_NS { left_ns } else { 0 }
    }

    /// From 0 to 1; the same numbers every time (SplitMix64).
    fn uniform(&mut self) -> f64 {
        self.random = self.random.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.random;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn what_is_sent_arrives_half_a_round_trip_later_within_the_jitter_and_in_order() {
        let quality = Quality { round_trip_s: 0.02, jitter_s: 5e-3, stalled_share: 0.0 };
        let mut delay = Delay::new(quality, 0, 1);
        let due: Vec<u64> = (0..1000).map(|i| delay.due_ns(i * 100 * MS) - i * 100 * MS).collect();
        assert!(due.iter().all(|&took_ns| (10 * MS..=15 * MS).contains(&took_ns)));
        let mean_ns = due.iter().sum::<u64>() / 1000;
        assert!(mean_ns.abs_diff(12_500_000) < 200_000, "{mean_ns}");
        let dense: Vec<u64> = (0..1000).map(|i| delay.due_ns(200_000 * MS + i * MS / 10)).collect();
        assert!(dense.is_sorted());
    }

    #[test]
    fn a_stalled_share_of_the_time_nothing_leaves() {
        let mut delay = Delay::new(Quality { stalled_share: 0.1, ..Quality::default() }, 0, 1);
        let waits: Vec<u64> = (0..20_000).map(|i| delay.due_ns(i * MS) - i * MS).collect();
        let stalled = waits.iter().filter(|&&wait_ns| wait_ns > 0).count();
        assert_eq!((stalled, waits.iter().max()), (2000, Some(&STALL_NS)));
    }
}
