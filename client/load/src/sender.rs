//! The thread that sends poses: paced by absolute deadlines, never waiting on the network.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use kerf_proto::v1::{self, control_request};
use kerf_script::Placement;
use tokio::sync::mpsc::error::TrySendError;

use crate::clock;
use crate::control::Sender;
use crate::in_flight::InFlight;
use crate::pacer::{Punctuality, Schedule};
use crate::script::Script;
use crate::timetable::Timetable;
use crate::wire;

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

impl SendTotals {
    /// Adds what another session's driver sent.
    pub fn add(&mut self, other: &Self) {
        self.sent += other.sent;
        self.dropped += other.dropped;
        self.kept.ticks += other.kept.ticks;
        self.kept.late += other.kept.late;
        self.kept.skipped += other.kept.skipped;
    }
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
    let mut next = 0;
    while !stop.load(Ordering::Relaxed) {
        clock::sleep_until_ns(schedule.deadline_ns());
        let tick = schedule.take(clock::now_ns());
        let time_s = timetable.time_of_tick_s(tick);
        if time_s > timetable.duration_s {
            break;
        }
        for (track, down) in script.tracks.iter().zip(&mut down) {
            let tool_id = track.tool_id;
            // The hand moved on in the ticks that were left out, and their poses wait for an answer as any other.
            (next..=tick)
                .filter(|tick| track.at(timetable.time_of_tick_s(*tick)).is_some())
                .for_each(|tick| in_flight.push(tool_id, Timetable::seq_of_tick(tick), timetable.due_ns(tick)));
            let message = match track.at(time_s) {
                Some(placement) => pose(tool_id, tick, &timetable, &placement),
                None if *down => {
                    in_flight.give_up(tool_id, clock::now_ns());
                    lift(tool_id)
                }
                None => continue,
            };
            *down = matches!(message, control_request::Message::Pose(_));
            match to.up.try_send(to.message(message)) {
                Ok(()) => totals.sent += u64::from(*down),
                Err(TrySendError::Full(_)) => totals.dropped += 1,
                Err(TrySendError::Closed(_)) => return SendTotals { kept: schedule.kept(), ..totals },
            }
        }
        next = tick + 1;
    }
    for (track, _) in script.tracks.iter().zip(down).filter(|(_, down)| *down) {
        in_flight.give_up(track.tool_id, clock::now_ns());
        // The last message may wait: nothing is paced any more. Closed: the stream lifts them.
        let _ = to.up.blocking_send(to.message(lift(track.tool_id)));
    }
    SendTotals { kept: schedule.kept(), ..totals }
}

/// A tick's pose of a tool, which says when its motion was due, not when it is sent.
fn pose(tool_id: u32, tick: u64, timetable: &Timetable, placement: &Placement) -> control_request::Message {
    control_request::Message::Pose(v1::ToolPose {
        tool_id,
        seq: Timetable::seq_of_tick(tick),
        client_ns: timetable.due_ns(tick),
        pose: Some(wire::pose_to_wire(&placement.pose)),
        buttons: 0,
        opening: Some(placement.opening as f32),
    })
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
        let timetable = Timetable { start_ns: clock::now_ns(), rate_hz: 1000.0, duration_s: 0.3 };
        let in_flight = Arc::new(InFlight::default());
        let shared = Arc::clone(&in_flight);
        let sender = std::thread::spawn(move || send(&script(0.0, 0.25), timetable, &up, &shared, &Arc::default()));
        let totals = sender.join().expect("the sender ends though nobody reads");
        assert_eq!(totals.sent, 2);
        assert!(totals.dropped > 5, "{totals:?}");
        // 0..=250 ms of the script: those that were dropped wait for an answer too, and so do those left out.
        let waited = in_flight.unanswered_ns().len();
        assert!((250..=251).contains(&waited), "{waited} poses");
        drop(received);
    }
}
