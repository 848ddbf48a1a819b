//! How a body gives way to what presses on it slowly: solves with the step's matrix less the inertia in it.
//!
//! Over a time T the matrix of an implicit step, over its dt^2, is `M / T^2 + C / T + K`. In a step of 1 ms the first two
//! outweigh the third, and a tool would be felt as stiff as what a wave reaches in that time. So mass is taken out of the
//! product until no more of it is left than belongs to [`LONGEST_S`]; stiffness and the damping that goes with it
//! stay as they are, one a multiple of the other. The cycle that preconditions the step's solves serves here too.

use super::Body;
use crate::fem::block::{ElementBlock, LANES};
use crate::fem::composite::corner_pair;
use crate::grid::levels::Element;
use crate::solve::pcg::{self, Factor, Stop, System, Systems};
use crate::solve::spring::PointSpring;
use crate::solve::vectors::{NodeVector, dot};
use crate::workers::Workers;
use wide::f32x4;

/// What is slower than this is static, s. A body that nothing holds is as heavy as it is over this time.
const LONGEST_S: f64 = 0.1;

/// What a body does under one load, by node; kept from solve to solve as the next one's guess.
#[derive(Clone, Debug, Default)]
pub(crate) struct Response {
    /// How far it gives way, times `dt^2 / kg`.
    pub(crate) displacement: NodeVector,
    /// The part of the load that the tissue itself carries so, without the springs that exert it: its matrix times the
    /// displacement.
    pub(crate) carried: NodeVector,
}

/// Room for the products of masses.
#[derive(Default)]
pub(super) struct InertiaScratch {
    values: NodeVector,
    momentum: NodeVector,
}

impl Response {
    /// `u_a^T A u_b`, the mean of the two ways to find it.
    pub(crate) fn work(workers: &Workers<'_>, a: &Self, b: &Self) -> f64 {
        0.5 * (dot(workers, &a.displacement, &b.carried) + dot(workers, &b.displacement, &a.carried))
    }
}

impl Body {
    /// Solves for the displacement under forces that `springs` exert where their points are moved by a vector each,
    /// times dt^2, with the springs that the operator has; these are among them.
    pub(crate) fn respond<'a, S: Iterator<Item = (&'a PointSpring, f32x4)>>(
        &mut self,
        workers: &Workers<'_>,
        springs: impl Fn() -> S,
        (relative_tolerance, max_iterations): (f64, u32),
        response: &mut Response,
    ) -> u32 {
        let load = &mut self.scratch.right_side_f32;
        load.fill(f32x4::ZERO);
        for (spring, moved) in springs() {
            spring.shares(moved).for_each(|(node, force)| load[node] += force);
        }
        let elements = &self.state.levels[0].elements;
        let mut system = QuasiStatic {
            system: System {
                multigrid: &mut self.solver.multigrid,
                scratch: &mut self.scratch.pcg,
                b: load,
                x: &mut response.displacement,
            },
            elements,
            blocks: &self.solver.blocks,
            dt_s: self.solver.params.dt_s,
            scratch: &mut self.scratch.inertia,
        };
        let report =
            pcg::solve(workers, &mut system, Stop { scale: 0.0, relative_tolerance, max_iterations, effort: None });
        let left = self.solver.multigrid.residual();
        response.carried.iter_mut().zip(left).for_each(|(carried, left)| *carried = -*left);
        for (spring, moved) in springs() {
            let stretched = moved - spring.value(&response.displacement);
            spring.shares(stretched).for_each(|(node, force)| response.carried[node] += force);
        }
        report.iterations
    }

    /// Makes room for a solve and what it answers with.
    pub(crate) fn fit(&mut self, response: &mut Response) {
        let nodes = self.node_count();
        let InertiaScratch { values, momentum } = &mut self.scratch.inertia;
        for vector in [&mut response.displacement, &mut response.carried, values, momentum] {
            vector.resize(nodes, f32x4::ZERO);
        }
    }

    /// The operator has stiffness and the damping that goes with it as one, `(dt^2 + beta dt) K`: the step in which stiffness
    /// alone would count as much. Springs that act beside it are to be scaled by it.
    pub(crate) fn quasi_static_dt_s(&self) -> f64 {
        let dt_s = self.dt_s();
        (dt_s * (dt_s + self.damping_time_s())).sqrt()
    }

    /// Damping over stiffness where tools touch it, s: that of its own material, which regions may differ from.
    pub(crate) fn damping_time_s(&self) -> f64 {
        self.description.materials[0].law.beta_s
    }
}

/// A body's system without inertia.
struct QuasiStatic<'a> {
    system: System<'a>,
    elements: &'a [Element],
    blocks: &'a [ElementBlock],
    dt_s: f64,
    scratch: &'a mut InertiaScratch,
}

impl Systems for QuasiStatic<'_> {
    fn for_each(&mut self, mut visit: impl FnMut(&mut System<'_>)) {
        visit(&mut self.system);
    }

    fn is_moot(&mut self, _: &Workers<'_>, _: f64) -> bool {
        false
    }

    fn couple(&mut self, factor: Factor) {
        let Self { system, elements, blocks, dt_s, scratch: InertiaScratch { values, momentum } } = self;
        values.copy_from_slice(system.factor(factor));
        momentum.fill(f32x4::ZERO);
        let operator = system.multigrid.operator_mut();
        for hanging in operator.hanging() {
            let sum =
                hanging.masters.iter().fold(f32x4::ZERO, |sum, (m, w)| sum + values[*m as usize] * f32x4::splat(*w));
            values[hanging.node as usize] = sum;
        }
        for (element, data) in elements.iter().enumerate() {
            let (block, lane) = (&blocks[element / LANES], element % LANES);
            // All but what is left of it over the longest time; mass-proportional damping goes with it.
            let dt_over_t = *dt_s / LONGEST_S;
            let share = 1.0 + block.alpha_per_s.as_array()[lane] * *dt_s - dt_over_t * dt_over_t;
            let masses: [f32x4; 36] = block.shapes.mass_kg.map(|m| f32x4::splat(-(share * m.as_array()[lane]) as f32));
            let u = data.nodes.map(|node| values[node as usize]);
            for (a, &node) in data.nodes.iter().enumerate() {
                let sum = (0..8).fold(f32x4::ZERO, |sum, b| masses[corner_pair(a, b)].mul_add(u[b], sum));
                momentum[node as usize] += sum;
            }
        }
        for index in 0..operator.hanging().len() {
            let hanging = operator.hanging()[index];
            let handed = std::mem::take(&mut momentum[hanging.node as usize]);
            hanging.masters.iter().for_each(|(m, w)| momentum[*m as usize] += handed * f32x4::splat(*w));
        }
        for (node, momentum) in momentum.iter().enumerate() {
            operator.add_to_product(node, *momentum);
        }
    }

    /// The step's solves are not to know that this one was.
    fn mend(&mut self, _: &Workers<'_>) -> bool {
        false
    }
}
