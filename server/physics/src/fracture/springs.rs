//! The springs between a share of the edge and its anchor, through one step: set up, settled with the
//! solve, concluded.

use super::anchor::{Ahead, Anchor};
use super::book::FrontBook;
use super::marker::Edge;
use crate::Vec3;
use crate::body::Body;
use crate::contact::{Contact, Mode};
use crate::tool::blade::BladeFrame;

/// A front does not advance by more than this many voxels in a step.
const MAX_ADVANCE_VOXELS: f64 = 2.0;
/// Virgin contact slides sideways where the sideways force exceeds this share of the forward one.
const EDGE_GRIP: f64 = 1.0;

/// The springs of one marker during a step.
#[derive(Clone, Copy, Debug)]
pub struct FrontContact {
    /// Which marker of the front they belong to.
    pub(super) marker: usize,
    /// Along the cutting direction.
    pub forward: Contact,
    /// Along the blade's normal; acts while `forward` does.
    pub lateral: Contact,
    /// Stiffness of the springs over what they relax to.
    unrelaxed: f64,
}

impl FrontContact {
    /// Sets up the springs between `edge` and the anchor of its marker.
    pub(super) fn new(body: &Body, marker: usize, edge: &Edge, anchor: &Anchor) -> Self {
        let weights = anchor.weights(body);
        let at = weights.sum(&body.position_m);
        let velocity = weights.sum(&body.velocity_m_per_s);
        let [k, relaxed] =
            anchor.stiffness_n_per_m2(body, &edge.frame, edge.from_end_m).map(|per_length| edge.share_m * per_length);
        let spring = |direction: Vec3| Contact {
            weights,
            direction,
            tool_point_m: edge.now_m,
            tool_point_before_m: edge.before_m,
            stiffness_n_per_m: k,
            gap_before_m: (edge.before_m - at).dot(&direction),
            gap_predicted_m: (edge.now_m - at - velocity * body.dt_s()).dot(&direction),
            limit_n: f64::INFINITY,
            ..Contact::default()
        };
        let mut forward = spring(edge.frame.forward);
        (forward.limit_n, forward.yield_n) = anchor.limits_n(body, &edge.frame, edge.share_m);
        forward.mode = if forward.limit_n == 0.0 && forward.gap_predicted_m > 0.0 { Mode::Yield } else { anchor.mode };
        let mut lateral = spring(edge.frame.normal);
        lateral.bilateral = true;
        lateral.mode = lateral_mode(&forward);
        Self { marker, forward, lateral, unrelaxed: k / relaxed }
    }

    /// Takes the solution's change of velocity; returns whether a mode had to change.
    pub fn settle(&mut self, dt_s: f64, velocity_change: &[[f64; 3]]) -> bool {
        let changed = self.forward.settle(dt_s, velocity_change);
        self.lateral.take_solution(dt_s, velocity_change);
        self.lateral.mode = lateral_mode(&self.forward);
        changed
    }

    /// Concludes the step: books it, tells the anchor what its spring did, and returns how far the
    /// anchor advances, reference configuration.
    pub(super) fn conclude(
        &self,
        body: &Body,
        anchor: &mut Anchor,
        frame: &BladeFrame,
        share_m: f64,
        book: &mut FrontBook,
    ) -> Vec3 {
        let (forward, lateral) = (&self.forward, &self.lateral);
        let (k, force) = (forward.stiffness_n_per_m, forward.force_n);
        // What the force, capped while it yields, can still do over the gap: where the front may not
        // advance by all of it in one step, the rest waits at the cap.
        let cap_m = if forward.mode == Mode::Yield { forward.yield_n / k } else { f64::INFINITY };
        let spring = |gap: f64| {
            let gap = gap.max(0.0);
            let held = gap.min(cap_m);
            k * held * (gap - 0.5 * held)
        };
        let mut advance = 0.0;
        if forward.mode == Mode::Yield {
            advance = (forward.gap_m - forward.yield_n / k).max(0.0);
            advance = advance.min(MAX_ADVANCE_VOXELS * body.grid.voxel_size_m());
        }
        let aside = 0.5 * lateral.force_n * lateral.gap_m;
        let stored = if forward.mode == Mode::Off { 0.0 } else { spring(forward.gap_m - advance) } + aside;
        let work =
            force * (forward.gap_m - forward.gap_before_m) + lateral.force_n * (lateral.gap_m - lateral.gap_before_m);
        // The springs' stiffness falls as the material relaxes, and their energy with it.
        let relaxed = anchor.stored_j * (1.0 - self.unrelaxed / anchor.unrelaxed);
        let lost = work - (stored - anchor.stored_j) - force * advance - relaxed;
        book.damping_j += relaxed;
        if forward.mode == Mode::Yield && !anchor.yielded {
            book.initiation_j += lost;
        } else {
            book.numerical_j += lost;
        }
        book.slip_j += force * advance;
        book.stored_j += stored;
        anchor.stored_j = stored;
        anchor.unrelaxed = self.unrelaxed;
        anchor.mode = forward.mode;
        // Grazing the outside starts no cut.
        anchor.yielded |= forward.mode == Mode::Yield && anchor.ahead != Ahead::Outside;
        let mut step = anchor.march(body, frame, advance);
        if let Ahead::Intact { fracture_energy_j_per_m2, .. } = anchor.ahead
            && advance > 0.0
        {
            // What the front sweeps moving forward; what it slides along itself opens nothing.
            let area = step.norm() * anchor.reference_width_m(body, frame, share_m);
            book.area_m2 += area;
            book.fracture_j += fracture_energy_j_per_m2 * area;
        }
        if !anchor.yielded && forward.mode == Mode::Spring {
            let grip = EDGE_GRIP * force / lateral.stiffness_n_per_m;
            let excess = lateral.gap_m - lateral.gap_m.clamp(-grip, grip);
            // In the surface: where that is dented it would climb off it.
            let slip = anchor.pull_back(body, &frame.normal) * excess;
            step += slip - anchor.inward * slip.dot(&anchor.inward);
        }
        step
    }
}

/// The edge holds the material beside it while it presses on material that holds.
fn lateral_mode(forward: &Contact) -> Mode {
    if forward.mode != Mode::Off && forward.yield_n > 0.0 { Mode::Spring } else { Mode::Off }
}
