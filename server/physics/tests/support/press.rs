//! A block under a blade.

use super::world_of;
use kerf_physics::scene::{BladeDesc, MaterialDesc, Scene, ShapeDesc, ToolDesc};
use kerf_physics::step_io::ToolMotion;
use kerf_physics::{NoClock, Pose, Quat, StepInputs, StepOutput, ToolInput, Vec3, Workers, World};

/// A block of 80 x 40 x 40 mm, held at its foot, 256 composite elements, under a blade that reaches
/// over it. It gives before it is pressed in by an element.
pub fn cutting_scene() -> Scene {
    let (side, h) = (0.04, 0.0025);
    let mut block = super::object([-side, 0.0, -0.5 * side], [side, side, 0.5 * side], h, 2);
    block.material.fracture_energy_j_per_m2 = Some(500.0);
    block.material.rayleigh_beta_s = 2e-4;
    block.fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, 1.01 * h, 1.0] }];
    let mut scene = super::scene(vec![block]);
    scene.desc.solver.relative_tolerance = Some(1e-3);
    let blade = BladeDesc::straight(0.06, 0.05);
    scene.desc.tools = vec![ToolDesc::blade("blade", blade)];
    scene
}

/// The edge at a height, along the block's length and askew.
pub fn pose_at(height_m: f64) -> ToolMotion {
    let orientation = Quat::from_euler_angles(0.0, 0.3, 0.0);
    ToolMotion::move_to(Pose { position_m: Vec3::new(0.0, height_m, 0.0004), orientation })
}

/// Steps with the edge moved to a height.
pub fn press_with<'w>(world: &'w mut World, workers: &Workers<'_>, height_m: f64) -> &'w StepOutput {
    let input = ToolInput { tool: 0, motion: pose_at(height_m) };
    world.step(workers, &NoClock, &StepInputs::of(&[input]))
}

/// The same on the calling thread.
pub fn press(world: &mut World, height_m: f64) -> &StepOutput {
    press_with(world, &Workers::serial(), height_m)
}

/// State hash every ten steps of a stroke deep into the block.
pub fn hashes(workers: &Workers<'_>, level: u8, change: fn(&mut MaterialDesc)) -> Vec<u64> {
    let mut scene = cutting_scene();
    scene.desc.objects[0].level = level;
    change(&mut scene.desc.objects[0].material);
    let mut world = world_of(&scene);
    let mut parted = 0;
    let mut hashes = Vec::new();
    for i in 0..60 {
        parted += press_with(&mut world, workers, 0.041 - 4e-4 * f64::from(i)).fracture.parted_links;
        if i % 10 == 9 {
            hashes.push(world.state_hash());
        }
    }
    assert!(parted > 30, "{parted} links parted");
    hashes
}

/// Materials whose laws take every path through an element.
pub const LAWS: [fn(&mut MaterialDesc); 3] =
    [|_| (), |stiffens| stiffens.strain_stiffening = 10.0, |relaxes| relaxes.viscosity = super::viscosity(0.01, 0.5)];

/// Those of a linear, of a stiffening and of a relaxing block, in hexadecimal.
pub fn hashes_of_all_laws() -> String {
    let all = LAWS.map(|law| hashes(&Workers::serial(), 2, law));
    all.iter().flatten().map(|h| format!("{h:016x}")).collect::<Vec<_>>().join(" ")
}
