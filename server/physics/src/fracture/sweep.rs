//! Which links a swept strip crosses, and parts.
//!
//! A link is an axis-aligned segment, so a triangle is tested in the plane across the axis: point in
//! triangle, then the crossing's place along the link. Points on an edge count as inside: adjacent
//! triangles may both find a link, which parts once, but none is missed. A triangle through a voxel's
//! centre leaves open which of two links it crosses; whoever sweeps keeps off the centres.

use super::anchor::fracture_energy;
use crate::Vec3;
use crate::body::Body;
use crate::grid::{Crossing, Grid, LinkId};

/// Parts the intact links across a quadrilateral, but for those that cannot be cut.
pub(super) fn part_quad(body: &Body, [a, b, c, d]: [Vec3; 4], links: &mut Vec<(LinkId, Crossing)>) {
    for triangle in [[a, b, c], [a, c, d]] {
        links_across(&body.state.grid, triangle, |link, crossing| {
            if body.state.grid.is_intact(link) && fracture_energy(body, link).is_finite() {
                links.push((link, crossing));
            }
        });
    }
}

/// What it takes to part links.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PartingCost {
    /// Area of the links: `h^2 |n . e|` of a link along e across a cut of normal n, m^2.
    pub area_m2: f64,
    /// Gc times that, J.
    pub fracture_j: f64,
}

impl PartingCost {
    /// Of each of `links` once; they are put in order.
    pub(super) fn of(body: &Body, links: &mut [(LinkId, Crossing)]) -> Self {
        links.sort_unstable_by_key(|l| l.0);
        let mut cost = Self::default();
        let mut seen = None;
        for (link, crossing) in links {
            if seen.replace(*link) != Some(*link) {
                let area =
                    body.state.grid.voxel_size_m().powi(2) * f64::from(crossing.normal[link.axis as usize]).abs();
                cost.area_m2 += area;
                cost.fracture_j += fracture_energy(body, *link) * area;
            }
        }
        cost
    }
}

/// Calls `visit` with each link that crosses the triangle, whatever its state.
fn links_across(grid: &Grid, triangle: [Vec3; 3], mut visit: impl FnMut(LinkId, Crossing)) {
    let normal = (triangle[1] - triangle[0]).cross(&(triangle[2] - triangle[0]));
    let Some(unit) = normal.try_normalize(0.0) else { return };
    // In voxel units, cell centres on the integers.
    let h = grid.voxel_size_m();
    let p = triangle.map(|v| (v - grid.origin_m()) / h - Vec3::repeat(0.5));
    for axis in 0..3usize {
        let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
        if unit[axis].abs() < 1e-9 {
            continue;
        }
        let range = |a: usize| {
            let low = p.iter().map(|v| v[a]).fold(f64::INFINITY, f64::min);
            let high = p.iter().map(|v| v[a]).fold(f64::NEG_INFINITY, f64::max);
            (low - 1e-9).ceil() as i32..=(high + 1e-9).floor() as i32
        };
        for j in range(b) {
            for k in range(c) {
                if !covers(&p, b, c, f64::from(j), f64::from(k)) {
                    continue;
                }
                let offset = unit[b] * (f64::from(j) - p[0][b]) + unit[c] * (f64::from(k) - p[0][c]);
                let exact = p[0][axis] - offset / unit[axis];
                // A sliver seen almost edge-on: the division must not throw the crossing off it.
                let ends = p.map(|v| v[axis]);
                let at = exact.clamp(ends[0].min(ends[1]).min(ends[2]), ends[0].max(ends[1]).max(ends[2]));
                let lower = at.floor();
                let mut cell = [0; 3];
                (cell[axis], cell[b], cell[c]) = (lower as i32, j, k);
                let toward_upper = if unit[axis] > 0.0 { unit } else { -unit };
                let crossing = Crossing {
                    t: ((at - lower) as f32).clamp(1e-3, 1.0 - 1e-3),
                    normal: [0, 1, 2].map(|i| toward_upper[i] as f32),
                };
                visit(LinkId { cell, axis: axis as u8 }, crossing);
            }
        }
    }
}

fn covers(p: &[Vec3; 3], b: usize, c: usize, x: f64, y: f64) -> bool {
    let side = |i: usize| {
        let (u, v) = (&p[i], &p[(i + 1) % 3]);
        (v[b] - u[b]) * (y - u[c]) - (v[c] - u[c]) * (x - u[b])
    };
    let s = [side(0), side(1), side(2)];
    let slack = 1e-12;
    s.iter().all(|v| *v >= -slack) || s.iter().all(|v| *v <= slack)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Voxel;

    fn cube(n: i32) -> Grid {
        let mut voxels = Vec::new();
        for k in 0..n {
            for j in 0..n {
                for i in 0..n {
                    voxels.push(Voxel { ijk: [i, j, k], material: 0 });
                }
            }
        }
        let boundary = |_| Crossing { t: 0.5, normal: [1.0, 0.0, 0.0] };
        Grid::new(0.01, Vec3::zeros(), [n; 3], voxels, |_| -1.0, boundary)
    }

    #[test]
    fn weighted_links_add_up_to_the_area_of_the_plane() {
        let grid = cube(24);
        let h = grid.voxel_size_m();
        for normal in [Vec3::x(), Vec3::new(1.0, 1.0, 0.0), Vec3::new(1.0, 1.0, 1.0), Vec3::new(0.3, -0.8, 0.5)] {
            let n = normal.normalize();
            let u = n.cross(&Vec3::new(0.12, 0.9, 0.3)).normalize() * 0.06;
            let v = n.cross(&u);
            let o = Vec3::repeat(0.1193);
            let corners = [o - u - v, o + u - v, o + u + v, o - u + v];
            let mut area = 0.0;
            let mut found = std::collections::BTreeSet::new();
            for triangle in [[corners[0], corners[1], corners[2]], [corners[0], corners[2], corners[3]]] {
                links_across(&grid, triangle, |link, _| {
                    if found.insert(link) {
                        area += h * h * n[link.axis as usize].abs();
                    }
                });
            }
            let exact = 0.12 * 0.12;
            assert!((area / exact - 1.0).abs() < 0.03, "normal {normal:?}: {area} against {exact}");
        }
    }

    #[test]
    fn a_swept_link_is_found_as_often_whatever_the_voxels_size() {
        // A wave of fixed size, swept down in steps of a fixed length by markers at half a voxel.
        let found = |n: i32| {
            let grid = cube(n);
            let h = grid.voxel_size_m();
            let (side, step) = (f64::from(n), 0.11 * 24.0 / f64::from(n));
            let at = |marker: i32, depth: f64| {
                let x = 0.5 * f64::from(marker) + 0.017;
                let depth = depth + 0.0037;
                let wave = 0.1 * side * (std::f64::consts::TAU * x / (0.6 * side)).sin();
                Vec3::new(x, side - depth, 0.4763 * side + wave) * h
            };
            let (mut visits, mut links) = (0, std::collections::BTreeSet::new());
            for row in 0..(0.9 * side / step) as i32 {
                let (above, below) = (f64::from(row) * step, f64::from(row + 1) * step);
                for marker in 2..2 * n - 2 {
                    let quad = [at(marker, above), at(marker + 1, above), at(marker + 1, below), at(marker, below)];
                    for triangle in [[quad[0], quad[1], quad[2]], [quad[0], quad[2], quad[3]]] {
                        links_across(&grid, triangle, |link, _| {
                            visits += 1;
                            links.insert(link);
                        });
                    }
                }
            }
            f64::from(visits) / links.len() as f64
        };
        let per_link = [12, 24, 48].map(found);
        assert!(per_link.iter().all(|visits| (1.0..1.02).contains(visits)), "{per_link:?}");
    }
}
