//! A session as a core without a clock and without a thread.
//!
//! Time comes in with each tick, threads are lent to it, and a tick ends with when the next one is due. In:
//! commands and poses, from the inbox. Out: reports, events, structure and state, to the outbox. Neither waits
//! for anybody, so a test runs minutes of a session in milliseconds; a thin thread around it runs one in real time.
//!
//! Deliberately absent: reading a clock, sleeping, waiting, starting a thread.

mod checkpoints;
mod commands;
mod entries;
#[cfg(test)]
mod hands;
mod journal;
#[cfg(test)]
mod journaled;
#[cfg(test)]
mod lock_step;
mod models;
mod owed_steps;
#[cfg(test)]
mod recording_cost;
#[cfg(test)]
mod showing;
mod views;
#[cfg(test)]
mod virtual_session;
#[cfg(test)]
mod virtual_time;
#[cfg(test)]
mod watching;

use std::any::Any;
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use kerf_physics::fault::Fault;
use kerf_physics::making::Making;
use kerf_physics::step_io::{EnergyStep, SolveReport};
use kerf_physics::{Scene, SoundScene, StageClock, StepInputs, Workers, World};

use crate::admission::{Admitted, LoadMeter};
use crate::checkpoints::Checkpoints;
use crate::counts::TimedStep;
use crate::error::SessionError;
use crate::feed::{Feed, feed};
use crate::governor::{FIRST_SAMPLES, Governor};
use crate::inbox::{Command, Drain, Inbox, Tick};
use crate::late_steps::LateStep;
use crate::limits::{SessionLimits, to_ns};
use crate::overload::OverloadWatch;
use crate::pacer::{Pace, Pacer};
use crate::past::Past;
use crate::priority::Demand;
use crate::projector::Projector;
use crate::publisher::Publisher;
use crate::shortfall::ShortfallWatch;
use crate::status::{Phase, StepTallies};
use crate::step_report::{StepReport, ToolReport};
use crate::tape::{LoggedInputs, TapeEntry, TapedStep, Wants};
use crate::tool_slot::DriverId;
use crate::view_message::SceneEvent;
use journal::BaseSchedule;
use models::ModelSchedule;
use owed_steps::OwedSteps;
use views::ViewSchedule;

/// How often a session that stands looks after its viewers, ns; commands wake it at once.
const STANDING_TICK_NS: u64 = 20_000_000;

/// A scene whose steps take longer than this is late at any rate that a hand feels, ns.
const LONGEST_WARM_UP_NS: u64 = 100_000_000;

/// When the next tick is due.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Wake {
    /// At this time: a step is due.
    At(u64),
    /// When a command arrives, and at this time at the latest: the session stands.
    OnCommand { or_at_ns: u64 },
    /// Never: the session has ended.
    Never,
}

/// A scene that is stepped, and what happens between two steps.
pub(crate) struct SessionCore {
    scene: SoundScene,
    limits: SessionLimits,
    world: World,
    inbox: Arc<Inbox>,
    publisher: Publisher,
    phase: Phase,
    pacer: Pacer,
    overload: OverloadWatch,
    shortfall: ShortfallWatch,
    /// The session stood, or its world was replaced: deadlines and leases run from the next step on.
    interrupted: bool,
    /// Steps that a session that stands has been asked for, a call after the other.
    owed: VecDeque<OwedSteps>,
    governor: Governor,
    checkpoints: Checkpoints,
    /// Times that the scene was put back to rest.
    resets: u64,
    /// It is on its way to another server, and was in this phase before.
    leaves: Option<Phase>,
    commands: Vec<Command>,
    tools: Tick,
    /// Per tool, as of the last tick: who drives it.
    holders: Vec<Option<DriverId>>,
    /// Per tool: kept out of the last step, as it would have been put down in tissue.
    waits: Vec<bool>,
    tally: Tally,
    views: ViewSchedule,
    feed: Feed,
    models: ModelSchedule,
    /// When a journal gets its next state to go on from.
    bases: BaseSchedule,
    /// What the session takes of the machine.
    admitted: Admitted,
    meter: LoadMeter,
}

/// What has been counted since the scene was at rest.
#[derive(Default)]
struct Tally {
    energy: EnergyStep,
    jumps: Vec<u64>,
    faults: u64,
    last_fault: Option<Fault>,
    steps: StepTallies,
    /// When the last step ended, and how long after its deadline.
    ended_ns: u64,
    lag_ns: u64,
    /// Relative residual that solves end at, as the governor has it.
    relative_tolerance: f64,
    /// Times that too many steps were late, and their share the last time.
    overloads: u64,
    late_share: f64,
    /// Times that the session went back to a checkpoint, and the last one's name.
    restores: u64,
    last_restored: Option<Arc<str>>,
}

impl Tally {
    fn of(scene: &Scene) -> Self {
        let jumps = vec![0; scene.desc.tools.len()];
        Self { jumps, relative_tolerance: scene.desc.relative_tolerance(), ..Self::default() }
    }
}

impl SessionCore {
    /// Builds the scene, in the phase that the publisher shows, and what shows it: at rest, or as `past` says.
    pub fn new(
        scene: SoundScene,
        limits: SessionLimits,
        inbox: Arc<Inbox>,
        publisher: Publisher,
        admitted: Admitted,
        past: Option<Past>,
        mut tell: impl FnMut(Making),
    ) -> Result<(Self, Projector), SessionError> {
        let mut world = build_world(&scene, &mut tell)?;
        let mut arrived = None;
        if let Some(past) = past {
            let followed = guard(|| past.follow(&scene, world, &admitted.memory, &Workers::serial()));
            let (there, stand) = followed.map_err(|message| SessionError::Failed { message })??;
            (world, arrived) = (there, Some(stand));
        }
        let (feed, shots) = feed();
        let projector = Projector::new(shots, publisher.showcase.clone());
        let tool_count = scene.desc.tools.len();
        let mut core = Self {
            world,
            inbox,
            phase: publisher.phase(),
            publisher,
            pacer: pacer(&scene, &limits),
            overload: OverloadWatch::default(),
            shortfall: ShortfallWatch::default(),
            interrupted: true,
            owed: VecDeque::new(),
            governor: Governor::of(&scene.desc),
            checkpoints: Checkpoints::new(limits.max_checkpoints),
            resets: 0,
            leaves: None,
            commands: Vec::new(),
            tools: Tick::default(),
            holders: vec![None; tool_count],
            waits: vec![false; tool_count],
            tally: Tally::of(&scene),
            views: ViewSchedule::default(),
            feed,
            models: ModelSchedule::default(),
            bases: BaseSchedule::default(),
            admitted,
            meter: LoadMeter::default(),
            scene,
            limits,
        };
        arrived.map_or(Ok(()), |arrived| core.arrive(arrived))?;
        Ok((core, projector))
    }

    /// What the world was built of.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The world, as the last step left it.
    pub fn world(&self) -> &World {
        &self.world
    }

    fn dt_s(&self) -> f64 {
        1.0 / self.scene.desc.rate_hz
    }

    /// Takes the first steps before their time, as fast as they go: what a step needs is in the caches then, and the
    /// governor knows what work takes here, so that the first touch is bounded as any other. Takes no longer than
    /// `LONGEST_WARM_UP_NS` and a step.
    pub fn warm_up(&mut self, workers: &Workers<'_>, clock: &dyn StageClock) {
        let begun_ns = clock.now_ns();
        self.publisher.vitals().come_by(begun_ns);
        for _ in 0..FIRST_SAMPLES {
            let now_ns = clock.now_ns();
            if self.phase != Phase::Running || now_ns - begun_ns > LONGEST_WARM_UP_NS {
                return;
            }
            if let Err(message) = guard(|| self.take_step(now_ns, workers, clock)) {
                self.fail(&message);
            }
        }
    }

    /// Does what is due at `now_ns`, which is next to nothing if that is too early; says when to call again.
    /// `clock` tells how long it takes.
    pub fn tick(&mut self, now_ns: u64, workers: &Workers<'_>, clock: &dyn StageClock) -> Wake {
        self.publisher.vitals().come_by(now_ns);
        let due = guard(|| match self.phase {
            Phase::Running => self.step_if_due(now_ns, workers, clock),
            Phase::Paused if !self.owed.is_empty() => self.step_while_standing(now_ns, workers, clock),
            Phase::Paused | Phase::Failed { .. } => self.stand(now_ns),
            Phase::Closing => {}
        });
        if let Err(message) = due {
            self.fail(&message);
        }
        match self.phase {
            Phase::Running => Wake::At(self.pacer.deadline_ns()),
            Phase::Paused if !self.owed.is_empty() => Wake::At(now_ns),
            Phase::Paused | Phase::Failed { .. } => Wake::OnCommand { or_at_ns: now_ns + STANDING_TICK_NS },
            Phase::Closing => Wake::Never,
        }
    }

    fn stand(&mut self, now_ns: u64) {
        self.inbox.drain(Drain::Standing, now_ns, &mut self.tools);
        self.tell_leases();
        self.serve_viewers(now_ns, false);
    }

    fn step_if_due(&mut self, now_ns: u64, workers: &Workers<'_>, clock: &dyn StageClock) {
        if std::mem::take(&mut self.interrupted) {
            self.pacer.restart(now_ns);
            self.inbox.renew_leases(now_ns);
        }
        if now_ns >= self.pacer.deadline_ns() {
            self.take_step(now_ns, workers, clock);
        }
    }

    /// What it asks of the machine: its load is that of the last whole second, or more where this one has come to more.
    /// `None` where nothing is due: steps that calls ask for are taken as fast as they can, and leave the machine to those
    /// that are.
    pub fn demand(&self) -> Option<Demand> {
        let load = f64::max(self.admitted.load.measured(), self.meter.so_far());
        let is_driven = self.tools.holders.iter().any(Option::is_some);
        (self.phase == Phase::Running).then_some(Demand { load, is_driven })
    }

    fn take_step(&mut self, started_ns: u64, workers: &Workers<'_>, clock: &dyn StageClock) {
        self.inbox.drain(Drain::Stepping { dt_s: self.dt_s() }, started_ns, &mut self.tools);
        self.keep_tools_out_of_tissue();
        self.tell_leases();
        let models = self.models.due(started_ns, &self.tools.model_intervals_ns, &self.world.output().tools);
        // A session that stands takes its steps for whoever asks, who waits for them.
        let behind_ns = started_ns.saturating_sub(self.pacer.deadline_ns());
        let work_units = self.governor.work_units(behind_ns).filter(|_| self.phase == Phase::Running);
        let inputs = StepInputs { tools: &self.tools.inputs, work_units, models };
        let output = self.world.step(workers, clock, &inputs);
        let ended_ns = clock.now_ns();
        let elapsed_ns = ended_ns - started_ns;
        let pace = match self.phase {
            Phase::Running if !self.interrupted => self.pacer.step_ended(ended_ns),
            _ => Pace::InTime,
        };
        (self.tally.ended_ns, self.tally.lag_ns) = (ended_ns, pace.lag_ns());
        self.tally.energy.book(&output.energy);
        self.tally.steps.add(output, elapsed_ns, pace);
        self.views.add_step(output, elapsed_ns);
        let load = self.meter.step_ended(elapsed_ns, self.scene.desc.rate_hz);
        if let Some(load) = load {
            self.admitted.load.set_measured(load);
            self.admitted.load.fair_share().into_iter().for_each(|share| self.governor.take_share(share));
        }
        let is_paced = self.phase == Phase::Running;
        let timed = TimedStep { output, elapsed_ns, pace: is_paced.then_some(pace), budget_units: work_units };
        self.publisher.counts.step_ended(&timed);
        self.publisher.vitals().step_ended(&timed, self.tally.energy.residual_j, load.is_some());
        let (step, fault, solve, put_away) = (output.step, output.fault.clone(), output.solve, output.put_away);
        if is_paced && pace.lag_ns() > 0 {
            self.publisher.late_step(LateStep { step, ended_ns, elapsed_ns, lag_ns: pace.lag_ns() });
        }
        let shortfall = self.shortfall.step_ended(ended_ns, &solve);
        for (count, jumped) in self.tally.jumps.iter_mut().zip(&self.tools.jumped) {
            *count += u64::from(*jumped);
        }
        if matches!(pace, Pace::Reanchored { .. }) {
            self.publisher.event(step, SceneEvent::Reanchored);
        }
        if let Some(late_share) = self.overload.step_ended(ended_ns, pace != Pace::InTime) {
            self.tally.overloads += 1;
            self.tally.late_share = late_share;
            self.publisher.event(step, SceneEvent::Overloaded(late_share));
            let late_percent = (100.0 * late_share).round();
            tracing::warn!(
                scene = self.scene.desc.name,
                rate_hz = self.scene.desc.rate_hz,
                late_percent,
                "OVERLOAD: steps are late, so the scene runs slower than the hands that drive it; lower the step rate or \
                 raise the level"
            );
        }
        self.govern(step, elapsed_ns, &solve);
        if let Some(fault) = fault {
            self.note_fault(fault);
        }
        if let Some(shortfall) = shortfall {
            tracing::warn!(step, ?shortfall, "solves fell short, though they were retried");
            self.publisher.event(step, SceneEvent::Unsolved(shortfall));
        }
        if put_away > 0 {
            tracing::info!(step, pieces = put_away, "fell out of the scene's reach and were put away");
            self.publisher.event(step, SceneEvent::PutAway(put_away));
        }
        if self.tools.drivers > 0 {
            self.publisher.report(self.report());
        }
        if self.publisher.tape.is_on() {
            self.record_step(work_units);
            self.write_base_if_due(elapsed_ns, clock);
        }
        self.serve_viewers(ended_ns, true);
    }

    /// Records the step that was just taken. The events that it led to stand before it.
    fn record_step(&self, work_units: Option<u64>) {
        let inputs = LoggedInputs { tools: self.tools.inputs.clone(), work_units };
        let is_hashed =
            self.publisher.tape.is_for(Wants::Hashes) || self.world.output().step.is_multiple_of(self.hashed_steps());
        let state_hash = is_hashed.then(|| self.world.state_hash());
        let step = TapedStep { inputs, report: self.report(), state_hash };
        self.publisher.tape.push(&TapeEntry::Step(Arc::new(step)));
    }

    fn govern(&mut self, step: u64, elapsed_ns: u64, solve: &SolveReport) {
        if self.phase != Phase::Running {
            return;
        }
        let Some(relative_tolerance) = self.governor.step_ended(elapsed_ns, solve) else { return };
        tracing::debug!(step, relative_tolerance, "the residual that solves are left with changed");
        self.tally.relative_tolerance = relative_tolerance;
        self.publisher.event(step, SceneEvent::ToleranceChanged(relative_tolerance));
    }

    fn note_fault(&mut self, fault: Fault) {
        tracing::warn!(step = fault.step, object = fault.object, what = ?fault.what, "state rolled back");
        self.tally.faults += 1;
        self.tally.last_fault = Some(fault.clone());
        // The world has lifted the tools.
        self.inbox.reenter_tools();
        self.publisher.event(fault.step, SceneEvent::Fault(fault));
    }

    fn report(&self) -> StepReport {
        let output = self.world.output();
        let tool = |index: usize| ToolReport {
            output: output.tools.get(index).copied().unwrap_or_default(),
            echo: self.tools.echoes.get(index).copied().flatten(),
            jumps: self.tally.jumps[index],
            waits: self.waits[index],
        };
        StepReport {
            step: output.step,
            sim_time_s: output.sim_time_s,
            ended_ns: self.tally.ended_ns,
            lag_ns: self.tally.lag_ns,
            phase: self.phase.clone(),
            resets: self.resets,
            late_steps: self.pacer.counts().late_steps,
            overloads: self.tally.overloads,
            late_share: self.tally.late_share,
            relative_tolerance: self.tally.relative_tolerance,
            faults: self.tally.faults,
            last_fault: self.tally.last_fault.clone(),
            restores: self.tally.restores,
            last_restored: self.tally.last_restored.clone(),
            tools: (0..self.tally.jumps.len()).map(tool).collect(),
        }
    }

    /// Tells viewers of tools that changed hands. Drivers learn of a lost lease from the next
    /// report, which every step brings.
    fn tell_leases(&mut self) {
        let step = self.world.output().step;
        for (tool, (before, now)) in self.holders.iter().zip(&self.tools.holders).enumerate() {
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
        self.holders.clone_from(&self.tools.holders);
    }

    /// A panic ends the stepping, not the session: it can still be described, reset, closed.
    fn fail(&mut self, message: &str) {
        self.publisher.counts.panicked();
        self.publisher.vitals().panicked();
        tracing::error!(
            step = self.world.output().step,
            message,
            "a step panicked; the session stands until it is reset"
        );
        let message: Arc<str> = message.into();
        self.owed.clear();
        self.set_phase(Phase::Failed { message }, SceneEvent::Failed);
    }

    fn set_phase(&mut self, phase: Phase, event: SceneEvent) {
        self.phase = phase.clone();
        self.publisher.set_phase(phase);
        self.publisher.event(self.world.output().step, event);
        self.publisher.report(self.report());
    }
}

/// The pacer of a session that has yet to take its first step.
fn pacer(scene: &Scene, limits: &SessionLimits) -> Pacer {
    Pacer::new(scene.desc.rate_hz, to_ns(limits.max_lag_s), 0)
}

fn build_world(scene: &SoundScene, tell: &mut dyn FnMut(Making)) -> Result<World, SessionError> {
    guard(|| World::make(scene, tell)).map_err(|message| SessionError::Failed { message })?.map_err(SessionError::from)
}

/// Runs `work`; a panic becomes its message. What `work` was changing may be half changed: the
/// session does not step it again before a reset has replaced it.
fn guard<T>(work: impl FnOnce() -> T) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(work)).map_err(|panic: Box<dyn Any + Send>| {
        let text = panic.downcast_ref::<&str>().map(ToString::to_string);
        text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "a panic without a message".into())
    })
}
