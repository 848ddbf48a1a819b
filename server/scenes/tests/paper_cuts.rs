//! The paper's scenes under the blade, as its figures show them.

use crate::support::cutting::{Rig, pieces};
use crate::support::swept::{Swept, crossings};
use kerf_physics::scene::ToolShapeDesc;
use kerf_physics::step_io::{EnergyStep, ToolMotion};
use kerf_physics::{NoClock, Quat, StepInputs, ToolInput, Vec3, Workers};
use kerf_scenes::catalog;

/// How far the blade is above the surface when it enters, m.
const CLEARANCE_M: f64 = 5e-4;

/// The dent at the first cut over the object's height, by a blade pressed into the middle of its top.
fn dent_at_the_first_cut(name: &str) -> f64 {
    let scene = catalog::builtin(name).unwrap();
    let height_m = 0.055;
    let start_m = Vec3::new(0.0, height_m + CLEARANCE_M, 4e-4);
    let mut rig = Rig::new(&scene, start_m, Quat::identity(), 0.1);
    while rig.travel_m < 0.8 * height_m {
        rig.drive(5e-4);
        if rig.samples.last().is_some_and(|sample| sample.area_m2 > 0.0) {
            let dent = (rig.travel_m - CLEARANCE_M) / height_m;
            println!("{name}: cut after a dent of {dent:.3} of the height, {:.1} N", rig.highest_force_n());
            return dent;
        }
    }
    panic!("{name} is not cut after {} m", rig.travel_m);
}

#[test]
fn jelly_parts_after_a_large_deformation_tofu_earlier_and_rubber_at_a_small_one() {
    let [jelly, tofu, rubber] = ["jelly", "tofu", "rubber"].map(dent_at_the_first_cut);
    assert!(jelly > 0.2 && rubber < 0.1, "jelly {jelly}, rubber {rubber} of the height");
    assert!(jelly > 1.3 * tofu && tofu > 1.5 * rubber, "jelly {jelly}, tofu {tofu}, rubber {rubber} of the height");
}

#[test]
fn the_cuboids_are_cut_along_the_edges_of_their_blades() {
    for name in ["cuboid-polyline", "cuboid-sine"] {
        let scene = catalog::builtin(name).unwrap();
        let ToolShapeDesc::Blade(blade) = &scene.desc.tools[0].shape else { panic!("{name} has a blade") };
        let swept = Swept(blade.edge.points_m(blade.width_m).unwrap());
        let object = &scene.desc.objects[0];
        let (h, gc) = (object.voxel_size_m.unwrap(), object.material.fracture_energy_j_per_m2.unwrap());
        let start_m = Vec3::new(0.0, 0.07 + CLEARANCE_M, 4e-4);
        let mut rig = Rig::new(&scene, start_m, Quat::identity(), 0.1);
        rig.drive(0.02);
        let found: Vec<Vec3> = crossings(rig.body().grid()).iter().map(|at| at - start_m).collect();
        let off = found.iter().map(|at| swept.distance_m(at).abs()).fold(0.0, f64::max);
        // The other way: from what was swept, down to a dent of 4 Gc/E and a voxel above the edge, to the
        // nearest crossing.
        let dent_m = 4.0 * gc / object.material.young_modulus_pa + h;
        let inside = |at: &Vec3| {
            let at = at + start_m;
            let below_edge = at.y - (rig.position_m.y + dent_m);
            (0.07 - at.y).min(below_edge).min(0.0575 - at.x.abs())
        };
        let surface = swept.surface(0.5 * h, |at| inside(at) - 0.5 * h);
        let nearest = |at: &Vec3| found.iter().map(|f| (f - at).norm()).fold(f64::INFINITY, f64::min);
        let missed = surface.iter().map(|(at, ..)| nearest(at)).fold(0.0, f64::max);
        let length_m = swept.length_m(|x| x.abs() < 0.0575);
        let force = rig.mean_force_n(0.012, 0.02) / (gc * length_m);
        let (_, work) = rig.area_and_work_ratio(gc);
        println!(
            "{name}: {} links, off by {:.2} h, {} points missed by at most {:.2} h, edge {:.2} of the width, \
             F/(Gc L) {force:.3}, work/(Gc A) {work:.3}",
            found.len(),
            off / h,
            surface.len(),
            missed / h,
            length_m / 0.115
        );
        assert!(off <= 0.5 * h, "{name}: a crossing {off} m off the swept surface");
        assert!(!surface.is_empty() && missed <= (0.5f64.sqrt() + 0.5) * h, "{name}: missed by {missed} m");
        assert!((force - 1.0).abs() < 0.06, "{name}: F/(Gc L) = {force}");
        assert_eq!(pieces(rig.body(), |_| true).len(), 1, "{name} is cut through at 20 of 70 mm");
    }
}

#[test]
fn the_gummy_bear_is_beheaded_in_one_stroke() {
    let scene = catalog::builtin("gummy-bear").unwrap();
    let gc = scene.desc.objects[0].material.fracture_energy_j_per_m2.unwrap();
    // Down between muzzle and chest, the edge along x: the stroke goes through the neck from the front.
    let turn = Quat::from_axis_angle(&Vec3::x_axis(), std::f64::consts::FRAC_PI_2);
    let mut rig = Rig::new(&scene, Vec3::new(0.0, 0.0345, 0.02), turn, 0.2);
    assert!((rig.forward() + Vec3::z()).norm() < 1e-9, "from the front");
    // It leans back on its feet before the blade: the neck is through 10 mm behind where it is at rest.
    rig.drive(0.056);
    let sizes = pieces(rig.body(), |_| true);
    let (area_m2, work) = rig.area_and_work_ratio(gc);
    println!("gummy bear: pieces {sizes:?}, {:.2} cm^2, work/(Gc A) {work:.3}", 1e4 * area_m2);
    assert_eq!(sizes.len(), 2, "pieces of {sizes:?} voxels");
    assert!(sizes[0] > 10_000, "the head is one piece");
    assert!((work - 1.0).abs() < 0.1, "work/(Gc A) = {work}");
}

#[test]
fn the_liver_comes_to_rest_after_a_cut_at_display_rates() {
    for rate_hz in [60.0, 100.0] {
        let mut scene = catalog::builtin("liver").unwrap().into_scene();
        scene.desc.rate_hz = rate_hz;
        let mut rig = Rig::new(&scene, Vec3::new(0.0, 0.16, 0.0), Quat::identity(), 0.1);
        rig.drive(0.12);
        let lift = [ToolInput { tool: 0, motion: ToolMotion::Lift }];
        rig.world.step(&Workers::serial(), &NoClock, &StepInputs::of(&lift));
        let mut energy = EnergyStep::default();
        for _ in 0..rate_hz as u32 {
            energy = rig.world.step(&Workers::serial(), &NoClock, &StepInputs::default()).energy;
        }
        let (kinetic_j, elastic_j) = (energy.kinetic_j, energy.elastic_j);
        println!("{rate_hz} Hz: a second later {kinetic_j:.1e} J are kinetic, {elastic_j:.2} J elastic");
        assert!(kinetic_j < 1e-7 * elastic_j, "{rate_hz} Hz: {kinetic_j} J beside {elastic_j} J");
    }
}

/// Elements of 28 mm in a liver of 140 mm: where a front is sampled takes in where the liver is held.
#[test]
fn the_coarsest_liver_is_held_back_by_no_more_than_half_of_its_fracture_energy() {
    let mut scene = catalog::builtin("liver").unwrap().into_scene();
    scene.desc.objects[0].level = 3;
    let gc_j_per_m2 = scene.desc.objects[0].material.fracture_energy_j_per_m2.unwrap();
    let mut rig = Rig::new(&scene, Vec3::new(0.0, 0.16, 0.0), Quat::identity(), 0.1);
    rig.drive(0.12);
    let over_gc_w = rig.highest_force_n() / (gc_j_per_m2 * 0.06);
    let spent = rig.sum(|sample| sample.energy.fracture_j) / rig.sum(|sample| sample.energy.tool_work_j);
    println!("level 3: at most {over_gc_w:.2} Gc w, {spent:.2} of the tool's work is fracture");
    assert!(over_gc_w < 1.55 && spent > 0.9, "{over_gc_w} Gc w, {spent} of the work");
}
