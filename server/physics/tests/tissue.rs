//! Soft tissue under a blade: at every level it carries the line load that cutting it takes, without
//! folding before.

use super::support::cutting::{BLOCK_HEIGHT_M, BLOCK_SIDE_M, Rig, YOUNG_PA, block, cutting_scene};
use super::support::world_of;
use kerf_physics::scene::toughness::{carried_over_eh, composite_edge_m};
use kerf_physics::scene::{BladeDesc, Scene, SceneDesc, ShapeDesc, ToolDesc};
use kerf_physics::step_io::ToolMotion;
use kerf_physics::{NoClock, Pose, Quat, StepInputs, ToolInput, Vec3, Workers};

const RATE_HZ: f64 = 500.0;
const SPEED_M_PER_S: f64 = 0.05;
const HEIGHT_M: f64 = 0.064;
/// Along the edge: a narrower slab bends aside under the blade, as a column does.
const WIDTH_M: f64 = 0.048;
const VOXEL_M: f64 = 0.002;
/// Energy release rate at which a front starts, over Gc.
const INITIATION: f64 = 2.0;

/// Tissue with the strain stiffening that is chosen for its stability.
struct Tissue {
    name: &'static str,
    young_modulus_pa: f64,
    fracture_energy_j_per_m2: f64,
    strain_stiffening: f64,
}

/// Where a blade first cuts: how deep it stands, the highest line load and the most that the load fell
/// by on the way there, N/m.
struct Start {
    depth_m: f64,
    load_n_per_m: f64,
    drop_n_per_m: f64,
}

/// A slab across which a blade lies.
fn slab(tissue: &Tissue, level: u8) -> Scene {
    let mut slab =
        super::support::object([-0.048, 0.0, -0.5 * WIDTH_M], [0.048, HEIGHT_M, 0.5 * WIDTH_M], VOXEL_M, level);
    slab.material.young_modulus_pa = tissue.young_modulus_pa;
    slab.material.poisson_ratio = 0.45;
    slab.material.strain_stiffening = tissue.strain_stiffening;
    slab.material.rayleigh_beta_s = 5e-3;
    slab.material.fracture_energy_j_per_m2 = Some(tissue.fracture_energy_j_per_m2);
    slab.material.initiation_ratio = INITIATION;
    slab.fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, 0.003, 1.0] }];
    let blade = BladeDesc::straight(2.0 * WIDTH_M, 0.1);
    let mut desc = SceneDesc { rate_hz: RATE_HZ, ..SceneDesc::of("slab", vec![slab]) };
    desc.tools = vec![ToolDesc::blade("blade", blade)];
    Scene { desc, meshes: Default::default() }
}

/// Presses until some of the edge cuts.
fn press(tissue: &Tissue, level: u8) -> Start {
    let mut world = world_of(&slab(tissue, level));
    // A blade that came into the scene inside the tissue would not touch it.
    let mut start = Start { depth_m: -5e-4, load_n_per_m: 0.0, drop_n_per_m: 0.0 };
    while start.depth_m < 0.9 * HEIGHT_M {
        start.depth_m += SPEED_M_PER_S / RATE_HZ;
        // Along z, off the planes of the lattice and off the slab's middle: symmetry is not to hold what would fold.
        let position_m = Vec3::new(0.0007, HEIGHT_M - start.depth_m, 1e-5);
        let orientation = Quat::from_euler_angles(0.0, std::f64::consts::FRAC_PI_2, 0.0);
        let motion = ToolMotion::move_to(Pose { position_m, orientation });
        let output = world.step(&Workers::serial(), &NoClock, &StepInputs::of(&[ToolInput { tool: 0, motion }]));
        if output.tools[0].cutting_length_m > 0.0 {
            return start;
        }
        let load_n_per_m = output.tools[0].wrench.force_n.y / WIDTH_M;
        start.load_n_per_m = start.load_n_per_m.max(load_n_per_m);
        start.drop_n_per_m = start.drop_n_per_m.max(start.load_n_per_m - load_n_per_m);
    }
    panic!("{} at level {level} is not cut", tissue.name);
}

/// The load rose to the end, and most of the edge carried what starts a cut: the ends of the edge, where
/// the slab bulges, carry less.
fn holds(tissue: &Tissue, level: u8, least: f64) -> f64 {
    let Start { depth_m, load_n_per_m, drop_n_per_m } = press(tissue, level);
    let needed = INITIATION * tissue.fracture_energy_j_per_m2;
    println!("{}, level {level}: {load_n_per_m:.1} of {needed:.1} N/m, dent {:.1} mm", tissue.name, 1e3 * depth_m);
    assert!(drop_n_per_m < 0.02 * needed, "{} at level {level} folds: {drop_n_per_m} N/m", tissue.name);
    assert!(load_n_per_m > least * needed, "{} at level {level} carries {load_n_per_m} N/m", tissue.name);
    depth_m
}

/// Moduli and fracture energies as measured: liver, pig's skin (needles), firm tofu (its fracture energy is
/// not known: that of other gels), gelatine of 10 % cut slowly.
fn tissues() -> [Tissue; 4] {
    [("liver", 1e4, 200.0, 10.0), ("skin", 2e5, 1136.0, 10.0), ("tofu", 2.64e4, 10.0, 3.0), ("gelatine", 1e4, 1.1, 3.0)]
        .map(|(name, young_modulus_pa, fracture_energy_j_per_m2, strain_stiffening)| Tissue {
            name,
            young_modulus_pa,
            fracture_energy_j_per_m2,
            strain_stiffening,
        })
}

#[test]
fn tissue_carries_what_cutting_it_takes_at_coarse_levels() {
    for tissue in tissues() {
        holds(&tissue, 2, 0.85);
        holds(&tissue, 3, 0.85);
    }
}

#[test]
#[ignore = "slow: the finer levels, half a minute"]
fn tissue_carries_what_cutting_it_takes_at_the_same_dent_on_finer_levels() {
    for tissue in tissues() {
        let dents = [0, 1, 2].map(|level| holds(&tissue, level, 0.85));
        for dent in &dents {
            // Within 10 % and a step.
            assert!((dent - dents[0]).abs() < 0.1 * dents[0] + 1e-4, "{}: dents {dents:?} m", tissue.name);
        }
    }
}

fn carries_what_scenes_are_granted(level: u8) {
    let mut tissue =
        Tissue { name: "granted", young_modulus_pa: 1e4, fracture_energy_j_per_m2: 1.0, strain_stiffening: 10.0 };
    let material = &slab(&tissue, level).desc.objects[0].material;
    let load_n_per_m = carried_over_eh(material, level) * 1e4 * VOXEL_M * f64::from(1u32 << level);
    tissue.fracture_energy_j_per_m2 = load_n_per_m / INITIATION;
    holds(&tissue, level, 0.85);
}

#[test]
fn stiffened_elements_carry_the_load_that_scenes_are_granted() {
    [1, 2].into_iter().for_each(carries_what_scenes_are_granted);
}

#[test]
#[ignore = "slow: full FEM, a quarter of a minute"]
fn so_do_stiffened_voxels() {
    carries_what_scenes_are_granted(0);
}

/// A blade through a block of the linear law whose initiation asks `load_over_eh` of its elements: the highest
/// force before 24 mm, and the mean force from 3 to 7 mm after the first cut, over Gc w.
fn linear_cut(level: u8, load_over_eh: f64) -> (f64, f64) {
    let voxel_m = 2.5e-3;
    let gc = load_over_eh * YOUNG_PA * composite_edge_m(voxel_m, level) / INITIATION;
    let mut block = block(voxel_m, level);
    block.material.initiation_ratio = INITIATION;
    block.material.fracture_energy_j_per_m2 = Some(gc);
    let start_m = Vec3::new(0.0, BLOCK_HEIGHT_M + 5e-4, 4e-4);
    let mut rig = Rig::beyond_limits(&cutting_scene(block, 0.12, 1000.0), start_m, Quat::identity(), 0.1);
    rig.drive(0.025);
    let first_m = rig.samples.iter().find(|s| s.area_m2 > 0.0).map_or(rig.travel_m, |s| s.travel_m);
    let gc_w = gc * BLOCK_SIDE_M;
    (rig.highest_force_n() / gc_w, rig.mean_force_n(first_m + 0.003, first_m + 0.007) / gc_w)
}

#[test]
fn linear_elements_carry_the_load_that_scenes_are_granted_and_fold_under_twice_as_much() {
    for level in [0, 1, 2] {
        let granted = carried_over_eh(&super::support::material(), level);
        let (highest, steady) = linear_cut(level, granted);
        println!("level {level}, {granted} E H: highest {highest:.2}, then F/(Gc w) {steady:.3}");
        // The sides of the block, which give way, start their shares of the cut before the middle does.
        assert!((0.85 * INITIATION..1.05 * INITIATION).contains(&highest), "level {level}: starts at {highest} Gc w");
        assert!((steady - 1.0).abs() < 0.06, "level {level}: F/(Gc w) = {steady}");
        let (folded, _) = linear_cut(level, 2.0 * granted);
        println!("  at twice as much: highest {folded:.2}");
        // At 0.49 to 0.71 of what it should be; of single voxels that hangs on how the cut starts.
        assert!(folded < 0.75 * INITIATION, "level {level}: {folded} Gc w at twice what is granted");
    }
}
