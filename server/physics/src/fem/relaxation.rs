//! What the relaxing branches of four elements do as the elements move.

use super::block::{ElementBlock, ElementState, Evaluation};
use super::lanes;
use super::viscosity::ViscosityBlock;
use wide::f64x4;

/// Strain below which nothing counts as relaxed: what comes next starts from there.
const LEAST_STRAIN: f64 = 1e-10;
/// Added to an extension and taken away again it rounds to some 1e-26 m: what decays would end in subnormal
/// numbers, a hundred times as slow.
const ROUNDING_M: f64 = 1e-10;

/// Where four elements are and how they move.
pub(super) struct Motion<'a> {
    /// R and the mean deformation gradient, row-major.
    pub rotation: &'a [f64x4; 9],
    pub gradient: &'a [f64x4; 9],
    /// Positions from the first corner and displacements, rest frame, m.
    pub position_m: &'a [f64x4; 24],
    pub displacement_m: &'a [f64x4; 24],
    /// Velocities, scene frame, m/s.
    pub velocity_m_per_s: &'a [f64x4; 24],
    /// `K u` in the rest frame, N.
    pub stiffness_displacement: &'a [f64x4; 24],
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
        let (half, dt, rounding) = (f64x4::splat(0.5), f64x4::splat(dt_s), f64x4::splat(ROUNDING_M));
        let mut decay_and_gain = (f64x4::ONE, f64x4::ONE);
        if let Some([v, kv]) = motion.before {
            decay_and_gain = (data.decay, data.gain);
            found.step.elastic_j += half * dt * dt * data.tangent() * lanes::dot(v, kv);
            found.step.force_work_j -= dt * data.lost * lanes::dot(&branch.force_n, motion.velocity_m_per_s);
        }
        let (before_m, before_j) = (branch.extension_m, branch.square_j);
        for i in 0..24 {
            let moved = decay_and_gain.1 * (motion.displacement_m[i] - branch.displacement_m[i]);
            branch.extension_m[i] = decay_and_gain.0.mul_add(before_m[i], moved) + rounding - rounding;
        }
        branch.displacement_m = *motion.displacement_m;
        let kw = self.stiffness.apply(&branch.extension_m);
        branch.square_j = lanes::dot(&branch.extension_m, &kw);
        if motion.before.is_some() {
            let [after, across, before] = data.dissipation;
            found.step.viscous_j = after * branch.square_j + across * lanes::dot(&before_m, &kw) + before * before_j;
        }
        found.elastic_j += half * data.ratio * branch.square_j;
        let u = motion.displacement_m;
        let least = f64x4::splat(LEAST_STRAIN) * self.shapes.edge_m;
        let least_j = (self.stiffness.entry(0) * least).mul_add(least, f64x4::splat(f64::MIN_POSITIVE));
        let share = (lanes::dot(u, &kw) + least_j) / (lanes::dot(u, motion.stiffness_displacement) + least_j);
        branch.unrelaxed = share.fast_max(f64x4::ZERO).fast_min(f64x4::ONE);
        let mut local = kw.map(|f| data.ratio * f);
        self.add_rotation_gradient(&mut local, motion.position_m, motion.rotation, motion.gradient);
        branch.force_n = lanes::rotate(motion.rotation, &local).map(|f| f64x4::ZERO - f);
        (0..24).for_each(|i| state.force_n[i] += branch.force_n[i]);
        let kv = lanes::rotate(motion.rotation, motion.stiffness_velocity);
        let tangent = dt * data.tangent();
        self.add_to_balance(balance_n, |i| f64x4::ZERO - data.lost * branch.force_n[i] - tangent * kv[i]);
    }
}
