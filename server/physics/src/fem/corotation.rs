//! Rotations and exact co-rotational forces, four elements at a time.
//!
//! Energy of an element: `U = 1/2 u^T K u + V (psi(w) - w)`, `u = R^T x - X`, R the rotation of the
//! mean deformation gradient, `w = 1/2 u^T K_G u / V`, `psi(w) = E/(2c) (exp(2 c w / E) - 1)`: strain
//! stiffening, uniaxially `sigma = E eps exp(c eps^2)`; the second term is absent for c = 0. What relaxes
//! in time stands beside it: [`super::viscosity`].

use super::composite::{ElementMatrices, corner_pair};
use super::lanes::{self, pack};
use super::packed::{MOST_SHARED, PackedMatrix, Shared};
use super::viscosity::{BranchState, Motion, Viscosity, ViscosityBlock};
use std::sync::Arc;
use wide::{f32x4, f64x4};

/// Lanes per block.
pub const LANES: usize = 4;

/// Exponent `2 c w / E` beyond which the stiffening energy goes on along its tangent: 400 times as
/// stiff as at rest, and no more, whatever a blade or a bad start does to an element. (Growing on,
/// even as a parabola, one linearised step no longer bounds the energy.)
const LINEAR_BEYOND: f64 = 6.0;

/// A rotation that was improved by less than 1e-4 rad is off by less than 1e-8 rad after it: the steps
/// converge quadratically.
const TURNED_ENOUGH_RAD2: f64 = 1e-8;

/// Smallest eigenvalue of `tr(S) I - S`, relative to the size of S, at which it is still inverted.
const ROTATION_FLOOR: f64 = 0.2;

/// What four elements have in their rest frames besides their stiffness.
#[derive(Clone, PartialEq)]
pub struct ElementShapes {
    /// Packed mass between corners, kg, lower triangle by rows.
    pub mass_kg: [f64x4; 36],
    /// Shape gradients averaged over the filled volume, 1/m.
    pub mean_gradient: [[f64x4; 3]; 8],
    /// Edge of the element's cell, m.
    pub edge_m: f64x4,
    /// Filled volume, m^3.
    pub volume_m3: f64x4,
}

/// Constant data of four elements.
#[derive(Clone)]
pub struct ElementBlock {
    /// Slots of each corner and lane in the buffers of the chunk; unused lanes have slot 0 and zero
    /// matrices.
    pub slots: [[u16; LANES]; 8],
    /// Stiffness, N/m.
    pub stiffness: PackedMatrix<f64x4>,
    /// The rest, stored once for blocks that have it in common.
    pub shapes: Arc<ElementShapes>,
    /// Rayleigh damping in proportion to mass, 1/s.
    pub alpha_per_s: f64x4,
    /// Rayleigh damping in proportion to stiffness, s.
    pub beta_s: f64x4,
    /// Present where any of the four stiffens with strain.
    pub stiffening: Option<StiffeningBlock>,
    /// Present where any of the four relaxes.
    pub viscosity: Option<Box<ViscosityBlock>>,
}

/// Nodal values of a chunk of elements, xyz0, by slot: what blocks read.
#[derive(Clone, Debug, Default)]
pub struct NodalBuffers {
    /// Positions, m.
    pub position_m: Vec<f64x4>,
    /// Velocities, m/s.
    pub velocity_m_per_s: Vec<f64x4>,
    /// How the step changed the velocities, m/s; empty where there was no step.
    pub velocity_change: Vec<f64x4>,
}

/// What an evaluation of four elements found.
#[derive(Clone, Copy, Debug, Default)]
pub struct Evaluation {
    /// Elastic energy, J.
    pub elastic_j: f64x4,
    /// Kinetic energy, J.
    pub kinetic_j: f64x4,
    /// What the step did to the energies.
    pub step: StepTerms<f64x4>,
    /// Square of the largest angle that an element has turned by, rad^2.
    pub turned_rad2: f64x4,
}

/// Data of the strain-stiffening law of four elements.
#[derive(Clone)]
pub struct StiffeningBlock {
    /// Galerkin stiffness, N/m.
    pub galerkin: PackedMatrix<f64x4>,
    /// `2 c / E`, 1/Pa; 0 where the element is linear.
    pub rate_per_pa: f64x4,
}

/// State and results of four elements.
#[derive(Clone)]
pub struct ElementState {
    /// Rotation as a quaternion, xyzw.
    pub rotation: [f64x4; 4],
    /// The same as a row-major matrix, for the solver.
    pub rotation_matrix: [f32x4; 9],
    /// `psi'`: factor on the Galerkin stiffness' part; 1 where linear.
    pub stiffening: f64x4,
    /// `psi'' / V`, and the local Galerkin force it goes with.
    pub curvature: f64x4,
    /// Local Galerkin force, N; zero where linear.
    pub galerkin_force_n: [f64x4; 24],
    /// Elastic force, N, scene frame.
    pub force_n: [f64x4; 24],
    /// Elastic energy but for what relaxes, J.
    pub elastic_j: f64x4,
    /// Present where any of the four relaxes.
    pub branch: Option<Box<BranchState>>,
}

impl Default for ElementState {
    fn default() -> Self {
        let zero = f64x4::ZERO;
        Self {
            rotation: [zero, zero, zero, f64x4::ONE],
            rotation_matrix: [0, 1, 2, 3, 4, 5, 6, 7, 8].map(|i| f32x4::splat(if i % 4 == 0 { 1.0 } else { 0.0 })),
            stiffening: f64x4::ONE,
            curvature: zero,
            galerkin_force_n: [zero; 24],
            force_n: [zero; 24],
            elastic_j: zero,
            branch: None,
        }
    }
}

/// Energies of a step of four elements or, in [`crate::body::StepEnergies`], of a body, J. Rotations and forces are
/// those of the step's beginning, `v` is the velocity at its end, `dx = dt v`.
#[derive(Clone, Copy, Debug, Default)]
pub struct StepTerms<E> {
    /// `1/2 dv^T M dv`, and `dt^2 v^T S dv` where elements have geometric stiffness.
    pub inertial_j: E,
    /// `1/2 dx^T K dx`.
    pub elastic_j: E,
    /// Work of the elastic forces, `f . dx`.
    pub force_work_j: E,
    /// Rayleigh damping, `dt v^T (alpha M + beta K) v`.
    pub damping_j: E,
    /// What the dashpots of relaxing materials dissipated.
    pub viscous_j: E,
}

/// Products of an element's stiffness matrices with a vector in its rest frame.
struct Products {
    k: [f64x4; 24],
    /// Of the Galerkin stiffness, where the element stiffens.
    g: Option<[f64x4; 24]>,
}

/// What blocks have in common.
#[derive(Default)]
pub struct SharedByBlocks {
    matrices: Shared<f64x4>,
    shapes: Vec<Arc<ElementShapes>>,
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
    /// What relaxes in time, if anything does.
    pub viscosity: Option<Viscosity>,
}

impl Default for ElementBlock {
    fn default() -> Self {
        let shapes = ElementShapes {
            mass_kg: [f64x4::ZERO; 36],
            mean_gradient: [[f64x4::ZERO; 3]; 8],
            edge_m: f64x4::ONE,
            volume_m3: f64x4::ONE,
        };
        Self {
            slots: [[0; LANES]; 8],
            stiffness: PackedMatrix::default(),
            shapes: Arc::new(shapes),
            alpha_per_s: f64x4::ZERO,
            beta_s: f64x4::ZERO,
            stiffening: None,
            viscosity: None,
        }
    }
}

impl Evaluation {
    /// Takes in what was found for other elements.
    pub fn join(&mut self, other: &Self) {
        self.elastic_j += other.elastic_j;
        self.kinetic_j += other.kinetic_j;
        self.step.inertial_j += other.step.inertial_j;
        self.step.elastic_j += other.step.elastic_j;
        self.step.force_work_j += other.step.force_work_j;
        self.step.damping_j += other.step.damping_j;
        self.step.viscous_j += other.step.viscous_j;
        self.turned_rad2 = self.turned_rad2.fast_max(other.turned_rad2);
    }
}

/// Writes one lane.
#[inline]
pub fn set_lane(vector: &mut f64x4, lane: usize, value: f64) {
    vector.as_mut_array()[lane] = value;
}

impl ElementBlock {
    /// Sets the slots of a lane's corners.
    pub fn set_slots(&mut self, lane: usize, slots: &[u16; 8]) {
        (0..8).for_each(|corner| self.slots[corner][lane] = slots[corner]);
    }

    /// Sets the matrices of a lane; its branch for steps of `dt_s`.
    pub fn set_matrices(&mut self, lane: usize, edge_m: f64, matrices: &ElementMatrices, law: ElementLaw, dt_s: f64) {
        self.stiffness.set(lane, &pack(&matrices.stiffness));
        let shapes = Arc::make_mut(&mut self.shapes);
        for a in 0..8 {
            for b in 0..=a {
                set_lane(&mut shapes.mass_kg[a * (a + 1) / 2 + b], lane, matrices.mass_kg[a][b]);
            }
            for i in 0..3 {
                set_lane(&mut shapes.mean_gradient[a][i], lane, matrices.mean_gradient[a][i]);
            }
        }
        set_lane(&mut shapes.edge_m, lane, edge_m);
        set_lane(&mut shapes.volume_m3, lane, matrices.volume_m3);
        set_lane(&mut self.alpha_per_s, lane, law.alpha_per_s);
        set_lane(&mut self.beta_s, lane, law.beta_s);
        if law.stiffening_rate_per_pa > 0.0 {
            let block = self
                .stiffening
                .get_or_insert_with(|| StiffeningBlock { galerkin: PackedMatrix::default(), rate_per_pa: f64x4::ZERO });
            set_lane(&mut block.rate_per_pa, lane, law.stiffening_rate_per_pa);
            block.galerkin.set(lane, &pack(&matrices.stiffness_measured));
        }
        if law.viscosity.is_some() || self.viscosity.is_some() {
            self.viscosity.get_or_insert_default().set(lane, law.viscosity.as_ref(), dt_s);
        }
    }

    /// Stores matrices and shapes once where the elements have them in common with each other or with
    /// those of blocks before.
    pub fn share_matrices(&mut self, shared: &mut SharedByBlocks) {
        self.stiffness.share(&mut shared.matrices);
        if let Some(stiffening) = &mut self.stiffening {
            stiffening.galerkin.share(&mut shared.matrices);
        }
        match shared.shapes.iter().find(|shapes| **shapes == self.shapes) {
            Some(known) => self.shapes = Arc::clone(known),
            // Where elements differ, blocks hardly ever agree.
            None if shared.shapes.len() < MOST_SHARED && self.is_uniform() => {
                shared.shapes.push(Arc::clone(&self.shapes));
            }
            None => {}
        }
    }

    fn is_uniform(&self) -> bool {
        let mut values = self.shapes.mass_kg.iter().chain(self.shapes.mean_gradient.as_flattened());
        values.all(|v| v.as_array().iter().all(|lane| *lane == v.as_array()[0]))
    }

    #[inline(always)]
    fn gather(&self, values: &[f64x4]) -> [f64x4; 24] {
        let mut out = [f64x4::ZERO; 24];
        let last = values.len() - 1;
        for (corner, slots) in self.slots.iter().enumerate() {
            let at = |lane: usize| values[usize::from(slots[lane]).min(last)];
            let [x, y, z, _] = f64x4::transpose([at(0), at(1), at(2), at(3)]);
            out[3 * corner] = x;
            out[3 * corner + 1] = y;
            out[3 * corner + 2] = z;
        }
        out
    }

    /// Updates rotations by `iterations` steps, then forces, energy and velocity terms at the positions and
    /// velocities of the nodes, and adds to `balance_n` what the elements add to the right side: elastic forces
    /// less `(dt + beta) K v + alpha M v`, N, by slot; with them the terms of the step from the state
    /// that was evaluated before, if there was one.
    pub fn evaluate(
        &self,
        state: &mut ElementState,
        nodal: &NodalBuffers,
        balance_n: &mut [f64x4],
        dt_s: f64,
        iterations: u32,
    ) -> Evaluation {
        // Compiled twice: even untaken, the way through a branch makes the other one slower by 6 %.
        if self.viscosity.is_some() {
            self.evaluate_as::<true>(state, nodal, balance_n, dt_s, iterations)
        } else {
            self.evaluate_as::<false>(state, nodal, balance_n, dt_s, iterations)
        }
    }

    fn evaluate_as<const RELAXES: bool>(
        &self,
        state: &mut ElementState,
        nodal: &NodalBuffers,
        balance_n: &mut [f64x4],
        dt_s: f64,
        iterations: u32,
    ) -> Evaluation {
        let mut x = self.gather(&nodal.position_m);
        let origin = [x[0], x[1], x[2]];
        (0..24).for_each(|i| x[i] -= origin[i % 3]);
        let gradient = self.deformation_gradient(&x);
        let r_before = rotation_matrix(&state.rotation);
        let mut turned_rad2 = f64x4::ZERO;
        for _ in 0..iterations {
            let step_rad2 = improve_rotation(&mut state.rotation, &gradient);
            turned_rad2 += step_rad2;
            if step_rad2.simd_lt(f64x4::splat(TURNED_ENOUGH_RAD2)).all() {
                break;
            }
        }
        let r = rotation_matrix(&state.rotation);
        for (narrow, entry) in state.rotation_matrix.iter_mut().zip(r) {
            // Rounded to 1e-16: the products of what a body at rest has turned by would be subnormal, and a
            // hundred times as slow.
            let [a, b, c, d] = (entry + f64x4::ONE - f64x4::ONE).to_array();
            *narrow = f32x4::new([a as f32, b as f32, c as f32, d as f32]);
        }
        let y = lanes::rotate_back(&r, &x);
        let velocity = self.gather(&nodal.velocity_m_per_s);
        // The stiffness is most of what an evaluation reads: once for both.
        let vectors = [self.displacement(&y), lanes::rotate_back(&r, &velocity)];
        let stiffness = self.stiffness.apply_to_each(&vectors);
        let galerkin = self.stiffening.as_ref().map(|s| s.galerkin.apply_to_each(&vectors));
        let products = |n: usize| Products { k: stiffness[n], g: galerkin.as_ref().map(|g| g[n]) };
        let momentum = self.mass_times(&velocity);
        let half = f64x4::splat(0.5);
        let kinetic_j = half * lanes::dot(&velocity, &momentum);
        let mut found = Evaluation { kinetic_j, turned_rad2, ..Evaluation::default() };
        let mut before = None;
        if !nodal.velocity_change.is_empty() {
            // What has hardly turned has hardly another product in the frame that it was in.
            let has_turned = !turned_rad2.simd_lt(f64x4::splat(TURNED_ENOUGH_RAD2)).all();
            let (v, products) = if has_turned {
                let v = lanes::rotate_back(&r_before, &velocity);
                (v, Products { k: self.stiffness.apply(&v), g: self.stiffening.as_ref().map(|s| s.galerkin.apply(&v)) })
            } else {
                (vectors[1], products(1))
            };
            let kv = self.tangent(state, &v, &products);
            let change = self.gather(&nodal.velocity_change);
            found.step = self.step_terms(state, &change, &velocity, kinetic_j, dt_s, [&v, &kv]);
            before = Some((v, products.k));
        }
        found.elastic_j = self.evaluate_forces(state, &r, &gradient, &y, &vectors[0], products(0));
        state.elastic_j = found.elastic_j;
        if RELAXES && let Some(viscosity) = &self.viscosity {
            let motion = Motion {
                rotation: &r,
                gradient: &gradient,
                position_m: &y,
                displacement_m: &vectors[0],
                velocity_m_per_s: &velocity,
                stiffness_displacement: &stiffness[0],
                stiffness_velocity: &stiffness[1],
                before: before.as_ref().map(|(v, kv)| [v, kv]),
            };
            self.evaluate_branch(viscosity, state, &motion, dt_s, balance_n, &mut found);
        }
        let kv = lanes::rotate(&r, &self.tangent(state, &vectors[1], &products(1)));
        let factor = self.beta_s + f64x4::splat(dt_s);
        self.add_to_balance(balance_n, |slot| {
            state.force_n[slot] - factor.mul_add(kv[slot], self.alpha_per_s * momentum[slot])
        });
        found
    }

    /// Adds a force on each corner's components, N, scene frame, to the sums by slot.
    #[inline(always)]
    pub(super) fn add_to_balance(&self, balance_n: &mut [f64x4], force_n: impl Fn(usize) -> f64x4) {
        let last = balance_n.len() - 1;
        for (corner, slots) in self.slots.iter().enumerate() {
            let [x, y, z] = [0, 1, 2].map(|i| force_n(3 * corner + i));
            let lanes = f64x4::transpose([x, y, z, f64x4::ZERO]);
            for lane in 0..LANES {
                balance_n[usize::from(slots[lane]).min(last)] += lanes[lane];
            }
        }
    }

    /// `y - X` for positions `y` in the rest frame, relative to the first corner.
    #[inline(always)]
    fn displacement(&self, y: &[f64x4; 24]) -> [f64x4; 24] {
        let mut u = *y;
        for corner in 0..8 {
            for i in 0..3 {
                if corner >> i & 1 == 1 {
                    u[3 * corner + i] -= self.shapes.edge_m;
                }
            }
        }
        u
    }

    #[inline(always)]
    fn deformation_gradient(&self, x: &[f64x4; 24]) -> [f64x4; 9] {
        let mut f = [f64x4::ZERO; 9];
        for a in 0..8 {
            for i in 0..3 {
                for j in 0..3 {
                    f[3 * i + j] = x[3 * a + i].mul_add(self.shapes.mean_gradient[a][j], f[3 * i + j]);
                }
            }
        }
        f
    }

    #[inline(always)]
    fn evaluate_forces(
        &self,
        state: &mut ElementState,
        r: &[f64x4; 9],
        f: &[f64x4; 9],
        y: &[f64x4; 24],
        u: &[f64x4; 24],
        products: Products,
    ) -> f64x4 {
        let mut local = products.k;
        let half = f64x4::splat(0.5);
        let mut energy_j = half * lanes::dot(u, &local);
        if let (Some(stiffening), Some(g)) = (&self.stiffening, products.g) {
            let w = half * lanes::dot(u, &g) / self.shapes.volume_m3;
            let (energy, slope, curvature) = stiffening_law(w, stiffening.rate_per_pa);
            energy_j += self.shapes.volume_m3 * energy;
            state.stiffening = slope;
            state.curvature = curvature / self.shapes.volume_m3;
            for i in 0..24 {
                local[i] = (slope - f64x4::ONE).mul_add(g[i], local[i]);
            }
            state.galerkin_force_n = g;
        }
        self.add_rotation_gradient(&mut local, y, r, f);
        let scene = lanes::rotate(r, &local);
        (0..24).for_each(|i| state.force_n[i] = -scene[i]);
        energy_j
    }

    /// Adds what the dependence of R on the positions contributes to dU/dx: `B x d_a` with
    /// `(tr(S) I - S) B = tau`, `tau = sum_a f_a x y_a`. Without it the force is off by percents and
    /// carries a net torque.
    #[inline(always)]
    pub(super) fn add_rotation_gradient(
        &self,
        local: &mut [f64x4; 24],
        y: &[f64x4; 24],
        r: &[f64x4; 9],
        f: &[f64x4; 9],
    ) {
        let mut tau = [f64x4::ZERO; 3];
        for a in 0..8 {
            let torque =
                cross([local[3 * a], local[3 * a + 1], local[3 * a + 2]], [y[3 * a], y[3 * a + 1], y[3 * a + 2]]);
            (0..3).for_each(|i| tau[i] += torque[i]);
        }
        let m = matmul_transposed_left(r, f);
        let b = solve_rotation(&m, tau);
        for a in 0..8 {
            let turned = cross(b, self.shapes.mean_gradient[a]);
            (0..3).for_each(|i| local[3 * a + i] += turned[i]);
        }
    }

    /// `K' v` in the rest frame of each element, from the products with v.
    #[inline(always)]
    fn tangent(&self, state: &ElementState, local: &[f64x4; 24], products: &Products) -> [f64x4; 24] {
        let mut kv = products.k;
        if let Some(g) = &products.g {
            let along = state.curvature * lanes::dot(&state.galerkin_force_n, local);
            for i in 0..24 {
                kv[i] = (state.stiffening - f64x4::ONE).mul_add(g[i], kv[i]);
                kv[i] = along.mul_add(state.galerkin_force_n[i], kv[i]);
            }
        }
        kv
    }

    #[inline(always)]
    fn mass_times(&self, v: &[f64x4; 24]) -> [f64x4; 24] {
        let mut out = [f64x4::ZERO; 24];
        for a in 0..8 {
            for b in 0..8 {
                let entry = corner_pair(a, b);
                for i in 0..3 {
                    out[3 * a + i] = self.shapes.mass_kg[entry].mul_add(v[3 * b + i], out[3 * a + i]);
                }
            }
        }
        out
    }

    /// Terms of a step from `state` to `velocity`, of kinetic energy `kinetic_j`, with `K' v` in the frame of
    /// `state`.
    #[inline(always)]
    fn step_terms(
        &self,
        state: &ElementState,
        change: &[f64x4; 24],
        velocity: &[f64x4; 24],
        kinetic_j: f64x4,
        dt_s: f64,
        [local, kv]: [&[f64x4; 24]; 2],
    ) -> StepTerms<f64x4> {
        let (half, dt) = (f64x4::splat(0.5), f64x4::splat(dt_s));
        let vkv = lanes::dot(local, kv);
        StepTerms {
            inertial_j: half * lanes::dot(change, &self.mass_times(change)),
            elastic_j: half * dt * dt * vkv,
            force_work_j: dt * lanes::dot(&state.force_n, velocity),
            damping_j: dt * (f64x4::splat(2.0) * self.alpha_per_s * kinetic_j + self.beta_s * vkv),
            viscous_j: f64x4::ZERO,
        }
    }
}

/// `psi - w`, `psi'` and `psi''` of the stiffening law at energy density `w`, rate = 2 c / E.
#[inline(always)]
fn stiffening_law(w: f64x4, rate: f64x4) -> (f64x4, f64x4, f64x4) {
    let limit = f64x4::splat(LINEAR_BEYOND);
    let z = rate * w;
    let inside = z.fast_min(limit);
    let beyond = z - inside;
    let e = inside.exp();
    // psi = (e^z - 1) / rate; beyond the limit its tangent.
    let slope = e;
    let excess = e * (f64x4::ONE + beyond) - f64x4::ONE - z;
    let linear = rate.simd_lt(f64x4::splat(f64::MIN_POSITIVE));
    let energy = linear.bitselect(f64x4::ZERO, excess / linear.bitselect(f64x4::ONE, rate));
    let curvature = beyond.simd_gt(f64x4::ZERO).bitselect(f64x4::ZERO, e * rate);
    (energy, slope, curvature)
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
fn improve_rotation(q: &mut [f64x4; 4], f: &[f64x4; 9]) -> f64x4 {
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
