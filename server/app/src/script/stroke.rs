//! The stroke that a scene is cut with when no script is given.

use anyhow::Result;
use kerf_physics::scene::{ObjectDesc, SceneDesc};
use kerf_physics::{Grid, Scene, Vec3, World};

use super::Script;

/// Height above the object at which the blade enters, and to which it returns, in heights of the object.
const CLEARANCE: f64 = 0.05;
/// Height above the object's bottom at which the stroke ends, in heights of the object: below most of
/// the material, above what usually holds it.
const DEPTH: f64 = 0.2;
/// Speed of the press, m/s: a brisk hand.
const PRESS_M_PER_S: f64 = 0.1;
/// Rest at the bottom, s.
const REST_S: f64 = 0.1;
/// Speed of the return, m/s.
const RETURN_M_PER_S: f64 = 0.3;

/// Press, cut, rest, return and lift, with the scene's first tool held level: straight down through
/// the middle of the bounding box of the first object that can be cut (of the first, where none can).
///
/// # Errors
/// The object cannot be voxelized.
pub fn default_stroke(scene: &Scene) -> Result<Script> {
    let object = object_of(&scene.desc).map(|object| &scene.desc.objects[object]);
    let grid = object.map(|object| kerf_physics::voxelize(object, &scene.meshes)).transpose()?;
    Ok(grid.as_ref().map(through).unwrap_or_default())
}

/// The same of a scene of which there is a world: nothing is voxelized again.
#[must_use]
pub fn default_stroke_in(world: &World, desc: &SceneDesc) -> Script {
    object_of(desc).map(|object| through(world.bodies()[object].grid())).unwrap_or_default()
}

/// The object that the stroke goes through; `None` where there is nothing to hold a tool by.
fn object_of(desc: &SceneDesc) -> Option<usize> {
    let can_be_cut = |object: &ObjectDesc| object.material.fracture_energy_j_per_m2.is_some();
    let object = desc.objects.iter().position(can_be_cut).unwrap_or(0);
    (!desc.tools.is_empty() && object < desc.objects.len()).then_some(object)
}

fn through(grid: &Grid) -> Script {
    Script::of_positions(&positions(grid))
}

fn positions(grid: &Grid) -> [(f64, Vec3); 4] {
    let extent_m = Vec3::from(grid.dims().map(f64::from)) * grid.voxel_size_m();
    let at_height = |share: f64| grid.origin_m() + extent_m.component_mul(&Vec3::new(0.5, share, 0.5));
    let (above, below) = (at_height(1.0 + CLEARANCE), at_height(DEPTH));
    let travel_m = above.y - below.y;
    let pressed_s = travel_m / PRESS_M_PER_S;
    let rested_s = pressed_s + REST_S;
    [(0.0, above), (pressed_s, below), (rested_s, below), (rested_s + travel_m / RETURN_M_PER_S, above)]
}

#[cfg(test)]
mod tests {
    use kerf_physics::step_io::ToolMotion;
    use kerf_scenes::catalog;

    use super::*;

    #[test]
    fn the_stroke_in_a_world_is_that_of_its_scene() {
        let scene = catalog::builtin("two-organs").unwrap();
        let mut strokes =
            [default_stroke(&scene).unwrap(), default_stroke_in(&World::new(&scene).unwrap(), &scene.desc)];
        let told = strokes.each_mut().map(|stroke| {
            (0..200).map(|step| format!("{:?}", stroke.advance(f64::from(step) * 0.01))).collect::<Vec<_>>()
        });
        assert_eq!(told[0], told[1]);
    }

    #[test]
    fn the_stroke_enters_above_the_cuboid_and_ends_inside_it() {
        let mut script = default_stroke(&catalog::builtin("cuboid").unwrap()).unwrap();
        let mut heights = Vec::new();
        for step in 0..=(script.end_s() * 1e3) as usize + 1 {
            match script.advance(step as f64 * 1e-3).first().map(|input| input.motion) {
                Some(ToolMotion::EnterAt { pose, .. } | ToolMotion::MoveTo { pose, .. }) => {
                    assert!(pose.position_m.x.abs() < 1e-9 && pose.position_m.z.abs() < 1e-9);
                    heights.push(pose.position_m.y);
                }
                other => assert!(matches!(other, None | Some(ToolMotion::Lift))),
            }
        }
        assert!((heights[0] - 0.07 * 1.05).abs() < 1e-9);
        assert!((heights.iter().copied().fold(f64::INFINITY, f64::min) - 0.07 * 0.2).abs() < 1e-9);
    }
}
