//! What people are told while a station runs.

use hdrhistogram::Histogram;
use serde::{Deserialize, Serialize};

use crate::link::LinkStatus;
use crate::servo::core::{Hold, State};
use crate::servo::runner::Sample;
use crate::station::{Station, ThreadStatus};

/// Longest time that is told apart, us.
const MOST_US: u64 = 10_000_000;

/// What came of the ticks since the last report.
pub struct Monitor {
    dt_us: Histogram<u64>,
    spent_us: Histogram<u64>,
    motion_age_us: Histogram<u64>,
    max_force_n: f64,
    last: Option<Sample>,
    since_ns: u64,
    before: LinkStatus,
    /// Faults of the servo before.
    faults_before: u64,
    /// Where the session is to be seen.
    pub page: String,
}

/// A line of what a station does.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// The device's name.
    pub device: String,
    /// Servo's calls a second, Hz.
    pub servo_hz: f64,
    /// Time between two calls, ms: median and 99th percentile.
    pub dt_ms: [f64; 2],
    /// Time that a call takes, us: median and 99th percentile.
    pub spent_us: [f64; 2],
    /// Poses, and messages in all, sent a second.
    pub poses_hz: f64,
    /// Messages sent a second.
    pub messages_hz: f64,
    /// Contacts a second.
    pub contacts_hz: f64,
    /// Smoothed round trip, ms.
    pub round_trip_ms: Option<f64>,
    /// Time that a contact takes from the server to here, ms.
    pub down_ms: Option<f64>,
    /// Age of the motion that the rendered contact reflects, ms: median and 99th percentile.
    pub motion_age_ms: [f64; 2],
    /// Where the tool is to be, m, scene frame; absent while it is out of the scene.
    pub position_m: Option<[f64; 3]>,
    /// Force on the hand now, N.
    pub force_n: f64,
    /// Greatest since the last line, N.
    pub max_force_n: f64,
    /// Stiffness of the coupling in the scene, N/m.
    pub coupling_n_per_m: f64,
    /// Energy that was given out and never taken in, mJ in the scene's scale.
    pub generated_mj: f64,
    /// What the servo is doing, and what there is to do where it has nothing to render.
    pub state: String,
    /// What the link is doing.
    pub link: String,
    /// Priority of the servo's thread.
    pub priority: String,
    /// Faults of the servo so far.
    pub faults: u64,
    /// What is wrong, or went wrong in the last seconds.
    pub last_fault: Option<String>,
    /// Where the session is to be seen.
    #[serde(default)]
    pub page: String,
}

impl Default for Monitor {
    fn default() -> Self {
        let histogram = || Histogram::new_with_bounds(1, MOST_US, 3).expect("the bounds are constants it takes");
        Self {
            dt_us: histogram(),
            spent_us: histogram(),
            motion_age_us: histogram(),
            max_force_n: 0.0,
            last: None,
            since_ns: 0,
            before: LinkStatus::default(),
            faults_before: 0,
            page: String::new(),
        }
    }
}

impl Monitor {
    /// Takes a tick.
    pub fn take(&mut self, sample: Sample) {
        if self.since_ns == 0 {
            self.since_ns = sample.at_ns;
        }
        self.dt_us.saturating_record((sample.dt_s * 1e6) as u64);
        self.spent_us.saturating_record(sample.spent_ns / 1000);
        if let Some(age_s) = sample.motion_age_s {
            self.motion_age_us.saturating_record((age_s * 1e6) as u64);
        }
        self.max_force_n = self.max_force_n.max(sample.force_n.norm());
        self.last = Some(sample);
    }

    /// Sums up what has been taken since the last time, and begins anew.
    pub fn report(&mut self, station: &Station) -> Option<Report> {
        let (link, thread) = (station.link(), station.thread());
        let report = self.sum_up(station, &link, &thread);
        let since_ns = self.last.map_or(0, |last| last.at_ns);
        let faults_before = self.last.map_or(0, |last| last.rendered.faults.1);
        let page = std::mem::take(&mut self.page);
        *self = Self { last: self.last, since_ns, before: link, faults_before, page, ..Self::default() };
        report
    }

    /// A report with what is so now in place of what it said: force, state and faults.
    pub fn refresh(&self, report: &mut Report, station: &Station) {
        if let Some(now) = self.sum_up(station, &station.link(), &station.thread()) {
            report.max_force_n = report.max_force_n.max(now.max_force_n);
            let Report { position_m, force_n, state, link, faults, last_fault, .. } = now;
            *report = Report { position_m, force_n, state, link, faults, last_fault, ..report.clone() };
        }
    }

    fn sum_up(&self, station: &Station, link: &LinkStatus, thread: &ThreadStatus) -> Option<Report> {
        let last = self.last?;
        let elapsed_s = (last.at_ns.saturating_sub(self.since_ns) as f64 * 1e-9).max(1e-3);
        let rate = |now: u64, before: u64| now.saturating_sub(before) as f64 / elapsed_s;
        let quantiles =
            |of: &Histogram<u64>, unit: f64| [0.5, 0.99].map(|quantile| of.value_at_quantile(quantile) as f64 * unit);
        let (fault, faults) = last.rendered.faults;
        let last_fault = thread.device_fault.clone().or_else(|| link.last_fault.clone());
        Some(Report {
            device: station.name.clone(),
            servo_hz: self.dt_us.len() as f64 / elapsed_s,
            dt_ms: quantiles(&self.dt_us, 1e-3),
            spent_us: quantiles(&self.spent_us, 1.0),
            poses_hz: rate(link.poses, self.before.poses),
            messages_hz: rate(link.messages, self.before.messages),
            contacts_hz: rate(link.contacts, self.before.contacts),
            round_trip_ms: link.round_trip_s.map(|s| s * 1e3),
            down_ms: link.down_s.map(|s| s * 1e3),
            motion_age_ms: quantiles(&self.motion_age_us, 1e-3),
            position_m: last.rendered.tool.map(|pose| pose.position_m.into()),
            force_n: last.force_n.norm(),
            max_force_n: self.max_force_n,
            coupling_n_per_m: last.rendered.coupling_n_per_m,
            generated_mj: last.rendered.generated_j * 1e3,
            state: link.waits.as_ref().map_or_else(|| words(last.rendered.state), |waits| format!("no force: {waits}")),
            link: format!("{:?}", link.state).to_lowercase(),
            priority: thread.priority.clone(),
            faults,
            last_fault: last_fault.or_else(|| {
                let fault = fault.filter(|_| faults > self.faults_before)?;
                Some(fault.words().to_owned())
            }),
            page: self.page.clone(),
        })
    }
}

/// A state for people.
fn words(state: State) -> String {
    match state {
        State::Stale => "no force: waits for the server".into(),
        State::Held(Hold::DeadMan) => "held: the dead man's button is up".into(),
        State::Held(Hold::Clutch) => "no force: the clutch is pressed".into(),
        State::Held(Hold::Device(word)) => format!("held: {word}"),
        State::Held(Hold::Leaving) => "leaving".into(),
        State::Tripped(fault) => format!("let go: {}", fault.words()),
        State::Ramping => "letting force in or out".into(),
        State::Rendering => "rendering".into(),
    }
}

impl std::fmt::Display for Report {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [median_ms, late_ms] = self.dt_ms;
        let round_trip = self.round_trip_ms.map_or_else(|| "-".into(), |ms| format!("{ms:.1} ms"));
        let at = self
            .position_m
            .map_or_else(|| "out of the scene".into(), |at| at.map(|m| format!("{:.1}", 1e3 * m)).join(" ") + " mm");
        write!(
            f,
            "{}, at {at}, force {:.2} N (max {:.2}), motion {:.0} ms old, servo {:.0} Hz (dt {median_ms:.2}/{late_ms:.2} \
             ms), round trip {round_trip}, poses {:.0} Hz, contacts {:.0} Hz, {}, {}",
            self.state,
            self.force_n,
            self.max_force_n,
            self.motion_age_ms[0],
            self.servo_hz,
            self.poses_hz,
            self.contacts_hz,
            self.link,
            self.page
        )?;
        self.last_fault.as_ref().map_or(Ok(()), |fault| write!(f, "; fault: {fault}"))
    }
}

/// What the lines of a run come to, as a section of a report: medians over its seconds.
///
/// # Errors
/// The file cannot be read, or a line is none of them.
pub fn loopback_text(path: &std::path::Path) -> anyhow::Result<String> {
    let lines = std::fs::read_to_string(path)?;
    let reports = lines.lines().map(serde_json::from_str).collect::<Result<Vec<Report>, _>>()?;
    let median = |of: &dyn Fn(&Report) -> f64| {
        let mut values: Vec<f64> = reports.iter().map(of).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
    };
    let most_n = reports.iter().map(|report| report.max_force_n).fold(0.0, f64::max);
    let priority = reports.last().map_or("", |report| report.priority.as_str());
    let rows = [
        ("servo, Hz", median(&|r| r.servo_hz)),
        ("dt p50, ms", median(&|r| r.dt_ms[0])),
        ("dt p99, ms", median(&|r| r.dt_ms[1])),
        ("a servo's tick p50, us: from the device's motion to its force", median(&|r| r.spent_us[0])),
        ("a servo's tick p99, us", median(&|r| r.spent_us[1])),
        ("round trip on loopback, ms", median(&|r| r.round_trip_ms.unwrap_or(f64::NAN))),
        ("age of the motion that the contact reflects p50, ms", median(&|r| r.motion_age_ms[0])),
        ("age of the motion that the contact reflects p99, ms", median(&|r| r.motion_age_ms[1])),
        ("poses sent, Hz, of 500", median(&|r| r.poses_hz)),
        ("contacts, Hz, of 250", median(&|r| r.contacts_hz)),
        ("greatest force on the hand, N", most_n),
    ];
    let rows: String = rows.iter().map(|(name, value)| format!("| {name} | {value:.3} |\n")).collect();
    Ok(format!(
        "## On loopback\n\nThe simulated Omni cuts the liver through a server on the same machine for {} s. The \
         figures are medians of the seconds. Priority of the servo's thread: {priority}. Few poses and contacts are \
         sent, because deadbands skip changes that a hand does not notice. A pose is sent when the predicted force \
         has changed by 5 %, when the tool has turned by 0.01 rad, or when it has moved far enough. Far enough is the \
         distance that it travels in 10 ms, or in 4 ms in contact, and at least 0.1 mm. A contact is sent when the one \
         before does not predict it or the tool has left its validity radius. At least one pose and one contact are \
         sent every 25 ms. The age below is that of the motion behind the newest contact, whose prediction is still \
         valid. The delay of the force is the round trip.\n\n| | |\n|---|---|\n{rows}\n",
        reports.len()
    ))
}
