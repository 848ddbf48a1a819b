//! Voxelization against volumes, areas and normals that are known.

use kerf_physics::scene::{ElementKind, MaterialDesc, Meshes, ObjectDesc, RegionDesc, ShapeDesc, TriangleMesh};
use kerf_physics::{Crossing, Grid, Link, LinkId, Vec3, region_voxels, voxelize};
use std::f64::consts::PI;

fn material() -> MaterialDesc {
    MaterialDesc {
        young_modulus_pa: 1e5,
        poisson_ratio: 0.4,
        density_kg_per_m3: 1000.0,
        rayleigh_alpha_per_s: 0.0,
        rayleigh_beta_s: 0.0,
        fracture_energy_j_per_m2: None,
        initiation_ratio: 2.0,
        rate: None,
        strain_stiffening: 0.0,
        viscosity: None,
        prestrain: None,
        friction_coefficient: 0.0,
        color: None,
    }
}

fn object(shape: ShapeDesc, voxel_size_m: f64) -> ObjectDesc {
    ObjectDesc {
        name: "body".into(),
        shape,
        voxel_size_m: Some(voxel_size_m),
        resolution: None,
        level: 2,
        element: ElementKind::default(),
        fracture_rule: Default::default(),
        material: material(),
        regions: vec![],
        finer: vec![],
        min_elements_across: None,
        fixed: vec![],
        loads: vec![],
    }
}

fn grid_of(shape: ShapeDesc, voxel_size_m: f64) -> Grid {
    voxelize(&object(shape, voxel_size_m), &Meshes::new()).unwrap()
}

fn sphere(radius_m: f64) -> ShapeDesc {
    ShapeDesc::Sphere { center_m: [0.3, -0.2, 0.1], radius_m }
}

fn volume_m3(grid: &Grid) -> f64 {
    grid.voxels().len() as f64 * grid.voxel_size_m().powi(3)
}

/// Every link to the outside: the link, its crossing, and +1 where its lower end is inside.
fn boundary(grid: &Grid) -> Vec<(LinkId, Crossing, f64)> {
    let links = grid.voxels().iter().flat_map(|v| Grid::links_of(v.ijk).map(|(link, other)| (v.ijk, link, other)));
    let outward = |(cell, link, other): ([i32; 3], LinkId, [i32; 3])| match grid.link(link) {
        Link::Boundary(crossing) => Some((link, crossing, if other > cell { 1.0 } else { -1.0 })),
        _ => None,
    };
    links.filter_map(outward).collect()
}

fn crossing_m(grid: &Grid, link: LinkId, crossing: &Crossing) -> Vec3 {
    let mut point = grid.centre_m(link.cell);
    point[link.axis as usize] += f64::from(crossing.t) * grid.voxel_size_m();
    point
}

fn normal(crossing: &Crossing) -> Vec3 {
    Vec3::from(crossing.normal.map(f64::from))
}

/// A sphere of triangles: rings and sectors, poles along y. `open_rings` are left out at the bottom.
fn sphere_mesh(radius: f64, rings: u32, sectors: u32, open_rings: u32) -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    for ring in 0..=rings {
        let polar = PI * f64::from(ring) / f64::from(rings);
        for sector in 0..sectors {
            let turn = 2.0 * PI * f64::from(sector) / f64::from(sectors);
            mesh.positions.push([
                radius * polar.sin() * turn.cos(),
                radius * polar.cos(),
                radius * polar.sin() * turn.sin(),
            ]);
        }
    }
    for ring in 0..rings - open_rings {
        for sector in 0..sectors {
            let at = |ring: u32, sector: u32| ring * sectors + sector % sectors;
            let [a, b, c, d] = [at(ring, sector), at(ring, sector + 1), at(ring + 1, sector + 1), at(ring + 1, sector)];
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    mesh
}

fn mesh_shape() -> ShapeDesc {
    ShapeDesc::Mesh { file: "m".into(), scale_m_per_unit: 1.0, offset_m: [0.0; 3] }
}

fn voxelize_mesh(mesh: TriangleMesh, voxel_size_m: f64) -> Result<Grid, String> {
    let meshes = Meshes::from([("m".to_owned(), mesh)]);
    voxelize(&object(mesh_shape(), voxel_size_m), &meshes).map_err(|e| e.to_string())
}

#[test]
fn a_box_of_whole_voxels_is_filled_exactly() {
    let shape = ShapeDesc::Box { min_m: [-0.0375, 0.0, 0.1], max_m: [0.0375, 0.055, 0.175] };
    let grid = grid_of(shape, 0.0025);
    assert_eq!(grid.dims(), [30, 22, 30]);
    assert_eq!(grid.voxels().len(), 30 * 22 * 30);
    for (link, crossing, outward) in boundary(&grid) {
        assert!((crossing.t - 0.5).abs() < 1e-5);
        let mut face = Vec3::zeros();
        face[link.axis as usize] = outward;
        assert_eq!(normal(&crossing), face);
    }
}

#[test]
fn resolution_counts_voxels_along_the_longest_edge() {
    let mut object = object(ShapeDesc::Box { min_m: [0.0; 3], max_m: [0.1, 0.3, 0.2] }, 0.0);
    (object.voxel_size_m, object.resolution) = (None, Some(30));
    assert_eq!(voxelize(&object, &Meshes::new()).unwrap().dims(), [10, 30, 20]);
}

#[test]
fn volumes_agree_with_the_formula_within_the_discretisation_error() {
    // Counting cell centres errs like a random walk over the surface voxels: 1 % at 20 voxels a radius
    // is an order above that.
    let cases = [
        (sphere(0.1), 4.0 / 3.0 * PI * 1e-3),
        (
            ShapeDesc::Ellipsoid { center_m: [0.0; 3], semi_axes_m: [0.15, 0.08, 0.1] },
            4.0 / 3.0 * PI * 0.15 * 0.08 * 0.1,
        ),
        (
            ShapeDesc::Capsule { from_m: [0.0; 3], to_m: [0.1, 0.2, 0.05], radius_m: 0.1 },
            PI * 0.01 * 0.0525f64.sqrt() + 4.0 / 3.0 * PI * 1e-3,
        ),
    ];
    for (shape, expected) in cases {
        let volume = volume_m3(&grid_of(shape.clone(), 0.005));
        assert!((volume / expected - 1.0).abs() < 0.01, "{shape:?}: {volume} against {expected}");
    }
}

#[test]
fn crossings_lie_on_the_sphere_with_its_normals() {
    let grid = grid_of(sphere(0.1), 0.01);
    let links = boundary(&grid);
    assert!(links.len() > 1000);
    for (link, crossing, outward) in links {
        let radial = crossing_m(&grid, link, &crossing) - Vec3::new(0.3, -0.2, 0.1);
        assert!((radial.norm() - 0.1).abs() < 1e-8, "{}", radial.norm());
        assert!((normal(&crossing) - radial.normalize()).norm() < 1e-6);
        assert!(normal(&crossing)[link.axis as usize] * outward > 0.0);
    }
}

#[test]
fn area_from_boundary_normals_is_that_of_the_sphere() {
    // Each link stands for h^2 |n . e| of area: physics of parted links uses the same weight.
    let grid = grid_of(sphere(0.1), 0.005);
    let weight =
        |(link, crossing, _): &(LinkId, Crossing, f64)| normal(crossing)[link.axis as usize].abs() * 0.005f64.powi(2);
    let area: f64 = boundary(&grid).iter().map(weight).sum();
    assert!((area / (4.0 * PI * 0.01) - 1.0).abs() < 0.01, "{area}");
}

#[test]
fn signed_distances_are_those_of_the_shape() {
    let grid = grid_of(sphere(0.1), 0.01);
    for cell in [[0, 0, 0], [10, 10, 10], [0, 19, 4], [3, 12, 9]] {
        let centre = grid.centre_m(cell);
        let expected = (centre - Vec3::new(0.3, -0.2, 0.1)).norm() - 0.1;
        assert!((grid.signed_distance_m(&centre) - expected).abs() < 1e-8, "{cell:?}");
    }
}

#[test]
fn a_link_that_leaves_twice_is_crossed_where_it_leaves_first() {
    // A plate and, a fifth of a voxel above, a sheet that no centre meets: the link ends beyond both.
    let plate = ShapeDesc::Box { min_m: [0.0; 3], max_m: [0.4, 0.4, 0.16] };
    let fin = ShapeDesc::Box { min_m: [0.0, 0.0, 0.178], max_m: [0.4, 0.4, 0.19] };
    let grid = grid_of(ShapeDesc::SmoothUnion { blend_m: 0.0, parts: vec![plate, fin], without: vec![] }, 0.1);
    let top: Vec<_> = boundary(&grid).into_iter().filter(|(link, _, up)| link.axis == 2 && *up > 0.0).collect();
    assert_eq!(top.len(), 16);
    for (link, crossing, _) in top {
        assert!((crossing_m(&grid, link, &crossing).z - 0.16).abs() < 1e-6);
        assert_eq!(normal(&crossing), Vec3::z());
    }
}

#[test]
fn the_last_of_overlapping_regions_gives_the_material() {
    let slab = |name: &str, from: f64, to: f64| RegionDesc {
        name: name.into(),
        shape: ShapeDesc::Box { min_m: [from, 0.0, 0.0], max_m: [to, 1.0, 1.0] },
        material: material(),
    };
    let mut object = object(ShapeDesc::Box { min_m: [0.0; 3], max_m: [1.0; 3] }, 0.1);
    object.regions = vec![slab("a", 0.0, 0.5), slab("b", 0.3, 0.8)];
    let grid = voxelize(&object, &Meshes::new()).unwrap();
    for voxel in grid.voxels() {
        let expected = [1, 1, 1, 2, 2, 2, 2, 2, 0, 0][voxel.ijk[0] as usize];
        assert_eq!(voxel.material, expected, "{:?}", voxel.ijk);
    }
}

#[test]
fn region_voxels_are_those_whose_centre_lies_in_the_shape() {
    let grid = grid_of(ShapeDesc::Box { min_m: [0.0; 3], max_m: [1.0; 3] }, 0.1);
    let floor = ShapeDesc::Box { min_m: [-1.0; 3], max_m: [2.0, 0.06, 2.0] };
    let held = region_voxels(&grid, &floor, &Meshes::new()).unwrap();
    assert_eq!(held.len(), 100);
    assert!(held.iter().all(|id| grid.voxels()[id.index()].ijk[1] == 0));
    assert!(held.is_sorted());
}

#[test]
fn a_mesh_of_a_sphere_is_voxelized_like_the_sphere() {
    let mesh = sphere_mesh(0.1, 96, 192, 0);
    let grid = voxelize_mesh(mesh, 0.01).unwrap();
    let exact = grid_of(ShapeDesc::Sphere { center_m: [0.0; 3], radius_m: 0.1 }, 0.01);
    assert!(grid.voxels().len().abs_diff(exact.voxels().len()) < 20);
    for (link, crossing, outward) in boundary(&grid) {
        let radial = crossing_m(&grid, link, &crossing);
        assert!((radial.norm() - 0.1).abs() < 1e-4);
        assert!(normal(&crossing).dot(&radial.normalize()) > 0.99);
        assert!(normal(&crossing)[link.axis as usize] * outward >= 0.0);
    }
    for cell in grid.voxels().iter().map(|v| v.ijk) {
        let expected_m = grid.centre_m(cell).norm() - 0.1;
        let distance_m = grid.signed_distance_m(&grid.centre_m(cell));
        let is_exact = (distance_m - expected_m).abs() < 1e-4;
        assert!(is_exact || (expected_m < -0.03 && distance_m < -0.02), "{cell:?} {distance_m} {expected_m}");
    }
}

#[test]
fn an_inward_mesh_gives_the_same_voxels_and_outward_normals() {
    let mesh = sphere_mesh(0.1, 48, 96, 0);
    let mut inward = mesh.clone();
    inward.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    let (outward, inward) = (voxelize_mesh(mesh, 0.01).unwrap(), voxelize_mesh(inward, 0.01).unwrap());
    assert_eq!(outward.voxels(), inward.voxels());
    for ((_, a, _), (_, b, _)) in boundary(&outward).iter().zip(boundary(&inward)) {
        assert!((normal(a) - normal(&b)).norm() < 1e-6);
    }
}

#[test]
fn a_mesh_is_placed_by_scale_and_offset() {
    let shape = ShapeDesc::Mesh { file: "m".into(), scale_m_per_unit: 0.01, offset_m: [1.0, 2.0, 3.0] };
    let meshes = Meshes::from([("m".to_owned(), sphere_mesh(10.0, 48, 96, 0))]);
    let grid = voxelize(&object(shape.clone(), 0.01), &meshes).unwrap();
    let centre = grid.voxels().iter().map(|v| grid.centre_m(v.ijk)).sum::<Vec3>() / grid.voxels().len() as f64;
    assert!((centre - Vec3::new(1.0, 2.0, 3.0)).norm() < 1e-4);
    assert!((volume_m3(&grid) / (4.0 / 3.0 * PI * 1e-3) - 1.0).abs() < 0.02);

    let block = grid_of(ShapeDesc::Box { min_m: [0.9, 1.9, 2.9], max_m: [1.3, 2.3, 3.3] }, 0.01);
    let held = region_voxels(&block, &shape, &meshes).unwrap();
    let expected = 4.0 / 3.0 * PI * 1e3;
    assert!((held.len() as f64 / expected - 1.0).abs() < 0.02, "{} of {expected}", held.len());
    assert!(region_voxels(&block, &shape, &Meshes::new()).unwrap_err().to_string().contains("was not read"));
}

#[test]
fn a_small_hole_is_closed_by_the_vote() {
    let closed = voxelize_mesh(sphere_mesh(0.1, 48, 96, 0), 0.005).unwrap();
    let pierced = voxelize_mesh(sphere_mesh(0.1, 48, 96, 4), 0.005).unwrap();
    let missing = closed.voxels().len().abs_diff(pierced.voxels().len());
    assert!(missing < closed.voxels().len() / 50, "{missing} of {}", closed.voxels().len());
    assert!(boundary(&pierced).iter().all(|(_, c, _)| (normal(c).norm() - 1.0).abs() < 1e-5));
}

/// Two meshes as one, the second moved.
fn both(mut mesh: TriangleMesh, second: &TriangleMesh, by_m: [f64; 3]) -> TriangleMesh {
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(second.positions.iter().map(|p| std::array::from_fn(|a| p[a] + by_m[a])));
    mesh.triangles.extend(second.triangles.iter().map(|t| t.map(|v| v + first)));
    mesh
}

fn cube_mesh(side: f64) -> TriangleMesh {
    let corner = |c: u32| [c & 1, c >> 1 & 1, c >> 2].map(|bit| side * f64::from(bit));
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    TriangleMesh {
        positions: (0..8).map(corner).collect(),
        triangles: quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect(),
        ..TriangleMesh::default()
    }
}

#[test]
fn faces_that_are_there_twice_change_nothing() {
    let sound = sphere_mesh(0.1, 48, 96, 0);
    let cells = |mesh: TriangleMesh| voxelize_mesh(mesh, 0.01).unwrap().voxels().to_vec();
    let expected = cells(sound.clone());
    // Some by their numbers, some with corners of their own and another first.
    let mut some = sound.clone();
    some.triangles.extend_from_within(..2000);
    assert_eq!(cells(some), expected);
    let mut turned = sound.clone();
    turned.triangles.iter_mut().for_each(|t| t.rotate_left(1));
    assert_eq!(cells(both(sound.clone(), &turned, [0.0; 3])), expected);
    assert_eq!(cells(both(both(sound.clone(), &sound, [0.0; 3]), &sound, [0.0; 3])), expected);
}

#[test]
fn of_several_bodies_each_is_solid_and_one_within_another_is_a_cavity() {
    let (large, small) = (sphere_mesh(0.1, 48, 96, 0), sphere_mesh(0.05, 48, 96, 0));
    let mut inward = small.clone();
    inward.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    let [alone, within] = [0.1f64, 0.05].map(|r| 4.0 / 3.0 * PI * r.powi(3));
    let cases = [
        (both(large.clone(), &small, [0.2, 0.03, 0.01]), alone + within),
        (both(large.clone(), &inward, [0.2, 0.03, 0.01]), alone + within),
        (both(large.clone(), &small, [0.0, 0.01, 0.0]), alone - within),
        (both(large.clone(), &inward, [0.0, 0.01, 0.0]), alone - within),
    ];
    for (i, (mesh, expected)) in cases.into_iter().enumerate() {
        let volume = volume_m3(&voxelize_mesh(mesh, 0.005).unwrap());
        assert!((volume / expected - 1.0).abs() < 0.02, "case {i}: {volume} against {expected}");
    }
    // Two cubes that share a wall, each with its own.
    let cubes = both(cube_mesh(0.1), &cube_mesh(0.1), [0.1, 0.0, 0.0]);
    assert_eq!(voxelize_mesh(cubes, 0.01).unwrap().dims(), [20, 10, 10]);
}

#[test]
fn bodies_that_overlap_are_refused() {
    let sphere = sphere_mesh(0.1, 48, 96, 0);
    let refused = voxelize_mesh(both(sphere.clone(), &sphere, [0.12, 0.0, 0.0]), 0.01).map(|_| ()).unwrap_err();
    assert!(refused.starts_with("shape") && refused.contains("overlap"), "{refused}");
}

#[test]
fn meshes_without_an_inside_are_refused_with_the_reason() {
    let refused = |mesh: TriangleMesh| voxelize_mesh(mesh, 0.01).map(|grid| grid.dims()).unwrap_err();
    assert!(refused(TriangleMesh::default()).contains("no triangles"));
    assert!(refused(sphere_mesh(0.1, 48, 96, 24)).contains("open to"), "a bowl");

    let mut wavy = TriangleMesh::default();
    for i in 0..11u32 {
        for j in 0..11u32 {
            let (x, z) = (f64::from(i) / 100.0, f64::from(j) / 100.0);
            wavy.positions.push([x, 0.02 * (60.0 * x).sin(), z]);
            if i < 10 && j < 10 {
                let at = |i: u32, j: u32| i * 11 + j;
                wavy.triangles
                    .extend([[at(i, j), at(i, j + 1), at(i + 1, j)], [at(i + 1, j + 1), at(i + 1, j), at(i, j + 1)]]);
            }
        }
    }
    assert!(refused(wavy.clone()).contains("no inside"), "a wavy sheet");
    wavy.positions.iter_mut().for_each(|p| p[1] = 0.0);
    assert!(refused(wavy.clone()).contains("flat"), "a plane sheet");
    wavy.positions[0][0] = f64::NAN;
    assert!(refused(wavy.clone()).contains("not finite"));
    wavy.triangles.push([0, 1, 999]);
    assert!(refused(wavy).contains("beyond the mesh"));

    // The centre of its box, where the only voxel's centre is, lies outside a corner of a cube.
    let corner = TriangleMesh {
        positions: vec![[0.0; 3], [0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.01]],
        triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
        ..TriangleMesh::default()
    };
    let message = refused(corner);
    assert!(message.contains("thinner than a voxel"), "{message}");
    assert!(message.starts_with("shape"), "{message}");
}
