//! Materials, steps and voxels from one end of their ranges to the other, under a blade that presses
//! in, waits and is lifted.

use kerf_physics::scene::{RegionDesc, ShapeDesc};
use kerf_physics::step_io::ToolMotion;
use kerf_physics::{SceneProblems, Vec3};

use super::scenes::{Specimen, SplitMix64, level_at, line};
use super::trial::{Measures, Return, Trial};
use super::{Budget, Case, Family};

/// Fraction of its height by which a specimen is pressed in.
const DENT: f64 = 0.15;
/// Contrasts of Young's modulus, up to the most that is supported.
const CONTRASTS: [f64; 3] = [1e2, 1e4, 1e6];

/// Presses a blade into a held block over about a period of it, waits, lifts it and lets go.
pub(super) fn pressed(
    specimen: &Specimen,
    scene: kerf_physics::Scene,
    budget: Budget,
) -> Result<Measures, SceneProblems> {
    let mut trial = Trial::new(scene)?;
    let height_m = specimen.extent_m().y;
    let start = level_at(Vec3::new(0.0, height_m + 0.1 * specimen.voxel_size_m, 0.06 * specimen.voxel_size_m));
    let steps = (specimen.period_s() / specimen.dt_s).clamp(30.0, f64::from(budget.most_steps / 4)) as u32;
    trial.step(&[ToolMotion::enter_at(start)]);
    for motion in line(start, -Vec3::y() * (DENT * height_m), steps) {
        trial.step(&[motion]);
    }
    (0..10).for_each(|_| _ = trial.step(&[]));
    trial.let_go(specimen.period_s(), 12.0, budget.most_steps, Return::ToItsPlace);
    Ok(trial.finish())
}

fn case(name: String, specimen: Specimen) -> Case {
    Case::new(Family::Materials, name, parameters(&specimen), move |budget| {
        pressed(&specimen, specimen.scene(specimen.held_block(), 1), budget)
    })
}

/// The values that a row of the matrix is about.
pub(super) fn parameters(s: &Specimen) -> String {
    format!(
        "E {:.1e}, nu {:.5}, rho {:.1e}, c {}, dt {:.1e}, h {:.1e}, {}x{}x{}, k {}",
        s.young_modulus_pa,
        s.poisson_ratio,
        s.density_kg_per_m3,
        s.strain_stiffening,
        s.dt_s,
        s.voxel_size_m,
        s.voxels[0],
        s.voxels[1],
        s.voxels[2],
        1 << s.level
    )
}

/// One value at a time, the corners of all ranges, and `random` places between them.
pub(super) fn cases(seed: u64, random: usize) -> Vec<Case> {
    let mut cases = Vec::new();
    let base = Specimen::default;
    for young_modulus_pa in [1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10] {
        cases.push(case(format!("E = {young_modulus_pa:.0e} Pa"), Specimen { young_modulus_pa, ..base() }));
    }
    for poisson_ratio in [0.0, 0.3, 0.45, 0.49, 0.499, 0.4999] {
        cases.push(case(format!("nu = {poisson_ratio}"), Specimen { poisson_ratio, ..base() }));
    }
    for density_kg_per_m3 in [1.0, 10.0, 100.0, 2e4] {
        cases.push(case(format!("rho = {density_kg_per_m3}"), Specimen { density_kg_per_m3, ..base() }));
    }
    for dt_s in [1e-4, 3e-4, 3e-3, 1e-2, 3e-2, 0.1] {
        cases.push(case(format!("dt = {dt_s} s"), Specimen { dt_s, ..base() }));
    }
    for voxel_size_m in [1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0] {
        cases.push(case(format!("h = {voxel_size_m} m"), Specimen { voxel_size_m, ..base() }));
    }
    for level in 0..=4 {
        cases.push(case(format!("level {level}, 16 voxels"), Specimen { level, voxels: [16; 3], ..base() }));
    }
    for strain_stiffening in [3.0, 10.0, 20.0] {
        cases.push(case(format!("c = {strain_stiffening}"), Specimen { strain_stiffening, ..base() }));
    }
    for corner in 0..32u32 {
        let at = |bit: u32, low: f64, high: f64| if corner >> bit & 1 == 1 { high } else { low };
        let specimen = Specimen {
            young_modulus_pa: at(0, 1e2, 1e10),
            density_kg_per_m3: at(1, 1.0, 2e4),
            dt_s: at(2, 1e-4, 0.1),
            voxel_size_m: at(3, 1e-5, 1.0),
            poisson_ratio: at(4, 0.0, 0.4999),
            ..base()
        };
        cases.push(case(format!("corner {corner}"), specimen));
    }
    let mut rng = SplitMix64(seed);
    for number in 0..random {
        cases.push(case(format!("random {number}"), between(&mut rng)));
    }
    cases
}

/// A specimen anywhere within the supported ranges.
fn between(rng: &mut SplitMix64) -> Specimen {
    Specimen {
        young_modulus_pa: rng.log(1e2, 1e10),
        poisson_ratio: 0.5 - rng.log(1e-4, 0.5),
        density_kg_per_m3: rng.log(1.0, 2e4),
        strain_stiffening: [0.0, 10.0][rng.index(2)],
        dt_s: rng.log(1e-4, 0.1),
        voxel_size_m: rng.log(1e-5, 1.0),
        voxels: [0; 3].map(|_| 3 + rng.index(7) as u32),
        level: rng.index(3) as u8,
    }
}

/// Stiff and soft in one block, in whole elements and within them.
pub(super) fn contrasts() -> Vec<Case> {
    let mut cases = Vec::new();
    for contrast in CONTRASTS {
        for (name, shapes) in arrangements() {
            for stiff_inside in [true, false] {
                let what = if stiff_inside { "stiff" } else { "soft" };
                let name = format!("{what} {name}, {contrast:.0e} : 1");
                let shapes = shapes.clone();
                let soft = Specimen { level: 2, ..Specimen::default() };
                let stiff = Specimen { young_modulus_pa: contrast * soft.young_modulus_pa, ..soft.clone() };
                cases.push(Case::new(Family::Contrast, name, parameters(&soft), move |budget| {
                    let mut block = soft.held_block();
                    let mut inside = soft.material();
                    let stiffer = if stiff_inside { &mut inside } else { &mut block.material };
                    stiffer.young_modulus_pa = stiff.young_modulus_pa;
                    block.regions = shapes
                        .iter()
                        .enumerate()
                        .map(|(i, shape)| RegionDesc {
                            name: format!("region {i}"),
                            shape: shape.clone(),
                            material: inside.clone(),
                        })
                        .collect();
                    pressed(&soft, soft.scene(block, 1), budget)
                }));
            }
        }
    }
    cases
}

/// Shapes within the default block, 40 mm a side.
fn arrangements() -> Vec<(&'static str, Vec<ShapeDesc>)> {
    let slab = |low: f64, high: f64| ShapeDesc::Box { min_m: [-1.0, low, -1.0], max_m: [1.0, high, 1.0] };
    vec![
        ("lower half", vec![slab(-1.0, 0.02)]),
        ("ball", vec![ShapeDesc::Sphere { center_m: [0.003, 0.019, 0.002], radius_m: 0.012 }]),
        ("layers of one voxel", (0..4).map(|i| slab(0.01 * f64::from(i), 0.01 * f64::from(i) + 0.005)).collect()),
    ]
}
