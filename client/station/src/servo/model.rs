//! The local model of the contact that the servo evaluates.

use kerf_script::Pose;
use nalgebra::{Matrix3, Vector3};

/// What the server said last.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Update {
    /// Rises with each contact that comes in.
    pub number: u64,
    /// The contact; `None`: nothing is touched.
    pub model: Option<LocalModel>,
    /// From a pose's sending to the arrival of the first contact that reflects it, s; smoothed.
    pub round_trip_s: f64,
}

/// Force on the tool near a pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalModel {
    /// Pose of the tool that `force_n` belongs to.
    pub reference: Pose,
    /// Force on the tool there, N.
    pub force_n: Vector3<f64>,
    /// Force lost per metre that the tool moves, N/m.
    pub stiffness_n_per_m: Matrix3<f64>,
    /// Force lost per radian that the tool turns, N/rad.
    pub turning_n_per_rad: Matrix3<f64>,
    /// Force lost per speed of the tool, N s/m.
    pub damping_n_s_per_m: Matrix3<f64>,
    /// While cutting: most of the force along a direction.
    pub cap: Option<Cap>,
    /// Distance from the reference within which the model holds, m.
    pub validity_radius_m: f64,
}

/// Most of a force along a direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cap {
    /// The most, N.
    pub force_n: f64,
    /// The direction.
    pub direction: Vector3<f64>,
}
