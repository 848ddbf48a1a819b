//! A marker: one segment of the edge, and how it comes into contact, stays in it and lets go.

use super::anchor::{Ahead, Anchor};
use super::crack::Crack;
use super::entry::{grazes, inward, is_on_surface, surface_behind};
use super::way_in::{WayIn, way_in};
use crate::Vec3;
use crate::body::Body;
use crate::contact::broad::NearElements;
use crate::contact::{Mode, narrow};
use crate::grid::MaterialPoint;
use crate::tool::frame::BladeFrame;
use serde::{Deserialize, Serialize};

/// A contact that has opened by this fraction of a voxel is let go where nothing is cut. Ours. A contact that is open
/// carries nothing, so that half or twice changes no force.
const RELEASE_VOXELS: f64 = 0.5;
/// A marker this many voxels beside its edge, or that goes on in material so far from where it was, has lost it.
/// Ours: more than a step's advance, less than the way to another wall. Strokes do not change by a bit with half or
/// twice of it.
const LOST_VOXELS: f64 = 2.0;

/// An edge that is put down less than this many voxels under the object's surface is outside still: surfaces are
/// known to about as much. It tells only for edges that appear at a surface; those that come in from outside do not
/// change by a bit.
const SKIN_VOXELS: f64 = 0.05;

/// A marker of an end is clear where it has this much of its clearance left. Ours: what comes on within a step is found
/// a step later, as far as that is not foreseen.
const CLEAR: f64 = 0.25;

/// One segment of the edge.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant, reason = "a box would be allocated as a marker comes into contact")]
pub(super) enum Marker {
    /// Not in the tissue.
    Outside,
    /// In the tissue without a front of its own: drawn backward, or come over by the tissue.
    Buried,
    /// In contact.
    On(Anchor),
    /// In the tissue, carried off the front with which it has cut.
    Lost,
}

/// What an edge may meet: a body, its elements near the edge, and its crack.
#[derive(Clone, Copy)]
pub struct Tissue<'a> {
    /// The body.
    pub body: &'a Body,
    /// Its elements near the edge.
    pub near: &'a NearElements,
    /// Where its cuts end.
    pub crack: &'a Crack,
}

/// A neighbour of a marker that is in contact, and the chord from its segment's middle to the marker's, scene frame, m.
pub(super) struct Beside {
    pub(super) anchor: Anchor,
    pub(super) chord_m: Vec3,
}

/// One segment of the edge during a step.
pub(super) struct Edge {
    /// Scene position of its middle at t, m.
    pub(super) before_m: Vec3,
    /// Scene position of its middle at t + dt, m.
    pub(super) now_m: Vec3,
    /// Directions of the blade at t + dt.
    pub(super) frame: BladeFrame,
    /// Half-width of the blade's edge, m.
    pub(super) half_width_m: f64,
    /// Factor on the spring that holds what is beside it.
    pub(super) penalty_factor: f64,
    /// Length of the segment, m.
    pub(super) segment_m: f64,
    /// Distance of its middle from the nearer end of the edge, m.
    pub(super) from_end_m: f64,
    /// How far it stands behind the blade's outline, m.
    pub(super) clearance_m: f64,
    /// Whether it is of an end of the edge, which cuts on where the edge has cut, and dents no surface that runs along it.
    pub(super) is_end: bool,
}

impl Edge {
    /// A marker that was outside: still is, or the edge has come in through a surface.
    pub(super) fn enter(&self, tissue: &Tissue<'_>, beside: Option<Beside>) -> Marker {
        let Tissue { body, near, crack } = *tissue;
        let Some(WayIn { point, at_m, last_m, fraction }) = way_in(body, near, &self.before_m, &self.now_m) else {
            return Marker::Outside;
        };
        let velocity = body.weights(&point).sum(&body.state.velocity_m_per_s);
        let came_m = at_m - last_m - velocity * (fraction * body.dt_s());
        let approach = came_m.dot(&self.frame.forward);
        let mut anchor = Anchor::at(point, self.frame.forward, self.half_width_m);
        let back = anchor.pull_back(body, &self.frame.forward);
        if approach > 0.0 {
            anchor.position_m = surface_behind(body, point.position_m, back, approach);
            anchor.inward = inward(body, &anchor.position_m, &anchor.inward).unwrap_or(anchor.inward);
        }
        let on_surface = is_on_surface(body, &anchor.position_m);
        let grazes = on_surface && grazes(body, &anchor.position_m, &back);
        // What comes in along itself, or through a wall of a cut, goes on with the cut of its neighbour.
        let slides = approach < came_m.dot(&self.frame.along).abs();
        let follows = slides || !on_surface;
        match beside {
            Some(beside) if follows && beside.anchor.yielded || grazes && !self.is_end => self.join(tissue, &beside),
            // An end that comes down behind its edge waits until that has cut.
            _ if slides && self.is_end => self.emerge(tissue),
            _ if approach > 0.0 && !(grazes && self.is_end) => {
                anchor.start_here(body, crack, &self.frame);
                self.unless_lost(tissue, anchor, &at_m)
            }
            _ => self.emerge(tissue),
        }
    }

    /// The edge came in through a side of the tissue that bulges along it, or the side bulged over the edge, past a
    /// neighbour that is in contact already: the marker goes on with the neighbour's front as soon as there is material
    /// for it there. (Where the edge itself is, it would stand deeper than the front by the contact's
    /// compression.)
    fn join(&self, tissue: &Tissue<'_>, beside: &Beside) -> Marker {
        let body = tissue.body;
        let mut anchor = beside.anchor;
        anchor.position_m += beside.anchor.pull_back(body, &beside.chord_m);
        (anchor.stored_j, anchor.beside_j) = (0.0, 0.0);
        anchor.ahead = Ahead::Outside;
        anchor.start_beside(body, &self.frame);
        if anchor.ahead == Ahead::Outside {
            return Marker::Outside;
        }
        let beside_m = beside.anchor.current_m(body) + beside.chord_m;
        self.unless_lost(tissue, anchor, &beside_m)
    }

    /// A marker at `anchor`, unless that has gone on in material that is far from `from_m`: the piece that it
    /// would go on in may have been carried away.
    fn unless_lost(&self, tissue: &Tissue<'_>, anchor: Anchor, from_m: &Vec3) -> Marker {
        let body = tissue.body;
        let far_m = LOST_VOXELS * body.state.grid.voxel_size_m();
        let holds = matches!(anchor.ahead, Ahead::Intact { .. });
        if holds && (anchor.current_m(body) - from_m).norm() > far_m {
            return self.emerge(tissue);
        }
        Marker::On(anchor)
    }

    /// Whether it stands clear of where its cut ends, and will at the end of the step: it presses on nothing.
    pub(super) fn is_clear(&self, body: &Body, anchor: &Anchor) -> bool {
        let presses = anchor.mode != Mode::Off || !anchor.yielded;
        if self.clearance_m == 0.0 || presses {
            return false;
        }
        let weights = anchor.weights(body);
        let end_m = weights.place_m(&body.state.position_m);
        let next_end_m = end_m + weights.sum(&body.state.velocity_m_per_s) * body.dt_s();
        let gap_m = (self.now_m - next_end_m).dot(&self.frame.forward);
        let aside_m = (self.now_m - end_m).dot(&self.frame.normal).abs();
        gap_m < -CLEAR * self.clearance_m && aside_m <= LOST_VOXELS * body.state.grid.voxel_size_m()
    }

    /// A marker that was in contact: still is, or has let go.
    pub(super) fn keep(&self, tissue: &Tissue<'_>, mut anchor: Anchor) -> Marker {
        let Tissue { body, near, crack } = *tissue;
        let h = body.state.grid.voxel_size_m();
        let was_m = anchor.current_m(body);
        anchor.look_ahead(body, crack, &self.frame);
        let offset = self.now_m - anchor.current_m(body);
        if offset.dot(&self.frame.normal).abs() > LOST_VOXELS * h {
            return if anchor.yielded { Marker::Lost } else { Marker::Buried };
        }
        let opened = offset.dot(&self.frame.forward) + anchor.behind_m < -RELEASE_VOXELS * h;
        let gone = opened && (!anchor.yielded || narrow::locate(body, near, &self.now_m).is_none());
        if gone { Marker::Outside } else { self.unless_lost(tissue, anchor, &was_m) }
    }

    /// A marker that `was` buried or lost: still is, has come out, or goes forward. Then it cuts on with a neighbour that
    /// cuts. One that was lost, as where all were carried off the front, cuts on from where it is.
    pub(super) fn emerge_or_go_on(&self, tissue: &Tissue<'_>, was: Marker, beside: Option<Beside>) -> Marker {
        let Tissue { body, near, .. } = *tissue;
        let Some(point) = within(body, near, &self.now_m) else { return Marker::Outside };
        let velocity = body.weights(&point).sum(&body.state.velocity_m_per_s);
        let came_m = self.now_m - self.before_m - velocity * body.dt_s();
        let [forward_m, slid_m] = [self.frame.forward, self.frame.along].map(|way| came_m.dot(&way));
        match (was, beside) {
            (_, Some(beside)) if beside.anchor.yielded && forward_m > 0.0 => self.join(tissue, &beside),
            (Marker::Lost, None) if forward_m > slid_m.abs() => {
                put_down(tissue, &self.now_m, &self.frame, self.half_width_m)
            }
            _ => was,
        }
    }

    /// A marker that was buried: still is, or has come out.
    pub(super) fn emerge(&self, tissue: &Tissue<'_>) -> Marker {
        if within(tissue.body, tissue.near, &self.now_m).is_some() { Marker::Buried } else { Marker::Outside }
    }
}

/// A marker whose segment of the edge is put down at `at_m`: in the tissue it goes on from there at once, as at the end
/// of a cut.
pub(super) fn put_down(tissue: &Tissue<'_>, at_m: &Vec3, frame: &BladeFrame, half_width_m: f64) -> Marker {
    let Tissue { body, near, crack } = *tissue;
    let Some(point) = within(body, near, at_m) else { return Marker::Outside };
    let mut anchor = Anchor::at(point, frame.forward, half_width_m);
    anchor.yielded = true;
    anchor.start_here(body, crack, frame);
    Marker::On(anchor)
}

/// The material at a point of an edge that has not come in through a surface. At the surface itself, where rounding
/// would tell, it is outside.
fn within(body: &Body, near: &NearElements, at_m: &Vec3) -> Option<MaterialPoint> {
    let skin_m = SKIN_VOXELS * body.state.grid.voxel_size_m();
    narrow::locate(body, near, at_m).filter(|p| -body.state.grid.signed_distance_m(&p.position_m) > skin_m)
}
