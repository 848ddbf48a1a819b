//! The description of a scene: one TOML file, version 1.
//!
//! Each subject has its data and defaults in a file of its own; [`SceneDesc::from_toml`] reads a file, [`toughness`] says
//! what a material asks of its elements. Whether the values are within their limits is judged by who makes a world of them
//! (`kerf_physics::Scene::judge`).

mod color;
pub mod edge;
mod load;
mod material;
mod object;
mod parse;
mod shape;
pub mod text;
mod tool;
pub mod toughness;
pub mod wording;

pub use color::Color;
pub use edge::{EdgeDesc, MAX_EDGE_POINTS};
pub use load::{Face, LoadDesc};
pub use material::{MaterialDesc, PrestrainDesc, RateDesc, ViscosityDesc};
pub use object::{ElementKind, FinerDesc, FractureRule, ObjectDesc, RegionDesc, default_level};
pub use shape::{Meshes, PlacedMesh, ShapeDesc, Strays, TriangleMesh};
pub use tool::{BladeDesc, CapsuleDesc, GrasperDesc, ScissorsDesc, ToolDesc, ToolShapeDesc};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Version of the scene format that this crate reads.
pub const SCENE_VERSION: u32 = 1;

/// What is wrong with a scene.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
pub enum SceneError {
    /// A place of a file that is not the TOML of a scene, or has a value that is not supported.
    #[error("{file}:{line}:{column}: {field}: {message}")]
    InFile {
        /// The file's name as given.
        file: String,
        /// Line, from 1.
        line: usize,
        /// Column in characters, from 1.
        column: usize,
        /// Path of the field, as `objects[0].material`; `syntax` where the text is not TOML.
        field: String,
        /// What was found and what was expected.
        message: String,
    },
    /// A field of a scene that is no file, or is missing in it, has a value that is not supported.
    #[error("{field}: {message}")]
    Field {
        /// Path of the field, as `objects[0].material.poisson_ratio`.
        field: String,
        /// The value, the limit and the reason.
        message: String,
    },
}

/// Everything that is wrong with a scene, in the order of its fields; at least one thing.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneProblems(pub Vec<SceneError>);

impl std::error::Error for SceneProblems {}

impl std::fmt::Display for SceneProblems {
    /// A line for each.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let lines: Vec<String> = self.0.iter().map(ToString::to_string).collect();
        f.write_str(&lines.join("\n"))
    }
}

impl From<SceneError> for SceneProblems {
    fn from(problem: SceneError) -> Self {
        Self(vec![problem])
    }
}

impl SceneError {
    /// The same problem with its field taken to lie within `owner`.
    #[must_use]
    pub fn within(self, owner: &str) -> Self {
        match self {
            Self::Field { field, message } => Self::Field { field: format!("{owner}.{field}"), message },
            in_file @ Self::InFile { .. } => in_file,
        }
    }
}

/// A scene. Every number is in SI units, named in the field.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SceneDesc {
    /// Version of the format: 1.
    pub version: u32,
    /// Short name.
    pub name: String,
    /// One sentence for people. Default: empty.
    #[serde(default)]
    pub description: String,
    /// Steps per simulated second, Hz, 10 to 10,000. Default 1000: the rate at which hands are served.
    #[serde(default = "default_rate_hz")]
    pub rate_hz: f64,
    /// Gravity, m/s^2, scene frame. Default: none.
    #[serde(default)]
    pub gravity_m_per_s2: [f64; 3],
    /// The velocity solver. Default: see [`SolverDesc`].
    #[serde(default)]
    pub solver: SolverDesc,
    /// Asks for a setting of the dial by its cost or its error, instead of stating one. It is
    /// settled before a world is built. Default: the scene is taken as it is.
    #[serde(default)]
    pub dial: Option<DialDesc>,
    /// How far the solver's effort may be reduced so that a session keeps its deadlines. Default: to a residual of 0.03
    /// of the loads.
    #[serde(default)]
    pub governor: Option<GovernorDesc>,
    /// The soft bodies; at least one.
    pub objects: Vec<ObjectDesc>,
    /// The tools that may enter the scene. Default: none.
    #[serde(default)]
    pub tools: Vec<ToolDesc>,
    /// Points whose displacement is reported. Default: none.
    #[serde(default)]
    pub tracked_points: Vec<TrackedPointDesc>,
}

impl SceneDesc {
    /// A scene of these objects with every default, as a file that states nothing else makes it.
    #[must_use]
    pub fn of(name: &str, objects: Vec<ObjectDesc>) -> Self {
        Self {
            version: SCENE_VERSION,
            name: name.into(),
            description: String::new(),
            rate_hz: default_rate_hz(),
            gravity_m_per_s2: [0.0; 3],
            solver: SolverDesc::default(),
            dial: None,
            governor: None,
            objects,
            tools: Vec::new(),
            tracked_points: Vec::new(),
        }
    }

    /// Relative tolerance of the velocity solve: the stated one, or that of the rate.
    #[must_use]
    pub fn relative_tolerance(&self) -> f64 {
        let longer = 1000.0 / self.rate_hz;
        // Roots are rounded alike on every machine, powers are not.
        let by_rate = || (1e-3 * (longer * longer.sqrt()).sqrt()).clamp(1e-3, 1e-2);
        self.solver.relative_tolerance.unwrap_or_else(by_rate)
    }

    /// Largest Young's modulus of its materials, Pa.
    #[must_use]
    pub fn stiffest_pa(&self) -> f64 {
        let materials = self.objects.iter().flat_map(ObjectDesc::materials);
        materials.map(|material| material.young_modulus_pa).fold(0.0, f64::max)
    }

    /// Relative residual at which a velocity solve may end once a step has used up its work: the governor's bound, or
    /// 0.03.
    #[must_use]
    pub fn most_relative_residual(&self) -> f64 {
        let least = self.relative_tolerance();
        self.governor.map_or(least.max(MOST_RELATIVE_RESIDUAL), |governor| governor.max_relative_tolerance)
    }
}

/// Of the loads; where a scene states no bound. Ours: forces of the liver's stroke are then .2 % off, rms, where steps may do
/// the median of their work (docs/explanation/performance.md). Less gives up less time, more makes a cut begin earlier or later.
const MOST_RELATIVE_RESIDUAL: f64 = 0.03;

fn default_rate_hz() -> f64 {
    1000.0
}

/// The velocity solver of a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SolverDesc {
    /// Unbalanced force at which a solve ends, relative to the loads and contact forces. Default: by the rate,
    /// `1e-3 (1000 Hz / rate_hz)^(3/4)`, from 1e-3 to 1e-2. The force on a tool is then off by less than 1e-3 of its
    /// maximum: rms over a stroke through the liver at 60 to 1000 Hz, against a tolerance of 1e-6. Short steps need
    /// the lower tolerance: their errors add up over more of them.
    pub relative_tolerance: Option<f64>,
    /// Iterations after which a solve ends whatever its residual. Default 200: some twenty times
    /// what a warm-started solve takes.
    pub max_iterations: u32,
}

impl Default for SolverDesc {
    fn default() -> Self {
        Self { relative_tolerance: None, max_iterations: 200 }
    }
}

/// A wish for a setting of the dial.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DialDesc {
    /// This level for every object, 0 to 4.
    Level(u8),
    /// The most exact setting whose steps take at most this long in the median, ms.
    BudgetMs(f64),
    /// The cheapest setting that errs by at most this, relative to the reference solution.
    MaxError(f64),
}

impl std::fmt::Display for DialDesc {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Level(level) => write!(f, "level = {level}"),
            Self::BudgetMs(ms) => write!(f, "budget_ms = {ms}"),
            Self::MaxError(error) => write!(f, "max_error = {error}"),
        }
    }
}

/// Bounds of the accuracy that is given up so that a session keeps its deadlines.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GovernorDesc {
    /// Largest relative residual at which a solve may end, from the solver's own tolerance, which gives up nothing, to 0.5.
    pub max_relative_tolerance: f64,
}

/// A point whose displacement is reported.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TrackedPointDesc {
    /// Name, unique among the tracked points.
    pub name: String,
    /// Name of the object it belongs to.
    pub object: String,
    /// Material point, reference configuration, m.
    pub position_m: [f64; 3],
}
