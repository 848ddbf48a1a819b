//! Symmetric 24x24 matrices of several elements side by side, one element per SIMD lane.
//!
//! Nested loops over small arrays do not vectorise by themselves; with an element per lane every
//! operation is a whole vector, and the bits do not depend on the width of the machine's registers.

use super::matrices::Matrix24;
use std::ops::{Add, Mul, Sub};
use wide::{f32x4, f32x8, f64x4};

/// Entries of a packed symmetric 24x24 matrix: by node blocks, row block `a`, first the lower
/// triangle of (a, a), then for each b < a the nine entries of (a, b), row-major.
pub const PACKED: usize = 300;

/// A vector of floating-point lanes.
pub trait Lane: Copy + Add<Output = Self> + Mul<Output = Self> {
    /// All lanes zero.
    const ZERO: Self;
    /// `self * factor + term`, rounded once.
    #[must_use]
    fn fma(self, factor: Self, term: Self) -> Self;
}

/// A vector of as many elements as it has lanes.
pub trait LaneVector: Lane + Sub<Output = Self> {
    /// What a lane holds.
    type Scalar: Copy + PartialEq + Into<f64>;
    /// Number of lanes.
    const LANES: usize;
    /// What rounding leaves of a sum that is zero, over the size of its terms: with room to spare.
    const ROUNDING: f64;
    /// The same value in every lane.
    fn splat(value: Self::Scalar) -> Self;
    /// A value rounded to what a lane holds.
    fn narrow(value: f64) -> Self::Scalar;
    /// Value of one lane.
    fn lane(&self, lane: usize) -> Self::Scalar;
    /// Sets one lane.
    fn set_lane(&mut self, lane: usize, value: Self::Scalar);
}

macro_rules! lane_vector {
    ($vector:ty, $scalar:ty, $lanes:expr, $rounding:expr) => {
        impl LaneVector for $vector {
            type Scalar = $scalar;
            const LANES: usize = $lanes;
            const ROUNDING: f64 = $rounding;
            #[inline(always)]
            fn splat(value: $scalar) -> Self {
                Self::splat(value)
            }
            #[inline(always)]
            fn narrow(value: f64) -> $scalar {
                value as $scalar
            }
            #[inline(always)]
            fn lane(&self, lane: usize) -> $scalar {
                self.as_array()[lane]
            }
            #[inline(always)]
            fn set_lane(&mut self, lane: usize, value: $scalar) {
                self.as_mut_array()[lane] = value;
            }
        }
    };
}

lane_vector!(f32x8, f32, 8, 1e-5);
lane_vector!(wide::f64x4, f64, 4, 1e-11);

impl Lane for wide::f64x4 {
    const ZERO: Self = Self::ZERO;
    #[inline(always)]
    fn fma(self, factor: Self, term: Self) -> Self {
        self.mul_add(factor, term)
    }
}

impl Lane for f32x8 {
    const ZERO: Self = Self::ZERO;
    #[inline(always)]
    fn fma(self, factor: Self, term: Self) -> Self {
        self.mul_add(factor, term)
    }
}

impl Lane for f64 {
    const ZERO: Self = 0.0;
    #[inline(always)]
    fn fma(self, factor: Self, term: Self) -> Self {
        self.mul_add(factor, term)
    }
}

/// Packed index of the first diagonal entry of a corner's own block.
#[must_use]
pub const fn diagonal_entry(corner: usize) -> usize {
    6 * corner + 9 * corner * corner.saturating_sub(1) / 2
}

/// Visits the packed entries as (index, row, column).
pub fn for_packed(mut visit: impl FnMut(usize, usize, usize)) {
    let mut index = 0;
    for a in 0..8 {
        for i in 0..3 {
            for j in 0..=i {
                visit(index, 3 * a + i, 3 * a + j);
                index += 1;
            }
        }
        for b in 0..a {
            for i in 0..3 {
                for j in 0..3 {
                    visit(index, 3 * a + i, 3 * b + j);
                    index += 1;
                }
            }
        }
    }
}

/// Packs a symmetric matrix.
#[must_use]
pub fn pack(matrix: &Matrix24) -> [f64; PACKED] {
    let mut packed = [0.0; PACKED];
    for_packed(|index, row, column| packed[index] = matrix[row][column]);
    packed
}

/// The full matrix of a packed one.
#[must_use]
pub fn unpack(packed: &[f64; PACKED]) -> Matrix24 {
    let mut matrix = [[0.0; 24]; 24];
    for_packed(|index, row, column| {
        matrix[row][column] = packed[index];
        matrix[column][row] = packed[index];
    });
    matrix
}

/// `y_n = K u_n` of several vectors, by the packed matrix of every lane, which is read once for all of them; the rows
/// and columns of the corners before `FIRST` are left out.
#[inline(always)]
fn product<L: Lane, const N: usize, const FIRST: usize>(k: &[L; PACKED], u: &[[L; 24]; N]) -> [[L; 24]; N] {
    let mut y = [[L::ZERO; 24]; N];
    for a in FIRST..8 {
        let (d, beside) = k[diagonal_entry(a)..].split_at(6);
        let mut ya = [[L::ZERO; 3]; N];
        for n in 0..N {
            let ua = [u[n][3 * a], u[n][3 * a + 1], u[n][3 * a + 2]];
            ya[n] = [
                d[0].fma(ua[0], d[1].fma(ua[1], d[3] * ua[2])),
                d[1].fma(ua[0], d[2].fma(ua[1], d[4] * ua[2])),
                d[3].fma(ua[0], d[4].fma(ua[1], d[5] * ua[2])),
            ];
        }
        for b in FIRST..a {
            let m = &beside[9 * b..9 * b + 9];
            for n in 0..N {
                let (u, y) = (&u[n], &mut y[n]);
                let ua = [u[3 * a], u[3 * a + 1], u[3 * a + 2]];
                let ub = [u[3 * b], u[3 * b + 1], u[3 * b + 2]];
                for i in 0..3 {
                    ya[n][i] = m[3 * i].fma(ub[0], m[3 * i + 1].fma(ub[1], m[3 * i + 2].fma(ub[2], ya[n][i])));
                }
                for j in 0..3 {
                    y[3 * b + j] = m[j].fma(ua[0], m[3 + j].fma(ua[1], m[6 + j].fma(ua[2], y[3 * b + j])));
                }
            }
        }
        for n in 0..N {
            y[n][3 * a..3 * a + 3].copy_from_slice(&ya[n]);
        }
    }
    y
}

/// `y_n = K u_n` of several vectors.
#[inline(always)]
pub fn apply_to_each<L: Lane, const N: usize>(k: &[L; PACKED], u: &[[L; 24]; N]) -> [[L; 24]; N] {
    product::<L, N, 0>(k, u)
}

/// The same of a matrix that does not resist translation, where the first corner of every vector is zero: what that bears
/// is what the others leave.
#[inline(always)]
pub fn apply_from_first_corner<L: LaneVector, const N: usize>(k: &[L; PACKED], u: &[[L; 24]; N]) -> [[L; 24]; N] {
    let mut y = product::<L, N, 1>(k, u);
    for y in &mut y {
        for i in 0..3 {
            y[i] = (1..8).fold(L::ZERO, |left, a| left - y[3 * a + i]);
        }
    }
    y
}

/// Rotates 8 vectors: `out_a = R u_a`, `r` row-major.
#[inline(always)]
pub fn rotate<L: Lane>(r: &[L; 9], u: &[L; 24]) -> [L; 24] {
    let mut out = [L::ZERO; 24];
    for a in 0..8 {
        for i in 0..3 {
            out[3 * a + i] = r[3 * i].fma(u[3 * a], r[3 * i + 1].fma(u[3 * a + 1], r[3 * i + 2] * u[3 * a + 2]));
        }
    }
    out
}

/// Rotates 8 vectors back: `out_a = R^T u_a`.
#[inline(always)]
pub fn rotate_back<L: Lane>(r: &[L; 9], u: &[L; 24]) -> [L; 24] {
    rotate(&[r[0], r[3], r[6], r[1], r[4], r[7], r[2], r[5], r[8]], u)
}

/// Components x, y and z of eight vectors, one vector per lane.
#[inline(always)]
#[must_use]
pub fn split(v: [f32x4; 8]) -> [f32x8; 3] {
    let low = f32x4::transpose([v[0], v[1], v[2], v[3]]);
    let high = f32x4::transpose([v[4], v[5], v[6], v[7]]);
    [0, 1, 2].map(|i| bytemuck::cast([low[i], high[i]]))
}

/// Eight vectors from their components: the inverse of [`split`].
#[inline(always)]
#[must_use]
pub fn join(components: [f32x8; 3]) -> [f32x4; 8] {
    let [x, y, z] = components.map(bytemuck::cast::<f32x8, [f32x4; 2]>);
    let low = f32x4::transpose([x[0], y[0], z[0], f32x4::ZERO]);
    let high = f32x4::transpose([x[1], y[1], z[1], f32x4::ZERO]);
    [low[0], low[1], low[2], low[3], high[0], high[1], high[2], high[3]]
}

/// Dot product of two local vectors.
#[inline(always)]
pub fn dot<L: Lane, const N: usize>(a: &[L; N], b: &[L; N]) -> L {
    let mut sum = L::ZERO;
    for i in 0..N {
        sum = a[i].fma(b[i], sum);
    }
    sum
}

/// Writes one lane.
#[inline]
pub fn set_lane(vector: &mut f64x4, lane: usize, value: f64) {
    vector.as_mut_array()[lane] = value;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packed_product_equals_the_full_matrix_product() {
        let mut full = [[0.0; 24]; 24];
        for i in 0..24 {
            for j in 0..=i {
                let value = ((i * 31 + j * 17) % 23) as f64 - 11.0;
                full[i][j] = value;
                full[j][i] = value;
            }
        }
        let u: [f64; 24] = std::array::from_fn(|i| (i as f64 * 0.7).sin());
        let packed = pack(&full);
        assert_eq!(unpack(&packed), full);
        let [y] = apply_to_each(&packed, &[u]);
        for i in 0..24 {
            let expected: f64 = (0..24).map(|j| full[i][j] * u[j]).sum();
            assert!((y[i] - expected).abs() < 1e-12, "row {i}: {} against {expected}", y[i]);
        }
    }

    #[test]
    fn a_product_from_the_first_corner_is_the_full_one_where_nothing_resists_translation() {
        // Springs between all pairs of corners, as different as their places in the matrix.
        let mut full = [[0.0; 24]; 24];
        for (a, b) in (0..8).flat_map(|a| (0..a).map(move |b| (a, b))) {
            for (i, j) in (0..9).map(|n| (n / 3, n % 3)) {
                let k = ((a * 31 + b * 17 + 5 * (i + j) + i * j) % 23) as f64;
                full[3 * a + i][3 * b + j] -= k;
                full[3 * b + i][3 * a + j] -= k;
                full[3 * a + i][3 * a + j] += k;
                full[3 * b + i][3 * b + j] += k;
            }
        }
        let packed = pack(&full).map(f64x4::splat);
        let mut u: [f64x4; 24] = std::array::from_fn(|i| f64x4::splat((i as f64 * 0.7).sin()));
        u[..3].fill(f64x4::ZERO);
        let [whole] = apply_to_each(&packed, &[u]);
        let [from_first] = apply_from_first_corner(&packed, &[u]);
        for (i, (a, b)) in from_first.iter().zip(whole).enumerate() {
            let (a, b) = (a.as_array()[0], b.as_array()[0]);
            assert!((a - b).abs() < 1e-12, "row {i}: {a} against {b}");
        }
    }
}
