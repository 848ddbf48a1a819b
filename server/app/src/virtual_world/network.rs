//! A network between a server and its clients that delays, stalls and breaks, by seed.

use std::io;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use fastrand::Rng;
use hyper_util::rt::TokioIo;
use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream, ReadHalf, WriteHalf, duplex, split};
use tokio::sync::mpsc;
use tokio::task::AbortHandle;
use tokio::time::{Instant, sleep_until};
use tonic::transport::{Channel, Endpoint};

/// Bytes that a connection takes before it makes its writer wait.
const ROOM_BYTES: usize = 1 << 16;

/// How good it is.
#[derive(Clone, Copy, Debug, Default)]
pub struct Quality {
    /// Time that bytes take one way.
    pub delay: Duration,
    /// And up to so much more, drawn for each piece; what was sent later comes later.
    pub jitter: Duration,
    /// How likely a piece waits for `stall` before it goes on.
    pub stalls: f64,
    /// How long then.
    pub stall: Duration,
}

/// A network; clones are the same one.
#[derive(Clone)]
pub struct Network(Arc<Mutex<State>>);

struct State {
    random: Rng,
    quality: Quality,
    /// `None`: no server listens.
    listener: Option<mpsc::UnboundedSender<DuplexStream>>,
    lines: Vec<AbortHandle>,
}

impl Network {
    pub fn new(seed: u64) -> Self {
        let state =
            State { random: Rng::with_seed(seed), quality: Quality::default(), listener: None, lines: Vec::new() };
        Self(Arc::new(Mutex::new(state)))
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn set(&self, quality: Quality) {
        self.lock().quality = quality;
    }

    /// The connections that a server is to accept, from now on.
    pub fn listen(&self) -> mpsc::UnboundedReceiver<DuplexStream> {
        let (listener, accepted) = mpsc::unbounded_channel();
        self.lock().listener = Some(listener);
        accepted
    }

    /// Breaks all connections.
    pub fn cut(&self) {
        self.lock().lines.drain(..).for_each(|line| line.abort());
    }

    /// Nobody listens any more, and all connections break.
    pub fn fall(&self) {
        self.lock().listener = None;
        self.cut();
    }

    /// A channel to the server.
    pub async fn channel(&self) -> Result<Channel, tonic::transport::Error> {
        let network = self.clone();
        let connector = tower::service_fn(move |_| {
            let network = network.clone();
            async move { network.connect().map(TokioIo::new) }
        });
        Endpoint::from_static("http://127.0.0.1:50051").connect_with_connector(connector).await
    }

    fn connect(&self) -> io::Result<DuplexStream> {
        let (client, near) = duplex(ROOM_BYTES);
        let (far, server) = duplex(ROOM_BYTES);
        let listens = self.lock().listener.as_ref().is_some_and(|listener| listener.send(server).is_ok());
        if !listens {
            return Err(io::ErrorKind::ConnectionRefused.into());
        }
        let ((from_client, to_client), (from_server, to_server)) = (split(near), split(far));
        for (from, to) in [(from_client, to_server), (from_server, to_client)] {
            // Each line draws by itself: which of several tasks goes first at a moment is not by seed.
            let random = self.lock().random.fork();
            let line = tokio::spawn(carry(self.clone(), random, from, to));
            self.lock().lines.push(line.abort_handle());
        }
        Ok(client)
    }

    /// How long the next piece takes.
    fn takes(&self, random: &mut Rng) -> Duration {
        let quality = self.lock().quality;
        let stall = if random.f64() < quality.stalls { quality.stall } else { Duration::ZERO };
        quality.delay + quality.jitter.mul_f64(random.f64()) + stall
    }
}

/// Carries bytes one way until an end is gone.
async fn carry(network: Network, mut random: Rng, mut from: ReadHalf<DuplexStream>, mut to: WriteHalf<DuplexStream>) {
    let (send, mut sent) = mpsc::unbounded_channel::<(Instant, Vec<u8>)>();
    let read = async move {
        let mut last = Instant::now();
        let mut bytes = vec![0; ROOM_BYTES];
        while let Ok(count @ 1..) = from.read(&mut bytes).await {
            last = last.max(Instant::now() + network.takes(&mut random));
            if send.send((last, bytes[..count].to_vec())).is_err() {
                break;
            }
        }
    };
    let write = async move {
        while let Some((arrives, bytes)) = sent.recv().await {
            sleep_until(arrives).await;
            if to.write_all(&bytes).await.is_err() {
                break;
            }
        }
        // The other end learns that no more comes.
        let _ = to.shutdown().await;
    };
    tokio::join!(read, write);
}
