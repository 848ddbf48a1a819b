//! Pulled tissue is cut at a lower force: `q_c = Gc - G_el`.

use super::support::cutting::{Rig, attitude, cutting_scene};
use super::support::{body, object, params};
use kerf_physics::scene::{Face, LoadDesc, MaterialDesc, PrestrainDesc, RegionDesc, Scene, ShapeDesc};
use kerf_physics::verification::StepParams;
use kerf_physics::{Body, Crossing, LinkId, Vec3, Workers};

const YOUNG_PA: f64 = 1e6;
const GC_J_PER_M2: f64 = 200.0;
/// Of the strip that is cut: its height between the clamps, m, and its thickness.
const HEIGHT_M: f64 = 0.03;
const THICKNESS_M: f64 = 0.02;
/// Length of the strip, and how deep it is cut from either end beforehand, m.
const LENGTH_M: f64 = 0.24;
const CUT_M: f64 = 0.08;
/// How deep one is cut from its top that is tense in life, m: two heights.
const DEPTH_M: f64 = 0.06;
/// Where the blade and the cuts made beforehand are beside the middle plane, m: off the planes of the lattice. The
/// blade stands in the cut, so its flanks press on neither side.
const BLADE_Z_M: f64 = 3e-4;
/// Thickness of the clamps, m.
const CLAMP_M: f64 = 0.01;

/// A strip along y between a held clamp and a stiff one that is pulled at along z; it is cut from both ends in the
/// middle, and the blade comes down in the upper cut.
fn strip(level: u8, h: f64, pull: f64) -> Scene {
    let (length, half, reach) = (LENGTH_M, 0.5 * HEIGHT_M, 0.5 * HEIGHT_M + CLAMP_M);
    let mut desc = object([0.0, 0.0, -reach], [THICKNESS_M, length, reach], h, level);
    desc.material = MaterialDesc {
        poisson_ratio: 0.0,
        rayleigh_beta_s: 1e-3,
        fracture_energy_j_per_m2: Some(GC_J_PER_M2),
        ..desc.material
    };
    let clamp =
        MaterialDesc { young_modulus_pa: 1e4 * YOUNG_PA, fracture_energy_j_per_m2: None, ..desc.material.clone() };
    let shape = ShapeDesc::Box { min_m: [-1.0, -1.0, half], max_m: [1.0; 3] };
    desc.regions = vec![RegionDesc { name: "clamp".into(), shape, material: clamp }];
    desc.fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, 1.0, -half] }];
    if pull > 0.0 {
        // Over what is not cut: the clamp keeps its angle.
        let region = ShapeDesc::Box { min_m: [-1.0, CUT_M, -1.0], max_m: [1.0, LENGTH_M - CUT_M, 1.0] };
        desc.loads = vec![LoadDesc::Traction { region, face: Face::MaxZ, traction_pa: [0.0, 0.0, pull * YOUNG_PA] }];
    }
    let mut scene = cutting_scene(desc, 2.0 * THICKNESS_M, 1000.0);
    scene.desc.solver.relative_tolerance = Some(1e-4);
    scene
}

/// Cuts the strip from its bottom and from its top, without a blade.
fn cut(body: &mut Body, depths_m: [f64; 2]) {
    let (h, [nx, ny, nz]) = (body.state.grid.voxel_size_m(), body.state.grid.dims());
    let crossing = Crossing { t: (0.5 + BLADE_Z_M / h) as f32, normal: [0.0, 0.0, 1.0] };
    let [below, above] = depths_m.map(|depth_m| (depth_m / h).round() as i32);
    let rows = (0..below).chain(ny - above..ny);
    let link = |i, j| (LinkId { cell: [i, j, nz / 2 - 1], axis: 2 }, crossing);
    let links: Vec<_> = rows.flat_map(|j| (0..nx).map(move |i| link(i, j))).collect();
    let parted = body.part_links(&links).parted;
    body.update_topology(&Workers::serial(), &parted);
}

/// The strip at rest, and its potential energy, J.
fn rest(scene: &Scene, depths_m: [f64; 2]) -> (Body, f64) {
    let mut body = body(&scene.desc.objects[0], StepParams { max_iterations: 2000, ..params(1e-2) });
    cut(&mut body, depths_m);
    let rest = body.relax(&Workers::serial(), &mut |_| ());
    assert!(rest.relative_residual < 1e-5, "{rest:?}");
    let moved = (0..body.node_count()).map(|n| (Vec3::from(body.state.position_m[n]) - body.rest_position_m(n)).into());
    let energy = body.energy();
    let potential_j = energy.elastic_j - body.external_work_j(moved);
    (body, potential_j)
}

/// Mean of the force while the front stands between two depths, per area that it sweeps.
fn mean_force_n(rig: &Rig, depths_m: [f64; 2]) -> f64 {
    let (mut depth_m, mut work, mut swept) = (0.0, 0.0, 0.0);
    for sample in &rig.samples {
        depth_m += sample.area_m2 / THICKNESS_M;
        if (depths_m[0]..depths_m[1]).contains(&depth_m) {
            work += sample.force_n * sample.area_m2;
            swept += sample.area_m2;
        }
    }
    work / swept
}

/// The strip at rest, and what 10 mm more of the upper cut set free, over Gc: by the difference of energies.
fn rest_and_released(scene: &Scene, [below_m, above_m]: [f64; 2]) -> (Body, f64) {
    let [(body, before_j), (_, after_j)] = [above_m, above_m + 0.01].map(|above_m| rest(scene, [below_m, above_m]));
    (body, (before_j - after_j) / (THICKNESS_M * 0.01) / GC_J_PER_M2)
}

/// Brings the blade down through the upper cut and on, from `start` or as the scene begins. The force over Gc w on the
/// way from 2 to 12 mm, and what the ledger leaves of the tool's work.
fn cut_on(scene: &Scene, depths_m: [f64; 2], start: Option<&Body>, speed_m_per_s: f64) -> (f64, f64) {
    let end_m = Vec3::new(0.5 * THICKNESS_M, LENGTH_M + 1e-3, BLADE_Z_M);
    let mut rig = Rig::new(scene, end_m, attitude(0.0, 0.0, 0.0), speed_m_per_s);
    let body = rig.world.body_mut(0);
    cut(body, depths_m);
    if let Some(start) = start {
        body.state.position_m.clone_from(&start.state.position_m);
    }
    rig.drive(depths_m[1] + 0.018);
    let (residual, _) = rig.residual_ratios();
    (mean_force_n(&rig, [0.002, 0.012]) / (GC_J_PER_M2 * THICKNESS_M), residual)
}

#[test]
#[ignore = "slow: three strokes through a strip of 15,000 voxels, a minute"]
fn a_stretched_strip_is_cut_at_gc_less_what_it_sets_free() {
    let (level, h) = (1, 2.5e-3);
    // As the square of the pull.
    let released = rest_and_released(&strip(level, h, 0.05), [CUT_M; 2]).1 / 0.05f64.powi(2);
    for pull in [0.0, 0.05, 0.08] {
        let scene = strip(level, h, pull);
        let start = (pull > 0.0).then(|| rest(&scene, [CUT_M; 2]).0);
        let (found, residual) = cut_on(&scene, [CUT_M; 2], start.as_ref(), 0.05);
        let theory = 1.0 - released * pull * pull;
        println!("pulled by {pull} E: F/(Gc w) {found:.3}, 1 - G_el/Gc {theory:.3}, residual {residual:.1e}");
        // Elements part when the front has come through them: what opens, and sets energy free, is behind the
        // front by half an element on the mean, and then is held by cohesive springs for what the blade has not paid.
        // At this load what is set free doubles in 10 mm, and the shorter cut sets less free: here 0.76 of what
        // theory says.
        let share = (1.0 - found) / (1.0 - theory);
        let is_near = if pull == 0.0 { (found - 1.0).abs() < 0.01 } else { (0.6..1.05).contains(&share) };
        assert!(is_near, "pull {pull}: {found} against {theory}");
        assert!(residual.abs() < 0.01, "pull {pull}: residual {residual} of the tool's work");
    }
}

/// A strip that is tense in life, between clamps that are held: a cut sets free `share` of Gc wherever its end is far from
/// those of the strip.
fn tense_strip(level: u8, h: f64, share: f64) -> Scene {
    let mut scene = strip(level, h, 0.0);
    let desc = &mut scene.desc.objects[0];
    // G = E e^2 / 2 times the height, e the strain from the free shape.
    let strain = (2.0 * share * GC_J_PER_M2 / (YOUNG_PA * HEIGHT_M)).sqrt();
    desc.material.prestrain = Some(PrestrainDesc { strain: strain / (1.0 - strain), along: Some([0.0, 0.0, 1.0]) });
    desc.regions.clear();
    desc.fixed.push(ShapeDesc::Box { min_m: [-1.0, -1.0, 0.5 * HEIGHT_M], max_m: [1.0; 3] });
    scene
}

#[test]
fn a_strip_that_is_tense_in_life_is_cut_at_gc_less_what_it_sets_free() {
    [(1, 5e-3), (2, 2.5e-3)].into_iter().for_each(|(level, h)| tense_strip_is_cut(level, h));
}

#[test]
#[ignore = "slow: smaller elements, half a minute"]
fn so_is_one_of_small_elements() {
    [(0, 5e-3), (1, 2.5e-3)].into_iter().for_each(|(level, h)| tense_strip_is_cut(level, h));
}

fn tense_strip_is_cut(level: u8, h: f64) {
    for share in [0.25, 0.63] {
        let scene = tense_strip(level, h, share);
        let (start, released) = rest_and_released(&scene, [0.0, DEPTH_M]);
        let (found, residual) = cut_on(&scene, [0.0, DEPTH_M], Some(&start), 0.1);
        println!("level {level}, h {h}: F/(Gc w) {found:.3}, 1 - G/Gc {:.3}, residual {residual:.1e}", 1.0 - share);
        assert!((released - share).abs() < 0.01, "level {level}, h {h}: sets {released} of Gc free, not {share}");
        assert!((found - (1.0 - share)).abs() < 0.05, "level {level}, h {h}: {found}, not 1 - {share}");
        assert!(residual.abs() < 1e-3, "level {level}, h {h}: residual {residual} of the tool's work");
    }
}
