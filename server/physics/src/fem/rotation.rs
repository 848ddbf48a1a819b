//! Rotations of elements, and what their dependence on the positions does to forces.

use super::block::ElementBlock;
use super::ground::GroundPoints;
use super::matrices::GROUND;
use wide::f64x4;

/// Smallest eigenvalue of `tr(S) I - S`, relative to the size of S, at which it is still inverted.
const ROTATION_FLOOR: f64 = 0.2;

/// Where four elements are, in their rest frames.
pub(super) struct Placed<'a> {
    /// R and the mean deformation gradient, row-major.
    pub(super) rotation: &'a [f64x4; 9],
    pub(super) gradient: &'a [f64x4; 9],
    /// Positions of the corners from the origin and displacements, m.
    pub(super) position_m: &'a [f64x4; 24],
    pub(super) displacement_m: &'a [f64x4; 24],
    /// Present where any is held.
    pub(super) ground: Option<GroundPoints>,
}

impl ElementBlock {
    /// Adds what the dependence of R on the positions contributes to dU/dx: `B x d_a` with
    /// `(tr(S) I - S) B = tau`, `tau = sum_a f_a x y_a`, the ground points among them. Without it the force is off by
    /// percents and carries a net torque.
    #[inline(always)]
    pub(super) fn add_rotation_gradient(
        &self,
        local: &mut [f64x4; 24],
        placed: &Placed<'_>,
        on_ground_n: Option<&[f64x4; GROUND]>,
    ) {
        let mut tau = [f64x4::ZERO; 3];
        let mut add = |f: &[f64x4], y: &[f64x4]| {
            let torque = cross([f[0], f[1], f[2]], [y[0], y[1], y[2]]);
            (0..3).for_each(|i| tau[i] += torque[i]);
        };
        (0..24).step_by(3).for_each(|i| add(&local[i..i + 3], &placed.position_m[i..i + 3]));
        if let (Some(force_n), Some(points)) = (on_ground_n, &placed.ground) {
            (0..GROUND).step_by(3).for_each(|i| add(&force_n[i..i + 3], &points.position_m[i..i + 3]));
        }
        let m = matmul_transposed_left(placed.rotation, placed.gradient);
        let b = solve_rotation(&m, tau);
        for a in 0..8 {
            let turned = cross(b, self.shapes.mean_gradient[a]);
            (0..3).for_each(|i| local[3 * a + i] += turned[i]);
        }
    }
}

#[inline(always)]
fn cross(a: [f64x4; 3], b: [f64x4; 3]) -> [f64x4; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// `R^T F`.
#[inline(always)]
fn matmul_transposed_left(r: &[f64x4; 9], f: &[f64x4; 9]) -> [f64x4; 9] {
    let mut m = [f64x4::ZERO; 9];
    for i in 0..3 {
        for j in 0..3 {
            m[3 * i + j] = r[i] * f[j] + r[3 + i] * f[3 + j] + r[6 + i] * f[6 + j];
        }
    }
    m
}

/// Solves `(tr(S) I - S) b = t` with S the symmetric part of `m`. Where the matrix is nearly singular
/// or indefinite (strong compression, inversion) the inverse is replaced by Mueller's scalar one.
#[inline(always)]
fn solve_rotation(m: &[f64x4; 9], t: [f64x4; 3]) -> [f64x4; 3] {
    let half = f64x4::splat(0.5);
    let trace = m[0] + m[4] + m[8];
    let (s01, s02, s12) = (half * (m[1] + m[3]), half * (m[2] + m[6]), half * (m[5] + m[7]));
    let g = [trace - m[0], trace - m[4], trace - m[8]];
    let size2 = (m[0] * m[0] + m[4] * m[4] + m[8] * m[8] + f64x4::splat(2.0) * (s01 * s01 + s02 * s02 + s12 * s12))
        * f64x4::splat(1.0 / 3.0);
    let size = size2.sqrt().fast_max(f64x4::ONE);
    let floor = f64x4::splat(ROTATION_FLOOR) * size;
    // Positive definite above the floor, by the leading minors of G - floor I.
    let d = [g[0] - floor, g[1] - floor, g[2] - floor];
    let minor2 = d[0] * d[1] - s01 * s01;
    let minor3 = d[0] * (d[1] * d[2] - s12 * s12) - s01 * (s01 * d[2] + s12 * s02) - s02 * (s01 * s12 + d[1] * s02);
    let regular = d[0].simd_gt(f64x4::ZERO) & minor2.simd_gt(f64x4::ZERO) & minor3.simd_gt(f64x4::ZERO);
    // Cofactors of G = [g0 -s01 -s02; -s01 g1 -s12; -s02 -s12 g2].
    let c00 = g[1] * g[2] - s12 * s12;
    let c01 = s01 * g[2] + s02 * s12;
    let c02 = s01 * s12 + s02 * g[1];
    let c11 = g[0] * g[2] - s02 * s02;
    let c12 = g[0] * s12 + s01 * s02;
    let c22 = g[0] * g[1] - s01 * s01;
    let det = g[0] * c00 - s01 * c01 - s02 * c02;
    let inverse = f64x4::ONE / regular.bitselect(det, f64x4::ONE);
    let scalar = f64x4::ONE / (trace.abs() + f64x4::splat(0.5) * size);
    let exact = [
        inverse * (c00 * t[0] + c01 * t[1] + c02 * t[2]),
        inverse * (c01 * t[0] + c11 * t[1] + c12 * t[2]),
        inverse * (c02 * t[0] + c12 * t[1] + c22 * t[2]),
    ];
    std::array::from_fn(|i| regular.bitselect(exact[i], scalar * t[i]))
}

/// One step toward the polar rotation of `f`: Newton's where it is well defined, Mueller's (2016)
/// elsewhere, which also recovers from inversion. Returns the square of the step's angle, rad^2.
#[inline(always)]
pub(super) fn improve_rotation(q: &mut [f64x4; 4], f: &[f64x4; 9]) -> f64x4 {
    let r = rotation_matrix(q);
    let m = matmul_transposed_left(&r, f);
    let axial = [m[7] - m[5], m[2] - m[6], m[3] - m[1]];
    let omega = solve_rotation(&m, axial);
    let half = f64x4::splat(0.5);
    let d = [half * omega[0], half * omega[1], half * omega[2]];
    let [x, y, z, w] = *q;
    let mut next = [
        x + w * d[0] + y * d[2] - z * d[1],
        y + w * d[1] + z * d[0] - x * d[2],
        z + w * d[2] + x * d[1] - y * d[0],
        w - x * d[0] - y * d[1] - z * d[2],
    ];
    let norm2 = next[0] * next[0] + next[1] * next[1] + next[2] * next[2] + next[3] * next[3];
    let scale = f64x4::ONE / norm2.sqrt();
    next.iter_mut().for_each(|c| *c *= scale);
    *q = next;
    omega[0] * omega[0] + omega[1] * omega[1] + omega[2] * omega[2]
}

/// Row-major matrix of unit quaternions xyzw.
#[inline(always)]
#[must_use]
pub fn rotation_matrix(q: &[f64x4; 4]) -> [f64x4; 9] {
    let [x, y, z, w] = *q;
    let two = f64x4::splat(2.0);
    let one = f64x4::ONE;
    [
        one - two * (y * y + z * z),
        two * (x * y - z * w),
        two * (x * z + y * w),
        two * (x * y + z * w),
        one - two * (x * x + z * z),
        two * (y * z - x * w),
        two * (x * z - y * w),
        two * (y * z + x * w),
        one - two * (x * x + y * y),
    ]
}
