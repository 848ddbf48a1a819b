//! Parts of tools: the tools of a scene, and what goes along with one of them.

use super::blade::Blade;
use super::pose::Pose;
use super::{ToolShape, capsule::Capsule};
use crate::scene::{CapsuleDesc, SceneError, ToolDesc};
use crate::{Quat, Vec3};
use nalgebra::Quaternion;
use std::f64::consts::FRAC_1_SQRT_2;

/// What touches tissue by itself.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ToolPart {
    /// What it is.
    pub shape: ToolShape,
    /// What carries it; none of a tool of the scene.
    pub carried: Option<Carried>,
}

/// How a part goes along with a tool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Carried {
    /// Index of the tool.
    pub by: usize,
    /// Frame of the part in the tool's.
    pub place: Pose,
}

impl ToolPart {
    /// Those of the tools of a scene whose stiffest material has this Young's modulus: the tools, then what they carry.
    ///
    /// # Errors
    /// An edge that is none.
    pub fn of(tools: &[ToolDesc], stiffest_pa: f64) -> Result<Vec<Self>, SceneError> {
        let (mut parts, mut carried) = (Vec::new(), Vec::new());
        for (by, tool) in tools.iter().enumerate() {
            let made = ToolShape::new(&tool.shape, stiffest_pa);
            let shape = made.map_err(|e| e.within(&format!("tools[{by}].shape.{}", tool.shape.kind())))?;
            carried.extend(tool.shape.handle().and_then(|desc| handle(by, &shape, desc)));
            parts.push(Self { shape, carried: None });
        }
        parts.append(&mut carried);
        Ok(parts)
    }
}

/// A tool's handle: its end touches the highest point of a blade's spine, the pivot of scissors or that of a grasper's jaws. A
/// probe has none.
fn handle(by: usize, shape: &ToolShape, desc: &CapsuleDesc) -> Option<ToolPart> {
    let capsule = Capsule::from(desc);
    let reach_m = capsule.radius_m + capsule.half_length_m;
    let place = match shape {
        ToolShape::Scissors(_) => Pose { position_m: -Vec3::x() * reach_m, ..Pose::default() },
        ToolShape::Blade(blade) => upwards(highest_m(blade) + reach_m),
        ToolShape::Grasper(grasper) => upwards(grasper.pivot_m() + reach_m),
        ToolShape::Probe(_) => return None,
    };
    Some(ToolPart { shape: ToolShape::Probe(capsule), carried: Some(Carried { by, place }) })
}

/// The place of a capsule along the tool's y axis, its middle at this height.
fn upwards(middle_m: f64) -> Pose {
    // A quarter of a turn about z: from the capsule's x to the tool's y.
    let orientation = Quat::new_unchecked(Quaternion::new(FRAC_1_SQRT_2, 0.0, 0.0, FRAC_1_SQRT_2));
    Pose { position_m: Vec3::y() * middle_m, orientation }
}

/// Height of the highest point of a blade's spine, m.
fn highest_m(blade: &Blade) -> f64 {
    blade.edge.points_m().iter().map(|at| at.y).fold(f64::NEG_INFINITY, f64::max) + blade.flanks.height_m()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{BladeDesc, EdgeDesc};

    #[test]
    fn a_handle_goes_on_from_the_highest_point_of_the_spine() {
        let edge = EdgeDesc::Arc { sagitta_m: 0.004 };
        let handle = Some(CapsuleDesc { radius_m: 0.005, length_m: 0.1 });
        let blade = ToolDesc::blade("blade", BladeDesc { edge, handle, ..BladeDesc::straight(0.04, 0.01) });
        let probe = ToolDesc::probe("probe", CapsuleDesc { radius_m: 0.01, length_m: 0.0 });
        let parts = ToolPart::of(&[blade, probe], 1e4).unwrap();
        assert_eq!(parts.iter().map(|part| part.carried.map(|c| c.by)).collect::<Vec<_>>(), [None, None, Some(0)]);
        let place = parts[2].carried.unwrap().place;
        // The ends of the edge trail its middle by the sagitta.
        let spine_m = 0.014;
        for (x, y) in [(-0.055, spine_m), (-0.05, spine_m + 0.005), (0.05, spine_m + 0.105)] {
            let at_m = place.transform(&Vec3::new(x, 0.0, 0.0));
            assert!((at_m - Vec3::new(0.0, y, 0.0)).norm() < 1e-12, "{at_m:?}");
        }
    }
}
