//! Flanks of a blade in a cut: the wall presses across them, and friction along them.

use super::support::cutting::*;
use super::support::{body, object, params};
use kerf_physics::contact::flank::WallsBeside;
use kerf_physics::scene::{BladeDesc, ToolDesc};
use kerf_physics::tool::blade::Blade;
use kerf_physics::{Crossing, LinkId, Pose, Quat, Vec3, Workers};

const H_M: f64 = 2.5e-3;
const DEEP_M: f64 = 0.02;
const ASIDE_M: f64 = 3e-3;

/// A block with a cut of 20 mm, made by a thin blade; `blade` is put down in it and moved aside, so that
/// one wall lies on one flank.
fn beside_a_wall(blade: BladeDesc, aside_m: f64) -> Rig {
    let mut scene = cutting_scene(block(H_M, 2), 0.12, 1000.0);
    scene.desc.tools.push(ToolDesc::blade("flank", blade));
    assert_eq!(scene.problems(), []);
    let at = Vec3::new(0.0, BLOCK_HEIGHT_M + 5e-4, 4e-4);
    let mut rig = Rig::new(&scene, at, attitude(0.0, 0.0, 0.0), 0.1);
    rig.drive(DEEP_M);
    rig.lift();
    rig.tool = 1;
    let inside = rig.position_m + Vec3::y() * 4e-3;
    rig.enter_at(inside);
    rig.drive_along(Vec3::z() * aside_m);
    rig.rest(60);
    rig
}

fn blade() -> BladeDesc {
    BladeDesc::straight(0.12, 0.06)
}

/// Moves the blade and returns the mean force over the last half of the way, N, and its length, m.
fn pulled(rig: &mut Rig, by_m: Vec3, speed_m_per_s: f64) -> Vec3 {
    rig.speed_m_per_s = speed_m_per_s;
    rig.drive_along(by_m * 0.5);
    let from = rig.wrenches_n.len();
    rig.drive_along(by_m * 0.5);
    let late = &rig.wrenches_n[from..];
    late.iter().sum::<Vec3>() / late.len() as f64
}

#[test]
fn friction_is_its_coefficient_times_the_normal_force_whichever_way_and_however_fast() {
    for (coefficient, way, speed_m_per_s) in [
        (0.0, Vec3::y(), 0.02),
        (0.1, Vec3::y(), 0.02),
        (0.3, Vec3::y(), 0.02),
        (0.3, Vec3::y(), 0.1),
        (0.3, Vec3::x(), 0.05),
        (0.3, Vec3::new(-0.6, 0.8, 0.0), 0.05),
    ] {
        let flank_friction = (coefficient > 0.0).then_some(coefficient);
        let mut rig = beside_a_wall(BladeDesc { flank_friction, ..blade() }, ASIDE_M);
        rig.samples.clear();
        let force = pulled(&mut rig, way * 4e-3, speed_m_per_s);
        let (normal, along) = (-force.z, -force.dot(&way));
        let friction = rig.sum(|s| s.energy.friction_j);
        let (residual, residual_abs) = rig.residual_ratios();
        println!(
            "mu {coefficient}, {speed_m_per_s} m/s: normal {normal:.3} N, along {:.4} of it, friction {friction:.2e} J, \
             residual {residual:.1e} ({residual_abs:.1e})",
            along / normal
        );
        assert!(normal > 0.5, "the wall presses with {normal} N");
        assert!(
            (along / normal - coefficient).abs() < 0.03 * coefficient.max(0.1),
            "{along} N along, {normal} N across"
        );
        if coefficient > 0.0 {
            // What the wall creeps along before it slides takes less.
            assert!((0.6..1.05).contains(&(friction / (coefficient * normal * 4e-3))), "{friction} J");
            assert!(residual_abs < 0.01, "energy residual {residual} ({residual_abs})");
        } else {
            assert_eq!(friction, 0.0);
        }
    }
}

#[test]
fn a_blade_at_rest_in_a_cut_is_held_within_what_friction_can_hold_and_creeps_ever_less() {
    let mut rig = beside_a_wall(BladeDesc { flank_friction: Some(0.3), ..blade() }, ASIDE_M);
    let mut spent = Vec::new();
    for _ in 0..3 {
        rig.samples.clear();
        rig.rest(100);
        spent.push(rig.sum(|s| s.energy.friction_j));
        let force = rig.wrenches_n[rig.wrenches_n.len() - 1];
        println!("at rest: {force:?} N, friction {:.1e} J in 0.1 s", spent[spent.len() - 1]);
        assert!(force.y.abs() <= 0.3 * force.z.abs(), "{force:?}");
        // A creep of at most 1 mm/s under the whole of what it holds.
        assert!((0.0..0.3 * force.z.abs() * 1e-4).contains(&spent[spent.len() - 1]), "{spent:?} J");
    }
    assert!(spent[2] < 0.7 * spent[0], "{spent:?} J while nothing moves");
}

#[test]
fn a_wedge_turns_the_walls_force_by_half_its_angle() {
    for angle_rad in [0.1, 0.2] {
        // Thick enough to be a wedge as far up as the cut is deep.
        let wedge = BladeDesc { thickness_m: 0.02 * angle_rad, wedge_angle_rad: Some(angle_rad), ..blade() };
        let rig = beside_a_wall(wedge, ASIDE_M);
        let force = rig.wrenches_n[rig.wrenches_n.len() - 1];
        let ratio = -force.y.abs() / force.z;
        println!("wedge of {angle_rad} rad: force {force:?} N, {ratio:.4} against {:.4}", (0.5 * angle_rad).tan());
        assert!(force.z < -0.5 && force.y > 0.0, "{force:?}");
        assert!((ratio / (0.5 * angle_rad).tan() - 1.0).abs() < 0.01, "{force:?}");
    }
}

#[test]
fn a_wedge_is_thin_at_the_edge() {
    // Put down in the cut, a full thickness holds both walls off all the way down, a wedge only up high.
    let spread_j = |thickness_m, wedge_angle_rad| {
        let mut rig = beside_a_wall(BladeDesc { thickness_m, wedge_angle_rad, ..blade() }, 0.0);
        // The walls come out of it by a voxel a second.
        rig.rest(500);
        let energy = rig.samples[rig.samples.len() - 1].energy;
        energy.elastic_j + energy.contact_j
    };
    let [thin, full, wedge] = [(0.0, None), (2e-3, None), (2e-3, Some(0.15))].map(|(t, w)| spread_j(t, w));
    println!("in the cut: thin {thin:.2e} J, full {full:.2e} J, wedge {wedge:.2e} J");
    assert!(thin < 1e-3 * full, "thin {thin} J, full {full} J");
    assert!((0.1..0.8).contains(&(wedge / full)), "full {full} J, wedge {wedge} J");
}

#[test]
fn a_blade_put_down_inside_brings_no_energy_whichever_way_it_goes_on() {
    for (name, way) in [("up", Vec3::y()), ("along", Vec3::x()), ("across", Vec3::z()), ("down", -Vec3::y())] {
        let mut scene = cutting_scene(block(H_M, 2), 0.12, 1000.0);
        scene.desc.tools[0] =
            ToolDesc::blade("thick", BladeDesc { thickness_m: 2e-3, flank_friction: Some(0.1), ..blade() });
        let mut rig = Rig::new(&scene, Vec3::new(0.0, 0.5 * BLOCK_HEIGHT_M, 4e-4), attitude(0.0, 0.0, 0.0), 0.5);
        rig.enter_at(rig.position_m);
        let at_once_n = rig.wrenches_n[rig.wrenches_n.len() - 1].norm();
        assert!(at_once_n < 1e-2, "{name}: {at_once_n} N as it is put down");
        rig.drive_along(way * 0.01);
        rig.rest(200);
        let (made_j, work_j) = rig.made_and_work_j();
        println!("{name}: made {made_j:.1e} J of {work_j:.1e} J of work");
        assert!(work_j > 1e-4, "{name}: {work_j} J");
        assert!(made_j < 1e-3 * work_j, "{name}: {made_j} J made of {work_j} J of work");
    }
}

#[test]
fn a_wall_that_has_turned_round_beside_the_blade_is_not_one_that_pressed_through_it() {
    // A bar in two, and a blade across it 1.2 voxels from the end of one half.
    let mut body = body(&object([-0.04, 0.0, -0.02], [0.04, 0.04, 0.02], 5e-3, 2), params(1e-3));
    let middle = body.state.grid.cell_of(&Vec3::new(-1e-4, 0.02, 0.0))[0];
    let cells = body.state.grid.voxels().iter().map(|v| v.ijk).filter(|cell| cell[0] == middle);
    let links: Vec<_> =
        cells.map(|cell| (LinkId { cell, axis: 0 }, Crossing { t: 0.5, normal: [1.0, 0.0, 0.0] })).collect();
    let parted = body.part_links(&links).parted;
    body.update_topology(&Workers::serial(), &parted);
    let blade = Blade::new(&blade()).expect("a blade");
    let pose = |x: f64, turn: f64| Pose {
        position_m: Vec3::new(x, -0.02, 0.0),
        orientation: Quat::from_axis_angle(&Vec3::y_axis(), turn * std::f64::consts::FRAC_PI_2),
    };
    // Flanks against walls once the blade has gone from 6 mm outside to 6 mm inside of the left half's end.
    let contacts = |turn: f64| {
        let (mut beside, mut out) = (WallsBeside::default(), Vec::new());
        let (outside, inside) = (pose(6e-3, 1.0), pose(-6e-3, turn));
        for poses in [[&outside, &outside], [&outside, &inside]] {
            beside.contacts(&body, &blade.flanks, poses, &mut out);
        }
        out
    };
    let through = contacts(1.0);
    assert!(!through.is_empty());
    assert!(through.iter().all(|c| c.direction.x < -0.99 && (5e-3..7e-3).contains(&c.gap_predicted_m)), "{through:?}");
    // As if the half had turned round beside it.
    let turned = contacts(-1.0);
    assert!(turned.is_empty(), "{turned:?}");
}
