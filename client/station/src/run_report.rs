//! What a run came to, as a folder: `--report DIR`. Force over time, and how long what is felt took to come.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Context;
use kerf_plot::{Axis, Chart, Curve, Figure};

use crate::servo::runner::Sample;

/// Forces are drawn by their greatest in so long, s: ten thousand points are an hour and a half.
const FORCE_EVERY_S: f64 = 0.02;
/// Points that are drawn at most; from then on every second one is kept.
const MOST_POINTS: usize = 20_000;
/// Width of a bar of the histogram, ms, and their number; what took longer is in the last.
const BAR_MS: f64 = 1.0;
const BARS: usize = 200;

/// What one device did, summed up as it goes.
pub struct RunReport {
    device: String,
    begun_ns: Option<u64>,
    /// Seconds since the beginning, and the greatest force on the hand since the point before, N.
    forces: Vec<(f64, f64)>,
    every_s: f64,
    /// Ticks by the age of the motion that they rendered.
    ages: [u64; BARS],
    ticks: u64,
    ticks_with_age: u64,
}

impl RunReport {
    /// Of a device of this name.
    #[must_use]
    pub fn new(device: &str) -> Self {
        Self {
            device: device.to_owned(),
            begun_ns: None,
            forces: Vec::new(),
            every_s: FORCE_EVERY_S,
            ages: [0; BARS],
            ticks: 0,
            ticks_with_age: 0,
        }
    }

    /// Takes a tick.
    pub fn take(&mut self, sample: &Sample) {
        let begun_ns = *self.begun_ns.get_or_insert(sample.at_ns);
        let time_s = sample.at_ns.saturating_sub(begun_ns) as f64 * 1e-9;
        let force_n = sample.force_n.norm();
        self.ticks += 1;
        match self.forces.last_mut() {
            Some((begun_s, most_n)) if time_s < *begun_s + self.every_s => *most_n = most_n.max(force_n),
            _ => self.forces.push((time_s, force_n)),
        }
        if self.forces.len() > MOST_POINTS {
            self.forces = self.forces.chunks(2).map(|two| two.iter().copied().fold(two[0], greater)).collect();
            self.every_s *= 2.0;
        }
        if let Some(age_s) = sample.motion_age_s {
            self.ticks_with_age += 1;
            self.ages[((age_s * 1e3 / BAR_MS) as usize).min(BARS - 1)] += 1;
        }
    }

    /// Age below which a share of the ticks lies, ms.
    fn age_ms(&self, share: f64) -> f64 {
        let wanted = share * self.ticks_with_age as f64;
        let mut below = 0;
        let bar = self.ages.iter().position(|ticks| {
            below += ticks;
            below as f64 >= wanted
        });
        (bar.unwrap_or(BARS - 1) + 1) as f64 * BAR_MS
    }

    /// Writes the plots of this device, and answers with its section of the page.
    fn write(&self, folder: &Path, index: usize) -> anyhow::Result<String> {
        let (force, latency) = (format!("force-{index}"), format!("latency-{index}"));
        let curve = Curve::line("force on the hand, N", self.forces.clone());
        let chart = Chart::new(Axis::linear("time, s"), Axis::linear("force, N"), vec![curve]);
        Figure::new(&force, &format!("Force, {}", self.device), chart).draw(folder)?;
        let share = |ticks: u64| 100.0 * ticks as f64 / self.ticks_with_age.max(1) as f64;
        let last = self.ages.iter().rposition(|ticks| *ticks > 0).unwrap_or(0);
        let steps = (0..=last).flat_map(|bar| {
            let (left_ms, right_ms) = (bar as f64 * BAR_MS, (bar + 1) as f64 * BAR_MS);
            [(left_ms, share(self.ages[bar])), (right_ms, share(self.ages[bar]))]
        });
        let curve = Curve::line("share of the ticks, %", steps.collect());
        let chart = Chart::new(Axis::linear("age of the motion, ms"), Axis::linear("ticks, %"), vec![curve]);
        Figure::new(&latency, &format!("What is felt reflects a motion of this age, {}", self.device), chart)
            .draw(folder)?;
        let most_n = self.forces.iter().map(|(_, force_n)| *force_n).fold(0.0, f64::max);
        let mut text = format!("## {}\n\n", self.device);
        let lasted_s = self.forces.last().map_or(0.0, |(time_s, _)| *time_s);
        writeln!(text, "{} ticks in {lasted_s:.1} s; greatest force {most_n:.2} N.", self.ticks)?;
        if self.ticks_with_age > 0 {
            let [half, most] = [0.5, 0.99].map(|share| self.age_ms(share));
            writeln!(text, "Half of them rendered a motion of less than {half} ms, 99 % of less than {most} ms.")?;
        }
        writeln!(text, "\n![Force over time]({force}.svg)\n\n![Histogram of ages]({latency}.svg)\n")?;
        Ok(text)
    }
}

fn greater(a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    (a.0, a.1.max(b.1))
}

/// Writes a page and its plots into a folder, which is made.
///
/// # Errors
/// They cannot be written.
pub fn write<'a>(folder: &Path, reports: impl IntoIterator<Item = &'a RunReport>) -> anyhow::Result<()> {
    let why = || format!("--report {}", folder.display());
    std::fs::create_dir_all(folder).with_context(why)?;
    let mut text = "# A run of the station\n\n".to_owned();
    for (index, report) in reports.into_iter().enumerate() {
        text += &report.write(folder, index).with_context(why)?;
    }
    std::fs::write(folder.join("report.md"), text).with_context(why)
}
