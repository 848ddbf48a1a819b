//! Large deflection of a slender cantilever under a dead force at its end.

use anyhow::Result;
use kerf_physics::Vec3;
use kerf_physics::scene::{Face, LoadDesc, Scene, ShapeDesc};
use rayon::prelude::*;

use super::beam::{Beam, Tip};
use super::scenes::{EVERYWHERE, Mesh, block, displacement_m, material, scene};
use super::{Extent, Family, Reference, Row, Table, statics};

const SIDE_M: f64 = 0.02;
const LENGTH_M: f64 = 0.4;
const CLAMP_M: f64 = 0.02;
const YOUNG_PA: f64 = 2e6;

/// P L^2 / E I with tip down and back over L (Mattiasson 1981).
const LOADS: [(f64, f64, f64); 3] = [(1.0, 0.30172, 0.05643), (3.0, 0.60325, 0.25442), (10.0, 0.81061, 0.55500)];

fn beam(load: f64) -> Beam {
    let mut beam = Beam {
        length_m: LENGTH_M,
        side_m: SIDE_M,
        young_modulus_pa: YOUNG_PA,
        poisson_ratio: 0.0,
        tip_force_n: 0.0,
        weight_n_per_m: 0.0,
    };
    beam.tip_force_n = load * beam.bending_stiffness_n_m2() / LENGTH_M.powi(2);
    beam
}

fn loaded(mesh: Mesh, load: f64) -> Scene {
    let mut desc = block([SIDE_M, SIDE_M, LENGTH_M + CLAMP_M], mesh, material(YOUNG_PA, 0.0));
    desc.fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, 1.0, CLAMP_M] }];
    let traction_pa = [0.0, -beam(load).tip_force_n / SIDE_M.powi(2), 0.0];
    desc.loads = vec![LoadDesc::Traction { region: EVERYWHERE, face: Face::MaxZ, traction_pa }];
    scene(desc)
}

fn tip(mesh: Mesh, load: f64) -> Result<Tip> {
    let body = statics::far_bent(&loaded(mesh, load))?;
    let u = displacement_m(&body, Vec3::new(0.5 * SIDE_M, 0.5 * SIDE_M, LENGTH_M + CLAMP_M))?;
    Ok(Tip { down_m: -u.y, back_m: -u.z })
}

/// The family.
///
/// # Errors
/// A beam did not come to rest.
pub fn family(extent: Extent) -> Result<Family> {
    let edges_m: &[f64] = if extent == Extent::Coarse { &[1e-2] } else { &[2e-2, 1e-2, 5e-3] };
    let of_k = |k: u32| edges_m.iter().map(move |edge_m| Mesh::new(k, edge_m / f64::from(k)));
    let meshes: Vec<Mesh> = [1, 2, 4].into_iter().flat_map(of_k).collect();
    let loads = extent.of(&LOADS, 2);
    let runs: Vec<(Mesh, f64)> = meshes.iter().flat_map(|m| loads.iter().map(|l| (*m, l.0))).collect();
    let found = runs.par_iter().map(|(mesh, load)| tip(*mesh, *load)).collect::<Result<Vec<Tip>>>()?;
    let at = |mesh: usize, load: usize| found[mesh * loads.len() + load];
    let mut rows = Vec::new();
    for (i, &(load, down, back)) in loads.iter().enumerate() {
        let theory = beam(load).large_tip();
        let figure = |case: &str, reference: f64, of: &dyn Fn(Tip) -> f64, source: &str| Row {
            case: format!("P L^2 / E I = {load}: {case}"),
            reference: Reference::Value(reference, ""),
            ours: (0..meshes.len()).map(|m| of(at(m, i)) / LENGTH_M).collect(),
            source: source.into(),
        };
        rows.push(figure("down / L", down, &|t| t.down_m, "Mattiasson 1981"));
        rows.push(figure("down / L", theory.down_m / LENGTH_M, &|t| t.down_m, "Reissner 1972"));
        rows.push(figure("back / L", back, &|t| t.back_m, "Mattiasson 1981"));
        rows.push(figure("back / L", theory.back_m / LENGTH_M, &|t| t.back_m, "Reissner 1972"));
    }
    Ok(Family {
        title: "Large deflection under a tip load",
        text: "The bar has a section of 0.02 x 0.02 m, a length of 0.4 m, nu 0 and a dead shear traction on its end \
               face. Mattiasson's figures are those of the elastica, which neither stretches nor shears. At this \
               slenderness both show, so Reissner's beam with the body's section is a second reference. The \
               difference from it is up to 0.2 %. It does not fall under refinement and is nearly the same at every \
               k, so it is no error of the mesh."
            .into(),
        tables: vec![Table { columns: meshes.iter().map(Mesh::name).collect(), rows }],
        ..Family::default()
    })
}
