//! `docs/explanation/stability.md` and its figure, from the tables of a run.

use std::fmt::Write as _;

use kerf_plot::{Axis, Chart, Curve, Figure};

use super::Family;
use super::tables::{Case, Tables};
use super::verdict::{MOST_MADE, MOST_MEDIAN_ITERATIONS, REST_KINETIC, REST_PERIODS, REST_VOXELS};

/// Share of a limit from which a case that holds counts as close to it.
const CLOSE: f64 = 0.5;
/// Energies that are less than this share of what was put in are drawn as this.
const LEAST_DRAWN: f64 = 1e-6;

/// What is known of why the cases of a family fail.
fn cause(family: Family) -> &'static str {
    match family {
        Family::Contrast => "The layers differ by the largest ratio that a scene may have, over single voxels.",
        Family::Supports => "One voxel at a corner holds the block.",
        Family::Starts => {
            "The nodes start at random places in a strongly stiffening material (c = 10): elements overlap and are inverted. \
             The body comes to rest in another equilibrium than its shape."
        }
        Family::Tools => {
            "The blade crosses most of the tissue within a few steps, from anywhere and turning as it goes. A server \
             refuses such speeds; a script of `simulate` may ask for them."
        }
        Family::Materials | Family::Loads | Family::Cuts | Family::Ends => "The cause is not known.",
    }
}

impl Tables {
    fn of(&self, family: Family) -> impl Iterator<Item = &Case> {
        self.cases.iter().filter(move |case| case.family == family.title())
    }

    /// The page; `seed` is that of the run, `commit` what it was measured at.
    #[must_use]
    pub fn page(&self, seed: u64, commit: &str) -> String {
        let mut text = self.preface(seed, commit);
        self.summary(&mut text);
        self.failures(&mut text);
        self.close(&mut text);
        self.properties(&mut text);
        self.refused(&mut text);
        text
    }

    fn preface(&self, seed: u64, commit: &str) -> String {
        let holding = self.cases.iter().filter(|case| case.holds()).count();
        let refused = self.cases.iter().filter(|case| case.refusal().is_some()).count();
        let not_finite = self.cases.iter().filter(|case| case.finite == "no").count();
        let true_properties = self.properties.iter().filter(|p| p.verdict == "holds").count();
        format!(
            "# Stability at the extremes\n\n\
             Every supported range is run at its ends: stiffness from 100 Pa to 10 GPa, Poisson's ratio to 0.4999, time \
             steps from 0.1 ms to 0.1 s, voxels from 10 um to 1 m. Further cases start far from rest, or move a blade \
             at 10 m/s. {holding} of {cases} cases hold, and {refused} are refused with a reason. Of {properties} \
             properties that are tried on random inputs {true_properties} hold. The failures are [below](#what-fails). \
             {not_finite} cases have a number that is not finite.\n\n\
             `make extremes` runs all of it with seed {seed}, and writes this page and its \
             [tables](../reference/stability/README.md). The same code and seed yield the same bytes; these \
             are of commit {commit}. Every case runs at the solver's default tolerance and iteration cap. Materials are damped at a tenth of critical in proportion to \
             mass and as much in proportion to stiffness, at the body's lowest frequency.\n\n\
             A case holds where all of this is true:\n\n\
             - Every number is finite. No step is rolled back. Every solve reaches its tolerance. The median step takes at \
             most {MOST_MEDIAN_ITERATIONS} iterations.\n\
             - Energy is bounded. The stored energy (elastic, contact, kinetic) never exceeds that of the start plus the \
             net work of tools and loads by more than {MOST_MADE} of the energy put in. The energy put in is the start's \
             energy, the magnitudes of all work, and the compression by a blade put down in tissue; at least 1e-6 E V.\n\
             - The body comes to rest. After {REST_PERIODS} periods of its slowest vibration its kinetic energy is at most \
             {REST_KINETIC:e} of the energy put in. Where it is fixed, whole and unloaded, every node is within \
             {REST_VOXELS} voxels of its place at rest. Shorter runs are not judged by this.\n\n",
            cases = self.cases.len(),
            properties = self.properties.len(),
        )
    }

    fn summary(&self, text: &mut String) {
        text.push_str(
            "| family | cases | hold | with rollbacks | largest energy error | largest median of iterations | most in a step |\n\
             |---|---|---|---|---|---|---|\n",
        );
        for family in Family::ALL {
            let cases: Vec<&Case> = self.of(family).collect();
            let largest = |of: fn(&Case) -> &str| cases.iter().filter_map(|c| number(of(c))).fold(0.0, f64::max);
            let _ = writeln!(
                text,
                "| {} | {} | {} | {} | {:.1e} | {} | {} |",
                family.title(),
                cases.len(),
                cases.iter().filter(|case| case.holds()).count(),
                cases.iter().filter(|case| number(&case.rolled_back).is_some_and(|n| n > 0.0)).count(),
                largest(|case| &case.made),
                largest(|case| &case.iterations_median),
                largest(|case| &case.iterations_most),
            );
        }
        text.push_str(
            "\nThe energy error is the energy beyond the energy put in, over the energy put in.\n\n\
             ![Energy error of every case, in order of size](../reference/stability/stability-energy.png)\n\n\
             The energy error of every case, in order of its size. Most cases create no energy and lie on the lowest \
             line; the dashed line is the limit.\n\n",
        );
    }

    fn failures(&self, text: &mut String) {
        text.push_str("## What fails\n");
        for family in Family::ALL {
            let fails = |case: &&Case| !case.holds() && case.refusal().is_none();
            let failed: Vec<&Case> = self.of(family).filter(fails).collect();
            if failed.is_empty() {
                continue;
            }
            let _ = writeln!(text, "\n**{}.** {}\n", family.title(), cause(family));
            for case in failed {
                let _ = writeln!(text, "- {} ({}): {}", case.case, case.values, case.finding);
            }
        }
        text.push_str("\nThese are refused before their first step, with a reason:\n\n");
        for (case, reason) in self.cases.iter().filter_map(|case| Some((case, case.refusal()?))) {
            let _ = writeln!(text, "- {} ({}). {reason}", case.case, case.values);
        }
    }

    fn close(&self, text: &mut String) {
        let is_close = |case: &&Case| {
            let beyond = |of: &str, limit: f64| number(of).is_some_and(|value| value > CLOSE * limit);
            let is_judged = number(&case.rest_periods).is_some_and(|periods| periods >= REST_PERIODS);
            case.holds()
                && (beyond(&case.made, MOST_MADE)
                    || beyond(&case.iterations_median, MOST_MEDIAN_ITERATIONS.into())
                    || is_judged && (beyond(&case.rest_kinetic, REST_KINETIC) || beyond(&case.off_voxels, REST_VOXELS)))
        };
        text.push_str("\n## Close to a limit\n\nThese hold, with more than half of a limit used.\n\n");
        for case in self.cases.iter().filter(is_close) {
            let Case { case, values, made, iterations_median, rest_kinetic, off_voxels, .. } = case;
            let dash = |cell: &str| if cell.is_empty() { "-".to_owned() } else { cell.to_owned() };
            let _ = writeln!(
                text,
                "- {case} ({values}): energy error {made}, median of {iterations_median} iterations, kinetic energy at \
                 rest {}, {} voxels off",
                dash(rest_kinetic),
                dash(off_voxels),
            );
        }
    }

    fn properties(&self, text: &mut String) {
        text.push_str(
            "\n## Properties\n\nproptest draws inputs from the same seed and shrinks failures. The table of properties \
             has the smallest failing input.\n\n| property | inputs | verdict |\n|---|---|---|\n",
        );
        for property in &self.properties {
            let verdict = property.verdict.split(" at tests/").next().unwrap_or_default();
            let verdict = verdict.split(": Measures").next().unwrap_or_default();
            let verdict = if verdict == "holds" { verdict.to_owned() } else { format!("**fails**, {verdict}") };
            let _ = writeln!(text, "| {} | {} | {verdict} |", property.property, property.inputs);
        }
    }

    fn refused(&self, text: &mut String) {
        let named = self.refusals.iter().filter(|refused| refused.names_field_and_limit == "yes").count();
        let _ = writeln!(
            text,
            "\n## Outside the ranges\n\nA value outside its range is refused when the scene is loaded. {named} of the {} \
             messages that were tried name the field and its limit, for example:\n",
            self.refusals.len(),
        );
        for refused in self.refusals.iter().step_by(10) {
            let _ = writeln!(text, "- `{}`", refused.said);
        }
    }

    /// Energy error of every case in order of size, by family.
    #[must_use]
    pub fn figure(&self) -> Figure {
        let curve = |family: Family| {
            let made = self.of(family).filter_map(|case| number(&case.made));
            let mut made: Vec<f64> = made.map(|made| made.clamp(LEAST_DRAWN, 1e3)).collect();
            made.sort_by(f64::total_cmp);
            let last = made.len().saturating_sub(1).max(1) as f64;
            let points = made.iter().enumerate().map(|(i, made)| (100.0 * i as f64 / last, *made)).collect();
            Curve::dotted_line(family.title(), points)
        };
        let mut curves: Vec<Curve> = Family::ALL.into_iter().map(curve).collect();
        curves.push(Curve::dashes("limit", (0.0, MOST_MADE), (100.0, MOST_MADE)));
        let energy = "energy made over energy put in (drawn from 1e-6 to 1e3)";
        let chart = Chart::new(Axis::linear("share of the family's cases, %"), Axis::log(energy), curves);
        Figure::new("stability-energy", "Energy error by family", chart)
    }
}

fn number(text: &str) -> Option<f64> {
    text.parse().ok()
}
