//! `docs/explanation/dicing.md`, from the tallies of a run.

use std::fmt::Write as _;

use super::campaign::Tally;

/// What is reported.
pub struct Report<'a> {
    /// The command that was run.
    pub command: String,
    /// Each model's name, and its dicings.
    pub models: &'a [(String, Vec<Tally>)],
}

impl Report<'_> {
    /// The report in Markdown.
    #[must_use]
    pub fn markdown(&self) -> String {
        let mut text = format!(
            "# Random dicings\n\n\
             Written by `make dice`: `{}`.\n\
             A dicing draws its rate (60, 125, 250, 500 or 1000 Hz) and its plunges from a seed: a straight blade that\n\
             reaches across the model goes straight down at a random place, to 0.6 to 1 of its height, at 0.1 to 1 m/s,\n\
             and up again as fast or slowly; half of the plunges are along x, half along z. Holds, loads and gravity are\n\
             those of the built-in scene, so that chips fall. Solved to a tolerance of 1e-3.\n\n\
             Asked of every step: nothing is rolled back. Of every dicing: what the ledger leaves unexplained is within\n\
             1e-2 of what tools and loads worked (both as sums of magnitudes), and what is stored never exceeds what was\n\
             worked by more than a tenth of it. Retried are solves that did not get to their tolerance at once;\n\
             unconverged are steps that were integrated without it, unsettled those that left a contact's force for the\n\
             next one.\n\n\
             | model | dicings | steps | links parted | most parts | rolled back | retried | unconverged | unsettled, of 1e6 \
             | most iterations | put away | residual/work, median, worst | stored beyond work, worst | with findings |\n\
             |---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n",
            self.command
        );
        for (name, tallies) in self.models {
            _ = writeln!(text, "{}", row(name, tallies));
        }
        text.push_str("\n## What does not hold\n\n");
        let mut found = false;
        for (name, tally) in self.models.iter().flat_map(|(name, tallies)| tallies.iter().map(move |t| (name, t))) {
            for finding in &tally.findings {
                found = true;
                _ = writeln!(text, "- {name}, seed {:016x}, {} Hz: {finding}", tally.seed, tally.rate_hz);
            }
        }
        if !found {
            text.push_str("Nothing was found.\n");
        }
        text
    }
}

fn row(name: &str, tallies: &[Tally]) -> String {
    let sum = |of: fn(&Tally) -> u64| tallies.iter().map(of).sum::<u64>();
    let worst = |of: fn(&Tally) -> f64| tallies.iter().map(of).fold(0.0, f64::max);
    let steps = sum(|t| t.steps);
    let mut residuals: Vec<f64> = tallies.iter().map(|t| t.residual_ratio).collect();
    residuals.sort_by(f64::total_cmp);
    format!(
        "| {name} | {} | {steps} | {} | {} | {} | {} | {} | {:.0} | {} | {} | {:.1e}, {:.1e} | {:.1e} | {} |",
        tallies.len(),
        sum(|t| t.parted_links),
        worst(|t| t.parts as f64),
        sum(|t| t.faults.into()),
        sum(|t| t.retries.into()),
        sum(|t| t.unconverged_steps.into()),
        1e6 * sum(|t| t.unsettled_steps.into()) as f64 / (steps as f64).max(1.0),
        worst(|t| t.most_iterations.into()),
        sum(|t| t.put_away.into()),
        residuals.get(residuals.len() / 2).copied().unwrap_or(0.0),
        residuals.last().copied().unwrap_or(0.0),
        worst(|t| t.gain_ratio),
        tallies.iter().filter(|t| !t.findings.is_empty()).count(),
    )
}
