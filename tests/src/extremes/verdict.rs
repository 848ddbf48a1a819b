//! What is asked of a run, and what of that it did not do.

use super::trial::Measures;

/// Energy that may come from nothing, over what was put in: one linearised implicit step may gain a
/// little while elements turn.
pub const MOST_MADE: f64 = 0.05;
/// Kinetic energy that counts as rest, over the energy put in: speeds a thousandth of the highest.
pub const REST_KINETIC: f64 = 1e-6;
/// Distance from its place at which a node counts as back, in voxels.
pub const REST_VOXELS: f64 = 0.05;
/// Periods of the body after which rest is asked for.
pub const REST_PERIODS: f64 = 10.0;
/// Median iterations of a step up to which a solve counts as cheap: five times the usual.
pub const MOST_MEDIAN_ITERATIONS: u32 = 50;

/// What the finding of a scene that is refused begins with.
pub const REFUSED: &str = "refused: ";

/// Something that was asked of a run and not done.
#[derive(Clone, Debug, PartialEq)]
pub enum Finding {
    /// A number that is none.
    NotFinite,
    /// Steps that were rolled back.
    Faults(u32),
    /// Energy from nothing.
    EnergyMade(f64),
    /// Still moving long after it was let go.
    NotAtRest(f64),
    /// At rest somewhere else.
    NotBack(f64),
    /// Many iterations in every other step.
    Slow(u32),
    /// Steps that ended above the solver's tolerance.
    Unconverged(f64),
    /// Something else that the case checks.
    Other(String),
}

impl std::fmt::Display for Finding {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::NotFinite => write!(f, "not finite"),
            Self::Faults(n) => write!(f, "{n} steps rolled back"),
            Self::EnergyMade(share) => write!(f, "energy made: {share:.2} of what was put in"),
            Self::NotAtRest(share) => write!(f, "not at rest: kinetic energy {share:.1e} of what was put in"),
            Self::NotBack(voxels) => write!(f, "rests {voxels:.2} voxels off its place"),
            Self::Slow(median) => write!(f, "slow: {median} iterations in every other step"),
            Self::Unconverged(share) => write!(f, "{:.2} % of the steps unconverged", 100.0 * share),
            Self::Other(what) => write!(f, "{what}"),
        }
    }
}

/// What a run did not do of what is asked of every run.
#[must_use]
pub fn findings(seen: &Measures) -> Vec<Finding> {
    let mut findings = Vec::new();
    let mut ask = |holds: bool, finding: Finding| {
        if !holds {
            findings.push(finding);
        }
    };
    ask(seen.finite, Finding::NotFinite);
    ask(seen.faults == 0, Finding::Faults(seen.faults));
    ask(seen.made_of_put_in <= MOST_MADE, Finding::EnergyMade(seen.made_of_put_in));
    ask(seen.iterations[0] <= MOST_MEDIAN_ITERATIONS, Finding::Slow(seen.iterations[0]));
    let unconverged = f64::from(seen.unconverged_steps) / f64::from(seen.steps.max(1));
    ask(seen.unconverged_steps == 0, Finding::Unconverged(unconverged));
    if let Some(rest) = seen.rest.as_ref().filter(|r| r.periods >= REST_PERIODS) {
        let still = rest.kinetic_of_put_in <= REST_KINETIC;
        ask(still, Finding::NotAtRest(rest.kinetic_of_put_in));
        if let Some(left) = rest.left_voxels {
            ask(left <= REST_VOXELS, Finding::NotBack(left));
        }
    }
    findings
}
