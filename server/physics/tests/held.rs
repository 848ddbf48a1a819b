//! What is held, voxel by voxel, in elements of many voxels.

use super::support::{assert_forces_are_the_energys_slope, body, mean_displacement, object, scene, world_of};
use kerf_physics::scene::{Face, LoadDesc, ShapeDesc, ViscosityDesc};
use kerf_physics::verification::StepParams;
use kerf_physics::{Body, Crossing, Grid, LinkId, MaterialPoint, Vec3, VoxelId, Workers};

const H_M: f64 = 2.5e-3;
const YOUNG_PA: f64 = 2e6;

/// Half-space below a height along an axis.
fn below(axis: usize, at_m: f64) -> ShapeDesc {
    let mut max_m = [1.0; 3];
    max_m[axis] = at_m;
    ShapeDesc::Box { min_m: [-1.0; 3], max_m }
}

fn params() -> StepParams {
    StepParams { dt_s: 1e-3, relative_tolerance: 1e-3, max_iterations: 200 }
}

#[test]
fn a_bar_held_by_one_layer_of_voxels_bends_as_beam_theory_says() {
    let (length_m, side_m, poisson, traction_pa) = (0.2, 0.02f64, 0.3, 100.0);
    let inertia = side_m.powi(4) / 12.0;
    let load_n = traction_pa * side_m * side_m;
    let shear_pa = YOUNG_PA / (2.0 * (1.0 + poisson));
    // The last layer of voxels is short of the end by half a voxel.
    let at_m = length_m - 0.5 * H_M;
    let bending = load_n * at_m * at_m * (3.0 * length_m - at_m) / (6.0 * YOUNG_PA * inertia);
    let expected = bending + load_n * at_m / (5.0 / 6.0 * shear_pa * side_m * side_m);
    for (level, bound) in [(0, 0.02), (1, 0.03), (2, 0.06), (3, 0.12)] {
        let mut desc = object([0.0; 3], [length_m + H_M, side_m, side_m], H_M, level);
        desc.material.young_modulus_pa = YOUNG_PA;
        desc.material.poisson_ratio = poisson;
        desc.fixed = vec![below(0, H_M)];
        desc.loads = vec![LoadDesc::Traction {
            region: ShapeDesc::Box { min_m: [-1.0; 3], max_m: [1.0; 3] },
            face: Face::MaxX,
            traction_pa: [0.0, -traction_pa, 0.0],
        }];
        let mut scene = scene(vec![desc]);
        scene.desc.gravity_m_per_s2 = [0.0; 3];
        let mut world = world_of(&scene);
        assert!(world.relax(&Workers::serial(), &mut |_| ()).converged);
        let found = -mean_displacement(world.bodies()[0], 0, length_m).y;
        println!("level {level}: {:.4} of beam theory", found / expected);
        assert!((found / expected - 1.0).abs() < bound, "level {level}: {found} m, {expected} m expected");
    }
}

/// A block whose lowest layers are held, its nodes moved at random.
fn shaken(level: u8, layers: f64, stiffening: f64) -> Body {
    let mut desc = object([0.0; 3], [0.03, 0.035, 0.03], H_M, level);
    desc.material.young_modulus_pa = YOUNG_PA;
    desc.material.strain_stiffening = stiffening;
    desc.fixed = vec![below(1, layers * H_M)];
    let mut body = body(&desc, params());
    let mut seed = 1u32;
    let mut random = || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(seed >> 8) / f64::from(1 << 24) - 0.5
    };
    let size_m = 0.2 * H_M * f64::from(1 << level);
    for node in 0..body.node_count() {
        let noise = Vec3::new(random(), random(), random()) * size_m;
        // It leans, so that elements at the hold turn.
        let rest = body.rest_position_m(node);
        let leans = Vec3::new(0.6 * rest.y, -0.2 * rest.y, 0.0);
        body.state.position_m[node] = (rest + leans + noise).into();
    }
    body.evaluate(&Workers::serial(), 40);
    body
}

#[test]
fn forces_beside_what_is_held_are_the_energys_slope() {
    for (level, layers, stiffening) in [(0, 1.0, 0.0), (1, 1.0, 0.0), (1, 3.0, 5.0), (2, 1.0, 0.0), (2, 2.0, 5.0)] {
        assert_forces_are_the_energys_slope(&mut shaken(level, layers, stiffening));
    }
}

#[test]
fn what_is_held_stays_whatever_the_nodes_around_it_do() {
    for level in [0, 1, 2, 3] {
        let body = shaken(level, 2.0, 0.0);
        let grid = &body.state.grid;
        for (id, voxel) in (0..).zip(grid.voxels()) {
            let position_m = grid.centre_m(voxel.ijk);
            let moved = body.current_m(&MaterialPoint { position_m, voxel: VoxelId(id) }) - position_m;
            if voxel.ijk[1] < 2 {
                assert!(moved.norm() < 1e-15, "level {level}: {moved:?} at {position_m:?}");
            } else {
                assert!(moved.norm() > 1e-6, "level {level}: stands still at {position_m:?}");
            }
            // On the surface of what is held both sides agree.
            if voxel.ijk[1] == 2 {
                let foot = position_m - Vec3::y() * (0.5 * H_M);
                let moved = body.current_m(&MaterialPoint { position_m: foot, voxel: VoxelId(id) }) - foot;
                assert!(moved.norm() < 1e-15, "level {level}: {moved:?} at the foot {foot:?}");
            }
        }
    }
}

#[test]
fn what_is_cut_off_what_is_held_is_free() {
    for level in [0, 1, 2] {
        let mut body = shaken(level, 2.0, 0.0);
        let links: Vec<(LinkId, Crossing)> = (0..12)
            .flat_map(|x| (0..12).map(move |z| LinkId { cell: [x, 1, z], axis: 1 }))
            .map(|link| (link, Crossing { t: 0.5, normal: [0.0, 1.0, 0.0] }))
            .collect();
        let parted = body.part_links(&links).parted;
        assert_eq!(parted.len(), 144);
        body.update_topology(&Workers::serial(), &parted);
        assert_eq!(body.part_count(), 2, "level {level}");
        // It is as heavy as its voxels, and no longer as the element's share of them.
        let voxels = body.state.grid.voxels().iter().filter(|voxel| voxel.ijk[1] >= 2).count() as f64;
        body.state.velocity_m_per_s.fill([0.0, 1.0, 0.0]);
        let momentum: f64 = body.nodal_momentum().iter().map(|p| p[1]).sum();
        let mass = voxels * H_M.powi(3) * body.description.materials[0].elastic.density_kg_per_m3;
        // What is held keeps a thousandth of its mass at its nodes.
        assert!((momentum / mass - 1.0).abs() < 2e-3, "level {level}: {momentum} N s of {mass} kg");
        assert!(Grid::links_of([0, 2, 0]).any(|(link, _)| !body.state.grid.is_intact(link)));
    }
}

#[test]
fn a_relaxing_bar_that_is_held_carries_what_an_elastic_one_does_after_a_while() {
    let sag = |viscosity: Option<ViscosityDesc>| {
        let mut desc = object([0.0; 3], [0.06, 0.02, 0.02], H_M, 2);
        desc.material.young_modulus_pa = 1e5;
        desc.material.viscosity = viscosity;
        desc.fixed = vec![below(0, H_M)];
        let mut world = world_of(&scene(vec![desc]));
        assert!(world.relax(&Workers::serial(), &mut |_| ()).converged);
        mean_displacement(world.bodies()[0], 0, 0.055).y
    };
    let relaxing = ViscosityDesc { relaxation_time_s: 0.02, relaxing_modulus_ratio: 1.0 };
    assert!((sag(Some(relaxing)) / sag(None) - 1.0).abs() < 1e-6);
}
