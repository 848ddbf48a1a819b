//! Cantilevers that are held by a few layers of voxels, thinner than an element.

use anyhow::Result;
use rayon::prelude::*;

use super::bending::limit;
use super::cantilever::{sag_m, sag_of_clamp_m, theory};
use super::scenes::Mesh;
use super::{Check, Extent, Family};

/// A hundredth of the weight: the deflection is linear to 1e-5.
const GRAVITY_M_PER_S2: f64 = 0.0981;
const VOXEL_M: f64 = 2.5e-3;
const SIDE_M: f64 = 0.02;
/// Voxels' edges of the full FEM that the reference is extrapolated from, m.
const FINE_M: [f64; 3] = [0.01, 5e-3, 2.5e-3];
/// Largest error by level: an element is 1, 2, 4 and 8 layers of voxels thick.
const LIMITS: [f64; 4] = [0.02, 0.03, 0.06, 0.12];

/// Layers of voxels that are held, and Poisson's ratio.
#[derive(Clone, Copy, Debug)]
struct Clamp {
    layers: u32,
    poisson_ratio: f64,
}

/// How far the free end sinks, m.
fn sinks_m(clamp: Clamp, level: u8) -> Result<f64> {
    let clamp_m = f64::from(clamp.layers) * VOXEL_M;
    Ok(-sag_of_clamp_m(Mesh { voxel_m: VOXEL_M, level }, clamp_m, SIDE_M, clamp.poisson_ratio, GRAVITY_M_PER_S2)?.y)
}

/// The same in the limit of fine full FEM, where nothing of the clamp but its face matters.
fn exact_m(poisson_ratio: f64) -> Result<f64> {
    let on = |voxel_m: &f64| Ok(-sag_m(Mesh::new(1, *voxel_m), SIDE_M, poisson_ratio, GRAVITY_M_PER_S2)?.y);
    let found = FINE_M.par_iter().map(on).collect::<Result<Vec<f64>>>()?;
    Ok(limit([found[0], found[1], found[2]]).0)
}

/// The family.
///
/// # Errors
/// A beam did not come to rest.
pub fn family(extent: Extent) -> Result<Family> {
    let clamps = extent.of(
        &[(1, 0.3), (2, 0.3), (3, 0.3), (5, 0.3), (1, 0.45)]
            .map(|(layers, poisson_ratio)| Clamp { layers, poisson_ratio }),
        1,
    );
    let runs: Vec<(Clamp, u8)> = clamps.iter().flat_map(|clamp| (0..4).map(|level| (*clamp, level))).collect();
    let found = runs.par_iter().map(|(clamp, level)| sinks_m(*clamp, *level)).collect::<Result<Vec<f64>>>()?;
    let mut ratios: Vec<f64> = clamps.iter().map(|clamp| clamp.poisson_ratio).collect();
    ratios.dedup();
    let exact = ratios.iter().map(|nu| Ok((*nu, exact_m(*nu)?))).collect::<Result<Vec<_>>>()?;
    let mut checks = Vec::new();
    for ((clamp, level), sunk_m) in runs.iter().zip(&found) {
        let Clamp { layers, poisson_ratio } = clamp;
        let reference_m = exact.iter().find(|(nu, _)| nu == poisson_ratio).map_or(f64::NAN, |(_, m)| *m);
        let layers = if *layers == 1 { "one layer".into() } else { format!("{layers} layers") };
        checks.push(Check {
            case: format!("{layers} held, nu {poisson_ratio}, level {level}: tip down, um"),
            reference: 1e6 * reference_m,
            ours: 1e6 * sunk_m,
            limit: Some(LIMITS[usize::from(*level)]),
            residual: None,
            source: "full FEM, extrapolated",
        });
    }
    Ok(Family { title: "Thin clamps", text: text(&exact), checks, ..Family::default() })
}

fn text(exact: &[(f64, f64)]) -> String {
    let beside = |(nu, exact_m): &(f64, f64)| {
        let beam_m = theory(SIDE_M, *nu, GRAVITY_M_PER_S2).linear_tip_m();
        format!("{:+.2} % at nu {nu}", 100.0 * (exact_m / beam_m - 1.0))
    };
    format!(
        "The cantilever of 0.2 m and of 8 x 8 voxels of 2.5 mm is fixed by 1, 2, 3 and 5 layers of voxels. Elements \
         are 1, 2, 4 and 8 layers thick (levels 0 to 3). If whole elements were fixed, one layer would shorten the \
         free length by 7.5 and 17.5 mm at levels 2 and 3. That is 14 and 31 % of the deflection. The reference is \
         the limit of full FEM under refinement (10, 5 and 2.5 mm, Richardson 1911), with a clamp of whole elements. \
         It differs from Timoshenko's beam by {}. The limits are 2, 3, 6 and 12 % at levels 0 to 3.",
        exact.iter().map(beside).collect::<Vec<_>>().join(" and ")
    )
}
