//! The command line.

use std::path::PathBuf;

use clap::{ArgGroup, Args as ClapArgs, Parser, ValueEnum};
use kerf_access::Access;
use kerf_proto::v1::create_session_request::Dial;

use crate::limits::LimitArgs;
use crate::script::strokes::StrokeParams;

/// Fastest rate of poses: what haptic devices are read at.
const MAX_RATE_HZ: f64 = 1000.0;
/// Most sessions: each has threads of its own here.
const MAX_SESSIONS: u32 = 256;
/// Most viewers of a session: each keeps a replica and checks it, on one thread.
const MAX_VIEWERS: u32 = 64;

/// Drives tools of Kerf sessions by a script, watches the sessions, and reports on both.
#[derive(Clone, Debug, Parser)]
#[command(name = "kerf-load", version)]
#[command(group(ArgGroup::new("what").required(true).args(["scene", "session"])))]
pub struct Args {
    /// Address of the server
    #[arg(long, env = "KERF_SERVER", default_value = "http://127.0.0.1:50051")]
    pub server: String,
    /// What the server asks for
    #[command(flatten)]
    pub access: Access,
    /// How long to wait for a server that is still starting, s
    #[arg(long, default_value_t = 0.0)]
    pub wait_for_server: f64,
    /// Creates a session of this scene, a name the server knows or a path to a scene file, and
    /// closes it at the end
    #[arg(long)]
    pub scene: Option<String>,
    /// Joins this session
    #[arg(long)]
    pub session: Option<String>,
    /// What is asked of the dial of a created session
    #[command(flatten)]
    pub dial: DialArgs,
    /// Step rates to choose from, Hz, highest first: the session runs at the first one that the server keeps
    /// while a trial session of the script's first seconds is driven; a single one is taken without a trial
    #[arg(long, value_name = "HZ,...", value_delimiter = ',', value_parser = positive, conflicts_with = "session")]
    pub step_rates: Vec<f64>,
    /// Levels to choose from, finest first: where none of the step rates is kept at one, the next is tried
    #[arg(long, value_name = "LEVEL,...", value_delimiter = ',', requires = "step_rates", conflicts_with = "DialArgs")]
    pub levels: Vec<u32>,
    /// Leaves a created session running
    #[arg(long, conflicts_with = "session")]
    pub keep_session: bool,
    /// What the tool does: `strokes`, or the path of a CSV file with the header
    /// `time_s,tool,x_m,y_m,z_m,qx,qy,qz,qw`
    #[arg(long, default_value = "strokes")]
    pub script: PathBuf,
    /// Tool that the strokes are made with, by name or index
    #[arg(long, default_value = "0")]
    pub tool: String,
    /// Parameters of the strokes
    #[command(flatten)]
    pub strokes: StrokeArgs,
    /// Poses a second, Hz
    #[arg(long, default_value_t = 250.0, value_parser = rate_hz)]
    pub rate: f64,
    /// Contacts a second, Hz; the rate of the poses by default
    #[arg(long, value_parser = rate_hz)]
    pub contact_rate: Option<f64>,
    /// Ends the script after this time, s
    #[arg(long, value_parser = positive)]
    pub duration: Option<f64>,
    /// Sessions of the scene that are created; what the server refuses is reported
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_SESSIONS)), conflicts_with = "session",
        default_value_t = 1)]
    pub sessions: u32,
    /// Sessions that are driven, each by strokes of its own; the others are only watched. All by default
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_SESSIONS)), conflicts_with = "session")]
    pub stations: Option<u32>,
    /// Viewers of each session, each with a replica of its own; the first one's is written at the end
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_VIEWERS)))]
    pub viewers: u32,
    /// States a second and viewer, Hz
    #[arg(long, default_value_t = 60.0, value_parser = rate_hz)]
    pub view_rate: f64,
    /// Writes the report to this file
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Leaves report, forces, plot and surface in this directory
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Whether progress is shown
    #[arg(long, default_value = "auto")]
    pub progress: ProgressMode,
    /// Limits; when one is exceeded the exit code is 3
    #[command(flatten)]
    pub limits: LimitArgs,
}

/// What is asked of the dial from fast to exact.
#[derive(Clone, Copy, Debug, Default, ClapArgs)]
#[group(multiple = false, conflicts_with = "session")]
pub struct DialArgs {
    /// Level of every object, 0 (exact) to 4
    #[arg(long)]
    pub level: Option<u32>,
    /// The most exact measured setting whose steps take at most this long in the median, ms
    #[arg(long, value_name = "MS", value_parser = positive)]
    pub budget_ms: Option<f64>,
    /// The cheapest measured setting that errs by at most this, relative to the reference solution
    #[arg(long, value_name = "ERROR", value_parser = positive)]
    pub max_error: Option<f64>,
}

impl DialArgs {
    /// As the server takes it.
    #[must_use]
    pub fn asked(&self) -> Option<Dial> {
        let level = self.level.map(Dial::Level);
        level.or(self.budget_ms.map(Dial::BudgetMs)).or(self.max_error.map(Dial::MaxError))
    }
}

/// How progress is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ProgressMode {
    /// A live line on a terminal, a line a second otherwise.
    Auto,
    /// Not at all.
    Off,
}

/// Parameters of the strokes.
#[derive(Clone, Debug, ClapArgs)]
pub struct StrokeArgs {
    /// Seed of the strokes' places and angles
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Number of strokes
    #[arg(long, default_value_t = 2)]
    pub strokes: u32,
    /// Depth of each stroke below the undeformed surface, m; half the local thickness by default
    #[arg(long)]
    pub depth: Option<f64>,
    /// Speed of the strokes, m/s
    #[arg(long, default_value_t = 0.02)]
    pub speed: f64,
    /// Speed between strokes, m/s
    #[arg(long, default_value_t = 0.1)]
    pub travel_speed: f64,
    /// Height above the surface at which strokes begin and end, m
    #[arg(long, default_value_t = 0.005)]
    pub clearance: f64,
    /// How long the blade rests at the bottom of a stroke, s
    #[arg(long, default_value_t = 0.2)]
    pub hold: f64,
    /// Random fraction of the strokes' places and angles, 0 to 1
    #[arg(long, default_value_t = 0.3)]
    pub jitter: f64,
}

impl StrokeArgs {
    /// As the script generator takes them.
    #[must_use]
    pub fn params(&self) -> StrokeParams {
        StrokeParams {
            seed: self.seed,
            strokes: self.strokes,
            depth_m: self.depth,
            cut_speed_m_per_s: self.speed,
            travel_speed_m_per_s: self.travel_speed,
            clearance_m: self.clearance,
            hold_s: self.hold,
            jitter: self.jitter,
        }
    }
}

fn positive(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    if value.is_finite() && value > 0.0 { Ok(value) } else { Err("has to be above 0".to_owned()) }
}

fn rate_hz(text: &str) -> Result<f64, String> {
    let value = positive(text)?;
    if value <= MAX_RATE_HZ { Ok(value) } else { Err(format!("has to be at most {MAX_RATE_HZ} Hz")) }
}
