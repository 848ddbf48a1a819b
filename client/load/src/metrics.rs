//! What the driver counts while contacts come in.

use std::sync::Arc;

use anyhow::Context;
use hdrhistogram::Histogram;
use kerf_proto::v1;
use nalgebra::Vector3;
use serde::Serialize;

use crate::durations::durations_ns;
use crate::force_age::ForceAge;
use crate::in_flight::InFlight;
use crate::script::Script;
use crate::timetable::Timetable;
use crate::wire;

/// Most samples that are kept, about 400 MB: an hour at 1 kHz. Later ones are counted, not kept.
const MAX_SAMPLES: usize = 3_600_000;

/// One contact: a line of `force.csv`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ContactSample {
    /// Script time when the contact came in, s.
    pub time_s: f64,
    /// Simulated time, s.
    pub sim_time_s: f64,
    /// Step of the server.
    pub step: u64,
    /// The tool.
    pub tool: u32,
    /// Position of the tool in that step, m, scene frame.
    pub x_m: f64,
    /// Position of the tool in that step, m, scene frame.
    pub y_m: f64,
    /// Position of the tool in that step, m, scene frame.
    pub z_m: f64,
    /// How far it is below the undeformed surface, m.
    pub depth_m: f64,
    /// Force on the tool, N, scene frame.
    pub fx_n: f64,
    /// Force on the tool, N, scene frame.
    pub fy_n: f64,
    /// Force on the tool, N, scene frame.
    pub fz_n: f64,
    /// Torque on the tool about its reference point, N m, scene frame.
    pub tx_nm: f64,
    /// Torque on the tool about its reference point, N m, scene frame.
    pub ty_nm: f64,
    /// Torque on the tool about its reference point, N m, scene frame.
    pub tz_nm: f64,
    /// Force against the cutting direction, N.
    pub resistance_n: f64,
    /// Length of the edge whose front is yielding, m.
    pub cutting_length_m: f64,
    /// From when the pose that the step used was due until now, s; absent when an earlier contact has told of the same
    /// pose.
    pub round_trip_s: Option<f64>,
}

/// How the steps that contacts told of kept time, by the server's clock.
pub struct StepTiming {
    /// How long after their deadlines the steps ended, ns; 0 in time.
    pub lag_ns: Histogram<u64>,
    /// Step, end of it in simulated time, s, and on the server's clock, ns, of the newest contact.
    last: Option<(u64, f64, u64)>,
    /// Simulated time from the first contact to the newest, s, and time on the server's clock, ns. A session that goes
    /// back in time goes on from there.
    passed: (f64, u64),
}

impl Default for StepTiming {
    fn default() -> Self {
        Self { lag_ns: durations_ns(), last: None, passed: (0.0, 0) }
    }
}

impl StepTiming {
    /// Simulated time over time on the server's clock; `None` before two steps were told of.
    #[must_use]
    pub fn pace(&self) -> Option<f64> {
        let (simulated_s, wall_ns) = self.passed;
        (wall_ns > 0).then(|| simulated_s / (wall_ns as f64 * 1e-9))
    }

    /// Adds the steps of another session.
    fn add(&mut self, other: &Self) {
        self.lag_ns += &other.lag_ns;
        self.passed.0 += other.passed.0;
        self.passed.1 += other.passed.1;
    }

    /// Each step counts once, however many tools it is told for.
    pub fn contact(&mut self, contact: &v1::Contact) {
        let now = (contact.step, contact.sim_time_s, contact.server_ns);
        let before = self.last.replace(now);
        if before.is_some_and(|(step, ..)| step == contact.step) {
            return;
        }
        self.lag_ns.saturating_record(contact.lag_ns);
        if let Some((_, sim_time_s, server_ns)) = before.filter(|(step, ..)| *step < contact.step) {
            self.passed.0 += contact.sim_time_s - sim_time_s;
            self.passed.1 += contact.server_ns.saturating_sub(server_ns);
        }
    }
}

/// Contacts, summed up.
pub struct ContactMetrics {
    /// Round trips, ns: from when a pose was due to the first contact of a step that has used it, or a newer one.
    pub round_trip_ns: Histogram<u64>,
    /// How old the force in the hand was.
    pub force_age: ForceAge,
    /// How the steps that contacts told of kept time.
    pub timing: StepTiming,
    /// Contacts that came in.
    pub received: u64,
    /// Bytes that came in, framing included.
    pub bytes: u64,
    /// Poses that the server refused.
    pub rejected: u64,
    /// The first refusal, for people.
    pub first_rejection: Option<String>,
    /// Faults that the server rolled back.
    pub faults: u64,
    /// Times that the server's governor changed the relative tolerance of the solves.
    pub governor_changes: u64,
    /// What it changed it to last.
    pub governed_tolerance: Option<f64>,
    /// Leases that ran out, or were taken away.
    pub leases_lost: u64,
    /// Greatest force, N.
    pub max_force_n: f64,
    /// The contacts whose pose is known, oldest first.
    pub samples: Vec<ContactSample>,
    /// The poses that wait for a contact.
    pub in_flight: Arc<InFlight>,
}

impl Default for ContactMetrics {
    fn default() -> Self {
        Self {
            round_trip_ns: durations_ns(),
            force_age: ForceAge::default(),
            timing: StepTiming::default(),
            received: 0,
            bytes: 0,
            rejected: 0,
            first_rejection: None,
            faults: 0,
            governor_changes: 0,
            governed_tolerance: None,
            leases_lost: 0,
            max_force_n: 0.0,
            samples: Vec::new(),
            in_flight: Arc::default(),
        }
    }
}

impl ContactMetrics {
    /// Counts a contact that came in at `now_ns`.
    ///
    /// # Errors
    /// A field of the contact is missing or not finite.
    pub fn contact(
        &mut self,
        contact: &v1::Contact,
        now_ns: u64,
        script: &Script,
        timetable: &Timetable,
    ) -> anyhow::Result<()> {
        let wrench = contact.wrench.context("contact.wrench is missing")?;
        let force_n = wire::vector(wrench.force_n, "contact.wrench.force_n")?;
        let torque_nm = wire::vector(wrench.torque_nm, "contact.wrench.torque_nm")?;
        let round_trip_ns = self.round_trips(contact, now_ns);
        self.force_age.contact(contact, now_ns, script, timetable);
        self.timing.contact(contact);
        self.received += 1;
        self.max_force_n = f64::max(self.max_force_n, force_n.norm());
        let sample = sample(contact, force_n, torque_nm, script, timetable);
        if let Some(mut sample) = sample.filter(|_| self.samples.len() < MAX_SAMPLES) {
            sample.time_s = (now_ns as f64 - timetable.start_ns as f64) * 1e-9;
            sample.round_trip_s = round_trip_ns.map(|ns| ns as f64 * 1e-9);
            self.samples.push(sample);
        }
        Ok(())
    }

    /// Counts a pose that the server refused.
    pub fn rejection(&mut self, rejected: &v1::PoseRejected) {
        self.rejected += 1;
        self.in_flight.forget(rejected.tool_id, rejected.seq);
        self.first_rejection.get_or_insert_with(|| {
            let v1::PoseRejected { tool_id, seq, field, limit } = rejected;
            format!("pose {seq} of tool {tool_id}: {field}: {limit}")
        });
    }

    /// Adds what another session's driver counted; samples stay those of this one.
    pub fn add(&mut self, other: &Self) {
        self.round_trip_ns += &other.round_trip_ns;
        self.in_flight.add_unanswered(&other.in_flight.unanswered_ns());
        self.force_age.add(&other.force_age);
        self.timing.add(&other.timing);
        self.received += other.received;
        self.bytes += other.bytes;
        self.rejected += other.rejected;
        self.first_rejection = self.first_rejection.take().or_else(|| other.first_rejection.clone());
        self.faults += other.faults;
        self.governor_changes += other.governor_changes;
        self.governed_tolerance = self.governed_tolerance.or(other.governed_tolerance);
        self.leases_lost += other.leases_lost;
        self.max_force_n = f64::max(self.max_force_n, other.max_force_n);
    }

    /// Round trips of the poses that were answered, and how long those had waited that were not, ns.
    #[must_use]
    pub fn round_trips_ns(&self) -> Histogram<u64> {
        let mut all = self.round_trip_ns.clone();
        all += self.in_flight.unanswered_ns();
        all
    }

    /// The contact that came in last.
    #[must_use]
    pub fn last(&self) -> Option<&ContactSample> {
        self.samples.last()
    }

    /// Counts the round trip of every pose that this contact is the first to reflect; returns that of
    /// the pose it echoes, ns, if that is one of them.
    fn round_trips(&mut self, contact: &v1::Contact, now_ns: u64) -> Option<u64> {
        let Self { in_flight, round_trip_ns, .. } = self;
        let mut echoed_ns = None;
        in_flight.take_reflected(contact.tool_id, contact.echo_seq, |seq, due_ns| {
            let elapsed_ns = now_ns.saturating_sub(due_ns);
            round_trip_ns.saturating_record(elapsed_ns);
            if seq == contact.echo_seq {
                echoed_ns = Some(elapsed_ns);
            }
        });
        echoed_ns
    }
}

/// What a contact says of the tool; its times are filled in by whoever has a clock. `None` where
/// the step has used no pose of the script.
fn sample(
    contact: &v1::Contact,
    force_n: Vector3<f64>,
    torque_nm: Vector3<f64>,
    script: &Script,
    timetable: &Timetable,
) -> Option<ContactSample> {
    let pose_time_s = timetable.time_of_tick_s(Timetable::tick_of_seq(contact.echo_seq)?);
    let pose = script.track(contact.tool_id)?.at(pose_time_s)?.pose;
    Some(ContactSample {
        time_s: 0.0,
        sim_time_s: contact.sim_time_s,
        step: contact.step,
        tool: contact.tool_id,
        x_m: pose.position_m.x,
        y_m: pose.position_m.y,
        z_m: pose.position_m.z,
        depth_m: script.depth_m(pose_time_s, &pose),
        fx_n: force_n.x,
        fy_n: force_n.y,
        fz_n: force_n.z,
        tx_nm: torque_nm.x,
        ty_nm: torque_nm.y,
        tz_nm: torque_nm.z,
        // The cutting direction is the tool's -y.
        resistance_n: force_n.dot(&(pose.orientation * Vector3::y())),
        cutting_length_m: f64::from(contact.cutting_length_m),
        round_trip_s: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_contact_ends_the_round_trip_of_every_pose_it_is_the_first_to_reflect() {
        let script = Script { tracks: Vec::new(), datums: Vec::new() };
        let timetable = Timetable { start_ns: 0, rate_hz: 250.0, duration_s: 1.0 };
        let mut metrics = ContactMetrics::default();
        (1..=4).for_each(|seq| metrics.in_flight.push(0, seq, 1000 * seq));
        metrics.rejection(&v1::PoseRejected { tool_id: 0, seq: 2, ..Default::default() });
        let wrench = v1::Wrench { force_n: Some(v1::Vec3::default()), torque_nm: Some(v1::Vec3::default()) };
        let contact = v1::Contact { echo_seq: 3, wrench: Some(wrench), ..Default::default() };
        for now_ns in [5000, 9000] {
            metrics.contact(&contact, now_ns, &script, &timetable).expect("valid");
        }
        let round_trips_ns: Vec<u64> = metrics.round_trip_ns.iter_recorded().map(|v| v.value_iterated_to()).collect();
        assert_eq!(metrics.round_trip_ns.len(), 2, "{round_trips_ns:?}");
        assert!(round_trips_ns[0].abs_diff(2000) < 10 && round_trips_ns[1].abs_diff(4000) < 10, "{round_trips_ns:?}");
    }

    #[test]
    fn pace_is_simulated_time_over_the_servers_and_a_step_back_is_no_time() {
        let mut timing = StepTiming::default();
        let told = |step: u64, server_ms: u64, lag_ns: u64| v1::Contact {
            step,
            sim_time_s: step as f64 * 1e-3,
            server_ns: server_ms * 1_000_000,
            lag_ns,
            ..Default::default()
        };
        assert_eq!(timing.pace(), None);
        // Two tools are told of step 2, which says nothing new.
        for (step, server_ms, lag_ns) in [(1, 10, 0), (2, 12, 500), (2, 12, 500), (5, 18, 2000)] {
            timing.contact(&told(step, server_ms, lag_ns));
        }
        assert!((timing.pace().expect("steps") - 0.5).abs() < 1e-9);
        // A reset: the session begins anew.
        [told(1, 100, 0), told(3, 102, 0)].iter().for_each(|contact| timing.contact(contact));
        assert!((timing.pace().expect("steps") - 0.6).abs() < 1e-9);
        assert_eq!((timing.lag_ns.len(), timing.lag_ns.max()), (5, 2000));
    }
}
