//! `docs/stability.md`, from the rows of a run. Without times, so that a run with the same seed writes
//! the same bytes.

use std::fmt::Write as _;

use super::refusals::Refusal;
use super::trial::Measures;
use super::verdict::{MOST_MADE, MOST_MEDIAN_ITERATIONS, REST_KINETIC, REST_PERIODS, REST_VOXELS};
use super::{Family, Row};

/// What is reported.
pub struct Report<'a> {
    /// Seed of the run.
    pub seed: u64,
    /// Lines of the matrix.
    pub rows: &'a [Row],
    /// What was refused.
    pub refusals: &'a [Refusal],
    /// Each property, how many inputs it was tried on, and the smallest input that failed.
    pub properties: &'a [(&'static str, u32, Result<(), String>)],
}

impl Report<'_> {
    /// The report in Markdown.
    #[must_use]
    pub fn markdown(&self) -> String {
        let mut text = preface(self.seed);
        self.summary(&mut text);
        self.findings(&mut text);
        self.supported(&mut text);
        self.tried(&mut text);
        for family in Family::ALL {
            self.family(&mut text, family);
        }
        text
    }

    fn of(&self, family: Family) -> impl Iterator<Item = &Row> {
        self.rows.iter().filter(move |row| row.family == family)
    }

    fn summary(&self, text: &mut String) {
        let holds = self.rows.iter().filter(|row| row.findings.is_empty()).count();
        _ = writeln!(text, "## Summary\n\n{holds} of {} cases hold.\n", self.rows.len());
        text.push_str("| family | cases | hold | finite | with rollbacks | energy made, worst | iterations, worst median | worst step |\n");
        text.push_str("|---|---|---|---|---|---|---|---|\n");
        for family in Family::ALL {
            let rows: Vec<&Row> = self.of(family).collect();
            let seen: Vec<&Measures> = rows.iter().filter_map(|row| row.seen.as_ref()).collect();
            let made = seen.iter().map(|s| s.made_of_put_in).fold(0.0, f64::max);
            let iterations = |i: usize| seen.iter().map(|s| s.iterations[i]).max().unwrap_or(0);
            _ = writeln!(
                text,
                "| {} | {} | {} | {} | {} | {made:.1e} | {} | {} |",
                family.title(),
                rows.len(),
                rows.iter().filter(|row| row.findings.is_empty()).count(),
                seen.iter().filter(|s| s.finite).count(),
                seen.iter().filter(|s| s.faults > 0).count(),
                iterations(0),
                iterations(1),
            );
        }
    }

    fn findings(&self, text: &mut String) {
        text.push_str("\n## What does not hold\n\n| family | case | values | finding |\n|---|---|---|---|\n");
        for row in self.rows.iter().filter(|row| !row.findings.is_empty()) {
            let findings: Vec<String> = row.findings.iter().map(ToString::to_string).collect();
            let (family, name) = (row.family.title(), &row.name);
            _ = writeln!(text, "| {family} | {name} | {} | {} |", row.parameters, findings.join("; "));
        }
    }

    fn supported(&self, text: &mut String) {
        text.push_str("\n## Outside the supported range\n\nRefused when the scene is loaded:\n\n");
        text.push_str("| what was said | names field and limit |\n|---|---|\n");
        for refusal in self.refusals {
            let verdict = if refusal.holds() { "yes" } else { "**no**" };
            _ = writeln!(text, "| `{}` | {verdict} |", refusal.said.join("; "));
        }
    }

    fn tried(&self, text: &mut String) {
        text.push_str("\n## Properties\n\nInputs chosen by proptest from the same seed; a failure is shrunk.\n\n");
        text.push_str("| property | inputs | verdict |\n|---|---|---|\n");
        for (name, inputs, outcome) in self.properties {
            let verdict = match outcome {
                Ok(()) => "holds".to_owned(),
                Err(failure) => failure.replace('\n', " ").replace('|', "/"),
            };
            _ = writeln!(text, "| {name} | {inputs} | {verdict} |");
        }
    }

    fn family(&self, text: &mut String, family: Family) {
        _ = writeln!(text, "\n## {}\n", family.title());
        text.push_str("| case | values | steps | finite | put in, J | stored at most | made | residual | at rest: kinetic | after periods | off, voxels | iterations median, most | unconverged | rolled back | links parted | verdict |\n");
        text.push_str("|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n");
        for row in self.of(family) {
            let verdict = if row.findings.is_empty() { "holds" } else { "**see above**" };
            let measured = row.seen.as_ref().map_or_else(|| "- | ".repeat(13), measured);
            _ = writeln!(text, "| {} | {} | {measured}{verdict} |", row.name, row.parameters);
        }
    }
}

/// The cells of what was measured, each with its bar.
fn measured(seen: &Measures) -> String {
    let dash = || "-".to_owned();
    let rest = seen.rest.as_ref();
    let left = rest.and_then(|r| r.left_voxels).map_or_else(dash, |l| format!("{l:.1e}"));
    let kinetic = rest.map_or_else(dash, |r| format!("{:.1e}", r.kinetic_of_put_in));
    let periods = rest.map_or_else(dash, |r| {
        if r.periods < 1e3 { format!("{:.1}", r.periods) } else { format!("{:.0e}", r.periods) }
    });
    let cells = [
        seen.steps.to_string(),
        if seen.finite { "yes" } else { "**no**" }.to_owned(),
        format!("{:.1e}", seen.put_in_j),
        format!("{:.2e}", seen.stored_of_put_in),
        format!("{:.1e}", seen.made_of_put_in),
        format!("{:.1e}", seen.residual_of_put_in),
        kinetic,
        periods,
        left,
        format!("{}, {}", seen.iterations[0], seen.iterations[1]),
        seen.unconverged_steps.to_string(),
        seen.faults.to_string(),
        seen.parted_links.to_string(),
    ];
    cells.iter().map(|cell| format!("{cell} | ")).collect()
}

fn preface(seed: u64) -> String {
    format!(
        "# Stability at the extremes\n\n\
         Written by `make extremes`, seed {seed}; a run with the same seed writes the same bytes. Every case\n\
         runs at the solver's default tolerance and cap of iterations, on materials damped at a tenth of the\n\
         critical in proportion to mass and as much in proportion to stiffness at the body's lowest frequency.\n\n\
         Asked of every case:\n\n\
         - every number is finite, no step is rolled back, every solve reaches its tolerance, and the median\n  \
           step takes at most {MOST_MEDIAN_ITERATIONS} iterations;\n\
         - energy is bounded by what was put in: at no time does the stored energy (elastic, contact, kinetic)\n  \
           exceed what was stored at the start plus the net work of tools and loads by more than {MOST_MADE} of\n  \
           the energy put in (column *made*; put in: the start's energy, the magnitudes of all work, what a blade\n  \
           put down in the tissue compresses; at least 1e-6 E V). *Stored at most* and *residual*, what the\n  \
           ledger leaves unexplained, are over the energy put in too;\n\
         - let go for {REST_PERIODS} periods of its slowest vibration or more, a body is at rest: kinetic energy\n  \
           over the last tenth of the steps at most {REST_KINETIC:e} of the energy put in and, where it is held,\n  \
           whole and unloaded, every node within {REST_VOXELS} voxels of where it was built. Where fewer periods\n  \
           pass, rest is not judged.\n\n\
         Units: E in Pa, rho in kg/m^3, dt in s, h (voxel) in m; k voxels to an element's edge, c the strain\n\
         stiffening. Periods are those of bending.\n\n"
    )
}
