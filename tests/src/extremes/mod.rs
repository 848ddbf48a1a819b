//! Extremes: a matrix of cases from one end of every supported range to the other, what is asked of
//! each, and the report that is made of them.

pub(crate) mod cuts;
mod ends;
mod loads;
mod materials;
pub mod properties;
pub mod refusals;
pub mod report;
pub mod scenes;
mod starts;
mod supports;
pub mod tables;
mod tools;
pub mod trial;
pub mod verdict;

use std::panic::{AssertUnwindSafe, catch_unwind};

use kerf_physics::SceneProblems;
use rayon::prelude::*;

use trial::Measures;
use verdict::{Finding, REFUSED, findings};

/// What a case is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Family {
    /// Material, step and voxel.
    Materials,
    /// Stiffness contrast.
    Contrast,
    /// Small bodies; held nowhere, everywhere, cut free.
    Supports,
    /// Starts far from rest.
    Starts,
    /// Tools.
    Tools,
    /// Loads that collapse elements.
    Loads,
    /// Random cuts without a blade.
    Cuts,
    /// Ends of several ranges at once.
    Ends,
}

impl Family {
    /// Every family, in the order of the report.
    pub const ALL: [Self; 8] = [
        Self::Materials,
        Self::Contrast,
        Self::Supports,
        Self::Starts,
        Self::Tools,
        Self::Loads,
        Self::Cuts,
        Self::Ends,
    ];

    /// Name in the report.
    #[must_use]
    pub fn title(self) -> &'static str {
        match self {
            Self::Materials => "Material, step and voxel",
            Self::Contrast => "Stiffness contrast",
            Self::Supports => "Small, free, held and cut free",
            Self::Starts => "Starts far from rest",
            Self::Tools => "Tools",
            Self::Loads => "Loads that collapse elements",
            Self::Cuts => "Random cuts",
            Self::Ends => "Ends of ranges together",
        }
    }
}

/// How long a case may take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Budget {
    /// Steps at most after letting go.
    pub most_steps: u32,
}

type Run = Box<dyn Fn(Budget) -> Result<Outcome, SceneProblems> + Send + Sync>;

/// What came of a case.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// What was measured.
    pub seen: Measures,
    /// What the case itself found wrong.
    pub wrong: Vec<String>,
}

impl From<Measures> for Outcome {
    fn from(seen: Measures) -> Self {
        Self { seen, wrong: Vec::new() }
    }
}

/// A scene and what is done to it.
pub struct Case {
    /// What it is about.
    pub family: Family,
    /// Its name, unique in its family.
    pub name: String,
    /// The values that matter, for the report.
    pub parameters: String,
    run: Run,
}

/// A line of the matrix.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// What the case is about.
    pub family: Family,
    /// Its name.
    pub name: String,
    /// The values that matter.
    pub parameters: String,
    /// What was measured; absent where the case panicked or its scene was refused.
    pub seen: Option<Measures>,
    /// What was asked and not done; empty: the case holds.
    pub findings: Vec<Finding>,
}

impl Case {
    fn new<O: Into<Outcome>>(
        family: Family,
        name: impl Into<String>,
        parameters: impl Into<String>,
        run: impl Fn(Budget) -> Result<O, SceneProblems> + Send + Sync + 'static,
    ) -> Self {
        let run: Run = Box::new(move |budget| run(budget).map(Into::into));
        Self { family, name: name.into(), parameters: parameters.into(), run }
    }

    /// Runs the case; a panic is a finding like any other.
    #[must_use]
    pub fn run(&self, budget: Budget) -> Row {
        let (seen, findings) = match catch_unwind(AssertUnwindSafe(|| (self.run)(budget))) {
            Ok(Ok(Outcome { seen, wrong })) => {
                let found = findings(&seen).into_iter().chain(wrong.into_iter().map(Finding::Other)).collect();
                (Some(seen), found)
            }
            Ok(Err(refused)) => (None, vec![Finding::Other(format!("{REFUSED}{refused}"))]),
            Err(panic) => {
                let text = panic.downcast_ref::<String>().map(String::as_str);
                let text = text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("without a message");
                (None, vec![Finding::Other(format!("panicked: {text}"))])
            }
        };
        Row { family: self.family, name: self.name.clone(), parameters: self.parameters.clone(), seen, findings }
    }
}

/// Every case of the matrix; `random` of them at places that `seed` chooses.
#[must_use]
pub fn matrix(seed: u64, random: usize) -> Vec<Case> {
    let families = [
        materials::cases(seed, random),
        materials::contrasts(),
        supports::cases(),
        starts::cases(seed),
        tools::cases(seed),
        loads::cases(),
        cuts::cases(seed),
        ends::cases(),
    ];
    families.into_iter().flatten().collect()
}

/// Runs cases on all cores, in any order; the rows come in the cases' order. `done` is told of each.
pub fn run_all(cases: &[Case], budget: Budget, done: impl Fn(&Row) + Sync) -> Vec<Row> {
    let run = |case: &Case| {
        let row = case.run(budget);
        done(&row);
        row
    };
    cases.par_iter().map(run).collect()
}
