//! What reaches a session from outside: poses, latest-wins per tool, and a bounded queue of
//! commands. The session's thread drains both at the start of a tick and holds no lock while it
//! steps.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Condvar, Mutex};
use std::time::Duration;

use kerf_physics::{Scene, ToolInput, World};
use tokio::sync::oneshot;

use crate::checkpoints::{Checkpoint, CheckpointInfo};
use crate::error::SessionError;
use crate::limits::{SessionLimits, to_ns};
use crate::lock::lock;
use crate::pose_check::PoseSample;
use crate::pose_refusal::PoseRefusal;
use crate::reach::Placement;
use crate::seek::{Position, Seek};
use crate::status::{SessionStatus, StepTallies};
use crate::stepping::{StepInput, StepMotion, Stepped, Steps};
use crate::tape::Base;
use crate::tool_slot::{DriverId, Echo, Loss, ToolSlot};

/// What a query sees between two steps.
pub struct Inspection<'a> {
    /// The world as the last step left it.
    pub world: &'a mut World,
    /// The scene.
    pub scene: &'a Scene,
    /// The steps since the scene was at rest.
    pub steps: &'a StepTallies,
}

/// Something to do at the start of a tick. A caller that has gone away is not an error.
pub(crate) enum Command {
    /// Stand; answers with the step after which the session stands.
    Pause(oneshot::Sender<u64>),
    /// Step on; answers with the step from which it goes on.
    Resume(oneshot::Sender<Result<u64, SessionError>>),
    /// Take steps and stand; answers when they are taken.
    Step(Steps, StepAnswer),
    /// Back to rest.
    Reset(oneshot::Sender<Result<(), SessionError>>),
    /// Describe the session.
    Describe(oneshot::Sender<SessionStatus>),
    /// Stand, give away all that the session goes on from elsewhere, and change nothing from then on.
    Leave(oneshot::Sender<Result<Arc<Base>, SessionError>>),
    /// Do not leave: go on here, as before.
    Stay(oneshot::Sender<Result<(), SessionError>>),
    /// Save a checkpoint, go back to one, tell of them.
    Checkpoint(CheckpointCommand),
    /// Of a recording that is played: go to a time, set the speed; answers with both.
    Seek(Seek, oneshot::Sender<Result<Position, SessionError>>),
    /// Inspect the world. The closure holds the answer's channel.
    Query(Box<dyn FnOnce(&mut Inspection<'_>) + Send>),
}

/// Where the outcome of steps goes.
pub(crate) type StepAnswer = oneshot::Sender<Result<Stepped, SessionError>>;

/// Something to do with the checkpoints that a session can go back to, by name.
pub(crate) enum CheckpointCommand {
    /// Save one; answers with its step.
    Save(String, oneshot::Sender<Result<u64, SessionError>>),
    /// Go back to one; answers with its step.
    Restore(String, oneshot::Sender<Result<u64, SessionError>>),
    /// Hand one out.
    Read(String, oneshot::Sender<Result<Checkpoint, SessionError>>),
    /// Hand out the state as it is.
    Copy(oneshot::Sender<Result<Checkpoint, SessionError>>),
    /// Say whether one of this name could be kept.
    Check(String, oneshot::Sender<Result<(), SessionError>>),
    /// Keep one that came as a file; answers with its step.
    Keep(String, Checkpoint, oneshot::Sender<Result<u64, SessionError>>),
    /// Forget one.
    Delete(String, oneshot::Sender<Result<(), SessionError>>),
    /// List them.
    List(oneshot::Sender<Vec<CheckpointInfo>>),
}

/// Which poses a tick takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Drain {
    /// Poses are applied in a step of this length, and leases run out.
    Stepping { dt_s: f64 },
    /// The session stands: poses wait, leases are kept.
    Standing,
}

/// What a tick knows of the tools; reused from tick to tick.
#[derive(Default)]
pub(crate) struct Tick {
    pub inputs: Vec<ToolInput>,
    /// Per tool: the last accepted pose of its driver.
    pub echoes: Vec<Option<Echo>>,
    /// Per tool: put down in this tick after a jump.
    pub jumped: Vec<bool>,
    /// Per tool: who drives it.
    pub holders: Vec<Option<DriverId>>,
    /// Per tool: how far apart models of its contact are wanted, ns.
    pub model_intervals_ns: Vec<Option<u64>>,
    /// Drivers connected.
    pub drivers: usize,
}

struct State {
    tools: Vec<ToolSlot>,
    commands: VecDeque<Command>,
    drivers: usize,
    /// What drivers of the same client know each other by.
    client_keys: BTreeMap<DriverId, Box<str>>,
    next_driver: u64,
    closing: bool,
}

impl State {
    fn is_same_client(&self, a: DriverId, b: DriverId) -> bool {
        a == b || self.client_keys.get(&a).is_some_and(|key| self.client_keys.get(&b) == Some(key))
    }
}

pub(crate) struct Inbox {
    state: Mutex<State>,
    /// Rung when a command or the end arrives, for a session that stands.
    bell: Condvar,
    limits: SessionLimits,
}

impl Inbox {
    pub fn new(tools: usize, limits: SessionLimits) -> Self {
        let state = State {
            tools: (0..tools).map(|_| ToolSlot::default()).collect(),
            commands: VecDeque::with_capacity(limits.max_commands),
            drivers: 0,
            client_keys: BTreeMap::new(),
            next_driver: 1,
            closing: false,
        };
        Self { state: Mutex::new(state), bell: Condvar::new(), limits }
    }

    /// Queues a command for the next tick.
    pub fn push(&self, command: Command) -> Result<(), SessionError> {
        let mut state = lock(&self.state);
        if state.closing {
            return Err(SessionError::Closed);
        }
        if state.commands.len() >= self.limits.max_commands {
            return Err(SessionError::TooManyCommands { limit: self.limits.max_commands });
        }
        state.commands.push_back(command);
        self.bell.notify_one();
        Ok(())
    }

    /// Ends the session at its next tick. Never refused: a full queue must not keep it alive.
    pub fn close(&self) {
        lock(&self.state).closing = true;
        self.bell.notify_one();
    }

    /// One more driver. One of a client that has a key may take over what others of the same key hold.
    pub fn connect_driver(&self, client_key: &str) -> Result<DriverId, SessionError> {
        let mut state = lock(&self.state);
        if state.closing {
            return Err(SessionError::Closed);
        }
        if state.drivers >= self.limits.max_drivers {
            return Err(SessionError::TooManyDrivers { limit: self.limits.max_drivers });
        }
        state.drivers += 1;
        state.next_driver += 1;
        let driver = DriverId(state.next_driver - 1);
        if !client_key.is_empty() {
            state.client_keys.insert(driver, client_key.into());
        }
        Ok(driver)
    }

    /// Commands that wait.
    pub fn waiting_commands(&self) -> usize {
        lock(&self.state).commands.len()
    }

    /// Drivers that are connected.
    pub fn drivers(&self) -> usize {
        lock(&self.state).drivers
    }

    pub fn disconnect_driver(&self, driver: DriverId) {
        let mut state = lock(&self.state);
        state.drivers -= 1;
        state.client_keys.remove(&driver);
        state.tools.iter_mut().for_each(|slot| slot.release(driver));
    }

    /// Gives all of `tools` to `driver`, or none.
    pub fn claim(&self, driver: DriverId, tools: &[usize], now_ns: u64) -> Result<(), SessionError> {
        let mut state = lock(&self.state);
        let count = state.tools.len();
        for &tool in tools {
            let slot = state.tools.get(tool).ok_or(SessionError::NoTool { tool, tools: count })?;
            if slot.driver().is_some_and(|holder| !state.is_same_client(holder, driver)) {
                return Err(SessionError::ToolTaken { tool, lease_s: self.limits.lease_s });
            }
        }
        for &tool in tools {
            state.tools[tool].take_over(driver, now_ns);
        }
        Ok(())
    }

    /// While `driver` holds them, models of the contacts of `tools` are wanted this far apart.
    pub fn ask_for_models(&self, driver: DriverId, tools: &[usize], interval_ns: u64) {
        let mut state = lock(&self.state);
        tools.iter().for_each(|tool| state.tools[*tool].ask_for_models(driver, interval_ns));
    }

    /// A pose of a tool that `driver` holds, or that is free: a driver whose lease ran out has it
    /// again with its next pose, unless somebody else was faster.
    pub fn submit(&self, driver: DriverId, tool: usize, sample: &PoseSample, now_ns: u64) -> Result<(), PoseRefusal> {
        let mut state = lock(&self.state);
        let slot = self.held_slot(&mut state, driver, tool, now_ns)?;
        slot.accept(sample, now_ns, &self.limits.pose)
    }

    /// Takes a tool that `driver` holds out of the scene.
    pub fn lift(&self, driver: DriverId, tool: usize, now_ns: u64) -> Result<(), PoseRefusal> {
        let mut state = lock(&self.state);
        self.held_slot(&mut state, driver, tool, now_ns)?.lift(now_ns);
        Ok(())
    }

    fn held_slot<'a>(
        &self,
        state: &'a mut State,
        driver: DriverId,
        tool: usize,
        now_ns: u64,
    ) -> Result<&'a mut ToolSlot, PoseRefusal> {
        let tools = state.tools.len();
        let slot = state.tools.get_mut(tool).ok_or(PoseRefusal::NoTool { tool: tool as u64, tools })?;
        match slot.claim(driver, now_ns) {
            true => Ok(slot),
            false => Err(PoseRefusal::ToolTaken { tool: tool as u64, lease_s: self.limits.lease_s }),
        }
    }

    /// How `driver` has lost `tool`, if it has; told once.
    pub fn take_eviction(&self, driver: DriverId, tool: usize) -> Option<Loss> {
        lock(&self.state).tools.get_mut(tool).and_then(|slot| slot.take_eviction(driver))
    }

    /// Tools that somebody drives.
    pub fn held_tools(&self) -> Vec<usize> {
        let state = lock(&self.state);
        state.tools.iter().enumerate().filter(|(_, slot)| slot.driver().is_some()).map(|(tool, _)| tool).collect()
    }

    /// Every tool is put down anew: the world has lost its hold of them.
    pub fn reenter_tools(&self) {
        lock(&self.state).tools.iter_mut().for_each(ToolSlot::reenter);
    }

    /// The session has stood, and hands may have gone elsewhere with their tools.
    pub fn tools_stood(&self) {
        lock(&self.state).tools.iter_mut().for_each(ToolSlot::stood);
    }

    /// The world is at rest, without tools.
    pub fn reset_tools(&self) {
        lock(&self.state).tools.iter_mut().for_each(ToolSlot::reset);
    }

    /// The world is at another moment and has its tools at `places`; those of `by_calls` were placed by steps that were
    /// asked for.
    pub fn take_tools_back(&self, places: impl Iterator<Item = Option<Placement>>, by_calls: &[bool]) {
        let mut state = lock(&self.state);
        let slots = state.tools.iter_mut().zip(places).zip(by_calls);
        slots.for_each(|((slot, placed), by_calls)| slot.go_back(placed, *by_calls));
    }

    /// By tool, whether steps that were asked for have placed it.
    pub fn placed_by_calls(&self) -> Vec<bool> {
        lock(&self.state).tools.iter().map(ToolSlot::is_placed_by_calls).collect()
    }

    /// The tool that the tick was to put down stays out of the scene for this step; `jumped` as the tick had it.
    pub fn keep_out(&self, tool: usize, jumped: bool) {
        lock(&self.state).tools[tool].keep_out(jumped);
    }

    /// Whether tools may do in coming steps of `dt_s` what a call says of them.
    pub fn check_inputs(&self, inputs: &[StepInput], dt_s: f64) -> Result<(), SessionError> {
        let mut trial = lock(&self.state).tools.clone();
        let mut inputs = inputs.iter().enumerate();
        inputs.try_for_each(|(index, input)| {
            follow(&mut trial, index, input, dt_s, &self.limits)?;
            for slot in &mut trial {
                slot.take_motion(dt_s, &self.limits.pose);
            }
            Ok(())
        })
    }

    /// Takes tools to where the coming step of `dt_s` has them; `index` is the place of the step in its call.
    pub fn follow(&self, index: usize, input: &StepInput, dt_s: f64) -> Result<(), SessionError> {
        follow(&mut lock(&self.state).tools, index, input, dt_s, &self.limits)
    }

    /// Leases run from now on, after a time in which nobody had to speak.
    pub fn renew_leases(&self, now_ns: u64) {
        lock(&self.state).tools.iter_mut().for_each(|slot| slot.heard(now_ns));
    }

    /// Moves the commands that wait into `commands`; `false` once the session is to end.
    pub fn take_commands(&self, commands: &mut Vec<Command>) -> bool {
        let mut state = lock(&self.state);
        commands.extend(state.commands.drain(..));
        !state.closing
    }

    pub fn is_closing(&self) -> bool {
        lock(&self.state).closing
    }

    /// Moves what is known of the tools into `tick`.
    pub fn drain(&self, mode: Drain, now_ns: u64, tick: &mut Tick) {
        tick.inputs.clear();
        tick.echoes.clear();
        tick.jumped.clear();
        tick.holders.clear();
        tick.model_intervals_ns.clear();
        let lease_ns = to_ns(self.limits.lease_s);
        let mut state = lock(&self.state);
        let state = &mut *state;
        tick.drivers = state.drivers;
        for (tool, slot) in state.tools.iter_mut().enumerate() {
            let mut jumped = false;
            if let Drain::Stepping { dt_s } = mode {
                slot.expire(now_ns, lease_ns);
                if let Some(next) = slot.take_motion(dt_s, &self.limits.pose) {
                    tick.inputs.push(ToolInput { tool, motion: next.motion });
                    jumped = next.jumped;
                }
            }
            tick.jumped.push(jumped);
            tick.echoes.push(slot.echo());
            tick.holders.push(slot.driver());
            tick.model_intervals_ns.push(slot.model_interval_ns());
        }
    }

    /// Waits until a command arrives or `timeout` has passed.
    pub fn wait(&self, timeout: Duration) {
        let state = lock(&self.state);
        let idle = |state: &mut State| state.commands.is_empty() && !state.closing;
        // A poisoned lock wakes the session early, which does no harm.
        drop(self.bell.wait_timeout_while(state, timeout, idle));
    }
}

fn follow(
    slots: &mut [ToolSlot],
    index: usize,
    input: &[StepMotion],
    dt_s: f64,
    limits: &SessionLimits,
) -> Result<(), SessionError> {
    let tools = slots.len();
    for (place, motion) in input.iter().enumerate() {
        let tool = motion.tool;
        let slot = slots.get_mut(tool).ok_or(PoseRefusal::NoTool { tool: tool as u64, tools });
        let followed = match slot {
            Ok(slot) if slot.driver().is_some() => {
                return Err(SessionError::ToolTaken { tool, lease_s: limits.lease_s });
            }
            Ok(slot) => slot.follow(motion.to.as_ref(), dt_s, &limits.pose),
            Err(refusal) => Err(refusal),
        };
        followed.map_err(|refusal| SessionError::refused_input(index, place, motion.to.is_some(), &refusal))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use kerf_physics::step_io::ToolMotion;
    use kerf_physics::{Pose, Vec3};

    const STEPPING: Drain = Drain::Stepping { dt_s: 2e-3 };

    fn inbox(tools: usize) -> Inbox {
        Inbox::new(tools, SessionLimits { max_commands: 2, max_drivers: 2, ..SessionLimits::default() })
    }

    fn at(seq: u64, x_m: f64) -> PoseSample {
        let pose = Pose { position_m: Vec3::new(x_m, 0.0, 0.0), ..Pose::default() };
        PoseSample { seq, client_ns: seq, pose, opening: 1.0 }
    }

    fn drained(inbox: &Inbox, mode: Drain, now_ns: u64) -> Tick {
        let mut tick = Tick::default();
        inbox.drain(mode, now_ns, &mut tick);
        tick
    }

    #[test]
    fn a_full_command_queue_refuses_and_names_its_limit() {
        let inbox = inbox(0);
        let push = || inbox.push(Command::Query(Box::new(|_| ())));
        assert_eq!((push(), push()), (Ok(()), Ok(())));
        assert_eq!(push(), Err(SessionError::TooManyCommands { limit: 2 }));
        let mut commands = Vec::new();
        assert!(inbox.take_commands(&mut commands));
        assert_eq!(commands.len(), 2);
        assert_eq!(push(), Ok(()));
    }

    #[test]
    fn closing_gets_past_a_full_queue_and_refuses_what_comes_later() {
        let inbox = inbox(0);
        while inbox.push(Command::Query(Box::new(|_| ()))).is_ok() {}
        inbox.close();
        assert!(!inbox.take_commands(&mut Vec::new()));
        assert_eq!(inbox.push(Command::Query(Box::new(|_| ()))), Err(SessionError::Closed));
        assert_eq!(inbox.connect_driver(""), Err(SessionError::Closed));
    }

    #[test]
    fn a_claim_takes_all_tools_or_none() {
        let inbox = inbox(2);
        let (a, b) = (inbox.connect_driver("").unwrap(), inbox.connect_driver("").unwrap());
        inbox.claim(a, &[1], 0).unwrap();
        assert!(matches!(inbox.claim(b, &[0, 1], 0), Err(SessionError::ToolTaken { tool: 1, .. })));
        assert!(matches!(inbox.claim(b, &[0, 7], 0), Err(SessionError::NoTool { tool: 7, tools: 2 })));
        assert_eq!(inbox.held_tools(), [1]);
        assert_eq!(inbox.connect_driver(""), Err(SessionError::TooManyDrivers { limit: 2 }));
    }

    #[test]
    fn a_driver_that_goes_away_lifts_its_tool_and_frees_it() {
        let inbox = inbox(1);
        let a = inbox.connect_driver("").unwrap();
        inbox.submit(a, 0, &at(1, 0.0), 0).unwrap();
        drained(&inbox, STEPPING, 0);
        inbox.disconnect_driver(a);
        let tick = drained(&inbox, STEPPING, 1);
        assert_eq!(tick.inputs, [ToolInput { tool: 0, motion: ToolMotion::Lift }]);
        assert_eq!((tick.drivers, tick.holders[0]), (0, None));
    }

    #[test]
    fn leases_run_out_while_stepping_and_are_kept_while_standing() {
        let inbox = inbox(1);
        let a = inbox.connect_driver("").unwrap();
        inbox.submit(a, 0, &at(1, 0.0), 0).unwrap();
        let hour_ns = 3_600_000_000_000;
        assert_eq!(drained(&inbox, Drain::Standing, hour_ns).holders, [Some(a)]);
        assert_eq!(drained(&inbox, STEPPING, hour_ns).holders, [None]);
        assert_eq!(inbox.take_eviction(a, 0), Some(Loss::Silence));
    }

    #[test]
    fn a_driver_whose_lease_ran_out_has_the_tool_again_with_its_next_pose() {
        let inbox = inbox(1);
        let (a, b) = (inbox.connect_driver("").unwrap(), inbox.connect_driver("").unwrap());
        inbox.submit(a, 0, &at(5, 0.0), 0).unwrap();
        drained(&inbox, STEPPING, 3_000_000_000);
        inbox.submit(a, 0, &at(6, 0.4), 3_000_000_000).unwrap();
        assert_eq!(inbox.take_eviction(a, 0), None);
        assert!(matches!(inbox.submit(b, 0, &at(1, 0.0), 3_000_000_000), Err(PoseRefusal::ToolTaken { .. })));
    }

    #[test]
    fn a_resumed_session_puts_tools_down_instead_of_sweeping_them_across() {
        let inbox = inbox(1);
        let a = inbox.connect_driver("").unwrap();
        inbox.submit(a, 0, &at(1, 0.0), 0).unwrap();
        drained(&inbox, STEPPING, 0);
        inbox.submit(a, 0, &at(2, 0.05), 40_000_000).unwrap();
        assert!(drained(&inbox, Drain::Standing, 50_000_000).inputs.is_empty());
        inbox.tools_stood();
        let tick = drained(&inbox, STEPPING, 50_000_000);
        assert!(matches!(tick.inputs[0].motion, ToolMotion::EnterAt { .. }));
    }

    #[test]
    fn a_driver_takes_over_what_an_older_one_of_its_client_holds_and_nobody_elses() {
        let inbox = Inbox::new(2, SessionLimits::default());
        let [old, new, other, nameless] =
            ["a", "a", "b", ""].map(|client_key| inbox.connect_driver(client_key).unwrap());
        inbox.claim(old, &[0], 0).unwrap();
        inbox.claim(nameless, &[1], 0).unwrap();
        for (driver, tool) in [(other, 0), (nameless, 0), (new, 1), (other, 1)] {
            assert!(matches!(inbox.claim(driver, &[tool], 1), Err(SessionError::ToolTaken { .. })), "{driver:?}");
        }
        assert!(matches!(inbox.claim(new, &[0, 1], 1), Err(SessionError::ToolTaken { tool: 1, .. })), "all or none");
        assert_eq!(inbox.take_eviction(old, 0), None);
        inbox.claim(new, &[0], 1).unwrap();
        assert_eq!(inbox.take_eviction(old, 0), Some(Loss::TakenOver));
        let late = inbox.lift(old, 0, 2);
        assert!(matches!(late, Err(PoseRefusal::ToolTaken { .. })), "what it said before comes late: {late:?}");
        inbox.disconnect_driver(old);
        assert_eq!(inbox.held_tools(), [0, 1], "its end frees nothing that it has not");
    }
}
