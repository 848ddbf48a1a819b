//! A blade that is drawn along its edge cuts with its end.

use super::support::cutting::*;
use kerf_physics::scene::{BladeDesc, EdgeDesc, Face, LoadDesc, ObjectDesc, ShapeDesc, ToolDesc};
use kerf_physics::step_io::SolveReport;
use kerf_physics::tool::blade::Blade;
use kerf_physics::{Pose, Quat, Vec3};

const GC: f64 = 20.0;
const TOP_M: f64 = 0.012;
const DEPTH_M: f64 = 0.007;
const WIDTH_M: f64 = 0.008;

/// The pad of `cases/drag`, by voxel size and level.
fn pad(h: f64, level: u8) -> ObjectDesc {
    let mut object = super::support::object([-0.03, 0.0, -0.015], [0.03, TOP_M, 0.015], h, level);
    object.material.young_modulus_pa = 5e4;
    object.material.fracture_energy_j_per_m2 = Some(GC);
    object.material.strain_stiffening = 10.0;
    object.material.rayleigh_alpha_per_s = 1.0;
    object.material.rayleigh_beta_s = 2e-4;
    object.fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, 0.002, 1.0] }];
    object
}

const WAY_M: f64 = 0.036;

/// Of the way, what the blade goes before its end stands as deep in the tissue as it will, and after: m.
const STEADY_M: [f64; 2] = [0.006, 0.033];

#[test]
fn a_blade_drawn_along_its_edge_cuts_with_its_end_at_gc_times_the_depth() {
    cuts_with_its_end(1, EdgeDesc::Straight);
    cuts_with_its_end(1, EdgeDesc::Arc { sagitta_m: 1e-3 });
}

#[test]
#[ignore = "slow: single voxels, a third of a minute"]
fn so_does_one_in_single_voxels_and_one_with_corners() {
    cuts_with_its_end(0, EdgeDesc::Straight);
    cuts_with_its_end(1, EdgeDesc::Polyline { points_m: vec![[-0.004, 0.001, 0.0], [0.0; 3], [0.004, 0.001, 0.0]] });
}

fn cuts_with_its_end(level: u8, edge: EdgeDesc) {
    let h = 1.5e-3;
    let mut scene = cutting_scene(pad(h, level), WIDTH_M, 250.0);
    let name = format!("{edge:?}, h {h}, level {level}");
    let blade = BladeDesc { edge, ..BladeDesc::straight(WIDTH_M, 0.04) };
    let edge = Blade::new(&blade).unwrap().edge;
    let lowest_m = edge.points_m().iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
    scene.desc.tools = vec![ToolDesc::blade("blade", blade)];
    let start = Vec3::new(-0.018, TOP_M + 0.002 - lowest_m, 3e-4);
    let mut rig = Rig::new(&scene, start, Quat::identity(), 0.022);
    rig.drive(DEPTH_M + 0.002);
    let first = rig.samples.len();
    rig.speed_m_per_s = 0.03;
    rig.drive_along(Vec3::x() * WAY_M);
    let [from, to] = STEADY_M.map(|way_m| first + (way_m / (0.03 * rig.dt_s)) as usize);
    let force_n = -rig.wrenches_n[from..to].iter().map(|f| f.x).sum::<f64>() / (to - from) as f64;
    let area_m2: f64 = rig.samples[from..to].iter().map(|s| s.area_m2).sum();
    let force = force_n / (GC * DEPTH_M);
    let area = area_m2 / (DEPTH_M * (STEADY_M[1] - STEADY_M[0]));
    let (residual, _) = rig.residual_ratios();
    println!("{name}: F/(Gc d) {force:.3}, A/(d l) {area:.3}, residual {residual:.1e}");
    assert!((force - 1.0).abs() < 0.1, "{name}: F/(Gc d) = {force}");
    // Where the cut ends under the skin is known to half of a marker's piece, 5 % of the depth here.
    assert!((area - 1.0).abs() < 0.06, "{name}: A/(d l) = {area}");
    assert!(residual.abs() < 5e-3, "{name}: residual {residual} of the work");
}

#[test]
fn a_blade_that_turns_as_it_is_drawn_along_a_circle_frees_a_disc() {
    frees_a_disc(1.5e-3, 1, 0.015);
    frees_a_disc(1.5e-3, 2, 0.015);
}

#[test]
#[ignore = "slow: single voxels, a minute"]
fn so_does_one_in_single_and_in_smaller_voxels_and_along_a_narrower_circle() {
    frees_a_disc(1.5e-3, 0, 0.015);
    frees_a_disc(1e-3, 1, 0.015);
    frees_a_disc(1.5e-3, 1, 0.01);
}

/// Cuts a disc out of a sheet whose rim is held. The middle of the blade goes along the circle, and its edge along the
/// tangent: the end that cuts goes along a circle that is larger, and at an angle to the blade.
fn frees_a_disc(h: f64, level: u8, radius_m: f64) {
    const THICKNESS_M: f64 = 0.006;
    const HALF_M: f64 = 0.027;
    let mut sheet = super::support::object([-HALF_M, 0.0, -HALF_M], [HALF_M, THICKNESS_M, HALF_M], h, level);
    sheet.material = pad(h, level).material;
    let beyond = |axis: usize, sign: f64| {
        let (mut min_m, mut max_m) = ([-1.0; 3], [1.0; 3]);
        let side = if sign < 0.0 { &mut max_m } else { &mut min_m };
        side[axis] = sign * (HALF_M - 0.003);
        ShapeDesc::Box { min_m, max_m }
    };
    sheet.fixed = vec![beyond(0, -1.0), beyond(0, 1.0), beyond(2, -1.0), beyond(2, 1.0)];
    let scene = cutting_scene(sheet, WIDTH_M, 250.0);
    let pose = |angle: f64, y: f64| Pose {
        position_m: Vec3::new(radius_m * angle.cos(), y, radius_m * angle.sin()),
        orientation: Quat::from_axis_angle(&Vec3::y_axis(), -angle - std::f64::consts::FRAC_PI_2),
    };
    let start = pose(0.0, THICKNESS_M + 2e-3);
    let mut rig = Rig::new(&scene, start.position_m, start.orientation, 0.022);
    rig.drive(THICKNESS_M + 4e-3);
    let first = rig.samples.len();
    let turn = std::f64::consts::TAU + WIDTH_M / radius_m;
    let steps = (turn * radius_m / (0.03 * rig.dt_s)) as usize;
    rig.drive_through((1..=steps).map(|k| pose(turn * k as f64 / steps as f64, -2e-3)));

    let end_radius_m = radius_m.hypot(0.5 * WIDTH_M);
    let disc = std::f64::consts::PI * end_radius_m.powi(2) * THICKNESS_M / h.powi(3);
    let sizes = pieces(rig.body(), |_| true);
    let area = rig.sum(|s| s.area_m2) / (std::f64::consts::TAU * end_radius_m * THICKNESS_M);
    let drawn = &rig.samples[first..];
    let work_j: f64 = drawn.iter().map(|s| s.energy.tool_work_j).sum();
    let work = work_j / (GC * drawn.iter().map(|s| s.area_m2).sum::<f64>());
    let (residual, _) = rig.residual_ratios();
    let name = format!("h {h}, level {level}, radius {radius_m} m");
    println!(
        "{name}: {sizes:?} voxels, {disc:.0} in the disc, A/(2 pi r t) {area:.3}, W/(Gc A) {work:.3}, {residual:.1e}"
    );
    assert!(sizes.len() <= 3, "{name}: pieces of {sizes:?} voxels");
    let freed = sizes[sizes.len() - 2] as f64 / disc;
    assert!((freed - 1.0).abs() < 0.05, "{name}: {freed} of the disc");
    // What of the way was cut before is not cut again.
    assert!((area - 1.0).abs() < 0.1, "{name}: A/(2 pi r t) = {area}");
    // Its flanks bend the cut that they stand in.
    assert!((0.9..1.25).contains(&work), "{name}: W/(Gc A) = {work}");
    assert!(residual.abs() < 5e-3, "{name}: residual {residual} of the work");
}

#[test]
fn a_blade_that_is_pushed_aside_off_its_cut_cuts_on_where_it_comes_to_stand() {
    for aside_m in [0.006, 0.01] {
        let scene = cutting_scene(pad(1.5e-3, 1), WIDTH_M, 250.0);
        let mut rig = Rig::new(&scene, Vec3::new(-0.018, TOP_M + 0.002, 3e-4), Quat::identity(), 0.022);
        rig.drive(DEPTH_M + 0.002);
        rig.speed_m_per_s = 0.03;
        rig.drive_along(Vec3::x() * 0.006);
        rig.drive_along(Vec3::z() * aside_m);
        rig.drive_along(Vec3::x() * 0.006);
        let first = rig.samples.len();
        rig.drive_along(Vec3::x() * 0.012);
        let drawn = &rig.wrenches_n[first..];
        let force = -drawn.iter().map(|f| f.x).sum::<f64>() / drawn.len() as f64 / (GC * DEPTH_M);
        let area = rig.samples[first..].iter().map(|s| s.area_m2).sum::<f64>() / (DEPTH_M * 0.012);
        println!("{aside_m} m aside: F/(Gc d) {force:.3}, A/(d l) {area:.3}");
        assert!((force - 1.0).abs() < 0.1, "{aside_m} m aside: F/(Gc d) = {force}");
        assert!((area - 1.0).abs() < 0.06, "{aside_m} m aside: A/(d l) = {area}");
    }
}

/// Iterations and solves of a stroke straight down, and the area that it cuts, m^2.
fn stroke_down(sharp_ends: bool) -> (u32, u32, f64) {
    let mut scene = cutting_scene(block(2.5e-3, 1), 0.02, 500.0);
    // Drawn apart along x, as cuts in the built-in scenes are.
    let pull = |face, traction_pa| LoadDesc::Traction {
        region: ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0; 3] },
        face,
        traction_pa: [traction_pa, 0.0, 0.0],
    };
    scene.desc.objects[0].loads = vec![pull(Face::MinX, -2e4), pull(Face::MaxX, 2e4)];
    scene.desc.tools = vec![ToolDesc::blade("blade", BladeDesc { sharp_ends, ..BladeDesc::straight(0.02, 0.06) })];
    let across = Quat::from_axis_angle(&Vec3::y_axis(), std::f64::consts::FRAC_PI_2);
    let mut rig = Rig::new(&scene, Vec3::new(3e-4, BLOCK_HEIGHT_M + 1e-3, 0.0), across, 0.05);
    rig.drive(0.02);
    let sum = |of: fn(&SolveReport) -> u32| rig.samples.iter().map(|s| of(&s.solve)).sum();
    (sum(|s| s.iterations), sum(|s| s.solves), rig.samples.iter().map(|s| s.area_m2).sum())
}

#[test]
fn the_ends_of_a_blade_that_only_comes_down_cost_next_to_no_solves() {
    let [sharp, blunt] = [true, false].map(stroke_down);
    println!("iterations, solves, area: sharp {sharp:?}, blunt {blunt:?}");
    assert!(f64::from(sharp.0) < 1.15 * f64::from(blunt.0), "iterations {} against {}", sharp.0, blunt.0);
    assert!(f64::from(sharp.1) < 1.05 * f64::from(blunt.1), "solves {} against {}", sharp.1, blunt.1);
    assert!((sharp.2 / blunt.2 - 1.0).abs() < 0.02, "area {} against {} m^2", sharp.2, blunt.2);
}
