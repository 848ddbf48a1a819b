//! A free bar that spins is stretched by what its spin says, whatever it turns by in a step.

use anyhow::{Result, ensure};
use kerf_physics::{Body, MaterialPoint, Vec3, VoxelId, World, verification};
use rayon::prelude::*;

use super::scenes::{Mesh, block, material, run, scene};
use super::{Extent, Family, Reference, Row, Table};

/// Length and width of the bar and edge of its voxels, m.
const LENGTH_M: f64 = 0.12;
const WIDTH_M: f64 = 0.02;
const VOXEL_M: f64 = 0.005;
const DENSITY_KG_PER_M3: f64 = 4000.0;
const POISSON: f64 = 0.45;
/// Young's modulus, Pa, at a spin of 30 rad/s; it goes with the square of the spin, so that the strain is the same.
const YOUNG_PA: f64 = 4e5;
const SPIN_RAD_PER_S: f64 = 30.0;
/// What it turns by in all, rad: five turns or so, after which its vibrations have gone.
const TURNED_RAD: f64 = 30.0;

/// Steps per second, Hz, and spin at the start, rad/s.
#[derive(Clone, Copy, Debug)]
struct Spin {
    rate_hz: f64,
    rad_per_s: f64,
}

/// At every rate one turns by more than 0.01 rad in a step and one by less.
/// The one of 120 Hz turns by half as much as that of 60 Hz.
const SPINS: [Spin; 7] = [
    Spin { rate_hz: 1000.0, rad_per_s: 30.0 },
    Spin { rate_hz: 60.0, rad_per_s: 12.0 },
    Spin { rate_hz: 120.0, rad_per_s: 12.0 },
    Spin { rate_hz: 4000.0, rad_per_s: 60.0 },
    Spin { rate_hz: 1000.0, rad_per_s: 8.0 },
    Spin { rate_hz: 60.0, rad_per_s: 0.5 },
    Spin { rate_hz: 4000.0, rad_per_s: 30.0 },
];

/// Young's modulus at which a spin strains the bar as every other, Pa.
fn young_pa(spin: Spin) -> f64 {
    YOUNG_PA * (spin.rad_per_s / SPIN_RAD_PER_S).powi(2)
}

/// Mean strain of the bar along itself, with its angular momentum kept.
///
/// A rod whose Biot stress is linear in the stretch stands at `x = sin(k X) / (k cos(k l))` over its half-length l, with
/// `k = w (rho / E)^1/2`; mean stress across it, `rho w^2 b^2 / 12`, takes `nu` times its own strain from that along it.
fn exact() -> f64 {
    let (half_m, across_m2) = (0.5 * LENGTH_M, WIDTH_M.powi(2) / 12.0);
    let wave_number = |spin: f64| spin * (DENSITY_KG_PER_M3 / YOUNG_PA).sqrt();
    // Mean of the squared distance from the axis.
    let spread_m2 = |spin: f64| {
        let k = wave_number(spin);
        let along = half_m - (2.0 * k * half_m).sin() / (2.0 * k);
        along / (2.0 * half_m * (k * (k * half_m).cos()).powi(2)) + across_m2
    };
    let at_rest_m2 = half_m.powi(2) / 3.0 + across_m2;
    let mut spin = SPIN_RAD_PER_S;
    for _ in 0..50 {
        spin = SPIN_RAD_PER_S * at_rest_m2 / spread_m2(spin);
    }
    let k = wave_number(spin);
    (k * half_m).tan() / (k * half_m) - 1.0 - POISSON * k * k * across_m2
}

/// Mean place of the face at an end of the bar, m; of the low end where `sign` is negative.
fn end_m(body: &Body, sign: f64) -> Vec3 {
    let grid = body.grid();
    let last = if sign < 0.0 { 0 } else { grid.dims()[0] - 1 };
    let at_end = (0..).zip(grid.voxels()).filter(|(_, voxel)| voxel.ijk[0] == last);
    let faces: Vec<Vec3> = at_end
        .map(|(id, voxel)| {
            let position_m = grid.centre_m(voxel.ijk) + Vec3::x() * (0.5 * sign * grid.voxel_size_m());
            body.current_m(&MaterialPoint { position_m, voxel: VoxelId(id) })
        })
        .collect();
    faces.iter().sum::<Vec3>() / faces.len() as f64
}

/// Strain of the bar, between the means of its end faces, after it has spun across.
fn strain(spin: Spin, level: u8) -> Result<f64> {
    let size_m = [LENGTH_M, WIDTH_M, WIDTH_M];
    let mut desc = block(size_m, Mesh { voxel_m: VOXEL_M, level }, material(young_pa(spin), POISSON));
    desc.material.density_kg_per_m3 = DENSITY_KG_PER_M3;
    let mut scene = scene(desc);
    scene.desc.rate_hz = spin.rate_hz;
    let mut world = World::new(&scene.judge()?)?;
    let body = verification::body_mut(&mut world, 0);
    for node in 0..body.node_count() {
        let arm_m = body.rest_position_m(node) - Vec3::from(size_m) / 2.0;
        verification::state_mut(body).velocity_m_per_s[node] = (Vec3::z() * spin.rad_per_s).cross(&arm_m).into();
    }
    verification::evaluate(body, 60);
    for _ in 0..(TURNED_RAD / spin.rad_per_s * spin.rate_hz).round() as u32 {
        run(&mut world, 1);
        ensure!(world.output().fault.is_none(), "{:?}", world.output().fault);
    }
    let body = world.bodies()[0];
    Ok((end_m(body, 1.0) - end_m(body, -1.0)).norm() / LENGTH_M - 1.0)
}

/// The family.
///
/// # Errors
/// A scene of it is not valid, or a step had a fault.
pub fn family(extent: Extent) -> Result<Family> {
    let levels = extent.of(&[2, 1, 0], 1);
    let spins = extent.of(&SPINS, 2);
    let runs: Vec<(Spin, u8)> = spins.iter().flat_map(|spin| levels.iter().map(|level| (*spin, *level))).collect();
    let found = runs.par_iter().map(|(spin, level)| strain(*spin, *level)).collect::<Result<Vec<_>>>()?;
    let rows = spins.iter().zip(found.chunks(levels.len())).map(|(spin, found)| {
        let Spin { rate_hz, rad_per_s } = spin;
        Row {
            case: format!("{rate_hz} Hz, {rad_per_s} rad/s, {:.4} rad a step: strain", rad_per_s / rate_hz),
            reference: Reference::Value(100.0 * exact(), "%"),
            ours: found.iter().map(|strain| 100.0 * strain).collect(),
            source: "rod of linear Biot stress, mean stress theorem".into(),
        }
    });
    Ok(Family {
        title: "Centrifugal strain",
        text: format!(
            "A free bar of 0.12 x 0.02 x 0.02 m (4000 kg/m^3, nu 0.45, voxels of 5 mm) spins about an axis across it, \
             through {TURNED_RAD} rad. E is 400 kPa at 30 rad/s and proportional to the square of the spin, so that \
             every row has the same strain. At small strains it is rho w^2 l^2 / 3 E = {:.3} %, with l half the \
             length. The reference also includes the stretch of the rod, the conserved angular momentum, and the \
             strain along the bar that the stress across it takes away. A piece that turns by 0.01 rad or more in a \
             step is moved along arcs. The remaining error falls with the square of the angle. A piece that turns by \
             less is moved along straight lines. Each of these adds half of the square of its angle to the strain: \
             0.005 % at most.",
            100.0 * DENSITY_KG_PER_M3 * (SPIN_RAD_PER_S * 0.5 * LENGTH_M).powi(2) / (3.0 * YOUNG_PA),
        ),
        tables: vec![Table {
            columns: levels.iter().map(|level| format!("k {}", 1 << level)).collect(),
            rows: rows.collect(),
        }],
        ..Family::default()
    })
}
