//! Bodies whose elements are smaller in some regions: hanging nodes, cuts across them, what they are for.

use super::support::cutting::*;
use super::support::{Lcg, body, object, params};
use kerf_physics::grid::levels::Level;
use kerf_physics::grid::units::VoxelUnits;
use kerf_physics::scene::{Face, FinerDesc, LoadDesc, ObjectDesc, ShapeDesc};
use kerf_physics::{Body, Crossing, LinkId, Mat3, Quat, Vec3, Workers};

const EDGE_M: f64 = 0.16;

/// A block of 16 x 16 x 16 voxels at level 2, with elements of one voxel around a corner of the cells.
fn graded_block() -> ObjectDesc {
    let mut desc = object([0.0; 3], [EDGE_M; 3], 0.01, 2);
    desc.finer =
        vec![FinerDesc { shape: ShapeDesc::Sphere { center_m: [0.08, 0.08, 0.14], radius_m: 0.03 }, level: 0 }];
    desc
}

fn relax(desc: &ObjectDesc) -> Body {
    let mut body = body(desc, params(1e-3));
    let end = body.relax(&Workers::serial(), &mut |_| {});
    assert!(end.converged, "{end:?}");
    body
}

/// Parts all links along `axis` between the voxels `at` and `at + 1` of it.
fn cut_plane(body: &mut Body, axis: u8, at: i32, keep: impl Fn([i32; 3]) -> bool) {
    let mut normal = [0.0; 3];
    normal[axis as usize] = 1.0;
    let links: Vec<_> = body
        .state
        .grid
        .voxels()
        .iter()
        .filter(|v| v.ijk[axis as usize] == at && !keep(v.ijk))
        .map(|v| (LinkId { cell: v.ijk, axis }, Crossing { t: 0.5, normal }))
        .collect();
    let parted = body.part_links(&links).parted;
    body.update_topology(&Workers::serial(), &parted);
}

fn sizes(body: &Body) -> Vec<i32> {
    let mut sizes: Vec<i32> = body.base().elements.iter().map(|e| e.size).collect();
    sizes.sort_unstable();
    sizes.dedup();
    sizes
}

#[test]
fn cells_that_touch_differ_by_a_factor_of_two_at_most() {
    let body = body(&graded_block(), params(1e-3));
    assert_eq!(sizes(&body), [1, 2, 4]);
    for a in &body.base().elements {
        for b in &body.base().elements {
            let touch = (0..3).all(|i| a.cell[i] <= b.cell[i] + b.size && b.cell[i] <= a.cell[i] + a.size);
            assert!(!touch || a.size <= 2 * b.size, "{:?} {} beside {:?} {}", a.cell, a.size, b.cell, b.size);
        }
    }
    for hanging in body.base().hanging() {
        let weights: f32 = hanging.masters.iter().map(|m| m.1).sum();
        assert_eq!(weights, 1.0);
        let at = |n: u32| body.rest_position_m(n as usize);
        let masters: Vec3 = hanging.masters.iter().map(|(n, w)| at(*n) * f64::from(*w)).sum();
        assert!((masters - at(hanging.node)).norm() < 1e-15);
        assert!(hanging.masters.iter().all(|(n, w)| *w == 0.0 || !body.base().hanging().any(|h| h.node == *n)));
    }
}

#[test]
fn affine_displacement_leaves_no_force_inside_a_graded_body() {
    for seed in 1..4 {
        let mut body = body(&graded_block(), params(1e-3));
        let mut rng = Lcg(seed);
        let links: Vec<_> = (0..600)
            .map(|_| {
                let cell = [0, 1, 2].map(|_| (rng.unit() * 16.0) as i32);
                (LinkId { cell, axis: (rng.unit() * 3.0) as u8 }, Crossing { t: 0.5, normal: [1.0, 0.0, 0.0] })
            })
            .collect();
        let parted = body.part_links(&links).parted;
        body.update_topology(&Workers::serial(), &parted);
        let shear = Mat3::new(0.02, 0.01, -0.01, 0.03, -0.015, 0.02, 0.01, -0.02, 0.025);
        let f = Mat3::identity() + shear * 1e-6;
        for node in 0..body.node_count() {
            body.state.position_m[node] = (f * body.rest_position_m(node)).into();
        }
        body.evaluate(&Workers::serial(), 30);
        let strain = (f + f.transpose()) * 0.5 - Mat3::identity();
        let elastic = body.description.materials[0].elastic;
        let stress = strain * (2.0 * elastic.mu_pa) + Mat3::identity() * (elastic.lambda_pa * strain.trace());
        let expected = body.constant_stress_forces_n(&stress);
        let scale = expected.iter().flatten().fold(0.0f64, |m, x| m.max(x.abs()));
        for (node, (g, e)) in body.elastic_forces_n().iter().zip(&expected).enumerate() {
            assert!((0..3).all(|i| (g[i] - e[i]).abs() < 2e-5 * scale), "node {node}: {g:?} against {e:?}");
        }
        // An uncut body under constant stress: nothing pulls at a node inside, hanging ones' share included.
        let uncut = super::support::body(&graded_block(), params(1e-3));
        for (node, e) in uncut.constant_stress_forces_n(&stress).iter().enumerate() {
            let x = uncut.rest_position_m(node);
            let inside = x.iter().all(|c| (1e-6..EDGE_M - 1e-6).contains(c));
            assert!(!inside || e.iter().all(|c| c.abs() < 1e-12 * scale), "node {node} inside carries {e:?}");
        }
    }
}

#[test]
fn a_graded_bar_stretches_as_a_bar() {
    let mut desc = graded_block();
    desc.material.poisson_ratio = 0.0;
    desc.fixed = vec![ShapeDesc::Box { min_m: [-1.0, -1.0, -1.0], max_m: [1.0, 1.0, 0.04] }];
    let whole = ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0; 3] };
    desc.loads = vec![LoadDesc::Traction { region: whole, face: Face::MaxZ, traction_pa: [0.0, 0.0, 1e-3 * 1e6] }];
    let body = relax(&desc);
    // Held voxels fill the lowest layer of cells: above it the stress is the traction's.
    let foot = |n: usize| body.rest_position_m(n).z <= 0.04 + 1e-9;
    for node in (0..body.node_count()).filter(|n| !foot(*n)) {
        let rest = body.rest_position_m(node);
        let got = body.state.position_m[node][2] - rest.z;
        let expected = 1e-3 * (rest.z - 0.04);
        assert!((got - expected).abs() < 2e-3 * 1e-3 * EDGE_M, "node at {rest:?}: {got} against {expected}");
    }
}

#[test]
fn a_cut_across_sizes_frees_both_sides() {
    let mut body = body(&graded_block(), params(1e-3));
    let turn = Quat::from_euler_angles(0.3, 0.2, -0.4);
    for node in 0..body.node_count() {
        body.state.position_m[node] = (turn * (1.1 * body.rest_position_m(node))).into();
    }
    body.evaluate(&Workers::serial(), 20);
    // Half of the plane first: the cut ends inside, some nodes on it no longer hang.
    let (nodes, hanging) = (body.node_count(), body.base().hanging().count());
    cut_plane(&mut body, 1, 8, |ijk| ijk[0] < 7);
    assert_eq!(body.part_count(), 1);
    assert!(body.node_count() > nodes);
    assert!(body.base().hanging().count() != hanging);
    cut_plane(&mut body, 1, 8, |_| false);
    assert_eq!(body.part_count(), 2);
    // Nothing jumped.
    for node in 0..body.node_count() {
        let expected = turn * (1.1 * body.rest_position_m(node));
        assert!((Vec3::from(body.state.position_m[node]) - expected).norm() < 1e-12);
    }
    // No element holds on to the other side, directly or through a hanging node's masters.
    let (part_of, _) = body.base().parts();
    let mut part_of_node = vec![u32::MAX; body.node_count()];
    for (element, data) in body.base().elements.iter().enumerate() {
        for node in data.nodes {
            let slot = &mut part_of_node[node as usize];
            assert!(*slot == u32::MAX || *slot == part_of[element], "node {node} joins two parts");
            *slot = part_of[element];
        }
    }
    for hanging in body.base().hanging() {
        for (master, w) in hanging.masters {
            assert!(w == 0.0 || part_of_node[master as usize] == part_of_node[hanging.node as usize]);
        }
    }
}

#[test]
fn random_cuts_leave_hanging_nodes_on_free_masters() {
    for seed in 1..6 {
        let mut body = body(&graded_block(), params(1e-3));
        let mut rng = Lcg(seed);
        for _ in 0..6 {
            let axis = (rng.unit() * 3.0) as u8;
            let at = (rng.unit() * 15.0) as i32;
            let (low, high) = (rng.unit() * 16.0, rng.unit() * 16.0);
            cut_plane(&mut body, axis, at, |ijk| (low..high).contains(&f64::from(ijk[(axis as usize + 1) % 3])));
        }
        let hanging: Vec<_> = body.base().hanging().collect();
        let hangs = |node: u32| hanging.iter().any(|h| h.node == node);
        assert!(hanging.iter().all(|h| h.masters.iter().all(|(m, w)| *w == 0.0 || !hangs(*m))), "seed {seed}");
        // Rebuilt from scratch the elements are the same: as many, with as many nodes.
        let units = VoxelUnits { grid: &body.state.grid, exponent: body.base().exponent };
        let again = Level::base(&units, body.base().sizes().clone());
        assert_eq!(again.elements.len(), body.base().elements.len(), "seed {seed}");
        assert_eq!(again.nodes.len(), body.base().nodes.len(), "seed {seed}");
        assert_eq!(again.hanging().count(), hanging.len(), "seed {seed}");
    }
}

#[test]
fn a_blade_cuts_through_regions_of_different_size_at_gc_per_width() {
    let mut desc = block(2.5e-3, 2);
    // Along half of the planned cut the elements are of one voxel.
    let shape = ShapeDesc::Box { min_m: [0.0, 0.005, -4e-3], max_m: [1.0, 1.0, 4e-3] };
    desc.finer = vec![FinerDesc { shape, level: 0 }];
    let scene = cutting_scene(desc, 0.12, 1000.0);
    let mut rig = Rig::new(&scene, Vec3::new(0.0, BLOCK_HEIGHT_M + 5e-4, 4e-4), attitude(0.0, 0.0, 0.0), 0.1);
    assert_eq!(sizes(rig.body()), [1, 2, 4]);
    rig.drive(BLOCK_HEIGHT_M + 4e-3);
    assert_eq!(pieces(rig.body(), |_| true).len(), 2);
    assert_eq!(rig.body().part_count(), 2);
    let (_, work) = rig.area_and_work_ratio(GC_J_PER_M2);
    let force = rig.mean_force_n(0.008, 0.022) / (GC_J_PER_M2 * BLOCK_SIDE_M);
    let (residual, residual_abs) = rig.residual_ratios();
    println!("F/(Gc w) {force:.3}, work/(Gc A) {work:.3}, residual {residual:+.1e} ({residual_abs:.1e})");
    assert!((force - 1.0).abs() < 0.05, "F/(Gc w) = {force}");
    assert!((work - 1.0).abs() < 0.05, "work/(Gc A) = {work}");
    assert!(residual_abs < 1e-4, "energy residual {residual} ({residual_abs}) of the tool's work");
    let iterations: Vec<u32> = rig.samples.iter().map(|s| s.solve.iterations).collect();
    println!("iterations: mean {}", iterations.iter().sum::<u32>() as f64 / iterations.len() as f64);
}
