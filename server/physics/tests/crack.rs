//! The crack is the body's: what is cut once is not paid again, whoever cut it.

use super::support::cutting::*;
use kerf_physics::scene::{BladeDesc, ShapeDesc, ToolDesc};
use kerf_physics::{Quat, Vec3};

const TOP_M: f64 = BLOCK_HEIGHT_M + 1e-3;
/// A depth at which no layer of voxels of 1.25 or 2.5 mm ends.
const DEPTH_M: f64 = 0.0118;
const WAY_M: f64 = DEPTH_M + TOP_M - BLOCK_HEIGHT_M;
const SOFT_GC_J_PER_M2: f64 = 50.0;
const BLADE_Z_M: f64 = 4e-4;

/// A block that is soft enough for an edge to press before it cuts, and a blade that is wider.
fn groove(h: f64, level: u8) -> Rig {
    let mut object = block(h, level);
    object.material.young_modulus_pa = 2e5;
    object.material.fracture_energy_j_per_m2 = Some(SOFT_GC_J_PER_M2);
    object.material.strain_stiffening = 10.0;
    let scene = cutting_scene(object, 0.06, 250.0);
    Rig::new(&scene, Vec3::new(0.0, TOP_M, BLADE_Z_M), Quat::identity(), 0.05)
}

/// Area and fracture energy of all steps.
fn booked(rig: &Rig) -> (f64, f64) {
    (rig.sum(|s| s.area_m2), rig.sum(|s| s.energy.fracture_j))
}

/// One stroke down and up, and the highest force on the way down to where the cut ends, N.
fn stroke(rig: &mut Rig, front_m: f64) -> f64 {
    let first = rig.samples.len();
    rig.travel_m = 0.0;
    rig.drive(WAY_M);
    let free = rig.samples[first..].iter().filter(|s| s.travel_m < front_m + TOP_M - BLOCK_HEIGHT_M);
    let highest_n = free.map(|s| s.force_n).fold(0.0, f64::max);
    rig.drive(-WAY_M);
    highest_n
}

fn hold_ten_strokes(meshes: &[(f64, u8)]) {
    for &(h, level) in meshes {
        let mut rig = groove(h, level);
        stroke(&mut rig, 0.0);
        let once = booked(&rig);
        let front_m = once.0 / BLOCK_SIDE_M;
        assert!((0.8 * DEPTH_M..DEPTH_M).contains(&front_m), "h {h}, level {level}: cut to {front_m} m");
        let mut highest_n: f64 = 0.0;
        for repeat in 1..10 {
            // With and without lifting between them.
            if repeat % 2 == 0 {
                rig.lift();
                rig.enter_at(Vec3::new(0.0, TOP_M, BLADE_Z_M));
            }
            highest_n = highest_n.max(stroke(&mut rig, front_m - 0.2 * h));
        }
        let ten = booked(&rig);
        let [area, energy] = [ten.0 / once.0, ten.1 / once.1];
        let force = highest_n / (SOFT_GC_J_PER_M2 * BLOCK_SIDE_M);
        println!("h {h}, level {level}: area {area:.4} and energy {energy:.4} of one stroke's, {force:.4} Gc w in it");
        assert!((1.0..1.01).contains(&area) && (1.0..1.01).contains(&energy), "h {h}, level {level}");
        assert!(force < 1e-3, "h {h}, level {level}: {force} Gc w in a groove that is cut already");
    }
}

#[test]
fn ten_strokes_in_one_groove_book_what_one_books() {
    hold_ten_strokes(&[(2.5e-3, 1), (2.5e-3, 2)]);
}

#[test]
#[ignore = "slow: the finer meshes, half a minute"]
fn ten_strokes_in_one_groove_book_what_one_books_on_finer_meshes() {
    hold_ten_strokes(&[(2.5e-3, 0), (1.25e-3, 1), (1.25e-3, 2)]);
}

#[test]
fn two_blades_that_come_from_both_sides_cut_the_section_once() {
    for (h, level, first_m) in [(2.5e-3, 1, 0.0142), (2.5e-3, 1, 0.0155), (2.5e-3, 2, 0.0161), (1.25e-3, 2, 0.0148)] {
        let mut object = block(h, level);
        let side = |from: f64, to: f64| ShapeDesc::Box { min_m: [-1.0, -1.0, from], max_m: [1.0, 1.0, to] };
        object.fixed = vec![side(-1.0, -0.0149), side(0.0149, 1.0)];
        let mut scene = cutting_scene(object, 0.06, 500.0);
        scene.desc.tools.push(ToolDesc::blade("from below", BladeDesc::straight(0.05, 0.06)));
        let mut rig = Rig::new(&scene, Vec3::new(0.0, TOP_M, BLADE_Z_M), Quat::identity(), 0.1);
        rig.drive(first_m + TOP_M - BLOCK_HEIGHT_M);
        rig.drive(-first_m - 2e-3);
        rig.lift();
        let from_above = booked(&rig).0;
        rig.tool = 1;
        rig.orientation = attitude(0.0, 180.0, 0.0);
        rig.enter_at(Vec3::new(0.0, -1e-3, BLADE_Z_M));
        rig.drive(TOP_M + 2e-3);
        let (area, work) = rig.area_and_work_ratio(GC_J_PER_M2);
        let [area, above] = [area, from_above].map(|m2| m2 / (BLOCK_SIDE_M * BLOCK_HEIGHT_M));
        println!(
            "h {h}, level {level}, {first_m} m: {above:.3} of the section from above, {area:.4} in all, work {work:.4}"
        );
        assert_eq!(pieces(rig.body(), |_| true).len(), 2, "h {h}, level {level}, {first_m} m");
        assert!((area - 1.0).abs() < 0.01, "h {h}, level {level}, {first_m} m: {area} of the section");
        assert!((work - 1.0).abs() < 0.05, "h {h}, level {level}, {first_m} m: work/(Gc A) = {work}");
    }
}
