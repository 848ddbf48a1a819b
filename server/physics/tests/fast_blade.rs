//! A blade that moves by many voxels in a step meets what lies on its way.

use super::support::cutting::*;
use super::support::world_of;
use kerf_physics::scene::{BladeDesc, ShapeDesc, ToolDesc};
use kerf_physics::step_io::ToolMotion;
use kerf_physics::{NoClock, Pose, Quat, StepInputs, ToolInput, Vec3, Workers, World};

const H_M: f64 = 0.0025;
const RATE_HZ: f64 = 60.0;

/// A sheet of one or two voxels across the way of the blade, held at both ends.
fn sheet(voxels: f64, level: u8, fracture_energy_j_per_m2: Option<f64>) -> World {
    let mut sheet = super::support::object([-0.04, 0.0, -0.02], [0.04, voxels * H_M, 0.02], H_M, level);
    sheet.material.rayleigh_beta_s = 1e-3;
    sheet.material.fracture_energy_j_per_m2 = fracture_energy_j_per_m2;
    let ends = |x: f64| ShapeDesc::Box { min_m: [x - 0.0051, -1.0, -1.0], max_m: [x + 0.0051, 1.0, 1.0] };
    sheet.fixed = vec![ends(-0.04), ends(0.04)];
    let mut scene = super::support::scene(vec![sheet]);
    scene.desc.rate_hz = RATE_HZ;
    scene.desc.tools = vec![ToolDesc::blade("blade", BladeDesc::straight(0.06, 0.1))];
    world_of(&scene)
}

/// The edge across the sheet at a height, cutting down.
fn at(height_m: f64) -> ToolMotion {
    let orientation = Quat::from_euler_angles(0.0, std::f64::consts::FRAC_PI_2, 0.0);
    ToolMotion::move_to(Pose { position_m: Vec3::new(7e-4, height_m, 0.0), orientation })
}

fn step(world: &mut World, motion: ToolMotion) -> f64 {
    let inputs = [ToolInput { tool: 0, motion }];
    let output = world.step(&Workers::serial(), &NoClock, &StepInputs::of(&inputs));
    assert!(output.fault.is_none(), "{:?}", output.fault);
    output.tools[0].wrench.force_n.y
}

#[test]
fn a_sheet_that_the_edge_would_jump_in_a_step_catches_it() {
    for (voxels, level) in [(1.0, 0), (2.0, 0), (2.0, 1), (2.0, 2)] {
        let mut world = sheet(voxels, level, None);
        assert_eq!(step(&mut world, at(0.011)), 0.0, "it hangs above");
        // 17 mm on: the whole sheet is behind it.
        let force_n = step(&mut world, at(0.011 - 1.0 / RATE_HZ));
        for _ in 0..30 {
            step(&mut world, at(0.011 - 1.0 / RATE_HZ));
        }
        let middle = |x: f64, y: f64| Vec3::new(x, y, 0.0);
        let body = world.bodies()[0];
        let grid = &body.state.grid;
        let point = |position_m: Vec3| kerf_physics::MaterialPoint {
            position_m,
            voxel: grid.voxel_at(grid.cell_of(&position_m)).expect("a point of the sheet"),
        };
        let dent_m = -body.current_m(&point(middle(7e-4, 0.5 * H_M))).y;
        println!("{voxels} voxels, level {level}: {force_n:.2} N, in the end dented by {:.2} mm", 1e3 * dent_m);
        assert!(force_n > 0.0, "{voxels} voxels, level {level}: {force_n} N");
        assert!(dent_m > 2e-3, "{voxels} voxels, level {level}: dented by {dent_m} m");
    }
}

#[test]
fn a_sheet_that_the_edge_would_jump_in_a_step_is_cut() {
    for voxels in [1.0, 2.0] {
        let mut world = sheet(voxels, 0, Some(50.0));
        step(&mut world, at(0.011));
        let mut parted = 0;
        for i in 0..4 {
            step(&mut world, at(0.011 - f64::from(i + 1) / RATE_HZ));
            parted += world.output().fracture.parted_links;
        }
        let pieces = super::support::cutting::pieces(world.bodies()[0], |_| true);
        println!("{voxels} voxels: {parted} links parted, pieces {pieces:?}");
        assert_eq!(pieces.len(), 2, "{voxels} voxels: pieces {pieces:?}");
    }
}

#[test]
fn an_edge_that_is_drawn_back_through_a_sheet_meets_nothing() {
    let mut world = sheet(2.0, 1, None);
    step(&mut world, at(-0.008));
    assert_eq!(step(&mut world, at(0.009)), 0.0);
    assert_eq!(step(&mut world, at(0.010)), 0.0);
}

#[test]
fn a_fast_stroke_leaves_no_bridge() {
    // Up to 16 voxels a step; from where the edge stands before it comes in.
    for (h, level, speed_m_per_s, clear_m) in [
        (2.5e-3, 1, 1.0, 1e-3),
        (2.5e-3, 1, 3.5, 6e-3),
        (2.5e-3, 1, 5.0, 1e-3),
        (2.5e-3, 0, 5.0, 1.3e-2),
        (1.25e-3, 2, 5.0, 6e-3),
    ] {
        let scene = cutting_scene(block(h, level), 0.06, 250.0);
        let start = Vec3::new(0.0, BLOCK_HEIGHT_M + clear_m, 4e-4);
        let mut rig = Rig::new(&scene, start, Quat::identity(), speed_m_per_s);
        rig.rest(1);
        rig.drive(BLOCK_HEIGHT_M + clear_m + 0.02);
        let sizes = pieces(rig.body(), |_| true);
        let (area, _) = rig.area_and_work_ratio(GC_J_PER_M2);
        let (share, (residual, _)) = (area / (BLOCK_SIDE_M * BLOCK_HEIGHT_M), rig.residual_ratios());
        println!(
            "h {h}, level {level}, {speed_m_per_s} m/s: pieces {sizes:?}, area {share:.3}, residual {residual:.1e}"
        );
        assert_eq!(sizes.len(), 2, "h {h}, level {level}, {speed_m_per_s} m/s: pieces of {sizes:?} voxels");
        assert!((share - 1.0).abs() < 0.03, "h {h}, level {level}, {speed_m_per_s} m/s: {share} of the section");
        assert!(residual.abs() < 1e-4, "h {h}, level {level}, {speed_m_per_s} m/s: {residual} of the work");
    }
}
