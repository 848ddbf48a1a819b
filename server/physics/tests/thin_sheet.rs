//! A sheet that is thinner than a voxel is touched and cut.

use super::support::cutting::*;
use kerf_physics::Vec3;
use kerf_physics::scene::ShapeDesc;

const SHEET_GC_J_PER_M2: f64 = 5.0;
const SIDE_M: f64 = 0.1;
const THICKNESS_M: f64 = 1e-3;

#[test]
fn a_sheet_thinner_than_a_voxel_is_cut_for_its_own_section() {
    for (h, level) in [(3.333e-3, 0), (2.5e-3, 0), (2.5e-3, 1), (2.0e-3, 0)] {
        let (half, thin) = (0.5 * SIDE_M, 0.5 * THICKNESS_M);
        let mut sheet = super::support::object([-half, -thin, -half], [half, thin, half], h, level);
        sheet.material.young_modulus_pa = 2e6;
        sheet.material.poisson_ratio = 0.0;
        sheet.material.fracture_energy_j_per_m2 = Some(SHEET_GC_J_PER_M2);
        sheet.material.strain_stiffening = 10.0;
        let side = |from: f64, to: f64| ShapeDesc::Box { min_m: [from, -1.0, -1.0], max_m: [to, 1.0, 1.0] };
        sheet.fixed = vec![side(-1.0, -0.011), side(0.011, 1.0)];
        let scene = cutting_scene(sheet, 1.2 * SIDE_M, 250.0);
        let mut rig = Rig::new(&scene, Vec3::new(0.0012, 0.012, 0.0), attitude(90.0, 0.0, 0.0), 0.04);
        rig.drive(0.022);
        let sizes = pieces(rig.body(), |_| true);
        let (area, work) = rig.area_and_work_ratio(SHEET_GC_J_PER_M2);
        let share = area / (SIDE_M * THICKNESS_M);
        let force = rig.highest_force_n() / (SHEET_GC_J_PER_M2 * SIDE_M);
        println!(
            "h {h}, level {level}: area {share:.3} of the section, at most {force:.3} Gc w, work/(Gc A) {work:.3}"
        );
        assert_eq!(sizes.len(), 2, "h {h}, level {level}: pieces of {sizes:?} voxels");
        // The sheet bends under the edge, so that the cut is not straight across it.
        assert!((0.95..1.2).contains(&share), "h {h}, level {level}: {share} of the section");
        assert!((force - 1.0).abs() < 0.05, "h {h}, level {level}: {force} Gc w");
        assert!((work - 1.0).abs() < 0.02, "h {h}, level {level}: work/(Gc A) = {work}");
    }
}
