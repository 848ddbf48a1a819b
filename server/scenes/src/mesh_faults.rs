//! What is wrong with a mesh that can be read, and can be used in spite of it.
//!
//! The inside of a mesh is found by counting how often lines cross it, by a vote of several. So holes are closed
//! somehow, the way round of a face does not matter, and where a surface crosses itself the inside is what an odd
//! number of crossings says. What comes of it is seldom what was meant.

use std::collections::{BTreeMap, BTreeSet};

use kerf_physics::Vec3;
use kerf_physics::scene::TriangleMesh;

/// Cells that a face may lie in; a larger one is compared with all.
const MAX_CELLS_OF_A_FACE: f64 = 512.0;
/// Edge of a cell over the mean extent of the faces.
const CELL_OVER_FACE: f64 = 2.0;
/// How far within a face, as a share of it, an edge has to go through it: faces that touch do not cross.
const WITHIN: f64 = 1e-6;

/// What is wrong, a sentence each.
#[must_use]
pub fn mesh_faults(mesh: &TriangleMesh) -> Vec<String> {
    let (places, faces) = joined(mesh);
    let mut faults = Vec::new();
    let edges = edges(&faces);
    let count = |is_wrong: fn(&[u32; 2]) -> bool| edges.values().filter(|ways| is_wrong(ways)).count();
    let open = count(|[one, other]| (one + other) % 2 == 1);
    if open > 0 {
        faults.push(format!(
            "the mesh is open: {open} of its {} edges have a face on one side only; the holes are closed by guess: \
             close them in the program that made it",
            edges.len()
        ));
    }
    let wound = count(|[one, other]| one != other && (one + other) % 2 == 0);
    if wound > 0 {
        faults.push(format!(
            "the mesh is wound inconsistently: at {wound} of its {} edges both faces go the same way round; \
             recalculate its normals in the program that made it",
            edges.len()
        ));
    }
    let crossing = crossing_faces(&places, &faces);
    if crossing > 0 {
        faults.push(format!(
            "the mesh crosses itself at {crossing} of its {} faces: what lies inside both sheets counts as outside; \
             unite its bodies in the program that made it",
            faces.len()
        ));
    }
    faults
}

/// Distinct places, and the faces between them, each once and none without three places.
fn joined(mesh: &TriangleMesh) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut ids = BTreeMap::new();
    let mut places = Vec::new();
    let place = |position: &[f64; 3]| {
        *ids.entry(position.map(|x| (x + 0.0).to_bits())).or_insert_with(|| {
            places.push(Vec3::from(*position));
            places.len() as u32 - 1
        })
    };
    let of_vertex: Vec<u32> = mesh.positions.iter().map(place).collect();
    let mut seen = BTreeSet::new();
    let faces = mesh.triangles.iter().map(|face| face.map(|vertex| of_vertex[vertex as usize]));
    let is_new = |&[a, b, c]: &[u32; 3]| {
        let first = [[a, b, c], [b, c, a], [c, a, b]].into_iter().min();
        a != b && b != c && c != a && seen.insert(first)
    };
    let faces = faces.filter(is_new).collect();
    (places, faces)
}

/// How many faces go along each edge from its lower to its higher end, and how many the other way.
fn edges(faces: &[[u32; 3]]) -> BTreeMap<[u32; 2], [u32; 2]> {
    let mut edges = BTreeMap::new();
    for [a, b, c] in faces {
        for [from, to] in [[a, b], [b, c], [c, a]] {
            let ways: &mut [u32; 2] = edges.entry([*from.min(to), *from.max(to)]).or_default();
            ways[usize::from(from > to)] += 1;
        }
    }
    edges
}

/// Faces that another one goes through. Faces with a common corner are not compared.
fn crossing_faces(places: &[Vec3], faces: &[[u32; 3]]) -> usize {
    let corners = |face: usize| faces[face].map(|place| places[place as usize]);
    let bounds: Vec<[Vec3; 2]> = (0..faces.len())
        .map(|face| {
            let [a, b, c] = corners(face);
            [a.inf(&b).inf(&c), a.sup(&b).sup(&c)]
        })
        .collect();
    let mut crossing = BTreeSet::new();
    let mut compare = |one: usize, other: usize| {
        let is_apart =
            (0..3).any(|a| bounds[one][1][a] < bounds[other][0][a] || bounds[other][1][a] < bounds[one][0][a]);
        let is_joined = faces[one].iter().any(|place| faces[other].contains(place));
        if !is_apart && !is_joined && cross(&corners(one), &corners(other)) {
            crossing.extend([one, other]);
        }
    };
    let (cells, large) = in_cells(&bounds);
    for group in cells.chunk_by(|a, b| a.0 == b.0) {
        for (i, (_, one)) in group.iter().enumerate() {
            group[i + 1..].iter().for_each(|(_, other)| compare(*one, *other));
        }
    }
    for one in large {
        (0..faces.len()).for_each(|other| compare(one, other));
    }
    crossing.len()
}

/// Each face in every cell of a lattice that its box reaches into, by cell; and the faces that reach into too many.
fn in_cells(bounds: &[[Vec3; 2]]) -> (Vec<([i64; 3], usize)>, Vec<usize>) {
    let mean_m = bounds.iter().map(|[low, high]| (high - low).max()).sum::<f64>() / bounds.len().max(1) as f64;
    let edge_m = CELL_OVER_FACE * mean_m;
    let (mut cells, mut large) = (Vec::new(), Vec::new());
    for (face, bounds) in bounds.iter().enumerate() {
        let [low, high] = bounds.map(|corner| (corner / edge_m).map(f64::floor));
        if (high - low).map(|n| n + 1.0).product() > MAX_CELLS_OF_A_FACE {
            large.push(face);
            continue;
        }
        let range = |axis: usize| low[axis] as i64..=high[axis] as i64;
        for i in range(0) {
            for j in range(1) {
                cells.extend(range(2).map(|k| ([i, j, k], face)));
            }
        }
    }
    cells.sort_unstable();
    (cells, large)
}

/// Whether an edge of one triangle goes through the other.
fn cross(one: &[Vec3; 3], other: &[Vec3; 3]) -> bool {
    let goes_through =
        |edges: &[Vec3; 3], face: &[Vec3; 3]| (0..3).any(|i| pierces(&edges[i], &edges[(i + 1) % 3], face));
    goes_through(one, other) || goes_through(other, one)
}

/// Whether a segment goes through the inside of a triangle (Möller, Trumbore, "Fast, minimum storage ray/triangle
/// intersection", 1997).
fn pierces(from: &Vec3, to: &Vec3, [a, b, c]: &[Vec3; 3]) -> bool {
    let (along, ab, ac) = (to - from, b - a, c - a);
    let normal_to_along = along.cross(&ac);
    let volume = ab.dot(&normal_to_along);
    if volume == 0.0 {
        return false;
    }
    let start = from - a;
    let turned = start.cross(&ab);
    let u = start.dot(&normal_to_along) / volume;
    let v = along.dot(&turned) / volume;
    let t = ac.dot(&turned) / volume;
    [u, v, 1.0 - u - v, t, 1.0 - t].iter().all(|share| *share > WITHIN)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cube from a corner.
    fn cube(mesh: &mut TriangleMesh, corner: [f64; 3], edge: f64) {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend((0..8).map(|c| std::array::from_fn(|a| corner[a] + edge * f64::from(c >> a & 1))));
        let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        let triangles = quads.iter().flat_map(|[a, b, c, d]: &[u32; 4]| [[*a, *b, *c], [*a, *c, *d]]);
        mesh.triangles.extend(triangles.map(|face| face.map(|vertex| first + vertex)));
    }

    fn cubes(corners: &[[f64; 3]]) -> TriangleMesh {
        let mut mesh = TriangleMesh::default();
        corners.iter().for_each(|corner| cube(&mut mesh, *corner, 1.0));
        mesh
    }

    #[test]
    fn sound_meshes_have_no_faults() {
        let mut mesh = cubes(&[[0.0; 3]]);
        assert_eq!(mesh_faults(&mesh), [""; 0]);
        mesh.triangles.iter_mut().for_each(|face| face.reverse());
        assert_eq!(mesh_faults(&mesh), [""; 0], "inside out throughout");
        assert_eq!(mesh_faults(&cubes(&[[0.0; 3], [1.0, 0.0, 0.0]])), [""; 0], "bodies that touch");
        assert_eq!(mesh_faults(&cubes(&[[0.0; 3], [0.0; 3]])), [""; 0], "faces that are there twice");
        let mut soup = cubes(&[[0.0; 3]]);
        soup.positions = soup.triangles.iter().flatten().map(|v| soup.positions[*v as usize]).collect();
        soup.triangles = (0..12).map(|face| [3 * face, 3 * face + 1, 3 * face + 2]).collect();
        assert_eq!(mesh_faults(&soup), [""; 0], "corners of its own for each face");
    }

    #[test]
    fn holes_and_turned_faces_are_counted_by_their_edges() {
        let mut open = cubes(&[[0.0; 3]]);
        open.triangles.pop();
        let [fault] = &mesh_faults(&open)[..] else { panic!("one fault") };
        assert!(fault.starts_with("the mesh is open: 3 of its 18 edges"), "{fault}");
        let mut turned = cubes(&[[0.0; 3]]);
        turned.triangles[0].reverse();
        let [fault] = &mesh_faults(&turned)[..] else { panic!("one fault") };
        assert!(fault.starts_with("the mesh is wound inconsistently: at 3 of its 18 edges"), "{fault}");
    }

    #[test]
    fn bodies_that_cross_are_found_whatever_the_size_of_their_faces() {
        let [fault] = &mesh_faults(&cubes(&[[0.0; 3], [0.3, 0.4, 0.5]]))[..] else { panic!("one fault") };
        assert!(fault.starts_with("the mesh crosses itself at ") && fault.contains(" of its 24 faces"), "{fault}");
        // Many small cubes, one of them through a face of a large one.
        let mut mesh = TriangleMesh::default();
        (0..400).for_each(|i| cube(&mut mesh, [f64::from(i % 20) * 0.02 + 0.1, 2.0, f64::from(i / 20) * 0.02], 0.01));
        cube(&mut mesh, [0.0; 3], 1.0);
        assert_eq!(mesh_faults(&mesh), [""; 0]);
        cube(&mut mesh, [0.503, 0.996, 0.301], 0.01);
        assert_eq!(mesh_faults(&mesh).len(), 1);
    }
}
