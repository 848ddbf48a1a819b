//! What a run found, as CSV files: the page is written from them. Without times, so that a run with the same seed writes
//! the same bytes.

use std::path::Path;

use anyhow::Result;
use serde::{Deserialize, Serialize};

use super::Row;
use super::refusals::Refusal;
use super::verdict::REFUSED;
use crate::rows::{read, write, write_commit};

/// A case of the matrix; cells are text, empty where nothing was measured.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Case {
    /// Title of its family.
    pub family: String,
    /// Its name.
    pub case: String,
    /// E in Pa, rho in kg/m^3, dt in s, h (voxel) in m, k voxels to an element's edge, c the strain stiffening.
    pub values: String,
    /// Steps taken.
    pub steps: String,
    /// `yes` or `no`.
    pub finite: String,
    /// Energy put in, J.
    pub put_in_j: String,
    /// Stored energy at most, over that put in.
    pub stored: String,
    /// Stored energy beyond the start's plus the net work, at most, over that put in.
    pub made: String,
    /// What the ledger leaves unexplained, over the energy put in.
    pub residual: String,
    /// Kinetic energy at rest over the energy put in.
    pub rest_kinetic: String,
    /// Periods of the slowest vibration after letting go.
    pub rest_periods: String,
    /// Farthest node from its place, in voxels.
    pub off_voxels: String,
    /// Iterations of the median step.
    pub iterations_median: String,
    /// Iterations of the worst step.
    pub iterations_most: String,
    /// Steps above the solver's tolerance.
    pub unconverged_steps: String,
    /// Steps rolled back.
    pub rolled_back: String,
    /// Links that parted.
    pub links_parted: String,
    /// What was asked and not done; empty: the case holds.
    pub finding: String,
}

impl Case {
    /// Whether all that is asked was done.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.finding.is_empty()
    }

    /// Why there was no first step, where its scene was refused.
    #[must_use]
    pub fn refusal(&self) -> Option<&str> {
        self.finding.strip_prefix(REFUSED)
    }
}

impl From<&Row> for Case {
    fn from(row: &Row) -> Self {
        let finding = row.findings.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ");
        let case = Self {
            family: row.family.title().into(),
            case: row.name.clone(),
            values: row.parameters.clone(),
            finding,
            ..Self::default()
        };
        let Some(seen) = &row.seen else { return case };
        let rest = seen.rest.as_ref();
        Self {
            steps: seen.steps.to_string(),
            finite: if seen.finite { "yes" } else { "no" }.into(),
            put_in_j: format!("{:.1e}", seen.put_in_j),
            stored: format!("{:.2e}", seen.stored_of_put_in),
            made: format!("{:.1e}", seen.made_of_put_in),
            residual: format!("{:.1e}", seen.residual_of_put_in),
            rest_kinetic: rest.map_or_else(String::new, |r| format!("{:.1e}", r.kinetic_of_put_in)),
            rest_periods: rest.map_or_else(String::new, |r| {
                if r.periods < 1e3 { format!("{:.1}", r.periods) } else { format!("{:.0e}", r.periods) }
            }),
            off_voxels: rest.and_then(|r| r.left_voxels).map_or_else(String::new, |left| format!("{left:.1e}")),
            iterations_median: seen.iterations[0].to_string(),
            iterations_most: seen.iterations[1].to_string(),
            unconverged_steps: seen.unconverged_steps.to_string(),
            rolled_back: seen.faults.to_string(),
            links_parted: seen.parted_links.to_string(),
            ..case
        }
    }
}

/// A value out of its range.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Refused {
    /// What was said of it when the scene was loaded.
    pub said: String,
    /// Whether that names the field and its limit: `yes` or `no`.
    pub names_field_and_limit: String,
}

impl From<&Refusal> for Refused {
    fn from(refusal: &Refusal) -> Self {
        let holds = if refusal.holds() { "yes" } else { "no" };
        Self { said: refusal.said.join("; "), names_field_and_limit: holds.into() }
    }
}

/// A property that holds for inputs chosen at random.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Property {
    /// What is said of every input.
    pub property: String,
    /// How many were tried.
    pub inputs: u32,
    /// `holds`, or the smallest input that fails.
    pub verdict: String,
}

/// All files of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Tables {
    /// `cases.csv`.
    pub cases: Vec<Case>,
    /// `refusals.csv`.
    pub refusals: Vec<Refused>,
    /// `properties.csv`.
    pub properties: Vec<Property>,
}

impl Tables {
    /// Writes the files into `folder`.
    ///
    /// # Errors
    /// One cannot be written.
    pub fn write(&self, folder: &Path) -> Result<()> {
        write(&folder.join("cases.csv"), &self.cases)?;
        write(&folder.join("refusals.csv"), &self.refusals)?;
        write(&folder.join("properties.csv"), &self.properties)?;
        write_commit(folder)
    }

    /// Reads the files of `folder`.
    ///
    /// # Errors
    /// One is absent or no such file.
    pub fn read(folder: &Path) -> Result<Self> {
        Ok(Self {
            cases: read(&folder.join("cases.csv"))?,
            refusals: read(&folder.join("refusals.csv"))?,
            properties: read(&folder.join("properties.csv"))?,
        })
    }
}
