//! A line load on soft tissue: where the linear law folds, and that strain stiffening carries it.

use super::support::cutting::{Rig, cutting_scene};
use super::support::object;
use kerf_physics::Quat;
use kerf_physics::Vec3;
use kerf_physics::scene::ShapeDesc;

const H_M: f64 = 2e-3;
const YOUNG_PA: f64 = 1e4;
const HEIGHT_M: f64 = 0.048;
const WIDTH_M: f64 = 0.024;

/// A slab under a blade that does not cut it; x 24 mm, z 64 mm.
fn slab(level: u8, stiffening: f64) -> Rig {
    let mut desc = object([-0.5 * WIDTH_M, 0.0, -0.032], [0.5 * WIDTH_M, HEIGHT_M, 0.032], H_M, level);
    desc.material.young_modulus_pa = YOUNG_PA;
    desc.material.rayleigh_beta_s = 2e-3;
    desc.material.rayleigh_alpha_per_s = 5.0;
    desc.material.strain_stiffening = stiffening;
    // Far beyond what is pressed here: the edge stands on the elements themselves.
    desc.material.fracture_energy_j_per_m2 = Some(1e4);
    desc.fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, 1.01 * H_M, 1.0] }];
    let scene = cutting_scene(desc, 0.12, 500.0);
    Rig::beyond_limits(&scene, Vec3::new(0.0, HEIGHT_M + 2e-4, 3e-4), Quat::identity(), 0.2)
}

/// Presses until the line load is `target` or the dent `deepest`; the dent and the highest load, m, N/m.
fn press(rig: &mut Rig, target: f64, deepest: f64) -> (f64, f64) {
    while rig.highest_force_n() / WIDTH_M < target && rig.travel_m < deepest {
        rig.drive(2e-4);
    }
    (rig.travel_m, rig.highest_force_n() / WIDTH_M)
}

#[test]
fn the_linear_law_folds_below_a_line_load_of_e_h() {
    for (level, k) in [(2, 4.0), (1, 2.0)] {
        let mut rig = slab(level, 0.0);
        let (dent, load) = press(&mut rig, 400.0, 0.04);
        let folded = load / (YOUNG_PA * k * H_M);
        println!("linear, k {k}: carries at most {load:.1} N/m = {folded:.2} E H, pressed by {:.1} mm", dent * 1e3);
        assert!((0.4..3.0).contains(&folded) && load < 150.0, "k {k}: {load} N/m");
    }
}

#[test]
fn strain_stiffening_carries_the_line_load_of_liver_and_springs_back() {
    let mut dents = Vec::new();
    for level in [2, 1] {
        let mut rig = slab(level, 10.0);
        let (dent, load) = press(&mut rig, 400.0, 0.045);
        println!("c = 10, k {}: {load:.0} N/m at {:.2} mm", 1 << level, dent * 1e3);
        assert!(load >= 400.0, "level {level}: folds at {load} N/m");
        dents.push(dent);
        rig.lift();
        for _ in 0..700 {
            rig.lift();
        }
        let body = rig.body();
        let left = (0..body.node_count())
            .map(|n| (Vec3::from(body.state.position_m[n]) - body.rest_position_m(n)).amax())
            .fold(0.0, f64::max);
        println!("  {:.1e} mm left after the lift", left * 1e3);
        assert!(left < 1e-2 * H_M, "level {level}: {left} m left after the lift");
    }
    assert!((dents[0] / dents[1] - 1.0).abs() < 0.1, "dents {dents:?}");
}
