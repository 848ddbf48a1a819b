//! Free parts keep their momentum whatever the tolerance of the solve.
//!
//! A relative tolerance leaves a residual in every mode, rigid ones included: a free spinning
//! fragment would fall too slowly. After a solve each part that nothing outside holds or touches gets
//! the rigid velocity change that makes its linear and angular momentum what the loads say. Parts that
//! press on each other get it as one: what they do to each other changes none of their sum.

use super::rigid_motion::{Totals, share_of_turn};
use super::{Body, Nodal};
use crate::fem::block::LANES;
use crate::fem::lanes::for_packed;
use crate::grid::levels::NONE;
use crate::{Mat3, Vec3};

impl Body {
    /// Sums what each part that is neither held nor touched (`touched_nodes`) should have gained and has
    /// not. Returns whether there is any such part.
    pub(crate) fn sum_missing_momentum(&mut self, touched_nodes: impl Iterator<Item = u32>, dv: &Nodal) -> bool {
        let parts = &mut self.state.rigid;
        parts.skip.copy_from_slice(&parts.held);
        touched_nodes.for_each(|n| parts.skip[parts.node_part[n as usize] as usize] = true);
        if parts.skip.iter().all(|s| *s) {
            return false;
        }
        let mut totals = std::mem::take(&mut parts.totals);
        totals.fill(Totals::default());
        self.add_missing_momentum(&mut totals, dv);
        totals.iter_mut().for_each(|total| *total = total.solved());
        self.state.rigid.totals = totals;
        true
    }

    /// The part that an element belongs to.
    pub(crate) fn part_of_element(&self, element: usize) -> u32 {
        self.state.rigid.element_part[element]
    }

    /// The part that a node belongs to.
    pub(crate) fn part_of_node(&self, node: u32) -> u32 {
        self.state.rigid.node_part[node as usize]
    }

    /// What a part is to gain; `None`: it is left alone.
    pub(crate) fn gain_of_part(&self, part: u32) -> Option<Totals> {
        (!self.state.rigid.skip[part as usize]).then(|| self.state.rigid.totals[part as usize])
    }

    /// Sets what a part is to gain.
    pub(crate) fn set_gain_of_part(&mut self, part: u32, gain: Option<Totals>) {
        self.state.rigid.skip[part as usize] = gain.is_none();
        self.state.rigid.totals[part as usize] = gain.unwrap_or_default();
    }

    /// Adds to `dv` what each part is to gain. Returns the work of the impulses that this wants.
    pub(crate) fn add_missing_motion(&mut self, dv: &mut Nodal) -> f64 {
        // In a part that is strained severalfold the solve loses more than any turn of a step.
        let dt = self.solver.params.dt_s;
        self.state.rigid.totals.iter_mut().for_each(|gain| gain.spin *= share_of_turn(gain.spin, dt));
        for (node, change) in dv.iter_mut().enumerate() {
            let gain = self.missing_motion(node);
            (0..3).for_each(|i| change[i] += gain[i]);
        }
        self.missing_motion_work_j(dv)
    }

    /// Work over the motion `v + dv` of a step of the impulses that give each part what it is to gain, J; see
    /// [`Self::impulse_work_j`].
    pub(crate) fn missing_motion_work_j(&self, dv: &Nodal) -> f64 {
        let loose = self.state.rigid.loose.iter().map(|element| *element as usize);
        self.impulse_work_j(loose, |node| self.velocity_after(node, dv), |node| self.missing_motion(node))
    }

    fn missing_motion(&self, node: usize) -> Vec3 {
        self.missing_motion_at(node, self.state.position_m[node].into())
    }

    /// The same for a node that is at `position_m` where the step begins.
    pub(super) fn missing_motion_at(&self, node: usize, position_m: Vec3) -> Vec3 {
        let part = self.state.rigid.node_part[node];
        if part == NONE || self.state.rigid.skip[part as usize] {
            return Vec3::zeros();
        }
        self.state.rigid.totals[part as usize].motion_at(position_m)
    }

    /// Work over the motion `v` of a step of the impulses `A d` that change the velocities by `d` at each node of
    /// `elements` in the step's system `A dv = b`, J; elsewhere `d` is zero.
    pub(crate) fn impulse_work_j(
        &self,
        elements: impl Iterator<Item = usize>,
        v_m_per_s: impl Fn(usize) -> Vec3,
        d_m_per_s: impl Fn(usize) -> Vec3,
    ) -> f64 {
        let operator = self.solver.multigrid.operator();
        let mut work_j = 0.0;
        for element in elements {
            let nodes = self.base().elements[element].nodes.map(|n| n as usize);
            let changes = nodes.map(&d_m_per_s);
            if changes.iter().all(|d| *d == Vec3::zeros()) {
                continue;
            }
            let back = Mat3::from_row_slice(&operator.rotation(element)).transpose();
            let (d, v) = (changes.map(|d| back * d), nodes.map(|n| back * v_m_per_s(n)));
            let matrix = operator.matrix(element);
            for_packed(|index, row, column| {
                let [(a, i), (b, j)] = [(row / 3, row % 3), (column / 3, column % 3)];
                let twice = if row == column { 0.0 } else { d[b][j] * v[a][i] };
                work_j += matrix[index] * (d[a][i] * v[b][j] + twice);
            });
        }
        work_j
    }

    /// Slows parts to a `share` of their motion after a change of velocity `dv`, free ones of their motion about their
    /// centre; what that takes, m/s, is added to `taken`. Less of the same motion strains a part by less of the same.
    pub(super) fn slow_parts(&mut self, share: impl Fn(usize, &Totals) -> f64, dv: &mut Nodal, taken: &mut Nodal) {
        let gains = self.state.rigid.totals.clone();
        let motions = self.motions(|body, node| body.velocity_after(node, dv));
        let kept: Vec<f64> = motions.iter().enumerate().map(|(part, motion)| share(part, motion)).collect();
        for (node, (dv, taken)) in dv.iter_mut().zip(taken).enumerate() {
            let part = self.state.rigid.node_part[node];
            if part != NONE && kept[part as usize] < 1.0 {
                let whole = self.state.rigid.loose_part(node).map_or(Vec3::zeros(), |part| motions[part].velocity);
                let v = Vec3::from(self.state.velocity_m_per_s[node]) + Vec3::from(*dv);
                let excess = (v - whole) * (1.0 - kept[part as usize]);
                take_motion(dv, taken, excess);
            }
        }
        self.state.rigid.totals = gains;
    }

    /// Momentum and rigid motion of each free part where its nodes are, at velocities `of`. Uses up the buffer of
    /// totals, which is to be given back.
    pub(super) fn motions(&mut self, of: impl Fn(&Self, usize) -> Vec3) -> Vec<Totals> {
        let mut totals = std::mem::take(&mut self.state.rigid.totals);
        totals.fill(Totals::default());
        self.add_mass_moments(&mut totals);
        self.for_each_mass(|part, node, other, mass| {
            let (total, momentum) = (&mut totals[part], of(self, other) * mass);
            total.linear += momentum;
            total.angular += (Vec3::from(self.state.position_m[node]) - total.centre).cross(&momentum);
        });
        totals.iter_mut().for_each(|total| *total = total.solved());
        totals
    }

    pub(crate) fn velocity_after(&self, node: usize, dv: &Nodal) -> Vec3 {
        Vec3::from(self.state.velocity_m_per_s[node]) + Vec3::from(dv[node])
    }

    /// Momentum that each part should have gained and has not.
    fn add_missing_momentum(&self, totals: &mut [Totals], dv: &Nodal) {
        let parts = &self.state.rigid;
        self.add_mass_moments(totals);
        let dt = self.solver.params.dt_s;
        // The change of momentum that the solve should have made: loads less mass damping.
        self.for_each_mass(|part, node, other, mass| {
            let (total, x) = (&mut totals[part], Vec3::from(self.state.position_m[node]));
            let change = Vec3::from(dv[other]) * mass;
            total.linear -= change;
            total.angular -= (x - total.centre).cross(&change);
        });
        for (node, f) in self.solver.external_n.iter().enumerate() {
            if parts.node_part[node] == NONE {
                continue;
            }
            let total = &mut totals[parts.node_part[node] as usize];
            let impulse = Vec3::from(*f) * dt;
            total.linear += impulse;
            total.angular += (Vec3::from(self.state.position_m[node]) - total.centre).cross(&impulse);
        }
        self.add_mass_damping(totals, dv);
    }

    /// `M alpha dt (v + dv)`: what mass-proportional damping takes.
    fn add_mass_damping(&self, totals: &mut [Totals], dv: &Nodal) {
        let dt = self.solver.params.dt_s;
        for element in self.state.rigid.loose.iter().map(|e| *e as usize) {
            let data = &self.base().elements[element];
            let (block, lane) = (&self.solver.blocks[element / LANES], element % LANES);
            let alpha = block.alpha_per_s.as_array()[lane];
            if alpha == 0.0 {
                continue;
            }
            let total = &mut totals[self.state.rigid.element_part[element] as usize];
            for a in 0..8 {
                for b in 0..8 {
                    let (i, j) = (data.nodes[a] as usize, data.nodes[b] as usize);
                    let mass = self.mass_between_kg(element, a, b);
                    let v = Vec3::from(self.state.velocity_m_per_s[j]) + Vec3::from(dv[j]);
                    let loss = v * (dt * alpha * mass);
                    total.linear -= loss;
                    total.angular -= (Vec3::from(self.state.position_m[i]) - total.centre).cross(&loss);
                }
            }
        }
    }

    fn add_mass_moments(&self, totals: &mut [Totals]) {
        self.for_each_mass(|part, node, _, mass| {
            totals[part].mass += mass;
            totals[part].centre += Vec3::from(self.state.position_m[node]) * mass;
        });
        totals.iter_mut().for_each(|t| t.centre /= t.mass);
        self.for_each_mass(|part, node, other, mass| {
            let total = &mut totals[part];
            let a = Vec3::from(self.state.position_m[node]) - total.centre;
            let b = Vec3::from(self.state.position_m[other]) - total.centre;
            total.inertia += (Mat3::identity() * a.dot(&b) - b * a.transpose()) * mass;
        });
    }

    /// Visits `(part, node, node, mass entry)` of the consistent mass.
    pub(super) fn for_each_mass(&self, mut visit: impl FnMut(usize, usize, usize, f64)) {
        for element in self.state.rigid.loose.iter().map(|e| *e as usize) {
            let data = &self.base().elements[element];
            let part = self.state.rigid.element_part[element] as usize;
            for a in 0..8 {
                for b in 0..8 {
                    let mass = self.mass_between_kg(element, a, b);
                    visit(part, data.nodes[a] as usize, data.nodes[b] as usize, mass);
                }
            }
        }
    }
}

/// Takes `excess` from a node's change of velocity, and adds it to what was `taken`, m/s.
pub(super) fn take_motion(dv: &mut [f64; 3], taken: &mut [f64; 3], excess: Vec3) {
    (0..3).for_each(|i| (dv[i], taken[i]) = (dv[i] - excess[i], taken[i] + excess[i]));
}
