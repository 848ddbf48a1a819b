//! Limbs that a level has few elements across for.

use super::support::{mean_displacement, object, scene, world_of};
use kerf_physics::scene::{Face, LoadDesc, ShapeDesc};
use kerf_physics::{Vec3, Workers};

/// How far a ball on a neck is bent down, m, and the number of elements. The neck is 4.6 voxels thick: 1.1 elements of
/// level 2, 0.6 of level 3.
fn bent(level: u8, min_elements_across: Option<f64>) -> (f64, usize) {
    let ball = |x: f64| ShapeDesc::Sphere { center_m: [x, 0.001, 0.0], radius_m: 0.03 };
    let neck = ShapeDesc::Capsule { from_m: [-0.05, 0.001, 0.0], to_m: [0.05, 0.001, 0.0], radius_m: 0.008 };
    let beyond = |x: f64| ShapeDesc::Box { min_m: [x, -1.0, -1.0], max_m: [1.0; 3] };
    let mut desc = object([0.0; 3], [0.0; 3], 0.0035, level);
    desc.shape = ShapeDesc::SmoothUnion { blend_m: 0.005, parts: vec![ball(-0.05), ball(0.05), neck], without: vec![] };
    desc.min_elements_across = min_elements_across;
    desc.fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [-0.05, 1.0, 1.0] }];
    desc.loads =
        vec![LoadDesc::Traction { region: beyond(0.05), face: Face::MaxX, traction_pa: [0.0, -5e-6 * 1e6, 0.0] }];
    let mut scene = scene(vec![desc]);
    scene.desc.gravity_m_per_s2 = [0.0; 3];
    let mut world = world_of(&scene);
    assert!(world.relax(&Workers::serial(), &mut |_| ()).converged);
    let moved: Vec3 = mean_displacement(world.bodies()[0], 0, 0.05);
    (-moved.y, world.bodies()[0].base().elements.len())
}

#[test]
fn a_thin_neck_gets_elements_that_bend_with_it() {
    let (single_voxels, _) = bent(0, None);
    let (_, all_finer) = bent(1, None);
    for (level, off) in [(2, 0.2), (3, 0.5)] {
        let (plain, _) = bent(level, None);
        let (finer, elements) = bent(level, Some(2.5));
        println!(
            "level {level}: {:.3} of single voxels, with 2.5 elements across {:.3} ({elements} elements)",
            plain / single_voxels,
            finer / single_voxels
        );
        assert!(plain < (1.0 - off) * single_voxels, "too coarse a neck bends too little");
        assert!((finer / single_voxels - 1.0).abs() < 0.04);
        assert!(3 * elements < 2 * all_finer, "the balls stay coarse: {elements} of {all_finer}");
    }
}
