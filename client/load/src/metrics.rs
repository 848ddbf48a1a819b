//! What the driver counts while contacts come in.

use std::sync::Arc;

use anyhow::Context;
use hdrhistogram::Histogram;
use kerf_proto::v1;
use nalgebra::Vector3;
use serde::Serialize;

use crate::script::Script;
use crate::sender::{InFlight, Timetable};
use crate::wire;

/// Longest round trip that is told apart; longer ones count as this.
const MAX_ROUND_TRIP_NS: u64 = 60_000_000_000;
/// Three digits: quantiles are exact to 0.1 %, in a fixed 200 kB.
const ROUND_TRIP_DIGITS: u8 = 3;
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
    /// From the sending of the pose that the step used until now, s; absent when an earlier contact
    /// has told of the same pose.
    pub round_trip_s: Option<f64>,
}

/// Contacts, summed up.
pub struct ContactMetrics {
    /// Round trips, ns: from the sending of a pose to the first contact of a step that has used it, or a
    /// newer one.
    pub round_trip_ns: Histogram<u64>,
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
            round_trip_ns: Histogram::new_with_bounds(1, MAX_ROUND_TRIP_NS, ROUND_TRIP_DIGITS)
                .expect("the bounds are constants that the histogram takes"),
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
        in_flight.take_reflected(contact.tool_id, contact.echo_seq, |seq, sent_ns| {
            let elapsed_ns = now_ns.saturating_sub(sent_ns);
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
    let pose_time_s = timetable.time_of_seq_s(contact.echo_seq)?;
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
}
