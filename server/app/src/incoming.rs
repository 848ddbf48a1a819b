//! Accepts connections: at most as many as the limit, from one peer and from all; the listener's own backlog holds
//! the others. One that says nothing after it was accepted is let go.

use std::collections::HashMap;
use std::future::Future;
use std::io;
use std::net::IpAddr;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;

use futures_util::{Stream, stream};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::Sleep;
use tonic::transport::server::{Connected, TcpConnectInfo};

use crate::config::TransportLimits;

/// Time to wait when a connection cannot be accepted: the process is out of file descriptors, and
/// only the end of other connections helps.
const ACCEPT_RETRY: Duration = Duration::from_millis(50);
/// Bytes that HTTP/2 begins a connection with. From then on the protocol's own pings find out who is not there;
/// a request of HTTP/1.1 that is shorter is whole with them.
const PREFACE_BYTES: usize = 24;

/// A connection that is counted.
pub struct Connection {
    stream: TcpStream,
    handshake: Option<Handshake>,
    _of_peer: OfPeer,
    _permit: OwnedSemaphorePermit,
}

/// The beginning of a connection, which may not take for ever.
struct Handshake {
    bytes: usize,
    deadline: Pin<Box<Sleep>>,
}

/// The connections of a listener.
pub fn connections(
    listener: TcpListener,
    limits: &TransportLimits,
) -> impl Stream<Item = io::Result<Connection>> + use<> {
    let permits = Arc::new(Semaphore::new(limits.max_connections.min(Semaphore::MAX_PERMITS)));
    let peers = Arc::new(Peers { open: Mutex::default(), max: limits.max_connections_per_peer });
    let handshake_timeout = Duration::from_secs_f64(limits.handshake_timeout_s);
    stream::unfold((listener, permits, peers), move |(listener, permits, peers)| async move {
        let permit = Arc::clone(&permits).acquire_owned().await.ok()?;
        let (stream, of_peer) = accept(&listener, &peers).await;
        let deadline = Box::pin(tokio::time::sleep(handshake_timeout));
        let handshake = Some(Handshake { bytes: 0, deadline });
        let connection = Connection { stream, handshake, _of_peer: of_peer, _permit: permit };
        Some((Ok(connection), (listener, permits, peers)))
    })
}

async fn accept(listener: &TcpListener, peers: &Arc<Peers>) -> (TcpStream, OfPeer) {
    loop {
        match listener.accept().await {
            Ok((stream, address)) => {
                // Closed at once where it is one too many: its peer's others go on.
                let Some(of_peer) = peers.count(address.ip()) else { continue };
                // A held-back small message costs a round trip; a socket without the option still works.
                if let Err(error) = stream.set_nodelay(true) {
                    tracing::warn!(%error, "TCP_NODELAY");
                }
                return (stream, of_peer);
            }
            Err(error) => {
                tracing::warn!(%error, "a connection could not be accepted");
                tokio::time::sleep(ACCEPT_RETRY).await;
            }
        }
    }
}

/// Connections that are open, by the address of the peer.
struct Peers {
    open: Mutex<HashMap<IpAddr, usize>>,
    max: usize,
}

impl Peers {
    fn lock(&self) -> MutexGuard<'_, HashMap<IpAddr, usize>> {
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Counts another connection of a peer, unless it has as many as it may.
    fn count(self: &Arc<Self>, peer: IpAddr) -> Option<OfPeer> {
        let mut open = self.lock();
        let count = open.entry(peer).or_default();
        (*count < self.max).then(|| {
            *count += 1;
            OfPeer { peer, peers: Arc::clone(self) }
        })
    }
}

/// Counts as one connection of a peer while it lives.
struct OfPeer {
    peer: IpAddr,
    peers: Arc<Peers>,
}

impl Drop for OfPeer {
    fn drop(&mut self) {
        let mut open = self.peers.lock();
        if let Some(count) = open.get_mut(&self.peer) {
            *count -= 1;
            if *count == 0 {
                open.remove(&self.peer);
            }
        }
    }
}

impl Connected for Connection {
    type ConnectInfo = TcpConnectInfo;

    fn connect_info(&self) -> TcpConnectInfo {
        self.stream.connect_info()
    }
}

impl AsyncRead for Connection {
    fn poll_read(mut self: Pin<&mut Self>, context: &mut Context<'_>, into: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        let before = into.filled().len();
        let read = Pin::new(&mut self.stream).poll_read(context, into);
        let Some(handshake) = &mut self.handshake else { return read };
        handshake.bytes += into.filled().len() - before;
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
        Pin::new(&mut self.stream).poll_write(context, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        slices: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write_vectored(context, slices)
    }
}
