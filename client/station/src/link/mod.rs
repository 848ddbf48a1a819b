//! The link: motions to the server, contacts to the servo.
//!
//! Two threads. One sends poses by the clock, as kerf-load does; the other runs the network's tasks: it dials, reads
//! contacts, and dials again when the stream breaks or falls silent. Neither ever waits for the servo, nor it for them.

mod connection;
mod deadband;
mod estimates;
mod probe;
mod receiver;
mod sender;
mod session;
mod status;
#[cfg(feature = "virtual-time")]
pub mod virtual_network;
mod wire;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;

use kerf_proto::v1;
use tokio::sync::{mpsc, oneshot};

pub use self::probe::{ServerProbe, probe};
pub use self::session::SharedSession;
pub use self::status::{LinkState, LinkStatus, SharedStatus};
use crate::config::{DeviceConfig, LinkConfig, ServerConfig, StationConfig};
use crate::servo::model::Update;
use crate::servo::runner::Motion;

/// What a link is to do.
#[derive(Clone, Debug)]
pub struct LinkSettings {
    /// The server.
    pub server: ServerConfig,
    /// The session.
    pub session: Arc<SharedSession>,
    /// Ids of the tools that it drives in turn.
    pub tool_ids: Arc<[u32]>,
    /// Rates and deadbands.
    pub link: LinkConfig,
    /// The device's newtons per newton of the scene.
    pub force_scale: f64,
}

impl LinkSettings {
    /// Those of a device that drives tools of a session in turn.
    #[must_use]
    pub fn new(
        config: &StationConfig,
        device: &DeviceConfig,
        session: Arc<SharedSession>,
        tool_ids: Arc<[u32]>,
    ) -> Self {
        let (server, link) = (config.server.clone(), config.link.clone());
        Self { server, session, tool_ids, link, force_scale: device.mapping.force_scale }
    }
}

/// An open stream, as the sending thread sees it; another one takes its place when it breaks.
#[derive(Clone, Debug)]
struct Uplink {
    /// Rises with each stream.
    epoch: u64,
    up: mpsc::Sender<v1::ControlRequest>,
    /// Number of the newest contact that was read.
    received: Arc<AtomicU64>,
    lease_s: f64,
    workspace: Option<[v1::Vec3; 2]>,
}

/// A running link.
pub struct Link {
    status: SharedStatus,
    stop: Arc<AtomicBool>,
    stop_network: Option<oneshot::Sender<()>>,
    threads: Vec<JoinHandle<()>>,
}

impl Link {
    /// Starts a link between the slots of a servo and a server.
    ///
    /// # Errors
    /// A thread cannot be started.
    pub fn start(
        settings: LinkSettings,
        motions: triple_buffer::Output<Motion>,
        updates: triple_buffer::Input<Update>,
    ) -> std::io::Result<Self> {
        let status = SharedStatus::default();
        let stop = Arc::new(AtomicBool::new(false));
        let uplink = sender::SharedUplink::default();
        let (stop_network, stopped) = oneshot::channel();
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let mut sender = sender::Sender::new(&settings, motions, uplink.clone(), status.clone(), Arc::clone(&stop));
        let dialler = connection::Dialler::new(settings, uplink, status.clone(), updates);
        let thread = |name: &str| std::thread::Builder::new().name(name.to_owned());
        let threads = vec![
            thread("station-send").spawn(move || sender.run())?,
            thread("station-link").spawn(move || runtime.block_on(dialler.run(stopped)))?,
        ];
        Ok(Self { status, stop, stop_network: Some(stop_network), threads })
    }

    /// A link without threads of its own: how it is doing, and what is to be polled for it.
    #[cfg(feature = "virtual-time")]
    pub(crate) fn as_task(
        settings: LinkSettings,
        motions: triple_buffer::Output<Motion>,
        updates: triple_buffer::Input<Update>,
    ) -> (SharedStatus, impl Future<Output = ()>) {
        let (status, uplink) = (SharedStatus::default(), sender::SharedUplink::default());
        let mut sender = sender::Sender::new(&settings, motions, uplink.clone(), status.clone(), Arc::default());
        let dialler = connection::Dialler::new(settings, uplink, status.clone(), updates);
        let task = async move {
            let (_never, stopped) = oneshot::channel();
            tokio::join!(sender.run_as_task(), dialler.run(stopped));
        };
        (status, task)
    }

    /// How it is doing.
    #[must_use]
    pub fn status(&self) -> LinkStatus {
        self.status.get()
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        drop(self.stop_network.take());
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}
