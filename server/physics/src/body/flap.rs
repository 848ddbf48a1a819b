//! Flaps that a step would throw about are braked.
//!
//! The solve moves every node along a straight line and takes an element's force for linear in it. That holds while
//! elements turn by little in a step. What hangs on by a face or an edge, light and let go by a blade, may turn by more
//! than a radian: the straight line then stretches it severalfold, which is energy from nothing.

use super::rigid::take_motion;
use super::{Body, Nodal};
use crate::{Mat3, Vec3};

/// The middle of an element turns by at most this in a step, rad, if it is a flap. One that hangs by a face turns about
/// that face by twice as much, and is widened by 17 %.
const MOST_TURN_RAD: f64 = 0.3;

impl Body {
    /// Whether any element turns too far in a step; few steps have a node that moves far enough for that.
    pub(crate) fn may_throw_flaps(&self, dv: &Nodal) -> bool {
        let far_m_per_s = 0.5 * MOST_TURN_RAD * self.lattice_edge_m() / self.solver.params.dt_s;
        let moves_far = |node| self.velocity_after(node, dv).norm_squared() > far_m_per_s * far_m_per_s;
        (0..self.node_count()).any(moves_far)
            && (0..self.base().elements.len()).any(|element| self.turn_in_step_rad(element, dv) > MOST_TURN_RAD)
    }

    /// Takes from a step's change of velocity `dv` what flaps would turn by beyond [`MOST_TURN_RAD`]: of the motion of
    /// the nodes at which all elements turn too far, beside that of their elements' other corners. What it takes, m/s,
    /// is added to `taken`.
    pub(crate) fn brake_flaps(&self, dv: &mut Nodal, taken: &mut Nodal) {
        let fast: Vec<(usize, f64)> = (0..self.base().elements.len())
            .map(|element| (element, self.turn_in_step_rad(element, dv)))
            .filter(|(_, turn_rad)| *turn_rad > MOST_TURN_RAD)
            .collect();
        if fast.is_empty() {
            return;
        }
        // Elements at each node, and how many of them turn slowly.
        let mut at_node = vec![[0u32; 2]; self.node_count()];
        for data in &self.base().elements {
            data.nodes.iter().for_each(|node| at_node[*node as usize] = at_node[*node as usize].map(|count| count + 1));
        }
        for (element, _) in &fast {
            self.base().elements[*element].nodes.iter().for_each(|node| at_node[*node as usize][1] -= 1);
        }
        let mut excess = vec![Vec3::zeros(); self.node_count()];
        for (element, turn_rad) in fast {
            let nodes = self.base().elements[element].nodes.map(|node| node as usize);
            let mean = |of: &dyn Fn(usize) -> bool| {
                let found = nodes.iter().filter(|node| of(**node));
                let (sum, count) =
                    found.fold((Vec3::zeros(), 0.0), |(sum, n), node| (sum + self.velocity_after(*node, dv), n + 1.0));
                (count > 0.0).then(|| sum / count)
            };
            let beside = mean(&|node| at_node[node][1] > 0).or_else(|| mean(&|_| true)).unwrap_or_default();
            for node in nodes.into_iter().filter(|node| at_node[*node][1] == 0) {
                let share = (1.0 - MOST_TURN_RAD / turn_rad) / f64::from(at_node[node][0]);
                excess[node] += (self.velocity_after(node, dv) - beside) * share;
            }
        }
        for hanging in self.solver.multigrid.operator().hanging() {
            let of_masters = hanging.masters.iter().map(|(master, w)| excess[*master as usize] * f64::from(*w));
            excess[hanging.node as usize] = of_masters.sum();
        }
        for ((dv, taken), excess) in dv.iter_mut().zip(taken).zip(excess) {
            take_motion(dv, taken, excess);
        }
    }

    /// Angle by which the middle of an element turns in a step after a change of velocity `dv`.
    fn turn_in_step_rad(&self, element: usize, dv: &Nodal) -> f64 {
        let mut gradient = Mat3::zeros();
        for (corner, node) in self.base().elements[element].nodes.iter().enumerate() {
            let outward = Vec3::from_fn(|i, _| if corner >> i & 1 == 1 { 1.0 } else { -1.0 });
            gradient += self.velocity_after(*node as usize, dv) * outward.transpose();
        }
        let gradient = gradient * self.rotation(element).transpose() / (4.0 * self.element_edge_m(element));
        let spin = 0.5 * (gradient - gradient.transpose());
        self.solver.params.dt_s * Vec3::new(spin[(2, 1)], spin[(0, 2)], spin[(1, 0)]).norm()
    }
}
