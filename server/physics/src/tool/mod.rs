//! Tools: their pose and their shape.

pub(crate) mod blade;
pub(crate) mod capsule;
pub(crate) mod edge;
pub(crate) mod flanks;
pub(crate) mod frame;
pub(crate) mod grasper;
pub(crate) mod part;
mod pose;
pub(crate) mod scissors;

use crate::scene::{SceneError, ToolShapeDesc};
use crate::{Mat3, Vec3};
use blade::Blade;
use capsule::Capsule;
use grasper::Grasper;
use scissors::Scissors;

pub use pose::{OPEN, Pose, PoseError};

/// What a tool is.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum ToolShape {
    /// Cuts with its edge.
    Blade(Blade),
    /// Holds what its jaws close on.
    Grasper(Grasper),
    /// Presses with a smooth surface.
    Probe(Capsule),
    /// Cuts between two edges.
    Scissors(Scissors),
}

impl ToolShape {
    /// The tool that a scene describes whose stiffest material has this Young's modulus.
    ///
    /// # Errors
    /// An edge that is none.
    pub fn new(desc: &ToolShapeDesc, stiffest_pa: f64) -> Result<Self, SceneError> {
        Ok(match desc {
            ToolShapeDesc::Blade(blade) => Self::Blade(Blade::new(blade)?),
            ToolShapeDesc::Grasper(grasper) => Self::Grasper(Grasper::new(grasper, stiffest_pa)),
            ToolShapeDesc::Probe(capsule) => Self::Probe(capsule.into()),
            ToolShapeDesc::Scissors(desc) => Self::Scissors(Scissors::new(desc)?),
        })
    }

    /// How large the part of it is that touches, m.
    #[must_use]
    pub(crate) fn size_m(&self) -> f64 {
        match self {
            Self::Blade(blade) | Self::Scissors(Scissors { blade, .. }) => blade.edge.length_m(),
            Self::Grasper(grasper) => 2.0 * grasper.radius_m,
            Self::Probe(capsule) => 2.0 * capsule.radius_m,
        }
    }

    /// How its normal at a point of a round surface turns as tissue slides along it, scene frame: the centre that it
    /// turns about, m, and the change of the normal over the way, 1/m. `None` where it is flat or sharp.
    #[must_use]
    pub(crate) fn turning(&self, pose: &Pose, surface_m: &Vec3) -> Option<(Vec3, Mat3)> {
        let Self::Probe(capsule) = self else { return None };
        let (centre_m, per_m) = capsule.turning(&pose.to_local(surface_m));
        let turn = pose.orientation.to_rotation_matrix();
        Some((pose.transform(&centre_m), turn.matrix() * per_m * turn.matrix().transpose()))
    }

    /// Whether it pulls at tissue as it pushes.
    #[must_use]
    pub(crate) fn pulls(&self) -> bool {
        matches!(self, Self::Grasper(_))
    }

    /// Whether what it cuts presses back along the one direction of [`frame::BladeFrame::forward`].
    #[must_use]
    pub(crate) fn cuts_forward(&self) -> bool {
        matches!(self, Self::Blade(_))
    }

    /// Radius of the smooth surface that it presses with, if it has one, m.
    pub(crate) fn smooth_radius_m(&self) -> Option<f64> {
        if let Self::Probe(capsule) = self { Some(capsule.radius_m) } else { None }
    }

    /// Force on the tool above which it loses its hold, N.
    #[must_use]
    pub(crate) fn max_hold_n(&self) -> f64 {
        match self {
            Self::Blade(_) | Self::Scissors(_) | Self::Probe(_) => f64::INFINITY,
            Self::Grasper(grasper) => grasper.max_force_n,
        }
    }
}

/// How a tool that is in the scene moves in a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ToolPath {
    /// Pose at t; equal to `pose` where it has just entered.
    pub before: Pose,
    /// Pose at t + dt.
    pub pose: Pose,
    /// Fraction of their full opening that jaws take at t; equal to `opening` where it has just entered.
    pub opening_before: f64,
    /// Fraction of their full opening that jaws take at t + dt.
    pub opening: f64,
    /// It was put down at `pose` in this step.
    pub entered: bool,
}

impl ToolPath {
    /// Whether it stays where and as it was.
    #[must_use]
    pub fn rests(&self) -> bool {
        !self.entered && self.before == self.pose && self.opening_before == self.opening
    }
}
