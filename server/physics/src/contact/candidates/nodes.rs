//! How far the nodes of a body may move before its patches are looked for again.

use crate::Vec3;
use crate::body::{Body, Nodal};
use crate::grow::{grow, make_room};

/// Fraction of the slack that nodes may have used up where others of their element are placed again: by 0.032
/// the element has turned, by 0.048 it turns from there, 0.08 together, which is what
/// [`TURN`](super::follow::TURN) is made for.
const MOST_SLACK_USED: f64 = 2.0 / 3.0;

/// The nodes of a body as they were when its patches were found.
#[derive(Debug, Default)]
pub(super) struct Nodes {
    /// Where they were, m; empty where patches are to be found anew.
    found_at_m: Nodal,
    /// How far each may be from there at the end of a step, m: the slack, and more where it is fast.
    may_move_m: Vec<f64>,
    /// Whether they were placed anew in the last look: scratch.
    placed: Vec<bool>,
    motion: Motion,
}

/// What nodes may do before patches are looked for again.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Motion {
    pub(super) slack_m: f64,
    /// What a node travels in a step beyond that is not looked at, m.
    pub(super) most_travel_m: f64,
    /// Velocity that most of the tissue has: what moves with it stays where it is in regard to it.
    pub(super) common_m_per_s: Vec3,
}

impl Motion {
    /// How far a node travels in a step in regard to most of the tissue, m.
    fn travel_m(&self, velocity_m_per_s: [f64; 3], dt_s: f64) -> f64 {
        ((Vec3::from(velocity_m_per_s) - self.common_m_per_s).norm() * dt_s).min(self.most_travel_m)
    }

    /// What a node that travels so far may move by until it is placed again, m: twice that, so that what flies is not
    /// placed in each step.
    fn may_move_m(&self, travel_m: f64) -> f64 {
        self.slack_m + if 2.0 * travel_m > self.slack_m { 2.0 * travel_m } else { 0.0 }
    }
}

impl Nodes {
    pub(super) fn reserve(&mut self, count: usize) {
        make_room(&mut self.found_at_m, count);
        make_room(&mut self.may_move_m, count);
        make_room(&mut self.placed, count);
    }

    pub(super) fn forget(&mut self) {
        self.found_at_m.clear();
    }

    pub(super) fn is_forgotten(&self) -> bool {
        self.found_at_m.is_empty()
    }

    /// Where they were, m.
    pub(super) fn found_at_m(&self) -> &Nodal {
        &self.found_at_m
    }

    /// Whether all of a body's nodes will be as near as they may at the end of the step.
    pub(super) fn hold(&self, body: &Body) -> bool {
        self.found_at_m.len() == body.node_count()
            && (0..self.found_at_m.len()).all(|node| self.gone_m(body, node) <= self.may_move_m[node])
    }

    /// How far a node has moved since it was placed and travels in the step that begins, m.
    fn gone_m(&self, body: &Body, node: usize) -> f64 {
        let moved_m = Vec3::from(body.state.position_m[node]) - Vec3::from(self.found_at_m[node]);
        moved_m.norm() + self.motion.travel_m(body.state.velocity_m_per_s[node], body.dt_s())
    }

    /// Places those again that have used most of their slack, and all that are fast. New nodes lie where those do
    /// that they split from, and from here on they move by themselves.
    pub(super) fn place_again(&mut self, body: &Body, motion: Motion) {
        self.motion = motion;
        let (known, count) = (self.found_at_m.len(), body.node_count());
        grow(&mut self.found_at_m, count, [0.0; 3]);
        grow(&mut self.may_move_m, count, 0.0);
        grow(&mut self.placed, count, false);
        for node in 0..count {
            let stays = node < known
                && self.may_move_m[node] <= motion.slack_m
                && self.gone_m(body, node) <= MOST_SLACK_USED * motion.slack_m;
            self.placed[node] = !stays;
            if !stays {
                self.found_at_m[node] = body.state.position_m[node];
                let travel_m = motion.travel_m(body.state.velocity_m_per_s[node], body.dt_s());
                self.may_move_m[node] = motion.may_move_m(travel_m);
            }
        }
    }

    /// Whether any of an element's nodes was placed in the last look.
    pub(super) fn any_placed(&self, nodes: &[u32]) -> bool {
        nodes.iter().any(|node| self.placed[*node as usize])
    }

    /// How far a point that moves with some nodes may, m.
    pub(super) fn most_m(&self, nodes: &[u32]) -> f64 {
        nodes.iter().map(|node| self.may_move_m[*node as usize]).fold(0.0, f64::max)
    }

    /// How far any of them may move, m.
    pub(super) fn most_of_all_m(&self) -> f64 {
        self.may_move_m.iter().copied().fold(0.0, f64::max)
    }
}
