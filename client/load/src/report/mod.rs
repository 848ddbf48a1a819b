//! The report on a run, as text and as JSON.

use std::fmt::{self, Write};

use hdrhistogram::Histogram;
use kerf_proto::v1;
use serde::Serialize;

mod exceeded;
mod sessions;

pub use sessions::{Refusal, Resting, Sessions};

use crate::metrics::ContactMetrics;
use crate::sender::SendTotals;
use crate::viewer::ViewTotals;

/// Fraction of late steps beyond which a report speaks of overload: a step late now and then is the machine's, not the
/// scene's.
pub const OVERLOAD_LATE_SHARE: f64 = 0.02;

/// The report on a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// Version of this program.
    pub version: &'static str,
    /// Version of the protocol.
    pub protocol_version: u32,
    /// Address of the server.
    pub server_address: String,
    /// Name of the scene.
    pub scene: String,
    /// The session.
    pub session_id: String,
    /// How many sessions there were. Where several were driven, durations and counts are those of all, forces, energy and
    /// surface those of the first.
    pub sessions: Sessions,
    /// What the tool did.
    pub script: String,
    /// How long poses were sent, s.
    pub duration_s: f64,
    /// Whether the run was broken off from the keyboard.
    pub interrupted: bool,
    /// From when a pose was due to the first contact of a step that has used it, or a newer one; absent without any.
    /// Poses that were left out count as if they had been sent, those that nothing answered with how long they had
    /// waited.
    pub round_trip_ms: Option<QuantilesMs>,
    /// How old the force in the hand was, asked every millisecond: from when the motion was due that it answers; absent
    /// without any.
    pub force_age_ms: Option<QuantilesMs>,
    /// What was sent.
    pub poses: Poses,
    /// What came back.
    pub contacts: Contacts,
    /// What the viewers got, all together.
    pub view: View,
    /// What the server said of itself.
    pub server: Server,
    /// What the server booked of energy; absent where it was not told.
    pub energy: Option<Energy>,
    /// What the tool felt.
    pub force: Force,
    /// Limits that were exceeded, in words.
    pub limits_exceeded: Vec<String>,
}

/// Quantiles of a duration, ms.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct QuantilesMs {
    /// Durations that were measured.
    pub count: u64,
    /// Median.
    pub p50: f64,
    /// 99th percentile.
    pub p99: f64,
    /// 99.9th percentile.
    pub p999: f64,
    /// Greatest.
    pub max: f64,
}

/// What was sent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Poses {
    /// Poses handed to the transport.
    pub sent: u64,
    /// Poses a second, Hz.
    pub rate_hz: f64,
    /// Ticks more than half a period late.
    pub late: u64,
    /// Ticks left out because the next one was due.
    pub skipped: u64,
    /// Poses that found the transport's queue full.
    pub dropped: u64,
    /// Late and skipped ticks over all ticks that were due.
    pub late_share: f64,
    /// Poses that the server refused.
    pub rejected: u64,
    /// Poses that no contact answered before the tool was lifted.
    pub unanswered: u64,
    /// Leases that ran out, or were taken away.
    pub leases_lost: u64,
}

/// What came back.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Contacts {
    /// Contacts that came in.
    pub received: u64,
    /// Contacts a second, Hz.
    pub rate_hz: f64,
    /// Bytes a second on the control stream.
    pub bytes_per_s: f64,
    /// The first refusal of a pose.
    pub first_rejection: Option<String>,
}

/// What the viewers got, all together.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct View {
    /// Viewers.
    pub viewers: u32,
    /// Keyframes applied.
    pub keyframes: u64,
    /// Patches applied.
    pub patches: u64,
    /// States applied.
    pub states: u64,
    /// States a second and viewer, Hz.
    pub state_rate_hz: f64,
    /// Messages that did not fit a replica.
    pub mismatches: u64,
    /// The first of them.
    pub first_mismatch: Option<String>,
    /// Bytes a second and viewer.
    pub bytes_per_s: f64,
    /// Version of the structure in the end.
    pub topology_version: u64,
}

/// What the server said of itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Server {
    /// Steps per simulated second that the session was to take, Hz.
    pub step_rate_hz: f64,
    /// Steps while it was watched.
    #[serde(flatten)]
    pub steps: Steps,
    /// Simulated time over wall time; below 1 the session fell behind, and tools moved faster there than in the hand.
    /// Absent before two steps were told of.
    pub pace: Option<f64>,
    /// How long after its deadline a step ended, 0 in time, of the steps that contacts told of; absent without any.
    pub lag_ms: Option<QuantilesMs>,
    /// Faults that were rolled back.
    pub faults: u64,
    /// Times that the governor changed the relative tolerance of the solves.
    pub governor_changes: u64,
    /// What it changed it to last.
    pub governed_tolerance: Option<f64>,
}

/// Steps of sessions while they were watched.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Steps {
    /// Steps.
    pub steps: u64,
    /// Of these, steps that ended after their deadline.
    pub late_steps: u64,
    /// Their share.
    pub late_step_share: f64,
    /// Mean duration of a step, ms.
    pub step_mean_ms: f64,
    /// Longest step, ms.
    pub step_max_ms: f64,
}

/// What the server booked of energy since the session began, J.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Energy {
    /// Work done by tools on the tissue, J.
    pub tool_work_j: f64,
    /// What was spent on parting tissue, J.
    pub fracture_j: f64,
    /// What the ledger leaves unexplained, J.
    pub residual_j: f64,
    /// That over the tools' work; absent where they did none.
    pub residual_over_tool_work: Option<f64>,
}

/// What the tool felt.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Force {
    /// Greatest force, N.
    pub max_n: f64,
    /// Greatest force against the cutting direction, N.
    pub max_resistance_n: f64,
    /// Fracture energy times the width of the blade: what a steady cut takes, N.
    pub reference_n: Option<f64>,
    /// Greatest depth, m.
    pub max_depth_m: f64,
}

/// What a report is made from.
pub struct Run<'a> {
    /// Address of the server.
    pub server_address: &'a str,
    /// Name of the scene.
    pub scene: &'a str,
    /// The session.
    pub session_id: &'a str,
    /// How many there were.
    pub sessions: Sessions,
    /// Steps per simulated second, Hz.
    pub step_rate_hz: f64,
    /// What the tool did.
    pub script: String,
    /// How long poses were sent, s.
    pub duration_s: f64,
    /// How long the viewers watched, s.
    pub watched_s: f64,
    /// Whether the run was broken off.
    pub interrupted: bool,
    /// Viewers.
    pub viewers: u32,
    /// Force of a steady cut, N.
    pub reference_n: Option<f64>,
    /// What became of the poses.
    pub sent: SendTotals,
    /// What came back.
    pub contacts: &'a ContactMetrics,
    /// What the viewers got.
    pub view: &'a ViewTotals,
}

impl Report {
    /// What a run means to somebody who holds the tool; `None` where no force came back.
    fn in_words(&self) -> Option<String> {
        let (ages, Server { step_rate_hz, steps: Steps { late_step_share, .. }, .. }) =
            (self.force_age_ms?, &self.server);
        Some(format!(
            "{step_rate_hz} steps a second, {:.1} % of them late. The force in the hand was {:.1} ms old half of the \
             time, and older than {:.1} ms a thousandth of it.",
            100.0 * late_step_share,
            ages.p50,
            ages.p999
        ))
    }

    /// Sums up a run; limits are not checked yet.
    #[must_use]
    pub fn of(run: &Run<'_>) -> Self {
        Self {
            version: env!("CARGO_PKG_VERSION"),
            protocol_version: kerf_proto::PROTOCOL_VERSION,
            server_address: run.server_address.to_owned(),
            scene: run.scene.to_owned(),
            session_id: run.session_id.to_owned(),
            sessions: run.sessions.clone(),
            script: run.script.clone(),
            duration_s: run.duration_s,
            interrupted: run.interrupted,
            round_trip_ms: QuantilesMs::of(&run.contacts.round_trips_ns()),
            force_age_ms: QuantilesMs::of(run.contacts.force_age.ns()),
            poses: Poses::of(run),
            contacts: Contacts {
                received: run.contacts.received,
                rate_hz: per(run.contacts.received, run.duration_s),
                bytes_per_s: per(run.contacts.bytes, run.duration_s),
                first_rejection: run.contacts.first_rejection.clone(),
            },
            view: View::of(run),
            server: Server::of(run),
            energy: run.view.energy.as_ref().map(Energy::of),
            force: Force::of(run),
            limits_exceeded: Vec::new(),
        }
    }
}

impl fmt::Display for QuantilesMs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { p50, p99, p999, max, .. } = self;
        write!(f, "p50 {p50:.2} ms, p99 {p99:.2} ms, p99.9 {p999:.2} ms, max {max:.2} ms")
    }
}

impl QuantilesMs {
    fn of(histogram_ns: &Histogram<u64>) -> Option<Self> {
        let ms = |quantile: f64| histogram_ns.value_at_quantile(quantile) as f64 * 1e-6;
        (!histogram_ns.is_empty()).then(|| Self {
            count: histogram_ns.len(),
            p50: ms(0.5),
            p99: ms(0.99),
            p999: ms(0.999),
            max: histogram_ns.max() as f64 * 1e-6,
        })
    }
}

impl Poses {
    fn of(run: &Run<'_>) -> Self {
        let SendTotals { sent, dropped, kept } = run.sent;
        Self {
            sent,
            rate_hz: per(sent, run.duration_s),
            late: kept.late,
            skipped: kept.skipped,
            dropped,
            late_share: per(kept.late + kept.skipped, (kept.ticks + kept.skipped) as f64),
            rejected: run.contacts.rejected,
            unanswered: run.contacts.in_flight.unanswered_ns().len(),
            leases_lost: run.contacts.leases_lost,
        }
    }
}

impl View {
    fn of(run: &Run<'_>) -> Self {
        Self {
            viewers: run.viewers,
            keyframes: run.view.keyframes,
            patches: run.view.patches,
            states: run.view.states,
            state_rate_hz: per(run.view.states, run.watched_s * f64::from(run.viewers)),
            mismatches: run.view.mismatches,
            first_mismatch: run.view.first_mismatch.clone(),
            bytes_per_s: per(run.view.bytes, run.watched_s * f64::from(run.viewers)),
            topology_version: run.view.server.map_or(0, |server| server.topology_version),
        }
    }
}

impl Server {
    fn of(run: &Run<'_>) -> Self {
        Self {
            step_rate_hz: run.step_rate_hz,
            steps: Steps::of(run.view),
            pace: run.contacts.timing.pace(),
            lag_ms: QuantilesMs::of(&run.contacts.timing.lag_ns),
            faults: run.contacts.faults,
            governor_changes: run.contacts.governor_changes,
            governed_tolerance: run.contacts.governed_tolerance,
        }
    }
}

impl Steps {
    fn of(view: &ViewTotals) -> Self {
        let steps = view.server.unwrap_or_default();
        Self {
            steps: steps.steps(),
            late_steps: steps.late_steps(),
            late_step_share: per(steps.late_steps(), steps.steps() as f64),
            step_mean_ms: 1e3
                * if steps.profiled_steps == 0 { 0.0 } else { steps.profiled_s / steps.profiled_steps as f64 },
            step_max_ms: 1e3 * steps.step_max_s,
        }
    }
}

impl Energy {
    fn of(ledger: &v1::EnergyLedger) -> Self {
        let v1::EnergyLedger { tool_work_j, fracture_j, residual_j, .. } = *ledger;
        let residual_over_tool_work = (tool_work_j != 0.0).then(|| residual_j / tool_work_j);
        Self { tool_work_j, fracture_j, residual_j, residual_over_tool_work }
    }
}

impl Force {
    fn of(run: &Run<'_>) -> Self {
        let samples = &run.contacts.samples;
        Self {
            max_n: run.contacts.max_force_n,
            max_resistance_n: samples.iter().fold(0.0, |max, sample| f64::max(max, sample.resistance_n)),
            reference_n: run.reference_n,
            max_depth_m: samples.iter().fold(0.0, |max, sample| f64::max(max, sample.depth_m)),
        }
    }
}

fn per(count: u64, of: f64) -> f64 {
    if of > 0.0 { count as f64 / of } else { 0.0 }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { poses, contacts, view, server, force, .. } = self;
        let ended = if self.interrupted { ", interrupted" } else { "" };
        writeln!(f, "{} on {}, {:.1} s{ended}", self.script, self.scene, self.duration_s)?;
        write!(f, "{}", self.sessions)?;
        match self.round_trip_ms {
            Some(times) => {
                writeln!(f, "round trip   {times} ({} poses, {} unanswered)", times.count, poses.unanswered)?;
            }
            None => writeln!(f, "round trip   no pose came back")?,
        }
        if let Some(ages) = &self.force_age_ms {
            writeln!(f, "force age    {ages}")?;
        }
        writeln!(
            f,
            "poses        {} sent, {:.1} Hz; {} late, {} skipped, {} dropped, {} rejected",
            poses.sent, poses.rate_hz, poses.late, poses.skipped, poses.dropped, poses.rejected
        )?;
        if let Some(rejection) = &contacts.first_rejection {
            writeln!(f, "             first rejection: {rejection}")?;
        }
        writeln!(
            f,
            "contacts     {} received, {:.1} Hz, {}/s",
            contacts.received,
            contacts.rate_hz,
            bytes(contacts.bytes_per_s)
        )?;
        writeln!(
            f,
            "view         {} viewer(s): {} keyframes, {} patches, {} states at {:.1} Hz, {}/s each; {} mismatches",
            view.viewers,
            view.keyframes,
            view.patches,
            view.states,
            view.state_rate_hz,
            bytes(view.bytes_per_s),
            view.mismatches
        )?;
        if let Some(mismatch) = &view.first_mismatch {
            writeln!(f, "             first mismatch: {mismatch}")?;
        }
        writeln!(
            f,
            "server       {} steps at {} Hz, {} late ({:.1} %), mean {:.2} ms, max {:.2} ms; topology version {}, {} faults",
            server.steps.steps,
            server.step_rate_hz,
            server.steps.late_steps,
            100.0 * server.steps.late_step_share,
            server.steps.step_mean_ms,
            server.steps.step_max_ms,
            view.topology_version,
            server.faults
        )?;
        if let Some((pace, lags)) = server.pace.zip(server.lag_ms) {
            writeln!(f, "pace         {pace:.3} of real time; steps ended {lags} after they were due")?;
        }
        if server.steps.late_step_share > OVERLOAD_LATE_SHARE {
            writeln!(
                f,
                "OVERLOAD     {:.1} % of the steps were late: forces and depths are not those of the script's speed. Ask \
                 for a lower step rate, a coarser level or a smaller scene.",
                100.0 * server.steps.late_step_share
            )?;
        }
        if let Some(last) = server.governed_tolerance {
            writeln!(f, "governor     {} changes of the tolerance, the last to {last:.1e}", server.governor_changes)?;
        }
        if let Some(energy) = &self.energy {
            let Energy { tool_work_j, fracture_j, residual_j, residual_over_tool_work } = energy;
            write!(
                f,
                "energy       tool work {tool_work_j:.3e} J, fracture {fracture_j:.3e} J, residual {residual_j:.1e} J"
            )?;
            let share =
                residual_over_tool_work.map_or(String::new(), |ratio| format!(" ({ratio:.1e} of the tool work)"));
            writeln!(f, "{share}")?;
        }
        write!(f, "force        max {:.3} N, against the cut {:.3} N", force.max_n, force.max_resistance_n)?;
        if let Some(reference_n) = force.reference_n {
            write!(f, " (steady cut: {reference_n:.3} N)")?;
        }
        write!(f, ", {:.1} mm deep", 1e3 * force.max_depth_m)?;
        if let Some(words) = self.in_words() {
            write!(f, "\n\n{words}")?;
        }
        self.limits_exceeded.iter().try_for_each(|exceeded| write!(f, "\nEXCEEDED     {exceeded}"))
    }
}

/// A number of bytes with a unit that suits it.
#[must_use]
pub fn bytes(count: f64) -> String {
    let (mut scaled, mut unit) = (count, "B");
    for larger in ["kB", "MB", "GB"] {
        if scaled >= 1000.0 {
            (scaled, unit) = (scaled / 1000.0, larger);
        }
    }
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = write!(text, "{scaled:.*} {unit}", usize::from(unit != "B"));
    text
}
