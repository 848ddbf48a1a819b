//! Numerical parameters of a step, with their defaults and reasons.

use serde::{Deserialize, Serialize};

/// Parameters of the step that are not properties of the material.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StepParams {
    /// Time step, s.
    pub dt_s: f64,
    /// Residual at which the velocity solve ends, over the right side or, if that is larger, the
    /// impulses of loads and contacts whose balance it is. Default: [`crate::SceneDesc::relative_tolerance`].
    pub relative_tolerance: f64,
    /// Iterations after which a solve ends whatever its residual. Default 200.
    pub max_iterations: u32,
}
