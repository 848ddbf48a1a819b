//! Where scripted tools go: the boxes around all that they sweep.

use kerf_physics::Vec3;
use kerf_physics::scene::{SceneDesc, ToolShapeDesc};
use kerf_physics::step_io::ToolMotion;

use super::Script;

/// Lower and upper corner, m, of the box around the edge or the axis of each tool over the whole script; `None` where
/// it does not enter the scene.
#[must_use]
pub fn boxes(desc: &SceneDesc, script: &Script) -> Vec<Option<[Vec3; 2]>> {
    let mut script = script.clone();
    let outlines: Vec<Vec<Vec3>> = desc.tools.iter().map(|tool| outline_m(&tool.shape)).collect();
    let mut boxes: Vec<Option<[Vec3; 2]>> = vec![None; desc.tools.len()];
    let steps = (script.end_s() * desc.rate_hz).ceil() as u64;
    for step in 0..=steps {
        for input in script.advance(step as f64 / desc.rate_hz) {
            let (ToolMotion::MoveTo { pose, .. } | ToolMotion::EnterAt { pose, .. }) = input.motion else { continue };
            for point in &outlines[input.tool] {
                let at = pose.transform(point);
                let [least, most] = boxes[input.tool].get_or_insert([at, at]);
                (*least, *most) = (least.inf(&at), most.sup(&at));
            }
        }
    }
    boxes
}

/// How far a tool touches beyond its edge or its axis, m.
#[must_use]
pub fn reach_m(shape: &ToolShapeDesc) -> f64 {
    match shape {
        ToolShapeDesc::Blade(_) | ToolShapeDesc::Scissors(_) => 0.0,
        ToolShapeDesc::Grasper(grasper) => grasper.radius_m,
        ToolShapeDesc::Probe(capsule) => capsule.radius_m,
    }
}

/// Points of a tool that its edge or its axis lies between, tool frame, m.
fn outline_m(shape: &ToolShapeDesc) -> Vec<Vec3> {
    let along = |ends_m: [f64; 2]| ends_m.map(|x| Vec3::new(x, 0.0, 0.0)).to_vec();
    match shape {
        ToolShapeDesc::Blade(blade) => blade.edge.points_m(blade.width_m).unwrap_or_default(),
        ToolShapeDesc::Grasper(_) => along([0.0, 0.0]),
        ToolShapeDesc::Probe(capsule) => along([-0.5 * capsule.length_m, 0.5 * capsule.length_m]),
        ToolShapeDesc::Scissors(scissors) => along([0.0, scissors.blade_length_m]),
    }
}
