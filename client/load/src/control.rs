//! The driver's stream: hello, poses up, contacts down.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use anyhow::{Context, bail};
use kerf_access::Wire;
use kerf_proto::v1::control_service_client::ControlServiceClient;
use kerf_proto::v1::{self, ControlRequest, ControlResponse, control_request, control_response};
use prost::Message;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::Streaming;

use crate::clock;
use crate::metrics::ContactMetrics;
use crate::script::Script;
use crate::session::refused;
use crate::timetable::Timetable;
use crate::wire::FRAME_BYTES;

/// Poses that may wait for the transport. Only the newest counts, so few; but the runtime's thread
/// may be a few ticks late on a busy machine, and a dropped pose is a jerk of the tool.
const QUEUED_POSES: usize = 8;

/// A server that accepts a stream answers the hello at once.
const HELLO_TIMEOUT: Duration = Duration::from_secs(10);

/// An open stream.
pub struct Control {
    /// What the server granted.
    pub hello: v1::ServerHello,
    /// Where poses go.
    pub up: mpsc::Sender<ControlRequest>,
    down: Streaming<ControlResponse>,
}

/// Opens a stream and takes the leases of the tools.
///
/// # Errors
/// What the server answers, or another protocol version.
pub async fn open(
    channel: Wire,
    session_id: &str,
    tool_ids: Vec<u32>,
    contact_rate_hz: f64,
) -> anyhow::Result<Control> {
    let (up, queue) = mpsc::channel(QUEUED_POSES);
    let hello = v1::ClientHello {
        protocol_version: kerf_proto::PROTOCOL_VERSION,
        session_id: session_id.to_owned(),
        tool_ids,
        contact_rate_hz,
        ..v1::ClientHello::default()
    };
    up.try_send(ControlRequest { message: Some(control_request::Message::Hello(hello)), received: 0 })
        .context("the queue is new and has room")?;
    let answer = async {
        let mut down = ControlServiceClient::new(channel)
            .control(ReceiverStream::new(queue))
            .await
            .map_err(|status| refused("opening the control stream", &status))?
            .into_inner();
        let first = down.message().await.map_err(|status| refused("opening the control stream", &status))?;
        Ok::<_, anyhow::Error>((down, first))
    };
    let (down, first) =
        tokio::time::timeout(HELLO_TIMEOUT, answer).await.context("the server did not answer the hello")??;
    let Some(ControlResponse { message: Some(control_response::Message::Hello(hello)) }) = first else {
        bail!("the server did not begin with a hello");
    };
    if hello.protocol_version != kerf_proto::PROTOCOL_VERSION {
        bail!(
            "the server speaks version {} of the protocol, this program {}",
            hello.protocol_version,
            kerf_proto::PROTOCOL_VERSION
        );
    }
    Ok(Control { hello, up, down })
}

/// The receiving half of an open stream.
pub struct Receiver {
    down: Streaming<ControlResponse>,
    /// For acknowledgements while no pose takes them along.
    up: mpsc::WeakSender<ControlRequest>,
    received: Arc<AtomicU64>,
}

/// The sending half of an open stream.
pub struct Sender {
    /// Where messages go.
    pub up: mpsc::Sender<ControlRequest>,
    /// Number of the newest contact that was read.
    pub received: Arc<AtomicU64>,
}

impl Sender {
    /// A message that acknowledges what was read until now.
    #[must_use]
    pub fn message(&self, message: control_request::Message) -> ControlRequest {
        ControlRequest { message: Some(message), received: self.received.load(Ordering::Relaxed) }
    }
}

impl Control {
    /// Splits the stream: poses are sent from another thread.
    #[must_use]
    pub fn split(self) -> (Sender, Receiver) {
        let received = Arc::new(AtomicU64::new(0));
        let sender = Sender { up: self.up.clone(), received: Arc::clone(&received) };
        (sender, Receiver { down: self.down, up: self.up.downgrade(), received })
    }
}

impl Receiver {
    /// Waits for the next message and counts it. Safe to drop while waiting.
    ///
    /// # Errors
    /// The stream has ended, a lease was lost, or a message is not valid.
    pub async fn next(
        &mut self,
        metrics: &mut ContactMetrics,
        script: &Script,
        timetable: &Timetable,
    ) -> anyhow::Result<()> {
        let message = self.down.message().await.map_err(|status| refused("the control stream broke", &status))?;
        let now_ns = clock::now_ns();
        let down = message.context("the server ended the control stream")?;
        metrics.bytes += down.encoded_len() as u64 + FRAME_BYTES;
        match down.message.context("the server sent an empty message")? {
            control_response::Message::Contact(contact) => {
                self.acknowledge(contact.number);
                metrics.contact(&contact, now_ns, script, timetable)?;
            }
            control_response::Message::Rejected(rejected) => metrics.rejection(&rejected),
            control_response::Message::Fault(_) => metrics.faults += 1,
            control_response::Message::ToleranceChanged(changed) => {
                metrics.governor_changes += 1;
                metrics.governed_tolerance = Some(changed.relative_tolerance);
            }
            // A script with a pause may lose a lease by silence; its next pose takes it again.
            control_response::Message::LeaseLost(_) => metrics.leases_lost += 1,
            // Somebody else undid what this script did; it goes on.
            control_response::Message::CheckpointRestored(_) => {}
            // Late steps are counted by themselves.
            control_response::Message::Event(_) => {}
            control_response::Message::Hello(_) => bail!("the server sent a second hello"),
        }
        Ok(())
    }

    /// Where the queue is full, a pose is about to take the acknowledgement along.
    fn acknowledge(&self, number: u64) {
        self.received.fetch_max(number, Ordering::Relaxed);
        if let Some(up) = self.up.upgrade() {
            let _ = up.try_send(ControlRequest { message: None, received: number });
        }
    }
}
