//! Free parts turn without being widened, and are strained by how fast they turn.
//!
//! The solve moves every node along a straight line, which widens what turns by `sqrt(1 + angle^2)`: the strain would
//! be energy from nothing. What a free part turns by is therefore a rotation that keeps angular momentum and energy
//! ([`Turn::of`]), and its velocities turn along. What that takes of forces is given back to the solve as centrifugal and
//! Coriolis forces.

use super::rigid::take_motion;
use super::rigid_motion::{MOST_TURN_RAD, Totals, Turn, share_of_turn};
use super::{Body, Nodal, State};
use crate::solve::assembly::CHUNK_ELEMENTS;
use crate::workers::Workers;
use crate::{Mat3, Vec3};
use nalgebra::Rotation3;

/// What turns by less than this in a step moves along straight lines, which widen it by 5e-5 at most, rad.
const LEAST_TURN_RAD: f64 = 0.01;
/// Corners of an element at the ends of its four diagonals.
const DIAGONALS: [[usize; 2]; 4] = [[0, 7], [1, 6], [2, 5], [4, 3]];

/// The shape that a free part would have if nothing strained it, turned as it is, and its motion.
#[derive(Clone, Copy, Default)]
struct UnstrainedShape {
    rest_centre_m: Vec3,
    turn: Mat3,
    /// Angular momentum of the part's motion, as far as the shape takes part in it, and inertia.
    angular: Vec3,
    inertia: Mat3,
}

impl UnstrainedShape {
    /// From its middle to a node, m.
    fn arm(&self, rest_m: Vec3) -> Vec3 {
        self.turn * (rest_m - self.rest_centre_m)
    }
}

impl Body {
    /// Takes from a step's change of velocity `dv` what free parts would turn by beyond [`MOST_TURN_RAD`]; what it
    /// takes, m/s, is added to `taken`.
    ///
    /// To the solve a turn of the shape that a part would have unstrained, turned as it is, costs no strain. What
    /// is strained severalfold has a torque about that shape, which nothing resists but its mass: it is a spin of this
    /// shape that is taken. A part that turns too far by what is left is slowed.
    pub(crate) fn brake_spin(&mut self, dv: &mut Nodal, taken: &mut Nodal) {
        let dt = self.solver.params.dt_s;
        let gains = self.state.rigid.totals.clone();
        let motions = self.motions(|body, node| body.velocity_after(node, dv));
        let mut shapes = self.unstrained_shapes(&motions);
        self.for_each_mass(|part, node, other, mass| {
            let shape = &mut shapes[part];
            let [arm, other_arm] = [node, other].map(|node| shape.arm(self.rest_position_m(node)));
            shape.angular += arm.cross(&(self.velocity_after(other, dv) - motions[part].velocity)) * mass;
            shape.inertia += (Mat3::identity() * arm.dot(&other_arm) - other_arm * arm.transpose()) * mass;
        });
        let excess: Vec<Vec3> = shapes
            .iter()
            .map(|shape| {
                let spin = shape.inertia.lu().solve(&shape.angular).unwrap_or_default();
                spin * (1.0 - share_of_turn(spin, dt))
            })
            .collect();
        self.state.rigid.totals = gains;
        for (node, (dv, taken)) in dv.iter_mut().zip(taken.iter_mut()).enumerate() {
            if let Some(part) = self.state.rigid.loose_part(node) {
                let excess = excess[part].cross(&shapes[part].arm(self.rest_position_m(node)));
                take_motion(dv, taken, excess);
            }
        }
        self.slow_parts(|_, motion| share_of_turn(motion.spin, dt), dv, taken);
    }

    /// The shapes that free parts would have unstrained, turned as they are now.
    fn unstrained_shapes(&self, motions: &[Totals]) -> Vec<UnstrainedShape> {
        let mut shapes = vec![UnstrainedShape::default(); motions.len()];
        self.for_each_mass(|part, node, _, mass| {
            shapes[part].rest_centre_m += self.rest_position_m(node) * (mass / motions[part].mass);
        });
        self.for_each_mass(|part, node, other, mass| {
            let shape = &mut shapes[part];
            let rest = self.rest_position_m(other) - shape.rest_centre_m;
            shape.turn += (Vec3::from(self.state.position_m[node]) - motions[part].centre) * rest.transpose() * mass;
        });
        for shape in &mut shapes {
            shape.turn = *Rotation3::from_matrix_eps(&shape.turn, 1e-9, 100, Rotation3::identity()).matrix();
        }
        shapes
    }

    /// Adds to the right side `impulses_n_s` what keeps straight on what turns: at the end of the step velocities are
    /// turned by a rotation `R`, which takes a force that nothing gives. Each node of a part that turns so gets
    /// `M (R^T - 1) v`, of which `-M w x v dt` is the first order: centrifugal and Coriolis forces. It is freed of
    /// what it would give the part as a whole.
    pub(super) fn add_turning_impulses(&mut self, impulses_n_s: &mut Nodal) {
        self.scratch.turning.clear();
        let velocity = |body: &Self, node: usize| Vec3::from(body.state.velocity_m_per_s[node]);
        if !self.may_turn_by(LEAST_TURN_RAD, velocity) {
            return;
        }
        let dt = self.solver.params.dt_s;
        let motions = self.motions(velocity);
        let turn = |motion: &Totals| {
            let angle_rad = dt * motion.spin.norm();
            // What turns by more will be braked.
            let kept = share_of_turn(motion.spin, dt);
            let motion = Totals { spin: motion.spin * kept, angular: motion.angular * kept, ..*motion };
            (angle_rad > LEAST_TURN_RAD).then(|| Turn::of(motion, dt))
        };
        let turns: Vec<_> = motions.iter().map(turn).collect();
        self.state.rigid.totals = motions;
        let lag = |body: &Self, node: usize| {
            let turn = body.state.rigid.loose_part(node).and_then(|part| turns[part].as_ref());
            turn.map_or(Vec3::zeros(), |Turn { motion, rotation }| {
                let moving = velocity(body, node) - motion.velocity;
                rotation.tr_mul(&moving) - moving
            })
        };
        let whole = self.motions(lag);
        let mut turning = std::mem::take(&mut self.scratch.turning);
        turning.resize(self.node_count(), [0.0; 3]);
        self.for_each_mass(|part, node, other, mass| {
            let rigid = whole[part].motion_at(self.state.position_m[other].into());
            let impulse = (lag(self, other) - rigid) * mass;
            (0..3).for_each(|i| turning[node][i] += impulse[i]);
        });
        self.state.rigid.totals = whole;
        impulses_n_s.iter_mut().zip(&turning).for_each(|(b, p)| (0..3).for_each(|i| b[i] += p[i]));
        self.scratch.turning = turning;
    }

    /// Finds how free parts turn in the step of a change of velocity `dv`.
    pub(super) fn find_turns(&mut self, dv: &Nodal) {
        self.state.rigid.turns.fill(None);
        if !self.may_turn_by(LEAST_TURN_RAD, |body, node| body.velocity_after(node, dv)) {
            return;
        }
        let dt = self.solver.params.dt_s;
        let gains = self.state.rigid.totals.clone();
        let totals = self.motions(|body, node| body.velocity_after(node, dv));
        let parts = &mut self.state.rigid;
        for ((turn, total), held) in parts.turns.iter_mut().zip(&totals).zip(&parts.held) {
            *turn = (!held && dt * total.spin.norm() > LEAST_TURN_RAD).then(|| Turn::of(*total, dt));
        }
        parts.totals = gains;
    }

    /// Puts the nodes of parts that turn where the turn takes them, from where straight lines have.
    pub(super) fn turn_positions(&mut self) {
        let dt = self.solver.params.dt_s;
        self.for_each_turned(|_, Turn { motion, rotation }, x, v| {
            let arm = *x - *v * dt - motion.centre;
            // What it is strained by turns along.
            let strained = arm + (*v - motion.velocity - motion.spin.cross(&arm)) * dt;
            *x = motion.centre + motion.velocity * dt + rotation * strained;
        });
    }

    /// Turns the velocities of parts that turn, so that their angular momentum stays; returns the energy that this and
    /// the impulses of turning have made, J. Forces and energies are evaluated anew.
    pub(crate) fn turn_velocities(&mut self, workers: &Workers<'_>) -> f64 {
        let work = |(p, v): (&[f64; 3], &[f64; 3])| Vec3::from(*p).dot(&Vec3::from(*v));
        let made_j = self.scratch.turning.iter().zip(&self.state.velocity_m_per_s).map(work).sum();
        if !self.state.rigid.any_turns() {
            return made_j;
        }
        let before_j = self.energy().kinetic_j;
        self.for_each_turned(|_, Turn { motion, rotation }, _, v| {
            *v = motion.velocity + rotation * (*v - motion.velocity);
        });
        let mut totals = self.motions(|body, node| Vec3::from(body.state.velocity_m_per_s[node]));
        for (total, turn) in totals.iter_mut().zip(&self.state.rigid.turns) {
            let kept = turn.map_or(total.angular, |turn| turn.motion.angular);
            *total = Totals { angular: kept - total.angular, ..*total }.solved();
        }
        self.for_each_turned(|part, _, x, v| *v += totals[part].spin.cross(&(*x - totals[part].centre)));
        self.state.rigid.totals = totals;
        let loose = std::mem::take(&mut self.state.rigid.loose);
        let is_loose = |chunk: usize| loose.binary_search_by(|e| (*e as usize / CHUNK_ELEMENTS).cmp(&chunk)).is_ok();
        self.evaluate_chunks(workers, is_loose, None, 2);
        self.state.rigid.loose = loose;
        made_j + self.energy().kinetic_j - before_j
    }

    /// Visits the nodes of parts that turn: part, its turn, position and velocity.
    fn for_each_turned(&mut self, visit: impl Fn(usize, &Turn, &mut Vec3, &mut Vec3)) {
        let State { rigid, position_m, velocity_m_per_s, .. } = &mut self.state;
        if !rigid.any_turns() {
            return;
        }
        for (node, (x, v)) in position_m.iter_mut().zip(velocity_m_per_s).enumerate() {
            let Some(part) = rigid.loose_part(node) else { continue };
            let Some(turn) = &rigid.turns[part] else { continue };
            let (mut at, mut moving) = (Vec3::from(*x), Vec3::from(*v));
            visit(part, turn, &mut at, &mut moving);
            (*x, *v) = (at.into(), moving.into());
        }
    }

    /// Whether any element of a free part will turn so fast that the part may have to be braked.
    pub(crate) fn may_spin_too_fast(&self, dv: &Nodal) -> bool {
        self.may_turn_by(MOST_TURN_RAD, |body, node| body.velocity_after(node, dv))
    }

    /// Whether any element of a free part may turn by more than this in the step.
    fn may_turn_by(&self, angle_rad: f64, velocity: impl Fn(&Self, usize) -> Vec3) -> bool {
        // Of the diagonals of a cube, the one most across the axis moves at sqrt(2/3) of spin times length at
        // least; strain may hide a part of it.
        let share = 0.5 * angle_rad / self.solver.params.dt_s;
        self.state.rigid.loose.iter().any(|element| {
            let nodes = self.base().elements[*element as usize].nodes;
            let limit = share * 3f64.sqrt() * self.element_edge_m(*element as usize);
            let at = |corner: usize| velocity(self, nodes[corner] as usize);
            DIAGONALS.iter().any(|[a, b]| (at(*a) - at(*b)).norm_squared() > limit * limit)
        })
    }
}
