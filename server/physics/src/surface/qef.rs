//! The point that fits a set of tangent planes best, within a dual cell.

use crate::{Mat3, Vec3};

/// Weight of staying near the last estimate against one unit plane, per pass. With [`PASSES`] passes
/// a direction in which the normals spread by `s2` (sum of squares) is followed by the share
/// `1 - (D / (D + s2))^PASSES`: edges and corners (`s2` near 1) to 1e-5, the faint curvature of a
/// smooth surface (0.01 and less) to a half and less. So noise in the normals cannot make spikes, and
/// there is no threshold at which the answer jumps.
const DAMPING: f64 = 0.05;
const PASSES: usize = 4;
/// A cube around the dual cell's centre, in voxels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Room {
    /// How far a vertex may be from the centre along an axis.
    reach: f64,
    /// Where a vertex is put that would be farther.
    held_at: f64,
}

/// The dual cell. On its faces themselves several vertices come to one place, and around such a link no diagonal may be
/// left that passes through nothing: 93 pairs of triangles cross in spheres cut eight times, 8 with this and 2 with all
/// vertices this near to the centre, which would make flat walls wavy.
pub(super) const CELL: Room = Room { reach: 0.5, held_at: 0.45 };
/// Where the rim of a cut may be wanted (see `rims`).
pub(super) const AROUND_CELL: Room = Room { reach: 1.0, held_at: 1.0 };

/// Sum of squared distances to tangent planes; lengths in voxels, origin in the dual cell's centre.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Qef {
    /// Sum of n n^T.
    normal_matrix: Mat3,
    /// Sum of n (n . p).
    right_side: Vec3,
    point_sum: Vec3,
    count: u32,
}

impl Qef {
    /// Adds the plane through `point`; the sign of its unit normal does not matter.
    pub(super) fn add(&mut self, point: Vec3, normal: Vec3) {
        self.normal_matrix += normal * normal.transpose();
        self.right_side += normal * normal.dot(&point);
        self.point_sum += point;
        self.count += 1;
    }

    pub(super) fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// The same planes, moved so that they pass through `point`.
    pub(super) fn through(&self, point: &Vec3) -> Self {
        Self { right_side: self.normal_matrix * point, ..*self }
    }

    /// These planes and others, which count `weight` times as much.
    pub(super) fn and(&self, others: &Self, weight: f64) -> Self {
        Self {
            normal_matrix: self.normal_matrix + others.normal_matrix * weight,
            right_side: self.right_side + others.right_side * weight,
            point_sum: self.point_sum + others.point_sum,
            count: self.count + others.count,
        }
    }

    /// Mean of the points.
    pub(super) fn mean(&self) -> Vec3 {
        self.point_sum / f64::from(self.count)
    }

    /// The minimiser in a room; where the planes leave directions open, the one nearest to `start`.
    pub(super) fn minimise(&self, start: &Vec3, room: Room) -> Vec3 {
        let mut held = [None; 3];
        loop {
            let x = self.damped_solve(start, &held);
            // Holding the worst axis and solving again keeps a vertex on the planes that allow it,
            // where cutting off each coordinate would pull it off all of them.
            let worst = (0..3).max_by(|a, b| x[*a].abs().total_cmp(&x[*b].abs())).expect("three axes");
            if x[worst].abs() <= room.reach {
                return x;
            }
            held[worst] = Some(room.held_at.copysign(x[worst]));
        }
    }

    /// Proximal-point iteration from `start`, some coordinates held.
    fn damped_solve(&self, start: &Vec3, held: &[Option<f64>; 3]) -> Vec3 {
        let mut matrix = self.normal_matrix + Mat3::identity() * DAMPING;
        let mut residual = self.right_side - self.normal_matrix * start;
        let mut held_step = Vec3::zeros();
        for axis in 0..3 {
            if let Some(coordinate) = held[axis] {
                held_step[axis] = coordinate - start[axis];
                residual -= self.normal_matrix.column(axis) * held_step[axis];
            }
        }
        for axis in (0..3).filter(|axis| held[*axis].is_some()) {
            matrix.row_mut(axis).fill(0.0);
            matrix.column_mut(axis).fill(0.0);
            matrix[(axis, axis)] = 1.0;
            residual[axis] = 0.0;
        }
        let inverse = matrix.try_inverse().expect("damped normal matrix is positive definite");
        let mut step = Vec3::zeros();
        for _ in 0..PASSES {
            step = inverse * (residual + step * DAMPING);
        }
        // Held axes exactly, so that the search for the worst axis ends.
        Vec3::from_fn(|axis, _| held[axis].unwrap_or(start[axis] + step[axis]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fit(planes: &[([f64; 3], [f64; 3])]) -> Vec3 {
        let mut qef = Qef::default();
        planes.iter().for_each(|(p, n)| qef.add(Vec3::from(*p), Vec3::from(*n).normalize()));
        qef.minimise(&qef.mean(), CELL)
    }

    #[test]
    fn coplanar_crossings_give_their_mean() {
        let x = fit(&[([0.1, 0.5, 0.5], [1.0, 0.0, 0.0]), ([0.1, -0.5, 0.5], [-1.0, 0.0, 0.0])]);
        assert!((x - Vec3::new(0.1, 0.0, 0.5)).norm() < 1e-12, "{x}");
    }

    #[test]
    fn three_planes_give_their_corner() {
        let x = fit(&[
            ([0.3, -0.5, -0.5], [1.0, 0.0, 0.0]),
            ([-0.5, -0.2, -0.5], [0.0, 1.0, 0.0]),
            ([-0.5, -0.5, 0.1], [0.0, 0.0, 1.0]),
        ]);
        assert!((x - Vec3::new(0.3, -0.2, 0.1)).norm() < 1e-4, "{x}");
    }

    #[test]
    fn planes_that_meet_outside_give_the_best_point_near_the_cell_s_face() {
        // y = 0.1 and x + y = 0.8 meet at x = 0.7; on x = 0.45 the least sum is at 2 (y - 0.1) = 0.35 - y.
        let x = fit(&[([0.4, 0.1, 0.0], [0.0, 1.0, 0.0]), ([0.4, 0.4, 0.0], [1.0, 1.0, 0.0])]);
        assert!((x - Vec3::new(CELL.held_at, 0.55 / 3.0, 0.0)).norm() < 1e-4, "{x}");
    }

    #[test]
    fn noise_in_nearly_parallel_normals_moves_the_vertex_little() {
        // Exactly solved, the two lines meet 0.02 / 0.05 / 2 = 0.2 beside the mean.
        let x = fit(&[([0.5, 0.01, 0.0], [0.025, 1.0, 0.0]), ([-0.5, -0.01, 0.0], [-0.025, 1.0, 0.0])]);
        assert!(x.x.abs() < 0.05, "{x}");
    }
}
