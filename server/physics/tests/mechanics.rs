//! Elements, forces and the solve against analytic results.

use super::support::{Lcg, beam, body, object, params};
use kerf_physics::{Body, Crossing, Grid, LinkId, Mat3, Quat, Vec3, Workers};

fn shear(a: f64) -> Mat3 {
    Mat3::new(0.02, a, -0.01, 0.03, -0.015, 0.02, 0.01, -0.02, 0.025)
}

/// Deforms every node by `x = F X + t`.
fn deform(body: &mut Body, f: &Mat3, t: &Vec3) {
    for node in 0..body.node_count() {
        body.state.position_m[node] = (f * body.rest_position_m(node) + t).into();
    }
}

fn cut_random_links(body: &mut Body, count: usize, rng: &mut Lcg) {
    let dims = body.state.grid.dims();
    let mut links = Vec::new();
    for _ in 0..count {
        let cell = [0, 1, 2].map(|a| (rng.unit() * f64::from(dims[a])) as i32);
        let link = LinkId { cell, axis: (rng.unit() * 3.0) as u8 };
        links.push((link, Crossing { t: 0.5, normal: [1.0, 0.0, 0.0] }));
    }
    let parted = body.part_links(&links).parted;
    body.update_topology(&Workers::serial(), &parted);
}

#[test]
fn rigid_rotation_gives_no_force_and_no_energy() {
    for stiffening in [0.0, 10.0] {
        let mut desc = object([0.0; 3], [0.08, 0.06, 0.05], 0.01, 2);
        desc.material.strain_stiffening = stiffening;
        let mut body = body(&desc, params(1e-3));
        for angle in [0.3, 1.7, 3.1] {
            let turn = Quat::from_axis_angle(&nalgebra::Unit::new_normalize(Vec3::new(1.0, 2.0, -0.5)), angle);
            deform(&mut body, turn.to_rotation_matrix().matrix(), &Vec3::new(0.5, -1.0, 2.0));
            body.evaluate(&Workers::serial(), 30);
            let largest = body.elastic_forces_n().iter().flatten().fold(0.0f64, |m, f| m.max(f.abs()));
            assert!(largest < 1e-8, "angle {angle}: {largest} N on a body of 1 MPa");
            assert!(body.energy().elastic_j < 1e-15, "energy {}", body.energy().elastic_j);
        }
    }
}

#[test]
fn affine_displacement_leaves_no_force_inside_whatever_the_filling_and_the_cuts() {
    for (level, seed) in [(0, 1), (1, 2), (2, 3)] {
        let mut desc = object([0.0; 3], [0.09, 0.07, 0.1], 0.01, level);
        desc.shape = kerf_physics::scene::ShapeDesc::Ellipsoid {
            center_m: [0.05, 0.05, 0.05],
            semi_axes_m: [0.05, 0.044, 0.05],
        };
        let mut body = body(&desc, params(1e-3));
        cut_random_links(&mut body, 400, &mut Lcg(seed));
        // Small strain: the linear patch test. The traction of a constant stress is what an element's
        // nodes carry: f_e = -V sigma d_a, so each element is checked against that, not only the sum.
        let f = Mat3::identity() + shear(0.01) * 1e-6;
        deform(&mut body, &f, &Vec3::zeros());
        body.evaluate(&Workers::serial(), 30);
        let strain = (f + f.transpose()) * 0.5 - Mat3::identity();
        let elastic = body.description.materials[0].elastic;
        let stress = strain * (2.0 * elastic.mu_pa) + Mat3::identity() * (elastic.lambda_pa * strain.trace());
        let expected = body.constant_stress_forces_n(&stress);
        let got = body.elastic_forces_n();
        let scale = expected.iter().flatten().fold(0.0f64, |m, x| m.max(x.abs()));
        for (node, (g, e)) in got.iter().zip(&expected).enumerate() {
            for i in 0..3 {
                assert!((g[i] - e[i]).abs() < 2e-5 * scale, "level {level} node {node}: {g:?} against {e:?}");
            }
        }
    }
}

#[test]
fn force_is_the_negative_gradient_of_the_energy() {
    for stiffening in [0.0, 3.0] {
        let mut desc = object([0.0; 3], [0.04, 0.02, 0.03], 0.01, 1);
        desc.material.strain_stiffening = stiffening;
        let mut body = body(&desc, params(1e-3));
        let mut rng = Lcg(7);
        let turn = Quat::from_euler_angles(0.4, -1.1, 2.0);
        for node in 0..body.node_count() {
            let noise = Vec3::new(rng.unit(), rng.unit(), rng.unit()) * 0.006;
            body.state.position_m[node] = (turn * (body.rest_position_m(node) + noise)).into();
        }
        body.evaluate(&Workers::serial(), 60);
        super::support::assert_forces_are_the_energys_slope(&mut body);
    }
}

#[test]
fn partly_filled_cells_are_no_stiffer_than_the_full_cell() {
    use kerf_physics::fem::composite::{CompositeTables, Field, FilledVoxel};
    use kerf_physics::fem::material::Elastic;
    let tables = CompositeTables::new(2, 0.01);
    let material = Elastic::new(1e6, 0.45, 1000.0);
    let largest =
        |m: &[[f64; 24]; 24]| nalgebra::SMatrix::<f64, 24, 24>::from_fn(|r, c| m[r][c]).symmetric_eigenvalues().max();
    let all: Vec<_> = (0..64).map(|p| FilledVoxel::whole(p, material)).collect();
    let full = largest(&tables.assemble(&all, Field::IncompatibleModes).stiffness_measured);
    let mut rng = Lcg(11);
    for _ in 0..200 {
        let share = rng.unit();
        let mut some: Vec<_> = all.iter().copied().filter(|_| rng.unit() < share).collect();
        if some.is_empty() {
            some.push(all[0]);
        }
        let matrices = tables.assemble(&some, Field::IncompatibleModes);
        let eigenvalues =
            nalgebra::SMatrix::<f64, 24, 24>::from_fn(|r, c| matrices.stiffness[r][c]).symmetric_eigenvalues();
        assert!(eigenvalues.max() <= full * (1.0 + 1e-9), "{} voxels", some.len());
        assert!(eigenvalues.min() >= -1e-9 * full, "{} voxels: {}", some.len(), eigenvalues.min());
    }
}

#[test]
fn a_clamped_beam_bends_as_beam_theory_says() {
    // 0.02 x 0.02 x 0.2 m, E 2 MPa, nu 0.45, rho 1100, its own weight at a hundredth of g so that the
    // answer is linear: w = q L^4 / 8 E I + shear. One cell layer beyond the clamp holds it.
    for (level, h, tolerance) in [(1, 0.0025, 0.04), (2, 0.0025, 0.09)] {
        let (deflection, expected) = beam(level, h, 0.45);
        let error = deflection / expected - 1.0;
        println!(
            "level {level}, h {h}: tip {deflection:.4e} m, beam theory {expected:.4e} m, error {:+.1} %",
            error * 100.0
        );
        assert!(error.abs() < tolerance, "level {level}: {error}");
    }
}

#[test]
fn parting_a_block_duplicates_elements_and_separates_nodes() {
    let desc = object([0.0; 3], [0.08, 0.04, 0.04], 0.01, 2);
    let mut body = body(&desc, params(1e-3));
    assert_eq!((body.base().elements.len(), body.node_count()), (2, 12));
    let plane = |i: i32| {
        (0..16)
            .map(move |n| (LinkId { cell: [i, n % 4, n / 4], axis: 0 }, Crossing { t: 0.5, normal: [1.0, 0.0, 0.0] }))
    };
    // Inside a cell: the cell is duplicated. On the face between cells: the nodes are.
    let parted = body.part_links(&plane(1).collect::<Vec<_>>()).parted;
    body.update_topology(&Workers::serial(), &parted);
    assert_eq!((body.base().elements.len(), body.node_count(), body.part_count()), (3, 20, 2));
    let parted = body.part_links(&plane(3).collect::<Vec<_>>()).parted;
    body.update_topology(&Workers::serial(), &parted);
    assert_eq!((body.base().elements.len(), body.node_count(), body.part_count()), (3, 24, 3));
    assert_eq!(parted.len(), 16);
    let _: &Grid = &body.state.grid;
}
