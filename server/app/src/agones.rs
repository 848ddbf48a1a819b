//! Membership of a fleet of Agones's: what a server tells the sidecar of its pod. A sidecar that is not there yet, or goes,
//! costs no session anything: the server tries again, and Agones decides what becomes of the pod.
//!
//! Deliberately absent: allocation, which clients ask of the cluster (`allocate`); lists and labels.

use std::sync::Arc;
use std::time::Duration;

use futures_util::stream;
use kerf_proto::agones::Empty;
use kerf_proto::agones::beta::sdk_client::SdkClient as CountersClient;
use kerf_proto::agones::beta::{CounterUpdateRequest, UpdateCounterRequest};
use kerf_proto::agones::sdk_client::SdkClient;
use kerf_session::Registry;
use tokio::task::JoinHandle;
use tokio::time::{interval, sleep, timeout};
use tonic::Status;
use tonic::transport::{Channel, Endpoint};

use crate::config::ServerConfig;

/// How often the sidecar hears that the server lives: Agones's manifests wait for 5 s and more.
const BEAT: Duration = Duration::from_secs(2);
/// How often sessions are counted.
const LOOK: Duration = Duration::from_millis(500);
/// How long a sidecar has for an answer, and how long it is left alone when it gave none.
const PATIENCE: Duration = Duration::from_secs(2);

/// A server's place in a fleet.
pub struct Membership {
    channel: Channel,
    telling: JoinHandle<()>,
    beating: JoinHandle<()>,
}

impl Membership {
    /// Tells the sidecar from now on, where the configuration says where it is.
    pub fn begin(config: &ServerConfig, registry: &Arc<Registry>) -> Option<Self> {
        // The configuration was judged.
        let endpoint = Endpoint::from_shared(config.agones.endpoint.clone()?).ok()?;
        let channel = endpoint.connect_timeout(PATIENCE).connect_lazy();
        let sessions = Sessions {
            registry: Arc::clone(registry),
            counters: CountersClient::new(channel.clone()),
            fleet: SdkClient::new(channel.clone()),
            counter: config.agones.counter.clone(),
            told: None,
        };
        let beating = tokio::spawn(beat(SdkClient::new(channel.clone())));
        Some(Self { channel, telling: tokio::spawn(sessions.tell()), beating })
    }

    /// The server has ended: its pod may go.
    pub async fn end(self) {
        self.telling.abort();
        self.beating.abort();
        let mut fleet = SdkClient::new(self.channel);
        if !matches!(timeout(PATIENCE, fleet.shutdown(Empty {})).await, Ok(Ok(_))) {
            tracing::warn!("Agones's sidecar was not told of the server's end");
        }
    }
}

/// Says that the server lives for as long as it does.
async fn beat(mut fleet: SdkClient<Channel>) {
    loop {
        let mut beats = interval(BEAT);
        let beats = stream::poll_fn(move |context| beats.poll_tick(context).map(|_| Some(Empty {})));
        // It ends with the sidecar alone, whose absence the one who counts has told of.
        let _ = fleet.health(beats).await;
        sleep(PATIENCE).await;
    }
}

/// What the sidecar knows of the sessions.
struct Sessions {
    registry: Arc<Registry>,
    counters: CountersClient<Channel>,
    fleet: SdkClient<Channel>,
    counter: String,
    /// `None`: nothing yet.
    told: Option<usize>,
}

impl Sessions {
    async fn tell(mut self) {
        let mut is_lost = false;
        loop {
            let outcome = match timeout(PATIENCE, self.tell_changes()).await {
                Ok(outcome) => outcome,
                Err(_) => Err(Status::deadline_exceeded(format!("no answer within {PATIENCE:?}"))),
            };
            match (&outcome, is_lost) {
                (Err(status), false) => {
                    tracing::warn!("Agones's sidecar is not told of the sessions: {}", status.message());
                }
                (Ok(()), true) => tracing::info!("Agones's sidecar is told of the sessions"),
                (Err(_), true) | (Ok(()), false) => {}
            }
            is_lost = outcome.is_err();
            sleep(if is_lost { PATIENCE } else { LOOK }).await;
        }
    }

    /// Counts, and says what has changed. A server without sessions is ready: also one that was allocated and has done
    /// what it was there for, so that the fleet may do without it.
    async fn tell_changes(&mut self) -> Result<(), Status> {
        let count = self.registry.list().len();
        if self.told == Some(count) {
            return Ok(());
        }
        let update = CounterUpdateRequest {
            name: self.counter.clone(),
            count: i64::try_from(count).ok(),
            capacity: i64::try_from(self.registry.limits().max_sessions).ok(),
            count_diff: 0,
        };
        self.counters.update_counter(UpdateCounterRequest { counter_update_request: Some(update) }).await?;
        if count == 0 || self.told.is_none() {
            self.fleet.ready(Empty {}).await?;
        }
        self.told = Some(count);
        Ok(())
    }
}
