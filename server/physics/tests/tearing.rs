//! Tearing: the energy release rate at a crack that was cut beforehand, against theory.

mod support;

use kerf_physics::body::Body;
use kerf_physics::fracture::release::{Tip, released_j_per_m};
use kerf_physics::grid::{Crossing, LinkId};
use kerf_physics::scene::{Face, LoadDesc, ObjectDesc, RegionDesc, ShapeDesc};
use kerf_physics::{Vec3, Workers};
use support::{body, material, object, params};

const YOUNG_PA: f64 = 1e6;
const THICKNESS_M: f64 = 0.02;

fn bounds(min_m: [f64; 3], max_m: [f64; 3]) -> ShapeDesc {
    ShapeDesc::Box { min_m, max_m }
}

/// Parts the links across the plane y = `height_m` for x below `crack_m`.
fn crack(body: &mut Body, height_m: f64, from_m: f64, crack_m: f64) {
    let (h, [_, _, nz]) = (body.grid.voxel_size_m(), body.grid.dims());
    let j = (height_m / h).round() as i32 - 1;
    let ends = (from_m / h).round() as i32..(crack_m / h).round() as i32;
    let link = |i, k| (LinkId { cell: [i, j, k], axis: 1 }, Crossing { t: 0.5, normal: [0.0, 1.0, 0.0] });
    let links: Vec<_> = ends.flat_map(|i| (0..nz).map(move |k| link(i, k))).collect();
    let parted = body.part_links(&links).parted;
    body.update_topology(&Workers::serial(), &parted);
}

fn rate(body: &Body, crack_m: f64, height_m: f64) -> f64 {
    let tip = Tip {
        position_m: Vec3::new(crack_m, height_m, 0.5 * THICKNESS_M),
        ahead: Vec3::x(),
        along: Vec3::z(),
        element_edge_m: body.lattice_edge_m(),
    };
    let n = 1000;
    let share: f64 = (0..n)
        .map(|i| {
            let z = (f64::from(i) + 0.5) / f64::from(n) * THICKNESS_M;
            tip.share_along(&(Vec3::new(crack_m, height_m, z) - tip.position_m)) * THICKNESS_M / f64::from(n)
        })
        .sum();
    released_j_per_m(body, &tip) / share
}

fn strip(h: f64, level: u8) -> f64 {
    let (height, length, grip) = (0.04, 0.32, 0.02);
    let mut desc: ObjectDesc = object([0.0; 3], [length, 2.0 * grip + height, THICKNESS_M], h, level);
    desc.material.poisson_ratio = 0.0;
    desc.fixed = vec![bounds([-1.0; 3], [1.0, grip, 1.0])];
    let stiff = kerf_physics::scene::MaterialDesc { young_modulus_pa: 1e4 * YOUNG_PA, ..desc.material.clone() };
    desc.regions =
        vec![RegionDesc { name: "grip".into(), shape: bounds([-1.0, grip + height, -1.0], [1.0; 3]), material: stiff }];
    let traction_pa = [0.0, 1e-3 * YOUNG_PA, 0.0];
    let crack_m = 0.08;
    let region = bounds([crack_m, -1.0, -1.0], [length - crack_m, 1.0, 1.0]);
    desc.loads = vec![LoadDesc::Traction { region, face: Face::MaxY, traction_pa }];
    let mut body = body(&desc, kerf_physics::params::StepParams { max_iterations: 2000, ..params(1e-2) });
    crack(&mut body, grip + 0.5 * height, 0.0, crack_m);
    crack(&mut body, grip + 0.5 * height, length - crack_m, length);
    let end = body.relax(&Workers::serial(), &mut |_| ());
    eprintln!("{end:?}");
    let top = body.node_count();
    let _ = top;
    let at = kerf_physics::body::MaterialPoint {
        position_m: Vec3::new(0.16, grip + height, 0.01),
        voxel: body.grid.voxel_at(body.grid.cell_of(&Vec3::new(0.16, grip + height - 0.5 * h, 0.01))).unwrap(),
    };
    let stretch = (body.current_m(&at) - at.position_m).y / height;
    rate(&body, crack_m, grip + 0.5 * height) / (0.5 * YOUNG_PA * stretch * stretch * height)
}

fn cantilever(h: f64, level: u8, arm: f64) -> f64 {
    let (crack_m, length) = (0.1, 0.22);
    let mut desc = object([0.0; 3], [length, 2.0 * arm, THICKNESS_M], h, level);
    desc.material = material();
    desc.material.poisson_ratio = 0.0;
    desc.fixed = vec![bounds([length - 0.02, -1.0, -1.0], [1.0; 3])];
    let traction = 1e-6 * YOUNG_PA;
    let pull = |from: f64, to: f64, sign: f64| LoadDesc::Traction {
        region: bounds([-1.0, from, -1.0], [1.0, to, 1.0]),
        face: Face::MinX,
        traction_pa: [0.0, sign * traction, 0.0],
    };
    desc.loads = vec![pull(-1.0, arm, -1.0), pull(arm, 1.0, 1.0)];
    let mut body = body(&desc, kerf_physics::params::StepParams { max_iterations: 2000, ..params(1e-2) });
    crack(&mut body, arm, 0.0, crack_m);
    let end = body.relax(&Workers::serial(), &mut |_| ());
    eprintln!("{end:?}");
    let force = traction * arm * THICKNESS_M;
    let theory =
        12.0 * force * force * (crack_m + 0.6728 * arm).powi(2) / (YOUNG_PA * THICKNESS_M.powi(2) * arm.powi(3));
    rate(&body, crack_m, arm) / theory
}

#[test]
fn probe() {
    for (h, level) in [(5e-3, 0), (2.5e-3, 2)] {
        eprintln!("strip h {h} level {level}: {:.4}", strip(h, level));
        eprintln!("dcb h {h} level {level}: {:.4}", cantilever(h, level, 0.02));
        eprintln!(
            "dcb inside h {h} level {level}: {:.4}",
            cantilever(h, level, 0.02 + 0.5 * h * f64::from(1 << level))
        );
    }
}
