//! Rotations and exact co-rotational forces, four elements at a time.
//!
//! Energy of an element: `U = 1/2 u^T K u + V (psi(w) - w)`, `u = R^T x - S X`, R the rotation of the mean deformation
//! gradient, S the stretch to the shape that it would take if it were free (1 but for prestrain),
//! `w = 1/2 u^T K_G u / V`, `psi(w) = E/(2c) (exp(2 c w / E) - 1)`: strain stiffening, uniaxially
//! `sigma = E eps exp(c eps^2)`; the second term is absent for c = 0. What relaxes in time stands beside it:
//! [`super::relaxation`].

use super::block::{ElementBlock, ElementState, Evaluation, NodalBuffers, StepTerms};
use super::composite::corner_pair;
use super::ground::GroundLanes;
use super::lanes;
use super::matrices::GROUND;
use super::packed::PackedMatrix;
use super::relaxation::Motion;
use super::rotation::{Placed, improve_rotation, rotation_matrix};
use wide::{f32x4, f64x4};

/// Exponent `2 c w / E` beyond which the stiffening energy goes on along its tangent: 400 times as
/// stiff as at rest, and no more, whatever a blade or a bad start does to an element. (Growing on,
/// even as a parabola, one linearised step no longer bounds the energy.)
const LINEAR_BEYOND: f64 = 6.0;

/// Elements whose stiffening factor is within this of 1 keep the matrix of the rest state.
const STIFFENING_THRESHOLD: f64 = 0.02;

/// Below this the power series of [`excess_series`] is exact to rounding: its first missing term, over the sum, is
/// `2 z^7 / 9!` = 1e-16.
const SERIES_BELOW: f64 = 0.03;

/// A rotation that was improved by less than 1e-4 rad is off by less than 1e-8 rad after it: the steps
/// converge quadratically.
const TURNED_ENOUGH_RAD2: f64 = 1e-8;

/// Products of an element's stiffness matrices with a vector in its rest frame.
struct Products {
    k: [f64x4; 24],
    /// Of the Galerkin stiffness, where the element stiffens.
    g: Option<[f64x4; 24]>,
}

impl ElementBlock {
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
        // Compiled thrice: even untaken, the way through a branch makes the other one slower by 6 %.
        match (&self.ground, &self.viscosity) {
            (Some(_), _) => self.evaluate_as::<true, true>(state, nodal, balance_n, dt_s, iterations),
            (None, Some(_)) => self.evaluate_as::<true, false>(state, nodal, balance_n, dt_s, iterations),
            (None, None) => self.evaluate_as::<false, false>(state, nodal, balance_n, dt_s, iterations),
        }
    }

    /// Elastic energy of a state, of what relaxes too, J.
    pub fn elastic_j(&self, state: &ElementState) -> f64x4 {
        match (&self.viscosity, &state.branch) {
            (Some(viscosity), Some(branch)) => state.elastic_j + viscosity.stored_j(branch),
            _ => state.elastic_j,
        }
    }

    fn evaluate_as<const RELAXES: bool, const HELD: bool>(
        &self,
        state: &mut ElementState,
        nodal: &NodalBuffers,
        balance_n: &mut [f64x4],
        dt_s: f64,
        iterations: u32,
    ) -> Evaluation {
        let ground = if HELD { self.ground.as_deref() } else { None };
        let mut x = self.gather(&nodal.position_m);
        let first = [x[0], x[1], x[2]];
        let origin = ground.map_or(first, |ground| ground.origin_m(first));
        (0..24).for_each(|i| x[i] -= origin[i % 3]);
        let mut gradient = self.deformation_gradient(&x);
        if let Some(ground) = ground {
            (0..9).for_each(|i| gradient[i] += ground.gradient[i]);
        }
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
        // What is not held resists no translation: of the velocities what differs from the first corner's counts.
        let mut strain_velocity = velocity;
        if !HELD {
            (0..24).for_each(|i| strain_velocity[i] -= velocity[i % 3]);
        }
        // The stiffness is most of what an evaluation reads: once for both.
        let vectors = [self.displacement(&y), lanes::rotate_back(&r, &strain_velocity)];
        let product = |matrix: &PackedMatrix<f64x4>| match HELD {
            true => matrix.apply_to_each(&vectors),
            false => matrix.apply_from_first_corner(&vectors),
        };
        let stiffness = product(&self.stiffness);
        let galerkin = self.stiffening.as_ref().map(|s| product(&s.galerkin));
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
                let v = lanes::rotate_back(&r_before, &strain_velocity);
                (v, Products { k: self.stiffness.apply(&v), g: self.stiffening.as_ref().map(|s| s.galerkin.apply(&v)) })
            } else {
                (vectors[1], products(1))
            };
            let kv = self.tangent(state, &v, &products);
            let change = self.gather(&nodal.velocity_change);
            found.step = self.step_terms(state, &change, [&velocity, &momentum], kinetic_j, dt_s, [&v, &kv]);
            before = Some((v, products.k));
        }
        let placed = Placed {
            rotation: &r,
            gradient: &gradient,
            position_m: &y,
            displacement_m: &vectors[0],
            ground: ground.map(|ground| ground.points(&r, self.shapes.edge_m, self.free_edges_m.as_deref())),
        };
        let (elastic_j, linear_j) = self.evaluate_forces(state, &placed, products(0));
        found.elastic_j = elastic_j;
        state.elastic_j = elastic_j;
        if RELAXES && let Some(viscosity) = &self.viscosity {
            let motion = Motion {
                placed: &placed,
                velocity_m_per_s: &velocity,
                stretched_j: f64x4::splat(2.0) * linear_j,
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

    /// `y - S X` for positions `y` in the rest frame, relative to the first corner.
    #[inline(always)]
    fn displacement(&self, y: &[f64x4; 24]) -> [f64x4; 24] {
        let mut u = *y;
        if let Some(free_edges_m) = self.free_edges_m.as_deref() {
            for (i, u) in u.iter_mut().enumerate() {
                let (corner, axis) = (i / 3, i % 3);
                (0..3).filter(|edge| corner >> edge & 1 == 1).for_each(|edge| *u -= free_edges_m[3 * axis + edge]);
            }
            return u;
        }
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

    /// Forces into the state. Returns the elastic energy, and what of it is linear elasticity's, J.
    #[inline(always)]
    fn evaluate_forces(&self, state: &mut ElementState, placed: &Placed<'_>, products: Products) -> (f64x4, f64x4) {
        let Placed { displacement_m: u, rotation: r, .. } = placed;
        let mut local = products.k;
        let half = f64x4::splat(0.5);
        let mut energy_j = half * lanes::dot(u, &local);
        let ground = self.ground.as_deref().map(|ground| &ground.stiffness);
        let mut on_ground_n = on_ground(placed, ground, &mut local, &mut energy_j);
        let linear_j = energy_j;
        if let (Some(stiffening), Some(mut g)) = (&self.stiffening, products.g) {
            let mut w_j = half * lanes::dot(u, &g);
            let measured_n = on_ground(placed, stiffening.ground.as_ref(), &mut g, &mut w_j);
            let (energy, slope, curvature) = stiffening_law(w_j / self.shapes.volume_m3, stiffening.rate_per_pa);
            energy_j += self.shapes.volume_m3 * energy;
            state.stiffening = slope;
            state.curvature = curvature / self.shapes.volume_m3;
            for i in 0..24 {
                local[i] = (slope - f64x4::ONE).mul_add(g[i], local[i]);
            }
            for (force, measured) in on_ground_n.iter_mut().flatten().zip(measured_n.iter().flatten()) {
                *force = (slope - f64x4::ONE).mul_add(*measured, *force);
            }
            state.galerkin_force_n = g;
        }
        self.add_rotation_gradient(&mut local, placed, on_ground_n.as_ref());
        if let (Some(kept), Some(found)) = (&mut state.ground_force_n, on_ground_n) {
            **kept = found;
        }
        let scene = lanes::rotate(r, &local);
        (0..24).for_each(|i| state.force_n[i] = -scene[i]);
        (energy_j, linear_j)
    }

    /// `K' v` in the rest frame of each element, from the products with v; K where K' is so near it that the system's
    /// matrix has K.
    #[inline(always)]
    fn tangent(&self, state: &ElementState, local: &[f64x4; 24], products: &Products) -> [f64x4; 24] {
        let mut kv = products.k;
        if let Some(g) = &products.g {
            let [rise, curvature] = state.stiffening_of_matrix();
            let along = curvature * lanes::dot(&state.galerkin_force_n, local);
            for i in 0..24 {
                kv[i] = rise.mul_add(g[i], kv[i]);
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
        [velocity, momentum]: [&[f64x4; 24]; 2],
        kinetic_j: f64x4,
        dt_s: f64,
        [local, kv]: [&[f64x4; 24]; 2],
    ) -> StepTerms<f64x4> {
        let (half, dt) = (f64x4::splat(0.5), f64x4::splat(dt_s));
        let vkv = lanes::dot(local, kv);
        StepTerms {
            inertial_work_j: lanes::dot(change, momentum),
            elastic_j: half * dt * dt * vkv,
            force_work_j: dt * lanes::dot(&state.force_n, velocity),
            damping_j: dt * (f64x4::splat(2.0) * self.alpha_per_s * kinetic_j + self.beta_s * vkv),
            viscous_j: f64x4::ZERO,
        }
    }
}

impl ElementState {
    /// `psi' - 1` and `psi''` as the system's matrix has them: 0 where `psi' - 1` is at most [`STIFFENING_THRESHOLD`].
    #[inline(always)]
    #[must_use]
    pub fn stiffening_of_matrix(&self) -> [f64x4; 2] {
        let rise = self.stiffening - f64x4::ONE;
        let is_stiffer = rise.simd_gt(f64x4::splat(STIFFENING_THRESHOLD));
        [rise, self.curvature].map(|v| is_stiffer.bitselect(v, f64x4::ZERO))
    }
}

/// `exp(z) - 1 - z` by its power series up to `z^8 / 8!`: the difference itself would leave nothing but rounding of an
/// element near rest, and a search for the least potential would follow that.
#[inline(always)]
fn excess_series(z: f64x4) -> f64x4 {
    let sum = (3..=8).rev().fold(f64x4::ONE, |sum, n| (z * f64x4::splat(1.0 / f64::from(n))).mul_add(sum, f64x4::ONE));
    f64x4::splat(0.5) * z * z * sum
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
    let excess =
        z.simd_lt(f64x4::splat(SERIES_BELOW)).bitselect(excess_series(z), e * (f64x4::ONE + beyond) - f64x4::ONE - z);
    let linear = rate.simd_lt(f64x4::splat(f64::MIN_POSITIVE));
    let energy = linear.bitselect(f64x4::ZERO, excess / linear.bitselect(f64x4::ONE, rate));
    let curvature = beyond.simd_gt(f64x4::ZERO).bitselect(f64x4::ZERO, e * rate);
    (energy, slope, curvature)
}

/// Adds what is held to forces `local` of the corners and to an energy; returns the force on the ground points.
#[inline(always)]
fn on_ground(
    placed: &Placed<'_>,
    stiffness: Option<&GroundLanes>,
    local: &mut [f64x4; 24],
    energy_j: &mut f64x4,
) -> Option<[f64x4; GROUND]> {
    let (stiffness, points) = (stiffness?, placed.ground.as_ref()?);
    let of_corners = *local;
    let on_ground_n = stiffness.add_force(placed.displacement_m, &points.displacement_m, local);
    // The coupling's part of u . f counts for the corners here, for the ground points there.
    let coupled: [f64x4; 24] = std::array::from_fn(|i| local[i] - of_corners[i]);
    let both = lanes::dot(placed.displacement_m, &coupled) + lanes::dot(&points.displacement_m, &on_ground_n);
    *energy_j += f64x4::splat(0.5) * both;
    Some(on_ground_n)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stiffening_energy_is_the_integral_of_its_slope_however_small() {
        // By Simpson's rule in the exponent z, which the slope depends on alone.
        let rate = 2e-3;
        let psi = |z: f64| stiffening_law(f64x4::splat(z / rate), f64x4::splat(rate));
        for z in [1e-30, 1e-12, 1e-6, 1e-3, 0.0299, 0.0301, 0.1] {
            let slope_less_one = |z: f64| z.exp_m1();
            let integral = z / 6.0 * (4.0 * slope_less_one(0.5 * z) + slope_less_one(z)) / rate;
            let energy = psi(z).0.as_array()[0];
            assert!((energy / integral - 1.0).abs() < 1e-8 + 1e-3 * z * z, "z {z}: {energy} for {integral}");
        }
    }
}
