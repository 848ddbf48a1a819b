//! Pieces that a step would lead uphill.
//!
//! A step of implicit Euler ends at the least of `Phi(dx) = 1/2 dv^T M dv + U(x + dx) - f . dx`, which the solve finds
//! for a quadratic model of it. The model holds where a step strains little. What is strained severalfold and let go
//! within a step, as a chip between blade and table, may end above where it began: energy from nothing. It is led a
//! shorter way in the same direction, downhill by the model, as in a search along a line (Nocedal and Wright,
//! "Numerical Optimization", 2006, section 3.1).

use super::rigid_motion::share_of_turn;
use super::{Body, Nodal};
use crate::Vec3;
use crate::fem::block::{LANES, ModelFit};
use wide::f64x4;

/// A piece is led uphill if its potential rises by this fraction of its Young's modulus times volume: a strain of one
/// in a hundred. Ours.
const LEAST_OF_EV: f64 = 1e-4;

impl Body {
    /// The parts that the step that was last evaluated has led uphill, brakes having taken `taken`, m/s, of their nodes'
    /// motion; empty: they took nothing.
    pub(crate) fn find_overshot(&self, taken: &Nodal) -> Option<Vec<bool>> {
        // The model falls by `1/2 v^T A v` on the way to its bottom, and by `d^T A v` more on one that `d` is taken of.
        let uphill_j = |fit: &ModelFit| fit.above_j - fit.descent_j;
        let most_j =
            self.scratch.fits.iter().map(|fit| uphill_j(fit).fast_max(f64x4::ZERO)).sum::<f64x4>().reduce_add();
        if taken.is_empty() && most_j <= LEAST_OF_EV * self.state.rigid.least_stiff_j() {
            return None;
        }
        let velocity = |node: usize| Vec3::from(self.state.velocity_m_per_s[node]);
        // Of the motion that the solve found: what keeps the momentum of free parts was added to it.
        let taken_of_solved = |node: usize| {
            let added = self.missing_motion_at(node, self.state.saved.position_m[node].into());
            taken.get(node).map_or(Vec3::zeros(), |taken| Vec3::from(*taken)) - added
        };
        let mut by_part_j = vec![0.0; self.part_count() as usize];
        for element in 0..self.base().elements.len() {
            let sum = &mut by_part_j[self.part_of_element(element) as usize];
            *sum += uphill_j(&self.scratch.fits[element / LANES]).as_array()[element % LANES];
            *sum -= self.impulse_work_j(std::iter::once(element), velocity, taken_of_solved);
        }
        for (node, work_j) in self.geometric_work_j() {
            by_part_j[self.part_of_node(node as u32) as usize] -= work_j;
        }
        let is_overshot = |(uphill_j, stiff_j): (&f64, &f64)| *uphill_j > LEAST_OF_EV * stiff_j;
        let overshot: Vec<bool> = by_part_j.iter().zip(&self.state.rigid.stiff_j).map(is_overshot).collect();
        overshot.contains(&true).then_some(overshot)
    }

    /// Halves the motion of `parts` after a change of velocity `dv`; see [`Self::slow_parts`].
    pub(crate) fn halve_motion(&mut self, parts: &[bool], dv: &mut Nodal, taken: &mut Nodal) {
        self.slow_parts(|part, _| if parts[part] { 0.5 } else { 1.0 }, dv, taken);
    }

    /// Gives `parts` back what brakes took of their motion, and slows them as a whole to the fastest turn of a step.
    ///
    /// A brake takes a spin of a part's unstrained shape ([`Self::brake_spin`]) or of some of its elements. What is left in a
    /// part that is strained by a fifth may lead uphill however short it is. The motion that the solve found leads downhill,
    /// and so does a share of it.
    pub(crate) fn brake_as_a_whole(&mut self, parts: &[bool], dv: &mut Nodal, taken: &mut Nodal) {
        for (node, (dv, taken)) in dv.iter_mut().zip(taken.iter_mut()).enumerate() {
            if parts.get(self.part_of_node(node as u32) as usize) == Some(&true) {
                (0..3).for_each(|i| dv[i] += taken[i]);
                *taken = [0.0; 3];
            }
        }
        let dt_s = self.solver.params.dt_s;
        self.slow_parts(|part, motion| if parts[part] { share_of_turn(motion.spin, dt_s) } else { 1.0 }, dv, taken);
    }
}
