//! Triangle meshes as solids: what is inside, and where the lattice's links cross the surface.
//!
//! Orientation is not trusted and small holes are tolerated. Along each axis the surface is cut by
//! the lines through the cell centres (the lattice's links lie on them); a cell is inside where most
//! of its six looks along these lines (three axes, two directions) cross the surface an odd number
//! of times. A line through a hole contradicts itself and so abstains. Faces that are there twice count
//! once. Of several bodies each is solid, one within another is a cavity; bodies that overlap are refused,
//! for which of both is meant is not known.

use parry3d_f64::math::Vector;
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::TriMesh;

use super::lattice::{Bounds, Lattice};
use super::mesh_faces::{bodies, distinct};
use super::{Crossing, Ijk, LinkId};
use crate::Vec3;
use crate::scene::TriangleMesh;

/// Fraction of the lines along one axis that may contradict themselves before the mesh counts as open.
const MAX_OPEN_SHARE: f64 = 0.25;
/// Bodies of one mesh may overlap by this fraction of a voxel: those that touch do, by rounding.
const MAX_OVERLAP_VOXELS: f64 = 0.5;

/// The mesh library has its own vectors: they cross here and nowhere else.
fn to_parry(v: &Vec3) -> Vector {
    Vector::new(v.x, v.y, v.z)
}

/// Bounding box of a mesh in the scene, or why the mesh cannot be used.
pub(super) fn bounds(mesh: &TriangleMesh, scale: f64, offset_m: &Vec3) -> Result<Bounds, String> {
    let count = mesh.positions.len();
    if mesh.triangles.is_empty() {
        return Err("the mesh has no triangles".into());
    }
    if let Some(i) = mesh.triangles.iter().position(|t| t.iter().any(|v| *v as usize >= count)) {
        return Err(format!("triangle {i} names a vertex beyond the mesh's {count}"));
    }
    if let Some(i) = mesh.positions.iter().position(|p| p.iter().any(|c| !c.is_finite())) {
        return Err(format!("vertex {i} is not finite"));
    }
    let used = mesh.triangles.iter().flatten().map(|v| offset_m + Vec3::from(mesh.positions[*v as usize]) * scale);
    let bounds = Bounds::of(used).expect("the mesh has triangles");
    if bounds.extent_m().min() <= bounds.extent_m().max() * 1e-9 {
        return Err("the mesh is flat: it has no inside".into());
    }
    Ok(bounds)
}

/// A mesh placed in the scene.
pub(super) struct MeshSolid {
    triangles: Vec<[Vec3; 3]>,
    /// Body of each triangle.
    body: Vec<u32>,
    tree: TriMesh,
}

impl MeshSolid {
    pub(super) fn new(mesh: &TriangleMesh, scale: f64, offset_m: &Vec3) -> Result<Self, String> {
        bounds(mesh, scale, offset_m)?;
        let place = |p: &[f64; 3]| offset_m + Vec3::from(*p) * scale;
        let points: Vec<Vec3> = mesh.positions.iter().map(place).collect();
        let triangles = distinct(mesh.triangles.iter().map(|t| t.map(|v| points[v as usize])).collect());
        let tree = TriMesh::new(points.iter().map(to_parry).collect(), mesh.triangles.clone())
            .map_err(|e| format!("the mesh cannot be searched: {e}"))?;
        Ok(Self { body: bodies(&triangles), triangles, tree })
    }

    /// Volume of what its faces go round counter-clockwise, seen from outside, m³.
    pub(super) fn volume_m3(&self) -> f64 {
        self.triangles.iter().map(|[a, b, c]| a.dot(&b.cross(c)) / 6.0).sum()
    }

    /// Distance to the surface, m, without a sign.
    pub(super) fn distance_m(&self, position_m: &Vec3) -> f64 {
        let point = to_parry(position_m);
        (self.tree.project_local_point(point, false).point - point).length()
    }

    /// Cuts the surface by the lines through the centres of a lattice's cells.
    pub(super) fn cut_by(&self, lattice: Lattice) -> Columns {
        let axes = std::array::from_fn(|axis| AxisColumns::new(axis, &self.triangles, &lattice));
        Columns { lattice, axes }
    }

    /// Why the mesh has no one inside, if bodies of it overlap: along a line one is entered before the last
    /// that was entered is left.
    pub(super) fn refuse_overlap(&self, columns: &Columns) -> Result<(), String> {
        let most_m = MAX_OVERLAP_VOXELS * columns.lattice.voxel_size_m;
        for axis in &columns.axes {
            for bounds in axis.first.windows(2) {
                let hits = &axis.hits[bounds[0] as usize..bounds[1] as usize];
                if let Some(at_m) = self.overlap_m(hits).filter(|overlap| *overlap > most_m) {
                    let name = ["x", "y", "z"][axis.axis];
                    return Err(format!("bodies of the mesh overlap, by {at_m:.2e} m along {name}: unite them first"));
                }
            }
        }
        Ok(())
    }

    /// How far two bodies overlap along a line, m, at most; `None` where a body has a hole on the line.
    fn overlap_m(&self, hits: &[Hit]) -> Option<f64> {
        let mut entered: Vec<(u32, f64)> = Vec::new();
        let mut overlap_m = 0.0f64;
        for hit in hits {
            let body = self.body[hit.triangle as usize];
            match entered.iter().position(|(other, _)| *other == body) {
                None => entered.push((body, hit.at_m)),
                Some(place) => {
                    entered.remove(place);
                    let later = entered[place..].iter().map(|(_, from_m)| hit.at_m - from_m);
                    overlap_m = later.fold(overlap_m, f64::max);
                }
            }
        }
        entered.is_empty().then_some(overlap_m)
    }

    /// Unit normal of a triangle, either way round; `None` for one without area.
    fn normal(&self, triangle: u32) -> Option<Vec3> {
        let [a, b, c] = self.triangles[triangle as usize];
        (b - a).cross(&(c - a)).try_normalize(f64::MIN_POSITIVE)
    }
}

/// Where the surface meets one line.
#[derive(Clone, Copy, Debug)]
struct Hit {
    /// Index of the line in its [`AxisColumns`].
    column: u32,
    triangle: u32,
    /// Coordinate along the line, m.
    at_m: f64,
}

/// The lines along one axis through the centres of the cells, margin included.
struct AxisColumns {
    axis: usize,
    /// Hits by column, then position.
    hits: Vec<Hit>,
    /// First hit of each column, and the end of the last.
    first: Vec<u32>,
}

impl AxisColumns {
    fn new(axis: usize, triangles: &[[Vec3; 3]], lattice: &Lattice) -> Self {
        let mut hits = Vec::new();
        for (id, triangle) in triangles.iter().enumerate() {
            Self::rasterize(axis, id as u32, triangle, lattice, &mut hits);
        }
        hits.sort_unstable_by(|a, b| {
            a.column.cmp(&b.column).then(a.at_m.total_cmp(&b.at_m)).then(a.triangle.cmp(&b.triangle))
        });
        let columns = Self::count(axis, lattice);
        let mut first = vec![0u32; columns + 1];
        hits.iter().for_each(|hit| first[hit.column as usize + 1] += 1);
        (0..columns).for_each(|c| first[c + 1] += first[c]);
        Self { axis, hits, first }
    }

    fn count(axis: usize, lattice: &Lattice) -> usize {
        (0..3).filter(|a| *a != axis).map(|a| (lattice.dims[a] + 2) as usize).product()
    }

    fn column(axis: usize, lattice: &Lattice, cell: Ijk) -> usize {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        (cell[v] + 1) as usize * (lattice.dims[u] + 2) as usize + (cell[u] + 1) as usize
    }

    /// Adds the hits of one triangle.
    fn rasterize(axis: usize, id: u32, triangle: &[Vec3; 3], lattice: &Lattice, hits: &mut Vec<Hit>) {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let range = |a: usize| {
            let cell = |x: f64| (x - lattice.origin_m[a]) / lattice.voxel_size_m - 0.5;
            let [p, q, r] = triangle.map(|corner| cell(corner[a]));
            let last = f64::from(lattice.dims[a]);
            // One cell more on either side: the exact test below decides, not this rounding.
            let low = (p.min(q).min(r).ceil() - 1.0).clamp(-1.0, last + 1.0) as i32;
            let high = (p.max(q).max(r).floor() + 1.0).clamp(-2.0, last) as i32;
            low..=high
        };
        let mut cell = [0; 3];
        for j in range(v) {
            for i in range(u) {
                (cell[u], cell[v]) = (i, j);
                let line = [lattice.centre_on_axis_m(u, i), lattice.centre_on_axis_m(v, j)];
                if let Some(at_m) = intersect(triangle, axis, line) {
                    hits.push(Hit { column: Self::column(axis, lattice, cell) as u32, triangle: id, at_m });
                }
            }
        }
    }

    fn in_column(&self, column: usize) -> &[Hit] {
        &self.hits[self.first[column] as usize..self.first[column + 1] as usize]
    }
}

/// Where a line along `axis` through `line` (the other two coordinates, cyclic order) meets a triangle.
///
/// The line is in the triangle's projection where a half line from it crosses an odd number of edges.
/// Each edge's test depends on the edge alone, not on the triangle, so a closed mesh is met an even
/// number of times whatever the rounding.
fn intersect(triangle: &[Vec3; 3], axis: usize, line: [f64; 2]) -> Option<f64> {
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let crosses = |a: &Vec3, b: &Vec3| {
        if (a[u] <= line[0]) == (b[u] <= line[0]) {
            return false;
        }
        let (low, high) = if a[u] < b[u] { (a, b) } else { (b, a) };
        (high[u] - low[u]) * (line[1] - low[v]) < (high[v] - low[v]) * (line[0] - low[u])
    };
    let [a, b, c] = triangle;
    if !(crosses(a, b) ^ crosses(b, c) ^ crosses(c, a)) {
        return None;
    }
    let normal = (b - a).cross(&(c - a));
    let slope = |other: usize, x: f64| normal[other] * (x - a[other]);
    let at_m = a[axis] - (slope(u, line[0]) + slope(v, line[1])) / normal[axis];
    // A triangle seen edge-on has no one answer: any within its extent will do.
    let (low, high) = (a[axis].min(b[axis]).min(c[axis]), a[axis].max(b[axis]).max(c[axis]));
    Some(if at_m.is_finite() { at_m.clamp(low, high) } else { (low + high) / 2.0 })
}

/// A mesh cut by the lines of a lattice.
pub(super) struct Columns {
    lattice: Lattice,
    axes: [AxisColumns; 3],
}

impl Columns {
    /// Whether each cell is inside, in the order of [`Lattice::slot`], or why nothing can be.
    pub(super) fn inside(&self) -> Result<Vec<bool>, String> {
        self.refuse_open()?;
        let mut votes = vec![0u8; self.lattice.len()];
        for columns in &self.axes {
            self.vote(columns, &mut votes);
        }
        Ok(votes.into_iter().map(|v| v > 3).collect())
    }

    fn refuse_open(&self) -> Result<(), String> {
        for columns in &self.axes {
            let counts = columns.first.windows(2).map(|w| w[1] - w[0]);
            let (hit, odd) = counts.fold((0, 0), |(hit, odd), n| (hit + u32::from(n > 0), odd + n % 2));
            if f64::from(odd) > MAX_OPEN_SHARE * f64::from(hit) {
                return Err(format!(
                    "the mesh has no inside: it is open to {odd} of the {hit} lines along {} that meet it",
                    ["x", "y", "z"][columns.axis],
                ));
            }
        }
        Ok(())
    }

    /// Adds to each cell the two votes of one axis.
    fn vote(&self, columns: &AxisColumns, votes: &mut [u8]) {
        let axis = columns.axis;
        for start in self.lattice.cells().filter(|cell| cell[axis] == -1) {
            let hits = columns.in_column(AxisColumns::column(axis, &self.lattice, start));
            if hits.is_empty() {
                continue;
            }
            let (mut cell, mut before) = (start, 0);
            for i in -1..=self.lattice.dims[axis] {
                cell[axis] = i;
                let centre_m = self.lattice.centre_on_axis_m(axis, i);
                before += hits[before..].iter().take_while(|hit| hit.at_m < centre_m).count();
                votes[self.lattice.slot(cell)] += (before % 2 + (hits.len() - before) % 2) as u8;
            }
        }
    }

    /// The crossing of a link with exactly one end inside: of several, the one nearest to that end.
    pub(super) fn crossing(&self, solid: &MeshSolid, link: LinkId, lower_is_inside: bool) -> Crossing {
        let axis = link.axis as usize;
        let hits = self.axes[axis].in_column(AxisColumns::column(axis, &self.lattice, link.cell));
        let start_m = self.lattice.centre_on_axis_m(axis, link.cell[axis]);
        let end_m = self.lattice.centre_on_axis_m(axis, link.upper()[axis]);
        let mut on_link = hits.iter().filter(|hit| start_m <= hit.at_m && hit.at_m < end_m);
        let hit = if lower_is_inside { on_link.next() } else { on_link.next_back() };
        let outward = if lower_is_inside { 1.0 } else { -1.0 };
        let mut normal = Vec3::zeros();
        normal[axis] = outward;
        // At a hole the vote closes the surface where there is no triangle: half-way, straight across.
        let Some(hit) = hit else { return Crossing { t: 0.5, normal: normal.cast().into() } };
        if let Some(face) = solid.normal(hit.triangle) {
            normal = if face[axis] * outward < 0.0 { -face } else { face };
        }
        let t = (hit.at_m - start_m) / (end_m - start_m);
        Crossing { t: t.clamp(0.0, 1.0) as f32, normal: normal.cast().into() }
    }
}
