//! A session as others hold it: commands, drivers, viewers.

mod driver;

pub use driver::{Driver, Reports};

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, OnceLock};
use std::thread::JoinHandle;

use kerf_physics::Scene;
use kerf_physics::world::ObjectStats;
use tokio::sync::{OwnedSemaphorePermit, oneshot, watch};
use tracing::Span;

use crate::TRACES;
use crate::admission::{Admitted, Load};
use crate::checkpoints::{Checkpoint, CheckpointInfo};
use crate::clock::MonotonicClock;
use crate::counts::Counts;
use crate::error::SessionError;
use crate::inbox::{CheckpointCommand, Command, Inbox, Inspection};
use crate::late_steps::{LateStep, LateSteps};
use crate::limits::{SessionLimits, to_ns};
use crate::lock::lock;
use crate::outbox::{Outbox, Viewer};
use crate::player::{Footage, Player};
use crate::prepare::Prepared;
use crate::publisher::Publisher;
use crate::seek::{Position, Seek};
use crate::session_core::SessionCore;
use crate::session_id::SessionId;
use crate::session_options::{Owner, SessionOptions};
use crate::session_thread::{self, Told};
use crate::status::{Phase, SessionStatus};
use crate::step_report::StepReport;
use crate::stepping::{Stepped, Steps};
use crate::tape::{Base, CAPACITY, Reel, TapeReader, Wants};
use crate::vitals::Watched;
use kerf_scenes::dial::Choice;

/// What a session that is played needs besides its frames.
pub struct Replay {
    /// The scene that was recorded.
    pub scene: Scene,
    /// What its objects consisted of.
    pub objects: Vec<ObjectStats>,
    /// Its frames.
    pub footage: Box<dyn Footage>,
    /// Where to begin and how fast.
    pub seek: Seek,
}

/// A scene that is simulated, or a recording that is played, on a thread of its own.
pub struct Session {
    id: SessionId,
    owner: Option<Owner>,
    scene: Arc<Scene>,
    choice: Option<Choice>,
    objects: Vec<ObjectStats>,
    warnings: Vec<String>,
    limits: SessionLimits,
    inbox: Arc<Inbox>,
    outbox: Arc<Outbox>,
    bell: watch::Receiver<u64>,
    reports: watch::Receiver<Arc<StepReport>>,
    thread: Mutex<Option<JoinHandle<()>>>,
    reel: Mutex<Option<Reel>>,
    journal: Mutex<Option<TapeReader>>,
    load: Arc<Load>,
    /// `None`: it is a recording that is played, and takes no steps.
    late_steps: Option<LateSteps>,
    /// Of its life, for traces.
    span: Span,
    memory_bytes: f64,
    /// When somebody last had to do with it.
    last_used_ns: AtomicU64,
    /// Where it goes on, once it has left.
    moved_to: OnceLock<String>,
}

/// The span of a session's life. It has no parent, because it outlives the request that it begins with; that one is linked.
fn life(id: SessionId, scene: &Scene) -> Span {
    let span = tracing::info_span!(
        target: TRACES,
        parent: None,
        "session",
        session.id = %id,
        scene.name = scene.desc.name,
        step_rate_hz = scene.desc.rate_hz,
    );
    span.follows_from(Span::current());
    span
}

impl Session {
    /// Builds the scene on the session's thread, takes it to where its past left it, and lets it run.
    pub(crate) async fn start(
        id: SessionId,
        prepared: Prepared,
        options: SessionOptions,
        limits: SessionLimits,
        counts: Arc<Counts>,
    ) -> Result<Self, SessionError> {
        let Prepared { scene, past, choice, admitted, permits } = prepared;
        let phase = if options.start_paused { Phase::Paused } else { Phase::Running };
        let (mut session, mut publisher) = Self::idle(id, scene.clone().into(), limits.clone(), phase, &admitted);
        session.owner = past.as_ref().map_or(options.owner, |past| past.owner.clone());
        session.choice = choice;
        publisher.counts = counts;
        let (late_steps, put) = LateSteps::new();
        publisher.late_steps = Some(put);
        session.late_steps = Some(late_steps);
        let reel = options.is_recorded.then(|| {
            let mut pictures = session.outbox.join_for_the_record(session.bell.clone());
            // The first look asks for a keyframe.
            pictures.try_next();
            Reel { tape: publisher.tape.reader(Wants::Hashes, CAPACITY), pictures }
        });
        let journal = options.is_journaled.then(|| publisher.tape.reader(Wants::Bases, CAPACITY));
        (session.reel, session.journal) = (Mutex::new(reel), Mutex::new(journal));
        let (inbox, threads) = (Arc::clone(&session.inbox), limits.threads_per_session);
        let build = {
            let inbox = Arc::clone(&inbox);
            let making = options.making;
            let tell = move |now| {
                making.send_replace(Some(now));
            };
            move || SessionCore::new(scene, limits, inbox, publisher, admitted, past, tell)
        };
        let (thread, built) = session_thread::start(format!("kerf-{id}"), threads, inbox, permits, build)?;
        // Its end closes the inbox: whoever gives up while the scene is built leaves no thread that steps for nobody.
        session.thread = Mutex::new(thread);
        Told { objects: session.objects, warnings: session.warnings } =
            built.await.map_err(|_| SessionError::Closed)??;
        Ok(session)
    }

    /// Plays a recording in a session's place.
    pub(crate) fn play(
        id: SessionId,
        replay: Replay,
        admitted: Admitted,
        slot: OwnedSemaphorePermit,
        limits: SessionLimits,
    ) -> Result<Self, SessionError> {
        let Replay { scene, objects, footage, seek } = replay;
        let (mut session, publisher) = Self::idle(id, Arc::new(scene), limits, Phase::Running, &admitted);
        session.objects = objects;
        let player = Player::new(footage, publisher, seek)?;
        let thread = {
            let inbox = Arc::clone(&session.inbox);
            std::thread::Builder::new().name(format!("kerf-{id}")).spawn(move || {
                player.run(&inbox);
                drop(slot);
            })
        };
        let thread = thread.map_err(|error| SessionError::NoThread { message: error.to_string() })?;
        session.thread = Mutex::new(Some(thread));
        Ok(session)
    }

    /// One without a thread, and what its thread is to publish by.
    fn idle(
        id: SessionId,
        scene: Arc<Scene>,
        limits: SessionLimits,
        phase: Phase,
        admitted: &Admitted,
    ) -> (Self, Publisher) {
        let outbox = Arc::new(Outbox::new(&limits, phase));
        let (publisher, bell, reports) = Publisher::new(Arc::clone(&outbox));
        let session = Self {
            id,
            owner: None,
            choice: None,
            objects: Vec::new(),
            warnings: Vec::new(),
            inbox: Arc::new(Inbox::new(scene.desc.tools.len(), limits.clone())),
            limits,
            outbox,
            bell,
            reports,
            thread: Mutex::new(None),
            reel: Mutex::new(None),
            journal: Mutex::new(None),
            load: Arc::clone(&admitted.load),
            late_steps: None,
            span: life(id, &scene),
            memory_bytes: admitted.memory.bytes(),
            last_used_ns: AtomicU64::new(MonotonicClock::now_ns()),
            moved_to: OnceLock::new(),
            scene,
        };
        (session, publisher)
    }

    /// Its id.
    #[must_use]
    pub fn id(&self) -> SessionId {
        self.id
    }

    /// Whose it is; `None`: nobody's.
    #[must_use]
    pub fn owner(&self) -> Option<&Owner> {
        self.owner.as_ref()
    }

    /// Its scene.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// What the dial was set to; `None` where nobody asked for anything.
    #[must_use]
    pub fn dial(&self) -> Option<&Choice> {
        self.choice.as_ref()
    }

    /// What its objects consisted of at rest, in the order of the scene.
    #[must_use]
    pub fn object_stats(&self) -> &[ObjectStats] {
        &self.objects
    }

    /// What its scene hardly means, as `kerf-server check` warns of it.
    #[must_use]
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// What it holds clients to.
    #[must_use]
    pub fn limits(&self) -> &SessionLimits {
        &self.limits
    }

    /// What it is doing.
    #[must_use]
    pub fn phase(&self) -> Phase {
        self.outbox.phase()
    }

    /// Whether it is a recording that is played.
    #[must_use]
    pub fn is_replay(&self) -> bool {
        self.late_steps.is_none()
    }

    /// What it was told to put on a tape: given out once, and nothing where it was not.
    pub fn take_reel(&self) -> Option<Reel> {
        lock(&self.reel).take()
    }

    /// The tape of its journal: given out once, and nothing where it has none.
    pub fn take_journal(&self) -> Option<TapeReader> {
        lock(&self.journal).take()
    }

    /// How it is doing, as of now. Nobody is asked: a thread that hangs is waited for by none.
    #[must_use]
    pub fn watched(&self) -> Watched {
        let (now_ns, vitals) = (MonotonicClock::now_ns(), &self.outbox.vitals);
        let (kept_patches, kept_patch_bytes) = self.outbox.kept_patches();
        Watched {
            phase: self.phase(),
            hangs: vitals.hangs(now_ns),
            away_ns: vitals.away_ns(now_ns),
            done: vitals.done(),
            viewers: self.viewers(),
            drivers: self.inbox.drivers(),
            waiting_commands: self.inbox.waiting_commands(),
            kept_patches,
            kept_patch_bytes,
            awaits_keyframe: self.outbox.keyframe_wanted(),
        }
    }

    /// Viewers that are connected.
    #[must_use]
    pub fn viewers(&self) -> usize {
        self.outbox.viewers()
    }

    /// Tools that somebody drives.
    #[must_use]
    pub fn held_tools(&self) -> Vec<usize> {
        self.inbox.held_tools()
    }

    /// Cores that its steps have kept busy of late: the time of a step over the time that it has.
    #[must_use]
    pub fn load(&self) -> f64 {
        self.load.measured()
    }

    /// Some of the steps that have ended late since this was last asked: the first [`crate::MAX_LATE_STEPS`].
    #[must_use]
    pub fn take_late_steps(&self) -> Vec<LateStep> {
        self.late_steps.as_ref().map(LateSteps::take).unwrap_or_default()
    }

    /// Notes in a span that is traced which session it is about.
    pub fn note_in(&self, span: &Span) {
        if !span.is_disabled() {
            span.record("session.id", self.id.to_string()).record("scene.name", self.scene.desc.name.as_str());
        }
    }

    /// The span of its life, which ends with it.
    #[must_use]
    pub fn span(&self) -> &Span {
        &self.span
    }

    /// Memory that it was told to need before it was built, bytes.
    #[must_use]
    pub fn memory_bytes(&self) -> f64 {
        self.memory_bytes
    }

    /// Somebody has to do with it.
    pub(crate) fn touch(&self) {
        self.last_used_ns.store(MonotonicClock::now_ns(), Ordering::Relaxed);
    }

    /// Whether nobody has had to do with it for as long as the limit says.
    pub(crate) fn is_idle(&self, now_ns: u64) -> bool {
        if self.viewers() > 0 || self.inbox.drivers() > 0 || self.is_replay() {
            self.touch();
        }
        now_ns.saturating_sub(self.last_used_ns.load(Ordering::Relaxed)) >= to_ns(self.limits.idle_timeout_s)
    }

    /// Stops stepping; answers with the step after which it stands.
    ///
    /// # Errors
    /// The queue is full or the session has ended.
    pub async fn pause(&self) -> Result<u64, SessionError> {
        self.ask(Command::Pause).await
    }

    /// Steps on; answers with the step from which it goes on.
    ///
    /// # Errors
    /// The queue is full, the sessions that run leave no time for this one, or it has ended or failed.
    pub async fn resume(&self) -> Result<u64, SessionError> {
        self.load.run()?;
        self.ask(Command::Resume).await?
    }

    /// Takes steps one after the other without waiting for their deadlines, stands after them, and answers then. The
    /// same calls from the same state lead to the same state.
    ///
    /// # Errors
    /// An input is refused, before the first step; the session is told something else meanwhile; the queue is full; or
    /// the session has ended or failed.
    pub async fn step(&self, steps: Steps) -> Result<Stepped, SessionError> {
        self.ask(|answer| Command::Step(steps, answer)).await?
    }

    /// Puts the scene back to rest.
    ///
    /// # Errors
    /// The queue is full or the session has ended.
    pub async fn reset(&self) -> Result<(), SessionError> {
        self.ask(Command::Reset).await?
    }

    /// Saves the state as it is as a checkpoint to go back to, in place of one of the same name; answers with
    /// its step. Checkpoints outlive a reset.
    ///
    /// # Errors
    /// The name is empty or too long, the session keeps as many checkpoints as it may or has failed, the queue
    /// is full, or the session has ended.
    pub async fn save_checkpoint(&self, name: &str) -> Result<u64, SessionError> {
        self.ask(|answer| Command::Checkpoint(CheckpointCommand::Save(name.into(), answer))).await?
    }

    /// Takes the scene back to a checkpoint, every tool lifted; answers with its step. A session that had failed
    /// stands afterwards, others go on as they were.
    ///
    /// # Errors
    /// There is no such checkpoint, the queue is full or the session has ended.
    pub async fn restore_checkpoint(&self, name: &str) -> Result<u64, SessionError> {
        self.ask(|answer| Command::Checkpoint(CheckpointCommand::Restore(name.into(), answer))).await?
    }

    /// A checkpoint, to be made a file of. It is shared and not copied: no step waits for it.
    ///
    /// # Errors
    /// There is no such checkpoint, the queue is full or the session has ended.
    pub async fn checkpoint(&self, name: &str) -> Result<Checkpoint, SessionError> {
        self.ask(|answer| Command::Checkpoint(CheckpointCommand::Read(name.into(), answer))).await?
    }

    /// A copy of the state as it is: what a file is made of, and read by. It takes no place among the checkpoints.
    ///
    /// # Errors
    /// There is no room for it, the queue is full, or the session has ended or failed.
    pub async fn copy(&self) -> Result<Checkpoint, SessionError> {
        self.ask(|answer| Command::Checkpoint(CheckpointCommand::Copy(answer))).await?
    }

    /// Whether a checkpoint of this name could be kept, to be asked before a large file is read.
    ///
    /// # Errors
    /// The name is empty or too long, the session keeps as many checkpoints as it may, the queue is full, or the session
    /// has ended.
    pub async fn check_checkpoint(&self, name: &str) -> Result<(), SessionError> {
        self.ask(|answer| Command::Checkpoint(CheckpointCommand::Check(name.into(), answer))).await?
    }

    /// Keeps a checkpoint that came as a file, in place of one of the same name; answers with its step.
    ///
    /// # Errors
    /// As of [`Session::check_checkpoint`].
    pub async fn keep_checkpoint(&self, name: &str, checkpoint: Checkpoint) -> Result<u64, SessionError> {
        self.ask(|answer| Command::Checkpoint(CheckpointCommand::Keep(name.into(), checkpoint, answer))).await?
    }

    /// Forgets a checkpoint.
    ///
    /// # Errors
    /// There is no such checkpoint, the queue is full or the session has ended.
    pub async fn delete_checkpoint(&self, name: &str) -> Result<(), SessionError> {
        self.ask(|answer| Command::Checkpoint(CheckpointCommand::Delete(name.into(), answer))).await?
    }

    /// The checkpoints that can be gone back to, in the order of saving.
    ///
    /// # Errors
    /// The queue is full or the session has ended.
    pub async fn checkpoints(&self) -> Result<Vec<CheckpointInfo>, SessionError> {
        self.ask(|answer| Command::Checkpoint(CheckpointCommand::List(answer))).await
    }

    /// Goes to a time of the recording that is played, sets its speed, and tells both.
    ///
    /// # Errors
    /// The session is simulated, the recording cannot be read there, the queue is full or the session has ended.
    pub async fn seek(&self, to: Seek) -> Result<Position, SessionError> {
        self.ask(|answer| Command::Seek(to, answer)).await?
    }

    /// Stands, and gives away all that it goes on from on another server. Until it is told to [stay](Self::stay) it refuses
    /// what would change it.
    ///
    /// # Errors
    /// It leaves already, is played, or has failed; there is no room for a copy of its state, the queue is full, or it has ended.
    pub async fn leave(&self) -> Result<Arc<Base>, SessionError> {
        self.ask(Command::Leave).await?
    }

    /// Goes on here, as before it was to leave.
    ///
    /// # Errors
    /// The queue is full, or it has ended.
    pub async fn stay(&self) -> Result<(), SessionError> {
        self.ask(Command::Stay).await?
    }

    /// Where it goes on, if it has left.
    #[must_use]
    pub fn moved_to(&self) -> Option<&str> {
        self.moved_to.get().map(String::as_str)
    }

    /// It goes on there.
    pub(crate) fn note_moved(&self, to: &str) {
        self.moved_to.get_or_init(|| to.into());
    }

    /// Describes the session after its last step.
    ///
    /// # Errors
    /// The queue is full or the session has ended.
    pub async fn describe(&self) -> Result<SessionStatus, SessionError> {
        self.ask(Command::Describe).await
    }

    /// Lets `inspect` see the world between two steps. It runs on the session's thread, so its time
    /// is the session's; a panic in it fails the session as one in a step does.
    ///
    /// # Errors
    /// The queue is full, or the session has ended or fails.
    pub async fn query<T: Send + 'static>(
        &self,
        inspect: impl FnOnce(&mut Inspection<'_>) -> T + Send + 'static,
    ) -> Result<T, SessionError> {
        if self.is_replay() {
            return Err(SessionError::IsReplay);
        }
        self.ask(|answer| {
            Command::Query(Box::new(move |inspection| {
                let _ = answer.send(inspect(inspection));
            }))
        })
        .await
    }

    async fn ask<T>(&self, command: impl FnOnce(oneshot::Sender<T>) -> Command) -> Result<T, SessionError> {
        let (answer, answered) = oneshot::channel();
        self.inbox.push(command(answer))?;
        // A command is dropped unanswered when the session ends or a panic gets in its way.
        answered.await.map_err(|_| match (self.inbox.is_closing(), self.phase()) {
            (true, _) => SessionError::Closed,
            (false, Phase::Failed { message }) => SessionError::Failed { message: message.to_string() },
            (false, _) => SessionError::Failed { message: "a panic before the command was answered".into() },
        })
    }

    /// A driver that holds `tools`, all or none.
    ///
    /// # Errors
    /// A tool is not there or taken, the session has ended, failed or has as many drivers as it may.
    pub fn drive(self: &Arc<Self>, tools: &[usize]) -> Result<Driver, SessionError> {
        self.drive_as("", tools)
    }

    /// The same for a client of this key, which takes over what an older driver of the same key still holds. An empty one
    /// is none.
    ///
    /// # Errors
    /// Those of [`Session::drive`].
    pub fn drive_as(self: &Arc<Self>, client_key: &str, tools: &[usize]) -> Result<Driver, SessionError> {
        if self.is_replay() {
            return Err(SessionError::IsReplay);
        }
        if let Phase::Failed { message } = self.phase() {
            return Err(SessionError::Failed { message: message.to_string() });
        }
        let id = self.inbox.connect_driver(client_key)?;
        // From here on the driver's end disconnects it.
        let mut reports = self.reports.clone();
        // Reports go out while there are drivers: the newest may be older than this one.
        reports.mark_unchanged();
        let mut driver = Driver::new(Arc::clone(self), id, reports);
        driver.claim(tools)?;
        Ok(driver)
    }

    /// A viewer: a keyframe, then what changes.
    ///
    /// # Errors
    /// The session has as many viewers as it may.
    pub fn view(&self) -> Result<Viewer, SessionError> {
        self.outbox.join(self.bell.clone())
    }

    /// Tells the session to end.
    pub(crate) fn begin_close(&self) {
        self.inbox.close();
    }

    /// Ends the session and waits for its thread. A second call finds nothing to do.
    pub async fn close(&self) {
        self.begin_close();
        let mut bell = self.bell.clone();
        // The bell's end is the thread's last act but its return.
        while bell.changed().await.is_ok() {}
        if let Some(thread) = lock(&self.thread).take()
            && thread.join().is_err()
        {
            tracing::error!(session = %self.id, "the session's thread panicked outside a step");
        }
    }
}

impl Drop for Session {
    /// A session that nobody holds ends; its thread is not waited for.
    fn drop(&mut self) {
        self.begin_close();
    }
}
