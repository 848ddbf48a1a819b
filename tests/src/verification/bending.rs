//! Bending of composite elements against the converged solution of full FEM, towards incompressibility.

use std::collections::BTreeMap;

use anyhow::Result;
use rayon::prelude::*;

use super::cantilever::{sag_m, theory};
use super::scenes::Mesh;
use super::{Extent, Family, Reference, Row, Series, Study, Table};

/// A hundredth of the weight: the deflection is linear to 1e-5.
const GRAVITY_M_PER_S2: f64 = 0.0981;
const VOXEL_M: f64 = 2.5e-3;
const POISSON: [f64; 4] = [0.3, 0.45, 0.49, 0.499];

/// A section and the meshes of full FEM that its reference is extrapolated from, voxels' edges halved.
struct Section {
    name: &'static str,
    side_m: f64,
}

const SECTIONS: [Section; 2] =
    [Section { name: "8 voxels", side_m: 8.0 * VOXEL_M }, Section { name: "10 voxels", side_m: 10.0 * VOXEL_M }];

/// Voxels' edges of the full FEM that the reference comes from, m.
const FINE_M: [f64; 3] = [2.0 * VOXEL_M, VOXEL_M, 0.5 * VOXEL_M];

/// The limit of a sequence on halved meshes and its order (Richardson 1911), from the last three terms;
/// the order is kept between 1 and 4, so that differences near round-off do no harm.
pub(super) fn limit([coarse, middle, fine]: [f64; 3]) -> (f64, f64) {
    let order = ((coarse - middle) / (middle - fine)).abs().log2().clamp(1.0, 4.0);
    (fine + (fine - middle) / (order.exp2() - 1.0), order)
}

type Key = (u64, u64, u32, u64);

/// Tip deflections of every beam that is asked for, each run once.
struct Deflections(BTreeMap<Key, f64>);

fn key(side_m: f64, poisson: f64, mesh: Mesh) -> Key {
    (side_m.to_bits(), poisson.to_bits(), mesh.k(), mesh.voxel_m.to_bits())
}

impl Deflections {
    fn run(beams: &[(f64, f64, Mesh)]) -> Result<Self> {
        let found = beams.par_iter().map(|&(side_m, poisson, mesh)| {
            Ok((key(side_m, poisson, mesh), -sag_m(mesh, side_m, poisson, GRAVITY_M_PER_S2)?.y))
        });
        Ok(Self(found.collect::<Result<_>>()?))
    }

    fn of(&self, side_m: f64, poisson: f64, mesh: Mesh) -> f64 {
        self.0[&key(side_m, poisson, mesh)]
    }
}

/// The family.
///
/// # Errors
/// A beam did not come to rest.
pub fn family(extent: Extent) -> Result<Family> {
    let (sections, poisson) = match extent {
        Extent::Coarse => (&SECTIONS[..1], &POISSON[..3]),
        Extent::Full => (&SECTIONS[..], &POISSON[..]),
    };
    let fine = &FINE_M[..extent.of(&FINE_M, 2).len()];
    let columns = [1, 2, 4, 8].map(|k| Mesh::new(k, VOXEL_M));
    let mut beams = Vec::new();
    // The largest first, so that no thread is left with one at the end.
    for mesh in fine.iter().rev().map(|h| Mesh::new(1, *h)).chain(columns[1..].iter().copied()) {
        beams.extend(sections.iter().flat_map(|s| poisson.iter().map(move |nu| (s.side_m, *nu, mesh))));
    }
    let refined = study_meshes(extent);
    for mesh in &refined {
        beams.extend(poisson.iter().map(|nu| (SECTIONS[0].side_m, *nu, *mesh)));
    }
    let found = Deflections::run(&beams)?;
    let reference = |side_m: f64, nu: f64| match fine {
        [a, b, c] => limit([a, b, c].map(|h| found.of(side_m, nu, Mesh::new(1, *h)))).0,
        _ => found.of(side_m, nu, Mesh::new(1, VOXEL_M)),
    };
    let mut rows = Vec::new();
    for section in sections {
        for &nu in poisson {
            rows.push(Row {
                case: format!("{} across, nu {nu}: tip down", section.name),
                reference: Reference::Value(1e6 * reference(section.side_m, nu), "um"),
                ours: columns.iter().map(|mesh| 1e6 * found.of(section.side_m, nu, *mesh)).collect(),
                source: source(section.side_m, nu, reference(section.side_m, nu)),
            });
        }
    }
    let studies = if extent == Extent::Full { studies(&found, &refined, &reference) } else { Vec::new() };
    Ok(Family {
        title: "Bending of composite elements",
        text: format!(
            "A cantilever of 0.2 m has a square section of 8 or 10 voxels of {} mm, and E 2 MPa. It bends under a \
             hundredth of its weight, with the same clamp of 20 mm on every mesh. The reference is the limit of full \
             FEM (k = 1) under refinement of the voxels (5, 2.5 and 1.25 mm). It is extrapolated with the observed \
             order (Richardson 1911). With 8 voxels across there are 4, 2 and 1 whole elements at k = 2, 4 and 8. \
             With 10 voxels the last element is partly filled from k = 4 on.",
            VOXEL_M * 1e3
        ),
        tables: vec![Table { columns: columns.iter().map(|m| format!("k {}", m.k())).collect(), rows }],
        studies,
        ..Family::default()
    })
}

fn source(side_m: f64, nu: f64, reference_m: f64) -> String {
    let beam = reference_m / theory(side_m, nu, GRAVITY_M_PER_S2).linear_tip_m() - 1.0;
    format!("full FEM, extrapolated ({:+.2} % of Timoshenko's beam, which has no clamp effect)", 100.0 * beam)
}

/// Meshes of the convergence study that the table has not.
fn study_meshes(extent: Extent) -> Vec<Mesh> {
    match extent {
        Extent::Coarse => Vec::new(),
        Extent::Full => [(1, 1e-2), (2, 5e-3), (2, 1.25e-3), (4, 5e-3), (4, 1.25e-3), (4, 0.625e-3)]
            .map(|(k, h)| Mesh::new(k, h))
            .to_vec(),
    }
}

/// Error of the tip over the elements' edge: a plot for each Poisson's ratio.
fn studies(found: &Deflections, refined: &[Mesh], reference: &dyn Fn(f64, f64) -> f64) -> Vec<Study> {
    let files = ["bending-30", "bending-45", "bending-49", "bending-499"];
    let side_m = SECTIONS[0].side_m;
    let all = [Mesh::new(1, FINE_M[0]), Mesh::new(1, FINE_M[1]), Mesh::new(2, VOXEL_M), Mesh::new(4, VOXEL_M)];
    let studies = POISSON.iter().zip(files).map(|(&nu, file)| Study {
        file,
        title: format!("Cantilever of 8 voxels of 2.5 mm across, nu {nu}"),
        error_of: "tip's deflection against the limit of full FEM".into(),
        size_of: "edge of an element, mm",
        series: [1, 2, 4]
            .map(|k| {
                let error = |m: &Mesh| found.of(side_m, nu, *m) / reference(side_m, nu) - 1.0;
                let of_k = all.iter().chain(refined).filter(|m| m.k() == k);
                Series::new(format!("k = {k}"), of_k.map(|m| (1e3 * m.element_m(), error(m))).collect())
            })
            .to_vec(),
    });
    studies.collect()
}
