//! Tools: blades, graspers, probes and scissors.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::EdgeDesc;

/// A tool that may enter the scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ToolDesc {
    /// Name, unique among the tools.
    pub name: String,
    /// Its shape.
    pub shape: ToolShapeDesc,
}

impl ToolDesc {
    /// A tool that is a blade.
    #[must_use]
    pub fn blade(name: &str, blade: BladeDesc) -> Self {
        Self { name: name.into(), shape: ToolShapeDesc::Blade(blade) }
    }

    /// A tool that is a grasper.
    #[must_use]
    pub fn grasper(name: &str, grasper: GrasperDesc) -> Self {
        Self { name: name.into(), shape: ToolShapeDesc::Grasper(grasper) }
    }

    /// A tool that presses with a smooth surface.
    #[must_use]
    pub fn probe(name: &str, capsule: CapsuleDesc) -> Self {
        Self { name: name.into(), shape: ToolShapeDesc::Probe(capsule) }
    }

    /// A tool that cuts between two edges.
    #[must_use]
    pub fn scissors(name: &str, scissors: ScissorsDesc) -> Self {
        Self { name: name.into(), shape: ToolShapeDesc::Scissors(scissors) }
    }
}

/// The shape of a tool.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ToolShapeDesc {
    /// Cuts with its edge.
    Blade(BladeDesc),
    /// Holds what its jaws close on.
    Grasper(GrasperDesc),
    /// Presses with a smooth surface.
    Probe(CapsuleDesc),
    /// Cuts between two edges that pivot.
    Scissors(ScissorsDesc),
}

impl ToolShapeDesc {
    /// What a scene file calls it.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Blade(_) => "blade",
            Self::Grasper(_) => "grasper",
            Self::Probe(_) => "probe",
            Self::Scissors(_) => "scissors",
        }
    }

    /// The handle that tissue presses on, if it has one.
    #[must_use]
    pub fn handle(&self) -> Option<&CapsuleDesc> {
        match self {
            Self::Blade(blade) => blade.handle.as_ref(),
            Self::Grasper(grasper) => grasper.handle.as_ref(),
            Self::Probe(_) => None,
            Self::Scissors(scissors) => scissors.handle.as_ref(),
        }
    }
}

/// A blade.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BladeDesc {
    /// How far the edge reaches along x, m: the length of a straight one.
    pub width_m: f64,
    /// Height of the flanks above the edge, m. They are the area that the edge sweeps in +y.
    pub height_m: f64,
    /// Shape of the edge. Default: straight.
    #[serde(default)]
    pub edge: EdgeDesc,
    /// Half-width of the edge, m: the contact's length scale. Default 5e-5: a kitchen knife in use.
    #[serde(default = "default_edge_half_width_m")]
    pub edge_half_width_m: f64,
    /// Thickness of the blade behind its edge, m. Default 0: flanks without volume.
    #[serde(default)]
    pub thickness_m: f64,
    /// Angle between the two flanks at the edge, rad, 0.01 to 2: the thickness grows from nothing at the
    /// edge to `thickness_m`, which is then above 0. Default: it is there from the edge on.
    #[serde(default)]
    pub wedge_angle_rad: Option<f64>,
    /// Coefficient of the Coulomb friction between the flanks and the walls of the cut, 0.001 to 2.
    /// Default: they slide freely.
    #[serde(default)]
    pub flank_friction: Option<f64>,
    /// Whether the two ends of the edge cut too, up to the spine: those of a blade that is drawn along its edge. Default:
    /// they do.
    // Not written where it is as it was before there was a choice: Pareto fronts know their scenes by their text.
    #[serde(default = "default_sharp_ends", skip_serializing_if = "Clone::clone")]
    pub sharp_ends: bool,
    /// Its handle, which tissue presses on as on a probe. It goes on from the highest point of the spine along the tool's y
    /// axis. Default: nothing behind the spine touches.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub handle: Option<CapsuleDesc>,
}

impl BladeDesc {
    /// A straight blade with every default.
    #[must_use]
    pub fn straight(width_m: f64, height_m: f64) -> Self {
        Self {
            width_m,
            height_m,
            edge: EdgeDesc::Straight,
            edge_half_width_m: default_edge_half_width_m(),
            thickness_m: 0.0,
            wedge_angle_rad: None,
            flank_friction: None,
            sharp_ends: default_sharp_ends(),
            handle: None,
        }
    }
}

fn default_sharp_ends() -> bool {
    true
}

fn default_edge_half_width_m() -> f64 {
    5e-5
}

/// A grasper: jaws that take hold of the tissue around the tool's reference point as they close, and keep
/// it where it is relative to the tool until they open.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GrasperDesc {
    /// Radius around the reference point within which the jaws take hold, m, 1e-4 to 0.1.
    pub radius_m: f64,
    /// Force on the tool above which the grasped tissue slips out, N, 1e-6 to 1e6. Default: 250 kPa, or half the Young's
    /// modulus of the scene's stiffest material where that is more, over the jaws' area, pi radius_m^2.
    #[serde(default)]
    pub max_force_n: Option<f64>,
    /// Its handle, as a blade's. It goes on along the tool's y axis from three radii above the reference point, where jaws of
    /// that reach have their pivot. Default: only the jaws touch.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub handle: Option<CapsuleDesc>,
}

/// Mean traction above which tissue slips out of jaws or is crushed, Pa. Ours: the order of the pressures of jaws that injure
/// grasped liver at once (S. De et al., Int. J. Robotics Research 26, 2007).
const MAX_JAW_TRACTION_PA: f64 = 250e3;
/// The same over the Young's modulus of what is stiffer than tissue: jaws are made for what they hold. Ours.
const MAX_JAW_STRAIN: f64 = 0.5;

impl GrasperDesc {
    /// A grasper with every default.
    #[must_use]
    pub fn new(radius_m: f64) -> Self {
        Self { radius_m, max_force_n: None, handle: None }
    }

    /// Force on the tool above which what it holds slips out, N; `stiffest_pa` is the largest Young's modulus of its scene.
    #[must_use]
    pub fn slips_above_n(&self, stiffest_pa: f64) -> f64 {
        let area_m2 = std::f64::consts::PI * self.radius_m.powi(2);
        self.max_force_n.unwrap_or_else(|| MAX_JAW_TRACTION_PA.max(MAX_JAW_STRAIN * stiffest_pa) * area_m2)
    }
}

/// A smooth, blunt surface: all points within a radius of a segment. A probe's segment is of the tool's x axis, about its
/// origin. It presses, rubs by the material's `friction_coefficient`, and cuts nothing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CapsuleDesc {
    /// Radius, m, 1e-4 to 1; at least two voxels of every object.
    pub radius_m: f64,
    /// Length of the segment, m, 0 to 10. Default 0: a sphere.
    #[serde(default)]
    pub length_m: f64,
}

/// Two straight blades on a pivot, which is the tool's reference point: +x runs from there along the closed
/// blades to their tips, the pivot's axis is z. Closing cuts the tissue between them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ScissorsDesc {
    /// Length of either edge from the pivot to its tip, m, 1e-4 to 10.
    pub blade_length_m: f64,
    /// Height of the flanks behind the edges, m, 1e-4 to 10.
    pub blade_height_m: f64,
    /// Angle between the edges where they are fully open, rad, 0.1 to 2. Default 0.7: 40 degrees.
    #[serde(default = "default_max_angle_rad")]
    pub max_angle_rad: f64,
    /// Half-width of the edges, m, 1e-8 to 1e-2. Default 5e-5, as a blade's.
    #[serde(default = "default_edge_half_width_m")]
    pub edge_half_width_m: f64,
    /// Thickness behind the edges, m, 0 to 0.1. Default 0: flanks without volume.
    #[serde(default)]
    pub thickness_m: f64,
    /// Their handle, as a blade's. It goes on from the pivot along -x. Default: only the blades touch.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub handle: Option<CapsuleDesc>,
}

impl ScissorsDesc {
    /// Scissors with every default.
    #[must_use]
    pub fn new(blade_length_m: f64, blade_height_m: f64) -> Self {
        Self {
            blade_length_m,
            blade_height_m,
            max_angle_rad: default_max_angle_rad(),
            edge_half_width_m: default_edge_half_width_m(),
            thickness_m: 0.0,
            handle: None,
        }
    }
}

fn default_max_angle_rad() -> f64 {
    0.7
}
