//! A session in real time: a thread that sleeps until the session's core is due, and lends it threads and a clock.

use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use kerf_physics::Workers;
use kerf_physics::world::ObjectStats;
use rayon::{ThreadPool, ThreadPoolBuilder};
use tokio::sync::oneshot;

use crate::clock::MonotonicClock;
use crate::error::SessionError;
use crate::inbox::Inbox;
use crate::prepare::Permits;
use crate::session_core::{SessionCore, Wake};

/// What is told of a scene that was built.
pub(crate) struct Told {
    /// What its objects consist of.
    pub objects: Vec<ObjectStats>,
    /// What it hardly means.
    pub warnings: Vec<String>,
}

type Built = Result<Told, SessionError>;

/// Starts a thread that builds a session's core, says so and runs it. The permits stay with the thread, so that a
/// caller who gives up waiting for a large scene does not make room for another.
pub(crate) fn start(
    name: String,
    threads: usize,
    inbox: Arc<Inbox>,
    permits: Permits,
    build: impl FnOnce() -> Result<SessionCore, SessionError> + Send + 'static,
) -> Result<(JoinHandle<()>, oneshot::Receiver<Built>), SessionError> {
    let pool = pool(threads)?;
    let (say, built) = oneshot::channel();
    let body = move || {
        let Permits { slot: _slot, build: building } = permits;
        if say.is_closed() {
            return;
        }
        let core = build();
        drop(building);
        match core {
            // A session that nobody waits for any more never begins.
            Ok(core) => {
                if say.send(Ok(told(&core))).is_ok() {
                    run(core, &inbox, pool.as_ref());
                }
            }
            Err(error) => drop(say.send(Err(error))),
        }
    };
    let thread = std::thread::Builder::new().name(name).spawn(body);
    Ok((thread.map_err(|error| SessionError::NoThread { message: error.to_string() })?, built))
}

fn told(core: &SessionCore) -> Told {
    let warnings = kerf_scenes::examine::warnings(core.scene(), core.world());
    Told { objects: core.world().object_stats(), warnings: warnings.iter().map(ToString::to_string).collect() }
}

/// Runs a session on this thread until it is closed.
fn run(mut core: SessionCore, inbox: &Inbox, pool: Option<&ThreadPool>) {
    let workers = pool.map_or_else(Workers::serial, Workers::of);
    let mut wake = Wake::At(MonotonicClock::now_ns());
    loop {
        match wake {
            Wake::At(due_ns) => MonotonicClock::sleep_until(due_ns),
            Wake::OnCommand { or_at_ns } => {
                inbox.wait(Duration::from_nanos(or_at_ns.saturating_sub(MonotonicClock::now_ns())));
            }
            Wake::Never => return,
        }
        core.obey_commands();
        wake = core.tick(MonotonicClock::now_ns(), &workers, &MonotonicClock);
    }
}

/// The threads that a session steps with; `None`: its own suffices.
fn pool(threads: usize) -> Result<Option<ThreadPool>, SessionError> {
    if threads <= 1 {
        return Ok(None);
    }
    let pool = ThreadPoolBuilder::new().num_threads(threads).thread_name(|i| format!("kerf-worker-{i}")).build();
    pool.map(Some).map_err(|error| SessionError::NoThread { message: error.to_string() })
}
