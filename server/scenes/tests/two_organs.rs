//! A lobe sinks onto a kidney, and each carries the other.

use kerf_physics::{NoClock, SoundScene, StepInputs, Vec3, Workers, World};
use kerf_scenes::catalog;

/// A world after this many steps without input.
fn rested(scene: &SoundScene, steps: usize) -> World {
    let mut world = World::new(scene).unwrap();
    for _ in 0..steps {
        let output = world.step(&Workers::serial(), &NoClock, &StepInputs::default());
        assert!(output.fault.is_none(), "{:?}", output.fault);
    }
    world
}

#[test]
fn the_lobe_rests_on_the_kidney_and_hangs_lower_without_it() {
    let scene = catalog::builtin("two-organs").unwrap();
    let world = rested(&scene, 1500);
    let on_lobe = |object: usize| if object == 0 { 1.0 } else { -1.0 };
    let force_n: Vec3 = world.tissue_presses().map(|press| press.force_n * on_lobe(press.objects[0])).sum();
    let deepest_m = world.tissue_presses().map(|press| press.depth_m).fold(0.0, f64::max);
    let voxel_m = scene.desc.objects[0].voxel_size_m.unwrap();
    let weight_n = 9.81 * world.bodies()[0].mass_kg();
    let (output, end_m) = (world.output(), world.output().tracked_displacement_m[1].y);

    let alone = scene.clone().with(|desc| desc.objects.truncate(1)).unwrap();
    let alone_m = rested(&alone, 1500).output().tracked_displacement_m[1].y;
    println!(
        "the kidney carries {:.3} of {weight_n:.2} N, {:.4} h deep; the end sinks {:.2} mm, alone {:.2} mm; kinetic \
         {:.1e} of {:.1e} J",
        force_n.y / weight_n,
        deepest_m / voxel_m,
        -1e3 * end_m,
        -1e3 * alone_m,
        output.energy.kinetic_j,
        output.energy.elastic_j
    );
    assert!((0.2..1.0).contains(&(force_n.y / weight_n)), "{force_n:?} of {weight_n} N");
    assert!(deepest_m < 0.1 * voxel_m, "{deepest_m} m deep");
    assert!(output.energy.kinetic_j < 1e-4 * output.energy.elastic_j, "at rest");
    assert!(alone_m < 1.5 * end_m, "{alone_m} m alone, {end_m} m on the kidney");
}
