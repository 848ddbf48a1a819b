//! Tools: their pose and their shape.

pub(crate) mod blade;
pub(crate) mod capsule;
pub(crate) mod edge;
pub(crate) mod flanks;
pub(crate) mod frame;
pub(crate) mod grasper;
mod pose;
pub(crate) mod scissors;

use crate::scene::{SceneError, ToolShapeDesc};
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
    /// The tool that a scene describes.
    ///
    /// # Errors
    /// An edge that is none.
    pub fn new(desc: &ToolShapeDesc) -> Result<Self, SceneError> {
        Ok(match desc {
            ToolShapeDesc::Blade(blade) => Self::Blade(Blade::new(blade).map_err(|e| e.within("blade"))?),
            ToolShapeDesc::Grasper(grasper) => Self::Grasper(grasper.into()),
            ToolShapeDesc::Probe(capsule) => Self::Probe(capsule.into()),
            ToolShapeDesc::Scissors(desc) => Self::Scissors(Scissors::new(desc).map_err(|e| e.within("scissors"))?),
        })
    }

    /// Distance from a pose within which the contact there is about the same, m: a twentieth of the size.
    #[must_use]
    pub fn validity_radius_m(&self) -> f64 {
        0.05 * match self {
            Self::Blade(blade) | Self::Scissors(Scissors { blade, .. }) => blade.edge.length_m(),
            Self::Grasper(grasper) => 2.0 * grasper.radius_m,
            Self::Probe(capsule) => 2.0 * capsule.radius_m,
        }
    }

    /// Stiffness against displacement and against turning with which a tool is felt to be held, over that
    /// of its `springs` contact springs: what the tissue gives in series. A blade's springs stand for the
    /// tissue themselves; see [`grasper::FELT_SHARES`], [`capsule::felt_share`].
    #[must_use]
    pub(crate) fn felt_shares(&self, springs: u32) -> [f64; 2] {
        match self {
            Self::Blade(_) | Self::Scissors(_) => [1.0; 2],
            Self::Grasper(_) => grasper::FELT_SHARES,
            Self::Probe(_) => [capsule::felt_share(springs); 2],
        }
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
