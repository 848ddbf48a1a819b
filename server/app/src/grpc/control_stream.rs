//! One control stream: a task reads poses, the answer is a stream that the transport pulls.
//!
//! The two halves share the driver; when the client goes away both end, and with them the leases.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use futures_util::stream;
use kerf_proto::v1;
use kerf_proto::v1::control_response::Message;
use kerf_session::clock::MonotonicClock;
use kerf_session::{Driver, Echo, Loss, Phase, PoseRefusal, Reports, SessionError, StepReport};
use tokio::sync::{mpsc, watch};
use tokio::task::JoinHandle;
use tokio::time::Instant;
use tonic::{Status, Streaming};

use super::contact_deadband::ContactDeadband;
use super::in_flight::InFlight;
use super::pose_budget::PoseBudget;
use super::{Outgoing, moved};
use crate::config::ControlLimits;
use crate::convert::contact::{contact, pose_sample, rejection, without_model};
use crate::convert::fault;
use crate::status::RequestError;

/// Contacts that new poses may call for ahead of the rate. Two: a step's length and the network's
/// jitter never hold one back at equal rates of poses and contacts.
const CONTACTS_AHEAD: u64 = 2;

/// Which reports become contacts: the first that a new pose shows in, so that no round trip waits for
/// the rate, and others as they fall due. The rate is kept on average.
pub struct Contacts {
    rate_hz: f64,
    interval_ns: u64,
    /// When the rate allows the next one, ns on the server's monotonic clock.
    due_ns: u64,
    /// The last report that was told.
    told: Option<Told>,
}

#[derive(Clone, Copy)]
struct Told {
    step: u64,
    late_steps: u64,
}

/// What a report says of a driver's poses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum News {
    /// A step has used one that no contact has told of.
    NewPose,
    /// Nothing new.
    None,
}

impl Contacts {
    pub fn new(step_rate_hz: f64, rate_hz: f64) -> Self {
        let steps = (step_rate_hz / rate_hz).round().max(1.0);
        let rate_hz = step_rate_hz / steps;
        Self { rate_hz, interval_ns: (1e9 / rate_hz) as u64, due_ns: 0, told: None }
    }

    /// The rate that whole steps allow.
    pub fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    /// Whether it is time for another. A step below the last one means that the scene was reset.
    fn is_due(&self, report: &StepReport, news: News) -> bool {
        let ahead_ns = match news {
            News::NewPose => CONTACTS_AHEAD * self.interval_ns,
            News::None => 0,
        };
        match &self.told {
            Some(told) if report.step == told.step => false,
            Some(told) if report.step < told.step => true,
            _ => report.ended_ns + ahead_ns >= self.due_ns,
        }
    }

    /// This report is told; answers with the steps that were late since the one before.
    fn tell(&mut self, report: &StepReport) -> u64 {
        // From the time it was due, so that the rate is kept though steps do not divide it.
        self.due_ns = (self.due_ns + self.interval_ns).max(report.ended_ns + self.interval_ns / 2);
        let before = self.told.map_or(report.late_steps, |told| told.late_steps);
        self.told = Some(Told { step: report.step, late_steps: report.late_steps });
        report.late_steps.saturating_sub(before)
    }
}

/// What a client's hello was granted.
pub struct Granted {
    pub driver: Driver,
    pub contacts: Contacts,
    pub deadband: ContactDeadband,
    /// Its contacts say where the tool is in the place of a model.
    pub without_models: bool,
}

/// The answer of a control stream, hello first.
pub fn outgoing(
    hello: v1::ControlResponse,
    granted: Granted,
    incoming: Streaming<v1::ControlRequest>,
    limits: &ControlLimits,
) -> Outgoing<v1::ControlResponse> {
    let Granted { driver, contacts, deadband, without_models } = granted;
    let reports = driver.reports();
    let driver = Arc::new(driver);
    let (rejected, rejections) = mpsc::channel(limits.max_untold_rejections);
    let (received, acknowledged) = watch::channel(0);
    let reader = Reader {
        driver: Arc::clone(&driver),
        incoming,
        rejected,
        received,
        budget: PoseBudget::new(limits.max_pose_rate_hz, driver.tools().len(), Instant::now().into_std()),
        limits: limits.clone(),
        in_a_row: 0,
    };
    let max_contact_age_ns = (limits.max_contact_age_s * 1e9) as u64;
    let (phase, tools) = (driver.session().phase(), driver.tools().len());
    let mut half = OutgoingHalf {
        jumps: vec![0; tools],
        echoes: vec![None; tools],
        driver,
        contacts,
        deadband,
        without_models,
        reports,
        rejections,
        acknowledged,
        in_flight: InFlight::new(max_contact_age_ns),
        max_contact_age_ns,
        reader: Some(ReaderTask(tokio::spawn(reader.run()))),
        ready: VecDeque::from([hello]),
        phase: Phase::Running,
        told: None,
    };
    half.say_phase(0, &phase);
    Box::pin(stream::unfold(half, |mut half| async move {
        let next = half.next().await?;
        Some((next, half))
    }))
}

/// Ends the reading task with the stream.
struct ReaderTask(JoinHandle<Result<(), RequestError>>);

impl Drop for ReaderTask {
    fn drop(&mut self) {
        self.0.abort();
    }
}

struct OutgoingHalf {
    driver: Arc<Driver>,
    contacts: Contacts,
    deadband: ContactDeadband,
    without_models: bool,
    reports: Reports,
    rejections: mpsc::Receiver<v1::PoseRejected>,
    acknowledged: watch::Receiver<u64>,
    in_flight: InFlight,
    max_contact_age_ns: u64,
    /// `None` once the stream has said its last.
    reader: Option<ReaderTask>,
    /// Messages of one report; the next one is looked at when they are gone.
    ready: VecDeque<v1::ControlResponse>,
    /// What the session was doing as far as was told.
    phase: Phase,
    /// The last report whose events were told; there is nothing to compare the first with.
    told: Option<Arc<StepReport>>,
    /// Per claimed tool: jumps that were told.
    jumps: Vec<u64>,
    /// Per claimed tool: the newest pose that was told of.
    echoes: Vec<Option<Echo>>,
}

enum Woken {
    Rejected(v1::PoseRejected),
    Acknowledged(u64),
    ReaderEnded(Result<(), RequestError>),
    Reported(Option<Arc<StepReport>>),
}

impl OutgoingHalf {
    async fn next(&mut self) -> Option<Result<v1::ControlResponse, Status>> {
        loop {
            if let Some(down) = self.ready.pop_front() {
                if self.is_in_time(&down) {
                    return Some(Ok(down));
                }
                continue;
            }
            match self.wait().await? {
                Woken::Rejected(rejected) => self.say(Message::Rejected(rejected)),
                Woken::Acknowledged(number) => {
                    self.in_flight.acknowledge(number, MonotonicClock::now_ns());
                    if let Some(held_back) = self.told.clone() {
                        self.tell_contacts(&held_back);
                    }
                }
                Woken::ReaderEnded(ended) => {
                    self.reader = None;
                    return ended.err().map(|error| Err(error.into()));
                }
                Woken::Reported(Some(report)) => {
                    if let Some(message) = report.phase.failure() {
                        self.reader = None;
                        let error = SessionError::Failed { message: message.to_owned() };
                        return Some(Err(RequestError::from(error).into()));
                    }
                    self.tell_events(&report);
                    self.tell_contacts(&report);
                    self.told = Some(report);
                }
                Woken::Reported(None) => {
                    self.reader = None;
                    if let Some(moved) = moved(self.driver.session()) {
                        return Some(Err(moved.into()));
                    }
                    self.say_lost(self.driver.tools().to_vec(), v1::LeaseLostReason::SessionClosing);
                }
            }
        }
    }

    /// What happens first; `None` when the stream is over.
    async fn wait(&mut self) -> Option<Woken> {
        let reader = &mut self.reader.as_mut()?.0;
        // In an order, so that a simulation by seed gives the same run: none of them is always ready.
        Some(tokio::select! {
            biased;
            Some(rejected) = self.rejections.recv() => Woken::Rejected(rejected),
            Ok(()) = self.acknowledged.changed() => Woken::Acknowledged(*self.acknowledged.borrow_and_update()),
            ended = reader => Woken::ReaderEnded(ended.unwrap_or(Ok(()))),
            report = self.reports.next() => Woken::Reported(report),
        })
    }

    /// The transport may have been full since a message was made; a contact does not keep.
    fn is_in_time(&self, down: &v1::ControlResponse) -> bool {
        match &down.message {
            Some(Message::Contact(contact)) => self.is_current(contact.server_ns),
            _ => true,
        }
    }

    fn is_current(&self, ended_ns: u64) -> bool {
        MonotonicClock::now_ns().saturating_sub(ended_ns) <= self.max_contact_age_ns
    }

    fn say(&mut self, message: Message) {
        self.ready.push_back(v1::ControlResponse { message: Some(message) });
    }

    fn say_event(&mut self, step: u64, kind: v1::EventKind, late_share: f64) {
        self.say(Message::Event(v1::Event { step, kind: kind.into(), late_share, ..v1::Event::default() }));
    }

    fn say_lost(&mut self, tools: Vec<usize>, reason: v1::LeaseLostReason) {
        for tool in tools {
            self.say(Message::LeaseLost(v1::LeaseLost { tool_id: tool as u32, reason: reason.into() }));
        }
    }

    /// What the session is doing, where that is not what was told.
    fn say_phase(&mut self, step: u64, now: &Phase) {
        if self.phase != *now {
            match now {
                Phase::Running => self.say_event(step, v1::EventKind::Resumed, 0.0),
                Phase::Paused => self.say_event(step, v1::EventKind::Paused, 0.0),
                // Both end the stream.
                Phase::Failed { .. } | Phase::Closing => {}
            }
            self.phase = now.clone();
        }
    }

    fn tell_events(&mut self, report: &StepReport) {
        for (tool, loss) in self.driver.take_lost_tools() {
            let reason = match loss {
                Loss::Silence => v1::LeaseLostReason::Silence,
                Loss::TakenOver => v1::LeaseLostReason::TakenOver,
            };
            self.say_lost(vec![tool], reason);
        }
        if let Some(told) = self.told.take() {
            if report.resets != told.resets {
                self.say_event(report.step, v1::EventKind::Reset, 0.0);
            }
            // A reset counts anew from 0.
            if report.overloads > told.overloads {
                self.say_event(report.step, v1::EventKind::Overloaded, report.late_share);
            }
            if report.faults > told.faults
                && let Some(found) = &report.last_fault
            {
                self.say(Message::Fault(fault(found)));
            }
            if report.relative_tolerance != told.relative_tolerance {
                self.say(Message::ToleranceChanged(v1::ToleranceChanged {
                    step: report.step,
                    relative_tolerance: report.relative_tolerance,
                }));
            }
            if report.restores > told.restores {
                let name = report.last_restored.as_deref().unwrap_or_default().to_owned();
                self.say(Message::CheckpointRestored(v1::CheckpointRestored { step: report.step, name }));
            }
        }
        self.say_phase(report.step, &report.phase);
    }

    /// Tells of the step what each tool feels, where it is time for it and the client has read enough of what went
    /// before.
    fn tell_contacts(&mut self, report: &StepReport) {
        let driver = Arc::clone(&self.driver);
        let echo = |tool: usize| report.tools.get(tool)?.echo.filter(|echo| echo.driver == driver.id());
        let is_new = |(told, tool): (&Option<Echo>, &usize)| echo(*tool).is_some_and(|echo| *told != Some(echo));
        let news = match self.echoes.iter().zip(driver.tools()).any(is_new) {
            true => News::NewPose,
            false => News::None,
        };
        if !self.deadband.is_news(report, driver.tools()) {
            return;
        }
        if !self.contacts.is_due(report, news) || !self.is_current(report.ended_ns) || !self.in_flight.has_room() {
            return;
        }
        let late_steps = self.contacts.tell(report);
        self.deadband.tell(report, driver.tools());
        let number = self.in_flight.send(MonotonicClock::now_ns());
        for (index, &tool) in driver.tools().iter().enumerate() {
            self.echoes[index] = echo(tool);
            let jumps = report.tools.get(tool).map_or(0, |of_tool| of_tool.jumps);
            let mut flags = 0;
            if late_steps > 0 {
                flags |= v1::ContactFlag::Late as u32;
            }
            if jumps > self.jumps[index] {
                flags |= v1::ContactFlag::Reentered as u32;
            }
            self.jumps[index] = jumps;
            let numbered = (number, self.contacts.rate_hz());
            let told = contact(report, tool, driver.id(), numbered, flags);
            let told = if self.without_models { without_model(told, report) } else { told };
            self.say(Message::Contact(told));
        }
    }
}

/// Reads what the client sends until it ends or errs too often.
struct Reader {
    driver: Arc<Driver>,
    incoming: Streaming<v1::ControlRequest>,
    rejected: mpsc::Sender<v1::PoseRejected>,
    /// Number of the newest contact that the client has read.
    received: watch::Sender<u64>,
    budget: PoseBudget,
    limits: ControlLimits,
    in_a_row: u32,
}

impl Reader {
    async fn run(mut self) -> Result<(), RequestError> {
        let idle_limit = Duration::from_secs_f64(self.limits.idle_timeout_s);
        loop {
            let up = tokio::time::timeout(idle_limit, self.incoming.message()).await;
            let up = up.map_err(|_| RequestError::Idle { limit_s: self.limits.idle_timeout_s })?;
            match up.map_err(|status| RequestError::Transport(Box::new(status)))? {
                None => return Ok(()),
                Some(up) => self.take(up)?,
            }
        }
    }

    fn take(&mut self, up: v1::ControlRequest) -> Result<(), RequestError> {
        if up.received > 0 {
            self.received.send_if_modified(|received| {
                let is_newer = up.received > *received;
                *received = up.received.max(*received);
                is_newer
            });
            if up.message.is_none() {
                return Ok(());
            }
        }
        let (tool_id, seq, result) = match up.message {
            Some(v1::control_request::Message::Pose(pose)) => {
                if let Err(rejected) = self.budget.take(pose.tool_id, pose.seq, Instant::now().into_std()) {
                    // Neither garbage nor a glitch: what a network held up comes together too.
                    let _ = self.rejected.try_send(rejected);
                    return Ok(());
                }
                (pose.tool_id, pose.seq, submit(&self.driver, &pose))
            }
            Some(v1::control_request::Message::Lift(lift)) => {
                (lift.tool_id, 0, self.driver.lift(lift.tool_id as usize))
            }
            Some(v1::control_request::Message::Hello(_)) => return Err(RequestError::HelloRepeated),
            None => return Err(RequestError::Missing { field: "message" }),
        };
        match result {
            Ok(()) => {
                self.in_a_row = 0;
                Ok(())
            }
            Err(refusal) => self.reject(rejection(tool_id, seq, &refusal)),
        }
    }

    fn reject(&mut self, rejected: v1::PoseRejected) -> Result<(), RequestError> {
        self.in_a_row += 1;
        if self.in_a_row >= self.limits.max_rejected_in_a_row {
            let v1::PoseRejected { field, limit, .. } = rejected;
            return Err(RequestError::TooManyRejected { count: self.in_a_row, field, limit });
        }
        // A client that does not read what it did wrong is not told more of it.
        let _ = self.rejected.try_send(rejected);
        Ok(())
    }
}

/// Hands a pose as it arrived to its tool.
pub fn submit(driver: &Driver, pose: &v1::ToolPose) -> Result<(), PoseRefusal> {
    let sample = pose_sample(pose, &driver.session().limits().pose)?;
    driver.submit(pose.tool_id as usize, &sample)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn take(contacts: &mut Contacts, report: &StepReport, news: News) -> Option<u64> {
        contacts.is_due(report, news).then(|| contacts.tell(report))
    }

    /// Steps, each of `step_ns`, whose reports are told; `news` of the poses by step.
    fn told_steps(
        contacts: &mut Contacts,
        steps: std::ops::Range<u64>,
        step_ns: u64,
        news: impl Fn(u64) -> News,
    ) -> Vec<u64> {
        let report = |step| StepReport { step, ended_ns: step * step_ns, ..StepReport::default() };
        steps.filter(|step| take(contacts, &report(*step), news(*step)).is_some()).collect()
    }

    fn nothing(_step: u64) -> News {
        News::None
    }

    #[test]
    fn contacts_come_at_the_granted_rate_and_go_on_after_a_reset() {
        let mut contacts = Contacts::new(1000.0, 250.0);
        assert_eq!(contacts.rate_hz(), 250.0);
        let told = told_steps(&mut contacts, 101..120, 1_000_000, nothing);
        assert_eq!(told, [101, 103, 107, 111, 115, 119]);
        assert_eq!(told_steps(&mut contacts, 1..2, 1_000_000, nothing), [1]);
    }

    #[test]
    fn contacts_keep_their_rate_though_steps_are_late() {
        let told = told_steps(&mut Contacts::new(1000.0, 250.0), 1..1001, 1_500_000, nothing);
        // 1.5 s of 250 Hz.
        assert!(told.len().abs_diff(375) <= 2, "{}", told.len());
    }

    #[test]
    fn the_first_step_with_a_new_pose_is_told_at_once() {
        // A pose in every fourth step, at the contacts' own rate.
        let with_pose = |step: u64| if step % 4 == 2 { News::NewPose } else { News::None };
        let told = told_steps(&mut Contacts::new(1000.0, 250.0), 1..1001, 1_000_000, with_pose);
        assert!((1..1001).filter(|step| step % 4 == 2).all(|step| told.contains(&step)), "{told:?}");
        assert!(told.len() <= 250 + 4, "{} in a second", told.len());
    }

    #[test]
    fn poses_faster_than_the_contacts_do_not_raise_their_rate() {
        let told = told_steps(&mut Contacts::new(1000.0, 250.0), 1..1001, 1_000_000, |_| News::NewPose);
        assert!(told.len().abs_diff(250) <= 4, "{} in a second", told.len());
    }

    #[test]
    fn a_late_step_between_two_contacts_is_told_with_the_second() {
        let mut contacts = Contacts::new(1000.0, 500.0);
        let mut told = |step, late_steps| {
            let report = StepReport { step, ended_ns: step * 1_000_000, late_steps, ..StepReport::default() };
            take(&mut contacts, &report, News::None)
        };
        assert_eq!(told(101, 5), Some(0));
        assert_eq!(told(102, 5), Some(0));
        assert_eq!(told(103, 6), None);
        assert_eq!(told(104, 6), Some(1));
        assert_eq!(told(106, 6), Some(0));
    }
}
