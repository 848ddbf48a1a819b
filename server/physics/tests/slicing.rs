//! A blade that slices and pushes: the force turns with the edge's way through the material, its work per
//! area does not; and the fracture energy may rise with the speed of the cut.

use super::support::cutting::*;
use kerf_physics::scene::RateDesc;
use kerf_physics::{Quat, Vec3};

const H_M: f64 = 2.5e-3;
const SPEED_M_PER_S: f64 = 0.05;

/// Mean force on a blade over a stroke along `by_m`, N, and the work of its front over Gc times the area.
fn stroke(rig: &mut Rig, by_m: Vec3) -> (Vec3, f64) {
    rig.samples.clear();
    rig.wrenches_n.clear();
    rig.drive_along(by_m);
    let (_, work) = rig.area_and_work_ratio(GC_J_PER_M2);
    (rig.wrenches_n.iter().sum::<Vec3>() / rig.wrenches_n.len() as f64, work)
}

#[test]
fn slicing_turns_the_force_and_leaves_the_work_per_area() {
    let gc_w = GC_J_PER_M2 * BLOCK_SIDE_M;
    for slice_push in [0.0, 0.5, 1.0, 2.0, 4.0, -2.0] {
        let scene = cutting_scene(block(H_M, 2), 0.16, 1000.0);
        let at = Vec3::new(-8e-3 * slice_push, BLOCK_HEIGHT_M + 5e-4, 4e-4);
        let mut rig = Rig::new(&scene, at, Quat::identity(), SPEED_M_PER_S);
        // In at one go, then sliding until the force has turned.
        rig.drive(4e-3);
        let way = Vec3::new(slice_push, -1.0, 0.0);
        let (_, turning) = stroke(&mut rig, way * 6e-3);
        let (force, work) = stroke(&mut rig, way * 6e-3);
        let share = 1.0 / (1.0 + slice_push * slice_push);
        let (down, aside) = (force.y / gc_w, -force.x / gc_w);
        println!(
            "xi {slice_push}: F_V/(Gc w) {down:.4} of {share:.4}, F_H/(Gc w) {aside:.4} of {:.4}, work/(Gc A) {work:.3}, {turning:.3} while turning",
            share * slice_push
        );
        assert!((down / share - 1.0).abs() < 0.05, "xi {slice_push}: F_V/(Gc w) = {down} of {share}");
        assert!((aside - share * slice_push).abs() < 0.05 * share * slice_push.abs().max(0.1), "F_H/(Gc w) = {aside}");
        assert!((work - 1.0).abs() < 0.05, "work/(Gc A) = {work}");
        assert!((turning - 1.0).abs() < 0.2, "work/(Gc A) = {turning} while the force turns");
        let (residual, residual_abs) = rig.residual_ratios();
        assert!(residual_abs < 1e-3, "energy residual {residual} ({residual_abs})");
    }
}

#[test]
fn a_tilted_edge_driven_straight_down_slices_by_the_tangent_of_its_tilt() {
    for (tilt_deg, in_m) in [(15.0f64, 0.014), (30.0, 0.026)] {
        let scene = cutting_scene(block(H_M, 2), 0.16, 1000.0);
        let lowest_m = 0.5 * BLOCK_SIDE_M * tilt_deg.to_radians().tan();
        let at = Vec3::new(0.0, BLOCK_HEIGHT_M + 5e-4 + lowest_m, 4e-4);
        let mut rig = Rig::new(&scene, at, attitude(0.0, tilt_deg, 0.0), SPEED_M_PER_S);
        rig.drive_along(Vec3::y() * -in_m);
        // All of the edge is in, none is out again.
        let (force, work) = stroke(&mut rig, Vec3::y() * (in_m - 0.029));
        // Gc per area of the block's width times the way down: the force along the way is Gc w, none aside.
        let (down, aside) = (force.y / (GC_J_PER_M2 * BLOCK_SIDE_M), force.x / (GC_J_PER_M2 * BLOCK_SIDE_M));
        println!("tilt {tilt_deg}: F_V/(Gc w) {down:.3}, F_H/(Gc w) {aside:.3}, work/(Gc A) {work:.3}");
        assert!((down - 1.0).abs() < 0.05, "F_V/(Gc w) = {down}");
        assert!(aside.abs() < 0.05, "F_H/(Gc w) = {aside}");
        assert!((work - 1.0).abs() < 0.05, "work/(Gc A) = {work}");
    }
}

#[test]
fn toughness_rises_with_the_speed_of_the_cut_by_its_power() {
    let rate = RateDesc { reference_speed_m_per_s: 0.02, exponent: 0.5 };
    for (speed_m_per_s, factor) in [(0.01, 1.0), (0.02, 1.0), (0.045, 1.5), (0.08, 2.0)] {
        let mut object = block(H_M, 2);
        // Elements of E H = 1e4 N/m carry twice the initial Gc.
        object.material.fracture_energy_j_per_m2 = Some(100.0);
        object.material.rate = Some(rate);
        let scene = cutting_scene(object, 0.12, 1000.0);
        let mut rig = Rig::new(&scene, Vec3::new(0.0, BLOCK_HEIGHT_M + 5e-4, 4e-4), Quat::identity(), speed_m_per_s);
        rig.drive(0.02);
        let force = rig.mean_force_n(0.01, 0.02) / (100.0 * BLOCK_SIDE_M);
        println!("{speed_m_per_s} m/s: F/(Gc w) {force:.3} of {factor}");
        assert!((force / factor - 1.0).abs() < 0.05, "{speed_m_per_s} m/s: F/(Gc w) = {force} of {factor}");
        let (residual, residual_abs) = rig.residual_ratios();
        assert!(residual_abs < 1e-3, "energy residual {residual} ({residual_abs})");
    }
}

#[test]
fn a_rate_that_no_front_reaches_leaves_every_bit() {
    let hash = |rate| {
        let mut object = block(H_M, 2);
        object.material.rate = rate;
        let scene = cutting_scene(object, 0.12, 1000.0);
        let at = Vec3::new(0.0, BLOCK_HEIGHT_M + 5e-4, 4e-4);
        let mut rig = Rig::new(&scene, at, Quat::identity(), 0.1);
        rig.drive(0.015);
        assert!(rig.sum(|s| s.area_m2) > 0.0);
        rig.world.state_hash()
    };
    assert_eq!(hash(None), hash(Some(RateDesc { reference_speed_m_per_s: 10.0, exponent: 1.0 })));
}
