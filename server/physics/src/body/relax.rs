//! Static equilibrium under the loads, without contact: the minimum of the potential, by L-BFGS (Nocedal and Wright,
//! Numerical Optimization, 2nd ed., algorithms 7.4 and 7.5) around the step's own solver.
//!
//! The solver's matrix `M / tau^2 + K` turns with the elements but leaves out how a turn changes their forces. A slender
//! body that bends far then takes hundreds of solves; what L-BFGS learns of the rest from the steps before makes it tens.

use super::{Body, Nodal};
use crate::fem::block::LANES;
use crate::fem::lanes::for_packed;
use crate::workers::Workers;
use std::collections::VecDeque;

/// Unbalanced force over the load's norm at which the body counts as at rest.
const REST: f64 = 1e-8;
/// Of all scenes tried, the slowest took 56: a cantilever bent by P L^2 / E I = 10.
const MAX_ROUNDS: u32 = 400;
/// Time over which the mass holds back the first step, s. It grows while whole steps make the potential fall.
const FIRST_TAU_S: f64 = 0.02;
/// Beyond this the mass no longer shows in the matrix, and at 1000 s the single-precision solve stalled.
const LONGEST_TAU_S: f64 = 100.0;
/// Earlier steps that are remembered; five to twenty are usual (Nocedal and Wright, section 7.2).
const REMEMBERED: usize = 10;
/// Part of the slope along a step by which the potential has to fall (Armijo's condition).
const SUFFICIENT_FALL: f64 = 1e-4;
/// Halvings of a step before another direction is tried.
const MOST_HALVINGS: u32 = 12;
/// Change of the potential over its size that may be rounding. There the force decides.
const ROUNDING: f64 = 1e-10;

/// How a search for rest ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Relaxation {
    /// Solves that were made.
    pub solves: u32,
    /// Norm of the unbalanced force at the end over that of the loads or, where this is larger, over 1e8 times the
    /// rounding of the elements' forces.
    pub relative_residual: f64,
    /// Whether it fell below 1e-8, at which a body counts as at rest.
    pub converged: bool,
}

/// A step of the search, m, and by how much it changed the slope of the potential, N.
struct Pair {
    step_m: Nodal,
    change_n: Nodal,
    curvature_j: f64,
}

/// The earlier steps, oldest first.
#[derive(Default)]
struct Memory(VecDeque<Pair>);

impl Memory {
    /// Remembers a step, if the potential curves upward along it.
    fn remember(&mut self, step_m: Nodal, change_n: Nodal) {
        let curvature_j = dot(&step_m, &change_n);
        if curvature_j > 0.0 {
            if self.0.len() == REMEMBERED {
                self.0.pop_front();
            }
            self.0.push_back(Pair { step_m, change_n, curvature_j });
        }
    }

    /// `H q` for the inverse of the curvature H that the steps show, over `solve` where they show nothing.
    fn apply(&self, mut q: Nodal, solve: impl FnOnce(&Nodal) -> Nodal) -> Nodal {
        let weights: Vec<f64> = self
            .0
            .iter()
            .rev()
            .map(|pair| {
                let weight = dot(&pair.step_m, &q) / pair.curvature_j;
                add(&mut q, -weight, &pair.change_n);
                weight
            })
            .collect();
        let mut x = solve(&q);
        for (pair, weight) in self.0.iter().zip(weights.into_iter().rev()) {
            let other = dot(&pair.change_n, &x) / pair.curvature_j;
            add(&mut x, weight - other, &pair.step_m);
        }
        x
    }
}

/// How far on its way to rest a body is at a relative residual, 0 to 1: the residual falls by about the same factor a solve.
pub(crate) fn share_of_rest(relative_residual: f64) -> f64 {
    (relative_residual.ln() / REST.ln()).clamp(0.0, 1.0)
}

impl Body {
    /// Takes the body to rest under its loads. Velocities are zero at the end, and what relaxes in time has done so.
    /// `progress` is told the relative residual before each solve.
    pub(crate) fn relax(&mut self, workers: &Workers<'_>, progress: &mut dyn FnMut(f64)) -> Relaxation {
        let params = self.solver.params;
        let viscosity = self.set_viscosity_aside();
        self.set_time_step(workers, FIRST_TAU_S);
        let reference_n = norm(&self.solver.external_n).max(self.rounding_n() / REST);
        let mut memory = Memory::default();
        let (mut potential_j, mut unbalanced_n) = (self.potential_j(), self.unbalanced_n(workers));
        let mut end = Relaxation { solves: 0, relative_residual: 0.0, converged: false };
        for _ in 0..MAX_ROUNDS {
            end.relative_residual = norm(&unbalanced_n) / reference_n;
            progress(end.relative_residual);
            end.converged = end.relative_residual < REST;
            if end.converged {
                break;
            }
            end.solves += 1;
            let mut step_m = memory.apply(unbalanced_n.clone(), |q| self.solve_static(workers, q));
            let tau = self.solver.params.dt_s;
            match self.search(workers, &mut step_m, potential_j, &unbalanced_n) {
                Some(found) => {
                    let mut change_n = std::mem::replace(&mut unbalanced_n, found.unbalanced_n);
                    add(&mut change_n, -1.0, &unbalanced_n);
                    potential_j = found.potential_j;
                    memory.remember(step_m, change_n);
                    if found.is_whole && tau < LONGEST_TAU_S {
                        self.set_time_step(workers, (4.0 * tau).min(LONGEST_TAU_S));
                    } else {
                        self.refresh_operator(workers);
                    }
                }
                // What was learnt misleads, or the matrix does: begin anew with shorter steps.
                None => {
                    memory.0.clear();
                    self.set_time_step(workers, 0.25 * tau);
                }
            }
        }
        self.solver.params = params;
        self.take_relaxed(workers, viscosity);
        self.set_time_step(workers, params.dt_s);
        self.save_state(workers);
        end
    }

    /// Moves along `step_m`, halved until the potential falls; `None`, and the body where it was, if it does not.
    fn search(
        &mut self,
        workers: &Workers<'_>,
        step_m: &mut Nodal,
        from_j: f64,
        unbalanced_n: &Nodal,
    ) -> Option<Found> {
        let (start_m, slope_j) = (self.state.position_m.clone(), dot(unbalanced_n, step_m));
        for halvings in 0..=MOST_HALVINGS {
            self.state.position_m.clone_from(&start_m);
            add(&mut self.state.position_m, 1.0, step_m);
            self.evaluate(workers, 20);
            let (potential_j, now_n) = (self.potential_j(), self.unbalanced_n(workers));
            let falls = potential_j <= from_j - SUFFICIENT_FALL * slope_j * 0.5f64.powi(halvings as i32);
            let settles = potential_j <= from_j + ROUNDING * from_j.abs() && norm(&now_n) < norm(unbalanced_n);
            if slope_j > 0.0 && falls || settles {
                return Some(Found { potential_j, unbalanced_n: now_n, is_whole: halvings == 0 });
            }
            step_m.iter_mut().flatten().for_each(|c| *c *= 0.5);
        }
        self.state.position_m = start_m;
        self.evaluate(workers, 20);
        None
    }

    /// `(M / tau^2 + K)^-1 f`.
    fn solve_static(&mut self, workers: &Workers<'_>, force_n: &Nodal) -> Nodal {
        let tau = self.solver.params.dt_s;
        self.scratch.right_side = force_n.iter().map(|f| f.map(|c| tau * c)).collect();
        let mut change = vec![[0.0; 3]; self.node_count()];
        self.solve_velocity_change(workers, &[], 0.0, &mut change);
        change.iter_mut().flatten().for_each(|c| *c *= tau);
        change
    }

    fn potential_j(&self) -> f64 {
        let energy = self.energy();
        let displacement = (0..self.node_count()).map(|n| {
            let rest = self.rest_position_m(n);
            [0, 1, 2].map(|i| self.state.position_m[n][i] - rest[i])
        });
        energy.elastic_j - self.external_work_j(displacement)
    }

    /// What loads and elements leave unbalanced on each unknown, N.
    fn unbalanced_n(&mut self, workers: &Workers<'_>) -> Nodal {
        self.assemble_right_side(workers);
        self.scratch.right_side.iter().map(|b| b.map(|c| c / self.solver.params.dt_s)).collect()
    }

    /// What rounding may leave of the forces at rest, N: they are made of coordinates times stiffness. On beams, blocks
    /// and livers, held or not, it left 0.1 to 0.31 of their product.
    fn rounding_n(&self) -> f64 {
        let mut stiffness_n_per_m = vec![[0.0; 3]; self.node_count()];
        for (element, of) in self.base().elements.iter().enumerate() {
            let matrix = &self.solver.blocks[element / LANES].stiffness;
            for_packed(|index, row, column| {
                if row == column {
                    stiffness_n_per_m[of.nodes[row / 3] as usize][row % 3] += matrix.at(index, element % LANES);
                }
            });
        }
        let farthest_m = self.state.position_m.iter().flatten().fold(0.0, |most: f64, c| most.max(c.abs()));
        f64::EPSILON * farthest_m * norm(&stiffness_n_per_m)
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

/// Where a step of the search ended.
struct Found {
    potential_j: f64,
    unbalanced_n: Nodal,
    /// Whether the step was taken as it was proposed.
    is_whole: bool,
}

fn dot(a: &Nodal, b: &Nodal) -> f64 {
    a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| a * b).sum()
}

fn norm(a: &Nodal) -> f64 {
    dot(a, a).sqrt()
}

/// `a += factor b`.
fn add(a: &mut Nodal, factor: f64, b: &Nodal) {
    a.iter_mut().flatten().zip(b.iter().flatten()).for_each(|(a, b)| *a += factor * b);
}
