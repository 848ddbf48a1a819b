//! Triangles of a surface that pass through each other or fold back, in the reference configuration.

use std::collections::BTreeMap;

use super::{Surface, VertexId, point, triangulate};
use crate::Vec3;
use crate::grid::Grid;
use crate::math::Aabb;

/// How far inside of an edge and of a triangle they meet, as a share of either: what only touches passes through nothing.
const INSIDE: f64 = 1e-3;
/// Cosine of 100 degrees.
const FOLD_COSINE: f64 = -0.17;
/// Sine of the angle below which an edge runs along a triangle.
const ALONG: f64 = 1e-6;

impl Surface {
    /// Pairs of triangles that pass through each other: an edge of one goes through the inside of the other. The two sides
    /// of a closed cut lie on each other and do not.
    #[must_use]
    pub fn crossing_pairs(&self) -> Vec<[[VertexId; 3]; 2]> {
        let placed = |ids: [VertexId; 3]| (Placed::new(ids.map(|id| point(self.vertices[&id].position_m))), ids);
        let mut by_x: Vec<_> = self.quads.values().flat_map(|quad| triangulate(*quad)).map(placed).collect();
        by_x.sort_by(|(a, _), (b, _)| a.bounds.min_m.x.total_cmp(&b.bounds.min_m.x));
        let mut pairs = Vec::new();
        for (index, (triangle, ids)) in by_x.iter().enumerate() {
            let behind =
                by_x[index + 1..].iter().take_while(|(other, _)| other.bounds.min_m.x <= triangle.bounds.max_m.x);
            pairs.extend(behind.filter(|(other, _)| triangle.crosses(other)).map(|(_, others)| [*ids, *others]));
        }
        pairs
    }

    /// Edges of the skin along which it folds back on itself: the normals of its two triangles there are more than 100
    /// degrees apart, which a model's right angles are not. Walls of cuts are no skin.
    #[must_use]
    pub fn folded_edges(&self, grid: &Grid) -> Vec<[VertexId; 2]> {
        let skin =
            self.quads.iter().filter(|(id, _)| self.is_skin(grid, **id)).flat_map(|(_, quad)| triangulate(*quad));
        let mut normals = BTreeMap::<[VertexId; 2], Vec<Vec3>>::new();
        for ids in skin {
            let normal = normal_m2(&ids.map(|id| point(self.vertices[&id].position_m)));
            for corner in 0..3 {
                let [from, to] = [ids[corner], ids[(corner + 1) % 3]];
                normals.entry([from.min(to), from.max(to)]).or_default().push(normal);
            }
        }
        let is_folded = |normals: &[Vec3]| matches!(normals, [a, b] if cosine(a, b) < FOLD_COSINE);
        normals.into_iter().filter(|(_, normals)| is_folded(normals)).map(|(edge, _)| edge).collect()
    }
}

/// Twice a triangle's area along its normal, m².
pub(super) fn normal_m2([a, b, c]: &[Vec3; 3]) -> Vec3 {
    (b - a).cross(&(c - a))
}

/// Of the angle between them; zero where one has no direction.
pub(super) fn cosine(a: &Vec3, b: &Vec3) -> f64 {
    a.dot(b) / (a.norm() * b.norm()).max(f64::MIN_POSITIVE)
}

/// A triangle in its place.
pub(super) struct Placed {
    pub(super) corners_m: [Vec3; 3],
    pub(super) bounds: Aabb,
}

impl Placed {
    pub(super) fn new(corners_m: [Vec3; 3]) -> Self {
        Self { corners_m, bounds: Aabb::around(corners_m) }
    }

    /// Whether an edge of one goes through the inside of the other.
    pub(super) fn crosses(&self, other: &Self) -> bool {
        self.bounds.meets(&other.bounds)
            && (goes_through(&self.corners_m, &other.corners_m) || goes_through(&other.corners_m, &self.corners_m))
    }
}

/// Whether an edge of one triangle goes through the inside of another. Those with a corner in common meet there.
fn goes_through(edges: &[Vec3; 3], triangle: &[Vec3; 3]) -> bool {
    if edges.iter().any(|corner| triangle.contains(corner)) {
        return false;
    }
    let [u, v] = [1, 2].map(|corner| triangle[corner] - triangle[0]);
    let normal = u.cross(&v);
    let is_inside = |share: f64| share > INSIDE && share < 1.0 - INSIDE;
    (0..3).any(|edge| {
        let (from, along) = (edges[edge], edges[(edge + 1) % 3] - edges[edge]);
        let rise = normal.dot(&along);
        if rise.abs() <= ALONG * normal.norm() * along.norm() {
            return false;
        }
        let share = normal.dot(&(triangle[0] - from)) / rise;
        let at = from + along * share - triangle[0];
        let [on_u, on_v] = [at.cross(&v), u.cross(&at)].map(|area| area.dot(&normal) / normal.norm_squared());
        is_inside(share) && [on_u, on_v, 1.0 - on_u - on_v].into_iter().all(is_inside)
    })
}
