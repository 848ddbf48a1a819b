//! How far a run is: a bar on a terminal, a line every few seconds elsewhere.

use std::io::{IsTerminal, Write as _};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use kerf_physics::making::{Making, MakingStage};

/// Time between lines; the first comes with the first step.
const LINE_EVERY: Duration = Duration::from_secs(5);

/// Progress towards a number of steps.
pub struct Progress {
    bar: ProgressBar,
    lines: Option<Lines>,
}

struct Lines {
    total: u64,
    done: u64,
    began: Instant,
    next: Instant,
}

impl Progress {
    /// None of so many steps is done.
    #[must_use]
    pub fn new(total: u64) -> Self {
        let style = ProgressStyle::with_template("{bar:40} {pos}/{len} steps, {per_sec}, {eta} left {msg}");
        let bar = ProgressBar::new(total).with_style(style.expect("the template is sound"));
        let began = Instant::now();
        let lines = Lines { total, done: 0, began, next: began };
        Self { bar, lines: (!std::io::stderr().is_terminal()).then_some(lines) }
    }

    /// One more is done.
    pub fn advance(&mut self) {
        self.bar.inc(1);
        if let Some(lines) = &mut self.lines {
            lines.done += 1;
            let now = Instant::now();
            if now >= lines.next {
                lines.next = now + LINE_EVERY;
                say(&line(lines.done, lines.total, (now - lines.began).as_secs_f64()));
            }
        }
    }

    /// Says something beside the bar.
    pub fn say(&self, what: &str) {
        // Not `println` of the bar: that says nothing where there is no terminal.
        self.bar.suspend(|| say(what));
    }

    /// Takes the bar away.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

/// How far a scene is that is being made: a bar on a terminal, nothing elsewhere.
pub struct MakingBar(ProgressBar);

/// Ticks of the whole bar.
const WHOLE: u64 = 1000;

impl MakingBar {
    /// Nothing is made yet.
    #[must_use]
    pub fn new() -> Self {
        let style = ProgressStyle::with_template("{bar:40} {percent} % {msg}");
        Self(ProgressBar::new(WHOLE).with_style(style.expect("the template is sound")))
    }

    /// So much is made.
    pub fn tell(&self, Making { stage, object, objects, voxels, share, .. }: Making) {
        let stage = match stage {
            MakingStage::Voxels => "voxels",
            MakingStage::Elements => "elements",
            MakingStage::Solver => "solver",
            MakingStage::Equilibrium => "equilibrium",
        };
        let counted = if voxels > 0 { format!(", {voxels} voxels") } else { String::new() };
        self.0.set_message(format!("object {} of {objects}: {stage}{counted}", object + 1));
        self.0.set_position((WHOLE as f64 * share) as u64);
    }

    /// Takes the bar away.
    pub fn finish(&self) {
        self.0.finish_and_clear();
    }
}

/// Says something on standard error. A run goes on though nobody can hear of it.
pub fn say(what: &str) {
    let _ = writeln!(std::io::stderr(), "{what}");
}

fn line(done: u64, total: u64, passed_s: f64) -> String {
    let per_s = done as f64 / passed_s;
    format!("{done} of {total} steps, {per_s:.1} a second, {:.0} s left", (total - done) as f64 / per_s)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_says_how_far_how_fast_and_how_long_still() {
        assert_eq!(line(50, 200, 10.0), "50 of 200 steps, 5.0 a second, 30 s left");
    }
}
