//! The thread that sends: paced by absolute deadlines, never waiting on the network.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use kerf_load::clock;
use kerf_load::pacer::Schedule;
use kerf_proto::v1::{self, control_request::Message};

use super::deadband::Deadband;
use super::status::SharedStatus;
use super::{LinkSettings, Uplink, wire};
use crate::servo::runner::Motion;

/// An acknowledgement waits this long for a pose that takes it along, ns.
const ACKNOWLEDGE_NS: u64 = 10_000_000;
/// A motion older than this is that of a servo that has stopped, ns; nothing is sent and the lease runs out.
const STOPPED_NS: u64 = 500_000_000;
/// Lifts of tools that are not in hand go out this many times a lease.
const LIFTS_PER_LEASE: f64 = 4.0;

/// The stream that is open now, if one is.
#[derive(Clone, Debug, Default)]
pub(super) struct SharedUplink(Arc<Mutex<Option<Uplink>>>);

impl SharedUplink {
    pub(super) fn set(&self, uplink: Option<Uplink>) {
        *self.lock() = uplink;
    }

    fn get(&self) -> Option<Uplink> {
        self.lock().clone()
    }

    fn lock(&self) -> MutexGuard<'_, Option<Uplink>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Sends motions.
pub(super) struct Sender {
    motions: triple_buffer::Output<Motion>,
    uplink: SharedUplink,
    status: SharedStatus,
    stop: Arc<AtomicBool>,
    tool_ids: Arc<[u32]>,
    rate_hz: f64,
    deadband: Deadband,
    epoch: u64,
    seq: u64,
    /// Newest acknowledgement that went out, and since when there is a newer one.
    acknowledged: u64,
    unacknowledged_since_ns: Option<u64>,
    lift_due_ns: u64,
}

impl Sender {
    pub(super) fn new(
        settings: &LinkSettings,
        motions: triple_buffer::Output<Motion>,
        uplink: SharedUplink,
        status: SharedStatus,
        stop: Arc<AtomicBool>,
    ) -> Self {
        let link = &settings.link;
        Self {
            motions,
            uplink,
            status,
            stop,
            tool_ids: Arc::clone(&settings.tool_ids),
            rate_hz: link.pose_rate_hz,
            deadband: Deadband::new(link.deadband, link.keep_alive_s, settings.force_scale),
            epoch: 0,
            seq: 0,
            acknowledged: 0,
            unacknowledged_since_ns: None,
            lift_due_ns: 0,
        }
    }

    /// Sends until it is told to stop.
    pub(super) fn run(&mut self) {
        let mut schedule = Schedule::new(clock::now_ns(), self.rate_hz);
        while !self.stop.load(Ordering::Relaxed) {
            clock::sleep_until_ns(schedule.deadline_ns());
            schedule.take(clock::now_ns());
            self.tick_if_open();
        }
    }

    /// The same as a task.
    #[cfg(feature = "virtual-time")]
    pub(super) async fn run_as_task(&mut self) {
        let mut ticks = tokio::time::interval(std::time::Duration::from_secs_f64(1.0 / self.rate_hz));
        loop {
            ticks.tick().await;
            self.tick_if_open();
        }
    }

    fn tick_if_open(&mut self) {
        if let Some(uplink) = self.uplink.get() {
            self.tick(&uplink, clock::now_ns());
        }
    }

    fn tick(&mut self, uplink: &Uplink, now_ns: u64) {
        if uplink.epoch != self.epoch {
            self.epoch = uplink.epoch;
            self.deadband.forget();
            (self.acknowledged, self.unacknowledged_since_ns, self.lift_due_ns) = (0, None, 0);
        }
        let motion = *self.motions.read();
        let received = uplink.received.load(Ordering::Relaxed);
        if motion.sampled_ns > 0 && now_ns.saturating_sub(motion.sampled_ns) < STOPPED_NS {
            self.status.change(|status| status.poses_due += 1);
            if self.deadband.passes(&motion) {
                let message = self.message(uplink, &motion);
                self.send(uplink, Some(message), received);
            }
            self.lift_others(uplink, motion.tool, now_ns, received);
        }
        if received > self.acknowledged {
            let since_ns = *self.unacknowledged_since_ns.get_or_insert(now_ns);
            if now_ns - since_ns >= ACKNOWLEDGE_NS {
                self.send(uplink, None, received);
            }
        }
    }

    /// Leases of the tools that wait for their turn are kept by lifting them again and again.
    fn lift_others(&mut self, uplink: &Uplink, in_hand: usize, now_ns: u64, received: u64) {
        if self.tool_ids.len() == 1 || now_ns < self.lift_due_ns {
            return;
        }
        self.lift_due_ns = now_ns + (uplink.lease_s / LIFTS_PER_LEASE * 1e9) as u64;
        let tool_ids = Arc::clone(&self.tool_ids);
        for (index, &tool_id) in tool_ids.iter().enumerate() {
            if index != in_hand {
                self.send(uplink, Some(Message::Lift(v1::LiftTool { tool_id })), received);
            }
        }
    }

    fn message(&mut self, uplink: &Uplink, motion: &Motion) -> Message {
        let tool_id = self.tool_ids[motion.tool];
        match motion.placement {
            Some(placement) => {
                self.seq += 1;
                Message::Pose(v1::ToolPose {
                    tool_id,
                    seq: self.seq,
                    client_ns: motion.sampled_ns,
                    pose: Some(wire::pose_to_wire(&placement.pose, uplink.workspace)),
                    buttons: 0,
                    opening: Some(placement.opening as f32),
                })
            }
            None => Message::Lift(v1::LiftTool { tool_id }),
        }
    }

    fn send(&mut self, uplink: &Uplink, message: Option<Message>, received: u64) {
        let is_pose = matches!(message, Some(Message::Pose(_)));
        // Full: the network does not keep up, and the next pose is newer.
        if uplink.up.try_send(v1::ControlRequest { message, received }).is_ok() {
            (self.acknowledged, self.unacknowledged_since_ns) = (received, None);
            self.status.change(|status| {
                status.messages += 1;
                status.poses += u64::from(is_pose);
            });
        } else if is_pose {
            self.deadband.forget();
        }
    }
}
