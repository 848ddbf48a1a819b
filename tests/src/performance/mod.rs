//! What a step costs: the paper's tables with its columns beside ours, the breakdown of a run, how cost
//! grows with voxels, elements and threads, and what each capability of the liver's scene adds.
//!
//! A section is a function that runs its scenes and returns its text. The binary `performance` writes
//! them as a document; figures belong to the machine it names.

mod breakdown;
mod budget;
mod capabilities;
mod felt;
mod growth;
pub mod models;
mod paper;
mod run;
mod targets;

use std::path::Path;

use anyhow::Result;
use kerf_server::machine::hardware;

/// A section's function: runs what it shows, leaves its plots in a folder, returns its Markdown.
pub type SectionFn = fn(&Path) -> Result<String>;

/// Every section, in the order of the document.
pub const SECTIONS: [(&str, SectionFn); 8] = [
    ("targets", targets::section),
    ("the paper's tables", paper::section),
    ("breakdown", breakdown::section),
    ("capabilities", capabilities::section),
    ("a driver that feels", felt::section),
    ("a budget of work", budget::section),
    ("threads", growth::threads),
    ("growth", growth::section),
];

/// Head of the document: where and how its figures were taken.
#[must_use]
pub fn header() -> String {
    format!(
        "# Performance\n\nWritten by `make performance` on {}. Every figure is from that one run, in \
         which the machine had nothing else to do; times are of whole steps as the step's own clock has them, \
         medians unless said otherwise. Strokes are `kerf-server simulate`'s default: straight down through the \
         middle at 0.1 m/s, rest, and back. A viewer watches, so that the surface is kept up to date.\n",
        hardware()
    )
}
