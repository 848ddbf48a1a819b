//! Pulled tissue is cut at a lower force.

mod support;

use kerf_physics::Vec3;
use kerf_physics::scene::{Face, LoadDesc, ShapeDesc};
use support::cutting::{BLOCK_HEIGHT_M, BLOCK_SIDE_M, GC_J_PER_M2, Rig, YOUNG_PA, attitude, block, cutting_scene};

#[test]
fn probe() {
    for (h, level) in [(2.5e-3, 2), (2.5e-3, 1), (2.5e-3, 0)] {
        for traction in [0.0f64, 1e-9, 2e4, 4e4] {
            let mut object = block(h, level);
            let half = 0.5 * BLOCK_SIDE_M;
            if traction > 0.0 {
                for (face, sign) in [(Face::MinZ, -1.0), (Face::MaxZ, 1.0)] {
                    let region = ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0; 3] };
                    object.loads.push(LoadDesc::Traction { region, face, traction_pa: [0.0, 0.0, sign * traction] });
                }
            }
            let mut scene = cutting_scene(object, 2.0 * half + 0.01, 1000.0);
            scene.desc.solver.relative_tolerance = 1e-3;
            let mut rig =
                Rig::new(&scene, Vec3::new(0.0, BLOCK_HEIGHT_M + 1e-3, 0.0007), attitude(0.0, 0.0, 0.0), 0.05);
            rig.drive(0.021);
            let want = GC_J_PER_M2 * BLOCK_SIDE_M;
            let force: Vec<String> = (0..7)
                .map(|i| {
                    format!("{:.3}", rig.mean_force_n(0.004 + 0.0025 * i as f64, 0.0055 + 0.0025 * i as f64) / want)
                })
                .collect();
            let w = traction * traction / (2.0 * YOUNG_PA) * BLOCK_SIDE_M;
            eprintln!(
                "h {h} level {level} t {traction}: F/(Gc w) {force:?}; W L / Gc {:.3}; residual {:?}",
                w / GC_J_PER_M2,
                rig.residual_ratios()
            );
        }
    }
}
