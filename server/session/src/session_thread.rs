//! A session in real time: a thread that sleeps until the session's core is due, and lends it threads and a clock.

use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use kerf_physics::Workers;
use kerf_physics::world::ObjectStats;
use rayon::{ThreadPool, ThreadPoolBuilder};
use tokio::sync::{OwnedSemaphorePermit, oneshot};

use crate::clock::MonotonicClock;
use crate::error::SessionError;
use crate::inbox::Inbox;
use crate::prepare::Permits;
use crate::priority::{self, Following, RealTime};
use crate::projector::Projector;
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
    build: impl FnOnce() -> Result<(SessionCore, Projector), SessionError> + Send + 'static,
) -> Result<(Option<JoinHandle<()>>, oneshot::Receiver<Built>), SessionError> {
    let (say, built) = oneshot::channel();
    #[cfg(feature = "virtual-time")]
    if crate::virtual_time::now_ns().is_some() {
        tokio::spawn(async move {
            if let Some((core, projector, _slot)) = begun(permits, say, build) {
                crate::session_task::run(core, projector, &inbox).await;
            }
        });
        return Ok((None, built));
    }
    let stepping = Stepping::with(threads)?;
    let body = move || {
        if let Some((core, projector, _slot)) = begun(permits, say, build) {
            run_shown(core, projector, &inbox, &stepping);
        }
    };
    let thread = std::thread::Builder::new().name(name).spawn(body);
    let thread = thread.map_err(|error| SessionError::NoThread { message: error.to_string() })?;
    Ok((Some(thread), built))
}

/// Builds a session's core and says so; with it what the session has a place by. `None` where that failed, or where nobody
/// waits for the session any more: it never begins.
fn begun(
    permits: Permits,
    say: oneshot::Sender<Built>,
    build: impl FnOnce() -> Result<(SessionCore, Projector), SessionError>,
) -> Option<(SessionCore, Projector, OwnedSemaphorePermit)> {
    let Permits { slot, build: building } = permits;
    if say.is_closed() {
        return None;
    }
    let built = build();
    drop(building);
    match built {
        Ok((core, projector)) => say.send(Ok(told(&core))).ok().map(|()| (core, projector, slot)),
        Err(error) => {
            drop(say.send(Err(error)));
            None
        }
    }
}

fn told(core: &SessionCore) -> Told {
    let warnings = kerf_scenes::examine::warnings(core.scene(), core.world());
    Told { objects: core.world().object_stats(), warnings: warnings.iter().map(ToString::to_string).collect() }
}

/// Runs a session on this thread, and what shows it on another, until it is closed.
fn run_shown(core: SessionCore, projector: Projector, inbox: &Inbox, stepping: &Stepping) {
    std::thread::scope(|threads| {
        let projecting = std::thread::Builder::new().name("kerf-view".into());
        let projecting = projecting.spawn_scoped(threads, move || {
            priority::stand_back();
            projector.run(&MonotonicClock);
        });
        if let Err(error) = projecting {
            tracing::error!(%error, "there is no thread that shows the session: it steps, and viewers see nothing");
        }
        // Threads take over the priority of the one that starts them: this one asks when it has started its own.
        run(core, inbox, stepping.pool.as_ref());
    });
}

/// Runs a session on this thread until it is closed.
fn run(mut core: SessionCore, inbox: &Inbox, pool: Option<&ThreadPool>) {
    let workers = pool.map_or_else(Workers::serial, Workers::of);
    core.warm_up(&workers, &MonotonicClock);
    let mut priority = Following::begin();
    let mut wake = Wake::At(MonotonicClock::now_ns());
    loop {
        match wake {
            Wake::At(due_ns) => MonotonicClock::sleep_until(due_ns),
            Wake::OnCommand { or_at_ns } => {
                inbox.wait(Duration::from_nanos(or_at_ns.saturating_sub(MonotonicClock::now_ns())));
            }
            Wake::Never => return,
        }
        if pool.is_none() {
            priority.follow(core.demand());
        }
        core.obey_commands();
        wake = core.tick(MonotonicClock::now_ns(), &workers, &MonotonicClock);
    }
}

/// The threads that a session steps with.
struct Stepping {
    /// `None`: the session's own suffices.
    pool: Option<ThreadPool>,
    /// What the pool's may have.
    _real_time: Option<Arc<RealTime>>,
}

impl Stepping {
    fn with(threads: usize) -> Result<Self, SessionError> {
        if threads <= 1 {
            return Ok(Self { pool: None, _real_time: None });
        }
        let real_time = RealTime::claim(threads).map(Arc::new);
        let of_pool = real_time.clone();
        let pool = ThreadPoolBuilder::new()
            .num_threads(threads)
            .thread_name(|i| format!("kerf-worker-{i}"))
            .start_handler(move |_| match &of_pool {
                Some(real_time) => real_time.begin(),
                None => priority::favour(),
            });
        let pool = pool.build().map_err(|error| SessionError::NoThread { message: error.to_string() })?;
        Ok(Self { pool: Some(pool), _real_time: real_time })
    }
}
