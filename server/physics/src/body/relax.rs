//! Static equilibrium under the loads, without contact.

use super::Body;
use crate::workers::Workers;

/// Unbalanced force over the load's norm at which the body counts as at rest.
const REST: f64 = 1e-8;
const MAX_ROUNDS: u32 = 400;
/// Beyond this the mass no longer shows in the matrix, and at 1000 s the single-precision solve stalled.
const LONGEST_TAU_S: f64 = 100.0;

/// How a search for rest ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Relaxation {
    /// Solves that were made.
    pub solves: u32,
    /// Norm of the unbalanced force over that of the loads, at the end.
    pub relative_residual: f64,
    /// Whether it fell below the limit at which a body counts as at rest.
    pub converged: bool,
}

impl Body {
    /// Newton steps with a mass term, `(M / tau^2 + K) dx = f`; tau grows while the energy falls and
    /// shrinks where it rises. Velocities are zero at the end, and what relaxes in time has done so.
    pub fn relax(&mut self, workers: &Workers<'_>, progress: &mut dyn FnMut(f64)) -> Relaxation {
        let params = self.solver.params;
        let viscosity = self.set_viscosity_aside();
        let mut tau = 0.02;
        self.set_time_step(workers, tau);
        let mut best = self.potential_j();
        let mut change = vec![[0.0; 3]; self.node_count()];
        let mut end = Relaxation { solves: 0, relative_residual: 0.0, converged: false };
        for _ in 0..MAX_ROUNDS {
            self.assemble_right_side(workers);
            let unbalanced = self.unbalanced_force();
            progress(unbalanced);
            end.relative_residual = unbalanced;
            end.converged = unbalanced < REST;
            if end.converged {
                break;
            }
            end.solves += 1;
            change.iter_mut().for_each(|v| *v = [0.0; 3]);
            self.solve_velocity_change(workers, &[], 0.0, &mut change);
            let saved = self.state.position_m.clone();
            for (x, v) in self.state.position_m.iter_mut().zip(&change) {
                (0..3).for_each(|i| x[i] += tau * v[i]);
            }
            self.evaluate(workers, 20);
            let energy = self.potential_j();
            // Near rest the energy's change drowns in its rounding; there the force decides.
            let falls = energy <= best + 1e-12 * best.abs();
            let mut settles = || {
                self.assemble_right_side(workers);
                energy <= best + 1e-8 * best.abs() && self.unbalanced_force() < unbalanced
            };
            if falls || settles() {
                best = energy;
                let grown = (4.0 * tau).min(LONGEST_TAU_S);
                if grown > tau {
                    tau = grown;
                    self.set_time_step(workers, tau);
                } else {
                    self.refresh_operator(workers);
                }
            } else {
                self.state.position_m = saved;
                self.evaluate(workers, 20);
                tau *= 0.25;
                self.set_time_step(workers, tau);
            }
        }
        self.solver.params = params;
        self.take_relaxed(workers, viscosity);
        self.set_time_step(workers, params.dt_s);
        self.save_finite_state(workers);
        end
    }

    fn potential_j(&self) -> f64 {
        let energy = self.energy();
        let displacement = (0..self.node_count()).map(|n| {
            let rest = self.rest_position_m(n);
            [0, 1, 2].map(|i| self.state.position_m[n][i] - rest[i])
        });
        energy.elastic_j + energy.hold_j - self.external_work_j(displacement)
    }

    fn unbalanced_force(&self) -> f64 {
        let norm = |v: &[[f64; 3]]| v.iter().flatten().map(|c| c * c).sum::<f64>().sqrt();
        norm(&self.scratch.right_side)
            / (self.solver.params.dt_s * norm(&self.solver.external_n)).max(f64::MIN_POSITIVE)
    }

    fn set_time_step(&mut self, workers: &Workers<'_>, dt_s: f64) {
        self.solver.params.dt_s = dt_s;
        self.state.velocity_m_per_s.iter_mut().for_each(|v| *v = [0.0; 3]);
        self.evaluate(workers, 2);
        for element in 0..self.base().elements.len() {
            self.write_matrix(element);
            self.solver.coarse_stiffening[element] = self.solver.applied_stiffening[element];
        }
        self.write_rotations(workers);
        self.solver.multigrid.rebuild(workers, &self.state.levels);
        self.share_system_matrices();
    }
}
