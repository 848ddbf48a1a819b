//! Free bodies that start far from rest: stretched, flat, shuffled, inside out, flying apart.

use kerf_physics::{SceneProblems, Vec3, verification};

use super::materials::parameters;
use super::scenes::{Specimen, SplitMix64};
use super::trial::{Return, Trial};
use super::{Budget, Case, Family, Outcome};

/// Position and velocity of a node from its rest position, relative to the centre, over the extent; the
/// velocity over the speed of sound.
type Start = fn(Vec3, &mut SplitMix64) -> (Vec3, Vec3);

const STARTS: [(&str, Start); 9] = [
    ("stretched by 1.5", |x, _| (Vec3::new(x.x, 1.5 * x.y, x.z), Vec3::zeros())),
    ("stretched by 5 all around", |x, _| (5.0 * x, Vec3::zeros())),
    ("squeezed to a tenth all around", |x, _| (0.1 * x, Vec3::zeros())),
    ("flat", |x, _| (Vec3::new(x.x, 0.0, x.z), Vec3::zeros())),
    ("all nodes in one point", |_, _| (Vec3::zeros(), Vec3::zeros())),
    ("random nodes", |_, rng| (0.5 * rng.vector(), Vec3::zeros())),
    ("inside out", |x, _| (-x, Vec3::zeros())),
    ("mirrored, with noise", |x, rng| (Vec3::new(-x.x, x.y, x.z) + 1e-3 * rng.vector(), Vec3::zeros())),
    ("random speeds, those of sound", |x, rng| (x, rng.vector())),
];

/// Each start at each level, linear and stiffening.
pub(super) fn cases(seed: u64) -> Vec<Case> {
    let mut cases = Vec::new();
    for (name, start) in STARTS {
        for (level, strain_stiffening) in [(0, 0.0), (1, 0.0), (2, 0.0), (1, 10.0), (2, 10.0)] {
            let specimen = Specimen { level, strain_stiffening, ..Specimen::default() };
            let name = format!("{name}, k {}, c {strain_stiffening}", 1 << level);
            cases.push(Case::new(Family::Starts, name, parameters(&specimen), move |budget| {
                run(&specimen, start, seed, budget)
            }));
        }
    }
    for strain_stiffening in [0.0, 3.0, 10.0] {
        for waves in [10.0, 50.0] {
            let specimen = Specimen { strain_stiffening, ..massless(waves) };
            let name = format!("squeezed by half, waves cross {waves} voxels a step, c {strain_stiffening}");
            cases.push(Case::new(Family::Starts, name, parameters(&specimen), move |budget| {
                run(&specimen, |x, rng| (0.5 * x + 0.01 * rng.vector(), Vec3::zeros()), seed, budget)
            }));
        }
    }
    cases
}

/// Lets a free body go from a start; it must end in its shape.
fn run(specimen: &Specimen, start: Start, seed: u64, budget: Budget) -> Result<Outcome, SceneProblems> {
    let mut trial = Trial::new(specimen.scene(specimen.block(), 0))?;
    let mut rng = SplitMix64(seed);
    let extent_m = specimen.extent_m();
    let centre_m = Vec3::new(0.0, 0.5 * extent_m.y, 0.0);
    let sound_m_per_s = (specimen.young_modulus_pa / specimen.density_kg_per_m3).sqrt();
    trial.start(|rest_m| {
        let (x, v) = start((rest_m - centre_m).component_div(&extent_m), &mut rng);
        (centre_m + x.component_mul(&extent_m), v * sound_m_per_s)
    });
    trial.let_go(specimen.period_s(), 14.0, budget.most_steps, Return::Anywhere);
    let off_voxels = shape_error_voxels(trial.world.bodies()[0]);
    let wrong =
        (off_voxels > super::verdict::REST_VOXELS).then(|| format!("ends {off_voxels:.2} voxels off its shape"));
    Ok(Outcome { seen: trial.finish(), wrong: wrong.into_iter().collect() })
}

/// A specimen in which waves cross so many voxels in a step: the inverse square of that is how much mass
/// shows beside stiffness in the matrix of a free body.
fn massless(waves: f64) -> Specimen {
    let specimen = Specimen { dt_s: 0.1, voxel_size_m: 0.1, density_kg_per_m3: 10.0, level: 0, ..Specimen::default() };
    let sound_m_per_s = waves * specimen.voxel_size_m / specimen.dt_s;
    Specimen { young_modulus_pa: specimen.density_kg_per_m3 * sound_m_per_s.powi(2), ..specimen }
}

/// Largest difference, in voxels, between how far two corners of an element are from each other and
/// how far they were at rest: blind to where the body is and how it is turned.
fn shape_error_voxels(body: &kerf_physics::Body) -> f64 {
    let mut worst = 0.0f64;
    for element in &verification::base(body).elements {
        for (i, &a) in element.nodes.iter().enumerate() {
            for &b in &element.nodes[..i] {
                let now = (Vec3::from(verification::state(body).position_m[a as usize])
                    - Vec3::from(verification::state(body).position_m[b as usize]))
                .norm();
                let then = (body.rest_position_m(a as usize) - body.rest_position_m(b as usize)).norm();
                worst = worst.max((now - then).abs());
            }
        }
    }
    worst / body.grid().voxel_size_m()
}
