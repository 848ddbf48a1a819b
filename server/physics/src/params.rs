//! Numerical parameters of a step, with their defaults and reasons.

/// Parameters of the step that are not properties of the material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepParams {
    /// Time step, s.
    pub dt_s: f64,
    /// Relative residual at which the velocity solve ends. Default 1e-3: the force on the tool is
    /// then within 1e-4 of the converged one.
    pub relative_tolerance: f64,
    /// Iterations after which a solve ends whatever its residual. Default 200.
    pub max_iterations: u32,
}
