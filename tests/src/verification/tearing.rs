//! How fast a crack runs through a strip that is pulled, without a blade.

use anyhow::{Result, ensure};
use kerf_physics::scene::{Face, LoadDesc, MaterialDesc, ObjectDesc, RegionDesc, ShapeDesc};
use kerf_physics::verification::{self, unjudged};
use kerf_physics::{Body, Crossing, LinkId, World};
use rayon::prelude::*;

use super::scenes::{Mesh, block, material, run, scene};
use super::{Extent, Family, Reference, Row, Table, statics};

const YOUNG_PA: f64 = 2e4;
const DENSITY_KG_PER_M3: f64 = 1000.0;
/// Size of the strip between its clamps, and of each clamp, m.
const STRIP_M: [f64; 3] = [0.32, 0.04, 0.02];
const CLAMP_M: f64 = 0.02;
/// Where the crack ends that was made beforehand, and between which places its speed is taken, m.
const TIP_M: f64 = 0.08;
const TIMED_M: [f64; 2] = [0.14, 0.26];
/// Energy that the strip holds per area of the crack, over what parting takes.
const PULL: f64 = 4.0;
/// Rayleigh waves over shear waves where nu is 0: the root of r^3 - 8 r^2 + 16 r = 8, r the square of it.
const RAYLEIGH: f64 = 0.8740;

/// The strip between a held clamp and one that is pulled at, so stiff and heavy that it stays where it is while the
/// crack runs.
fn strip(mesh: Mesh) -> ObjectDesc {
    let [length_m, height_m, thickness_m] = STRIP_M;
    let soft = MaterialDesc { rayleigh_beta_s: 1e-4, ..material(YOUNG_PA, 0.0) };
    let mut desc = block([length_m, CLAMP_M + height_m + CLAMP_M, thickness_m], mesh, soft);
    desc.fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, CLAMP_M, 1.0] }];
    desc.regions = vec![RegionDesc {
        name: "clamp".into(),
        shape: ShapeDesc::Box { min_m: [-1.0, CLAMP_M + height_m, -1.0], max_m: [1.0; 3] },
        material: MaterialDesc { density_kg_per_m3: 1e3 * DENSITY_KG_PER_M3, ..material(1e4 * YOUNG_PA, 0.0) },
    }];
    let region = ShapeDesc::Box { min_m: [TIP_M, -1.0, -1.0], max_m: [1.0; 3] };
    let traction_pa = [0.0, 0.04 * YOUNG_PA, 0.0];
    desc.loads = vec![LoadDesc::Traction { region, face: Face::MaxY, traction_pa }];
    desc
}

fn crack(body: &mut Body) {
    let (h, [_, _, nz]) = (body.grid().voxel_size_m(), body.grid().dims());
    let j = ((CLAMP_M + 0.5 * STRIP_M[1]) / h).round() as i32 - 1;
    let link = |i, k| (LinkId { cell: [i, j, k], axis: 1 }, Crossing { t: 0.5, normal: [0.0, 1.0, 0.0] });
    let links: Vec<_> = (0..(TIP_M / h).round() as i32).flat_map(|i| (0..nz).map(move |k| link(i, k))).collect();
    verification::part(body, &links);
}

/// Energy per area of the plane that the crack runs in, far from its tip, J/m^2.
fn pull_j_per_m2(body: &Body) -> Result<f64> {
    let at_m = kerf_physics::Vec3::new(0.2, CLAMP_M + STRIP_M[1], 0.5 * STRIP_M[2]);
    let strain = super::scenes::displacement_m(body, at_m)?.y / STRIP_M[1];
    Ok(0.5 * YOUNG_PA * strain * strain * STRIP_M[1])
}

/// Speed of the strip's Rayleigh waves, m/s.
fn wave_m_per_s() -> f64 {
    RAYLEIGH * (0.5 * YOUNG_PA / DENSITY_KG_PER_M3).sqrt()
}

/// Speed of the crack over that of the strip's Rayleigh waves.
fn speed(mesh: Mesh, rate_hz: f64) -> Result<f64> {
    let mut desc = strip(mesh);
    let mut still = statics::body(&scene(desc.clone()), statics::HELD_TAU_S)?;
    crack(&mut still);
    statics::settle(&mut still)?;
    let gc_j_per_m2 = pull_j_per_m2(&still)? / PULL;
    desc.material.fracture_energy_j_per_m2 = Some(gc_j_per_m2);
    let mut scene = scene(desc);
    scene.desc.rate_hz = rate_hz;
    // The clamp is heavier than tissue may be.
    let mut world = World::new(&unjudged(scene))?;
    let body = verification::body_mut(&mut world, 0);
    crack(body);
    verification::state_mut(body).position_m.clone_from(&verification::state(&still).position_m);
    let passed = TIMED_M.map(|x_m| (x_m - TIP_M) * STRIP_M[2] * gc_j_per_m2);
    let (mut paid_j, mut at_s) = (0.0, [0.0; 2]);
    while paid_j < passed[1] {
        run(&mut world, 1);
        let output = world.output();
        ensure!(output.fault.is_none(), "{:?}", output.fault);
        ensure!(
            output.sim_time_s < 4.0,
            "the crack stands still: {paid_j} of {passed:?} J, {rate_hz} Hz, {}",
            mesh.name()
        );
        for (at_s, _) in at_s.iter_mut().zip(passed).filter(|(_, passed_j)| paid_j < *passed_j) {
            *at_s = output.sim_time_s;
        }
        paid_j += output.energy.fracture_j;
    }
    Ok((TIMED_M[1] - TIMED_M[0]) / (at_s[1] - at_s[0]) / wave_m_per_s())
}

/// The family.
///
/// # Errors
/// A body did not come to rest, or its crack did not run.
pub fn family(extent: Extent) -> Result<Family> {
    let meshes = extent.of(&[Mesh::new(4, 2.5e-3), Mesh::new(2, 2.5e-3), Mesh::new(1, 2.5e-3)], 2);
    let mut rows = Vec::new();
    for rate_hz in [1000.0, 4000.0] {
        rows.push(Row {
            case: format!("speed over that of Rayleigh waves, {rate_hz} Hz"),
            reference: Reference::Value(1.0, ""),
            ours: meshes.par_iter().map(|mesh| speed(*mesh, rate_hz)).collect::<Result<_>>()?,
            source: "Freund 1990".into(),
        });
    }
    Ok(Family {
        title: "Speed of a tear",
        text: format!(
            "A strip of {:.0} mm between fixed clamps stores {PULL} times the energy per area that a crack takes. \
             However fast a crack runs, the strip then has more energy than it takes. Only waves limit the crack, so \
             its speed tends to that of Rayleigh waves. It is timed over {:.0} mm, from {:.0} mm beyond its start. nu \
             is 0 and E is 20 kPa: waves take {:.1} ms for an element of 5 mm. A tear advances by one element a step \
             at most. At k 1 and 1 kHz that limits it to 2.5 mm a ms, {:.2} of the waves' speed.",
            1e3 * STRIP_M[1],
            1e3 * (TIMED_M[1] - TIMED_M[0]),
            1e3 * (TIMED_M[0] - TIP_M),
            1e3 * 5e-3 / wave_m_per_s(),
            2.5 / wave_m_per_s(),
        ),
        tables: vec![Table { columns: meshes.iter().map(Mesh::name).collect(), rows }],
        ..Family::default()
    })
}
