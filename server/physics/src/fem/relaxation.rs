//! What the relaxing branches of four elements do as the elements move.

use super::block::{ElementBlock, ElementState, Evaluation};
use super::lanes;
use super::matrices::GROUND;
use super::rotation::Placed;
use super::viscosity::ViscosityBlock;
use wide::f64x4;

/// Strain below which nothing counts as relaxed: what comes next starts from there.
const LEAST_STRAIN: f64 = 1e-10;
/// Added to an extension and taken away again it rounds to some 1e-26 m: what decays would end in subnormal
/// numbers, a hundred times as slow.
const ROUNDING_M: f64 = 1e-10;

/// Where four elements are and how they move.
pub(super) struct Motion<'a> {
    pub placed: &'a Placed<'a>,
    /// Velocities, scene frame, m/s.
    pub velocity_m_per_s: &'a [f64x4; 24],
    /// `u^T K u`, ground points included, J.
    pub stretched_j: f64x4,
    /// `K v` in the rest frame, N/s.
    pub stiffness_velocity: &'a [f64x4; 24],
    /// v and `K v` in the rest frame before the step, where there was a step.
    pub before: Option<[&'a [f64x4; 24]; 2]>,
}

impl ElementBlock {
    /// Brings the branches to where the elements are, a step later or at once, and adds what they do: to
    /// the forces, to the energies, and to `balance_n` the forces as the next step starts from them,
    /// `s e K w - dt s g K v`, less those that the state's forces hold already.
    pub(super) fn evaluate_branch(
        &self,
        data: &ViscosityBlock,
        state: &mut ElementState,
        motion: &Motion<'_>,
        dt_s: f64,
        balance_n: &mut [f64x4],
        found: &mut Evaluation,
    ) {
        let Some(branch) = state.branch.as_deref_mut() else { return };
        let (dt, rounding) = (f64x4::splat(dt_s), f64x4::splat(ROUNDING_M));
        let mut decay_and_gain = (f64x4::ONE, f64x4::ONE);
        if let Some([v, kv]) = motion.before {
            decay_and_gain = (data.decay, data.gain);
            found.step.elastic_j += f64x4::splat(0.5) * dt * dt * data.tangent() * lanes::dot(v, kv);
            found.step.force_work_j -= dt * data.lost * lanes::dot(&branch.force_n, motion.velocity_m_per_s);
        }
        let placed = motion.placed;
        let (before_m, before_j) = (branch.extension_m, branch.square_j);
        let before_ground_m = branch.ground_extension_m;
        let extend = |extension_m: &mut [f64x4], displacement_m: &mut [f64x4], now_m: &[f64x4]| {
            for ((w, u), now) in extension_m.iter_mut().zip(displacement_m).zip(now_m) {
                let moved = decay_and_gain.1 * (*now - *u);
                *w = decay_and_gain.0.mul_add(*w, moved) + rounding - rounding;
                *u = *now;
            }
        };
        extend(&mut branch.extension_m, &mut branch.displacement_m, placed.displacement_m);
        if let Some(points) = &placed.ground {
            let (extension_m, before_m) = (&mut branch.ground_extension_m, &mut branch.ground_displacement_m);
            extend(extension_m, before_m, &points.displacement_m);
        }
        let u = placed.displacement_m;
        let mut kw = self.stiffness.apply(&branch.extension_m);
        let on_ground = self
            .ground
            .as_deref()
            .map(|ground| ground.stiffness.add_force(&branch.extension_m, &branch.ground_extension_m, &mut kw));
        // Products with what the branch pulls with, corners and ground points.
        let along = |corners: &[f64x4; 24], ground: &[f64x4; GROUND]| {
            lanes::dot(corners, &kw) + on_ground.as_ref().map_or(f64x4::ZERO, |force| lanes::dot(ground, force))
        };
        branch.square_j = along(&branch.extension_m, &branch.ground_extension_m);
        if motion.before.is_some() {
            let [after, across, before] = data.dissipation;
            let across_j = along(&before_m, &before_ground_m);
            found.step.viscous_j = after * branch.square_j + across * across_j + before * before_j;
        }
        found.elastic_j += data.stored_j(branch);
        let least = f64x4::splat(LEAST_STRAIN) * self.shapes.edge_m;
        let least_j = (self.stiffness.entry(0) * least).mul_add(least, f64x4::splat(f64::MIN_POSITIVE));
        let share = (along(u, &branch.ground_displacement_m) + least_j) / (motion.stretched_j + least_j);
        branch.unrelaxed = share.fast_max(f64x4::ZERO).fast_min(f64x4::ONE);
        let mut local = kw.map(|f| data.ratio * f);
        let on_ground_n = on_ground.map(|force| force.map(|f| data.ratio * f));
        self.add_rotation_gradient(&mut local, placed, on_ground_n.as_ref());
        branch.force_n = lanes::rotate(placed.rotation, &local).map(|f| f64x4::ZERO - f);
        (0..24).for_each(|i| state.force_n[i] += branch.force_n[i]);
        if let (Some(sum), Some(force)) = (&mut state.ground_force_n, on_ground_n) {
            sum.iter_mut().zip(force).for_each(|(sum, force)| *sum += force);
        }
        let kv = lanes::rotate(placed.rotation, motion.stiffness_velocity);
        let tangent = dt * data.tangent();
        self.add_to_balance(balance_n, |i| f64x4::ZERO - data.lost * branch.force_n[i] - tangent * kv[i]);
    }
}
