//! Motion without tools: momenta, energy, and the return from violent starts.

use anyhow::{Result, ensure};
use kerf_physics::scene::{ObjectDesc, ShapeDesc};
use kerf_physics::{Body, Crossing, LinkId, Mat3, Quat, Vec3, World, verification};
use rayon::prelude::*;

use super::scenes::{Lcg, Mesh, block, material, run, scene};
use super::{Extent, Family, Reference, Row, Table};

/// The two fragments of a bar that is cut across before it flies.
fn bar(level: u8) -> Result<World> {
    let mut scene = scene(block([0.12, 0.04, 0.04], Mesh { voxel_m: 0.01, level }, material(1e6, 0.45)));
    // Momenta must not depend on how well the velocities are solved.
    scene.desc.solver.relative_tolerance = Some(1e-2);
    let mut world = World::new(&scene.judge()?)?;
    let body = verification::body_mut(&mut world, 0);
    let crossing = Crossing { t: 0.5, normal: [1.0, 0.0, 0.0] };
    let links: Vec<_> = (0..16).map(|n| (LinkId { cell: [CUT, n % 4, n / 4], axis: 0 }, crossing)).collect();
    verification::part(body, &links);
    ensure!(body.part_count() == 2, "the cut leaves {} parts", body.part_count());
    Ok(world)
}

/// The last layer of voxels of the near fragment.
const CUT: i32 = 6;

/// Whether each node belongs to the far fragment.
fn far(body: &Body) -> Vec<bool> {
    let mut far = vec![false; body.node_count()];
    let base = verification::base(body);
    for (voxel, &element) in body.grid().voxels().iter().zip(&base.owner) {
        base.elements[element as usize].nodes.iter().for_each(|n| far[*n as usize] |= voxel.ijk[0] > CUT);
    }
    far
}

/// Linear and angular momentum (about the origin) of each fragment.
fn momenta(body: &Body, far: &[bool]) -> [(Vec3, Vec3); 2] {
    let mut total = [(Vec3::zeros(), Vec3::zeros()); 2];
    for (node, p) in verification::nodal_momentum(body).iter().enumerate() {
        let (total, p) = (&mut total[usize::from(far[node])], Vec3::from(*p));
        total.0 += p;
        total.1 += Vec3::from(verification::state(body).position_m[node]).cross(&p);
    }
    total
}

/// Worst relative change of the fragments' linear and angular momentum in free tumbling, and the highest energy
/// over the first.
fn tumble(level: u8, steps: u32) -> Result<[f64; 3]> {
    let mut world = bar(level)?;
    let body = verification::body_mut(&mut world, 0);
    let far = far(body);
    for (node, far) in far.iter().enumerate() {
        let (middle, spin, drift) = if *far {
            (Vec3::new(0.095, 0.02, 0.02), Vec3::new(8.0, -21.0, 13.0), Vec3::new(0.3, 0.1, -0.2))
        } else {
            (Vec3::new(0.035, 0.02, 0.02), Vec3::new(-5.0, 2.0, 9.0), Vec3::new(-0.4, 0.0, 0.1))
        };
        verification::state_mut(body).velocity_m_per_s[node] =
            (drift + spin.cross(&(body.rest_position_m(node) - middle))).into();
    }
    verification::evaluate(body, 60);
    verification::refresh_operator(body);
    let (start, first_j) = (momenta(body, &far), verification::energy(body).total_j());
    let mut worst = [0.0f64; 3];
    for _ in 0..steps {
        run(&mut world, 1);
        let body = world.bodies()[0];
        for (now, start) in momenta(body, &far).iter().zip(&start) {
            worst[0] = worst[0].max((now.0 - start.0).norm() / start.0.norm());
            worst[1] = worst[1].max((now.1 - start.1).norm() / start.1.norm());
        }
        worst[2] = worst[2].max(verification::energy(body).total_j() / first_j);
    }
    Ok(worst)
}

/// What a body is thrown into, given a rest position.
type Start = fn(Vec3, &mut Lcg) -> Vec3;

const STARTS: [(&str, Start); 4] = [
    ("stretched by 5", |x, _| x * 5.0),
    ("collapsed to a plane", |x, _| Vec3::new(x.x, 0.0, x.z)),
    ("random nodes", |_, r| 0.04 * r.vector()),
    ("turned inside out", |x, r| Vec3::new(-x.x, x.y, x.z) + 1e-4 * r.vector()),
];

/// Energy's maximum over the first, and how far from a rigid copy of the rest shape the body ends, in voxels.
fn recover(start: Start, level: u8, strain_stiffening: f64) -> Result<[f64; 2]> {
    let mut desc: ObjectDesc = block([1.0; 3], Mesh { voxel_m: 0.005, level }, material(1e4, 0.45));
    desc.shape = ShapeDesc::Ellipsoid { center_m: [0.0; 3], semi_axes_m: [0.04, 0.03, 0.022] };
    desc.material.rayleigh_alpha_per_s = 4.0;
    desc.material.rayleigh_beta_s = 5e-3;
    desc.material.strain_stiffening = strain_stiffening;
    let mut scene = scene(desc);
    scene.desc.solver.relative_tolerance = Some(1e-3);
    let mut world = World::new(&scene.judge()?)?;
    let body = verification::body_mut(&mut world, 0);
    let mut rng = Lcg(5);
    for node in 0..body.node_count() {
        verification::state_mut(body).position_m[node] = start(body.rest_position_m(node), &mut rng).into();
    }
    verification::evaluate(body, 60);
    verification::refresh_operator(body);
    let first_j = verification::energy(body).total_j();
    let mut highest = 0.0f64;
    for step in 0..1500 {
        run(&mut world, 1);
        ensure!(world.output().fault.is_none(), "step {step}: {:?}", world.output().fault);
        highest = highest.max(verification::energy(world.bodies()[0]).total_j() / first_j);
    }
    Ok([highest, shape_error_voxels(world.bodies()[0])])
}

/// Largest distance of a node from the best rigid copy of the rest shape (Kabsch 1976), in voxels.
fn shape_error_voxels(body: &Body) -> f64 {
    let n = body.node_count() as f64;
    let rest: Vec<Vec3> = (0..body.node_count()).map(|i| body.rest_position_m(i)).collect();
    let now: Vec<Vec3> = verification::state(body).position_m.iter().map(|x| Vec3::from(*x)).collect();
    let (a, b) = (rest.iter().sum::<Vec3>() / n, now.iter().sum::<Vec3>() / n);
    let covariance = rest.iter().zip(&now).fold(Mat3::zeros(), |m, (r, x)| m + (x - b) * (r - a).transpose());
    let turn = Quat::from_matrix_eps(&covariance, 1e-12, 1000, Quat::identity());
    let error = rest.iter().zip(&now).map(|(r, x)| ((x - b) - turn * (r - a)).norm()).fold(0.0, f64::max);
    error / body.grid().voxel_size_m()
}

/// The family.
///
/// # Errors
/// A scene of it is not valid, or a step had a fault.
pub fn family(extent: Extent) -> Result<Family> {
    let (levels, steps) = match extent {
        Extent::Coarse => (vec![2], 200),
        Extent::Full => (vec![0, 1, 2], 1000),
    };
    let tumbles = levels.par_iter().map(|l| tumble(*l, steps)).collect::<Result<Vec<_>>>()?;
    let row = |case: String, reference: Reference, ours: Vec<f64>, source: &str| Row {
        case,
        reference,
        ours,
        source: source.into(),
    };
    let figure = |i: usize| tumbles.iter().map(|t| t[i]).collect::<Vec<f64>>();
    let mut rows = vec![
        row("tumbling fragments: linear momentum".into(), Reference::Zero, figure(0), "conserved"),
        row("tumbling fragments: angular momentum".into(), Reference::Zero, figure(1), "conserved"),
        row(
            "tumbling fragments: energy over the first".into(),
            Reference::AtMost(1.01),
            figure(2),
            "no input; one linearised solve may gain",
        ),
    ];
    let stiffenings = extent.of(&[0.0, 10.0], 1);
    let starts = extent.of(&STARTS, 3);
    let runs: Vec<(f64, &str, Start, u8)> = stiffenings
        .iter()
        .flat_map(|c| starts.iter().flat_map(|s| levels.iter().map(|l| (*c, s.0, s.1, *l))))
        .collect();
    let found = runs.par_iter().map(|&(c, _, start, level)| recover(start, level, c)).collect::<Result<Vec<_>>>()?;
    for (runs, found) in runs.chunks(levels.len()).zip(found.chunks(levels.len())) {
        let (c, name, ..) = runs[0];
        let of = |i: usize| found.iter().map(|f| f[i]).collect::<Vec<f64>>();
        rows.push(row(format!("{name}, c = {c}: energy over the first"), Reference::AtMost(1.05), of(0), "no input"));
        rows.push(row(
            format!("{name}, c = {c}: shape after 1.5 s, voxels off"),
            Reference::AtMost(0.05),
            of(1),
            "returns to rest",
        ));
    }
    Ok(Family {
        title: "Motion without input",
        text: format!(
            "Two fragments of a bar, cut beforehand, tumble freely for {steps} steps of 1 ms with solves to 1e-2. \
             Their momenta are relative to the first ones. An ellipsoid (E 10 kPa, nu 0.45) starts from violent \
             states: stretched by 5, collapsed to a plane, turned inside out, or with nodes at random places. Its \
             energy is measured, and after 1500 steps its distance from the best rigid copy of its rest shape. From \
             random nodes at c = 10 it has returned by then at k = 4, but not at k = 1 and 2. `cargo test -p \
             kerf-physics determinism` and `make same-bits` test that the same inputs give the same bits at 1 and 2 \
             threads."
        ),
        tables: vec![Table { columns: levels.iter().map(|l| format!("k {}", 1 << l)).collect(), rows }],
        ..Family::default()
    })
}
