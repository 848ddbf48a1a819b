//! Pulled tissue is cut at a lower force: `q_c = Gc - G_el`.

mod support;

use kerf_physics::Vec3;
use kerf_physics::body::{Body, MaterialPoint};
use kerf_physics::scene::{Face, LoadDesc, MaterialDesc, RegionDesc, Scene, ShapeDesc};
use support::cutting::{Rig, attitude, cutting_scene};
use support::object;

const YOUNG_PA: f64 = 1e6;
const GC_J_PER_M2: f64 = 200.0;
/// Of the strip that is cut: its height between the grips, m, and its thickness.
const HEIGHT_M: f64 = 0.03;
const THICKNESS_M: f64 = 0.02;
/// Length of the strip, and how deep it is cut, m.
const LENGTH_M: f64 = 0.24;
const CUT_M: f64 = 0.05;
/// Thickness of the grips, m.
const GRIP_M: f64 = 0.01;

/// A strip along y between grips at either end of z, pulled apart at both; the blade comes down in its middle.
fn strip(level: u8, h: f64, stretch: f64) -> Scene {
    let (length, half, reach) = (LENGTH_M, 0.5 * HEIGHT_M, 0.5 * HEIGHT_M + GRIP_M);
    let mut desc = object([0.0, 0.0, -reach], [THICKNESS_M, length, reach], h, level);
    desc.material = MaterialDesc {
        poisson_ratio: 0.0,
        rayleigh_beta_s: 1e-3,
        fracture_energy_j_per_m2: Some(GC_J_PER_M2),
        ..desc.material
    };
    let grip =
        MaterialDesc { young_modulus_pa: 100.0 * YOUNG_PA, fracture_energy_j_per_m2: None, ..desc.material.clone() };
    for (face, side) in [(Face::MinZ, -1.0), (Face::MaxZ, 1.0)] {
        let [near, far] = [side * half, side * 1.0];
        let shape = ShapeDesc::Box { min_m: [-1.0, -1.0, near.min(far)], max_m: [1.0, 1.0, near.max(far)] };
        desc.regions.push(RegionDesc { name: format!("{face:?}"), shape: shape.clone(), material: grip.clone() });
        if stretch > 0.0 {
            let traction_pa = [0.0, 0.0, side * stretch * YOUNG_PA];
            // On what stays uncut: the grips keep their angle.
            let region = ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, LENGTH_M - CUT_M, 1.0] };
            desc.loads.push(LoadDesc::Traction { region, face, traction_pa });
        }
    }
    desc.fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, 1.01 * h, 1.0] }];
    let mut scene = cutting_scene(desc, 2.0 * THICKNESS_M, 1000.0);
    scene.desc.solver.relative_tolerance = 1e-4;
    scene
}

/// `W H` where the strip has not been cut yet, `ahead_m` below the edge.
fn stored_ahead(body: &Body, edge_m: &Vec3, ahead_m: f64) -> f64 {
    let at = |z: f64| {
        let position_m = Vec3::new(0.5 * THICKNESS_M, edge_m.y - ahead_m, z);
        let inside_m = position_m - Vec3::z() * 1e-4 * z.signum();
        let voxel = body.grid.voxel_at(body.grid.cell_of(&inside_m)).expect("in the strip");
        (body.current_m(&MaterialPoint { position_m, voxel }) - position_m).z
    };
    let stretch = (at(0.5 * HEIGHT_M) - at(-0.5 * HEIGHT_M)) / HEIGHT_M;
    0.5 * YOUNG_PA * stretch * stretch * HEIGHT_M
}

#[test]
fn a_stretched_strip_is_cut_at_gc_less_what_it_sets_free() {
    for (level, h) in [(1, 2.5e-3), (2, 1.25e-3)] {
        for stretch in [0.0, 0.04, 0.06, 0.08] {
            let scene = strip(level, h, stretch);
            let top_m = Vec3::new(0.5 * THICKNESS_M, LENGTH_M + 1e-3, 3e-4);
            let mut rig = Rig::new(&scene, top_m, attitude(0.0, 0.0, 0.0), 0.05);
            rig.rest(1);
            rig.drive(CUT_M - 0.005);
            let before = rig.samples.len();
            rig.drive(0.01);
            let force =
                rig.samples[before..].iter().map(|s| s.force_n).sum::<f64>() / (rig.samples.len() - before) as f64;
            let found = force / (GC_J_PER_M2 * THICKNESS_M);
            let stored = stored_ahead(rig.body(), &rig.position_m, 0.02) / GC_J_PER_M2;
            let (residual, _) = rig.residual_ratios();
            println!(
                "k {}, stretched by {stretch}: F/(Gc w) = {found:.3}, 1 - W H/Gc = {:.3}, residual {residual:.1e}",
                1 << level,
                1.0 - stored
            );
            assert!(
                (found - (1.0 - stored)).abs() < 0.08,
                "level {level}, stretch {stretch}: {found} against {}",
                1.0 - stored
            );
        }
    }
}
