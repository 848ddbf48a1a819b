//! `kerf-server allocate`: asks Agones's allocator for a server of a fleet with room for a session.

use std::collections::HashMap;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, Result, anyhow};
use clap::Args;
use kerf_access::root_cause;
use kerf_proto::agones::allocation::allocation_response::GameServerStatusPort;
use kerf_proto::agones::allocation::allocation_service_client::AllocationServiceClient;
use kerf_proto::agones::allocation::game_server_selector::GameServerState;
use kerf_proto::agones::allocation::priority::{Order, Type};
use kerf_proto::agones::allocation::{AllocationRequest, CounterSelector, GameServerSelector, Priority};
use tonic::transport::{Endpoint, Identity};

/// An allocator that cannot be reached is not waited for, and one that works on it answers within seconds.
const TIMEOUT: Duration = Duration::from_secs(10);
/// The label by which Agones tells of which fleet a server is.
const FLEET: &str = "agones.dev/fleet";

/// Arguments of `allocate`.
#[derive(Args, Clone, Debug)]
pub struct AllocateArgs {
    /// The allocator, as https://NAME:PORT.
    #[arg(value_name = "URL")]
    pub allocator: String,
    /// Namespace of the fleet.
    #[arg(long, default_value = "default")]
    pub namespace: String,
    /// Name of the fleet.
    #[arg(long, default_value = "kerf")]
    pub fleet: String,
    /// The counter of sessions, as the servers' `agones.counter` names it.
    #[arg(long, default_value = "sessions")]
    pub counter: String,
    /// Certificate (PEM) that the allocator knows this client by.
    #[arg(long, value_name = "FILE", requires = "key")]
    pub certificate: Option<PathBuf>,
    /// Its key (PEM).
    #[arg(long, value_name = "FILE", requires = "certificate")]
    pub key: Option<PathBuf>,
    /// Certificates (PEM) of those who are trusted to sign the allocator's. Default: the system's.
    #[arg(long, value_name = "FILE")]
    pub ca_file: Option<PathBuf>,
    /// The servers have no TLS.
    #[arg(long)]
    pub plain: bool,
}

/// Prints the address of a server with room for one more session, for the `--server` of a client.
///
/// # Errors
/// A file cannot be read, the allocator does not answer, or no server has room.
pub fn run(args: &AllocateArgs) -> Result<()> {
    let endpoint = endpoint(args)?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().context("runtime")?;
    let allocated = runtime.block_on(async {
        let channel = endpoint
            .connect_timeout(TIMEOUT)
            .timeout(TIMEOUT)
            .connect()
            .await
            .map_err(|error| anyhow!("no allocator answers at {} ({})", args.allocator, root_cause(&error)))?;
        let answer = AllocationServiceClient::new(channel).allocate(request(args)).await;
        answer.map_err(|status| anyhow!("the fleet `{}` has no server for a session: {}", args.fleet, status.message()))
    })?;
    let allocated = allocated.into_inner();
    let [GameServerStatusPort { port, .. }] = &allocated.ports[..] else {
        return Err(anyhow!(
            "`{}` has {} ports, not the one of a server",
            allocated.game_server_name,
            allocated.ports.len()
        ));
    };
    let scheme = if args.plain { "http" } else { "https" };
    writeln!(std::io::stdout(), "{scheme}://{}:{port}", allocated.address)?;
    Ok(())
}

/// A server that has sessions already before one that has none: full ones leave others to be ended.
fn request(args: &AllocateArgs) -> AllocationRequest {
    let of_state = |state: GameServerState| GameServerSelector {
        match_labels: HashMap::from([(FLEET.into(), args.fleet.clone())]),
        game_server_state: state.into(),
        counters: HashMap::from([(args.counter.clone(), CounterSelector { min_available: 1 })]),
    };
    AllocationRequest {
        namespace: args.namespace.clone(),
        game_server_selectors: [GameServerState::Allocated, GameServerState::Ready].map(of_state).into(),
        priorities: vec![Priority {
            r#type: Type::Counter.into(),
            key: args.counter.clone(),
            order: Order::Ascending.into(),
        }],
    }
}

fn endpoint(args: &AllocateArgs) -> Result<Endpoint> {
    let authority = args.ca_file.as_deref().map(read).transpose()?;
    let identity = match (&args.certificate, &args.key) {
        (Some(certificate), Some(key)) => Some(Identity::from_pem(read(certificate)?, read(key)?)),
        _ => None,
    };
    Ok(kerf_access::endpoint(&args.allocator, authority.as_deref(), identity)?)
}

fn read(path: &Path) -> Result<String> {
    std::fs::read_to_string(path).with_context(|| path.display().to_string())
}
