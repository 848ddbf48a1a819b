//! The link-energy rule: what it parts, what that takes, and how its force depends on material and mesh.

use super::support::cutting::*;
use super::support::motion_hash;
use kerf_physics::scene::toughness::{asked_over_eh, composite_edge_m};
use kerf_physics::scene::{FractureRule, RateDesc, Scene, SceneDesc, ShapeDesc};
use kerf_physics::{Quat, Vec3};

const H_M: f64 = 2.5e-3;
const LINK_GC_J_PER_M2: f64 = 10.0;
/// Start of a stroke above the block.
const CLEARANCE_M: f64 = 5e-4;
/// From the faces that look along z this much is held, or an element if that is more, m: in half an element beside what
/// is held the energy would be as high as in a smaller one.
const HELD_M: f64 = 5e-3;

/// A block that hangs between its held ends, so that what is cut comes apart.
fn scene(rule: FractureRule, h: f64, level: u8, gc_j_per_m2: f64, young_pa: f64) -> Scene {
    let mut desc = block(h, level);
    let held = 0.5 * BLOCK_SIDE_M - composite_edge_m(h, level).max(HELD_M);
    desc.fixed = vec![
        ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, 1.0, -held] },
        ShapeDesc::Box { min_m: [-1.0, -1.0, held], max_m: [1.0; 3] },
    ];
    desc.fracture_rule = rule;
    desc.material.fracture_energy_j_per_m2 = Some(gc_j_per_m2);
    desc.material.young_modulus_pa = young_pa;
    cutting_scene(desc, 0.12, 1000.0)
}

fn rig(scene: &Scene) -> Rig {
    Rig::new(scene, Vec3::new(0.0, BLOCK_HEIGHT_M + CLEARANCE_M, 4e-4), Quat::identity(), 0.1)
}

#[test]
fn a_stroke_cuts_the_block_in_two_and_every_joule_is_booked() {
    for level in [0, 1, 2] {
        let mut rig = rig(&scene(FractureRule::LinkEnergy, H_M, level, LINK_GC_J_PER_M2, YOUNG_PA));
        rig.drive(0.038);
        let area = rig.sum(|s| s.area_m2);
        let share = |term: fn(&Sample) -> f64| rig.sum(term) / rig.sum(|s| s.energy.tool_work_j);
        let (_, work) = rig.area_and_work_ratio(LINK_GC_J_PER_M2);
        let (residual, residual_abs) = rig.residual_ratios();
        println!(
            "level {level}: mean F/(Gc w) {:.1}, work/(Gc A) {work:.1}; of the tool's work: fracture {:.3} slip {:+.3} \
             parting {:+.3} damping {:.3} numerical {:+.3} residual {residual:+.1e} ({residual_abs:.1e})",
            rig.mean_force_n(0.008, 0.02) / (LINK_GC_J_PER_M2 * BLOCK_SIDE_M),
            share(|s| s.energy.fracture_j),
            share(|s| s.energy.front_slip_j),
            share(|s| s.energy.parting_j),
            share(|s| s.energy.damping_j),
            share(|s| s.energy.numerical_j),
        );
        let voxels = rig.body().state.grid.voxels().len();
        assert_eq!(pieces(rig.body(), |_| true), [voxels / 2, voxels / 2], "level {level}");
        assert_eq!(rig.body().part_count(), 2);
        let left_n = rig.samples[rig.samples.len() - 1].force_n;
        assert!(left_n.abs() < 1e-2 * rig.highest_force_n(), "level {level}: {left_n} N after the cut");
        assert!((area / (BLOCK_SIDE_M * BLOCK_HEIGHT_M) - 1.0).abs() < 1e-3, "level {level}: {area} m^2");
        let booked = rig.sum(|s| s.energy.fracture_j);
        assert!((booked / (LINK_GC_J_PER_M2 * area) - 1.0).abs() < 1e-9, "{booked} J for {area} m^2");
        assert!(residual_abs < 1e-3, "energy residual {residual} ({residual_abs}) of the tool's work");
    }
}

/// Line load at which the first links part, N/m.
fn start_n_per_m(h: f64, level: u8, gc_j_per_m2: f64, young_pa: f64) -> f64 {
    let mut rig = rig(&scene(FractureRule::LinkEnergy, h, level, gc_j_per_m2, young_pa));
    while rig.samples.last().is_none_or(|s| s.parted_links == 0) {
        assert!(rig.travel_m < BLOCK_HEIGHT_M, "nothing parts");
        rig.drive(1e-4);
    }
    rig.highest_force_n() / BLOCK_SIDE_M
}

#[test]
fn the_load_that_starts_a_cut_is_the_elements_edge_times_the_root_of_2_e_gc_over_h() {
    let reference = start_n_per_m(H_M, 2, LINK_GC_J_PER_M2, YOUNG_PA);
    // Doubled: Gc, E, and half the voxels, whose elements are half as large.
    for (what, h, gc_factor, young_factor, expected) in [
        ("2 Gc", H_M, 2.0, 1.0, 2f64.sqrt()),
        ("2 E", H_M, 1.0, 2.0, 2f64.sqrt()),
        ("2 Gc, 2 E", H_M, 2.0, 2.0, 2.0),
        ("h / 2", 0.5 * H_M, 1.0, 1.0, 0.5f64.sqrt()),
    ] {
        let load = start_n_per_m(h, 2, gc_factor * LINK_GC_J_PER_M2, young_factor * YOUNG_PA);
        println!("{what}: {:.3} of the load, {expected:.3} expected", load / reference);
        // A step of the blade adds two hundredths of the load; smaller elements see the block as less thin.
        let bound = if h == H_M { 0.05 } else { 0.1 };
        assert!((load / reference / expected - 1.0).abs() < bound, "{what}: {}", load / reference);
    }
}

#[test]
fn the_scene_is_checked_for_the_load_that_starts_a_cut() {
    for level in [0, 1, 2] {
        let scene = scene(FractureRule::LinkEnergy, H_M, level, LINK_GC_J_PER_M2, YOUNG_PA);
        let material = &scene.desc.objects[0].material;
        let asked = asked_over_eh(material, FractureRule::LinkEnergy, H_M, level).expect("it can be cut");
        let load = start_n_per_m(H_M, level, LINK_GC_J_PER_M2, YOUNG_PA);
        let found = load / (YOUNG_PA * H_M * f64::from(1u32 << level));
        println!("level {level}: starts at {found:.4} E H, {asked:.4} asked");
        assert!((found / asked - 1.0).abs() < 0.03, "level {level}: {found} E H, the check says {asked}");
    }
}

#[test]
fn until_something_gives_both_rules_press_with_the_same_bits() {
    let hash = |rule| {
        let start_m = Vec3::new(0.0, BLOCK_HEIGHT_M + CLEARANCE_M, 4e-4);
        let mut rig = Rig::beyond_limits(&scene(rule, H_M, 2, 1e4, YOUNG_PA), start_m, Quat::identity(), 0.1);
        rig.drive(3e-3);
        assert!(rig.highest_force_n() > 10.0, "the blade presses");
        motion_hash(&rig.world)
    };
    assert_eq!(hash(FractureRule::Front), hash(FractureRule::LinkEnergy));
}

/// Fields of what is wrong with a scene of the rule.
fn problems(change: impl Fn(&mut SceneDesc)) -> Vec<String> {
    let mut scene = scene(FractureRule::LinkEnergy, H_M, 2, LINK_GC_J_PER_M2, YOUNG_PA);
    change(&mut scene.desc);
    scene.problems().iter().map(ToString::to_string).collect()
}

#[test]
fn what_the_rule_cannot_do_is_refused_by_field() {
    assert_eq!(problems(|_| ()), Vec::<String>::new());
    let rate = problems(|s| {
        s.objects[0].material.rate = Some(RateDesc { reference_speed_m_per_s: 0.01, exponent: 0.5 });
    });
    assert!(rate.len() == 1 && rate[0].starts_with("objects[0].material.rate: "), "{rate:?}");
    // 2 % of E H is nothing to the front; a link of so small a voxel does not hold as much.
    let tough = |rule| {
        problems(move |s| {
            s.objects[0].fracture_rule = rule;
            s.objects[0].material.fracture_energy_j_per_m2 = Some(GC_J_PER_M2);
        })
    };
    assert_eq!(tough(FractureRule::Front), Vec::<String>::new());
    let refused = tough(FractureRule::LinkEnergy);
    assert!(refused.len() == 1 && refused[0].starts_with("objects[0].material.fracture_energy_j_per_m2: a link"));
}

#[test]
fn a_file_names_the_rule_and_an_unknown_one_is_refused_with_its_field() {
    let scene = scene(FractureRule::LinkEnergy, H_M, 2, LINK_GC_J_PER_M2, YOUNG_PA);
    let text = toml::to_string(&scene.desc).expect("a scene is TOML");
    assert!(text.contains("fracture_rule = \"link_energy\""));
    assert_eq!(SceneDesc::from_toml("scene.toml", &text).expect("a scene"), scene.desc);
    let unknown = SceneDesc::from_toml("scene.toml", &text.replace("link_energy", "phase_field")).unwrap_err();
    let message = unknown.to_string();
    assert!(message.contains("objects[0].fracture_rule") && message.contains("`link_energy`"), "{message}");
    let unstated = text.replace("fracture_rule = \"link_energy\"\n", "");
    let front = SceneDesc::from_toml("scene.toml", &unstated).expect("a scene");
    assert_eq!(front.objects[0].fracture_rule, FractureRule::Front);
}
