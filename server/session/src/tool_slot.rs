//! One tool as a session sees it between ticks: who drives it, and what it does next.

use kerf_physics::step_io::ToolMotion;

use crate::limits::PoseLimits;
use crate::pose_check::{PoseRefusal, PoseSample, TimedPose, check_motion, check_place};

/// A driver of a session, unique over the session's life.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct DriverId(pub u64);

/// What a station needs to measure its round trip by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Echo {
    /// Driver that sent the pose.
    pub driver: DriverId,
    /// Sequence number of the pose.
    pub seq: u64,
    /// The client's time stamp of the pose, ns.
    pub client_ns: u64,
    /// When the pose arrived, ns on the server's monotonic clock.
    pub arrived_ns: u64,
}

#[derive(Clone, Copy, Debug)]
struct Lease {
    driver: DriverId,
    heard_ns: u64,
}

/// Whether the world has a tool.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Presence {
    /// It is lifted.
    #[default]
    Out,
    /// It is where it was last told to be.
    In,
    /// It may be there, at a pose that is too old to move on from.
    Stale,
}

/// Lease and pending motion of a tool. At most one motion waits, whatever the rate of poses.
#[derive(Clone, Debug, Default)]
pub(crate) struct ToolSlot {
    lease: Option<Lease>,
    /// Who lost the lease by silence and has not been told.
    evicted: Option<DriverId>,
    /// Last accepted pose under this lease, or of the steps that were asked for while nobody held one.
    last: Option<TimedPose>,
    /// The last pose, if it was refused for being too far from `last`.
    jumped_to: Option<TimedPose>,
    pending: Option<ToolMotion>,
    /// As of when `pending` is applied.
    presence: Presence,
    /// Who last asked for models of its contact, and how far apart, ns.
    models: Option<(DriverId, u64)>,
    /// Whether `pending` puts down a tool that had jumped.
    jumped: bool,
}

/// What a tool does in the coming step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SlotMotion {
    pub motion: ToolMotion,
    /// The tool had jumped, and is put down where it went.
    pub jumped: bool,
}

impl ToolSlot {
    pub fn driver(&self) -> Option<DriverId> {
        self.lease.map(|lease| lease.driver)
    }

    /// Gives the tool to `driver` if it is free or already theirs; `false` if another holds it.
    pub fn claim(&mut self, driver: DriverId, now_ns: u64) -> bool {
        match &mut self.lease {
            Some(lease) if lease.driver != driver => false,
            Some(_) => true,
            None => {
                self.lease = Some(Lease { driver, heard_ns: now_ns });
                self.last = None;
                // Nobody is evicted from what they hold again.
                self.evicted = self.evicted.filter(|evicted| *evicted != driver);
                true
            }
        }
    }

    /// Checks a pose from the holder of the lease and makes it the pending motion.
    pub fn accept(&mut self, sample: &PoseSample, now_ns: u64, limits: &PoseLimits) -> Result<(), PoseRefusal> {
        if let Some(last) = self.last
            && sample.seq <= last.sample.seq
        {
            return Err(PoseRefusal::SeqNotRising { seq: sample.seq, last: last.sample.seq });
        }
        check_place(sample, limits)?;
        let timed = TimedPose { sample: *sample, arrived_ns: now_ns };
        let enters = self.enters_by(&timed, limits)?;
        self.heard(now_ns);
        self.jumped |= enters && self.jumped_to.take().is_some();
        self.go_to(timed, enters);
        Ok(())
    }

    /// Takes the tool, which nobody may hold, to where the coming step of `dt_ns` has it; without a pose it is lifted.
    pub fn follow(&mut self, to: Option<&PoseSample>, dt_ns: u64, limits: &PoseLimits) -> Result<(), PoseRefusal> {
        let Some(&sample) = to else {
            self.leave_scene();
            return Ok(());
        };
        check_place(&sample, limits)?;
        let timed = TimedPose { sample, arrived_ns: dt_ns };
        let from = self.last.filter(|_| self.presence == Presence::In);
        if let Some(from) = from {
            check_motion(&TimedPose { arrived_ns: 0, ..from }, &timed, limits)?;
        }
        self.go_to(timed, from.is_none());
        Ok(())
    }

    fn go_to(&mut self, to: TimedPose, enters: bool) {
        self.last = Some(to);
        // A tool that was put down since the last tick has touched nothing before its newest pose.
        let was_put_down = matches!(self.pending, Some(ToolMotion::EnterAt { .. }));
        let (pose, opening) = (to.sample.pose, to.sample.opening);
        self.pending = Some(if enters || was_put_down {
            ToolMotion::EnterAt { pose, opening }
        } else {
            ToolMotion::MoveTo { pose, opening }
        });
        self.presence = Presence::In;
    }

    /// While `driver` holds it, models of its contact are wanted this far apart.
    pub fn ask_for_models(&mut self, driver: DriverId, interval_ns: u64) {
        self.models = Some((driver, interval_ns));
    }

    /// How far apart models of its contact are wanted, if whoever holds it wants any, ns.
    pub fn model_interval_ns(&self) -> Option<u64> {
        self.models.filter(|(asked, _)| self.driver() == Some(*asked)).map(|(_, interval_ns)| interval_ns)
    }

    /// Takes the tool out of the scene until its next pose; the lease goes on.
    pub fn lift(&mut self, now_ns: u64) {
        self.heard(now_ns);
        self.leave_scene();
    }

    /// Counts as a sign of life of the driver.
    pub fn heard(&mut self, now_ns: u64) {
        if let Some(lease) = &mut self.lease {
            lease.heard_ns = now_ns;
        }
    }

    /// Whether the tool is put down at the new pose instead of moving there. A single pose that is
    /// too far away is refused, as it may be a glitch; a second one near it means that the tool is
    /// really there.
    fn enters_by(&mut self, to: &TimedPose, limits: &PoseLimits) -> Result<bool, PoseRefusal> {
        let Some(last) = self.last.as_ref().filter(|_| self.presence == Presence::In) else { return Ok(true) };
        let Err(refusal) = check_motion(last, to, limits) else {
            self.jumped_to = None;
            return Ok(false);
        };
        let settled = self.jumped_to.is_some_and(|jump| check_motion(&jump, to, limits).is_ok());
        if settled {
            return Ok(true);
        }
        self.jumped_to = Some(*to);
        Err(refusal)
    }

    /// Frees the tool if `driver` holds it.
    pub fn release(&mut self, driver: DriverId) {
        if self.driver() == Some(driver) {
            self.free();
        }
    }

    /// Frees the tool if its driver has been silent for `lease_ns`; says whether it has.
    pub fn expire(&mut self, now_ns: u64, lease_ns: u64) -> bool {
        match self.lease {
            Some(lease) if now_ns.saturating_sub(lease.heard_ns) >= lease_ns => {
                self.evicted = Some(lease.driver);
                self.free();
                true
            }
            _ => false,
        }
    }

    fn free(&mut self) {
        self.lease = None;
        self.last = None;
        self.leave_scene();
    }

    fn leave_scene(&mut self) {
        self.jumped_to = None;
        self.jumped = false;
        if self.presence != Presence::Out {
            self.pending = Some(ToolMotion::Lift);
            self.presence = Presence::Out;
        }
    }

    /// Whether `driver` lost this tool by silence; true once.
    pub fn take_eviction(&mut self, driver: DriverId) -> bool {
        self.evicted.take_if(|evicted| *evicted == driver).is_some()
    }

    /// The world has no pose of the tool any more, or one that is too old to move from: the next
    /// motion puts it down.
    pub fn reenter(&mut self) {
        match self.pending {
            Some(ToolMotion::MoveTo { pose, opening }) => self.pending = Some(ToolMotion::EnterAt { pose, opening }),
            None if self.presence == Presence::In => self.presence = Presence::Stale,
            _ => {}
        }
    }

    /// The world has the tool where it was at another moment: it is lifted, unless a pose waits to put it
    /// down.
    pub fn withdraw(&mut self) {
        self.reenter();
        if !matches!(self.pending, Some(ToolMotion::EnterAt { .. })) {
            (self.pending, self.presence) = (Some(ToolMotion::Lift), Presence::Out);
        }
    }

    /// What the tool does in the coming step.
    pub fn take_motion(&mut self) -> Option<SlotMotion> {
        let motion = self.pending.take()?;
        Some(SlotMotion { motion, jumped: std::mem::take(&mut self.jumped) })
    }

    /// Of the last accepted pose.
    pub fn echo(&self) -> Option<Echo> {
        let (lease, TimedPose { sample, arrived_ns }) = (self.lease?, self.last?);
        Some(Echo { driver: lease.driver, seq: sample.seq, client_ns: sample.client_ns, arrived_ns })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kerf_physics::Vec3;
    use kerf_physics::tool::Pose;

    const MS: u64 = 1_000_000;
    const A: DriverId = DriverId(1);
    const B: DriverId = DriverId(2);

    fn at(seq: u64, x_m: f64) -> PoseSample {
        let pose = Pose { position_m: Vec3::new(x_m, 0.0, 0.0), ..Pose::default() };
        PoseSample { seq, client_ns: seq, pose, opening: 1.0 }
    }

    fn entered() -> ToolSlot {
        let mut slot = ToolSlot::default();
        assert!(slot.claim(A, 0));
        slot.accept(&at(1, 0.0), 0, &PoseLimits::default()).unwrap();
        assert!(entered_at_x_m(&mut slot).is_some());
        slot
    }

    fn moved_to_x_m(slot: &mut ToolSlot) -> Option<f64> {
        match slot.take_motion()?.motion {
            ToolMotion::MoveTo { pose, .. } => Some(pose.position_m.x),
            _ => None,
        }
    }

    fn entered_at_x_m(slot: &mut ToolSlot) -> Option<f64> {
        match slot.take_motion()?.motion {
            ToolMotion::EnterAt { pose, .. } => Some(pose.position_m.x),
            _ => None,
        }
    }

    #[test]
    fn poses_since_the_last_tick_reduce_to_the_latest() {
        let mut slot = entered();
        for seq in 2..6 {
            slot.accept(&at(seq, seq as f64 * 1e-3), seq * MS, &PoseLimits::default()).unwrap();
        }
        assert_eq!(moved_to_x_m(&mut slot), Some(5e-3));
        assert_eq!(slot.take_motion(), None);
        assert_eq!(slot.echo().map(|e| (e.seq, e.client_ns)), Some((5, 5)));
    }

    #[test]
    fn a_tool_put_down_and_moved_within_a_tick_is_put_down_at_its_newest_pose() {
        let mut slot = ToolSlot::default();
        slot.claim(A, 0);
        slot.accept(&at(1, 0.0), 0, &PoseLimits::default()).unwrap();
        slot.accept(&at(2, 1e-3), MS, &PoseLimits::default()).unwrap();
        assert_eq!(entered_at_x_m(&mut slot), Some(1e-3));
    }

    #[test]
    fn a_motion_states_the_opening_of_its_pose() {
        let mut slot = entered();
        let mut closing = |seq, x_m| {
            slot.accept(&PoseSample { opening: 0.25, ..at(seq, x_m) }, seq * MS, &PoseLimits::default()).unwrap();
            slot.take_motion().unwrap().motion
        };
        let pose = at(2, 1e-3).pose;
        assert_eq!(closing(2, 1e-3), ToolMotion::MoveTo { pose, opening: 0.25 });
    }

    #[test]
    fn seq_must_rise_and_a_refused_pose_changes_nothing() {
        let mut slot = entered();
        let refusal = slot.accept(&at(1, 1e-3), MS, &PoseLimits::default()).unwrap_err();
        assert_eq!(refusal, PoseRefusal::SeqNotRising { seq: 1, last: 1 });
        assert_eq!(slot.take_motion(), None);
    }

    #[test]
    fn a_single_far_pose_is_refused_and_forgotten() {
        let mut slot = entered();
        assert!(slot.accept(&at(2, 0.5), MS, &PoseLimits::default()).is_err());
        slot.accept(&at(3, 1e-3), 2 * MS, &PoseLimits::default()).unwrap();
        assert_eq!(moved_to_x_m(&mut slot), Some(1e-3));
    }

    #[test]
    fn a_tool_that_stays_where_it_teleported_to_is_put_down_there() {
        let mut slot = entered();
        assert!(slot.accept(&at(2, 0.5), MS, &PoseLimits::default()).is_err());
        slot.accept(&at(3, 0.501), 2 * MS, &PoseLimits::default()).unwrap();
        let put_down = slot.take_motion().unwrap();
        assert!(put_down.jumped);
        assert!(matches!(put_down.motion, ToolMotion::EnterAt { pose, .. } if pose.position_m.x == 0.501));
        slot.accept(&at(4, 0.502), 3 * MS, &PoseLimits::default()).unwrap();
        assert_eq!(moved_to_x_m(&mut slot), Some(0.502));
    }

    #[test]
    fn a_silent_driver_loses_the_tool_which_is_lifted() {
        let mut slot = entered();
        assert!(!slot.expire(1999 * MS, 2000 * MS));
        assert!(slot.expire(2000 * MS, 2000 * MS));
        assert_eq!(slot.take_motion().map(|m| m.motion), Some(ToolMotion::Lift));
        assert!(slot.take_eviction(A));
        assert!(!slot.take_eviction(A));
        assert!(slot.claim(B, 2000 * MS));
        assert!(!slot.claim(A, 2000 * MS));
    }

    #[test]
    fn refused_poses_do_not_keep_a_lease() {
        let mut slot = entered();
        assert!(slot.accept(&at(2, f64::NAN), 1500 * MS, &PoseLimits::default()).is_err());
        assert!(slot.expire(2000 * MS, 2000 * MS));
    }

    #[test]
    fn a_second_driver_is_refused_until_the_first_releases() {
        let mut slot = entered();
        assert!(!slot.claim(B, MS));
        slot.release(B);
        assert!(!slot.claim(B, MS));
        slot.release(A);
        assert!(slot.claim(B, MS));
        // A new lease starts a new sequence.
        slot.accept(&at(1, 0.3), MS, &PoseLimits::default()).unwrap();
        assert!(entered_at_x_m(&mut slot).is_some());
    }

    #[test]
    fn after_the_world_lost_the_tool_it_is_put_down_again() {
        let mut slot = entered();
        slot.reenter();
        slot.accept(&at(2, 1e-3), MS, &PoseLimits::default()).unwrap();
        slot.reenter();
        assert!(entered_at_x_m(&mut slot).is_some());
        slot.accept(&at(3, 2e-3), 2 * MS, &PoseLimits::default()).unwrap();
        assert_eq!(moved_to_x_m(&mut slot), Some(2e-3));
    }

    #[test]
    fn a_tool_that_stood_through_a_pause_is_lifted_when_its_driver_goes() {
        let mut slot = entered();
        slot.reenter();
        slot.release(A);
        assert_eq!(slot.take_motion().map(|m| m.motion), Some(ToolMotion::Lift));
    }

    #[test]
    fn a_tool_of_a_world_that_went_back_is_lifted_unless_a_pose_waits() {
        let mut slot = entered();
        slot.withdraw();
        assert_eq!(slot.take_motion().map(|m| m.motion), Some(ToolMotion::Lift));
        slot.accept(&at(2, 1e-3), MS, &PoseLimits::default()).unwrap();
        assert_eq!(entered_at_x_m(&mut slot), Some(1e-3));
        slot.accept(&at(3, 2e-3), 2 * MS, &PoseLimits::default()).unwrap();
        slot.withdraw();
        assert_eq!(entered_at_x_m(&mut slot), Some(2e-3));
        slot.accept(&at(4, 3e-3), 3 * MS, &PoseLimits::default()).unwrap();
        assert_eq!(moved_to_x_m(&mut slot), Some(3e-3));
    }

    #[test]
    fn a_lifted_tool_may_come_down_anywhere_but_its_sequence_goes_on() {
        let mut slot = entered();
        slot.lift(MS);
        assert_eq!(slot.take_motion().map(|m| m.motion), Some(ToolMotion::Lift));
        assert!(slot.accept(&at(1, 0.5), 2 * MS, &PoseLimits::default()).is_err());
        slot.accept(&at(2, 0.5), 2 * MS, &PoseLimits::default()).unwrap();
        let put_down = slot.take_motion().unwrap();
        assert!(matches!(put_down.motion, ToolMotion::EnterAt { .. }));
        assert!(!put_down.jumped);
    }
}
