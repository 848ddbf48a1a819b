//! Whether a body is at rest: no velocity and no unbalanced force that a solve would resolve.

use super::{Body, Nodal};
use crate::fem::block::LANES;
use crate::workers::Workers;

/// Strain that counts as none whatever a body carries: forces that strain every element by no more than this are
/// balanced. A body that carries nothing has no load to which a tolerance could be relative. Ten times more, and a
/// body that has sprung back comes to rest as much earlier as it damps to a tenth in. Far below strains that loads of
/// a ten-thousandth of E cause.
const LEAST_STRAIN: f64 = 1e-8;

impl Body {
    /// Whether the body is at rest under its loads and `impulses` (node, N s), what contacts give it in a step.
    /// `applied_n_s` is the norm of all that was applied in the solve, `kinetic_j` the body's kinetic energy.
    ///
    /// It is where neither the momentum of its nodes nor the impulse of the forces that are left unbalanced is larger
    /// than the residual at which a solve ends. Stopped there it stays: a solve that starts from no velocity finds
    /// that none is a solution. What relaxes in time must have done so to the same limit: it is what still would have
    /// been lost of the force.
    pub(crate) fn is_at_rest(&mut self, impulses: &[(u32, [f64; 3])], applied_n_s: f64, kinetic_j: f64) -> bool {
        let limit_n_s =
            (self.solver.params.relative_tolerance * applied_n_s).max(self.solver.params.dt_s * self.least_force_n());
        // The largest eigenvalue of the mass is no more than the heaviest node.
        let momentum_n_s = (2.0 * kinetic_j * self.heaviest_node_kg()).sqrt();
        momentum_n_s <= limit_n_s && self.unbalanced_n_s(impulses) <= limit_n_s && self.unrelaxed_n_s() <= limit_n_s
    }

    /// Stops the body where it is.
    pub(crate) fn halt(&mut self, workers: &Workers<'_>) {
        self.state.velocity_m_per_s.fill([0.0; 3]);
        self.state.rigid.forget_turns();
        self.evaluate(workers, 2);
    }

    /// Norm of the nodes' forces under [`LEAST_STRAIN`], N: `E H^2` times it at each.
    fn least_force_n(&self) -> f64 {
        LEAST_STRAIN * self.state.rigid.stiff_j() / (self.largest_edge_m() * (self.node_count() as f64).sqrt())
    }

    /// Bound on the mass that moves with a node, kg.
    fn heaviest_node_kg(&self) -> f64 {
        let densities = self.description.materials.iter().map(|m| m.elastic.density_kg_per_m3);
        densities.fold(0.0, f64::max) * self.largest_edge_m().powi(3)
    }

    /// Norm of the impulse that elastic forces, loads and `impulses` leave in a step without velocities, N s.
    fn unbalanced_n_s(&mut self, impulses: &[(u32, [f64; 3])]) -> f64 {
        let dt = self.solver.params.dt_s;
        let mut sum = std::mem::take(&mut self.scratch.applied);
        sum.iter_mut().zip(&self.solver.external_n).for_each(|(sum, force)| *sum = force.map(|f| dt * f));
        for (index, element) in self.base().elements.iter().enumerate() {
            let force_n = &self.state.elements[index / LANES].force_n;
            for (corner, &node) in element.nodes.iter().enumerate() {
                let at = |i: usize| force_n[3 * corner + i].as_array()[index % LANES];
                (0..3).for_each(|i| sum[node as usize][i] += dt * at(i));
            }
        }
        for (node, impulse) in impulses {
            (0..3).for_each(|i| sum[*node as usize][i] += impulse[i]);
        }
        self.norm_of(sum)
    }

    /// Norm of the impulse of what is going to relax, N s.
    fn unrelaxed_n_s(&mut self) -> f64 {
        if !self.is_viscous() {
            return 0.0;
        }
        let dt = self.solver.params.dt_s;
        let mut sum = std::mem::take(&mut self.scratch.applied);
        sum.fill([0.0; 3]);
        for (index, element) in self.base().elements.iter().enumerate() {
            let Some(branch) = &self.state.elements[index / LANES].branch else { continue };
            for (corner, &node) in element.nodes.iter().enumerate() {
                let at = |i: usize| branch.force_n[3 * corner + i].as_array()[index % LANES];
                (0..3).for_each(|i| sum[node as usize][i] += dt * at(i));
            }
        }
        self.norm_of(sum)
    }

    /// Norm of a sum over the solver's unknowns; hands the vector back to the scratch.
    fn norm_of(&mut self, mut sum: Nodal) -> f64 {
        self.gather_hanging(&mut sum);
        let square: f64 = sum.iter().flatten().map(|c| c * c).sum();
        self.scratch.applied = sum;
        square.sqrt()
    }
}
