//! The thread that sends poses: paced by absolute deadlines, never waiting on the network.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use kerf_proto::v1::{self, control_request};
use kerf_script::Placement;
use tokio::sync::mpsc::error::TrySendError;

use crate::clock;
use crate::control::Sender;
use crate::pacer::{Punctuality, Schedule};
use crate::script::Script;
use crate::wire;

/// Poses that may wait for the transport. Only the newest counts, so few; but the runtime's thread
/// may be a few ticks late on a busy machine, and a dropped pose is a jerk of the tool.
pub const QUEUED_POSES: usize = 8;

/// When and how often poses are sent.
#[derive(Clone, Copy, Debug)]
pub struct Timetable {
    /// When the script begins, on the monotonic clock, ns.
    pub start_ns: u64,
    /// Poses a second and tool, Hz.
    pub rate_hz: f64,
    /// When the script ends, s after its start.
    pub duration_s: f64,
}

impl Timetable {
    /// Script time of a tick, s.
    #[must_use]
    pub fn time_of_tick_s(&self, tick: u64) -> f64 {
        tick as f64 / self.rate_hz
    }

    /// Sequence number of a tick's poses: 0 means "none yet" on the wire.
    #[must_use]
    pub fn seq_of_tick(tick: u64) -> u64 {
        tick + 1
    }

    /// Script time of a pose by its sequence number, s; `None` for "none yet".
    #[must_use]
    pub fn time_of_seq_s(&self, seq: u64) -> Option<f64> {
        seq.checked_sub(1).map(|tick| self.time_of_tick_s(tick))
    }
}

/// Most poses that are remembered until a contact reflects them: seconds at the fastest rate, and a
/// session that reflects nothing for longer has no round trip to speak of.
const MAX_IN_FLIGHT: usize = 10_000;

/// A pose that was sent.
#[derive(Clone, Copy, Debug)]
struct Sent {
    tool_id: u32,
    seq: u64,
    sent_ns: u64,
}

/// The poses that were sent and that no contact has reflected yet, oldest first; shared by the thread
/// that sends and the one that receives.
#[derive(Debug, Default)]
pub struct InFlight(Mutex<VecDeque<Sent>>);

impl InFlight {
    /// A pose is about to be sent.
    pub fn push(&self, tool_id: u32, seq: u64, sent_ns: u64) {
        let mut poses = self.lock();
        if poses.len() == MAX_IN_FLIGHT {
            poses.pop_front();
        }
        poses.push_back(Sent { tool_id, seq, sent_ns });
    }

    /// A pose that no contact will ever reflect.
    pub fn forget(&self, tool_id: u32, seq: u64) {
        self.lock().retain(|pose| (pose.tool_id, pose.seq) != (tool_id, seq));
    }

    /// Takes the poses of a tool up to the newest that a step has used, and calls `reflected` with the
    /// number of each and when it was sent, ns. Those before the newest one were used by earlier steps,
    /// or overtaken on their way to one: this is the first contact to tell of them either way.
    pub fn take_reflected(&self, tool_id: u32, newest_seq: u64, mut reflected: impl FnMut(u64, u64)) {
        self.lock().retain(|pose| {
            let is_reflected = pose.tool_id == tool_id && pose.seq <= newest_seq;
            if is_reflected {
                reflected(pose.seq, pose.sent_ns);
            }
            !is_reflected
        });
    }

    fn lock(&self) -> MutexGuard<'_, VecDeque<Sent>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What became of the poses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SendTotals {
    /// Poses handed to the transport.
    pub sent: u64,
    /// Poses that found the transport's queue full.
    pub dropped: u64,
    /// How well the deadlines were kept.
    pub kept: Punctuality,
}

/// Sends a script's poses until it ends, `stop` is set or the stream is gone; then lifts the tools.
#[must_use]
pub fn send(
    script: &Script,
    timetable: Timetable,
    to: &Sender,
    in_flight: &InFlight,
    stop: &Arc<AtomicBool>,
) -> SendTotals {
    let mut schedule = Schedule::new(timetable.start_ns, timetable.rate_hz);
    let mut totals = SendTotals::default();
    let mut down = vec![false; script.tracks.len()];
    while !stop.load(Ordering::Relaxed) {
        clock::sleep_until_ns(schedule.deadline_ns());
        let tick = schedule.take(clock::now_ns());
        let time_s = timetable.time_of_tick_s(tick);
        if time_s > timetable.duration_s {
            break;
        }
        for (track, down) in script.tracks.iter().zip(&mut down) {
            let (tool_id, seq, client_ns) = (track.tool_id, Timetable::seq_of_tick(tick), clock::now_ns());
            let message = match track.at(time_s) {
                Some(Placement { pose, opening }) => {
                    in_flight.push(tool_id, seq, client_ns);
                    let pose = Some(wire::pose_to_wire(&pose));
                    let opening = Some(opening as f32);
                    control_request::Message::Pose(v1::ToolPose { tool_id, seq, client_ns, pose, buttons: 0, opening })
                }
                None if *down => lift(tool_id),
                None => continue,
            };
            *down = matches!(message, control_request::Message::Pose(_));
            match to.up.try_send(to.message(message)) {
                Ok(()) => totals.sent += u64::from(*down),
                Err(TrySendError::Full(_)) => {
                    in_flight.forget(tool_id, seq);
                    totals.dropped += 1;
                }
                Err(TrySendError::Closed(_)) => return SendTotals { kept: schedule.kept(), ..totals },
            }
        }
    }
    for (track, _) in script.tracks.iter().zip(down).filter(|(_, down)| *down) {
        // The last message may wait: nothing is paced any more. Closed: the stream lifts them.
        let _ = to.up.blocking_send(to.message(lift(track.tool_id)));
    }
    SendTotals { kept: schedule.kept(), ..totals }
}

fn lift(tool_id: u32) -> control_request::Message {
    control_request::Message::Lift(v1::LiftTool { tool_id })
}

#[cfg(test)]
mod tests {
    use kerf_script::{Key, Pose, Track};
    use nalgebra::{UnitQuaternion, Vector3};
    use tokio::sync::mpsc;

    use super::*;
    use crate::script::Datum;

    fn script(from_s: f64, to_s: f64) -> Script {
        let pose = Pose { position_m: Vector3::zeros(), orientation: UnitQuaternion::identity() };
        let keys = [from_s, to_s].map(|time_s| Key { time_s, placement: Some(pose.into()) }).to_vec();
        let track = Track { tool_id: 3, keys }.lifted_at_end();
        Script { tracks: vec![track], datums: vec![Datum { from_s: 0.0, height_m: 0.0 }] }
    }

    #[test]
    fn a_contact_reflects_the_poses_up_to_its_own_once_and_those_of_no_other_tool() {
        let in_flight = InFlight::default();
        let taken = |tool_id, newest_seq| {
            let mut taken = Vec::new();
            in_flight.take_reflected(tool_id, newest_seq, |seq, sent_ns| taken.push((seq, sent_ns)));
            taken
        };
        for (tool_id, seq) in [(0, 1), (1, 1), (0, 2), (0, 3), (0, 4)] {
            in_flight.push(tool_id, seq, 100 * seq);
        }
        in_flight.forget(0, 2);
        assert_eq!(taken(0, 3), [(1, 100), (3, 300)]);
        assert_eq!(taken(0, 3), []);
        assert_eq!((taken(1, 9), taken(0, 4)), (vec![(1, 100)], vec![(4, 400)]));
    }

    #[test]
    fn poses_that_nothing_reflects_are_forgotten_in_the_end() {
        let in_flight = InFlight::default();
        (1..=MAX_IN_FLIGHT as u64 + 5).for_each(|seq| in_flight.push(0, seq, seq));
        let mut first = None;
        in_flight.take_reflected(0, u64::MAX, |seq, _| first = first.or(Some(seq)));
        assert_eq!(first, Some(6));
    }

    fn messages(script: &Script, duration_s: f64, capacity: usize) -> (SendTotals, Vec<control_request::Message>) {
        let (up, mut received) = mpsc::channel(capacity);
        let up = Sender { up, received: Arc::default() };
        let timetable = Timetable { start_ns: clock::now_ns(), rate_hz: 1000.0, duration_s };
        let totals = send(script, timetable, &up, &InFlight::default(), &Arc::default());
        drop(up);
        let messages = std::iter::from_fn(|| received.blocking_recv()).filter_map(|up| up.message).collect();
        (totals, messages)
    }

    #[test]
    fn poses_carry_rising_numbers_and_the_tool_is_lifted_at_the_end() {
        let (totals, messages) = messages(&script(0.0, 1.0), 0.05, 1000);
        let (last, poses) = messages.split_last().expect("poses were sent");
        assert_eq!(*last, lift(3));
        let seqs: Vec<u64> = poses
            .iter()
            .map(|message| match message {
                control_request::Message::Pose(pose) => pose.seq,
                other => panic!("{other:?}"),
            })
            .collect();
        assert!(seqs.windows(2).all(|pair| pair[0] < pair[1]), "{seqs:?}");
        assert_eq!(totals.sent, poses.len() as u64);
        // A tick is run or skipped; the one that finds the end is run too. 0..=50 ms make 51 poses.
        assert!(totals.kept.ticks + totals.kept.skipped >= 52, "{totals:?}");
    }

    #[test]
    fn tool_is_lifted_when_its_track_ends_before_the_script() {
        let (_, messages) = messages(&script(0.0, 0.01), 0.03, 1000);
        assert_eq!(messages.iter().filter(|message| **message == lift(3)).count(), 1);
        assert_eq!(messages.last(), Some(&lift(3)));
    }

    #[test]
    fn full_queue_drops_poses_instead_of_waiting() {
        let (up, received) = mpsc::channel(2);
        let up = Sender { up, received: Arc::default() };
        let timetable = Timetable { start_ns: clock::now_ns(), rate_hz: 1000.0, duration_s: 0.02 };
        let in_flight = Arc::new(InFlight::default());
        let shared = Arc::clone(&in_flight);
        let sender = std::thread::spawn(move || send(&script(0.0, 0.015), timetable, &up, &shared, &Arc::default()));
        let totals = sender.join().expect("the sender ends though nobody reads");
        assert_eq!(totals.sent, 2);
        assert!(totals.dropped > 5, "{totals:?}");
        let mut awaited = 0;
        in_flight.take_reflected(3, u64::MAX, |_, _| awaited += 1);
        assert_eq!(awaited, 2, "nobody waits for a pose that was dropped");
        drop(received);
    }
}
