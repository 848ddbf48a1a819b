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
             `make dice` runs `{}` and writes this page. A run that is cut off leaves the dicings that it has\n\
             made.\n\
             \n\
             Each dicing has a seed, which draws its rate (60, 125, 250, 500 or 1000 Hz) and its plunges. A\n\
             straight blade that reaches across the model comes straight down at a random place, to 0.6 to 1 of\n\
             its height, at 0.1 to 1 m/s. It goes up again at a speed drawn anew. Half of the plunges are along\n\
             x, half along z. Holds, loads and gravity are those of the built-in scene, so that chips fall. Steps\n\
             are solved to a tolerance of 1e-3.\n\
             \n\
             No step may be rolled back. In each dicing the ledger explains all energy but 1e-2 of the work of\n\
             tools and loads, as sums of magnitudes. The stored energy never exceeds the net work by more than a\n\
             tenth of that sum.\n\
             \n\
             *Retried* counts solves that missed their tolerance at first. *Unconverged* counts steps that were\n\
             integrated without it. *Unsettled* counts steps that left the force of a contact for the next one.\n\
             \n\
             | model | dicings | steps | links cut | most parts | rolled back | retried | unconverged | unsettled, of 1e6 \
             | most iterations | deactivated | residual/work, median, worst | stored beyond work, worst | with findings |\n\
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
