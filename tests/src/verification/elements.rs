//! Patch test, rigid rotation, and force as the gradient of the energy: what holds to round-off.

use anyhow::Result;
use kerf_physics::scene::{ObjectDesc, ShapeDesc};
use kerf_physics::{Body, Crossing, LinkId, Mat3, Quat, Vec3, verification};
use rayon::prelude::*;

use super::scenes::{Lcg, Mesh, block, deform, largest, material, scene};
use super::{Extent, Family, Reference, Row, Table, statics};

const YOUNG_PA: f64 = 1e6;
const POISSON: f64 = 0.45;
const VOXEL_M: f64 = 0.01;
const ROUNDING: &str = "exact: round-off alone";

/// How the cells of a body are filled.
#[derive(Clone, Copy, Debug)]
enum Filling {
    Whole,
    Partial,
    /// Partly filled, and links parted at random: cells are duplicated.
    Parted,
}

impl Filling {
    const ALL: [(Self, &'static str); 3] = [
        (Self::Whole, "whole cells"),
        (Self::Partial, "partly filled cells"),
        (Self::Parted, "partly filled, duplicated cells"),
    ];

    fn object(self, level: u8) -> ObjectDesc {
        let mut desc = block([0.16, 0.08, 0.08], Mesh { voxel_m: VOXEL_M, level }, material(YOUNG_PA, POISSON));
        if !matches!(self, Self::Whole) {
            desc.shape = ShapeDesc::Ellipsoid { center_m: [0.05; 3], semi_axes_m: [0.05, 0.044, 0.05] };
        }
        desc
    }

    fn body(self, level: u8, strain_stiffening: f64) -> Result<Body> {
        let mut desc = self.object(level);
        desc.material.strain_stiffening = strain_stiffening;
        let mut body = statics::body(&scene(desc), statics::FREE_TAU_S)?;
        if matches!(self, Self::Parted) {
            part_at_random(&mut body, 400, |_| true, &mut Lcg(3));
        }
        Ok(body)
    }
}

/// Parts up to `count` links along the axes that are allowed.
pub fn part_at_random(body: &mut Body, count: usize, allowed: impl Fn(u8) -> bool, rng: &mut Lcg) {
    let dims = body.grid().dims();
    let links: Vec<_> = (0..count)
        .map(|_| {
            let cell = dims.map(|d| (rng.unit() * f64::from(d)) as i32);
            (LinkId { cell, axis: (rng.unit() * 3.0) as u8 }, Crossing { t: 0.5, normal: [1.0, 0.0, 0.0] })
        })
        .filter(|(link, _)| allowed(link.axis))
        .collect();
    verification::part(body, &links);
}

fn turn(angle_rad: f64) -> Mat3 {
    *Quat::from_scaled_axis(Vec3::new(1.0, 2.0, -0.5).normalize() * angle_rad).to_rotation_matrix().matrix()
}

/// Worst nodal force under `x = Q S X + t` against that of the constant stress `Q (2 mu (S - 1) +
/// lambda tr(S - 1))`, over the largest: exact for any stretch, since the Biot stress is linear in it.
fn patch(filling: Filling, level: u8) -> Result<f64> {
    let mut body = filling.body(level, 0.0)?;
    let stretch = Mat3::new(1.03, 0.02, -0.01, 0.02, 0.96, 0.015, -0.01, 0.015, 1.05);
    let rotation = turn(0.7);
    deform(&mut body, &(rotation * stretch), &Vec3::new(0.5, -1.0, 2.0));
    let mu_pa = YOUNG_PA / (2.0 * (1.0 + POISSON));
    let lambda_pa = YOUNG_PA * POISSON / ((1.0 + POISSON) * (1.0 - 2.0 * POISSON));
    let strain = stretch - Mat3::identity();
    let stress = strain * (2.0 * mu_pa) + Mat3::identity() * (lambda_pa * strain.trace());
    let expected = verification::constant_stress_forces_n(&body, &(rotation * stress));
    let off: Vec<[f64; 3]> = verification::elastic_forces_n(&body)
        .iter()
        .zip(&expected)
        .map(|(g, e)| [0, 1, 2].map(|i| g[i] - e[i]))
        .collect();
    Ok(largest(&off) / largest(&expected))
}

/// Largest force of a turned body over E h^2, and its energy over E V.
fn rigid(filling: Filling, level: u8) -> Result<[f64; 2]> {
    let mut worst = [0.0f64; 2];
    let mut body = filling.body(level, 10.0)?;
    let volume = body.grid().voxels().len() as f64 * VOXEL_M.powi(3);
    for angle in [0.3, 1.7, 3.1] {
        deform(&mut body, &turn(angle), &Vec3::new(0.5, -1.0, 2.0));
        worst[0] = worst[0].max(largest(&verification::elastic_forces_n(&body)) / (YOUNG_PA * VOXEL_M.powi(2)));
        worst[1] = worst[1].max((verification::energy(&body).elastic_j / (YOUNG_PA * volume)).abs());
    }
    Ok(worst)
}

/// Moves nodes at random by `share` of a cell's edge.
fn shake(body: &mut Body, share: f64, rng: &mut Lcg) {
    let size_m = share * body.lattice_edge_m();
    for node in 0..body.node_count() {
        verification::state_mut(body).position_m[node] = (body.rest_position_m(node) + rng.vector() * size_m).into();
    }
    verification::evaluate(body, 60);
}

/// Change of a strained body's energy when it is turned, over the energy.
fn invariance(filling: Filling, level: u8) -> Result<f64> {
    let mut body = filling.body(level, 10.0)?;
    shake(&mut body, 0.05, &mut Lcg(5));
    let energy = verification::energy(&body).elastic_j;
    let mut worst = 0.0f64;
    for angle in [0.3, 1.7, 3.1] {
        let q = turn(angle);
        verification::state_mut(&mut body).position_m.iter_mut().for_each(|x| *x = (q * Vec3::from(*x)).into());
        verification::evaluate(&mut body, 60);
        worst = worst.max((verification::energy(&body).elastic_j / energy - 1.0).abs());
    }
    Ok(worst)
}

/// Worst difference between a force and the central difference of the energy, over the largest force, at
/// nodes and axes drawn at random.
fn gradient(filling: Filling, level: u8, strain_stiffening: f64) -> Result<f64> {
    let mut body = filling.body(level, strain_stiffening)?;
    let mut rng = Lcg(7);
    shake(&mut body, 0.05, &mut rng);
    let forces = verification::elastic_forces_n(&body);
    let scale = largest(&forces);
    let step = 1e-5 * body.lattice_edge_m();
    let mut worst = 0.0f64;
    for _ in 0..60 {
        let (node, axis) = ((rng.unit() * body.node_count() as f64) as usize, (rng.unit() * 3.0) as usize);
        let middle = verification::state(&body).position_m[node][axis];
        let energy = [step, -step].map(|by| {
            verification::state_mut(&mut body).position_m[node][axis] = middle + by;
            verification::evaluate(&mut body, 40);
            verification::energy(&body).elastic_j
        });
        verification::state_mut(&mut body).position_m[node][axis] = middle;
        let slope = (energy[0] - energy[1]) / (2.0 * step);
        worst = worst.max((slope + forces[node][axis]).abs() / scale);
    }
    Ok(worst)
}

/// The family.
///
/// # Errors
/// A scene of it is not valid.
pub fn family(extent: Extent) -> Result<Family> {
    let levels = extent.of(&[0, 1, 2, 3], 3);
    let mut rows = Vec::new();
    let row = |case: String, source: &str, run: &(dyn Fn(u8) -> Result<f64> + Sync)| -> Result<Row> {
        let ours = levels.par_iter().map(|level| run(*level)).collect::<Result<Vec<f64>>>()?;
        Ok(Row { case, reference: Reference::Zero, ours, source: source.into() })
    };
    for (filling, name) in Filling::ALL {
        rows.push(row(format!("patch, {name}: nodal force"), "Irons 1966; Biot stress", &|l| patch(filling, l))?);
        rows.push(row(format!("rotation, {name}: force / E h^2"), ROUNDING, &|l| Ok(rigid(filling, l)?[0]))?);
        rows.push(row(format!("rotation, {name}: energy / E V"), ROUNDING, &|l| Ok(rigid(filling, l)?[1]))?);
        rows.push(row(format!("rotation, {name}: energy at 5 % noise"), ROUNDING, &|l| invariance(filling, l))?);
        for (c, law) in [(0.0, "linear"), (3.0, "c = 3")] {
            let run = move |l| gradient(filling, l, c);
            rows.push(row(format!("force + dU/dx, {name}, {law}"), "central differences", &run)?);
        }
    }
    Ok(Family {
        title: "Elements: patch test, rotation, gradient",
        text: "Patch test: an affine map with 5 % strain and a rotation of 0.7 rad moves the nodes, and each \
               element's nodal forces have to be those of its constant Biot stress. Rotation: a body that is turned \
               by 0.3, 1.7 and 3.1 rad carries no force and no energy. A strained body that is turned keeps its \
               energy. Gradient: forces are the negative gradient of the energy. For this the nodes are moved at \
               random by 5 % of an element's edge. 60 components are drawn at random, and errors are relative to the \
               largest force. The cut body has 400 links that are cut at random. nu is 0.45 and voxels are 10 mm. The \
               rows of the rotation have strain stiffening c = 10."
            .into(),
        tables: vec![Table { columns: levels.iter().map(|l| format!("k {}", 1 << l)).collect(), rows }],
        ..Family::default()
    })
}
