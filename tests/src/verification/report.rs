//! The index of the tables: how each family is set up and measured, where its figures stand, and its plots.

use std::fmt::Write;

use super::tables::file_name;
use super::{Family, Series, Study};

const HEADER: &str = "# Verification: tables

Written by `make verify`. [The page](../../explanation/verification.md) explains these figures. This page has
their set-up and a CSV file for each family of cases. Figures are deterministic: a re-run writes the same bytes.

| column | content |
|---|---|
| `case`, `mesh` | the measured quantity, and the mesh where the case does not name it |
| `compared` | `relative`: the error is relative to the reference; `zero`: the reference is zero and the figure an upper bound, a power of ten; `at_most`: the reference must not be exceeded |
| `reference`, `unit`, `measured` | both in the same unit; ratios have none |
| `error_percent`, `limit_percent` | relative error and the largest allowed; empty where there is none |
| `residual_below` | upper bound of the ledger's residual over the tool's work; more than 1 % misses the limit |
| `verdict` | `met`, `missed` or `no_limit` |
| `source` | where the reference is from |

`k` is the number of voxels along the edge of a composite element, `h` the edge of a voxel, `H = k h` that of an element.
Static cases are solved to a correction of 1e-7 of the displacement. Orders of convergence are those of the three finest
meshes; \"not asymptotic\" means that the error changes its sign there or is no power of the size. A coarse part of each
family runs in `make test` (`tests/tests/verification.rs`).
";

/// The index; files and plots lie beside it.
#[must_use]
pub fn index(families: &[Family]) -> String {
    let mut text = String::from(HEADER);
    for family in families {
        // Writing to a string does not fail.
        let _ =
            writeln!(text, "\n## {0}\n\n[{1}.csv]({1}.csv)\n\n{2}", family.title, file_name(family.title), family.text);
        family.studies.iter().for_each(|study| write_study(&mut text, study));
        for figure in &family.figures {
            let _ = writeln!(text, "\n![{}]({}.png)", figure.title, figure.file);
        }
    }
    text
}

fn write_study(text: &mut String, study: &Study) {
    let orders: Vec<String> = study.series.iter().map(Series::summary).collect();
    let _ = writeln!(text, "\n{}. Error of the {}; {}.", study.title, study.error_of, orders.join(", "));
    let _ = writeln!(text, "\n![{}](verification-{}.png)", study.title, study.file);
}
