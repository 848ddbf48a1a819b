//! Tissue that is pulled apart: what a crack sets free, against theory, and when it goes on by itself.

use super::support::{body, material, object, params, scene, world_beyond_limits};
use kerf_physics::fracture::release::{Tip, released};
use kerf_physics::scene::{Face, LoadDesc, MaterialDesc, ObjectDesc, RegionDesc, ShapeDesc};
use kerf_physics::verification::StepParams;
use kerf_physics::{Body, Crossing, LinkId, MaterialPoint, NoClock, StepInputs, Vec3, Workers, World};

use std::f64::consts::PI;

const YOUNG_PA: f64 = 1e6;
const THICKNESS_M: f64 = 0.02;
/// Level and voxel size: elements of 5 and of 10 mm.
const MESHES: [(u8, f64); 2] = [(2, 2.5e-3), (1, 2.5e-3)];

fn bounds(min_m: [f64; 3], max_m: [f64; 3]) -> ShapeDesc {
    ShapeDesc::Box { min_m, max_m }
}

/// Parts the links across the plane y = `height_m` between two places along x.
fn crack(body: &mut Body, height_m: f64, along_m: [f64; 2]) {
    let (h, [_, _, nz]) = (body.state.grid.voxel_size_m(), body.state.grid.dims());
    let j = (height_m / h).round() as i32 - 1;
    let [from, to] = along_m.map(|x| (x / h).round() as i32);
    let link = |i, k| (LinkId { cell: [i, j, k], axis: 1 }, Crossing { t: 0.5, normal: [0.0, 1.0, 0.0] });
    let links: Vec<_> = (from..to).flat_map(|i| (0..nz).map(move |k| link(i, k))).collect();
    let parted = body.part_links(&links).parted;
    assert_eq!(parted.len(), links.len());
    body.update_topology(&Workers::serial(), &parted);
}

/// A specimen: its description, where its cracks are, and their common height.
struct Specimen {
    desc: ObjectDesc,
    cracks_m: Vec<[f64; 2]>,
    height_m: f64,
    tip_m: f64,
}

/// A strip 40 mm high between a held clamp and a stiff one that is pulled at, cracked from both ends.
fn strip(level: u8, h: f64, traction_pa: f64) -> Specimen {
    let (height, length, clamp, crack) = (0.04, 0.32, 0.02, 0.08);
    let mut desc = object([0.0; 3], [length, 2.0 * clamp + height, THICKNESS_M], h, level);
    desc.material.poisson_ratio = 0.0;
    desc.fixed = vec![bounds([-1.0; 3], [1.0, clamp, 1.0])];
    let material = MaterialDesc { young_modulus_pa: 1e4 * YOUNG_PA, ..desc.material.clone() };
    let shape = bounds([-1.0, clamp + height, -1.0], [1.0; 3]);
    desc.regions = vec![RegionDesc { name: "clamp".into(), shape, material }];
    let region = bounds([crack, -1.0, -1.0], [length - crack, 1.0, 1.0]);
    desc.loads = vec![LoadDesc::Traction { region, face: Face::MaxY, traction_pa: [0.0, traction_pa, 0.0] }];
    let cracks_m = vec![[0.0, crack], [length - crack, length]];
    Specimen { desc, cracks_m, height_m: clamp + 0.5 * height, tip_m: crack }
}

/// `W H` of the strip: W from how far the clamp has gone over the middle.
fn strip_theory(body: &Body) -> f64 {
    let at_m = Vec3::new(0.16, 0.06, 0.5 * THICKNESS_M);
    let voxel = body.state.grid.voxel_at(body.state.grid.cell_of(&(at_m - Vec3::y() * 1e-4))).expect("in the strip");
    let stretch = (body.current_m(&MaterialPoint { position_m: at_m, voxel }) - at_m).y / 0.04;
    0.5 * YOUNG_PA * stretch * stretch * 0.04
}

const ARM_M: f64 = 0.02;
const CRACK_M: f64 = 0.1;

/// A double cantilever of arms of `arm_m` under opposite shear tractions.
fn cantilever(level: u8, h: f64, arm_m: f64, traction_pa: f64) -> Specimen {
    let length = 0.22;
    let mut desc = object([0.0; 3], [length, 2.0 * arm_m, THICKNESS_M], h, level);
    desc.material = MaterialDesc { poisson_ratio: 0.0, ..material() };
    desc.fixed = vec![bounds([length - 0.02, -1.0, -1.0], [1.0; 3])];
    let pull = |from: f64, to: f64, sign: f64| LoadDesc::Traction {
        region: bounds([-1.0, from, -1.0], [1.0, to, 1.0]),
        face: Face::MinX,
        traction_pa: [0.0, sign * traction_pa, 0.0],
    };
    desc.loads = vec![pull(-1.0, arm_m, -1.0), pull(arm_m, 1.0, 1.0)];
    Specimen { desc, cracks_m: vec![[0.0, CRACK_M]], height_m: arm_m, tip_m: CRACK_M }
}

/// `12 P^2 (a + 0.673 h)^2 / (E b^2 h^3)` (Foote and Buchwald 1985).
fn cantilever_theory(arm_m: f64, traction_pa: f64) -> f64 {
    let force_n = traction_pa * arm_m * THICKNESS_M;
    12.0 * (force_n * (CRACK_M + 0.6728 * arm_m)).powi(2) / (YOUNG_PA * THICKNESS_M.powi(2) * arm_m.powi(3))
}

const BAR_M: f64 = 0.16;

/// A bar that is drawn apart, cracked from both sides up to a ligament of so many voxels within one element.
fn facing_cracks(h: f64, voxels: u32, traction_pa: f64) -> Specimen {
    let mut desc = object([0.0; 3], [BAR_M, 0.1, THICKNESS_M], h, 2);
    desc.material.poisson_ratio = 0.0;
    desc.fixed = vec![bounds([-1.0; 3], [1.0, 0.01, 1.0])];
    let region = bounds([-1.0; 3], [1.0; 3]);
    desc.loads = vec![LoadDesc::Traction { region, face: Face::MaxY, traction_pa: [0.0, traction_pa, 0.0] }];
    let first_m = 0.5 * BAR_M + h;
    let cracks_m = vec![[0.0, first_m], [first_m + h * f64::from(voxels), BAR_M]];
    Specimen { desc, cracks_m, height_m: 0.055, tip_m: first_m }
}

/// `2 P^2 / (pi E b)` of a ligament of width b between two deep cracks, P per thickness (Tada, Paris and Irwin 2000).
fn facing_cracks_theory(width_m: f64, traction_pa: f64) -> f64 {
    2.0 * (traction_pa * BAR_M).powi(2) / (PI * YOUNG_PA * width_m)
}

/// At rest under its loads.
fn still(specimen: &Specimen) -> Body {
    let params = StepParams { max_iterations: 2000, ..params(1e-2) };
    let mut body = body(&specimen.desc, params);
    specimen.cracks_m.iter().for_each(|along_m| crack(&mut body, specimen.height_m, *along_m));
    let rest = body.relax(&Workers::serial(), &mut |_| ());
    assert!(rest.relative_residual < 1e-5, "{rest:?}");
    body
}

fn run(world: &mut World, steps: usize) {
    for _ in 0..steps {
        let fault = world.step(&Workers::serial(), &NoClock, &StepInputs::default()).fault.clone();
        assert!(fault.is_none(), "{fault:?}");
    }
}

/// The energy release rate in the middle of the front, J/m^2.
fn release_rate(body: &Body, specimen: &Specimen) -> f64 {
    let tip = Tip {
        position_m: Vec3::new(specimen.tip_m, specimen.height_m, 0.5 * THICKNESS_M),
        ahead: Vec3::x(),
        along: Vec3::z(),
        element_edge_m: body.lattice_edge_m(),
    };
    let slices = 1000;
    let at_m = |i: i32| tip.position_m + Vec3::z() * ((f64::from(i) + 0.5) / f64::from(slices) - 0.5) * THICKNESS_M;
    let length_m: f64 = (0..slices).map(|i| tip.weight_at(body, &at_m(i)) * THICKNESS_M / f64::from(slices)).sum();
    released(body, &tip).j_per_m / length_m
}

#[test]
fn the_energy_release_rate_is_that_of_theory() {
    hold_release_rates(&MESHES[..1]);
}

#[test]
#[ignore = "slow: the finer meshes, half a minute"]
fn the_energy_release_rate_is_that_of_theory_on_finer_meshes() {
    hold_release_rates(&MESHES[1..]);
}

fn hold_release_rates(meshes: &[(u8, f64)]) {
    for &(level, h) in meshes {
        let specimen = strip(level, h, 1e-3 * YOUNG_PA);
        let body = still(&specimen);
        let ratio = release_rate(&body, &specimen) / strip_theory(&body);
        println!("strip, k {}, h {h}: G / W H = {ratio:.4}", 1 << level);
        assert!((ratio - 1.0).abs() < 0.03, "strip, level {level}, h {h}: {ratio}");
        // The second one runs inside cells where there are any.
        let inside = 0.5 * h * f64::from((1u32 << level) & !1);
        for arm_m in [ARM_M, ARM_M + inside] {
            let specimen = cantilever(level, h, arm_m, 1e-6 * YOUNG_PA);
            let ratio = release_rate(&still(&specimen), &specimen) / cantilever_theory(arm_m, 1e-6 * YOUNG_PA);
            println!("double cantilever of {arm_m}, k {}, h {h}: {ratio:.4}", 1 << level);
            assert!((ratio - 1.0).abs() < 0.06, "cantilever, level {level}, h {h}, arm {arm_m}: {ratio}");
        }
    }
}

/// A specimen whose material can be cut, that starts where `still` is at rest.
fn cuttable(specimen: &Specimen, still: &Body, gc_j_per_m2: f64) -> World {
    let mut desc = specimen.desc.clone();
    desc.material.fracture_energy_j_per_m2 = Some(gc_j_per_m2);
    desc.material.rayleigh_beta_s = 1e-3;
    let mut world = world_beyond_limits(&scene(vec![desc]));
    let body = world.body_mut(0);
    specimen.cracks_m.iter().for_each(|along_m| crack(body, specimen.height_m, *along_m));
    body.state.position_m.clone_from(&still.state.position_m);
    world
}

/// Links that part in it in 100 steps.
fn torn(specimen: &Specimen, still: &Body, gc_j_per_m2: f64) -> u32 {
    let mut world = cuttable(specimen, still, gc_j_per_m2);
    let mut parted = 0;
    for _ in 0..100 {
        run(&mut world, 1);
        parted += world.output().fracture.parted_links;
    }
    parted
}

#[test]
fn ends_of_cuts_are_looked_at_where_their_surroundings_have_changed() {
    let (level, h) = MESHES[0];
    let specimen = strip(level, h, 1e-3 * YOUNG_PA);
    let still = still(&specimen);
    // Two cracks, elements of 10 mm.
    let stations = 2 * 2;
    for (share, most) in [(100.0, 0), (1.1, 2 * stations)] {
        let mut world = cuttable(&specimen, &still, share * strip_theory(&still));
        let mut looks = 0;
        for _ in 0..100 {
            run(&mut world, 1);
            looks += world.output().fracture.looks;
        }
        println!("Gc = {share} G: {looks} looks in 100 steps");
        assert!(looks <= most && (most == 0 || looks >= stations), "Gc {share} of the theory's G: {looks} looks");
    }
    // As it runs, each station once a step at most.
    let mut world = cuttable(&specimen, &still, 0.5 * strip_theory(&still));
    let mut parted = 0;
    for _ in 0..60 {
        run(&mut world, 1);
        let fracture = world.output().fracture;
        parted += fracture.parted_links;
        assert!(fracture.looks <= stations, "{} looks in a step", fracture.looks);
    }
    assert!(parted >= 4 * 16, "{parted} links parted");
}

#[test]
fn a_cut_goes_on_by_itself_at_the_load_that_theory_gives() {
    hold_tearing_loads(&MESHES[..1]);
}

#[test]
#[ignore = "slow: the finer meshes, half a minute"]
fn a_cut_goes_on_by_itself_at_the_load_that_theory_gives_on_finer_meshes() {
    hold_tearing_loads(&MESHES[1..]);
}

fn hold_tearing_loads(meshes: &[(u8, f64)]) {
    for &(level, h) in meshes {
        for name in ["strip", "double cantilever"] {
            let specimen = match name {
                "strip" => strip(level, h, 1e-3 * YOUNG_PA),
                _ => cantilever(level, h, ARM_M, 1e-6 * YOUNG_PA),
            };
            let still = still(&specimen);
            let theory = match name {
                "strip" => strip_theory(&still),
                _ => cantilever_theory(ARM_M, 1e-6 * YOUNG_PA),
            };
            for (share, tears) in [(1.1, false), (0.9, true)] {
                let parted = torn(&specimen, &still, share * theory);
                println!("{name}, k {}, Gc = {share} G: {parted} links parted", 1 << level);
                assert_eq!(parted > 0, tears, "{name}, level {level}, Gc {share} of the theory's G: {parted} parted");
            }
        }
    }
}

#[test]
fn what_facing_cracks_leave_of_an_element_tears_at_1_2_to_1_6_of_the_load_that_theory_gives() {
    let (h, traction_pa) = (2.5e-3, 1e-3 * YOUNG_PA);
    for voxels in [1, 2] {
        let specimen = facing_cracks(h, voxels, traction_pa);
        let still = still(&specimen);
        let theory = facing_cracks_theory(h * f64::from(voxels), traction_pa);
        for (load, tears) in [(1.2, false), (1.6, true)] {
            let parted = torn(&specimen, &still, theory / (load * load));
            println!("{voxels} voxels, {load} of the theory's load: {parted} links parted");
            assert_eq!(parted, if tears { voxels * 8 } else { 0 }, "{voxels} voxels, {load} of the load");
        }
    }
}
