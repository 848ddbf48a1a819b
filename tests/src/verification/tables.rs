//! The figures of the families as CSV files, one for each family. They are what the page is written from, so that its
//! words can change without a run.

use std::path::Path;

use anyhow::Result;
use serde::{Deserialize, Serialize};

use super::{Check, Family, Reference, Row};
use crate::rows;

/// What a figure is compared with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Compared {
    /// `error_percent` is relative to the reference.
    Relative,
    /// The reference is zero, and the figure is an upper bound, a power of ten.
    Zero,
    /// The reference must not be exceeded.
    AtMost,
}

/// Whether a figure keeps its limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// It does, and so does the ledger of its run.
    Met,
    /// It does not.
    Missed,
    /// It has none.
    NoLimit,
}

/// One figure: a line of a file. Cells are text, rounded to the digits that the same code repeats anywhere.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Figure {
    /// What is measured.
    pub case: String,
    /// Mesh; empty where the case names it.
    pub mesh: String,
    /// What it is compared with.
    pub compared: Compared,
    /// Reference, or what must not be exceeded.
    pub reference: String,
    /// Unit of reference and figure; empty for ratios and where the case names it.
    pub unit: String,
    /// The figure.
    pub measured: String,
    /// Relative error; empty but for `relative`.
    pub error_percent: String,
    /// Largest error allowed; empty where there is none.
    pub limit_percent: String,
    /// Upper bound, a power of ten, of the ledger's residual over the tool's work; empty where no tool works.
    pub residual_below: String,
    /// Whether the limit is kept.
    pub verdict: Verdict,
    /// Where the reference is from.
    pub source: String,
}

impl Figure {
    fn of_check(check: &Check) -> Self {
        Self {
            case: check.case.clone(),
            mesh: String::new(),
            compared: Compared::Relative,
            reference: significant(check.reference),
            unit: String::new(),
            measured: significant(check.ours),
            error_percent: percent(check.error()),
            limit_percent: check.limit.map_or_else(String::new, |limit| format!("{}", 100.0 * limit)),
            residual_below: check.residual.map_or_else(String::new, decade),
            verdict: match (check.limit, check.is_met()) {
                (None, _) => Verdict::NoLimit,
                (Some(_), true) => Verdict::Met,
                (Some(_), false) => Verdict::Missed,
            },
            source: check.source.to_owned(),
        }
    }

    fn of_cell(row: &Row, mesh: &str, ours: f64, error: f64) -> Self {
        let (compared, reference, unit, measured, error_percent, verdict) = match row.reference {
            Reference::Value(value, unit) => {
                (Compared::Relative, significant(value), unit, significant(ours), percent(error), Verdict::NoLimit)
            }
            Reference::Zero => (Compared::Zero, "0".into(), "", decade(ours), String::new(), Verdict::NoLimit),
            Reference::AtMost(limit) => {
                let verdict = if error > 0.0 { Verdict::Missed } else { Verdict::Met };
                (Compared::AtMost, limit.to_string(), "", format!("{ours:.4}"), String::new(), verdict)
            }
        };
        Self {
            case: row.case.clone(),
            mesh: mesh.to_owned(),
            compared,
            reference,
            unit: unit.to_owned(),
            measured,
            error_percent,
            limit_percent: String::new(),
            residual_below: String::new(),
            verdict,
            source: row.source.clone(),
        }
    }

    /// Size of the error over its limit: above 1 the limit is missed. `None` without a limit, or where the figure is
    /// allowed no error at all.
    #[must_use]
    pub fn of_limit(&self) -> Option<f64> {
        let number = |text: &str| text.parse::<f64>().ok();
        match self.compared {
            Compared::AtMost => Some(number(&self.measured)? / number(&self.reference)?),
            _ => Some(number(&self.error_percent)?.abs() / number(&self.limit_percent).filter(|limit| *limit > 0.0)?),
        }
    }
}

/// Name of the files of a family: its title in lower case, with hyphens.
#[must_use]
pub fn file_name(title: &str) -> String {
    let words = title.to_lowercase();
    words.split(|c: char| !c.is_ascii_alphanumeric()).filter(|word| !word.is_empty()).collect::<Vec<_>>().join("-")
}

/// Every figure of a family: tables first, then what has a limit.
#[must_use]
pub fn figures(family: &Family) -> Vec<Figure> {
    let cells = family.tables.iter().flat_map(|table| {
        table.rows.iter().flat_map(|row| {
            let meshes = table.columns.iter().zip(&row.ours).zip(row.errors());
            meshes.map(|((mesh, ours), error)| Figure::of_cell(row, mesh, *ours, error)).collect::<Vec<_>>()
        })
    });
    cells.chain(family.checks.iter().map(Figure::of_check)).collect()
}

/// Writes the file of a family into `folder`.
///
/// # Errors
/// The file cannot be written.
pub fn write(folder: &Path, title: &str, figures: &[Figure]) -> Result<()> {
    rows::write(&folder.join(file_name(title)).with_extension("csv"), figures)
}

/// Reads the file of a family from `folder`.
///
/// # Errors
/// It is absent, or no such file.
pub fn read(folder: &Path, title: &str) -> Result<Vec<Figure>> {
    rows::read(&folder.join(file_name(title)).with_extension("csv"))
}

/// Five significant digits.
fn significant(value: f64) -> String {
    // The exponent of the rounded value: 0.999999 is written as 1.0000.
    let scientific = format!("{value:.4e}");
    let exponent = scientific.split_once('e').and_then(|(_, exponent)| exponent.parse::<i32>().ok()).unwrap_or(0);
    format!("{value:.*}", (4 - exponent).clamp(0, 12) as usize)
}

fn percent(error: f64) -> String {
    if error.abs() < 5e-6 {
        "0.000".into()
    } else if error.abs() < 1e-3 {
        format!("{:+.3}", 100.0 * error)
    } else {
        format!("{:+.2}", 100.0 * error)
    }
}

/// The least power of ten that is not exceeded: figures of round-off have no digits to show.
fn decade(error: f64) -> String {
    if error == 0.0 { "0".into() } else { format!("1e{}", error.abs().log10().ceil() as i32) }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn figures_are_written_with_five_digits_and_errors_in_percent() {
        assert_eq!(
            [significant(32.748_526), significant(0.301_72), significant(-3444.04)],
            ["32.749", "0.30172", "-3444.0"]
        );
        assert_eq!([percent(-0.0123), percent(2e-4), percent(1e-7)], ["-1.23", "+0.020", "0.000"]);
        assert_eq!([decade(3e-13), decade(0.0)], ["1e-12", "0"]);
    }

    #[test]
    fn a_figure_beyond_its_limit_is_missed_and_survives_its_file() {
        let check = |ours| Check {
            case: "F / Gc w".into(),
            reference: 1.0,
            ours,
            limit: Some(0.05),
            residual: Some(3e-6),
            source: "Griffith 1921",
        };
        let family = Family { title: "Steady cuts", checks: vec![check(1.01), check(0.94)], ..Family::default() };
        let found = figures(&family);
        assert_eq!([found[0].verdict, found[1].verdict], [Verdict::Met, Verdict::Missed]);
        assert!(found[1].of_limit().expect("it has a limit") > 1.0);
        let folder = std::env::temp_dir().join(format!("kerf-verification-{}", std::process::id()));
        fs::create_dir_all(&folder).expect("a folder for temporary files");
        write(&folder, family.title, &found).expect("written");
        assert_eq!(read(&folder, family.title).expect("read"), found);
        fs::remove_dir_all(&folder).expect("removed");
    }
}
