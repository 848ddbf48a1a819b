//! What a sweep is asked for.

use std::path::PathBuf;

use clap::Args;

use super::sweep::Axes;
use crate::scene_args::WarningArgs;

/// Options of a sweep.
#[derive(Args, Clone, Debug)]
pub struct Options {
    /// Name of a built-in scene, or path of a scene's TOML file.
    pub scene: String,
    /// Poses over time, as for `simulate`. Default: its stroke.
    #[arg(long, value_name = "FILE.csv")]
    pub script: Option<PathBuf>,
    /// Simulated time, s. Default: the script's length and 0.2 s; 0.5 s where nothing moves a tool.
    #[arg(long, value_name = "S")]
    pub duration: Option<f64>,
    /// Values of each axis.
    #[command(flatten)]
    pub axes: Axes,
    /// Points of the surface that are compared.
    #[arg(long, value_name = "N", default_value_t = 240, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub points: u32,
    /// Times at which they are compared.
    #[arg(long, value_name = "N", default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub samples: u32,
    /// Threads lent to the steps that are timed; the reference has all of the machine.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=256))]
    pub threads: u16,
    /// Time that the reference may take, s: the finest one that a pilot says will fit is taken. One that
    /// stands in the folder is kept.
    #[arg(long, value_name = "S", default_value_t = 1200.0)]
    pub reference_budget_s: f64,
    /// Times the runs in the folder again, each from where the tool touches and for at most so many seconds,
    /// and keeps their errors.
    #[arg(long, value_name = "S", num_args = 0..=1, default_missing_value = "10")]
    pub retime: Option<f64>,
    /// What warnings do.
    #[command(flatten)]
    pub warnings: WarningArgs,
    /// Folder for runs/, pareto.csv, pareto.md, pareto.svg and pareto.png, and profile.svg and profile.png
    /// where no tool moves.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}
