//! Rotations and exact co-rotational forces, eight elements at a time.
//!
//! Energy of an element: `U = 1/2 u^T K u + V (psi(w) - w)`, `u = R^T x - X`, R the rotation of the
//! mean deformation gradient, `w = 1/2 u^T K_G u / V`, `psi(w) = E/(2c) (exp(2 c w / E) - 1)`: strain
//! stiffening, uniaxially `sigma = E eps exp(c eps^2)`; the second term is absent for c = 0.

use super::composite::{ElementMatrices, corner_pair};
use super::lanes::{self, PACKED, for_packed};
use wide::f64x8;

/// Lanes per block.
pub const LANES: usize = 8;

/// Exponent `2 c w / E` beyond which the stiffening energy goes on along its tangent: 400 times as
/// stiff as at rest, and no more, whatever a blade or a bad start does to an element. (Growing on,
/// even as a parabola, one linearised step no longer bounds the energy.)
const LINEAR_BEYOND: f64 = 6.0;

/// Smallest eigenvalue of `tr(S) I - S`, relative to the size of S, at which it is still inverted.
const ROTATION_FLOOR: f64 = 0.2;

/// Constant data of eight elements.
#[derive(Clone)]
pub struct ElementBlock {
    /// Node of each corner and lane; unused lanes repeat lane 0 with zero matrices.
    pub nodes: [[u32; LANES]; 8],
    /// Packed stiffness, N/m.
    pub stiffness: Box<[f64x8; PACKED]>,
    /// Packed mass between corners, kg, lower triangle by rows.
    pub mass_kg: [f64x8; 36],
    /// Shape gradients averaged over the filled volume, 1/m.
    pub mean_gradient: [[f64x8; 3]; 8],
    /// Edge of the element's cell, m.
    pub edge_m: f64x8,
    /// Filled volume, m^3.
    pub volume_m3: f64x8,
    /// Rayleigh damping in proportion to mass, 1/s.
    pub alpha_per_s: f64x8,
    /// Rayleigh damping in proportion to stiffness, s.
    pub beta_s: f64x8,
    /// Present where any of the eight stiffens with strain.
    pub stiffening: Option<Box<StiffeningBlock>>,
}

/// Data of the strain-stiffening law of eight elements.
#[derive(Clone)]
pub struct StiffeningBlock {
    /// Packed Galerkin stiffness, N/m.
    pub galerkin: [f64x8; PACKED],
    /// `2 c / E`, 1/Pa; 0 where the element is linear.
    pub rate_per_pa: f64x8,
}

/// State and results of eight elements.
#[derive(Clone, Copy)]
pub struct ElementState {
    /// Rotation as a quaternion, xyzw.
    pub rotation: [f64x8; 4],
    /// Elastic energy, J.
    pub energy_j: f64x8,
    /// Kinetic energy, J.
    pub kinetic_j: f64x8,
    /// `psi'`: factor on the Galerkin stiffness' share; 1 where linear.
    pub stiffening: f64x8,
    /// `psi'' / V`, and the local Galerkin force it goes with.
    pub curvature: f64x8,
    /// Local Galerkin force, N; zero where linear.
    pub galerkin_force_n: [f64x8; 24],
    /// Elastic force, N, scene frame.
    pub force_n: [f64x8; 24],
    /// `(dt + beta) K v + alpha M v`, N, scene frame: what the velocity adds to the right side.
    pub drag_n: [f64x8; 24],
    /// `M v`, N s, scene frame.
    pub momentum: [f64x8; 24],
}

impl Default for ElementState {
    fn default() -> Self {
        let zero = f64x8::ZERO;
        Self {
            rotation: [zero, zero, zero, f64x8::ONE],
            energy_j: zero,
            kinetic_j: zero,
            stiffening: f64x8::ONE,
            curvature: zero,
            galerkin_force_n: [zero; 24],
            force_n: [zero; 24],
            drag_n: [zero; 24],
            momentum: [zero; 24],
        }
    }
}

/// Sums over elements of what a step does, J.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepEnergies {
    /// `1/2 dv^T M dv`.
    pub inertial_j: f64,
    /// `1/2 dx^T K dx`.
    pub elastic_j: f64,
    /// `1/2 dx^T H dx` of held voxels.
    pub hold_j: f64,
    /// Work of the elastic forces at the beginning of the step, `f . dx`.
    pub force_work_j: f64,
    /// Rayleigh damping, `dt v^T (alpha M + beta K) v`.
    pub damping_j: f64,
}

/// Properties of one element that are not in its matrices.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ElementLaw {
    /// Rayleigh damping in proportion to mass, 1/s.
    pub alpha_per_s: f64,
    /// Rayleigh damping in proportion to stiffness, s.
    pub beta_s: f64,
    /// `2 c / E` of the strain-stiffening law, 1/Pa; 0: linear.
    pub stiffening_rate_per_pa: f64,
}

impl Default for ElementBlock {
    fn default() -> Self {
        Self {
            nodes: [[0; LANES]; 8],
            stiffness: Box::new([f64x8::ZERO; PACKED]),
            mass_kg: [f64x8::ZERO; 36],
            mean_gradient: [[f64x8::ZERO; 3]; 8],
            edge_m: f64x8::ONE,
            volume_m3: f64x8::ONE,
            alpha_per_s: f64x8::ZERO,
            beta_s: f64x8::ZERO,
            stiffening: None,
        }
    }
}

/// Writes one lane.
#[inline]
pub fn set_lane(vector: &mut f64x8, lane: usize, value: f64) {
    vector.as_mut_array()[lane] = value;
}

impl ElementBlock {
    /// Sets the nodes of a lane.
    pub fn set_nodes(&mut self, lane: usize, nodes: &[u32; 8]) {
        (0..8).for_each(|corner| self.nodes[corner][lane] = nodes[corner]);
    }

    /// Sets the matrices of a lane.
    pub fn set_matrices(&mut self, lane: usize, edge_m: f64, matrices: &ElementMatrices, law: ElementLaw) {
        for_packed(|index, row, column| set_lane(&mut self.stiffness[index], lane, matrices.stiffness[row][column]));
        for a in 0..8 {
            for b in 0..=a {
                set_lane(&mut self.mass_kg[a * (a + 1) / 2 + b], lane, matrices.mass_kg[a][b]);
            }
            for i in 0..3 {
                set_lane(&mut self.mean_gradient[a][i], lane, matrices.mean_gradient[a][i]);
            }
        }
        set_lane(&mut self.edge_m, lane, edge_m);
        set_lane(&mut self.volume_m3, lane, matrices.volume_m3);
        set_lane(&mut self.alpha_per_s, lane, law.alpha_per_s);
        set_lane(&mut self.beta_s, lane, law.beta_s);
        if law.stiffening_rate_per_pa > 0.0 {
            let block = self.stiffening.get_or_insert_with(|| {
                Box::new(StiffeningBlock { galerkin: [f64x8::ZERO; PACKED], rate_per_pa: f64x8::ZERO })
            });
            set_lane(&mut block.rate_per_pa, lane, law.stiffening_rate_per_pa);
            for_packed(|i, row, column| {
                set_lane(&mut block.galerkin[i], lane, matrices.stiffness_galerkin[row][column])
            });
        }
    }

    #[inline(always)]
    fn gather(&self, values: &[[f64; 3]]) -> [f64x8; 24] {
        let mut out = [f64x8::ZERO; 24];
        for corner in 0..8 {
            for lane in 0..LANES {
                let point = &values[self.nodes[corner][lane] as usize];
                for i in 0..3 {
                    out[3 * corner + i].as_mut_array()[lane] = point[i];
                }
            }
        }
        out
    }

    /// Updates rotations by `iterations` steps, then forces, energy and velocity terms at positions
    /// `position_m` and velocities `velocity_m_per_s` of the nodes.
    pub fn evaluate(
        &self,
        state: &mut ElementState,
        position_m: &[[f64; 3]],
        velocity_m_per_s: &[[f64; 3]],
        dt_s: f64,
        iterations: u32,
    ) {
        let mut x = self.gather(position_m);
        let origin = [x[0], x[1], x[2]];
        (0..24).for_each(|i| x[i] -= origin[i % 3]);
        let gradient = self.deformation_gradient(&x);
        for _ in 0..iterations {
            improve_rotation(&mut state.rotation, &gradient);
        }
        let r = rotation_matrix(&state.rotation);
        self.evaluate_forces(state, &r, &gradient, &x);
        self.evaluate_velocity_terms(state, &r, &self.gather(velocity_m_per_s), dt_s);
    }

    #[inline(always)]
    fn deformation_gradient(&self, x: &[f64x8; 24]) -> [f64x8; 9] {
        let mut f = [f64x8::ZERO; 9];
        for a in 0..8 {
            for i in 0..3 {
                for j in 0..3 {
                    f[3 * i + j] = x[3 * a + i].mul_add(self.mean_gradient[a][j], f[3 * i + j]);
                }
            }
        }
        f
    }

    #[inline(always)]
    fn evaluate_forces(&self, state: &mut ElementState, r: &[f64x8; 9], f: &[f64x8; 9], x: &[f64x8; 24]) {
        let y = lanes::rotate_back(r, x);
        let mut u = y;
        for corner in 0..8 {
            for i in 0..3 {
                if corner >> i & 1 == 1 {
                    u[3 * corner + i] -= self.edge_m;
                }
            }
        }
        let mut local = lanes::apply(&self.stiffness, &u);
        let half = f64x8::splat(0.5);
        state.energy_j = half * lanes::dot(&u, &local);
        if let Some(stiffening) = &self.stiffening {
            let g = lanes::apply(&stiffening.galerkin, &u);
            let w = half * lanes::dot(&u, &g) / self.volume_m3;
            let (energy, slope, curvature) = stiffening_law(w, stiffening.rate_per_pa);
            state.energy_j += self.volume_m3 * energy;
            state.stiffening = slope;
            state.curvature = curvature / self.volume_m3;
            for i in 0..24 {
                local[i] = (slope - f64x8::ONE).mul_add(g[i], local[i]);
            }
            state.galerkin_force_n = g;
        }
        self.add_rotation_gradient(&mut local, &y, r, f);
        let scene = lanes::rotate(r, &local);
        (0..24).for_each(|i| state.force_n[i] = -scene[i]);
    }

    /// Adds what the dependence of R on the positions contributes to dU/dx: `B x d_a` with
    /// `(tr(S) I - S) B = tau`, `tau = sum_a f_a x y_a`. Without it the force is off by percents and
    /// carries a net torque.
    #[inline(always)]
    fn add_rotation_gradient(&self, local: &mut [f64x8; 24], y: &[f64x8; 24], r: &[f64x8; 9], f: &[f64x8; 9]) {
        let mut tau = [f64x8::ZERO; 3];
        for a in 0..8 {
            let torque =
                cross([local[3 * a], local[3 * a + 1], local[3 * a + 2]], [y[3 * a], y[3 * a + 1], y[3 * a + 2]]);
            (0..3).for_each(|i| tau[i] += torque[i]);
        }
        let m = matmul_transposed_left(r, f);
        let b = solve_rotation(&m, tau);
        for a in 0..8 {
            let turned = cross(b, self.mean_gradient[a]);
            (0..3).for_each(|i| local[3 * a + i] += turned[i]);
        }
    }

    /// `K' v` in the rest frame of each element.
    #[inline(always)]
    fn tangent(&self, state: &ElementState, local: &[f64x8; 24]) -> [f64x8; 24] {
        let mut kv = lanes::apply(&self.stiffness, local);
        if let Some(stiffening) = &self.stiffening {
            let g = lanes::apply(&stiffening.galerkin, local);
            let along = state.curvature * lanes::dot(&state.galerkin_force_n, local);
            for i in 0..24 {
                kv[i] = (state.stiffening - f64x8::ONE).mul_add(g[i], kv[i]);
                kv[i] = along.mul_add(state.galerkin_force_n[i], kv[i]);
            }
        }
        kv
    }

    #[inline(always)]
    fn mass_times(&self, v: &[f64x8; 24]) -> [f64x8; 24] {
        let mut out = [f64x8::ZERO; 24];
        for a in 0..8 {
            for b in 0..8 {
                let entry = corner_pair(a, b);
                for i in 0..3 {
                    out[3 * a + i] = self.mass_kg[entry].mul_add(v[3 * b + i], out[3 * a + i]);
                }
            }
        }
        out
    }

    /// Adds what a step from `state` to velocities `v + dv` does, rotations as they are in `state`.
    pub fn add_step_energies(
        &self,
        state: &ElementState,
        velocity_m_per_s: &[[f64; 3]],
        velocity_change: &[[f64; 3]],
        dt_s: f64,
        sum: &mut StepEnergies,
    ) {
        let dv = self.gather(velocity_change);
        let mut v = self.gather(velocity_m_per_s);
        (0..24).for_each(|i| v[i] += dv[i]);
        let r = rotation_matrix(&state.rotation);
        let local = lanes::rotate_back(&r, &v);
        let vkv = lanes::dot(&local, &self.tangent(state, &local));
        let vmv = lanes::dot(&v, &self.mass_times(&v));
        let damping = f64x8::splat(dt_s) * (self.alpha_per_s * vmv + self.beta_s * vkv);
        sum.inertial_j += 0.5 * lanes::dot(&dv, &self.mass_times(&dv)).reduce_add();
        sum.elastic_j += 0.5 * dt_s * dt_s * vkv.reduce_add();
        sum.force_work_j += dt_s * lanes::dot(&state.force_n, &v).reduce_add();
        sum.damping_j += damping.reduce_add();
    }

    #[inline(always)]
    fn evaluate_velocity_terms(&self, state: &mut ElementState, r: &[f64x8; 9], v: &[f64x8; 24], dt_s: f64) {
        let kv = lanes::rotate(r, &self.tangent(state, &lanes::rotate_back(r, v)));
        state.momentum = self.mass_times(v);
        state.kinetic_j = f64x8::splat(0.5) * lanes::dot(v, &state.momentum);
        let factor = self.beta_s + f64x8::splat(dt_s);
        for i in 0..24 {
            state.drag_n[i] = factor.mul_add(kv[i], self.alpha_per_s * state.momentum[i]);
        }
    }
}

/// `psi - w`, `psi'` and `psi''` of the stiffening law at energy density `w`, rate = 2 c / E.
#[inline(always)]
fn stiffening_law(w: f64x8, rate: f64x8) -> (f64x8, f64x8, f64x8) {
    let limit = f64x8::splat(LINEAR_BEYOND);
    let z = rate * w;
    let inside = z.fast_min(limit);
    let beyond = z - inside;
    let e = inside.exp();
    // psi = (e^z - 1) / rate; beyond the limit its tangent.
    let slope = e;
    let excess = e * (f64x8::ONE + beyond) - f64x8::ONE - z;
    let linear = rate.simd_lt(f64x8::splat(f64::MIN_POSITIVE));
    let energy = linear.bitselect(f64x8::ZERO, excess / linear.bitselect(f64x8::ONE, rate));
    let curvature = beyond.simd_gt(f64x8::ZERO).bitselect(f64x8::ZERO, e * rate);
    (energy, slope, curvature)
}

#[inline(always)]
fn cross(a: [f64x8; 3], b: [f64x8; 3]) -> [f64x8; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// `R^T F`.
#[inline(always)]
fn matmul_transposed_left(r: &[f64x8; 9], f: &[f64x8; 9]) -> [f64x8; 9] {
    let mut m = [f64x8::ZERO; 9];
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
fn solve_rotation(m: &[f64x8; 9], t: [f64x8; 3]) -> [f64x8; 3] {
    let half = f64x8::splat(0.5);
    let trace = m[0] + m[4] + m[8];
    let (s01, s02, s12) = (half * (m[1] + m[3]), half * (m[2] + m[6]), half * (m[5] + m[7]));
    let g = [trace - m[0], trace - m[4], trace - m[8]];
    let size2 = (m[0] * m[0] + m[4] * m[4] + m[8] * m[8] + f64x8::splat(2.0) * (s01 * s01 + s02 * s02 + s12 * s12))
        * f64x8::splat(1.0 / 3.0);
    let size = size2.sqrt().fast_max(f64x8::ONE);
    let floor = f64x8::splat(ROTATION_FLOOR) * size;
    // Positive definite above the floor, by the leading minors of G - floor I.
    let d = [g[0] - floor, g[1] - floor, g[2] - floor];
    let minor2 = d[0] * d[1] - s01 * s01;
    let minor3 = d[0] * (d[1] * d[2] - s12 * s12) - s01 * (s01 * d[2] + s12 * s02) - s02 * (s01 * s12 + d[1] * s02);
    let regular = d[0].simd_gt(f64x8::ZERO) & minor2.simd_gt(f64x8::ZERO) & minor3.simd_gt(f64x8::ZERO);
    // Cofactors of G = [g0 -s01 -s02; -s01 g1 -s12; -s02 -s12 g2].
    let c00 = g[1] * g[2] - s12 * s12;
    let c01 = s01 * g[2] + s02 * s12;
    let c02 = s01 * s12 + s02 * g[1];
    let c11 = g[0] * g[2] - s02 * s02;
    let c12 = g[0] * s12 + s01 * s02;
    let c22 = g[0] * g[1] - s01 * s01;
    let det = g[0] * c00 - s01 * c01 - s02 * c02;
    let inverse = f64x8::ONE / regular.bitselect(det, f64x8::ONE);
    let scalar = f64x8::ONE / (trace.abs() + f64x8::splat(0.5) * size);
    let exact = [
        inverse * (c00 * t[0] + c01 * t[1] + c02 * t[2]),
        inverse * (c01 * t[0] + c11 * t[1] + c12 * t[2]),
        inverse * (c02 * t[0] + c12 * t[1] + c22 * t[2]),
    ];
    std::array::from_fn(|i| regular.bitselect(exact[i], scalar * t[i]))
}

/// One step toward the polar rotation of `f`: Newton's where it is well defined, Mueller's (2016)
/// elsewhere, which also recovers from inversion.
#[inline(always)]
fn improve_rotation(q: &mut [f64x8; 4], f: &[f64x8; 9]) {
    let r = rotation_matrix(q);
    let m = matmul_transposed_left(&r, f);
    let axial = [m[7] - m[5], m[2] - m[6], m[3] - m[1]];
    let omega = solve_rotation(&m, axial);
    let half = f64x8::splat(0.5);
    let d = [half * omega[0], half * omega[1], half * omega[2]];
    let [x, y, z, w] = *q;
    let mut next = [
        x + w * d[0] + y * d[2] - z * d[1],
        y + w * d[1] + z * d[0] - x * d[2],
        z + w * d[2] + x * d[1] - y * d[0],
        w - x * d[0] - y * d[1] - z * d[2],
    ];
    let norm2 = next[0] * next[0] + next[1] * next[1] + next[2] * next[2] + next[3] * next[3];
    let scale = f64x8::ONE / norm2.sqrt();
    next.iter_mut().for_each(|c| *c *= scale);
    *q = next;
}

/// Row-major matrix of unit quaternions xyzw.
#[inline(always)]
#[must_use]
pub fn rotation_matrix(q: &[f64x8; 4]) -> [f64x8; 9] {
    let [x, y, z, w] = *q;
    let two = f64x8::splat(2.0);
    let one = f64x8::ONE;
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
