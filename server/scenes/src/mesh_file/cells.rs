//! Cells, as files of finite elements have them: the boundary of those that have a volume, or else the faces that are
//! there.
//!
//! Of curved cells the corners are read and the nodes between them are not: the surface goes straight from corner to
//! corner.

use std::collections::BTreeMap;

use kerf_physics::scene::TriangleMesh;

use super::push_fan;

/// Most cells with a volume. The boundary of as many hexahedra is found in a gigabyte of memory.
const MAX_VOLUMES: usize = 1 << 22;
/// In the place of a triangle's fourth corner.
const NONE: u32 = u32::MAX;

/// The shape of a cell by its corners.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shape {
    /// Points and lines, which bound nothing.
    Thin,
    Triangle,
    Quadrilateral,
    Tetrahedron,
    Pyramid,
    Wedge,
    Hexahedron,
}

impl Shape {
    fn corners(self) -> usize {
        match self {
            Self::Thin => 0,
            Self::Triangle => 3,
            Self::Quadrilateral | Self::Tetrahedron => 4,
            Self::Pyramid => 5,
            Self::Wedge => 6,
            Self::Hexahedron => 8,
        }
    }
}

/// A cell with a volume: its corners in the order of both formats, of which a base comes first and what stands over it
/// after it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Volume {
    Tetrahedron([u32; 4]),
    Pyramid([u32; 5]),
    Wedge([u32; 6]),
    Hexahedron([u32; 8]),
}

impl Volume {
    fn corners(&self) -> &[u32] {
        match self {
            Self::Tetrahedron(corners) => corners,
            Self::Pyramid(corners) => corners,
            Self::Wedge(corners) => corners,
            Self::Hexahedron(corners) => corners,
        }
    }

    fn corners_mut(&mut self) -> &mut [u32] {
        match self {
            Self::Tetrahedron(corners) => corners,
            Self::Pyramid(corners) => corners,
            Self::Wedge(corners) => corners,
            Self::Hexahedron(corners) => corners,
        }
    }

    /// Faces by the cell's corners. They look outwards where the base goes round counter-clockwise as seen from the
    /// corners over it.
    fn faces(&self) -> &'static [&'static [usize]] {
        match self {
            Self::Tetrahedron(_) => &[&[0, 2, 1], &[0, 1, 3], &[1, 2, 3], &[2, 0, 3]],
            Self::Pyramid(_) => &[&[0, 3, 2, 1], &[0, 1, 4], &[1, 2, 4], &[2, 3, 4], &[3, 0, 4]],
            Self::Wedge(_) => &[&[0, 2, 1], &[3, 4, 5], &[0, 1, 4, 3], &[1, 2, 5, 4], &[2, 0, 3, 5]],
            Self::Hexahedron(_) => {
                &[&[0, 3, 2, 1], &[4, 5, 6, 7], &[0, 1, 5, 4], &[1, 2, 6, 5], &[2, 3, 7, 6], &[3, 0, 4, 7]]
            }
        }
    }
}

/// The cells of a file.
#[derive(Default)]
pub(super) struct Cells {
    /// Vertices, and the faces that are there as such.
    mesh: TriangleMesh,
    volumes: Vec<Volume>,
}

impl Cells {
    pub(super) fn vertices(&self) -> usize {
        self.mesh.positions.len()
    }

    pub(super) fn push_vertex(&mut self, position: [f64; 3]) -> Result<(), String> {
        if !position.iter().all(|x| x.is_finite()) {
            return Err("a coordinate is not finite".into());
        }
        self.mesh.positions.push(position);
        Ok(())
    }

    /// Adds a cell by its nodes, the corners first.
    pub(super) fn push(&mut self, shape: Shape, nodes: &[u32]) -> Result<(), String> {
        let too_few = || format!("a cell has at least {} nodes, not {}", shape.corners(), nodes.len());
        let corners = nodes.get(..shape.corners()).ok_or_else(too_few)?;
        let volume = match shape {
            Shape::Thin => return Ok(()),
            Shape::Triangle | Shape::Quadrilateral => return self.push_polygon(corners),
            Shape::Tetrahedron => corners.try_into().map(Volume::Tetrahedron),
            Shape::Pyramid => corners.try_into().map(Volume::Pyramid),
            Shape::Wedge => corners.try_into().map(Volume::Wedge),
            Shape::Hexahedron => corners.try_into().map(Volume::Hexahedron),
        };
        if self.volumes.len() >= MAX_VOLUMES {
            return Err(format!("the file has more than {MAX_VOLUMES} cells; export their surface"));
        }
        self.volumes.push(volume.map_err(|_| too_few())?);
        Ok(())
    }

    pub(super) fn push_polygon(&mut self, corners: &[u32]) -> Result<(), String> {
        push_fan(&mut self.mesh, corners)
    }

    /// Adds the triangles between each three corners of a strip that follow each other; every other one is turned.
    pub(super) fn push_strip(&mut self, corners: &[u32]) -> Result<(), String> {
        if corners.len() < 3 {
            return Err(format!("a strip has at least three corners, not {}", corners.len()));
        }
        let turned =
            |(number, [a, b, c]): (usize, &[u32; 3])| if number % 2 == 0 { [*a, *b, *c] } else { [*b, *a, *c] };
        let triangles = corners.windows(3).filter_map(<[u32]>::as_array::<3>);
        self.mesh.triangles.extend(triangles.enumerate().map(turned));
        Ok(())
    }

    /// The boundary of the cells that have a volume: faces that occur once. Without such cells the faces that are there.
    pub(super) fn surface(mut self) -> Result<TriangleMesh, String> {
        if !self.volumes.is_empty() {
            self.mesh.triangles.clear();
            self.bound()?;
        }
        if self.mesh.triangles.is_empty() {
            return Err("the file has no faces, and no cells with a volume".into());
        }
        Ok(used_alone(&self.mesh))
    }

    fn bound(&mut self) -> Result<(), String> {
        // Pieces of a grid that was written in parts have vertices of their own where they meet.
        let of_place = of_place(&self.mesh.positions);
        let corners = self.volumes.iter_mut().flat_map(Volume::corners_mut);
        corners.for_each(|corner| *corner = of_place[*corner as usize]);
        // Gmsh writes an element once for each of its physical groups, and some pieces have cells of their neighbours.
        self.volumes.sort_unstable();
        self.volumes.dedup();
        let mut faces = Vec::new();
        for volume in &self.volumes {
            let is_inside_out = six_volumes(&self.mesh.positions, volume) < 0.0;
            for face in volume.faces() {
                let corners = face.iter().map(|corner| volume.corners()[*corner]);
                faces.extend(bounding(corners, is_inside_out));
            }
        }
        let key = |face: &[u32; 4]| {
            let mut key = *face;
            key.sort_unstable();
            key
        };
        faces.sort_unstable_by_key(key);
        for same in faces.chunk_by(|one, other| key(one) == key(other)) {
            if let [face] = same {
                push_fan(&mut self.mesh, &face[..if face[3] == NONE { 3 } else { 4 }])?;
            }
        }
        if self.mesh.triangles.is_empty() {
            return Err("no face of the cells is on the outside: each occurs more than once".into());
        }
        Ok(())
    }
}

/// The first vertex at the place of each vertex.
fn of_place(positions: &[[f64; 3]]) -> Vec<u32> {
    let mut first = BTreeMap::new();
    // There are two zeros.
    let place = |position: &[f64; 3]| position.map(|x| (x + 0.0).to_bits());
    positions.iter().zip(0..).map(|(position, vertex)| *first.entry(place(position)).or_insert(vertex)).collect()
}

/// Six times the volume of a cell, by tetrahedra between one of its corners and its faces; negative where it is inside out.
fn six_volumes(positions: &[[f64; 3]], volume: &Volume) -> f64 {
    let corners = volume.corners();
    let from_first = |corner: usize| {
        let [at, first] = [corners[corner], corners[0]].map(|vertex| positions[vertex as usize]);
        std::array::from_fn::<f64, 3, _>(|axis| at[axis] - first[axis])
    };
    let fan = |face: &[usize]| {
        let [a, b, c] = [face[0], face[1], face[2]].map(from_first);
        let first = determinant(a, b, c);
        first + face.get(3).map_or(0.0, |corner| determinant(a, c, from_first(*corner)))
    };
    volume.faces().iter().map(|face| fan(face)).sum()
}

fn determinant(a: [f64; 3], b: [f64; 3], c: [f64; 3]) -> f64 {
    a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
}

/// A face whose neighbouring corners differ; `None` where fewer than three are left, as in a hexahedron that is folded to
/// a wedge.
fn bounding(corners: impl Iterator<Item = u32>, is_inside_out: bool) -> Option<[u32; 4]> {
    let mut distinct: Vec<u32> = corners.collect();
    distinct.dedup();
    if distinct.len() > 1 && distinct.first() == distinct.last() {
        distinct.pop();
    }
    if is_inside_out {
        distinct.reverse();
    }
    match distinct[..] {
        [a, b, c] => Some([a, b, c, NONE]),
        [a, b, c, d] => Some([a, b, c, d]),
        _ => None,
    }
}

/// The mesh without the vertices that no triangle has: those inside, and points that a geometry was built from, which may
/// lie outside.
fn used_alone(mesh: &TriangleMesh) -> TriangleMesh {
    let mut used = TriangleMesh::default();
    let mut renamed = vec![NONE; mesh.positions.len()];
    let mut rename = |vertex: u32| {
        let name = &mut renamed[vertex as usize];
        if *name == NONE {
            *name = used.positions.len() as u32;
            used.positions.push(mesh.positions[vertex as usize]);
        }
        *name
    };
    used.triangles = mesh.triangles.iter().map(|triangle| triangle.map(&mut rename)).collect();
    used
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// The volume that a closed mesh has inside where its faces look outwards, and the area of its faces.
    pub(in super::super) fn volume_and_area(mesh: &TriangleMesh) -> (f64, f64) {
        mesh.triangles.iter().fold((0.0, 0.0), |(volume, area), triangle| {
            let [a, b, c] = triangle.map(|vertex| mesh.positions[vertex as usize]);
            let minus = |p: [f64; 3]| std::array::from_fn::<f64, 3, _>(|axis| p[axis] - a[axis]);
            let ([p, q, r], [u, v, w]) = (minus(b), minus(c));
            let normal = [q * w - r * v, r * u - p * w, p * v - q * u];
            let length = normal.iter().map(|x| x * x).sum::<f64>().sqrt();
            (volume + determinant(a, b, c) / 6.0, area + length / 2.0)
        })
    }

    /// Unit cubes in a row, a vertex in the middle of each.
    fn row(cubes: u32) -> Cells {
        let mut cells = Cells::default();
        for x in 0..=cubes {
            for [y, z] in [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]] {
                cells.push_vertex([f64::from(x), y, z]).unwrap();
            }
        }
        (0..cubes).for_each(|x| cells.push_vertex([f64::from(x) + 0.5, 0.5, 0.5]).unwrap());
        cells
    }

    fn corners_of(cube: u32) -> [u32; 8] {
        std::array::from_fn(|corner| 4 * cube + corner as u32)
    }

    #[test]
    fn what_bounds_cells_of_all_shapes_together_looks_outwards() {
        let mut cells = row(3);
        cells.push(Shape::Hexahedron, &corners_of(0)).unwrap();
        let [a, b, c, d, e, f, g, h] = corners_of(1);
        // The second is inside out.
        cells.push(Shape::Wedge, &[a, b, e, d, c, h]).unwrap();
        cells.push(Shape::Wedge, &[c, g, h, b, f, e]).unwrap();
        let [a, b, c, d, e, f, g, h] = corners_of(2);
        for base in [[a, b, c, d], [h, g, f, e], [a, e, f, b], [b, f, g, c], [c, g, h, d]] {
            let [p, q, r, s] = base;
            cells.push(Shape::Pyramid, &[p, q, r, s, 18]).unwrap();
        }
        // The last pyramid as two tetrahedra: at the outside of the row a face may be cut in any way.
        cells.push(Shape::Tetrahedron, &[d, h, e, 18]).unwrap();
        cells.push(Shape::Tetrahedron, &[d, e, a, 18]).unwrap();
        let mesh = cells.surface().unwrap();
        let (volume, area) = volume_and_area(&mesh);
        assert!((volume - 3.0).abs() < 1e-12 && (area - 14.0).abs() < 1e-12, "{volume} {area}");
        assert_eq!(crate::mesh_faults::mesh_faults(&mesh), [""; 0]);
        // The vertices in the middle of cubes are not left.
        assert_eq!(mesh.positions.len(), 16);
    }

    #[test]
    fn cells_that_are_there_twice_count_once_and_pieces_join_where_they_meet() {
        let mut cells = row(1);
        cells.push(Shape::Hexahedron, &corners_of(0)).unwrap();
        cells.push(Shape::Hexahedron, &corners_of(0)).unwrap();
        // The second has a copy with vertices of its own, as in a piece that has cells of its neighbour.
        for _ in 0..2 {
            let first = cells.vertices() as u32;
            for x in [1.0, 2.0] {
                for [y, z] in [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [-0.0, 1.0]] {
                    cells.push_vertex([x, y, z]).unwrap();
                }
            }
            cells.push(Shape::Hexahedron, &corners_of(0).map(|corner| first + corner)).unwrap();
        }
        let (volume, area) = volume_and_area(&cells.surface().unwrap());
        assert!((volume - 2.0).abs() < 1e-12 && (area - 10.0).abs() < 1e-12, "{volume} {area}");
    }

    #[test]
    fn a_hexahedron_that_is_folded_to_a_wedge_is_bounded_as_one() {
        let mut cells = row(1);
        let [a, b, c, _, e, f, g, _] = corners_of(0);
        cells.push(Shape::Hexahedron, &[a, b, c, c, e, f, g, g]).unwrap();
        let mesh = cells.surface().unwrap();
        let (volume, area) = volume_and_area(&mesh);
        assert!((volume - 0.5).abs() < 1e-12, "{volume}");
        assert!((area - (3.0 + 2.0f64.sqrt())).abs() < 1e-12, "{area}");
        assert_eq!(mesh.triangles.len(), 8);
    }

    #[test]
    fn a_strip_keeps_to_one_side_and_faces_beside_cells_do_not_count() {
        let strip = || {
            let mut cells = row(1);
            cells.push_strip(&[0, 1, 3, 2]).unwrap();
            cells
        };
        assert_eq!(strip().surface().unwrap().triangles, [[0, 1, 2], [2, 1, 3]]);
        let mut beside = strip();
        beside.push(Shape::Hexahedron, &corners_of(0)).unwrap();
        assert_eq!(beside.surface().unwrap().triangles.len(), 12);
        assert!(row(1).surface().unwrap_err().contains("no faces"));
        assert_eq!(row(1).push_strip(&[0, 1]), Err("a strip has at least three corners, not 2".into()));
        assert_eq!(row(1).push(Shape::Wedge, &[0; 5]), Err("a cell has at least 6 nodes, not 5".into()));
    }
}
