//! Geometric stiffness of stressed elements whose cells are not full.
//!
//! A stressed element resists being turned by its stress alone, which the corotational matrix does not have. Where a
//! few voxels of a cell hang on, little else resists: each step would throw them past where they are to stand, for
//! ever. The tangent gets the geometric stiffness of what is in tension, `T_ab = V d_a . sigma+ d_b` on each axis, with
//! the mean gradients d of the filled volume V and the positive part of the stress: what is compressed would make it
//! indefinite. Forces, and so where anything comes to rest, stay as they are.

use super::Body;
use crate::fem::block::LANES;
use crate::grid::VoxelId;
use crate::{Mat3, Vec3};
use serde::{Deserialize, Serialize};

/// Strain below which the tangent does without. A liver that is diced by twenty plunges at 250 Hz takes 2.2 iterations a
/// solve; 6.9 with a quarter of this strain and 4.5 with five times of it. Without geometric stiffness it takes 11.8, and
/// two steps are rolled back.
const LEAST_STRAIN: f64 = 0.02;
/// The tangent follows when the stress has changed by this fraction. With a quarter of it the dicing takes 3.0 iterations
/// a solve, with two and a half times of it 2.6.
const CHANGE: f64 = 0.2;
/// Time in which the tangent comes to follow all elements, s. Ours: short beside what strain takes to change by
/// [`CHANGE`] under a hand. A step looks at part of the elements, in turn, so that a liver at 1 kHz does not look at all
/// of them in each millisecond. No other value was measured.
const FOLLOWS_IN_S: f64 = 8e-3;
/// Most steps that this takes: as many as at 1 kHz. Ours: until its turn comes, an element that was stressed anew is
/// solved without its tension, which takes more iterations and may throw too far what little hangs there (see
/// [`LEAST_STRAIN`]). At 10 kHz, the highest rate, that could else last 80 steps. No other value was measured.
const MOST_TURNS: usize = 8;
/// A cell that is filled by this fraction is full.
const FULL: f64 = 1.0 - 1e-9;

/// An element whose cell is not full.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct GeometricStiffness {
    element: u32,
    gradient_per_m: [Vec3; 8],
    /// `V E`, by the mean Young's modulus of its voxels, J.
    stiffness_j: f64,
    /// `V sigma` in the element's frame, J, that the tangent was made of; zero where it does without.
    stress_j: Mat3,
    /// Its positive part.
    tension_j: Mat3,
}

impl GeometricStiffness {
    fn is_idle(&self) -> bool {
        self.stress_j == Mat3::zeros()
    }

    /// `T_ab`, N/m.
    pub(super) fn stiffness_n_per_m(&self, a: usize, b: usize) -> f64 {
        self.gradient_per_m[a].dot(&(self.tension_j * self.gradient_per_m[b]))
    }

    /// `T v` at the corners.
    fn apply(&self, v: &[Vec3; 8]) -> [Vec3; 8] {
        let gradient: Mat3 = v.iter().zip(&self.gradient_per_m).map(|(v, d)| v * d.transpose()).sum();
        let pull = gradient * self.tension_j;
        self.gradient_per_m.map(|d| pull * d)
    }
}

impl Body {
    /// Takes an element that was rebuilt, at rest for now, among those with geometric stiffness, unless its cell is full.
    pub(super) fn begin_geometric_stiffness(&mut self, element: usize, voxels: &[VoxelId]) {
        let found = self.solver.geometric.binary_search_by_key(&(element as u32), |s| s.element);
        if self.filled_volume_m3(element) > FULL * self.element_edge_m(element).powi(3) {
            if let Ok(at) = found {
                self.solver.geometric.remove(at);
            }
            return;
        }
        let gradient_per_m = self.mean_gradient_per_m(element);
        let young_pa: f64 = voxels.iter().map(|v| self.material_of(*v).young_modulus_pa).sum();
        let stiffness_j = young_pa / voxels.len() as f64 * self.filled_volume_m3(element);
        let (stress_j, tension_j) = (Mat3::zeros(), Mat3::zeros());
        let begun = GeometricStiffness { element: element as u32, gradient_per_m, stiffness_j, stress_j, tension_j };
        match found {
            Ok(at) => self.solver.geometric[at] = begun,
            Err(at) => self.solver.geometric.insert(at, begun),
        }
    }

    /// Geometric stiffness of an element, if it has any.
    pub(super) fn geometric_stiffness(&self, element: usize) -> Option<&GeometricStiffness> {
        let found = self.solver.geometric.binary_search_by_key(&(element as u32), |s| s.element).ok()?;
        Some(&self.solver.geometric[found]).filter(|found| !found.is_idle())
    }

    /// `T v` at the corners of each element with geometric stiffness, by node, N/s.
    pub(super) fn geometric_pulls(&self) -> impl Iterator<Item = ([usize; 8], [Vec3; 8])> + '_ {
        self.solver.geometric.iter().filter(|found| !found.is_idle()).map(|found| {
            let nodes = self.base().elements[found.element as usize].nodes.map(|n| n as usize);
            (nodes, found.apply(&nodes.map(|n| Vec3::from(self.state.velocity_m_per_s[n]))))
        })
    }

    /// `dx^T T dx` of the geometric stiffness over the step that led to the velocities, J, and a node of the element that it is of.
    pub(super) fn geometric_work_j(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        let dt = self.solver.params.dt_s;
        self.geometric_pulls().map(move |(nodes, pulls)| {
            let v = nodes.map(|n| Vec3::from(self.state.velocity_m_per_s[n]));
            (nodes[0], dt * dt * v.iter().zip(pulls).map(|(v, pull)| v.dot(&pull)).sum::<f64>())
        })
    }

    /// Brings the matrices of stressed elements to the stress of now: of some of them in a step that is short beside
    /// [`FOLLOWS_IN_S`], in turn. Returns the largest change of stress that this made, over Young's modulus.
    pub(super) fn follow_stress(&mut self) -> f64 {
        let turns = ((FOLLOWS_IN_S / self.solver.params.dt_s) as usize).clamp(1, MOST_TURNS);
        self.solver.geometric_turn = (self.solver.geometric_turn + 1) % turns;
        let (mut most_change, stiffens) = (0.0f64, self.stiffens());
        for at in (self.solver.geometric_turn..self.solver.geometric.len()).step_by(turns) {
            let element = self.solver.geometric[at].element as usize;
            let energy_j = self.state.elements[element / LANES].elastic_j.as_array()[element % LANES];
            let is_strained = 2.0 * energy_j > self.solver.geometric[at].stiffness_j * LEAST_STRAIN * LEAST_STRAIN;
            let stress_j = if is_strained { self.element_stress_j(element) } else { Mat3::zeros() };
            let change_j = (stress_j - self.solver.geometric[at].stress_j).norm();
            if change_j > CHANGE * stress_j.norm() {
                let geometric = &mut self.solver.geometric[at];
                let axes = stress_j.symmetric_eigen();
                let positive = Mat3::from_diagonal(&axes.eigenvalues.map(|value| value.max(0.0)));
                geometric.tension_j = axes.eigenvectors * positive * axes.eigenvectors.transpose();
                geometric.stress_j = stress_j;
                most_change = most_change.max(change_j / geometric.stiffness_j);
                self.write_matrix(element);
                if !stiffens {
                    self.solver.multigrid.operator_mut().share_matrix(element, &mut Vec::new());
                }
            }
        }
        most_change
    }
}
