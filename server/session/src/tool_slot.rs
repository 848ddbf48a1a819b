//! One tool as a session sees it between ticks: who drives it, and what it does next.

use kerf_physics::Pose;
use kerf_physics::step_io::ToolMotion;

use crate::limits::PoseLimits;
use crate::pose_check::{PoseSample, TimedPose, check_motion, check_place};
use crate::pose_refusal::PoseRefusal;
use crate::reach::{Placement, Reach};

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

/// Why a driver has lost a tool.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Loss {
    /// Nothing was heard of it for the time of a lease.
    Silence,
    /// A newer driver of the same client has it.
    TakenOver,
}

#[derive(Clone, Copy, Debug)]
struct Lease {
    driver: DriverId,
    heard_ns: u64,
}

/// What a tool is to do.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Course {
    /// It is lifted.
    #[default]
    Out,
    /// It is put down where its newest pose has it, once that is clear of tissue; for it `jumped` there.
    Enters { jumped: bool },
    /// It is in the scene and follows its newest pose.
    Follows,
    /// It is in the scene, from before the session stood or went back: it goes on if its next pose is where it is, and
    /// enters anew if the hand has gone elsewhere.
    Returns,
}

/// Lease of a tool, where it is wanted and where it is. At most one pose waits, whatever the rate of poses.
#[derive(Clone, Debug, Default)]
pub(crate) struct ToolSlot {
    lease: Option<Lease>,
    /// Who lost the lease and has not been told, and why.
    evicted: Option<(DriverId, Loss)>,
    /// Last accepted pose under this lease, or of the steps that were asked for while nobody held one.
    last: Option<TimedPose>,
    /// The last pose, if it was refused for being too far from `last`.
    jumped_to: Option<TimedPose>,
    course: Course,
    /// Where the last step had it; `None`: lifted.
    placed: Option<Placement>,
    /// Who last asked for models of its contact, and how far apart, ns.
    models: Option<(DriverId, u64)>,
}

/// What a tool does in the coming step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SlotMotion {
    pub motion: ToolMotion,
    /// The tool had jumped, and is put down where it went.
    pub jumped: bool,
}

impl SlotMotion {
    fn of(motion: ToolMotion) -> Self {
        Self { motion, jumped: false }
    }
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
                self.evicted = self.evicted.filter(|(evicted, _)| *evicted != driver);
                true
            }
        }
    }

    /// Takes a pose from the holder of the lease as the one to follow, if it is plausible.
    pub fn accept(&mut self, sample: &PoseSample, now_ns: u64, limits: &PoseLimits) -> Result<(), PoseRefusal> {
        if let Some(last) = self.last
            && sample.seq <= last.sample.seq
        {
            return Err(PoseRefusal::SeqNotRising { seq: sample.seq, last: last.sample.seq });
        }
        check_place(sample, limits)?;
        let timed = TimedPose { sample: *sample, arrived_ns: now_ns };
        self.course = self.course_by(&timed, limits)?;
        self.jumped_to = None;
        self.heard(now_ns);
        self.last = Some(timed);
        Ok(())
    }

    /// Takes the tool, which nobody may hold, to where the coming step of `dt_s` has it; without a pose it is lifted.
    pub fn follow(&mut self, to: Option<&PoseSample>, dt_s: f64, limits: &PoseLimits) -> Result<(), PoseRefusal> {
        let Some(&sample) = to else {
            self.course = Course::Out;
            return Ok(());
        };
        check_place(&sample, limits)?;
        match self.placed.filter(|_| self.course == Course::Follows) {
            Some(placed) => Reach::within(dt_s, limits).check(&placed.pose, &sample.pose)?,
            None => self.course = Course::Enters { jumped: false },
        }
        self.last = Some(TimedPose { sample, arrived_ns: 0 });
        Ok(())
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
        (self.course, self.jumped_to) = (Course::Out, None);
    }

    /// Counts as a sign of life of the driver.
    pub fn heard(&mut self, now_ns: u64) {
        if let Some(lease) = &mut self.lease {
            lease.heard_ns = now_ns;
        }
    }

    /// What the tool does about a new pose. A single pose that is too far away is refused, as it may be a glitch; a
    /// second one near it means that the tool is really there.
    fn course_by(&mut self, to: &TimedPose, limits: &PoseLimits) -> Result<Course, PoseRefusal> {
        let last = match (self.course, &self.last) {
            (Course::Follows, Some(last)) => last,
            (Course::Out | Course::Follows, _) => return Ok(Course::Enters { jumped: false }),
            // Not in the scene, or not since the session stood: it may come down anywhere.
            (course, _) => return Ok(course),
        };
        let Err(refusal) = check_motion(last, to, limits) else { return Ok(self.course) };
        if self.jumped_to.is_some_and(|jump| check_motion(&jump, to, limits).is_ok()) {
            return Ok(Course::Enters { jumped: true });
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
                self.evicted = Some((lease.driver, Loss::Silence));
                self.free();
                true
            }
            _ => false,
        }
    }

    /// Gives the tool to another driver of the client that holds it; it enters anew.
    pub fn take_over(&mut self, driver: DriverId, now_ns: u64) {
        if let Some(lease) = self.lease.filter(|lease| lease.driver != driver) {
            self.evicted = Some((lease.driver, Loss::TakenOver));
            self.free();
        }
        self.claim(driver, now_ns);
    }

    fn free(&mut self) {
        (self.lease, self.last, self.jumped_to, self.course) = (None, None, None, Course::Out);
    }

    /// Whether `driver` lost this tool by silence; true once.
    pub fn take_eviction(&mut self, driver: DriverId) -> Option<Loss> {
        self.evicted.take_if(|(evicted, _)| *evicted == driver).map(|(_, loss)| loss)
    }

    /// The world has lost its hold of the tool, which is put down anew.
    pub fn reenter(&mut self) {
        if self.is_in() {
            self.course = Course::Enters { jumped: false };
        }
    }

    /// The session has stood: where a hand holds the tool, it may have gone elsewhere.
    pub fn stood(&mut self) {
        if self.lease.is_some() && self.course == Course::Follows {
            self.course = Course::Returns;
        }
    }

    /// The world is at rest, without tools. A hand that holds this one puts it down anew.
    pub fn reset(&mut self) {
        self.placed = None;
        match self.lease {
            Some(_) => self.reenter(),
            None => self.free(),
        }
    }

    /// The world is at another moment and has the tool there. A hand that is where it was then goes on with it; what
    /// steps that were asked for had put there stays.
    pub fn go_back(&mut self, placed: Option<Placement>, by_calls: bool) {
        self.placed = placed;
        match (self.lease, placed) {
            (Some(_), Some(_)) if self.course != Course::Out => self.course = Course::Returns,
            (Some(_), _) => self.reenter(),
            (None, Some(Placement { pose, opening })) if by_calls => {
                let sample = PoseSample { seq: 0, client_ns: 0, pose, opening };
                (self.last, self.course) = (Some(TimedPose { sample, arrived_ns: 0 }), Course::Follows);
            }
            (None, _) => self.free(),
        }
    }

    /// Whether steps that were asked for have put it where it is, with nobody who holds it.
    pub fn is_placed_by_calls(&self) -> bool {
        self.lease.is_none() && self.placed.is_some()
    }

    /// The tool was to be put down in this step and is kept out: there is tissue.
    pub fn keep_out(&mut self, jumped: bool) {
        (self.course, self.placed) = (Course::Enters { jumped }, None);
    }

    fn is_in(&self) -> bool {
        matches!(self.course, Course::Follows | Course::Returns)
    }

    /// What the tool does in the coming step of `dt_s`: it goes no farther than a hand does in the time. Behind its
    /// newest pose it catches up, or is lifted and put down there if it is too far behind.
    pub fn take_motion(&mut self, dt_s: f64, limits: &PoseLimits) -> Option<SlotMotion> {
        if self.course == Course::Out {
            return self.placed.take().map(|_| SlotMotion::of(ToolMotion::Lift));
        }
        let wanted = self.last?.sample.placement();
        let step = Reach::within(dt_s, limits);
        self.course = self.course_to(&wanted.pose, step.plus(Reach::within(limits.catch_up_s, limits)), limits);
        match (self.course, self.placed) {
            (Course::Enters { jumped }, _) => {
                (self.course, self.placed) = (Course::Follows, Some(wanted));
                let Placement { pose, opening } = wanted;
                Some(SlotMotion { motion: ToolMotion::EnterAt { pose, opening }, jumped })
            }
            (Course::Follows, Some(placed)) if placed != wanted => {
                let next @ Placement { pose, opening } = step.toward(&placed, &wanted);
                self.placed = Some(next);
                Some(SlotMotion::of(ToolMotion::MoveTo { pose, opening }))
            }
            _ => None,
        }
    }

    fn course_to(&self, wanted: &Pose, farthest: Reach, limits: &PoseLimits) -> Course {
        let comes = |reach: Reach| self.placed.is_some_and(|placed| reach.check(&placed.pose, wanted).is_ok());
        match self.course {
            Course::Follows if !comes(farthest) => Course::Enters { jumped: true },
            Course::Returns if !comes(Reach::slack(limits)) => Course::Enters { jumped: false },
            // No pose has come since.
            Course::Returns if self.placed.is_some_and(|placed| placed.pose == *wanted) => Course::Returns,
            Course::Returns => Course::Follows,
            course => course,
        }
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
    use kerf_physics::{Pose, Vec3};

    const MS: u64 = 1_000_000;
    const DT_S: f64 = 2e-3;
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

    fn motion(slot: &mut ToolSlot) -> Option<SlotMotion> {
        slot.take_motion(DT_S, &PoseLimits::default())
    }

    fn moved_to_x_m(slot: &mut ToolSlot) -> Option<f64> {
        match motion(slot)?.motion {
            ToolMotion::MoveTo { pose, .. } => Some(pose.position_m.x),
            _ => None,
        }
    }

    fn entered_at_x_m(slot: &mut ToolSlot) -> Option<f64> {
        match motion(slot)?.motion {
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
        assert_eq!(motion(&mut slot), None);
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
            slot.accept(&PoseSample { opening: 0.98, ..at(seq, x_m) }, seq * MS, &PoseLimits::default()).unwrap();
            motion(&mut slot).unwrap().motion
        };
        let pose = at(2, 1e-3).pose;
        assert_eq!(closing(2, 1e-3), ToolMotion::MoveTo { pose, opening: 0.98 });
    }

    #[test]
    fn seq_must_rise_and_a_refused_pose_changes_nothing() {
        let mut slot = entered();
        let refusal = slot.accept(&at(1, 1e-3), MS, &PoseLimits::default()).unwrap_err();
        assert_eq!(refusal, PoseRefusal::SeqNotRising { seq: 1, last: 1 });
        assert_eq!(motion(&mut slot), None);
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
        let put_down = motion(&mut slot).unwrap();
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
        assert_eq!(motion(&mut slot).map(|m| m.motion), Some(ToolMotion::Lift));
        assert_eq!(slot.take_eviction(A), Some(Loss::Silence));
        assert_eq!(slot.take_eviction(A), None);
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
        slot.stood();
        slot.release(A);
        assert_eq!(motion(&mut slot).map(|m| m.motion), Some(ToolMotion::Lift));
    }

    #[test]
    fn a_hand_that_is_where_the_tool_stood_goes_on_and_one_that_has_gone_elsewhere_puts_it_down_anew() {
        for (x_m, goes_on) in [(1e-3, true), (0.03, false)] {
            let mut slot = entered();
            slot.stood();
            assert_eq!(motion(&mut slot), None, "no pose has come");
            slot.accept(&at(2, x_m), 20 * MS, &PoseLimits::default()).unwrap();
            let next = motion(&mut slot).unwrap();
            assert_eq!(matches!(next.motion, ToolMotion::MoveTo { .. }), goes_on, "{next:?}");
            assert!(!next.jumped);
        }
    }

    fn placed_at(x_m: f64) -> Option<Placement> {
        Some(at(0, x_m).placement())
    }

    #[test]
    fn of_a_world_that_went_back_a_tool_goes_on_in_a_hand_that_is_there() {
        let gone_back = |placed, x_m| {
            let mut slot = entered();
            slot.accept(&at(2, x_m), 20 * MS, &PoseLimits::default()).unwrap();
            slot.go_back(placed, false);
            motion(&mut slot).map(|next| next.motion)
        };
        assert!(matches!(gone_back(placed_at(0.0), 1e-3), Some(ToolMotion::MoveTo { .. })));
        assert!(matches!(gone_back(placed_at(0.0), 0.01), Some(ToolMotion::EnterAt { .. })));
        assert!(matches!(gone_back(None, 0.0), Some(ToolMotion::EnterAt { .. })));
    }

    #[test]
    fn of_a_world_that_went_back_a_tool_that_nobody_holds_stays_where_calls_had_put_it_and_is_lifted_else() {
        let placed = |by_calls| {
            let mut slot = ToolSlot::default();
            slot.go_back(placed_at(0.1), by_calls);
            (motion(&mut slot).map(|next| next.motion), slot.is_placed_by_calls())
        };
        assert_eq!(placed(true), (None, true));
        assert_eq!(placed(false), (Some(ToolMotion::Lift), false));
    }

    #[test]
    fn poses_that_add_up_to_more_than_a_step_allows_are_caught_up_with_at_the_limit_of_speed() {
        let mut slot = entered();
        for seq in 2..=15 {
            slot.accept(&at(seq, 2e-3 * (seq - 1) as f64), 20 * MS, &PoseLimits::default()).unwrap();
        }
        let way_m: Vec<f64> = std::iter::from_fn(|| moved_to_x_m(&mut slot)).collect();
        let wanted_m = [6e-3, 12e-3, 18e-3, 24e-3, 28e-3];
        assert!(way_m.iter().zip(wanted_m).all(|(at, wanted)| (at - wanted).abs() < 1e-12), "{way_m:?}");
        assert_eq!(way_m.len(), wanted_m.len(), "{way_m:?}");
    }

    #[test]
    fn poses_that_add_up_to_more_than_can_be_caught_up_with_put_the_tool_down_anew() {
        let mut slot = entered();
        for seq in 2..=31 {
            slot.accept(&at(seq, 2e-3 * (seq - 1) as f64), 20 * MS, &PoseLimits::default()).unwrap();
        }
        let next = motion(&mut slot).unwrap();
        assert!(next.jumped && matches!(next.motion, ToolMotion::EnterAt { pose, .. } if pose.position_m.x == 0.06));
        slot.keep_out(next.jumped);
        slot.accept(&at(32, 0.061), 21 * MS, &PoseLimits::default()).unwrap();
        assert!(motion(&mut slot).unwrap().jumped, "it is told where it is put down at last");
    }

    #[test]
    fn jaws_that_a_button_closes_take_their_time_and_do_not_hold_the_hand_back() {
        let mut slot = entered();
        slot.accept(&PoseSample { opening: 0.0, ..at(2, 1e-3) }, 2 * MS, &PoseLimits::default()).unwrap();
        let openings = std::iter::from_fn(|| match motion(&mut slot)?.motion {
            ToolMotion::MoveTo { pose, opening } if pose.position_m.x == 1e-3 => Some(opening),
            other => panic!("{other:?}"),
        });
        let openings: Vec<f64> = openings.collect();
        assert_eq!((openings.len(), openings.last()), (25, Some(&0.0)), "50 ms: {openings:?}");
        assert!(openings.iter().zip(&openings[1..]).all(|(before, now)| before - now < 0.0401), "{openings:?}");
    }

    #[test]
    fn a_lifted_tool_may_come_down_anywhere_but_its_sequence_goes_on() {
        let mut slot = entered();
        slot.lift(MS);
        assert_eq!(motion(&mut slot).map(|m| m.motion), Some(ToolMotion::Lift));
        assert!(slot.accept(&at(1, 0.5), 2 * MS, &PoseLimits::default()).is_err());
        slot.accept(&at(2, 0.5), 2 * MS, &PoseLimits::default()).unwrap();
        let put_down = motion(&mut slot).unwrap();
        assert!(matches!(put_down.motion, ToolMotion::EnterAt { .. }));
        assert!(!put_down.jumped);
    }
}
