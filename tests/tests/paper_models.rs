//! The paper's horse, armadillo and bunny from scanned meshes: their sizes, and a stroke through each.

use kerf_physics::step_io::ToolMotion;
use kerf_physics::{Grid, NoClock, Pose, Quat, StepInputs, ToolInput, Vec3, Workers, World};
use kerf_system_tests::performance::models::{ARMADILLO, BUNNY, HORSE};

#[test]
fn horse_armadillo_and_bunny_have_the_papers_voxels_and_can_be_cut() {
    // Voxels and composite elements in the paper's Table 1.
    for (model, paper_voxels, paper_elements) in [(HORSE, 4828, 68), (ARMADILLO, 16_965, 109), (BUNNY, 44_221, 158)] {
        let Some(scene) = model.scene().expect("a mesh where one is to be") else { continue };
        let mut world = World::new(&scene).unwrap();
        let (file, counts) = (model.file, world.counts());
        let (voxels, elements) = (counts.voxels, counts.composite_elements);
        println!("{file}: {voxels} voxels ({paper_voxels} in the paper), {elements} elements ({paper_elements})");
        let (parted, area_m2) = stroke(&mut world);
        println!("  a stroke parts {parted} links, {:.1} cm^2", 1e4 * area_m2);
        assert!((voxels as f64 / f64::from(paper_voxels) - 1.0).abs() < 0.05, "{file}: {voxels}");
        assert!(parted > 20, "{file}: {parted} links parted");
    }
}

/// Links parted by a blade that goes down half of the body from its top, and the area it swept, m^2.
fn stroke(world: &mut World) -> (u32, f64) {
    let grid: &Grid = world.bodies()[0].grid();
    let extent_m = Vec3::from(grid.dims().map(f64::from)) * grid.voxel_size_m();
    let top_m = grid.origin_m() + extent_m.component_mul(&Vec3::new(0.5, 1.0, 0.5));
    let (mut parted, mut area_m2) = (0, 0.0);
    for step in 0..220 {
        // 0.4 m/s, from just above.
        let position_m = top_m + Vec3::new(0.0, 1e-3 - 4e-4 * f64::from(step).min(extent_m.y / 2.0 / 4e-4), 3e-4);
        let motion = ToolMotion::move_to(Pose { position_m, orientation: Quat::identity() });
        let output = world.step(&Workers::serial(), &NoClock, &StepInputs::of(&[ToolInput { tool: 0, motion }]));
        assert!(output.fault.is_none(), "{:?}", output.fault);
        parted += output.fracture.parted_links;
        area_m2 += output.fracture.cut_area_m2;
    }
    (parted, area_m2)
}
