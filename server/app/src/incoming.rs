//! Accepts connections: at most as many as the limit, from one peer and from all. A peer that has few gets a place of
//! one that has many. A connection that says nothing after it was accepted, or takes too long over TLS, is let go.

use std::collections::BTreeMap;
use std::future::Future;
use std::io;
use std::net::{IpAddr, Ipv6Addr};
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, ready};
use std::time::{Duration, Instant};

use futures_util::future::{Fuse, FutureExt};
use futures_util::{Stream, stream};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::oneshot;
use tokio::time::Sleep;
use tonic::transport::server::{Connected, TcpConnectInfo};

use tokio_rustls::server::TlsStream;
use tokio_rustls::{Accept, TlsAcceptor};

use crate::config::TransportLimits;
use crate::traffic::{Full, Traffic};

/// Time to wait when a connection cannot be accepted: the process is out of file descriptors, and
/// only the end of other connections helps.
const ACCEPT_RETRY: Duration = Duration::from_millis(50);
/// Refused connections are told of at most so often: whoever is refused tries again.
const TELL: Duration = Duration::from_secs(5);
/// Bytes that HTTP/2 begins a connection with. From then on the protocol's own pings find out who is not there;
/// a request of HTTP/1.1 that is shorter is whole with them.
const PREFACE_BYTES: usize = 24;

/// A connection that is counted.
pub struct Connection {
    traffic: Arc<Traffic>,
    stream: Wire,
    info: TcpConnectInfo,
    handshake: Option<Handshake>,
    place: Place,
}

trait ReadWrite: AsyncRead + AsyncWrite + Unpin {}

impl<T: AsyncRead + AsyncWrite + Unpin> ReadWrite for T {}

/// What bytes come over.
enum Wire {
    Plain(TcpStream),
    /// TLS begins with what its client says first: on the connection's own task, so that nobody waits for a slow one.
    Begins(Box<Accept<TcpStream>>),
    Tls(Box<TlsStream<TcpStream>>),
}

impl Wire {
    fn new(stream: TcpStream, tls: Option<&TlsAcceptor>) -> Self {
        match tls {
            None => Self::Plain(stream),
            Some(tls) => Self::Begins(Box::new(tls.accept(stream))),
        }
    }

    /// What can be read and written, once there is.
    fn poll_ready(&mut self, context: &mut Context<'_>) -> Poll<io::Result<Pin<&mut dyn ReadWrite>>> {
        if let Self::Begins(accept) = self {
            match accept.poll_unpin(context) {
                Poll::Pending => return Poll::Pending,
                Poll::Ready(begun) => *self = Self::Tls(Box::new(begun?)),
            }
        }
        match self {
            Self::Plain(stream) => Poll::Ready(Ok(Pin::new(stream))),
            Self::Tls(stream) => Poll::Ready(Ok(Pin::new(stream.as_mut()))),
            Self::Begins(_) => Poll::Pending,
        }
    }
}

/// The beginning of a connection, which may not take for ever.
struct Handshake {
    bytes: usize,
    deadline: Pin<Box<Sleep>>,
}

/// What ends the connections of a listener.
pub struct Cut(Arc<Places>);

impl Cut {
    /// Ends all connections as a kill would: their clients take the server for lost, and look for it. Returns when none is
    /// left, or after a tenth of a second.
    pub async fn all(&self) {
        for _ in 0..100 {
            self.0.lock().connections.clear();
            if self.0.traffic.open() == 0 {
                return;
            }
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
    }
}

/// The connections of a listener, counted, and what ends them.
pub fn connections(
    listener: TcpListener,
    limits: &TransportLimits,
    tls: Option<TlsAcceptor>,
    traffic: Arc<Traffic>,
) -> (impl Stream<Item = io::Result<Connection>> + use<>, Cut) {
    let (max, max_of_peer) = (limits.max_connections, limits.max_connections_per_peer);
    let places = Arc::new(Places { taken: Mutex::default(), traffic, max, max_of_peer });
    (accepted(listener, Arc::clone(&places), limits, tls), Cut(places))
}

fn accepted(
    listener: TcpListener,
    places: Arc<Places>,
    limits: &TransportLimits,
    tls: Option<TlsAcceptor>,
) -> impl Stream<Item = io::Result<Connection>> + use<> {
    let handshake_timeout = Duration::from_secs_f64(limits.handshake_timeout_s);
    stream::unfold((listener, places, tls), move |(listener, places, tls)| async move {
        let (stream, place) = accept(&listener, &places).await;
        let deadline = Box::pin(tokio::time::sleep(handshake_timeout));
        let handshake = Some(Handshake { bytes: 0, deadline });
        let (info, stream) = (stream.connect_info(), Wire::new(stream, tls.as_ref()));
        let traffic = Arc::clone(&places.traffic);
        Some((Ok(Connection { traffic, stream, info, handshake, place }), (listener, places, tls)))
    })
}

async fn accept(listener: &TcpListener, places: &Arc<Places>) -> (TcpStream, Place) {
    loop {
        match listener.accept().await {
            Ok((stream, address)) => {
                // Closed at once where it is one too many: its peer's others go on.
                let place = match places.take(host(address.ip())) {
                    Ok(place) => place,
                    Err(full) => {
                        places.refuse(address.ip(), full);
                        continue;
                    }
                };
                // A held-back small message costs a round trip; a socket without the option still works.
                if let Err(error) = stream.set_nodelay(true) {
                    tracing::warn!(%error, "TCP_NODELAY");
                }
                return (stream, place);
            }
            Err(error) => {
                tracing::warn!(%error, "a connection could not be accepted");
                tokio::time::sleep(ACCEPT_RETRY).await;
            }
        }
    }
}

/// What counts as one peer: an address of IPv4, or what a host is given of IPv6, which is 2^64 addresses.
pub fn host(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(address) => Ipv6Addr::from_bits(address.to_bits() >> 64 << 64).into(),
        address => address,
    }
}

/// The places of connections.
struct Places {
    taken: Mutex<Taken>,
    /// Counts those that have not ended yet, those that lost their places among them.
    traffic: Arc<Traffic>,
    max: usize,
    max_of_peer: usize,
}

#[derive(Default)]
struct Taken {
    next_id: u64,
    /// When it was last told that a connection was refused.
    told: Option<Instant>,
    /// In the order of their coming: the peer, and what ends the connection by its own end.
    connections: BTreeMap<u64, (IpAddr, oneshot::Sender<()>)>,
}

impl Places {
    fn lock(&self) -> MutexGuard<'_, Taken> {
        self.taken.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Counts a connection that was refused, and tells of it unless that was told a moment ago: nobody else can, as its peer
    /// sees an end without a word.
    fn refuse(&self, peer: IpAddr, full: Full) {
        self.traffic.refuse(full);
        let told = &mut self.lock().told;
        if told.is_none_or(|told| told.elapsed() > TELL) {
            *told = Some(Instant::now());
            let (limit, refused) = (full.setting(), self.traffic.refused(full));
            tracing::warn!(%peer, limit, refused, "a connection was refused: as many as the limit says are open");
        }
    }

    /// A place for another connection of a peer, or why there is none. Where all are taken, the peer that has most gives up
    /// its newest, if it has more than this one will.
    fn take(self: &Arc<Self>, peer: IpAddr) -> Result<Place, Full> {
        let mut taken = self.lock();
        let count = |of: IpAddr| taken.connections.values().filter(|(peer, _)| *peer == of).count();
        let own = count(peer);
        if own >= self.max_of_peer {
            return Err(Full::Address);
        }
        if taken.connections.len() >= self.max {
            let crowd = taken.connections.iter().map(|(id, (peer, _))| (count(*peer), *id));
            let (_, newest) = crowd.max().filter(|(most, _)| *most > own + 1).ok_or(Full::Server)?;
            taken.connections.remove(&newest);
        }
        let (id, (connection, given_up)) = (taken.next_id, oneshot::channel());
        taken.next_id += 1;
        taken.connections.insert(id, (peer, connection));
        self.traffic.begin();
        Ok(Place { id, places: Arc::clone(self), given_up: given_up.fuse() })
    }
}

/// A place that is taken while this lives.
struct Place {
    id: u64,
    places: Arc<Places>,
    /// Ends when another peer gets the place.
    given_up: Fuse<oneshot::Receiver<()>>,
}

impl Drop for Place {
    fn drop(&mut self) {
        self.places.lock().connections.remove(&self.id);
        self.places.traffic.end();
    }
}

impl Connected for Connection {
    type ConnectInfo = TcpConnectInfo;

    fn connect_info(&self) -> TcpConnectInfo {
        self.info.clone()
    }
}

impl Connection {
    fn count_sent(&self, written: Poll<io::Result<usize>>) -> Poll<io::Result<usize>> {
        if let Poll::Ready(Ok(bytes)) = written {
            self.traffic.sent_bytes.add(bytes as u64);
        }
        written
    }
}

impl AsyncRead for Connection {
    fn poll_read(mut self: Pin<&mut Self>, context: &mut Context<'_>, into: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        if self.place.given_up.poll_unpin(context).is_ready() {
            return Poll::Ready(Err(io::ErrorKind::ConnectionAborted.into()));
        }
        let before = into.filled().len();
        let read = match self.stream.poll_ready(context) {
            Poll::Ready(Ok(stream)) => stream.poll_read(context, into),
            Poll::Ready(Err(error)) => Poll::Ready(Err(error)),
            Poll::Pending => Poll::Pending,
        };
        let bytes = into.filled().len() - before;
        self.traffic.received_bytes.add(bytes as u64);
        let Some(handshake) = &mut self.handshake else { return read };
        handshake.bytes += bytes;
        if handshake.bytes >= PREFACE_BYTES {
            self.handshake = None;
        } else if read.is_pending() && handshake.deadline.as_mut().poll(context).is_ready() {
            return Poll::Ready(Err(io::ErrorKind::TimedOut.into()));
        }
        read
    }
}

impl AsyncWrite for Connection {
    fn poll_write(mut self: Pin<&mut Self>, context: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let written = ready!(self.stream.poll_ready(context))?.poll_write(context, bytes);
        self.count_sent(written)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        ready!(self.stream.poll_ready(context))?.poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        ready!(self.stream.poll_ready(context))?.poll_shutdown(context)
    }

    /// TCP takes several pieces at once, and so does TLS.
    fn is_write_vectored(&self) -> bool {
        true
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        slices: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let written = ready!(self.stream.poll_ready(context))?.poll_write_vectored(context, slices);
        self.count_sent(written)
    }
}
