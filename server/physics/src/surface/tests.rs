//! Properties of the surface of whole grids.

use std::collections::{BTreeMap, BTreeSet};

use proptest::prelude::*;

use super::test_solids::{
    Plane, arbitrary_crossing, arbitrary_solid, box_solid, cells, cut, inner_links, sphere_solid,
};
use super::*;
use crate::Vec3;
use crate::grid::Crossing;

fn position_m(surface: &Surface, id: VertexId) -> Vec3 {
    let vertex = surface.vertex(id).expect("a quad's vertices exist");
    Vec3::from(vertex.position_m.map(f64::from))
}

fn triangles(surface: &Surface) -> Vec<[VertexId; 3]> {
    surface.quads().flat_map(|(_, quad)| triangulate(*quad)).collect()
}

/// Asserts that every directed edge is cancelled by its opposite, as often as it occurs.
fn assert_closed(polygons: impl Iterator<Item = Vec<VertexId>>) {
    let mut balance = BTreeMap::new();
    for polygon in polygons {
        for (from, to) in polygon.iter().zip(polygon.iter().cycle().skip(1)) {
            assert_ne!(from, to, "an edge has two ends");
            *balance.entry((from.min(to).to_owned(), from.max(to).to_owned())).or_insert(0) +=
                if from < to { 1 } else { -1 };
        }
    }
    let open: Vec<_> = balance.iter().filter(|(_, count)| **count != 0).collect();
    assert!(open.is_empty(), "{} open edges, the first {:?}", open.len(), open[0]);
}

/// Enclosed volume and area of each connected piece, by volume.
fn pieces(surface: &Surface) -> Vec<(f64, f64)> {
    let mut parent: BTreeMap<VertexId, VertexId> = surface.vertices().map(|(id, _)| (id, id)).collect();
    fn root(parent: &BTreeMap<VertexId, VertexId>, mut id: VertexId) -> VertexId {
        while parent[&id] != id {
            id = parent[&id];
        }
        id
    }
    for (_, quad) in surface.quads() {
        for id in quad {
            let (a, b) = (root(&parent, quad[0]), root(&parent, *id));
            parent.insert(a.max(b), a.min(b));
        }
    }
    let mut measures: BTreeMap<VertexId, (f64, f64)> = BTreeMap::new();
    for [a, b, c] in triangles(surface) {
        let (volume_m3, area_m2) = measures.entry(root(&parent, a)).or_default();
        let [a, b, c] = [a, b, c].map(|id| position_m(surface, id));
        *volume_m3 += a.dot(&b.cross(&c)) / 6.0;
        *area_m2 += (b - a).cross(&(c - a)).norm() / 2.0;
    }
    let mut pieces: Vec<_> = measures.into_values().collect();
    pieces.sort_by(|a, b| a.0.total_cmp(&b.0));
    pieces
}

fn assert_near(what: &str, value: f64, expected: f64, relative: f64) {
    assert!((value / expected - 1.0).abs() < relative, "{what}: {value}, expected {expected}");
}

/// Asserts that vertices are in their dual cells, those of rims and beside them less than a cell away.
fn assert_near_dual_cells(grid: &Grid, surface: &Surface) {
    for (id, vertex) in surface.vertices() {
        let cell_links = surface.lattice.links_of(id / 8);
        let has = |kind: fn(&Link) -> bool| cell_links.iter().any(|link| kind(&grid.link(surface.lattice.link(*link))));
        let at_rim = has(|link| matches!(link, Link::Boundary(_))) && has(|link| matches!(link, Link::Parted(_)));
        let half_diagonal_m =
            grid.voxel_size_m() * 0.75f64.sqrt() * if at_rim || surface.movers.contains_key(&id) { 2.5 } else { 1.0 };
        let centre_m = grid.centre_m(surface.lattice.cell(id / 8)) + Vec3::repeat(grid.voxel_size_m() / 2.0);
        let distance_m = (Vec3::from(vertex.position_m.map(f64::from)) - centre_m).norm();
        assert!(distance_m <= half_diagonal_m * (1.0 + 1e-5), "{id}: {} h", distance_m / grid.voxel_size_m());
    }
}

#[test]
fn a_box_is_reproduced_with_its_edges_and_corners() {
    let (min_m, max_m) = (Vec3::new(0.013, 0.008, 0.011), Vec3::new(0.084, 0.052, 0.067));
    let surface = Surface::build(&box_solid([10, 7, 8], 0.01, min_m, max_m));
    let [(volume_m3, area_m2)] = pieces(&surface)[..] else { panic!("a box is one piece") };
    let d = max_m - min_m;
    assert_near("volume", volume_m3, d.x * d.y * d.z, 1e-4);
    assert_near("area", area_m2, 2.0 * (d.x * d.y + d.y * d.z + d.z * d.x), 1e-4);
}

#[test]
fn a_sphere_has_nearly_its_analytic_volume_and_area() {
    let radius_m = 0.1;
    let surface = Surface::build(&sphere_solid(24, 0.01, radius_m));
    let [(volume_m3, area_m2)] = pieces(&surface)[..] else { panic!("a sphere is one piece") };
    assert_near("volume", volume_m3, 4.0 / 3.0 * std::f64::consts::PI * radius_m.powi(3), 0.01);
    assert_near("area", area_m2, 4.0 * std::f64::consts::PI * radius_m.powi(2), 0.01);
    for (id, _) in surface.vertices() {
        let off_m = (position_m(&surface, id) - Vec3::repeat(0.12)).norm() - radius_m;
        assert!(off_m.abs() < 0.05 * 0.01, "vertex {id} is {off_m} m off the sphere");
    }
}

#[test]
fn a_plane_cut_through_a_box_leaves_two_closed_pieces_of_the_geometric_volumes() {
    let (min_m, max_m) = (Vec3::repeat(0.012), Vec3::new(0.128, 0.088, 0.097));
    let d = max_m - min_m;
    let middle_m = (min_m + max_m) / 2.0;
    // A tilted plane that meets no x face parts the volume as an upright one through the same point
    // of the middle line does.
    for (normal, tolerance) in [(Vec3::x(), 1e-4), (Vec3::new(1.0, 0.4, 0.0), 3e-3), (Vec3::new(1.0, -0.3, 0.6), 3e-3)]
    {
        let mut grid = box_solid([14, 10, 11], 0.01, min_m, max_m);
        let whole_m2 = pieces(&Surface::build(&grid))[0].1;
        let point_m = middle_m + Vec3::x() * 0.0137;
        assert!(!cut(&mut grid, &Plane::through(point_m, normal), |_| true).is_empty());
        let surface = Surface::build(&grid);
        assert_closed(surface.quads().map(|(_, quad)| quad.to_vec()));
        let [(smaller_m3, _), (larger_m3, _)] = pieces(&surface)[..] else { panic!("{normal}: two pieces") };
        assert_near("smaller", smaller_m3, (d.x / 2.0 - 0.0137) * d.y * d.z, tolerance);
        assert_near("larger", larger_m3, (d.x / 2.0 + 0.0137) * d.y * d.z, tolerance);
        let cut_m2 = pieces(&surface).iter().map(|piece| piece.1).sum::<f64>() - whole_m2;
        assert_near("new area", cut_m2, 2.0 * d.y * d.z / normal.normalize().x, 10.0 * tolerance);
    }
}

/// On so coarse a solid the surface bends by half a right angle from cell to cell, and cuts meet each other and it
/// outside the cells that both pass.
#[test]
fn cuts_through_a_coarse_sphere_hardly_change_the_enclosed_volume() {
    let (h_m, radius_m, cells) = (0.01, 0.025, 8);
    let middle_m = Vec3::repeat(0.5 * h_m * f64::from(cells));
    let volume_m3 = |grid: &Grid| pieces(&Surface::build(grid)).iter().map(|piece| piece.0).sum::<f64>();
    let whole_m3 = volume_m3(&sphere_solid(cells, h_m, radius_m));
    let mut worst = [0.0f64; 3];
    for number in 0..60 {
        let mut grid = sphere_solid(cells, h_m, radius_m);
        let mut area_m2 = 0.0;
        for of in 0..1 + number % 3 {
            let turn = f64::from(number) + 100.0 * f64::from(of);
            let normal = Vec3::new(turn.sin(), (1.7 * turn).cos(), (2.3 * turn).sin());
            let offset_m = 0.6 * radius_m * (3.1 * turn).sin();
            cut(&mut grid, &Plane::through(middle_m + normal.normalize() * offset_m, normal), |_| true);
            area_m2 += std::f64::consts::PI * (radius_m * radius_m - offset_m * offset_m);
        }
        let worst = &mut worst[number as usize % 3];
        *worst = worst.max((volume_m3(&grid) - whole_m3).abs() / (area_m2 * h_m));
    }
    println!("worst change of the volume by one, two and three cuts: {worst:.4?} A h");
    assert!(worst.iter().all(|worst| *worst < 0.02), "{worst:?} A h");
}

/// A sphere and planes through it in many directions, from its middle to a thin cap.
const SPHERE_CELLS: i32 = 20;
const SPHERE_H_M: f64 = 0.01;
const SPHERE_RADIUS_M: f64 = 0.08;

fn planes_through_the_sphere(count: i32, up_to: f64) -> impl Iterator<Item = Plane> {
    (0..count).map(f64::from).map(move |turn| {
        let normal = Vec3::new(turn.sin(), (1.7 * turn).cos(), (2.3 * turn).sin()).normalize();
        let from_middle_m = normal * up_to * SPHERE_RADIUS_M * (3.1 * turn).sin();
        Plane::through(Vec3::repeat(0.5 * SPHERE_H_M * f64::from(SPHERE_CELLS)) + from_middle_m, normal)
    })
}

/// A cut often meets the skin outside the dual cell that both pass; where its vertex cannot follow, it is a tooth.
#[test]
fn the_rim_of_a_cut_is_on_the_skin_and_but_for_teeth_on_the_blade() {
    let middle_m = Vec3::repeat(0.5 * SPHERE_H_M * f64::from(SPHERE_CELLS));
    let (mut off_cut, mut off_skin) = (Vec::new(), Vec::new());
    for plane in planes_through_the_sphere(20, 0.5) {
        let mut grid = sphere_solid(SPHERE_CELLS, SPHERE_H_M, SPHERE_RADIUS_M);
        cut(&mut grid, &plane, |_| true);
        let surface = Surface::build(&grid);
        let [of_cut, of_skin] = [true, false].map(|is_cut| -> BTreeSet<VertexId> {
            let is_parted = |id| matches!(grid.link(surface.link_of(id)), Link::Parted(_));
            surface.quads().filter(|(id, _)| is_parted(*id) == is_cut).flat_map(|(_, quad)| *quad).collect()
        });
        for id in of_cut.intersection(&of_skin) {
            let here_m = position_m(&surface, *id);
            off_cut.push((plane.normal.dot(&here_m) - plane.offset_m).abs() / SPHERE_H_M);
            off_skin.push(((here_m - middle_m).norm() - SPHERE_RADIUS_M).abs() / SPHERE_H_M);
        }
    }
    for (what, mut off, limits) in
        [("the plane", off_cut, [0.03, 0.1, 0.2]), ("the sphere", off_skin, [0.05, 0.07, 0.12])]
    {
        off.sort_by(f64::total_cmp);
        let off_h = [0.5, 0.9, 0.99].map(|share| off[((off.len() - 1) as f64 * share) as usize]);
        println!("of {} vertices of rims 50, 90, 99 % are less off {what} than {off_h:.3?} h", off.len());
        assert!(off_h.iter().zip(limits).all(|(off_h, limit)| *off_h < limit), "off {what}");
    }
}

#[test]
fn cuts_in_any_direction_make_no_triangles_pass_through_each_other() {
    let whole = sphere_solid(SPHERE_CELLS, SPHERE_H_M, SPHERE_RADIUS_M);
    assert_eq!(Surface::build(&whole).crossing_pairs(), [[[0; 3]; 2]; 0]);
    assert_eq!(Surface::build(&whole).folded_edges(&whole), [[0; 2]; 0]);
    let (mut crossing, mut folded, mut all) = (0, 0, 0);
    for plane in planes_through_the_sphere(60, 0.8) {
        for up_to_m in [f64::INFINITY, 0.1] {
            let mut grid = whole.clone();
            cut(&mut grid, &plane, |point_m| point_m.x < up_to_m);
            let surface = Surface::build(&grid);
            crossing += surface.crossing_pairs().len();
            folded += surface.folded_edges(&grid).len();
            all += 2 * surface.quads.len();
        }
    }
    println!("{crossing} pairs of {all} triangles cross, {folded} edges of the skin fold");
    assert!(crossing == 0 && folded == 0 && all > 300_000, "{crossing} of {all}");
}

#[test]
fn cuts_that_cross_each_other_make_hardly_any_triangles_pass_through_each_other() {
    let whole = sphere_solid(SPHERE_CELLS, SPHERE_H_M, SPHERE_RADIUS_M);
    let planes: Vec<Plane> = planes_through_the_sphere(160, 0.8).collect();
    let (mut crossing, mut folded, mut all) = (0, 0, 0);
    for planes in planes.chunks(8) {
        let mut grid = whole.clone();
        planes.iter().for_each(|plane| drop(cut(&mut grid, plane, |_| true)));
        let surface = Surface::build(&grid);
        crossing += surface.crossing_pairs().len();
        folded += surface.folded_edges(&grid).len();
        all += 2 * surface.quads.len();
    }
    println!("{crossing} pairs of {all} triangles cross, {folded} edges of the skin fold");
    assert!(crossing <= 4 && all > 150_000, "{crossing} of {all}");
    assert!(folded <= 2, "{folded} edges of the skin fold");
}

#[test]
fn a_triangle_that_passes_through_another_is_found_and_one_that_touches_is_not() {
    let crossing = |moved_m: [f64; 3]| {
        let mut surface = Surface::build(&box_solid([5; 3], 1.0, Vec3::repeat(0.3), Vec3::repeat(4.6)));
        let corner = surface.vertices.iter_mut().min_by(|(_, a), (_, b)| {
            let [a, b] = [a, b].map(|vertex| vertex.position_m.iter().sum::<f32>());
            a.total_cmp(&b)
        });
        corner.unwrap().1.position_m = moved_m.map(|c| c as f32);
        surface.crossing_pairs().len()
    };
    assert_eq!(crossing([0.3; 3]), 0);
    assert_eq!(crossing([1.0; 3]), 0, "a dent");
    assert!(crossing([2.5, 2.4, 6.0]) >= 3, "the side above is pierced");
}

#[test]
fn both_sides_of_a_plane_cut_have_the_same_vertices_on_the_plane() {
    let mut grid = sphere_solid(20, 0.01, 0.08);
    let plane = Plane::through(Vec3::new(0.101, 0.098, 0.1), Vec3::new(0.3, 1.0, -0.2));
    cut(&mut grid, &plane, |_| true);
    let surface = Surface::build(&grid);
    let mut pairs = 0;
    for (_, quad) in surface.quads().filter(|(id, _)| matches!(grid.link(surface.link_of(*id)), Link::Parted(_))) {
        for id in quad {
            let centre_m = grid.centre_m(surface.lattice.cell(id / 8)) + Vec3::repeat(0.005);
            if (centre_m - Vec3::repeat(0.1)).norm() > 0.07 {
                continue; // Near the skin either side has crossings of its own.
            }
            let here_m = position_m(&surface, *id);
            assert!((plane.normal.dot(&here_m) - plane.offset_m).abs() < 1e-7, "{id} lies off the plane");
            let others = surface.vertices.range(id / 8 * 8..id / 8 * 8 + 8).filter(|(other, _)| *other != id);
            let mates: Vec<_> = others.map(|(other, _)| position_m(&surface, *other)).collect();
            assert_eq!(mates, [here_m], "{id} has one mate in the same place");
            pairs += 1;
        }
    }
    assert!(pairs > 100);
}

#[test]
fn the_two_sides_of_a_partial_cut_share_vertices_at_the_front_only() {
    let mut grid = box_solid([12, 6, 6], 0.01, Vec3::repeat(0.002), Vec3::new(0.118, 0.058, 0.058));
    let parted = cut(&mut grid, &Plane::through(Vec3::new(0.0, 0.0, 0.03), Vec3::z()), |x| x.x < 0.06);
    let surface = Surface::build(&grid);
    let on_side = |side: u32| -> BTreeSet<VertexId> {
        let quads = parted.iter().map(|link| surface.quad(surface.lattice.link_index(*link) * 2 + side));
        quads.flat_map(|quad| *quad.expect("a parted link has two quads")).collect()
    };
    let (below, above) = (on_side(0), on_side(1));
    let shared: Vec<_> = below.intersection(&above).map(|id| position_m(&surface, *id)).collect();
    // One in each dual cell along the front, 7 across the box of 6 voxels.
    assert_eq!(shared.len(), 7);
    assert!(shared.iter().all(|x| (x.x - 0.06).abs() < 1e-6 && (x.z - 0.03).abs() < 1e-6), "{shared:?}");
    assert!(below.len() > shared.len() && above.len() > shared.len());
    assert_closed(surface.quads().map(|(_, quad)| quad.to_vec()));
    assert_eq!(pieces(&surface).len(), 1);
}

#[test]
fn front_vertices_stay_in_place_when_the_front_moves_on() {
    let mut grid = box_solid([12, 6, 6], 0.01, Vec3::repeat(0.002), Vec3::new(0.118, 0.058, 0.058));
    let plane = Plane::through(Vec3::new(0.0, 0.0, 0.03), Vec3::new(0.1, 0.0, 1.0));
    let mut surface = Surface::build(&grid);
    let first = cut(&mut grid, &plane, |x| x.x < 0.06);
    surface.rebuild_touched(&grid, &first, &[]);
    let before = surface.clone();
    let next = cut(&mut grid, &plane, |x| x.x < 0.07);
    surface.rebuild_touched(&grid, &next, &[]);
    let mut split = 0;
    for (id, _) in surface.vertices().filter(|(id, _)| before.vertex(*id).is_none()) {
        let here_m = position_m(&surface, id);
        let mut old = before.vertices.range(id / 8 * 8..id);
        if let Some((old, _)) = old.next_back() {
            assert!((position_m(&before, *old) - here_m).norm() < 0.1 * 0.01, "{old} split into {id} elsewhere");
            split += 1;
        }
    }
    assert!(split >= 5);
}

#[test]
fn a_single_parted_link_gives_two_opposite_quads_on_the_same_vertices() {
    let mut grid = arbitrary_solid([4; 3], &[true; 64]);
    let link = LinkId { cell: [1, 1, 1], axis: 1 };
    let mut surface = Surface::build(&grid);
    grid.part(link, arbitrary_crossing(link));
    let change = surface.rebuild_touched(&grid, &[link], &[]);
    let [lower, upper] = change.upserted_quads[..] else { panic!("two quads") };
    let ([a, b, c, d], upper) = (*surface.quad(lower).unwrap(), *surface.quad(upper).unwrap());
    assert_eq!(upper, [c, b, a, d], "split along the same diagonal");
    assert_eq!(change.upserted_vertices.len(), 4);
}

#[test]
fn quads_face_outward_and_name_their_link() {
    let mut grid = box_solid([5; 3], 1.0, Vec3::repeat(0.3), Vec3::repeat(4.6));
    let link = LinkId { cell: [2, 2, 2], axis: 0 };
    grid.part(link, Crossing { t: 0.5, normal: [1.0, 0.0, 0.0] });
    let surface = Surface::build(&grid);
    for (id, quad) in surface.quads() {
        let link = surface.link_of(id);
        let end = if id % 2 == 0 { link.cell } else { link.upper() };
        let [a, b, c, d] = quad.map(|vertex| position_m(&surface, vertex));
        let normal = (c - a).cross(&(d - b));
        assert!(normal.dot(&(a - grid.centre_m(end))) > 0.0, "quad {id} on {link:?} faces inward");
    }
}

#[test]
fn vertices_of_rebound_voxels_are_reported_and_no_others() {
    let grid = box_solid([6; 3], 1.0, Vec3::repeat(0.3), Vec3::repeat(5.6));
    let mut surface = Surface::build(&grid);
    let voxel = grid.voxel_at([0, 0, 3]).unwrap();
    let change = surface.rebuild_touched(&grid, &[], &[voxel, voxel]);
    let bound: Vec<_> = surface.vertices().filter(|(_, v)| v.voxel == voxel).map(|(id, _)| id).collect();
    assert!(!bound.is_empty());
    assert_eq!(change, SurfaceChange { upserted_vertices: bound, ..SurfaceChange::default() });
}

#[test]
fn a_quad_is_split_along_its_shorter_diagonal_unless_only_the_other_stays_between_link_and_edges() {
    for axis in 0..3 {
        // Across the link, and along it.
        let is_split_otherwise = |corners: [[f64; 3]; 4]| {
            let placed = corners.map(|[u, v, along]| {
                let mut at = Vec3::repeat(along);
                (at[usize::from(axis + 1) % 3], at[usize::from(axis + 2) % 3]) = (u, v);
                at
            });
            super::is_split_otherwise(placed, axis)
        };
        let flat = |reach: f64| [[-reach, -0.5, 0.5], [0.5, -0.5, 0.5], [0.5, 0.5, 0.5], [-0.5, 0.5, 0.5]];
        assert!(!is_split_otherwise(flat(0.5)), "of equal ones the first");
        assert!(is_split_otherwise(flat(0.6)) && !is_split_otherwise(flat(0.4)), "the shorter");
        let sunk_in = [[-3.0, -3.0, 0.5], [0.9, -0.8, 0.5], [0.02, 0.02, 0.5], [-0.8, 0.9, 0.5]];
        let [a, b, c, d] = sunk_in;
        assert!(!is_split_otherwise(sunk_in) && is_split_otherwise([d, a, b, c]), "the other lies outside the quad");
        let bent = |along: f64| [[-0.54, 0.0, 0.0], [0.5, -0.5, 0.0], [0.0, 0.54, 0.0], [-0.3, 0.3, along]];
        assert!(!is_split_otherwise(bent(0.0)) && is_split_otherwise(bent(1.0)), "the other passes below an edge");
    }
}

const SOLID: [i32; 3] = [5, 4, 6];

/// What is done to a random solid.
#[derive(Clone, Debug)]
enum Cut {
    Links(Vec<prop::sample::Index>),
    Plane { point: [f64; 3], normal: [f64; 3], up_to_x: f64 },
}

fn any_cut() -> impl Strategy<Value = Cut> {
    let normal = prop::array::uniform3(-1.0..1.0f64).prop_filter("a direction", |n| Vec3::from(*n).norm() > 0.1);
    prop_oneof![
        prop::collection::vec(any::<prop::sample::Index>(), 1..4).prop_map(Cut::Links),
        (prop::array::uniform3(0.5..4.5f64), normal, 0.0..8.0f64).prop_map(|(point, normal, up_to_x)| Cut::Plane {
            point,
            normal,
            up_to_x
        }),
    ]
}

fn apply(cut_made: &Cut, grid: &mut Grid) -> Vec<LinkId> {
    match cut_made {
        Cut::Plane { point, normal, up_to_x } => {
            cut(grid, &Plane::through((*point).into(), (*normal).into()), |x| x.x < *up_to_x)
        }
        Cut::Links(picks) => {
            let links = inner_links(grid);
            let picked = picks.iter().filter(|_| !links.is_empty()).map(|pick| *pick.get(&links));
            picked.filter(|link| grid.part(*link, arbitrary_crossing(*link))).collect()
        }
    }
}

/// Solids from dust to nearly full.
fn any_filling() -> impl Strategy<Value = Vec<bool>> {
    let count = cells(SOLID).count();
    (0.1..1.0f64).prop_flat_map(move |share| prop::collection::vec(prop::bool::weighted(share), count))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn every_directed_edge_is_cancelled_after_any_cuts(filled in any_filling(), cuts in prop::collection::vec(any_cut(), 0..6)) {
        let mut grid = arbitrary_solid(SOLID, &filled);
        cuts.iter().for_each(|c| { apply(c, &mut grid); });
        let surface = Surface::build(&grid);
        assert_closed(surface.quads().map(|(_, quad)| quad.to_vec()));
        assert_closed(triangles(&surface).into_iter().map(|t| t.to_vec()));
        assert_near_dual_cells(&grid, &surface);
        let used: BTreeSet<_> = surface.quads().flat_map(|(_, quad)| *quad).collect();
        prop_assert!(surface.vertices().map(|(id, _)| id).eq(used), "every vertex is in a quad");
    }

    #[test]
    fn a_surface_rebuilt_cut_by_cut_equals_one_built_at_once(filled in any_filling(), cuts in prop::collection::vec(any_cut(), 1..6)) {
        let mut grid = arbitrary_solid(SOLID, &filled);
        let mut surface = Surface::build(&grid);
        for c in &cuts {
            let before = surface.clone();
            let parted = apply(c, &mut grid);
            let change = surface.rebuild_touched(&grid, &parted, &[]);
            let afresh = Surface::build(&grid);
            prop_assert_eq!(&surface, &afresh);
            let moved = |id: &VertexId| before.vertex(*id) != afresh.vertex(*id);
            prop_assert!(afresh.vertices().map(|(id, _)| id).filter(moved).eq(change.upserted_vertices));
            let rejoined = |id: &QuadId| before.quad(*id) != afresh.quad(*id);
            prop_assert!(afresh.quads().map(|(id, _)| id).filter(rejoined).eq(change.upserted_quads));
            prop_assert!(before.vertices().all(|(id, _)| afresh.vertex(id).is_some()), "vertices only appear");
            prop_assert!(before.quads().all(|(id, _)| afresh.quad(id).is_some()), "quads only appear");
        }
    }

    #[test]
    fn a_vertex_is_bound_to_the_nearest_voxel_of_its_component(filled in any_filling(), cuts in prop::collection::vec(any_cut(), 0..4)) {
        let mut grid = arbitrary_solid(SOLID, &filled);
        cuts.iter().for_each(|c| { apply(c, &mut grid); });
        let surface = Surface::build(&grid);
        for (id, vertex) in surface.vertices() {
            let components = surface.components[&(id / 8)];
            let distance = |corner: usize| {
                let cell = lattice::corner_cell(surface.lattice.cell(id / 8), corner);
                ((grid.centre_m(cell) - surface.contoured_m(id)).norm(), grid.voxel_at(cell))
            };
            let own = (0..8).filter(|corner| components.of(*corner) == id % 8).map(distance);
            let nearest = own.clone().map(|(d, _)| d).fold(f64::INFINITY, f64::min);
            let bound = own.clone().find(|(_, voxel)| *voxel == Some(vertex.voxel));
            prop_assert!(bound.is_some_and(|(d, _)| d <= nearest + 1e-6), "{id} is bound to {bound:?}, nearest {nearest}");
        }
    }
}
