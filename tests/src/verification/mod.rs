//! The physics against analytic and independent results.
//!
//! A family is a function that runs its cases on a set of meshes and returns what it found: tables of
//! figures beside their references, and studies of convergence under refinement. The binary `verify`
//! writes the figures as CSV files and a page from these; the test `verification` holds the coarse part against bounds.

pub mod beam;
pub mod bending;
pub mod cantilever;
pub mod cutting;
pub mod elements;
pub mod filled;
pub mod half_space;
pub mod held;
pub mod link_rule;
pub mod motion;
pub mod page;
pub mod probe;
pub mod release;
pub mod report;
pub mod scenes;
pub mod scissors;
pub mod spin;
pub mod statics;
pub mod tables;
pub mod tearing;
pub mod tip_load;
pub mod uniaxial;

use anyhow::Result;
use kerf_plot::{Axis, Chart, Curve, Figure};

/// How much of a family is run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
    /// A few coarse meshes: seconds in a test.
    Coarse,
    /// Every mesh and study of the document.
    Full,
}

impl Extent {
    /// The first `coarse` of `all`, or all of them.
    #[must_use]
    pub fn of<T: Clone>(self, all: &[T], coarse: usize) -> Vec<T> {
        match self {
            Self::Coarse => all[..coarse].to_vec(),
            Self::Full => all.to_vec(),
        }
    }
}

/// Cases that belong together.
#[derive(Clone, Debug, Default)]
pub struct Family {
    /// Heading.
    pub title: &'static str,
    /// What is set up and how the figures are taken, in Markdown.
    pub text: String,
    /// Figures.
    pub tables: Vec<Table>,
    /// Convergence under refinement.
    pub studies: Vec<Study>,
    /// Figures with limits.
    pub checks: Vec<Check>,
    /// Plots beside those of the studies.
    pub figures: Vec<Figure>,
}

/// Figures on the same meshes.
#[derive(Clone, Debug, Default)]
pub struct Table {
    /// Name of each mesh.
    pub columns: Vec<String>,
    /// Cases.
    pub rows: Vec<Row>,
}

/// A case on every mesh of its table.
#[derive(Clone, Debug)]
pub struct Row {
    /// What is measured.
    pub case: String,
    /// What it should be.
    pub reference: Reference,
    /// What it is, by column.
    pub ours: Vec<f64>,
    /// Where the reference is from.
    pub source: String,
}

/// What a figure is held against.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reference {
    /// A value in a unit (empty: a ratio); errors are relative to it.
    Value(f64, &'static str),
    /// Nothing: the figure, a ratio, is the error.
    Zero,
    /// A ratio that must not be exceeded.
    AtMost(f64),
}

impl Row {
    /// Error of each figure: relative, absolute where the reference is zero, what exceeds a limit.
    pub fn errors(&self) -> impl Iterator<Item = f64> {
        self.ours.iter().map(|ours| match self.reference {
            Reference::Value(reference, _) => ours / reference - 1.0,
            Reference::Zero => *ours,
            Reference::AtMost(limit) => (ours - limit).max(0.0),
        })
    }

    /// The largest error in size.
    #[must_use]
    pub fn worst(&self) -> f64 {
        self.errors().fold(0.0, |worst, e| if e.is_nan() { f64::INFINITY } else { worst.max(e.abs()) })
    }
}

/// Largest fraction of a tool's work that a ledger may leave unexplained.
const LEDGER_LIMIT: f64 = 0.01;

/// A figure that must be met, and how well the run that it is from keeps its energy where a tool works.
#[derive(Clone, Debug)]
pub struct Check {
    /// What is measured.
    pub case: String,
    /// What it should be.
    pub reference: f64,
    /// What it is.
    pub ours: f64,
    /// Largest relative error; none where the figure is there to be read, not held.
    pub limit: Option<f64>,
    /// What the ledger leaves unexplained over the tool's work; none where no tool works.
    pub residual: Option<f64>,
    /// Where the reference is from.
    pub source: &'static str,
}

impl Check {
    /// Relative error.
    #[must_use]
    pub fn error(&self) -> f64 {
        self.ours / self.reference - 1.0
    }

    /// Whether the figure, if it is held, and the ledger keep their limits.
    #[must_use]
    pub fn is_met(&self) -> bool {
        self.limit.is_none_or(|limit| self.error().abs() <= limit)
            && self.residual.is_none_or(|residual| residual <= LEDGER_LIMIT)
    }
}

/// Errors under refinement, for one plot.
#[derive(Clone, Debug)]
pub struct Study {
    /// Name of the plot's files.
    pub file: &'static str,
    /// Title of the plot.
    pub title: String,
    /// What the error is taken of and against.
    pub error_of: String,
    /// What the size of a mesh is, with its unit.
    pub size_of: &'static str,
    /// Curves.
    pub series: Vec<Series>,
}

impl Study {
    /// Sizes of errors over sizes of elements, both by decades.
    #[must_use]
    pub fn figure(&self) -> Figure {
        let curve = |series: &Series| {
            let percent = series.points.iter().map(|(h, e)| (*h, 100.0 * e.abs())).collect();
            Curve::dotted_line(&series.summary(), percent)
        };
        let error = format!("error, %: {}", self.error_of);
        let curves = self.series.iter().map(curve).collect();
        let chart = Chart::new(Axis::log(self.size_of), Axis::log(&error), curves);
        Figure::new(&format!("verification-{}", self.file), &self.title, chart)
    }
}

/// Largest difference of the orders between neighbouring meshes at which an error counts as a power.
const ORDERS_APART: f64 = 1.5;

/// A curve of a study.
#[derive(Clone, Debug)]
pub struct Series {
    /// Name.
    pub label: String,
    /// Size of the elements and relative error, from coarse to fine.
    pub points: Vec<(f64, f64)>,
}

impl Series {
    /// A curve from sizes and errors in any order.
    #[must_use]
    pub fn new(label: String, mut points: Vec<(f64, f64)>) -> Self {
        points.sort_by(|a, b| b.0.total_cmp(&a.0));
        Self { label, points }
    }

    /// The order p of `error = C size^p` on the three finest meshes (halved each time);
    /// `None` where there are fewer, or where the error is not yet a power of the size: it changes its sign,
    /// or the orders from mesh to mesh differ by more than 1.5.
    #[must_use]
    pub fn order(&self) -> Option<f64> {
        let [coarse, middle, fine] = *self.points.last_chunk()?;
        let between = |a: (f64, f64), b: (f64, f64)| (a.1 / b.1).ln() / (a.0 / b.0).ln();
        let orders = [between(coarse, middle), between(middle, fine)];
        let is_power = (orders[0] - orders[1]).abs() <= ORDERS_APART && orders.iter().all(|p| *p > 0.0);
        // The slope of the regression through equally spaced points is that between the outer two.
        is_power.then(|| between(coarse, fine))
    }

    /// Its name and its order, as plots and the document say it.
    #[must_use]
    pub fn summary(&self) -> String {
        let order = match self.order() {
            Some(order) => format!("order {order:.1}"),
            None if self.points.len() < 3 => "fewer than three meshes".into(),
            None => "not asymptotic".into(),
        };
        format!("{}: {order}", self.label)
    }
}

/// A family's function.
pub type FamilyFn = fn(Extent) -> Result<Family>;

/// Every family, in the order of the document.
pub const FAMILIES: [(&str, FamilyFn); 16] = [
    ("elements", elements::family),
    ("uniaxial stress", uniaxial::family),
    ("bending", bending::family),
    ("cantilever", cantilever::family),
    ("thin clamps", held::family),
    ("sides off the lattice", filled::family),
    ("tip load", tip_load::family),
    ("half-space", half_space::family),
    ("probe", probe::family),
    ("energy release", release::family),
    ("tearing", tearing::family),
    ("motion", motion::family),
    ("spin", spin::family),
    ("steady cuts", cutting::steady::family),
    ("widths, slices, speeds and regions", cutting::variations::family),
    ("scissors", scissors::family),
];

#[cfg(test)]
mod tests {
    use super::Series;

    #[test]
    fn the_order_of_a_power_law_is_its_exponent() {
        let power = |h: f64| (h, -0.7 * h.powf(1.5));
        let order = Series::new(String::new(), [0.1, 0.4, 0.2].map(power).to_vec()).order().expect("three points");
        assert!((order - 1.5).abs() < 1e-12);
    }

    #[test]
    fn errors_that_change_sign_or_rise_or_stall_have_no_order() {
        for errors in [[0.3, 0.1, -0.01], [0.1, 0.2, 0.05], [0.41, 0.4, 0.03]] {
            let points = [0.4, 0.2, 0.1].into_iter().zip(errors).collect();
            assert_eq!(Series::new(String::new(), points).order(), None);
        }
    }
}
