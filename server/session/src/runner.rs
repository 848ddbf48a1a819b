//! The thread of a session: paces, drains the inbox, steps the world, publishes.

mod points;

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use kerf_physics::fault::Fault;
use kerf_physics::step_io::EnergyStep;
use kerf_physics::{Scene, StepInputs, Workers, World};

use crate::clock::MonotonicClock;
use crate::error::SessionError;
use crate::governor::Governor;
use crate::inbox::{Command, Drain, Inbox, Probe, Tick};
use crate::limits::{SessionLimits, to_ns};
use crate::lock;
use crate::outbox::{Publisher, SceneEvent, StepReport, ToolReport, ViewState};
use crate::pacer::{Pace, Pacer};
use crate::points::Points;
use crate::recorder::InputLog;
use crate::status::{Phase, SessionStatus, StepTallies, StepTimes};
use crate::structure_log::Place;
use crate::tool_slot::DriverId;

/// How often a session that stands looks after its viewers; commands wake it at once.
const STANDING_TICK: Duration = Duration::from_millis(20);

/// What a session's thread owns.
pub(crate) struct Runner {
    scene: Arc<Scene>,
    limits: SessionLimits,
    world: World,
    pool: Option<rayon::ThreadPool>,
    inbox: Arc<Inbox>,
    publisher: Publisher,
    /// Shared with whoever lists sessions.
    phase: Arc<Mutex<Phase>>,
    pacer: Pacer,
    /// Present where the scene states how much effort may be given up.
    governor: Option<Governor>,
    /// What the governor decided after the last step.
    next_tolerance: Option<f64>,
    log: InputLog,
    points: Points,
    tick: Tick,
    /// Per tool, as of the last tick: who drives it.
    holders: Vec<Option<DriverId>>,
    tally: Tally,
    views: ViewSchedule,
}

/// What has been counted since the scene was at rest.
#[derive(Default)]
struct Tally {
    energy: EnergyStep,
    jumps: Vec<u64>,
    faults: u64,
    last_fault: Option<Fault>,
    steps: StepTallies,
    /// Relative tolerance of the solves, as the governor has it.
    relative_tolerance: f64,
    /// Times that the session went back to a point, and the last one's name.
    restores: u64,
    last_restored: Option<Arc<str>>,
}

impl Tally {
    fn of(scene: &Scene) -> Self {
        let jumps = vec![0; scene.desc.tools.len()];
        Self { jumps, relative_tolerance: scene.desc.relative_tolerance(), ..Self::default() }
    }
}

/// When viewers get what.
#[derive(Default)]
struct ViewSchedule {
    next_state_ns: u64,
    next_keyframe_ns: u64,
    times: StepTimes,
}

/// What a runner is made of.
pub(crate) struct Parts {
    pub scene: Arc<Scene>,
    pub limits: SessionLimits,
    pub inbox: Arc<Inbox>,
    pub publisher: Publisher,
    pub phase: Arc<Mutex<Phase>>,
}

impl Runner {
    /// Builds the scene at rest.
    pub fn build(parts: Parts) -> Result<Self, SessionError> {
        let Parts { scene, limits, inbox, publisher, phase } = parts;
        let world = build_world(&scene)?;
        let pool = lend_threads(limits.threads_per_session)?;
        let pacer = Pacer::new(scene.desc.rate_hz, to_ns(limits.max_lag_s), MonotonicClock::now_ns());
        let log = InputLog::new(limits.max_recorded_motions);
        let points = Points::new(limits.max_points);
        let tools = scene.desc.tools.len();
        let tally = Tally::of(&scene);
        let governor = Governor::of(&scene.desc);
        Ok(Self {
            scene,
            limits,
            world,
            pool,
            inbox,
            publisher,
            phase,
            pacer,
            governor,
            next_tolerance: None,
            log,
            points,
            tick: Tick::default(),
            holders: vec![None; tools],
            tally,
            views: ViewSchedule::default(),
        })
    }

    /// The world, before the first step.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// Steps until the session is closed.
    pub fn run(mut self) {
        self.pacer.restart(MonotonicClock::now_ns());
        let mut commands = Vec::new();
        loop {
            match self.is_running() {
                true => MonotonicClock::sleep_until(self.pacer.deadline_ns()),
                false => self.inbox.wait(STANDING_TICK),
            }
            if !self.inbox.take_commands(&mut commands) {
                break;
            }
            if let Err(message) = guard(|| self.tick_once(&mut commands)) {
                commands.clear();
                self.fail(&message);
            }
        }
        self.set_phase(Phase::Closing, SceneEvent::Closing);
    }

    /// Everything that may panic. Commands come first: motions are drained by a session that is
    /// sure to step, or they would be lost.
    fn tick_once(&mut self, commands: &mut Vec<Command>) {
        commands.drain(..).for_each(|command| self.obey(command));
        let running = self.is_running();
        let mode = if running { Drain::Stepping } else { Drain::Standing };
        self.inbox.drain(mode, MonotonicClock::now_ns(), &mut self.tick);
        self.tell_leases();
        match running {
            true => self.step(),
            false => self.serve_viewers(false),
        }
    }

    fn is_running(&self) -> bool {
        *lock(&self.phase) == Phase::Running
    }

    fn step(&mut self) {
        let started_ns = MonotonicClock::now_ns();
        let inputs = StepInputs { tools: &self.tick.inputs, relative_tolerance: self.next_tolerance.take() };
        self.log.record(&inputs);
        let workers = self.pool.as_ref().map_or_else(Workers::serial, Workers::of);
        let output = self.world.step(&workers, &MonotonicClock, &inputs);
        let ended_ns = MonotonicClock::now_ns();
        let pace = self.pacer.step_ended(ended_ns);
        self.tally.energy.book(&output.energy);
        self.tally.steps.add(output, ended_ns - started_ns, pace);
        self.views.times.add(output, ended_ns - started_ns);
        let (step, fault) = (output.step, output.fault.clone());
        for (count, jumped) in self.tally.jumps.iter_mut().zip(&self.tick.jumped) {
            *count += u64::from(*jumped);
        }
        if pace == Pace::Reanchored {
            self.publisher.event(step, SceneEvent::Reanchored);
        }
        self.govern(step, ended_ns - started_ns, pace);
        if let Some(fault) = fault {
            self.note_fault(fault);
        }
        if self.tick.drivers > 0 {
            self.publisher.report(self.report(ended_ns, None));
        }
        self.serve_viewers(true);
    }

    fn govern(&mut self, step: u64, elapsed_ns: u64, pace: Pace) {
        let Some(governor) = &mut self.governor else { return };
        let Some(relative_tolerance) = governor.step_ended(elapsed_ns, pace != Pace::InTime) else { return };
        tracing::info!(step, relative_tolerance, "the governor changed the solver's tolerance");
        self.next_tolerance = Some(relative_tolerance);
        self.tally.relative_tolerance = relative_tolerance;
        self.publisher.event(step, SceneEvent::ToleranceChanged(relative_tolerance));
    }

    fn note_fault(&mut self, fault: Fault) {
        tracing::warn!(step = fault.step, object = fault.object, what = ?fault.what, "non-finite state rolled back");
        self.tally.faults += 1;
        self.tally.last_fault = Some(fault.clone());
        // The world has lifted the tools.
        self.inbox.reenter_tools();
        self.publisher.event(fault.step, SceneEvent::Fault(fault));
    }

    fn report(&self, ended_ns: u64, failure: Option<Arc<str>>) -> StepReport {
        let output = self.world.output();
        let tool = |index: usize| ToolReport {
            output: output.tools.get(index).copied().unwrap_or_default(),
            echo: self.tick.echoes.get(index).copied().flatten(),
            jumps: self.tally.jumps[index],
        };
        StepReport {
            step: output.step,
            sim_time_s: output.sim_time_s,
            ended_ns,
            late_steps: self.pacer.counts().late_steps,
            relative_tolerance: self.tally.relative_tolerance,
            faults: self.tally.faults,
            last_fault: self.tally.last_fault.clone(),
            restores: self.tally.restores,
            last_restored: self.tally.last_restored.clone(),
            failure,
            tools: (0..self.tally.jumps.len()).map(tool).collect(),
        }
    }

    /// Publishes structure as it changes and state as it falls due; nothing while nobody views.
    fn serve_viewers(&mut self, stepped: bool) {
        if !self.publisher.is_viewed() {
            // Whoever comes next gets a keyframe of then.
            self.world.forget_surface();
            return;
        }
        let now_ns = MonotonicClock::now_ns();
        let patch = if stepped { self.world.topology_patch() } else { None };
        let mut structure_changed = patch.is_some();
        if let Some(patch) = patch {
            self.publisher.patch(patch.clone());
        }
        if self.publisher.keyframe_wanted() && now_ns >= self.views.next_keyframe_ns {
            self.views.next_keyframe_ns = now_ns + to_ns(self.limits.min_keyframe_interval_s);
            self.publisher.keyframe(self.world.keyframe());
            structure_changed = true;
        }
        // Structure is always followed by a state of the same version.
        if structure_changed || (stepped && now_ns >= self.views.next_state_ns) {
            self.publish_state(now_ns);
        }
    }

    fn publish_state(&mut self, now_ns: u64) {
        let interval_ns = to_ns(1.0 / self.limits.view_rate_hz);
        // From the time it was due, so that the rate is kept though steps do not divide it.
        self.views.next_state_ns = (self.views.next_state_ns + interval_ns).max(now_ns + interval_ns / 2);
        if let Some(took_ns) = self.world.adapt_surface(&MonotonicClock) {
            self.views.times.add_adaptation(took_ns);
        }
        let output = self.world.output();
        let displacements = |object: usize| {
            let mut displacements_m = Vec::new();
            self.world.node_displacements_m(object, &mut displacements_m);
            displacements_m
        };
        let objects = 0..self.scene.desc.objects.len();
        let version = output.topology_version;
        self.publisher.state(ViewState {
            place: Place { epoch: self.publisher.epoch(), version },
            topology_version: version,
            step: output.step,
            sim_time_s: output.sim_time_s,
            late_steps: self.pacer.counts().late_steps,
            node_displacements_m: objects.clone().map(displacements).collect(),
            adapted: objects.map(|object| self.world.adapted_vertices(object).to_vec()).collect(),
            tools: output.tools.clone(),
            energy: self.tally.energy,
            times: std::mem::take(&mut self.views.times),
            published_ns: now_ns,
        });
    }

    /// Tells viewers of tools that changed hands. Drivers learn of a lost lease from the next
    /// report, which every step brings.
    fn tell_leases(&mut self) {
        let step = self.world.output().step;
        for (tool, (before, now)) in self.holders.iter().zip(&self.tick.holders).enumerate() {
            if before == now {
                continue;
            }
            if before.is_some() {
                self.publisher.event(step, SceneEvent::ToolReleased(tool));
            }
            if now.is_some() {
                self.publisher.event(step, SceneEvent::ToolTaken(tool));
            }
        }
        self.holders.clone_from(&self.tick.holders);
    }

    fn obey(&mut self, command: Command) {
        // A caller that has given up waiting is no error of the session's.
        match command {
            Command::Pause(answer) => {
                if self.is_running() {
                    self.set_phase(Phase::Paused, SceneEvent::Paused);
                }
                let _ = answer.send(self.world.output().step);
            }
            Command::Resume(answer) => {
                let _ = answer.send(self.resume());
            }
            Command::Reset(answer) => {
                let _ = answer.send(self.reset());
            }
            Command::Describe(answer) => {
                let _ = answer.send(self.describe());
            }
            Command::Point(command) => self.obey_point(command),
            Command::Query(look) => {
                look(&mut Probe {
                    world: &mut self.world,
                    log: &self.log,
                    scene: &self.scene,
                    steps: &self.tally.steps,
                });
            }
        }
    }

    fn resume(&mut self) -> Result<u64, SessionError> {
        let phase = lock(&self.phase).clone();
        match phase {
            Phase::Failed { message } => return Err(SessionError::Failed { message: message.to_string() }),
            Phase::Paused => {
                let now_ns = MonotonicClock::now_ns();
                // Tools went on moving; the world's poses are as old as the pause.
                self.inbox.reenter_tools();
                self.inbox.renew_leases(now_ns);
                self.pacer.restart(now_ns);
                self.set_phase(Phase::Running, SceneEvent::Resumed);
            }
            Phase::Running | Phase::Closing => {}
        }
        Ok(self.world.output().step)
    }

    /// Back to rest; a failed session stands afterwards, others go on as they were.
    fn reset(&mut self) -> Result<(), SessionError> {
        self.world = build_world(&self.scene)?;
        self.log.clear();
        self.tally = Tally::of(&self.scene);
        self.governor = Governor::of(&self.scene.desc);
        self.next_tolerance = None;
        self.views = ViewSchedule::default();
        self.inbox.reenter_tools();
        let now_ns = MonotonicClock::now_ns();
        self.inbox.renew_leases(now_ns);
        self.pacer = Pacer::new(self.scene.desc.rate_hz, to_ns(self.limits.max_lag_s), now_ns);
        self.publisher.start_over();
        self.publisher.event(0, SceneEvent::Reset);
        if matches!(*lock(&self.phase), Phase::Failed { .. }) {
            self.set_phase(Phase::Paused, SceneEvent::Paused);
        }
        Ok(())
    }

    fn describe(&self) -> SessionStatus {
        let output = self.world.output();
        let counts = self.pacer.counts();
        SessionStatus {
            phase: lock(&self.phase).clone(),
            step: output.step,
            sim_time_s: output.sim_time_s,
            topology_version: output.topology_version,
            late_steps: counts.late_steps,
            relative_tolerance: self.tally.relative_tolerance,
            reanchors: counts.reanchors,
            energy: self.tally.energy,
            probe_displacement_m: output.probe_displacement_m.clone(),
            state_hash: self.world.state_hash(),
        }
    }

    /// A panic ends the stepping, not the thread: the session can still be described, reset, closed.
    fn fail(&mut self, message: &str) {
        tracing::error!(
            step = self.world.output().step,
            message,
            "a step panicked; the session stands until it is reset"
        );
        let message: Arc<str> = message.into();
        self.set_phase(Phase::Failed { message: Arc::clone(&message) }, SceneEvent::Failed);
        self.publisher.report(self.report(MonotonicClock::now_ns(), Some(message)));
    }

    fn set_phase(&mut self, phase: Phase, event: SceneEvent) {
        *lock(&self.phase) = phase;
        self.publisher.event(self.world.output().step, event);
    }
}

fn build_world(scene: &Scene) -> Result<World, SessionError> {
    guard(|| World::new(scene)).map_err(|message| SessionError::Failed { message })?.map_err(SessionError::from)
}

fn lend_threads(threads: usize) -> Result<Option<rayon::ThreadPool>, SessionError> {
    if threads <= 1 {
        return Ok(None);
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).thread_name(|i| format!("kerf-worker-{i}")).build();
    pool.map(Some).map_err(|error| SessionError::NoThread { message: error.to_string() })
}

/// Runs `work`; a panic becomes its message. What `work` was changing may be half changed: the
/// session does not step it again before a reset has replaced it.
fn guard<T>(work: impl FnOnce() -> T) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(work)).map_err(|panic: Box<dyn Any + Send>| {
        let text = panic.downcast_ref::<&str>().map(ToString::to_string);
        text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "a panic without a message".into())
    })
}
