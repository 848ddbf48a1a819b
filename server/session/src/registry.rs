//! The sessions of a server.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use kerf_physics::SoundScene;
use kerf_scenes::cost::Cost;
use kerf_scenes::dial::ParetoFronts;
use tokio::sync::Semaphore;

use crate::admission::Admission;
use crate::clock::MonotonicClock;
use crate::counts::Counts;
use crate::error::SessionError;
use crate::limits::{LimitError, SessionLimits};
use crate::lock::lock;
use crate::past::Past;
use crate::prepare::{Permits, prepare};
use crate::session::{Replay, Session};
use crate::session_id::{InstanceId, SessionId};
use crate::session_options::{Owner, SessionOptions};

/// Sessions that have left and whose clients are told where to; of more the oldest are forgotten. Each takes some hundred bytes.
const MOST_MOVED: usize = 10_000;

/// A session that has left.
struct Moved {
    to: String,
    owner: Option<Owner>,
}

/// The sessions of a server, at most [`SessionLimits::max_sessions`] of them.
pub struct Registry {
    limits: SessionLimits,
    pareto_fronts: Arc<ParetoFronts>,
    sessions: Mutex<BTreeMap<SessionId, Arc<Session>>>,
    /// Those of another run of the server that are not back yet.
    expected: Mutex<BTreeSet<SessionId>>,
    /// Where those have gone that have left.
    moved: Mutex<BTreeMap<SessionId, Moved>>,
    instance: InstanceId,
    next_number: AtomicU64,
    /// One permit per thread that may live, held by the thread.
    permits: Arc<Semaphore>,
    /// One permit per scene that may be read and built at a time.
    builds: Arc<Semaphore>,
    admission: Arc<Admission>,
    counts: Arc<Counts>,
}

impl Registry {
    /// A registry without sessions, whose dial knows these Pareto fronts.
    ///
    /// # Errors
    /// A limit that makes no sense.
    pub fn new(limits: SessionLimits, pareto_fronts: ParetoFronts) -> Result<Self, LimitError> {
        limits.validate()?;
        let permits = Arc::new(Semaphore::new(limits.max_sessions));
        let builds = Arc::new(Semaphore::new(limits.max_builds));
        let [max_memory_mib, max_load] =
            [limits.max_memory_mib, limits.max_load].map(|max| max.unwrap_or(f64::INFINITY));
        let admission = Admission::new(max_memory_mib, max_load, limits.max_setup_s, limits.threads_per_session);
        Ok(Self {
            limits,
            pareto_fronts: Arc::new(pareto_fronts),
            sessions: Mutex::default(),
            expected: Mutex::default(),
            moved: Mutex::default(),
            instance: InstanceId::random(),
            next_number: AtomicU64::new(1),
            permits,
            builds,
            admission,
            counts: Arc::default(),
        })
    }

    /// This run of the server.
    #[must_use]
    pub fn instance(&self) -> InstanceId {
        self.instance
    }

    /// What is counted of all its sessions, those that have ended among them.
    #[must_use]
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// Memory that is taken by sessions and their checkpoints, as it was estimated, bytes.
    #[must_use]
    pub fn taken_memory_bytes(&self) -> f64 {
        self.admission.taken_bytes()
    }

    /// What every session holds its clients to.
    #[must_use]
    pub fn limits(&self) -> &SessionLimits {
        &self.limits
    }

    /// Builds a scene at the dial's setting and starts a session of it; a large scene takes seconds.
    ///
    /// # Errors
    /// The server is full or shutting down, the scene needs more than is left of the machine, the dial cannot be set
    /// as asked, or the scene cannot be built.
    pub async fn create(&self, scene: SoundScene, options: SessionOptions) -> Result<Arc<Session>, SessionError> {
        self.create_from(|| Ok(scene), options).await
    }

    /// Whoever asks for these sessions is told to ask again, until each is brought back, or is not.
    pub fn expect(&self, ids: impl IntoIterator<Item = SessionId>) {
        lock(&self.expected).extend(ids);
    }

    /// Sessions that are not back yet.
    #[must_use]
    pub fn expected(&self) -> usize {
        lock(&self.expected).len()
    }

    /// Brings a session back that another run of the server had: what `read` says of it leads to where it stood.
    ///
    /// # Errors
    /// Those of [`Registry::create`] and of `read`, and that it does not lead there.
    pub async fn bring_back<E: From<SessionError> + Send + 'static>(
        &self,
        id: SessionId,
        read: impl FnOnce() -> Result<(SoundScene, Past), E> + Send + 'static,
        options: SessionOptions,
    ) -> Result<Arc<Session>, E> {
        let read = || read().map(|(scene, past)| (scene, Some(past)));
        let back = self.begin(Some(id), read, options).await;
        lock(&self.expected).remove(&id);
        back
    }

    /// The same for a scene that has yet to be read: `read` runs on a thread of its own when its turn has come, so
    /// that it may take its time.
    ///
    /// # Errors
    /// Those of [`Registry::create`] and of `read`.
    pub async fn create_from<E: From<SessionError> + Send + 'static>(
        &self,
        read: impl FnOnce() -> Result<SoundScene, E> + Send + 'static,
        options: SessionOptions,
    ) -> Result<Arc<Session>, E> {
        self.begin(None, || Ok((read()?, None)), options).await
    }

    /// Begins a session, under an id of this run unless it has one.
    async fn begin<E: From<SessionError> + Send + 'static>(
        &self,
        id: Option<SessionId>,
        read: impl FnOnce() -> Result<(SoundScene, Option<Past>), E> + Send + 'static,
        options: SessionOptions,
    ) -> Result<Arc<Session>, E> {
        let slot = Arc::clone(&self.permits).try_acquire_owned().map_err(|_| match self.permits.is_closed() {
            true => self.draining(),
            false => SessionError::TooManySessions { limit: self.limits.max_sessions },
        })?;
        // A caller who gives up while others are built has cost nothing.
        let build = Arc::clone(&self.builds).acquire_owned().await.map_err(|_| self.draining())?;
        let permits = Permits { slot, build };
        let (limits, fronts, admission) =
            (self.limits.clone(), Arc::clone(&self.pareto_fronts), Arc::clone(&self.admission));
        let wishes = options.clone();
        let prepared = tokio::task::spawn_blocking(move || {
            Ok::<_, E>(prepare(read()?, &wishes, &limits, &fronts, &admission, permits)?)
        });
        let panicked = |_| SessionError::Failed { message: "a panic while the scene was read".into() };
        let prepared = prepared.await.map_err(panicked)??;
        let id = id.unwrap_or_else(|| self.next_id());
        let (limits, counts) = (self.limits.clone(), Arc::clone(&self.counts));
        let session = Arc::new(Session::start(id, prepared, options, limits, counts).await?);
        let mut sessions = lock(&self.sessions);
        if self.permits.is_closed() {
            // The server began to shut down while the scene was being built.
            return Err(self.draining().into());
        }
        if sessions.contains_key(&id) {
            return Err(SessionError::Here { id: id.to_string() }.into());
        }
        sessions.insert(id, Arc::clone(&session));
        lock(&self.moved).remove(&id);
        let dial = session.dial().map(ToString::to_string);
        tracing::info!(session = %id, scene = session.scene().desc.name, dial, "session created");
        session.warnings().iter().for_each(|warning| tracing::warn!(session = %id, "{warning}"));
        Ok(session)
    }

    fn draining(&self) -> SessionError {
        SessionError::Draining { limit_s: self.limits.drain_s }
    }

    /// Plays a recording in the place of a session.
    ///
    /// # Errors
    /// The server is full or shutting down, or nothing of the recording can be shown.
    pub fn play(&self, replay: Replay) -> Result<Arc<Session>, SessionError> {
        let full = |_| SessionError::TooManySessions { limit: self.limits.max_sessions };
        let slot = Arc::clone(&self.permits).try_acquire_owned().map_err(full)?;
        let id = self.next_id();
        let admitted = self.admission.admit(&Cost::default(), 1.0, false)?;
        let session = Arc::new(Session::play(id, replay, admitted, slot, self.limits.clone())?);
        lock(&self.sessions).insert(id, Arc::clone(&session));
        Ok(session)
    }

    fn next_id(&self) -> SessionId {
        SessionId { instance: self.instance, number: self.next_number.fetch_add(1, Ordering::Relaxed) }
    }

    /// The session of this id.
    ///
    /// # Errors
    /// There is none, or it has moved.
    pub fn get(&self, id: &str) -> Result<Arc<Session>, SessionError> {
        self.get_if(id, |_, _| true)
    }

    /// The session of this id, for somebody who is to know of those alone that `is_known` says. Others are not kept alive
    /// by being asked for.
    ///
    /// # Errors
    /// There is none, or it has moved.
    pub fn get_if(
        &self,
        id: &str,
        is_known: impl Fn(SessionId, Option<&Owner>) -> bool,
    ) -> Result<Arc<Session>, SessionError> {
        let parsed = id.parse()?;
        let session = lock(&self.sessions).get(&parsed).filter(|session| is_known(parsed, session.owner())).cloned();
        let session = session.ok_or_else(|| {
            let id = id.into();
            let moved = lock(&self.moved);
            match moved.get(&parsed).filter(|moved| is_known(parsed, moved.owner.as_ref())) {
                Some(Moved { to, .. }) => SessionError::Moved { id, to: to.clone() },
                None => self.absent(parsed),
            }
        })?;
        session.touch();
        Ok(session)
    }

    /// That a session is not here, or not yet. Whose it is is not known before it is read: whoever knows its id is told.
    fn absent(&self, id: SessionId) -> SessionError {
        let is_expected = lock(&self.expected).contains(&id);
        let id = id.to_string();
        if is_expected { SessionError::ComesBack { id } } else { SessionError::NoSession { id } }
    }

    /// All sessions, by id.
    #[must_use]
    pub fn list(&self) -> Vec<Arc<Session>> {
        lock(&self.sessions).values().cloned().collect()
    }

    /// Sessions that nobody has had to do with for as long as the limit says.
    #[must_use]
    pub fn idle(&self) -> Vec<Arc<Session>> {
        let now_ns = MonotonicClock::now_ns();
        lock(&self.sessions).values().filter(|session| session.is_idle(now_ns)).cloned().collect()
    }

    /// Ends a session and waits for its thread.
    ///
    /// # Errors
    /// There is no such session.
    pub async fn close(&self, id: &str) -> Result<(), SessionError> {
        let id = id.parse()?;
        let session = lock(&self.sessions).remove(&id);
        let session = session.ok_or_else(|| self.absent(id))?;
        session.close().await;
        tracing::info!(session = %session.id(), "session closed");
        Ok(())
    }

    /// Ends a session that goes on at another server's address. Its streams and whoever asks for it are told.
    ///
    /// # Errors
    /// It has ended already.
    pub async fn close_moved(&self, session: &Session, to: &str) -> Result<(), SessionError> {
        session.note_moved(to);
        {
            let mut moved = lock(&self.moved);
            moved.insert(session.id(), Moved { to: to.into(), owner: session.owner().cloned() });
            if moved.len() > MOST_MOVED {
                moved.pop_first();
            }
        }
        tracing::info!(session = %session.id(), to, "session moved");
        self.close(&session.id().to_string()).await
    }

    /// Creates no more sessions.
    pub fn refuse_new(&self) {
        self.permits.close();
        self.builds.close();
    }

    /// Ends all sessions and waits for their threads; none can be created afterwards.
    pub async fn close_all(&self) {
        self.refuse_new();
        let sessions = std::mem::take(&mut *lock(&self.sessions));
        // All are told before any is waited for.
        sessions.values().for_each(|session| session.begin_close());
        for session in sessions.values() {
            session.close().await;
        }
    }
}
