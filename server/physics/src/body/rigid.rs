//! Free parts keep their momentum whatever the tolerance of the solve.
//!
//! A relative tolerance leaves a residual in every mode, rigid ones included: a free spinning
//! fragment would fall too slowly. After a solve each part that nothing outside holds or touches gets
//! the rigid velocity change that makes its linear and angular momentum what the loads say.

use super::{Body, Nodal};
use crate::fem::corotation::LANES;
use crate::grid::levels::NONE;
use crate::{Mat3, Vec3};

/// The separate pieces of a body.
#[derive(Clone, Debug, Default)]
pub(super) struct RigidParts {
    element_part: Vec<u32>,
    node_part: Vec<u32>,
    held: Vec<bool>,
    /// Elements of the parts that are not held: all that has to be summed over.
    loose: Vec<u32>,
    /// Whether a part is left alone this step, and what it is to gain.
    skip: Vec<bool>,
    totals: Vec<Totals>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Totals {
    mass: f64,
    centre: Vec3,
    linear: Vec3,
    angular: Vec3,
    inertia: Mat3,
    velocity: Vec3,
    spin: Vec3,
}

impl RigidParts {
    pub(super) fn new(body: &Body) -> Self {
        let (element_part, count) = body.base().parts();
        let mut node_part = vec![NONE; body.node_count()];
        for (element, data) in body.base().elements.iter().enumerate() {
            data.nodes.iter().for_each(|n| node_part[*n as usize] = element_part[element]);
        }
        let mut held = vec![false; count as usize];
        body.holds.iter().for_each(|(element, _)| held[element_part[*element as usize] as usize] = true);
        let (skip, totals) = (held.clone(), vec![Totals::default(); count as usize]);
        let loose = (0..element_part.len() as u32).filter(|e| !held[element_part[*e as usize] as usize]).collect();
        Self { element_part, node_part, held, loose, skip, totals }
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
    /// Corrects `dv` on every part that is neither held nor touched (`touched_nodes`).
    pub fn correct_rigid_motion(&mut self, touched_nodes: impl Iterator<Item = u32>, dv: &mut Nodal) {
        let parts = &mut self.rigid;
        parts.skip.copy_from_slice(&parts.held);
        touched_nodes.for_each(|n| parts.skip[parts.node_part[n as usize] as usize] = true);
        if parts.skip.iter().all(|s| *s) {
            return;
        }
        let mut totals = std::mem::take(&mut parts.totals);
        totals.fill(Totals::default());
        self.add_missing_momentum(&mut totals, dv);
        for total in &mut totals {
            total.velocity = total.linear / total.mass;
            total.spin = total.inertia.lu().solve(&total.angular).unwrap_or_default();
        }
        for (node, change) in dv.iter_mut().enumerate() {
            let part = self.rigid.node_part[node];
            if part == NONE || self.rigid.skip[part as usize] {
                continue;
            }
            let total = &totals[part as usize];
            let add = total.velocity + total.spin.cross(&(Vec3::from(self.position_m[node]) - total.centre));
            (0..3).for_each(|i| change[i] += add[i]);
        }
        self.rigid.totals = totals;
    }

    /// Momentum that each part should have gained and has not.
    fn add_missing_momentum(&self, totals: &mut [Totals], dv: &Nodal) {
        let parts = &self.rigid;
        self.add_mass_moments(totals);
        let dt = self.params.dt_s;
        // The change of momentum that the solve should have made: loads less mass damping.
        self.for_each_mass(|part, node, other, mass| {
            let (total, x) = (&mut totals[part], Vec3::from(self.position_m[node]));
            let change = Vec3::from(dv[other]) * mass;
            total.linear -= change;
            total.angular -= (x - total.centre).cross(&change);
        });
        for (node, f) in self.external_n.iter().enumerate() {
            if parts.node_part[node] == NONE {
                continue;
            }
            let total = &mut totals[parts.node_part[node] as usize];
            let impulse = Vec3::from(*f) * dt;
            total.linear += impulse;
            total.angular += (Vec3::from(self.position_m[node]) - total.centre).cross(&impulse);
        }
        self.add_mass_damping(totals, dv);
    }

    /// `M alpha dt (v + dv)`: what mass-proportional damping takes.
    fn add_mass_damping(&self, totals: &mut [Totals], dv: &Nodal) {
        let dt = self.params.dt_s;
        for element in self.rigid.loose.iter().map(|e| *e as usize) {
            let data = &self.base().elements[element];
            let (block, lane) = (&self.blocks[element / LANES], element % LANES);
            let alpha = block.alpha_per_s.as_array()[lane];
            if alpha == 0.0 {
                continue;
            }
            let total = &mut totals[self.rigid.element_part[element] as usize];
            for a in 0..8 {
                for b in 0..8 {
                    let (i, j) = (data.nodes[a] as usize, data.nodes[b] as usize);
                    let mass = self.mass_between_kg(element, a, b);
                    let v = Vec3::from(self.velocity_m_per_s[j]) + Vec3::from(dv[j]);
                    let loss = v * (dt * alpha * mass);
                    total.linear -= loss;
                    total.angular -= (Vec3::from(self.position_m[i]) - total.centre).cross(&loss);
                }
            }
        }
    }

    fn add_mass_moments(&self, totals: &mut [Totals]) {
        self.for_each_mass(|part, node, _, mass| {
            totals[part].mass += mass;
            totals[part].centre += Vec3::from(self.position_m[node]) * mass;
        });
        totals.iter_mut().for_each(|t| t.centre /= t.mass);
        self.for_each_mass(|part, node, other, mass| {
            let total = &mut totals[part];
            let a = Vec3::from(self.position_m[node]) - total.centre;
            let b = Vec3::from(self.position_m[other]) - total.centre;
            total.inertia += (Mat3::identity() * a.dot(&b) - b * a.transpose()) * mass;
        });
    }

    /// Visits `(part, node, node, mass entry)` of the consistent mass.
    fn for_each_mass(&self, mut visit: impl FnMut(usize, usize, usize, f64)) {
        for element in self.rigid.loose.iter().map(|e| *e as usize) {
            let data = &self.base().elements[element];
            let part = self.rigid.element_part[element] as usize;
            for a in 0..8 {
                for b in 0..8 {
                    let mass = self.mass_between_kg(element, a, b);
                    visit(part, data.nodes[a] as usize, data.nodes[b] as usize, mass);
                }
            }
        }
    }
}
