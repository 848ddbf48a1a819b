//! The springs between a segment of the edge and its anchor, through one step: set up, settled with the
//! solve, concluded.

use super::anchor::{Ahead, Anchor};
use super::book::FrontBook;
use super::drive::Strained;
use super::link_energy;
use super::marker::Edge;
use crate::Vec3;
use crate::body::Body;
use crate::contact::{COMES_OUT_VOXELS_PER_S, Contact, Misjudged, Mode, Solution, ToolEnds, pressed_m};
use crate::scene::FractureRule;
use crate::tool::frame::BladeFrame;
use serde::{Deserialize, Serialize};

/// A front does not advance by more than this many voxels in a step; what is left of the way waits at the cap. Ours: 5
/// m/s at 250 Hz in voxels of 1.25 mm. With an eighth of it a blade of 3.5 m/s leaves the tissue before its front has come
/// through, and a bridge behind it.
const MAX_ADVANCE_VOXELS: f64 = 16.0;
/// Virgin contact slides sideways where the sideways force exceeds this fraction of the forward one. Ours: dry
/// friction of a blade on tissue is below 1, so that an edge rather holds than slides off. Half of it parts one link
/// in 465 fewer where an edge comes in askew, twice changes nothing.
const EDGE_FRICTION: f64 = 1.0;

/// The way, in voxels, over which a front that goes on comes after an edge that is taken across its own plane, as that of a
/// blade drawn along a curve. Ours: what the lateral spring stands for, the walls beside the edge, is about as long. A
/// disc of 30 mm that a turning blade of 8 mm cuts out of a sheet is larger by 3 % of its area with twice of it. With a
/// hundred times of it the front loses the edge after 150 degrees.
const STEERS_WITHIN_VOXELS: f64 = 1.0;

/// Largest force along the edge over Gc per length: `xi / (1 + xi^2)` at xi = 1 (Atkins, Xu and Jeronimidis 2004). It
/// holds where an edge turns round before its way is known anew. Where an edge slices to and fro, half of it takes 10
/// % off the mean force, twice adds 3 %; an edge that only presses does not know of it.
const MOST_DRAG: f64 = 0.5;

/// An edge that cuts may be farther ahead of its front than work has pressed it, as where it joins a neighbour's. It catches up by
/// this fraction of its way through the tissue, which makes as much of the force's work from nothing. Ours. With none of it
/// the front stays behind where it joined, and leaves a bridge of a segment in the cut.
const CATCHES_UP: f64 = 0.01;

/// The springs of one marker during a step.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct FrontContact {
    /// Which marker of the front they belong to.
    pub(super) marker: usize,
    /// Along the cutting direction.
    pub forward: Contact,
    /// Along the blade's normal; acts while `forward` does. While that is capped the front goes aside as it advances, and
    /// the spring is the softer for it.
    pub lateral: Contact,
    /// Stiffness of the lateral spring where the front stays, N/m.
    lateral_n_per_m: f64,
    /// What the front has been carried aside from the edge without force, m.
    carried_m: f64,
    /// Along the edge, while `forward` is capped and the edge slices: a dashpot, whose gap is what the edge
    /// has slid in this step.
    pub along: Contact,
    /// Stiffness of the springs over what they relax to.
    unrelaxed: f64,
}

impl FrontContact {
    /// Sets up the springs between `edge` and the anchor of its marker.
    pub(super) fn new(body: &Body, marker: usize, edge: &Edge, anchor: &Anchor, strained: &Strained) -> Self {
        let weights = anchor.weights(body);
        let at = weights.place_m(&body.state.position_m);
        let velocity = weights.sum(&body.state.velocity_m_per_s);
        let [k, relaxed] =
            anchor.stiffness_n_per_m2(body, &edge.frame, edge.from_end_m).map(|per_length| edge.segment_m * per_length);
        let spring = |direction: Vec3| Contact {
            ends: ToolEnds { weights, tool_point_m: edge.now_m, tool_point_before_m: edge.before_m },
            direction,
            stiffness_n_per_m: k,
            gap_before_m: (edge.before_m - at).dot(&direction),
            gap_predicted_m: (edge.now_m - at - velocity * body.dt_s()).dot(&direction),
            ..Contact::default()
        };
        let mut forward = spring(edge.frame.forward);
        (forward.limit_n, forward.yield_n) = match body.description.fracture_rule {
            FractureRule::Front => anchor.limits_n(body, &edge.frame, edge.segment_m, strained),
            FractureRule::LinkEnergy => link_energy::limits_n(body, anchor, &edge.frame),
        };
        forward.mode = match anchor.mode {
            _ if forward.limit_n == 0.0 && forward.gap_predicted_m > 0.0 => Mode::Yield,
            // What went freely has come upon what never gives.
            Mode::Yield if forward.yield_n.is_infinite() => Mode::Spring,
            mode => mode,
        };
        shift_gap(&mut forward, |gap_m| gap_m + anchor.behind_m);
        let mut lateral = spring(edge.frame.normal);
        lateral.stiffness_n_per_m *= edge.penalty_factor;
        lateral.bilateral = true;
        // Found farther in, or more to the side, than work has pressed it, an edge does not push for that: it would make
        // energy.
        let comes_out_m = COMES_OUT_VOXELS_PER_S * body.dt_s() * body.state.grid.voxel_size_m();
        let way_m = (edge.now_m - edge.before_m - velocity * body.dt_s()).norm();
        let by_work_m = pressed_to_m(&forward, anchor.stored_j - anchor.beside_j);
        let most_m = match forward.mode {
            _ if anchor.yielded => by_work_m + CATCHES_UP * way_m,
            // One that touches for the first time is in by its way in a step at most.
            Mode::Off => way_m.max(comes_out_m),
            // The markers of one that dents slide along it to where the tissue is deeper.
            _ => by_work_m,
        };
        shift_gap(&mut forward, |gap_m| gap_m.min(most_m));
        let aside_m = pressed_m(lateral.stiffness_n_per_m, anchor.beside_j) + comes_out_m;
        let carried_m = -shift_gap(&mut lateral, |gap_m| gap_m.clamp(-aside_m, aside_m));
        lateral.mode = lateral_mode(&forward);
        let lateral_n_per_m = lateral.stiffness_n_per_m;
        lateral.stiffness_n_per_m /= 1.0 + steered(body, &forward, anchor);
        let mut slide = spring(edge.frame.along);
        slide.gap_predicted_m -= slide.gap_before_m;
        let along = drag(body, slide, &forward, anchor);
        Self { marker, forward, lateral, lateral_n_per_m, carried_m, along, unrelaxed: k / relaxed }
    }

    /// Takes the solution's change of velocity; returns how wrong the modes were.
    pub fn settle(&mut self, dt_s: f64, velocity_change: &[[f64; 3]], solution: Solution) -> Misjudged {
        let change_m_per_s = self.forward.ends.weights.sum(velocity_change);
        let mut wrong = self.forward.settle(dt_s, &change_m_per_s, solution);
        self.lateral.take_solution(dt_s, &change_m_per_s);
        self.lateral.mode = lateral_mode(&self.forward);
        if self.forward.mode == Mode::Yield && self.along.stiffness_n_per_m > 0.0 {
            wrong += self.along.settle(dt_s, &change_m_per_s, solution);
            return wrong;
        }
        self.along.take_solution(dt_s, &change_m_per_s);
        self.along.mode = Mode::Off;
        wrong
    }

    /// Concludes the step: books it, tells the anchor what its spring did, and returns how far the
    /// anchor advances, reference configuration.
    pub(super) fn conclude(
        &self,
        body: &Body,
        anchor: &mut Anchor,
        frame: &BladeFrame,
        segment_m: f64,
        book: &mut FrontBook,
    ) -> Vec3 {
        let (forward, lateral) = (&self.forward, &self.lateral);
        let (k, force) = (forward.stiffness_n_per_m, forward.force_n);
        let (mut step, mut advance) = (Vec3::zeros(), 0.0);
        if forward.mode == Mode::Yield {
            let most_m = MAX_ADVANCE_VOXELS * body.state.grid.voxel_size_m();
            (step, advance) = anchor.march(body, frame, (forward.gap_m - cap_m(forward)).max(0.0).min(most_m));
        }
        let gap_left_m = forward.gap_m - advance;
        let aside_left_m = lateral.force_n / self.lateral_n_per_m;
        let aside = if lateral.mode == Mode::Off { 0.0 } else { lateral.gap_m - aside_left_m };
        // An edge cuts ahead, not with its flank: it makes up for what it was carried at 45 degrees at most.
        let most_m = advance.max(0.0);
        step += anchor.pull_back(body, &frame.normal) * (aside + self.carried_m.clamp(-most_m, most_m));
        let held = match forward.mode {
            Mode::Off => 0.0,
            // Between what it has cut and what holds next it does nothing, and keeps what it has room for.
            Mode::Yield if forward.yield_n == 0.0 => anchor.stored_j.min(0.5 * k * gap_left_m.max(0.0).powi(2)),
            Mode::Spring | Mode::Yield => held_j(forward, gap_left_m),
        };
        let beside = 0.5 * lateral.force_n * aside_left_m;
        let stored = held + beside;
        // Its force times the way of the front, as long as it stays at its cap.
        let let_go = held_j(forward, forward.gap_m) - held_j(forward, gap_left_m) + lateral.force_n * aside;
        let work =
            force * (forward.gap_m - forward.gap_before_m) + lateral.force_n * (lateral.gap_m - lateral.gap_before_m);
        // The springs' stiffness falls as the material relaxes, and their energy with it.
        let relaxed = anchor.stored_j * (1.0 - self.unrelaxed / anchor.unrelaxed);
        let lost = work - (stored - anchor.stored_j) - let_go - relaxed;
        book.damping_j += relaxed;
        if forward.mode == Mode::Yield && !anchor.yielded {
            book.initiation_j += lost;
        } else {
            book.lost_j += lost;
        }
        book.slip_j += let_go + self.along.force_n * self.along.gap_m;
        book.stored_j += stored;
        anchor.stored_j = stored;
        anchor.beside_j = beside;
        anchor.unrelaxed = self.unrelaxed;
        anchor.mode = forward.mode;
        if forward.mode == Mode::Off {
            anchor.behind_m = 0.0;
        }
        // Grazing the outside starts no cut.
        anchor.yielded |= forward.mode == Mode::Yield && anchor.ahead != Ahead::Outside;
        if let Some(toughness_j_per_m2) = anchor.toughness_j_per_m2(body)
            && forward.mode == Mode::Yield
        {
            // What the front sweeps moving forward; what it slides along itself opens nothing.
            let area = step.norm() * anchor.reference_width_m(body, frame, segment_m);
            book.area_m2 += area;
            book.fracture_j += toughness_j_per_m2 * area;
        }
        if anchor.yielded {
            let slid_m = self.along.gap_m * self.along.direction.dot(&frame.along);
            anchor.travel.add(advance, slid_m, body.dt_s(), body.state.grid.voxel_size_m());
        }
        if !anchor.yielded && forward.mode == Mode::Spring {
            let held_m = EDGE_FRICTION * force / lateral.stiffness_n_per_m;
            let excess = lateral.gap_m - lateral.gap_m.clamp(-held_m, held_m);
            // In the surface: where that is dented it would climb off it.
            let slip = anchor.pull_back(body, &frame.normal) * excess;
            step += slip - anchor.inward * slip.dot(&anchor.inward);
        }
        step
    }
}

/// The gap at which the force reaches its cap, m.
fn cap_m(forward: &Contact) -> f64 {
    if forward.mode == Mode::Yield { forward.yield_n / forward.stiffness_n_per_m } else { f64::INFINITY }
}

/// What the force, capped while it yields, can still do over a gap, J: where the front may not advance by all of it in
/// one step, the rest waits at the cap.
fn held_j(forward: &Contact, gap_m: f64) -> f64 {
    let gap_m = gap_m.max(0.0);
    let held_m = gap_m.min(cap_m(forward));
    forward.stiffness_n_per_m * held_m * (gap_m - 0.5 * held_m)
}

/// The gap that so much energy has pressed it to, m: the inverse of [`held_j`]; any where that takes no force.
fn pressed_to_m(forward: &Contact, held_j: f64) -> f64 {
    match forward.mode {
        Mode::Yield if forward.yield_n == 0.0 => f64::INFINITY,
        Mode::Yield if held_j > 0.5 * forward.yield_n * cap_m(forward) => {
            0.5 * cap_m(forward) + held_j / forward.yield_n
        }
        Mode::Off | Mode::Spring | Mode::Yield => pressed_m(forward.stiffness_n_per_m, held_j),
    }
}

/// Begins the step at another gap; returns what that adds.
fn shift_gap(contact: &mut Contact, to: impl Fn(f64) -> f64) -> f64 {
    let by_m = to(contact.gap_before_m) - contact.gap_before_m;
    contact.gap_before_m += by_m;
    contact.gap_predicted_m += by_m;
    by_m
}

/// The edge holds the material beside it while it presses on material that holds.
fn lateral_mode(forward: &Contact) -> Mode {
    if forward.mode != Mode::Off && forward.yield_n > 0.0 { Mode::Spring } else { Mode::Off }
}

/// By what a front that goes on gives way aside in a step, over what its lateral spring does.
fn steered(body: &Body, forward: &Contact, anchor: &Anchor) -> f64 {
    let voxel_size_m = body.state.grid.voxel_size_m();
    if forward.mode != Mode::Yield || !anchor.travel.is_known(voxel_size_m) {
        return 0.0;
    }
    anchor.travel.speed_m_per_s() * body.dt_s() / (STEERS_WITHIN_VOXELS * voxel_size_m)
}

/// What the edge drags along as it slices: the force is opposite to the edge's motion relative to the front,
/// of size `Gc v_n / |v|` per length (Atkins, Xu and Jeronimidis, J. Mater. Sci. 39, 2004, 2761), so
/// that its work is Gc per area swept whichever way the edge goes. Its part along the edge is
/// `forward.yield_n` times the slice-push ratio, as far as that counts: an edge that only slides opens nothing. Here, times this step's slide over the mean advance. Taken
/// of past slides alone it would push on after tissue softer than Gc over a voxel has turned round.
fn drag(body: &Body, slide: Contact, forward: &Contact, anchor: &Anchor) -> Contact {
    let advance_m = anchor.travel.speed_m_per_s() * body.dt_s();
    let most_n = MOST_DRAG * forward.yield_n * (1.0 + anchor.travel.slice_push().powi(2));
    let known = anchor.travel.is_known(body.state.grid.voxel_size_m());
    let acts = known && advance_m > 0.0 && forward.yield_n > 0.0;
    let way = if slide.gap_predicted_m < 0.0 { -1.0 } else { 1.0 };
    Contact {
        direction: slide.direction * way,
        stiffness_n_per_m: if acts { anchor.travel.advanced_share() * forward.yield_n / advance_m } else { 0.0 },
        gap_before_m: 0.0,
        gap_predicted_m: slide.gap_predicted_m * way,
        limit_n: most_n,
        yield_n: most_n,
        bilateral: true,
        mode: if acts && forward.mode == Mode::Yield { Mode::Spring } else { Mode::Off },
        ..slide
    }
}
