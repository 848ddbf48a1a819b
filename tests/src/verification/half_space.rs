//! Pressure on an elastic half-space: a uniform one on a square (Love 1929) and on a strip.
//!
//! The body is a block cut from the half-space. On its other faces act the tractions that the exact
//! solution has there, so that nothing is lost to the block's size.

use std::f64::consts::PI;

use anyhow::Result;
use kerf_physics::scene::{Face, LoadDesc, ShapeDesc};
use kerf_physics::{Mat3, Vec3};
use rayon::prelude::*;

use super::scenes::{Mesh, block, displacement_m, material, scene};
use super::{Extent, Family, Reference, Row, Series, Study, Table, statics};

/// Half-width of the loaded square or strip, m.
const A_M: f64 = 0.02;
const YOUNG_PA: f64 = 1e6;
const PRESSURE_PA: f64 = 100.0;
/// Extent of the block to each side and in depth, in half-widths.
const REACH: f64 = 3.0;
/// Point or line sources along an edge of the loaded area, for the field far from it.
const SOURCES: u32 = 24;

/// Stress at depth below a point force along -y at the origin of the half-space y < 0 (Boussinesq 1885;
/// Johnson 1985, eq. 3.18 and 3.19, with z = -y), Pa per N.
fn boussinesq(at_m: Vec3, poisson_ratio: f64) -> Mat3 {
    let (x, z, d) = (at_m.x, at_m.z, -at_m.y);
    let (r2, rho) = (x * x + z * z, at_m.norm());
    let (rho3, rho5) = (rho.powi(3), rho.powi(5));
    let f = (1.0 - 2.0 * poisson_ratio) / r2;
    let lateral =
        |p: f64, q: f64| f * ((1.0 - d / rho) * (p * p - q * q) / r2 + d * q * q / rho3) - 3.0 * d * p * p / rho5;
    let xz = f * ((1.0 - d / rho) * x * z / r2 - x * z * d / rho3) - 3.0 * x * z * d / rho5;
    // The depth points down, so shear with y changes its sign.
    let (xy, yz) = (3.0 * x * d * d / rho5, 3.0 * z * d * d / rho5);
    Mat3::new(lateral(x, z), xy, xz, xy, -3.0 * d.powi(3) / rho5, yz, xz, yz, lateral(z, x)) / (2.0 * PI)
}

/// Displacement along -y below a point force along -y, m per N (Johnson 1985, eq. 3.18c).
fn boussinesq_down(at_m: Vec3, poisson_ratio: f64) -> f64 {
    let rho = at_m.norm();
    let shear_modulus = YOUNG_PA / (2.0 * (1.0 + poisson_ratio));
    (at_m.y * at_m.y / rho.powi(3) + 2.0 * (1.0 - poisson_ratio) / rho) / (4.0 * PI * shear_modulus)
}

/// Stress below a line force along -y on the z axis in plane strain (Flamant 1892), Pa per N/m.
fn flamant(at_m: Vec3, poisson_ratio: f64) -> Mat3 {
    let (x, d) = (at_m.x, -at_m.y);
    let factor = -2.0 / (PI * (x * x + d * d).powi(2));
    let (xx, yy, xy) = (factor * x * x * d, factor * d.powi(3), -factor * x * d * d);
    Mat3::new(xx, xy, 0.0, xy, yy, 0.0, 0.0, 0.0, poisson_ratio * (xx + yy))
}

/// Middles of the intervals that -a..a is divided in, m.
fn sources() -> impl Iterator<Item = f64> + Clone {
    (0..SOURCES).map(|i| A_M * ((2.0 * f64::from(i) + 1.0) / f64::from(SOURCES) - 1.0))
}

/// Which area carries the pressure.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Loaded {
    /// |x| < a and |z| < a.
    Square,
    /// |x| < a in plane strain.
    Strip,
}

impl Loaded {
    /// The block, m: its lower corner; the upper is its mirror image at y = 0.
    fn lower_m(self, mesh: Mesh) -> [f64; 3] {
        let reach_m = REACH * A_M;
        let across_m = if self == Self::Square { reach_m } else { mesh.element_m() };
        [-reach_m, -reach_m, -across_m]
    }

    /// Stress of the exact solution far from the loaded area, Pa.
    fn stress_pa(self, at_m: Vec3, poisson_ratio: f64) -> Mat3 {
        let width_m = 2.0 * A_M / f64::from(SOURCES);
        match self {
            Self::Square => {
                sources()
                    .flat_map(|x| sources().map(move |z| boussinesq(at_m - Vec3::new(x, 0.0, z), poisson_ratio)))
                    .sum::<Mat3>()
                    * (PRESSURE_PA * width_m * width_m)
            }
            Self::Strip => {
                sources().map(|x| flamant(at_m - Vec3::new(x, 0.0, 0.0), poisson_ratio)).sum::<Mat3>()
                    * (PRESSURE_PA * width_m)
            }
        }
    }

    /// The pressure and, patch by patch of an element's size, the tractions on the block's other faces. What
    /// the patches miss of equilibrium is spread over the bottom.
    fn loads(self, mesh: Mesh, poisson_ratio: f64) -> Vec<LoadDesc> {
        let (lower, h) = (Vec3::from(self.lower_m(mesh)), mesh.element_m());
        let upper = Vec3::new(-lower.x, 0.0, -lower.z);
        let z_m = if self == Self::Square { A_M } else { 1.0 };
        let region = ShapeDesc::Box { min_m: [-A_M, -1.0, -z_m], max_m: [A_M, 1.0, z_m] };
        let mut loads = vec![LoadDesc::Traction { region, face: Face::MaxY, traction_pa: [0.0, -PRESSURE_PA, 0.0] }];
        let mut total_n = Vec3::new(0.0, -PRESSURE_PA * 4.0 * A_M * z_m.min(upper.z), 0.0);
        let faces = [Face::MinX, Face::MaxX, Face::MinZ, Face::MaxZ, Face::MinY];
        for (face, axis, at, sign) in [
            (faces[0], 0, lower.x, -1.0),
            (faces[1], 0, upper.x, 1.0),
            (faces[2], 2, lower.z, -1.0),
            (faces[3], 2, upper.z, 1.0),
            (faces[4], 1, lower.y, -1.0),
        ] {
            for middle in patches(lower, upper, axis, at, h) {
                let traction = self.stress_pa(middle, poisson_ratio).column(axis) * sign;
                total_n += traction * (h * h);
                let mut half = Vec3::repeat(0.5 * h);
                half[axis] = h;
                let region = ShapeDesc::Box { min_m: (middle - half).into(), max_m: (middle + half).into() };
                loads.push(LoadDesc::Traction { region, face, traction_pa: traction.into() });
            }
        }
        let bottom_m2 = (upper.x - lower.x) * (upper.z - lower.z);
        let mend = LoadDesc::Traction {
            region: super::scenes::EVERYWHERE,
            face: Face::MinY,
            traction_pa: (-total_n / bottom_m2).into(),
        };
        loads.push(mend);
        loads
    }

    /// The block at rest: how much deeper one point of it has sunk than another, m.
    fn sunk_m(self, mesh: Mesh, poisson_ratio: f64, point_m: Vec3, than_m: Vec3) -> Result<f64> {
        let lower = self.lower_m(mesh);
        let mut desc = block([1.0; 3], mesh, material(YOUNG_PA, poisson_ratio));
        desc.shape = ShapeDesc::Box { min_m: lower, max_m: [-lower[0], 0.0, -lower[2]] };
        desc.loads = self.loads(mesh, poisson_ratio);
        let mut body = statics::body(&scene(desc), statics::FREE_TAU_S)?;
        statics::settle(&mut body)?;
        Ok(displacement_m(&body, than_m)?.y - displacement_m(&body, point_m)?.y)
    }

    /// The two points that are compared, m, and by how much the first sinks deeper, m.
    fn exact(self, poisson_ratio: f64) -> (Vec3, Vec3, f64) {
        let compliance = PRESSURE_PA * A_M * (1.0 - poisson_ratio.powi(2)) / (PI * YOUNG_PA);
        match self {
            Self::Square => {
                let bottom = Vec3::new(0.0, -REACH * A_M, 0.0);
                let force_n = PRESSURE_PA * (2.0 * A_M / f64::from(SOURCES)).powi(2);
                let deep: f64 = sources()
                    .flat_map(|x| sources().map(move |z| boussinesq_down(bottom - Vec3::new(x, 0.0, z), poisson_ratio)))
                    .sum();
                (Vec3::zeros(), bottom, 8.0 * (1.0 + 2f64.sqrt()).ln() * compliance - force_n * deep)
            }
            Self::Strip => (Vec3::zeros(), Vec3::new(2.0 * A_M, 0.0, 0.0), 6.0 * 3f64.ln() * compliance),
        }
    }
}

/// Middles of the squares of edge `h` that tile the face of a block at `at` along `axis`.
fn patches(lower: Vec3, upper: Vec3, axis: usize, at: f64, h: f64) -> Vec<Vec3> {
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let count = |a: usize| ((upper[a] - lower[a]) / h).round() as usize;
    let mut middles = Vec::with_capacity(count(u) * count(v));
    for i in 0..count(u) {
        for j in 0..count(v) {
            let mut middle = Vec3::zeros();
            middle[axis] = at;
            middle[u] = lower[u] + (i as f64 + 0.5) * h;
            middle[v] = lower[v] + (j as f64 + 0.5) * h;
            middles.push(middle);
        }
    }
    middles
}

/// A mesh of elements `per_half_width` to the half-width.
fn mesh(k: u32, per_half_width: u32) -> Mesh {
    Mesh::new(k, A_M / f64::from(per_half_width * k))
}

fn table(loaded: Loaded, meshes: &[(u32, u32)], poisson: &[f64], case: &str, source: &str) -> Result<Table> {
    let runs: Vec<(f64, (u32, u32))> = poisson.iter().flat_map(|nu| meshes.iter().map(|m| (*nu, *m))).collect();
    let run = |&(nu, (k, n)): &(f64, (u32, u32))| {
        let (point, than, _) = loaded.exact(nu);
        Ok(1e6 * loaded.sunk_m(mesh(k, n), nu, point, than)?)
    };
    let found = runs.par_iter().map(run).collect::<Result<Vec<f64>>>()?;
    let rows = poisson.iter().zip(found.chunks(meshes.len())).map(|(nu, ours)| Row {
        case: format!("nu {nu}: {case}"),
        reference: Reference::Value(1e6 * loaded.exact(*nu).2, "um"),
        ours: ours.to_vec(),
        source: source.into(),
    });
    Ok(Table { rows: rows.collect(), columns: meshes.iter().map(|(k, n)| format!("k {k}, a/H {n}")).collect() })
}

fn study(table: &Table, row: usize, meshes: &[(u32, u32)], file: &'static str, title: String) -> Study {
    let errors: Vec<f64> = table.rows[row].errors().collect();
    let series = [1, 2, 4].map(|k| {
        let of_k = meshes.iter().zip(&errors).filter(|((k_of_mesh, _), _)| *k_of_mesh == k);
        let points = of_k.map(|((_, per_a), error)| (1e3 * A_M / f64::from(*per_a), *error));
        Series::new(format!("k = {k}"), points.collect())
    });
    let error_of = "depth to which the middle sinks".into();
    Study { file, title, error_of, size_of: "edge of an element, mm (a = 20 mm)", series: series.to_vec() }
}

/// The family.
///
/// # Errors
/// A block did not come to rest.
pub fn family(extent: Extent) -> Result<Family> {
    let (square, strip) = match extent {
        Extent::Coarse => (vec![(1, 2), (2, 2)], vec![(1, 2), (2, 2), (4, 2)]),
        Extent::Full => (
            vec![(1, 1), (1, 2), (1, 4), (1, 8), (2, 1), (2, 2), (2, 4), (4, 1), (4, 2)],
            [1, 2, 4].into_iter().flat_map(|k| [1, 2, 4, 8].map(|per_a| (k, per_a))).collect(),
        ),
    };
    let poisson = extent.of(&[0.3, 0.45, 0.49], 2);
    let tables = vec![
        table(
            Loaded::Square,
            &square,
            &poisson,
            "square, middle below a point 3 a deep",
            "Love 1929; Boussinesq 1885",
        )?,
        table(
            Loaded::Strip,
            &strip,
            &poisson,
            "strip, middle below the surface at 2 a",
            "Flamant 1892; Johnson 1985, 2.5",
        )?,
    ];
    let studies = match extent {
        Extent::Coarse => Vec::new(),
        Extent::Full => vec![
            study(&tables[0], 1, &square, "love", "Pressure on a square of a half-space, nu 0.45".into()),
            study(&tables[1], 1, &strip, "flamant", "Pressure on a strip of a half-space, nu 0.45".into()),
        ],
    };
    Ok(Family {
        title: "Pressure on a half-space",
        text: "A uniform pressure acts on a square, or on a strip in plane strain, of half-width a. The block is 6 a \
            x 6 a x 3 a. Its other faces carry the exact tractions of the half-space, one for each face of an \
            element. H is the edge of an element. The errors of the square below 0.5 % are not yet asymptotic."
            .into(),
        tables,
        studies,
        ..Family::default()
    })
}
