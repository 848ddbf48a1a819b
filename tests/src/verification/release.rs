//! Energy release rate of cracks that links parted beforehand make, by the difference of potential
//! energies at two crack lengths: no blade, no front.

use std::ops::Range;

use anyhow::Result;
use kerf_physics::scene::{Face, LoadDesc, ObjectDesc, RegionDesc, ShapeDesc};
use kerf_physics::{Body, Crossing, LinkId, Vec3, verification};
use rayon::prelude::*;

use super::scenes::{Mesh, block, displacement_m, material, scene};
use super::{Extent, Family, Reference, Row, Series, Study, Table, statics};

const YOUNG_PA: f64 = 1e6;
/// Thickness along z, m; nu is 0, so it does not matter otherwise.
const THICKNESS_M: f64 = 0.02;
/// What a crack advances between two solutions, m: a multiple of every element's edge.
const ADVANCE_M: f64 = 0.02;

/// Parts the links across the plane y = `height_m` whose middles lie in one of the ranges of x.
fn crack(body: &mut Body, height_m: f64, along_m: &[Range<f64>]) {
    let (h, [nx, _, nz]) = (body.grid().voxel_size_m(), body.grid().dims());
    let j = (height_m / h).round() as i32 - 1;
    let mut links = Vec::new();
    for i in (0..nx).filter(|i| along_m.iter().any(|r| r.contains(&((f64::from(*i) + 0.5) * h)))) {
        for k in 0..nz {
            links.push((LinkId { cell: [i, j, k], axis: 1 }, Crossing { t: 0.5, normal: [0.0, 1.0, 0.0] }));
        }
    }
    verification::part(body, &links);
}

/// Potential energy at rest of a body under its dead loads, J, and the body.
fn rest(desc: &ObjectDesc, height_m: f64, along_m: &[Range<f64>]) -> Result<(f64, Body)> {
    let mut body = statics::body(&scene(desc.clone()), statics::HELD_TAU_S)?;
    crack(&mut body, height_m, along_m);
    statics::settle(&mut body)?;
    let moved = (0..body.node_count())
        .map(|n| (Vec3::from(verification::state(&body).position_m[n]) - body.rest_position_m(n)).into());
    let energy = verification::energy(&body);
    Ok((energy.elastic_j - verification::external_work_j(&body, moved), body))
}

/// The strip between clamps: height and length, m, and thickness of the upper clamp.
const STRIP_M: [f64; 2] = [0.04, 0.32];
const CLAMP_M: f64 = 0.02;

/// Energy release rate of a strip between clamps over W H, W the energy density far from its two cracks.
fn pure_shear(mesh: Mesh, crack_m: f64) -> Result<f64> {
    let [height_m, length_m] = STRIP_M;
    let mut desc = block([length_m, CLAMP_M + height_m + CLAMP_M, THICKNESS_M], mesh, material(YOUNG_PA, 0.0));
    desc.fixed = vec![ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0, CLAMP_M, 1.0] }];
    desc.regions = vec![RegionDesc {
        name: "clamp".into(),
        shape: ShapeDesc::Box { min_m: [-1.0, CLAMP_M + height_m, -1.0], max_m: [1.0; 3] },
        material: material(1e4 * YOUNG_PA, 0.0),
    }];
    let traction_pa = 1e-4 * YOUNG_PA;
    // Over what is not cracked, on the mean: the clamp is not bent.
    let half_m = 0.5 * length_m - crack_m - 0.5 * ADVANCE_M;
    let region =
        ShapeDesc::Box { min_m: [0.5 * length_m - half_m, -1.0, -1.0], max_m: [0.5 * length_m + half_m, 1.0, 1.0] };
    desc.loads = vec![LoadDesc::Traction { region, face: Face::MaxY, traction_pa: [0.0, traction_pa, 0.0] }];
    let middle_m = CLAMP_M + 0.5 * height_m;
    let at = |a: f64| -> Result<(f64, f64)> {
        let (potential_j, body) = rest(&desc, middle_m, &[0.0..a, length_m - a..length_m])?;
        let clamp = Vec3::new(0.5 * length_m, CLAMP_M + height_m, 0.5 * THICKNESS_M);
        Ok((potential_j, displacement_m(&body, clamp)?.y))
    };
    let (before, after) = (at(crack_m)?, at(crack_m + ADVANCE_M)?);
    let release_j_per_m2 = (before.0 - after.0) / (2.0 * THICKNESS_M * ADVANCE_M);
    // At dead load -dPi = F (d2 - d1) / 2 = d1 d2 (k1 - k2) / 2: the strip's k falls by E dA / H.
    Ok(release_j_per_m2 / (0.5 * YOUNG_PA * before.1 * after.1 / height_m))
}

/// Uncracked length of the double cantilever beyond the longest crack, m.
const LIGAMENT_M: f64 = 0.1;
/// What Foote and Buchwald (1985) add to a crack's length, in arm heights.
const ROOT: f64 = 0.6728;

/// Energy release rate of a double cantilever over 12 P^2 (a + c h)^2 / (E b^2 h^3), for c = 0 (beam theory)
/// and c = [`ROOT`]; the theories are means over the advance.
fn double_cantilever(mesh: Mesh, arm_m: f64, crack_m: f64) -> Result<[f64; 2]> {
    let length_m = crack_m + ADVANCE_M + LIGAMENT_M;
    let mut desc = block([length_m, 2.0 * arm_m, THICKNESS_M], mesh, material(YOUNG_PA, 0.0));
    desc.fixed = vec![ShapeDesc::Box { min_m: [length_m - 0.02, -1.0, -1.0], max_m: [1.0; 3] }];
    let traction_pa = 1e-6 * YOUNG_PA;
    let pull = |from_m: f64, to_m: f64, sign: f64| LoadDesc::Traction {
        region: ShapeDesc::Box { min_m: [-1.0, from_m, -1.0], max_m: [1.0, to_m, 1.0] },
        face: Face::MinX,
        traction_pa: [0.0, sign * traction_pa, 0.0],
    };
    desc.loads = vec![pull(-1.0, arm_m, -1.0), pull(arm_m, 1.0, 1.0)];
    let before = rest(&desc, arm_m, &[0.0..crack_m])?.0;
    let after = rest(&desc, arm_m, &[0.0..crack_m + ADVANCE_M])?.0;
    let force_n = traction_pa * arm_m * THICKNESS_M;
    let release_j_per_m2 = (before - after) / (THICKNESS_M * ADVANCE_M);
    Ok([0.0, ROOT].map(|root| {
        let a = crack_m + root * arm_m;
        let mean_square = ((a + ADVANCE_M).powi(3) - a.powi(3)) / (3.0 * ADVANCE_M);
        let theory = 12.0 * force_n * force_n * mean_square / (YOUNG_PA * THICKNESS_M.powi(2) * arm_m.powi(3));
        release_j_per_m2 / theory
    }))
}

fn row(case: String, source: &str, ours: Vec<f64>) -> Row {
    Row { case, reference: Reference::Value(1.0, ""), ours, source: source.into() }
}

/// The family.
///
/// # Errors
/// A body did not come to rest.
pub fn family(extent: Extent) -> Result<Family> {
    let meshes = match extent {
        Extent::Coarse => vec![Mesh::new(1, 1e-2), Mesh::new(2, 5e-3), Mesh::new(4, 2.5e-3)],
        Extent::Full => [(1, 1e-2), (1, 5e-3), (2, 5e-3), (2, 2.5e-3), (4, 5e-3), (4, 2.5e-3), (4, 1.25e-3)]
            .map(|(k, h)| Mesh::new(k, h))
            .to_vec(),
    };
    let mut rows = Vec::new();
    for crack_m in extent.of(&[0.06, 0.08, 0.1], 1) {
        let ours = meshes.par_iter().map(|m| pure_shear(*m, crack_m)).collect::<Result<_>>()?;
        rows.push(row(format!("strip, cracks of {:.0} mm: G / W H", crack_m * 1e3), "Rivlin, Thomas 1953", ours));
    }
    for crack_m in extent.of(&[0.1, 0.2], 1) {
        let found = meshes.par_iter().map(|m| double_cantilever(*m, 0.02, crack_m)).collect::<Result<Vec<_>>>()?;
        let name = format!("double cantilever, a/h {:.0}", crack_m / 0.02);
        let of = |i: usize| found.iter().map(|f| f[i]).collect();
        rows.push(row(format!("{name}: G / (12 P^2 a^2 / E b^2 h^3)"), "beam theory", of(0)));
        rows.push(row(format!("{name}: the same with a + 0.673 h"), "Foote, Buchwald 1985", of(1)));
    }
    // Arms of half cells: the crack runs inside cells and duplicates them.
    let inside: Vec<Mesh> = meshes.iter().copied().filter(|m| m.k() > 1).collect();
    let mut table = Table { columns: inside.iter().map(Mesh::name).collect(), rows: Vec::new() };
    let half = |m: &Mesh| Ok(double_cantilever(*m, 0.02 + 0.5 * m.element_m(), 0.1)?[1]);
    let ours = inside.par_iter().map(half).collect::<Result<_>>()?;
    let case = "double cantilever, h = 20 mm + H/2: G with a + 0.673 h".to_owned();
    table.rows.push(row(case, "Foote, Buchwald 1985", ours));
    let study = study(&rows[rows.len() - 1], &meshes);
    Ok(Family {
        title: "Energy release without a blade",
        text: "Links across a plane are cut beforehand. G is the difference of the potential energies at rest for \
               cracks of a and a + 20 mm, over the area between them. nu is 0, so that plane stress and plane strain \
               agree. The strip (40 mm high, two cracks) hangs between a fixed clamp and one that is 10,000 times as \
               stiff as the strip. The double cantilever has arms of h = 20 mm under opposite shear tractions. In \
               beam theory the arms do not turn at their root. Foote and Buchwald's asymptotic solution of plane \
               elasticity adds 0.673 h to the crack for that. In the second table the crack runs through the middle \
               of elements and duplicates them."
            .into(),
        tables: vec![Table { columns: meshes.iter().map(Mesh::name).collect(), rows }, table],
        studies: if extent == Extent::Full { vec![study] } else { Vec::new() },
        ..Family::default()
    })
}

fn study(row: &Row, meshes: &[Mesh]) -> Study {
    let errors: Vec<f64> = row.errors().collect();
    let series = [1, 2, 4].map(|k| {
        let of_k = meshes.iter().zip(&errors).filter(|(m, _)| m.k() == k);
        Series::new(format!("k = {k}"), of_k.map(|(m, e)| (1e3 * m.element_m(), *e)).collect())
    });
    Study {
        file: "release",
        title: "Double cantilever, a/h = 10".into(),
        error_of: "energy release rate against Foote and Buchwald".into(),
        size_of: "edge of an element, mm (h = 20 mm)",
        series: series.to_vec(),
    }
}
