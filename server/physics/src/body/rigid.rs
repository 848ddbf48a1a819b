//! Free parts keep their momentum whatever the tolerance of the solve.
//!
//! A relative tolerance leaves a residual in every mode, rigid ones included: a free spinning
//! fragment would fall too slowly. After a solve each part that nothing outside holds or touches gets
//! the rigid velocity change that makes its linear and angular momentum what the loads say. Parts that
//! press on each other get it as one: what they do to each other changes none of their sum.

use super::turn::{Turn, share_of_turn};
use super::{Body, Nodal};
use crate::fem::block::LANES;
use crate::fem::lanes::for_packed;
use crate::grid::VoxelId;
use crate::grid::levels::{LevelChange, NONE};
use crate::walk::Kept;
use crate::{Mat3, Vec3};
use serde::{Deserialize, Serialize};

/// The separate pieces of a body.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct RigidParts {
    element_part: Kept<Vec<u32>>,
    node_part: Kept<Vec<u32>>,
    pub(super) held: Vec<bool>,
    /// Young's modulus times volume of each part, J.
    pub(super) stiff_j: Vec<f64>,
    /// Times that a state of each part was remembered since it was last lost; as many as can be if it never was.
    pub(super) steady_steps: Vec<u32>,
    /// Whether each part was put away.
    pub(super) away: Vec<bool>,
    /// A node of each part.
    pub(super) first_node: Vec<u32>,
    /// Elements of the parts that are not held: all that has to be summed over.
    pub(super) loose: Kept<Vec<u32>>,
    /// Whether a part is left alone this step, and what it is to gain.
    pub(super) skip: Vec<bool>,
    pub(super) totals: Vec<Totals>,
    /// How a part turns in this step, unless it is along straight lines.
    pub(super) turns: Vec<Option<Turn>>,
}

/// Mass, and momentum that is missing, of a part or of several as one.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Totals {
    pub(super) mass: f64,
    pub(super) centre: Vec3,
    pub(super) linear: Vec3,
    pub(super) angular: Vec3,
    pub(super) inertia: Mat3,
    pub(super) velocity: Vec3,
    pub(super) spin: Vec3,
}

impl Totals {
    /// Two as one, about their common centre.
    #[must_use]
    pub(crate) fn joined(&self, other: &Self) -> Self {
        let mass = self.mass + other.mass;
        let centre = (self.centre * self.mass + other.centre * other.mass) / mass;
        let mut joined = Self { mass, centre, linear: self.linear + other.linear, ..Self::default() };
        for one in [self, other] {
            let arm = one.centre - centre;
            joined.angular += one.angular + arm.cross(&one.linear);
            joined.inertia += one.inertia + (Mat3::identity() * arm.dot(&arm) - arm * arm.transpose()) * one.mass;
        }
        joined
    }

    /// Velocity of the rigid motion at `x_m`.
    pub(super) fn motion_at(&self, x_m: Vec3) -> Vec3 {
        self.velocity + self.spin.cross(&(x_m - self.centre))
    }

    /// The rigid motion that makes up for what is missing.
    #[must_use]
    pub(crate) fn solved(mut self) -> Self {
        self.velocity = self.linear / self.mass;
        self.spin = self.inertia.lu().solve(&self.angular).unwrap_or_default();
        self
    }
}

impl RigidParts {
    pub(super) fn new(body: &Body) -> Self {
        let (element_part, count) = body.base().parts();
        let mut node_part = vec![NONE; body.node_count()];
        for (element, data) in body.base().elements.iter().enumerate() {
            data.nodes.iter().for_each(|n| node_part[*n as usize] = element_part[element]);
        }
        let mut held = vec![false; count as usize];
        body.state.held.elements().iter().for_each(|element| held[element_part[*element as usize] as usize] = true);
        let (skip, totals) = (held.clone(), vec![Totals::default(); count as usize]);
        let loose = (0..element_part.len() as u32).filter(|e| !held[element_part[*e as usize] as usize]);
        let loose = Kept::from(loose.collect::<Vec<_>>());
        let turns = vec![None; count as usize];
        let stiff_j = stiff_by_part_j(body, &element_part, count);
        let away = vec![false; count as usize];
        let mut first_node = vec![NONE; count as usize];
        for (node, part) in node_part.iter().enumerate().rev().filter(|(_, part)| **part != NONE) {
            first_node[*part as usize] = node as u32;
        }
        let steady_steps = vec![u32::MAX; count as usize];
        let (element_part, node_part) = (Kept::from(element_part), Kept::from(node_part));
        Self { element_part, node_part, held, stiff_j, steady_steps, away, first_node, loose, skip, totals, turns }
    }

    /// Follows a change of the elements, whose nodes and holds the body has by now. Parts only ever split: while there
    /// are as many as before, what is new is in the part that it split from.
    pub(super) fn follow(&mut self, body: &Body, change: &LevelChange) {
        // The coarsest elements hang together as the finest do, and are few.
        let coarsest = &body.state.levels[body.state.levels.len() - 1];
        if coarsest.parts().1 != self.part_count() {
            let before = std::mem::replace(self, Self::new(body));
            self.inherit(&before, change);
            return;
        }
        for &(new, from) in &change.split_elements {
            let part = self.element_part[from as usize];
            self.element_part.push(part);
            if !self.held[part as usize] {
                self.loose.push(new);
            }
        }
        for &(_, from) in &change.split_nodes {
            let part = self.node_part[from as usize];
            self.node_part.push(part);
        }
        self.forget_turns();
    }

    /// Takes what is remembered of parts from those that they split from.
    fn inherit(&mut self, before: &Self, change: &LevelChange) {
        let kept = (0..before.element_part.len() as u32).map(|element| (element, element));
        for (element, from) in kept.chain(change.split_elements.iter().copied()) {
            let [part, was] = [self.element_part[element as usize], before.element_part[from as usize]];
            self.steady_steps[part as usize] = before.steady_steps[was as usize];
            self.away[part as usize] = before.away[was as usize];
        }
    }

    /// Young's modulus times volume of all parts, J; parting links changes neither.
    pub(super) fn stiff_j(&self) -> f64 {
        self.stiff_j.iter().sum()
    }

    /// The same of the part that has least of it, J.
    pub(super) fn least_stiff_j(&self) -> f64 {
        self.stiff_j.iter().copied().fold(f64::INFINITY, f64::min)
    }

    /// Whether an element's part was put away.
    pub(super) fn is_away(&self, element: usize) -> bool {
        self.away[self.element_part[element] as usize]
    }

    /// Whether they are of so many elements and nodes.
    pub(super) fn fits(&self, elements: usize, nodes: usize) -> bool {
        let parts = self.held.len();
        [self.element_part.len(), self.node_part.len()] == [elements, nodes]
            && [self.skip.len(), self.totals.len(), self.turns.len()] == [parts; 3]
            && [self.stiff_j.len(), self.steady_steps.len(), self.away.len(), self.first_node.len()] == [parts; 4]
            && self.element_part.iter().all(|part| (*part as usize) < parts)
            && self.node_part.iter().all(|part| *part == NONE || (*part as usize) < parts)
            && self.loose.iter().all(|element| (*element as usize) < elements)
    }

    /// Lets go of how parts turn in the step that is going on.
    pub(super) fn forget_turns(&mut self) {
        self.turns.fill(None);
    }

    pub(super) fn any_turns(&self) -> bool {
        self.turns.iter().any(Option::is_some)
    }

    pub(super) fn part_count(&self) -> u32 {
        self.held.len() as u32
    }

    /// The piece that a node belongs to, if nothing holds that piece.
    pub(super) fn loose_part(&self, node: usize) -> Option<usize> {
        let part = self.node_part[node];
        (part != NONE && !self.held[part as usize]).then_some(part as usize)
    }
}

impl Body {
    /// Corrects `dv` on every part that is neither held nor touched (`touched_nodes`), each by itself.
    pub fn correct_rigid_motion(&mut self, touched_nodes: impl Iterator<Item = u32>, dv: &mut Nodal) {
        if self.sum_missing_momentum(touched_nodes, dv) {
            self.add_missing_motion(dv);
        }
    }

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

fn stiff_by_part_j(body: &Body, element_part: &[u32], count: u32) -> Vec<f64> {
    let mut modulus_pa = vec![0.0; count as usize];
    for voxel in (0..body.state.grid.voxels().len() as u32).map(VoxelId) {
        modulus_pa[element_part[body.element_of(voxel)] as usize] += body.material_of(voxel).young_modulus_pa;
    }
    modulus_pa.iter().map(|sum| body.state.grid.voxel_size_m().powi(3) * sum).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Crossing, LinkId};
    use crate::workers::Workers;

    const SCENE: &str = r#"
version = 1
name = "bar"
[[objects]]
name = "bar"
shape = { box = { min_m = [0.0, 0.0, 0.0], max_m = [0.12, 0.02, 0.02] } }
voxel_size_m = 0.0025
level = 1
material = { young_modulus_pa = 1e5, poisson_ratio = 0.4 }
fixed = [{ box = { min_m = [-1.0, -1.0, -1.0], max_m = [0.004, 1.0, 1.0] } }]
"#;

    #[test]
    fn parts_follow_cuts_to_what_they_would_be_if_they_were_counted_anew() {
        let mut body = Body::of_text(SCENE);
        // Across the bar, within a layer of elements and between two: half way, then through.
        for (x, rows, parts) in [(20, 0..4, 1), (20, 4..8, 2), (31, 0..4, 2), (31, 4..8, 3), (10, 0..6, 3)] {
            let cells = rows.flat_map(|y| (0..8).map(move |z| [x, y, z]));
            let crossing = Crossing { t: 0.5, normal: [1.0, 0.0, 0.0] };
            let links: Vec<_> = cells.map(|cell| (LinkId { cell, axis: 0 }, crossing)).collect();
            let parted = body.part_links(&links).parted;
            assert_eq!(parted.len(), links.len());
            body.update_topology(&Workers::serial(), &parted);
            let (followed, anew) = (&body.state.rigid, RigidParts::new(&body));
            assert_eq!(followed.part_count(), parts);
            assert_eq!((&followed.element_part, &followed.node_part), (&anew.element_part, &anew.node_part));
            assert_eq!((&followed.held, &followed.loose), (&anew.held, &anew.loose));
        }
    }
}
