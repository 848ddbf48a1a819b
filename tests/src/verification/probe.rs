//! A smooth probe on a half-space, against Hertz, at every level.

use anyhow::{Result, ensure};
use kerf_physics::scene::{CapsuleDesc, Face, LoadDesc, ObjectDesc, ShapeDesc, ToolDesc};
use kerf_physics::step_io::ToolMotion;
use kerf_physics::{NoClock, Pose, StepInputs, ToolInput, Vec3, Workers, World};
use rayon::prelude::*;

use super::scenes::{Mesh, block, displacement_m, material, scene};
use super::{Check, Extent, Family, statics};

const YOUNG_PA: f64 = 1e5;
const POISSON: f64 = 0.3;
const VOXEL_M: f64 = 2.5e-3;
const RADIUS_M: f64 = 0.04;
/// How deep the probe is pressed, one after the other, m.
const DEPTHS_M: [f64; 2] = [7.5e-4, 1.5e-3];
/// The block: half its width, its free height and what is held below, m.
const HALF_M: f64 = 0.04;
const FREE_M: f64 = 0.04;
const HELD_M: f64 = 0.02;
/// Half-width of the square that tells the block's compliance from the half-space's, m.
const SQUARE_M: f64 = 4.0 * VOXEL_M;
const RATE_HZ: f64 = 250.0;
const PRESS_STEPS: u32 = 30;
const REST_STEPS: u32 = 40;
const LIMIT: f64 = 0.15;
/// Where the probe stands on the block's top, m: on a node of every level, and on one of none.
const PLACES: [(&str, [f64; 2]); 2] = [("beside nodes", [6.1e-3, 4.3e-3]), ("on a node", [0.0; 2])];

/// A block cut from the half-space y < 0, held at its foot.
fn half_space(mesh: Mesh) -> ObjectDesc {
    let mut desc = block([1.0; 3], mesh, material(YOUNG_PA, POISSON));
    desc.shape = ShapeDesc::Box { min_m: [-HALF_M, -FREE_M - HELD_M, -HALF_M], max_m: [HALF_M, 0.0, HALF_M] };
    desc.fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, -FREE_M, 1.0] }];
    desc
}

/// How much farther the block's top goes down per force on its middle than the half-space's does, m/N, from a small
/// uniform pressure on a square (Love 1929).
///
/// What the block's sides and foot make of a force on its top does not depend on how the force is spread.
fn block_compliance_m_per_n(mesh: Mesh) -> Result<f64> {
    let pressure_pa = 1e-4 * YOUNG_PA;
    let mut desc = half_space(mesh);
    let region = ShapeDesc::Box { min_m: [-SQUARE_M, -1.0, -SQUARE_M], max_m: [SQUARE_M, 1.0, SQUARE_M] };
    desc.loads = vec![LoadDesc::Traction { region, face: Face::MaxY, traction_pa: [0.0, -pressure_pa, 0.0] }];
    let mut body = statics::body(&scene(desc), statics::FREE_TAU_S)?;
    statics::settle(&mut body)?;
    let love_m = 8.0 * (1.0 + 2f64.sqrt()).ln() / std::f64::consts::PI * pressure_pa * SQUARE_M / reduced_pa();
    Ok((-displacement_m(&body, Vec3::zeros())?.y - love_m) / (pressure_pa * 4.0 * SQUARE_M.powi(2)))
}

/// `E / (1 - nu^2)`.
fn reduced_pa() -> f64 {
    YOUNG_PA / (1.0 - POISSON * POISSON)
}

/// Hertz's `4/3 E* R^1/2 d^3/2` on the half-space, N, and the same where the block goes down with the force.
fn exact_n(depth_m: f64, compliance_m_per_n: f64) -> [f64; 2] {
    let hertz = |depth_m: f64| 4.0 / 3.0 * reduced_pa() * RADIUS_M.sqrt() * depth_m.max(0.0).powf(1.5);
    let [mut low, mut high] = [0.0, 2.0 * hertz(depth_m)];
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        *(if hertz(depth_m - compliance_m_per_n * middle) > middle { &mut low } else { &mut high }) = middle;
    }
    [hertz(depth_m), low]
}

/// Force on the probe at rest at each depth, N, and what the ledger leaves unexplained over the probe's work.
fn pressed(level: u8, [x, z]: [f64; 2]) -> Result<[[f64; 2]; 2]> {
    let mut desc = half_space(Mesh { voxel_m: VOXEL_M, level });
    desc.material.rayleigh_beta_s = 5e-3;
    let mut scene = scene(desc);
    scene.desc.rate_hz = RATE_HZ;
    scene.desc.solver.relative_tolerance = Some(1e-4);
    scene.desc.tools = vec![ToolDesc::probe("probe", CapsuleDesc { radius_m: RADIUS_M, length_m: 0.0 })];
    let mut world = World::new(&scene.judge()?)?;
    let (mut residual_j, mut work_j, mut from_m) = (0.0, 0.0, 0.0);
    let mut found = [[0.0; 2]; 2];
    for (found, to_m) in found.iter_mut().zip(DEPTHS_M) {
        for step in 1..=PRESS_STEPS + REST_STEPS {
            let depth_m = from_m + (to_m - from_m) * f64::from(step.min(PRESS_STEPS)) / f64::from(PRESS_STEPS);
            let pose = Pose { position_m: Vec3::new(x, RADIUS_M - depth_m, z), ..Pose::default() };
            let inputs = [ToolInput { tool: 0, motion: ToolMotion::move_to(pose) }];
            let output = world.step(&Workers::serial(), &NoClock, &StepInputs::of(&inputs));
            ensure!(output.fault.is_none(), "{:?}", output.fault);
            residual_j += output.energy.residual_j.abs();
            work_j += output.energy.tool_work_j;
            found[0] = output.tools[0].wrench.force_n.y;
        }
        found[1] = residual_j / work_j;
        from_m = to_m;
    }
    Ok(found)
}

/// The family.
///
/// # Errors
/// A block did not come to rest, or a step had a fault.
pub fn family(extent: Extent) -> Result<Family> {
    let (levels, compliance_mesh): (&[u8], Mesh) = match extent {
        Extent::Coarse => (&[1], Mesh::new(1, 2.0 * VOXEL_M)),
        Extent::Full => (&[0, 1, 2, 3], Mesh::new(1, VOXEL_M)),
    };
    let places = extent.of(&PLACES, 1);
    let compliance_m_per_n = block_compliance_m_per_n(compliance_mesh)?;
    let runs: Vec<_> = places.iter().flat_map(|place| levels.iter().map(|level| (*place, *level))).collect();
    let found = runs.par_iter().map(|((_, at_m), level)| pressed(*level, *at_m)).collect::<Result<Vec<_>>>()?;
    let mut checks = Vec::new();
    for (i, depth_m) in DEPTHS_M.iter().enumerate() {
        for (((place, _), level), found) in runs.iter().zip(&found) {
            let [ours, residual] = found[i];
            checks.push(Check {
                case: format!("{} mm deep, level {level}, {place}: force, N", 1e3 * depth_m),
                reference: exact_n(*depth_m, compliance_m_per_n)[1],
                ours,
                limit: Some(LIMIT),
                residual: Some(residual),
                source: "Hertz 1882; Love 1929",
            });
        }
    }
    let contact_voxels = DEPTHS_M.map(|depth_m| format!("{:.1}", (RADIUS_M * depth_m).sqrt() / VOXEL_M));
    let block_share = DEPTHS_M.map(|depth_m| {
        let [hertz_n, block_n] = exact_n(depth_m, compliance_m_per_n);
        format!("{:+.1} %", 100.0 * (block_n / hertz_n - 1.0))
    });
    Ok(Family {
        title: "A probe on a half-space",
        text: format!(
            "A sphere of {} mm radius is pressed into a block until the contact's radius is {} voxels. The block is \
             80 x 40 x 80 mm (E 100 kPa, nu 0.3, voxels of 2.5 mm) and fixed below. The reference is Hertz's force, \
             corrected for the block, whose top is stiffer than a half-space's. That correction is taken from a \
             uniform pressure on a square (Love 1929) and changes the force by {}. Elements are 1, 2, 4 and 8 voxels \
             wide. The probe stands on a node of every level, or beside the nodes of all levels.",
            1e3 * RADIUS_M,
            contact_voxels.join(" and "),
            block_share.join(" and "),
        ),
        checks,
        ..Family::default()
    })
}
