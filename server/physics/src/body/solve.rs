//! The velocity solve of a body: its springs, its right side and its solution in the solver's vectors.

use super::{Body, Nodal};
use crate::params::StepParams;
use crate::solve::operator::masters_of;
use crate::solve::pcg::{self, Factor, Stop, System, Systems};
use crate::solve::spring::PointSpring;
use crate::solve::vectors::NODE_GRAIN;
use crate::step_io::SolveReport;
use crate::workers::Workers;
use wide::f32x4;

impl Body {
    /// Replaces the springs of the solver's operator.
    pub(crate) fn set_springs(&mut self, springs: impl Iterator<Item = PointSpring>) {
        self.solver.multigrid.set_springs(springs);
    }

    /// Norm of the impulses that loads and contacts `impulses` (node, N s) give the nodes in a step.
    pub(crate) fn applied_impulse_norm(&mut self, workers: &Workers<'_>, impulses: &[(u32, [f64; 3])]) -> f64 {
        let mut applied = std::mem::take(&mut self.scratch.applied);
        let dt = self.solver.params.dt_s;
        workers.for_chunks((&mut applied[..], &self.solver.external_n[..]), NODE_GRAIN, |_, (applied, external)| {
            applied.iter_mut().zip(external).for_each(|(a, f)| *a = f.map(|c| dt * c));
        });
        for (node, impulse) in impulses {
            (0..3).for_each(|i| applied[*node as usize][i] += impulse[i]);
        }
        self.gather_hanging(&mut applied);
        let square = |_, applied: &[[f64; 3]]| applied.iter().flatten().map(|c| c * c).sum::<f64>();
        let squares = workers.reduce_chunks(&applied[..], NODE_GRAIN, square, |a, b| a + b);
        self.scratch.applied = applied;
        squares.sqrt()
    }

    /// Solves for the change of velocity with contact impulses `impulse` (node, N s) added to the
    /// right side, to the tolerance relative to it or, if that is larger, to `scale`;
    /// `velocity_change` starts as the guess and ends as the solution.
    pub(crate) fn solve_velocity_change(
        &mut self,
        workers: &Workers<'_>,
        impulses: &[(u32, [f64; 3])],
        scale: f64,
        velocity_change: &mut Nodal,
    ) -> SolveReport {
        self.load_system(workers, impulses, velocity_change);
        let stop = self.stop(scale);
        let solve = pcg::solve(workers, self, stop);
        self.take_velocity_change(workers, velocity_change);
        SolveReport {
            iterations: solve.iterations,
            solves: 1,
            relative_residual: solve.relative_residual,
            is_unconverged: !solve.is_converged,
            ..SolveReport::default()
        }
    }

    /// Makes what preconditions the solves anew of the matrices as they are. The operator's springs are dropped.
    pub(crate) fn renew_preconditioner(&mut self, workers: &Workers<'_>) {
        self.solver.coarse_stiffening.clone_from(&self.solver.applied_stiffening);
        self.solver.multigrid.rebuild(workers, &self.state.levels);
        (self.solver.turned_rad, self.solver.unsmoothed) = (0.0, 0.0);
    }

    /// When a solve ends in which the impulses applied have the norm `scale`, N s.
    #[must_use]
    pub(crate) fn stop(&self, scale: f64) -> Stop {
        let StepParams { relative_tolerance, max_iterations, .. } = self.solver.params;
        Stop { scale, relative_tolerance, max_iterations, effort: None }
    }

    /// Writes the right side, contact impulses (node, N s) added, and the guess into the solver's vectors.
    pub(crate) fn load_system(
        &mut self,
        workers: &Workers<'_>,
        impulses: &[(u32, [f64; 3])],
        guess_m_per_s: &[[f64; 3]],
    ) {
        let scratch = &mut self.scratch;
        let data = (&mut scratch.right_side_f32[..], &scratch.right_side[..]);
        workers.for_chunks(data, NODE_GRAIN, |_, (narrowed, b)| {
            narrowed.iter_mut().zip(b).for_each(|(narrowed, b)| *narrowed = narrow(b));
        });
        let hanging = self.solver.multigrid.operator().hanging();
        for (node, impulse) in impulses {
            for (master, w) in masters_of(hanging, *node as usize) {
                scratch.right_side_f32[master] += f32x4::splat(w) * narrow(impulse);
            }
        }
        let data = (&mut scratch.solution[..], guess_m_per_s);
        workers.for_chunks(data, NODE_GRAIN, |_, (solution, guess)| {
            solution.iter_mut().zip(guess).for_each(|(solution, guess)| *solution = narrow(guess));
        });
    }

    /// What the solver works on.
    pub(crate) fn system(&mut self) -> System<'_> {
        System {
            multigrid: &mut self.solver.multigrid,
            scratch: &mut self.scratch.pcg,
            b: &self.scratch.right_side_f32,
            x: &mut self.scratch.solution,
        }
    }

    /// A spring at a point of the body, spread over the solver's unknowns.
    #[must_use]
    pub(crate) fn among_unknowns(&self, spring: &PointSpring) -> PointSpring {
        self.solver.multigrid.operator().among_unknowns(spring)
    }

    /// Adds to the solver's product what `spring` does where its point moves by `at`.
    pub(crate) fn add_to_product(&mut self, spring: &PointSpring, at: f32x4) {
        let operator = self.solver.multigrid.operator_mut();
        spring.shares(at).for_each(|(node, force)| operator.add_to_product(node, force));
    }

    /// Reads the solution out of the solver's vectors.
    pub(crate) fn take_velocity_change(&mut self, workers: &Workers<'_>, velocity_change: &mut Nodal) {
        let data = (&mut velocity_change[..], &self.scratch.solution[..]);
        workers.for_chunks(data, NODE_GRAIN, |_, (change, solution)| {
            for (change, v) in change.iter_mut().zip(solution) {
                let [x, y, z, _] = v.to_array().map(f64::from);
                *change = [x, y, z];
            }
        });
        for hanging in self.solver.multigrid.operator().hanging() {
            let mut moved = [0.0; 3];
            for (master, w) in hanging.masters {
                (0..3).for_each(|i| moved[i] += f64::from(w) * velocity_change[master as usize][i]);
            }
            velocity_change[hanging.node as usize] = moved;
        }
    }
}

/// A body that presses on no other is solved alone.
impl Systems for Body {
    fn for_each(&mut self, mut visit: impl FnMut(&mut System<'_>)) {
        visit(&mut self.system());
    }

    fn is_moot(&mut self, _: &Workers<'_>, _: f64) -> bool {
        false
    }

    fn couple(&mut self, _: Factor) {}
}

fn narrow(v: &[f64; 3]) -> f32x4 {
    f32x4::new([v[0] as f32, v[1] as f32, v[2] as f32, 0.0])
}
