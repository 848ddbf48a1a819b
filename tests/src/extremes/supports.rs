//! The smallest bodies, and bodies held nowhere, everywhere, or cut free.

use kerf_physics::step_io::ToolMotion;
use kerf_physics::{Crossing, LinkId, SceneProblems, Vec3, verification};

use super::cuts::check_body;
use super::materials::{parameters, pressed};
use super::scenes::{Specimen, everywhere, level_at, line};
use super::trial::{Return, Trial};
use super::{Budget, Case, Family, Outcome};

/// Tough enough for the blade to dent the block by a few millimetres first, within what the linear law
/// carries at k = 2.
const GC_J_PER_M2: f64 = 40.0;

pub(super) fn cases() -> Vec<Case> {
    let mut cases = small();
    cases.extend(held_or_not());
    cases
}

fn small() -> Vec<Case> {
    let mut cases = Vec::new();
    for (what, voxels) in [("one voxel", [1, 1, 1]), ("a string of voxels", [1, 12, 1]), ("a sheet", [12, 1, 12])] {
        for level in 0..=4 {
            let specimen = Specimen { voxels, level, ..Specimen::default() };
            let name = format!("{what}, k {}", 1 << level);
            let free = specimen.clone();
            cases.push(Case::new(Family::Supports, format!("{name}, held"), parameters(&specimen), move |budget| {
                pressed(&specimen, specimen.scene(specimen.held_block(), 1), budget)
            }));
            cases.push(Case::new(
                Family::Supports,
                format!("{name}, free, cut at"),
                parameters(&free),
                move |budget| {
                    let mut block = free.block();
                    block.material.fracture_energy_j_per_m2 = Some(1.0);
                    block.material.strain_stiffening = 10.0;
                    struck(&free, block, free.period_s(), budget)
                },
            ));
        }
    }
    cases
}

/// A blade falls on a block at 1 m/s, goes through, is lifted; the longest period of the block as it is held.
pub(super) fn struck(
    specimen: &Specimen,
    block: kerf_physics::scene::ObjectDesc,
    period_s: f64,
    budget: Budget,
) -> Result<Outcome, SceneProblems> {
    let mut trial = Trial::new(specimen.scene(block, 1))?;
    let height_m = specimen.extent_m().y;
    let start = level_at(Vec3::new(0.0, height_m + specimen.voxel_size_m, 0.06 * specimen.voxel_size_m));
    let down_m = height_m + 2.0 * specimen.voxel_size_m;
    trial.step(&[ToolMotion::enter_at(start)]);
    for motion in line(start, -Vec3::y() * down_m, (down_m / specimen.dt_s).ceil() as u32) {
        trial.step(&[motion]);
    }
    trial.let_go(period_s, 12.0, budget.most_steps, Return::Anywhere);
    let wrong = check_body(trial.world.bodies()[0], specimen.voxels.iter().product::<u32>() as usize);
    Ok(Outcome { seen: trial.finish(), wrong })
}

fn held_or_not() -> Vec<Case> {
    let specimen = Specimen { strain_stiffening: 10.0, level: 1, ..Specimen::default() };
    let mut cases = Vec::new();
    // Holds a block somehow, and returns its longest period.
    let mut case = |name: &str, hold: fn(&Specimen, &mut kerf_physics::scene::ObjectDesc) -> f64| {
        let specimen = specimen.clone();
        cases.push(Case::new(Family::Supports, name, parameters(&specimen), move |budget| {
            let mut block = specimen.block();
            block.material.fracture_energy_j_per_m2 = Some(GC_J_PER_M2);
            let period_s = hold(&specimen, &mut block);
            struck(&specimen, block, period_s, budget)
        }));
    };
    case("nothing held, struck by a blade", |s, _| s.period_s());
    case("everything held, struck by a blade", |s, block| {
        block.fixed.push(everywhere());
        s.period_s()
    });
    case("one corner voxel held, struck by a blade", |s, block| {
        let extent = 0.5 * s.extent_m().x;
        let corner = [-extent, 0.0, -extent];
        let near = kerf_physics::scene::ShapeDesc::Sphere { center_m: corner, radius_m: s.voxel_size_m };
        block.fixed.push(near);
        hinged_period_s(s)
    });
    case("cut free: held at one end, cut through", |s, block| {
        let z = -0.5 * s.extent_m().z + 1.01 * s.voxel_size_m;
        block.fixed.push(kerf_physics::scene::ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, 1.0, z] });
        s.period_s()
    });
    for pitch in [2, 4] {
        cases.push(diced(pitch));
    }
    cases.push(falling());
    cases
}

/// Period of a cube of edge L that one voxel at a corner holds, as a hinge: `2 pi sqrt(2/3 m L^2 / k)`, with
/// `k = E h^3 / 12`, a beam as long and as thick as the voxel.
fn hinged_period_s(specimen: &Specimen) -> f64 {
    let (edge_m, h_m) = (specimen.extent_m().x, specimen.voxel_size_m);
    let turning_mass_kg_m2 = 2.0 / 3.0 * specimen.density_kg_per_m3 * edge_m.powi(5);
    let stiffness_nm = specimen.young_modulus_pa * h_m.powi(3) / 12.0;
    2.0 * std::f64::consts::PI * (turning_mass_kg_m2 / stiffness_nm).sqrt()
}

/// Every link between dice of `pitch` voxels parted at once, while the block flies apart.
fn diced(pitch: i32) -> Case {
    let specimen = Specimen { level: 2, ..Specimen::default() };
    Case::new(
        Family::Supports,
        format!("cut free: diced by {pitch} voxels at once"),
        parameters(&specimen),
        move |budget| {
            let mut trial = Trial::new(specimen.scene(specimen.block(), 0))?;
            let body = verification::body_mut(&mut trial.world, 0);
            let mut links = Vec::new();
            for voxel in body.grid().voxels() {
                for axis in 0..3u8 {
                    let mut normal = [0.0; 3];
                    normal[axis as usize] = 1.0;
                    if (voxel.ijk[axis as usize] + 1) % pitch == 0 {
                        links.push((LinkId { cell: voxel.ijk, axis }, Crossing { t: 0.5, normal }));
                    }
                }
            }
            verification::part(body, &links);
            trial.start(|rest_m| (rest_m, 5.0 * (rest_m - Vec3::new(0.0, 0.02, 0.0)) / 0.02));
            trial.let_go(specimen.period_s(), 12.0, budget.most_steps, Return::Anywhere);
            let body = trial.world.bodies()[0];
            let mut wrong = check_body(body, 512);
            let dice = (8 / pitch).pow(3) as u32;
            if body.part_count() != dice {
                wrong.push(format!("{} pieces instead of {dice}", body.part_count()));
            }
            Ok(Outcome { seen: trial.finish(), wrong })
        },
    )
}

/// Nothing held, under gravity: the fall is implicit Euler's, to the last digits. It ends within the scene's reach, beyond
/// which the body would be put away.
fn falling() -> Case {
    let mut specimen = Specimen { level: 2, ..Specimen::default() };
    specimen.voxels = [7, 5, 6];
    Case::new(Family::Supports, "nothing held, falls for 0.3 s", parameters(&specimen), move |_| {
        let mut block = specimen.block();
        block.material.rayleigh_alpha_per_s = 0.0;
        let mut scene = specimen.scene(block, 0);
        scene.desc.gravity_m_per_s2 = [0.0, -9.81, 0.0];
        let mut trial = Trial::new(scene)?;
        (0..300).for_each(|_| _ = trial.step(&[]));
        let body = trial.world.bodies()[0];
        let momentum: Vec3 = verification::nodal_momentum(body).iter().map(|p| Vec3::from(*p)).sum();
        let off = (momentum / body.mass_kg() + Vec3::new(0.0, 0.3 * 9.81, 0.0)).norm() / (0.3 * 9.81);
        let wrong = (off > 1e-9).then(|| format!("speed off by {off:.1e} of g t"));
        Ok(Outcome { seen: trial.finish(), wrong: wrong.into_iter().collect() })
    })
}
