//! The front: a chain of markers along a blade's edge.
//!
//! Each marker has a segment of the edge's width and, once in contact, a material point X that the edge
//! pushes on through a spring whose force is capped. While it is capped, X advances through the
//! material by what the edge moved beyond the spring; the strip between the old and the new chain is
//! the cut.

use super::anchor::{Ahead, Anchor};
use super::book::FrontBook;
use super::crack::{AT_VOXELS, Crack, Span};
use super::drive::{Drive, Piece, Strained, is_small};
use super::entry::{inward, is_on_surface, onto_surface};
use super::link_energy;
use super::marker::{Beside, Edge, Marker, Tissue, put_down};
use super::release::INNER;
use super::springs::FrontContact;
use super::sweep::{PartingCost, part_quad};
use crate::Vec3;
use crate::body::Body;
use crate::contact::{Mode, ON_SURFACE_VOXELS};
use crate::grid::{Crossing, Link, LinkId};
use crate::grow::make_room;
use crate::scene::FractureRule;
use crate::tool::Pose;
use crate::tool::blade::Blade;
use crate::tool::edge::EdgeSegment;
use crate::tool::frame::BladeFrame;
use crate::walk::Kept;
use serde::{Deserialize, Serialize};

/// Markers per voxel edge. Ours: two find every link. One moves the first peak by up to 4 % and the mean force by 1 %,
/// and parts 4 links in 465 fewer; four take 2 to 3 % off the peak, at twice the cost of contact.
const MARKERS_PER_VOXEL: f64 = 2.0;
/// Neighbouring markers farther apart than this in the material stand in different pieces of it. Ours: as far as half
/// a voxel is stretched sixteen times. Strokes do not change by a bit with half or twice of it.
const CHAIN_GAP_VOXELS: f64 = 8.0;
/// A cut starts this far outside the point where the edge came in, so that the voxels at the surface part too. Ours:
/// their centres are within half a voxel of it. Half or twice changes no bit of strokes that come down on a lattice's
/// face.
const START_VOXELS: f64 = 0.5;

/// The front of one blade in one body.
#[derive(Clone, Serialize, Deserialize)]
pub struct Front {
    markers: Vec<Marker>,
    /// Segments of the blade's outline, one to a marker.
    segments: Kept<Vec<EdgeSegment>>,
    /// How many of them are of the first end, and of the edge after it; the others are of the last end.
    counts: [usize; 2],
    /// Directions of each segment at t + dt, scene frame: scratch, kept between steps.
    #[serde(skip)]
    frames: Vec<BladeFrame>,
    /// Energy in springs that were let go since it was last taken, J.
    dropped_j: f64,
    /// Where the chain stands and starts, and where its strip ends: scratch, kept between steps.
    #[serde(skip)]
    chain: Vec<Option<ChainPoint>>,
    #[serde(skip)]
    target: Vec<Vec3>,
    /// Pieces of the front that cut: scratch, kept between steps.
    #[serde(skip)]
    spans: Vec<Span>,
    /// What drives it in a body that is strained; present in one under tension, or so small beside Gc/E that cutting
    /// strains all of it.
    drive: Option<Drive>,
    /// Whether the blade was put down in the tissue and the cut that it stands in is to be opened.
    opens_own_cut: bool,
    /// Springs of the step that is being taken.
    pub contacts: Vec<FrontContact>,
}

/// Where a marker stands on the chain.
#[derive(Clone, Copy)]
struct ChainPoint {
    /// Reference position, m.
    position_m: Vec3,
    /// Where the cut begins, reference configuration, m.
    start_m: Vec3,
    /// From it to the middle of its segment of the edge, scene frame, m.
    to_edge_m: Vec3,
    /// Where its spring acts, scene frame, and by how much that is behind it, m.
    acts_at_m: Vec3,
    behind_m: f64,
    /// The elements that carry it.
    elements: [usize; 2],
}

/// Where a step's front is seen from: the blade and its poses.
#[derive(Clone, Copy)]
pub struct BladeMotion<'a> {
    /// The blade.
    pub blade: &'a Blade,
    /// Pose at t.
    pub before: Pose,
    /// Pose at t + dt.
    pub pose: Pose,
}

impl Front {
    /// A front of `blade`, nowhere in contact.
    #[must_use]
    pub fn new(blade: &Blade, body: &Body) -> Self {
        let (segments, counts) = blade.outline(body.state.grid.voxel_size_m() / MARKERS_PER_VOXEL);
        let count = segments.len();
        Self {
            markers: vec![Marker::Outside; count],
            segments: segments.into(),
            counts,
            frames: Vec::with_capacity(count),
            dropped_j: 0.0,
            chain: Vec::with_capacity(count),
            target: Vec::with_capacity(count),
            spans: Vec::with_capacity(3 * count),
            drive: is_small(body).then(Drive::default),
            opens_own_cut: false,
            contacts: Vec::with_capacity(count),
        }
    }

    /// Whether it is one of an edge of as many segments.
    #[must_use]
    pub fn is_like(&self, other: &Self) -> bool {
        let count = other.segments.len();
        let known = self.contacts.iter().all(|contact| contact.marker < count);
        [self.segments.len(), self.markers.len()] == [count; 2] && known
    }

    /// Number of its markers.
    #[must_use]
    pub fn markers(&self) -> usize {
        self.markers.len()
    }

    /// Number of springs that the front may have at most.
    #[must_use]
    pub fn most_springs(&self) -> usize {
        3 * self.markers.len()
    }

    /// Room for a spring on every marker, which a copy of a front lacks.
    pub fn reserve(&mut self) {
        let count = self.markers.len();
        make_room(&mut self.chain, count);
        make_room(&mut self.target, count);
        make_room(&mut self.spans, 3 * count);
        make_room(&mut self.contacts, count);
    }

    /// Forgets every contact.
    pub fn lift(&mut self) {
        for marker in &mut self.markers {
            if let Marker::On(anchor) = marker {
                self.dropped_j += anchor.stored_j;
            }
            *marker = Marker::Outside;
        }
        self.opens_own_cut = false;
        self.contacts.clear();
        self.drive.iter_mut().for_each(Drive::clear);
    }

    /// Puts the blade down. Where that is in the tissue it stands in a cut of its own making, which the step's
    /// [`Self::advance`] opens, and cuts on from there. An edge no part of which is deeper than on the surface has cut
    /// nothing: what is ahead of it dents before it parts.
    pub fn enter(&mut self, tissue: &Tissue<'_>, motion: &BladeMotion<'_>) {
        self.lift();
        let grid = &tissue.body.state.grid;
        for (marker, segment) in self.markers.iter_mut().zip(self.segments.iter()) {
            let (at_m, frame) =
                (motion.pose.transform(&segment.outline_m()), segment.frame.turned(&motion.pose.orientation));
            *marker = put_down(tissue, &at_m, &frame, motion.blade.edge_half_width_m);
            let Marker::On(anchor) = marker else { continue };
            self.opens_own_cut |= -grid.signed_distance_m(&anchor.start_m) > ON_SURFACE_VOXELS * grid.voxel_size_m();
        }
        for marker in &mut self.markers {
            if let Marker::On(anchor) = marker {
                anchor.yielded = self.opens_own_cut;
            }
        }
    }

    /// Finds which markers touch the tissue and sets up their springs. Tissue is `near` the first end, the edge and the
    /// last end, or not.
    pub fn detect(&mut self, tissue: &Tissue<'_>, motion: &BladeMotion<'_>, near: [bool; 3]) {
        self.contacts.clear();
        self.frames.clear();
        self.frames.extend(self.segments.iter().map(|segment| segment.frame.turned(&motion.pose.orientation)));
        let strained = self.drive.as_ref().map_or(Strained::NOT, Drive::strained);
        let edge = self.of_edge();
        for (part, near) in [0..edge.start, edge.clone(), edge.end..self.markers.len()].into_iter().zip(near) {
            if near || self.markers[part.clone()].iter().any(|marker| !matches!(marker, Marker::Outside)) {
                part.for_each(|index| self.detect_at(index, tissue, motion, &strained));
            }
        }
    }

    /// Finds whether a marker touches the tissue and sets up its springs.
    fn detect_at(&mut self, index: usize, tissue: &Tissue<'_>, motion: &BladeMotion<'_>, strained: &Strained) {
        let segment = &self.segments[index];
        let edge = Edge {
            before_m: motion.before.transform(&segment.middle_m),
            now_m: motion.pose.transform(&segment.middle_m),
            frame: self.frames[index],
            half_width_m: motion.blade.edge_half_width_m,
            penalty_factor: motion.blade.penalty_factor,
            segment_m: segment.length_m,
            from_end_m: segment.from_end_m,
            clearance_m: segment.clearance_m,
            is_end: !self.of_edge().contains(&index),
        };
        let was = self.markers[index];
        let now = match was {
            Marker::On(anchor) if anchor.knows_ahead(tissue.body) && edge.is_clear(tissue.body, &anchor) => return,
            Marker::On(anchor) => edge.keep(tissue, anchor),
            Marker::Outside => edge.enter(tissue, self.beside(index, &motion.pose)),
            Marker::Buried | Marker::Lost => edge.emerge_or_go_on(tissue, was, self.beside(index, &motion.pose)),
        };
        match (&was, &now) {
            (_, Marker::On(anchor)) if edge.is_clear(tissue.body, anchor) => {}
            (_, Marker::On(anchor)) => {
                self.contacts.push(FrontContact::new(tissue.body, index, &edge, anchor, strained));
            }
            (Marker::On(let_go), _) => self.dropped_j += let_go.stored_j,
            _ => {}
        }
        self.markers[index] = now;
    }

    /// Advances the markers that gave way, and the body's crack with them, finds the links their strips cross, and books
    /// the energy; in the step that they were detected in. Where the body is `in_tension`, what that adds is felt from then
    /// on.
    pub fn advance(
        &mut self,
        body: &Body,
        crack: &mut Crack,
        motion: &BladeMotion<'_>,
        in_tension: bool,
        links: &mut Vec<(LinkId, Crossing)>,
    ) -> FrontBook {
        let mut book = FrontBook::default();
        if std::mem::take(&mut self.opens_own_cut) {
            self.open_own_cut(body, motion.blade.flanks.height_m(), links);
        }
        let by_link_energy = body.description.fracture_rule == FractureRule::LinkEnergy;
        let first_link = links.len();
        for contact in &self.contacts {
            let Marker::On(anchor) = &mut self.markers[contact.marker] else { continue };
            let frame = self.frames[contact.marker];
            let virgin = !anchor.yielded;
            let mut step = contact.conclude(body, anchor, &frame, self.segments[contact.marker].length_m, &mut book);
            if by_link_energy {
                step += link_energy::give_way(body, anchor, &frame, &contact.forward, &mut book);
            }
            if virgin && anchor.yielded {
                anchor.start_m = anchor.position_m;
                self.open_beside(body, contact.marker, links);
            }
            if let Marker::On(anchor) = &mut self.markers[contact.marker] {
                anchor.go_on(body, step);
            }
        }
        self.take_crack_along(body, crack);
        self.sweep(body, links);
        if by_link_energy {
            let cost = PartingCost::of(body, &mut links[first_link..]);
            (book.area_m2, book.fracture_j) = (cost.area_m2, cost.fracture_j);
        }
        book.slip_j -= book.fracture_j;
        self.follow_edge(body, &motion.pose);
        self.drop_outside(body, &mut book);
        if in_tension && self.drive.is_none() {
            self.drive = Some(Drive::default());
        }
        book
    }

    /// Parts what the blade stands in, from its edge up to its spine. Nobody pushed it there, so this takes no work and is
    /// in no book. A link beside a cut stays whole: a blade that comes back into its own cut is not to make a second one.
    fn open_own_cut(&self, body: &Body, height_m: f64, links: &mut Vec<(LinkId, Crossing)>) {
        let mut cut = Vec::new();
        // From the edge to the spine, reference configuration.
        let up = |index: usize| self.anchor(index).map(|a| -a.pull_back(body, &self.frames[index].forward) * height_m);
        for index in self.of_edge() {
            let (Some(own), Some(up_m)) = (self.anchor(index), up(index)) else { continue };
            let from = own.swept_m;
            for (side, left) in [(-1.0, index.wrapping_sub(1)), (1.0, index)] {
                match (self.segment(body, left).filter(|_| self.goes_on(left)), up(index + 1)) {
                    (Some(ends), Some(next_up_m)) if left == index => {
                        let to = ends[1].swept_m;
                        part_quad(body, [from, to, to + next_up_m, from + up_m], &mut cut);
                    }
                    (Some(_), _) => {}
                    (None, _) => {
                        let half = own.pull_back(body, &self.frames[index].along)
                            * (0.5 * side * self.segments[index].length_m);
                        part_quad(body, [from, from + half, from + half + up_m, from + up_m], &mut cut);
                    }
                }
            }
        }
        let grid = &body.state.grid;
        cut.retain(|(link, _)| {
            ![-1, 1].into_iter().any(|side| {
                let mut beside = *link;
                beside.cell[beside.axis as usize] += side;
                matches!(grid.link(beside), Link::Parted(_))
            })
        });
        links.append(&mut cut);
    }

    /// Parts what lies between the surface, the marker `index` that is about to start cutting, and the
    /// cut of a neighbour that started before it: on a curved surface the edge comes in segment by segment.
    fn open_beside(&self, body: &Body, index: usize, links: &mut Vec<(LinkId, Crossing)>) {
        let Some(own) = self.anchor(index) else { return };
        let frame = &self.frames[index];
        let out = own.pull_back(body, &frame.forward).normalize() * (-START_VOXELS * body.state.grid.voxel_size_m());
        let nudge = own.nudge(body, frame);
        for left in [index.wrapping_sub(1), index] {
            let Some(ends) = self.segment(body, left) else { continue };
            let other = if left == index { ends[1] } else { ends[0] };
            let [from, to] = [own.start_m + nudge, other.start_m + nudge];
            part_quad(body, [from, to, to + out, from + out], links);
            if other.yielded {
                part_quad(body, [from, to, other.swept_m, own.swept_m], links);
            }
        }
    }

    /// Parts the links between where the chain was and where it is now. Neighbours share their edges of
    /// the strip, consecutive strips the chain between them: no link slips through, whichever markers
    /// move.
    fn sweep(&mut self, body: &Body, links: &mut Vec<(LinkId, Crossing)>) {
        let count = self.markers.len();
        let mut target = std::mem::take(&mut self.target);
        target.clear();
        let end = |i| self.anchor(i).map_or(Vec3::zeros(), |a| a.strip_end_m(body, &self.frames[i]));
        target.extend((0..count).map(end));
        for index in 0..count {
            let Some(own) = self.anchor(index) else { continue };
            let (from, to) = (own.swept_m, target[index]);
            for (side, left) in [(-1.0, index.wrapping_sub(1)), (1.0, index)] {
                let segment = self.segment(body, left).filter(|ends| ends[0].yielded || ends[1].yielded);
                if let Some(ends) = segment {
                    if left == index {
                        part_quad(body, [from, ends[1].swept_m, target[index + 1], to], links);
                    }
                } else if own.yielded {
                    // The chain ends here: half a segment beyond at the blade's end, and up to the next
                    // marker where that one is outside the material.
                    let half =
                        own.pull_back(body, &self.frames[index].along) * (0.5 * side * self.segments[index].length_m);
                    let beside = if left == index { index + 1 } else { left };
                    let outside = self.goes_on(left) && matches!(self.markers.get(beside), Some(Marker::Outside));
                    let reach = if outside { 2.0 * half } else { half };
                    part_quad(body, [from, from + reach, to + reach, to], links);
                }
            }
        }
        for (marker, target) in self.markers.iter_mut().zip(&target) {
            if let Marker::On(anchor) = marker {
                anchor.swept_m = *target;
            }
        }
        self.target = target;
    }

    /// The body's crack goes on where markers cut, in the step that they were detected in.
    fn take_crack_along(&mut self, body: &Body, crack: &mut Crack) {
        let mut spans = std::mem::take(&mut self.spans);
        spans.clear();
        let presses = |index: usize| self.contacts.binary_search_by_key(&index, |contact| contact.marker).is_ok();
        let has_cut = |anchor: &&Anchor| anchor.yielded && matches!(anchor.ahead, Ahead::Intact { .. });
        let cuts = |index: usize| self.anchor(index).filter(has_cut).filter(|_| presses(index));
        for (index, frame) in self.frames.iter().enumerate() {
            let Some(own) = cuts(index) else { continue };
            let way = own.way(body, frame);
            let half_m = 0.5 * own.reference_width_m(body, frame, self.segments[index].length_m);
            // One that was put down in tissue has cut nothing before it goes on.
            let goes_on = (own.position_m - own.swept_m).dot(&way.ahead) > AT_VOXELS * body.state.grid.voxel_size_m();
            if goes_on && !own.is_at_end() {
                crack.begin(&way, half_m);
            }
            let (from_m, ahead) = (own.position_m, way.ahead);
            let went = |anchor: &Anchor| (anchor.position_m - anchor.swept_m).norm();
            for (side, left) in [(-1.0, index.wrapping_sub(1)), (1.0, index)] {
                let beside = if left == index { index + 1 } else { left };
                match cuts(beside).filter(|_| self.goes_on(left) && self.segment(body, left).is_some()) {
                    Some(next) if left == index => {
                        let went_m = went(own).max(went(next));
                        spans.push(Span { from_m, to_m: next.position_m, ahead, went_m });
                    }
                    Some(_) => {}
                    None => {
                        let to_m = from_m + way.along * (side * half_m);
                        spans.push(Span { from_m, to_m, ahead, went_m: went(own) });
                    }
                }
            }
        }
        crack.follow(body, &spans);
        self.spans = spans;
    }

    /// Slides markers along the chain to where their segment of the edge is now.
    fn follow_edge(&mut self, body: &Body, pose: &Pose) {
        let mut chain = std::mem::take(&mut self.chain);
        chain.clear();
        chain.extend((0..self.markers.len()).map(|i| {
            let anchor = self.anchor(i)?;
            let current_m = anchor.current_m(body);
            Some(ChainPoint {
                position_m: anchor.position_m,
                start_m: anchor.start_m,
                to_edge_m: pose.transform(&self.segments[i].middle_m) - current_m,
                acts_at_m: current_m - self.frames[i].forward * anchor.behind_m,
                behind_m: anchor.behind_m,
                elements: anchor.elements(body),
            })
        }));
        let gap = CHAIN_GAP_VOXELS * body.state.grid.voxel_size_m();
        for index in 0..self.markers.len() {
            let Marker::On(anchor) = self.markers[index] else { continue };
            let along = self.frames[index].along;
            let Some(own) = chain[index] else { continue };
            let to_edge_m = own.to_edge_m;
            let slip = to_edge_m.dot(&along);
            let next = if slip > 0.0 { index + 1 } else { index.wrapping_sub(1) };
            let beside = chain.get(next).copied().flatten().filter(|_| self.goes_on(index.min(next)));
            let mut moved = anchor;
            match beside.filter(|b| (b.position_m - anchor.position_m).norm() < gap) {
                Some(beside) => {
                    let fraction = (slip.abs() / self.segments[index].length_m).min(1.0);
                    let unbend = self.unbend(body, &anchor, pose, [index, next], &beside.to_edge_m);
                    moved.position_m += (beside.position_m - anchor.position_m) * fraction;
                    moved.behind_m = slid_behind_m(body, &moved, &self.frames[index].forward, fraction, [own, beside]);
                    moved.position_m += unbend * fraction;
                    moved.start_m += (beside.start_m - anchor.start_m + unbend) * fraction;
                }
                None => {
                    // Round a corner of the outline it goes no farther than what is beyond has cut.
                    let lead_m = |corner: ChainPoint| {
                        let apart_m = pose.orientation * (self.segments[index].middle_m - self.segments[next].middle_m);
                        (apart_m - to_edge_m + corner.to_edge_m).dot(&along) * slip.signum()
                    };
                    let most_m =
                        chain.get(next).copied().flatten().map_or(f64::INFINITY, |corner| (-lead_m(corner)).max(0.0));
                    let shift = anchor.pull_back(body, &along) * slip.clamp(-most_m, most_m);
                    moved.position_m += shift;
                    moved.start_m += shift;
                }
            }
            // One that has come in through a wall of a cut stays there.
            if !moved.yielded && is_on_surface(body, &anchor.position_m) {
                moved.position_m = onto_surface(body, moved.position_m);
                moved.start_m = moved.position_m;
                moved.inward = inward(body, &moved.position_m, &moved.inward).unwrap_or(moved.inward);
            }
            self.markers[index] = Marker::On(moved);
        }
        self.chain = chain;
    }

    /// Samples what the strained body adds to the drive of the front, in a step that it has advanced in.
    pub fn sample_drive(&mut self, body: &Body) {
        if body.description.fracture_rule == FractureRule::LinkEnergy {
            return;
        }
        let Some(mut drive) = self.drive.take() else { return };
        // Behind a front that is no deeper than this there is no cut in the ring of the integral.
        let least_m = INNER * body.lattice_edge_m();
        let piece = |index| {
            let (anchor, frame) = (self.anchor(index).filter(|a| a.yielded)?, &self.frames[index]);
            let ahead = anchor.pull_back(body, &frame.forward).normalize();
            if body.state.grid.signed_distance_m(&(anchor.position_m - ahead * least_m)) > 0.0 {
                return None;
            }
            let along_m = anchor.pull_back(body, &frame.along) * self.segments[index].length_m;
            Some(Piece { position_m: anchor.position_m, ahead, along_m, forward: frame.forward })
        };
        drive.sample(body, (0..self.markers.len()).filter_map(piece));
        self.drive = Some(drive);
    }

    /// What takes the front of the segment `next` to where it would be if the edge went on straight from its
    /// neighbour `index`, reference configuration: on a bent edge it is not the chord to the next front that
    /// a front slides along, but the edge's tangent. Without it, cuts would lose their corners.
    fn unbend(&self, body: &Body, anchor: &Anchor, pose: &Pose, [index, next]: [usize; 2], to_edge: &Vec3) -> Vec3 {
        let (own, other) = (&self.frames[index], &self.frames[next]);
        if own == other {
            return Vec3::zeros();
        }
        let chord = pose.orientation * (self.segments[next].middle_m - self.segments[index].middle_m);
        let tangent = own.along * self.segments[index].length_m.copysign(own.along.dot(&chord));
        let turned = (own.along - other.along) * to_edge.dot(&other.along)
            + (own.forward - other.forward) * to_edge.dot(&other.forward)
            + (own.normal - other.normal) * to_edge.dot(&other.normal);
        anchor.pull_back(body, &(tangent - chord - turned))
    }

    /// Markers that have come out of the material on the other side are outside.
    fn drop_outside(&mut self, body: &Body, book: &mut FrontBook) {
        for marker in &mut self.markers {
            if let Marker::On(anchor) = marker
                && anchor.ahead == Ahead::Outside
                && body.state.grid.signed_distance_m(&anchor.position_m) > 0.0
            {
                book.stored_j -= anchor.stored_j;
                book.lost_j += anchor.stored_j;
                *marker = Marker::Outside;
            }
        }
    }

    /// Energy in springs that were let go since this was last asked, J.
    pub fn take_dropped_j(&mut self) -> f64 {
        std::mem::take(&mut self.dropped_j)
    }

    /// Length of the edge that is yielding against intact material, m.
    #[must_use]
    pub fn cutting_length_m(&self) -> f64 {
        let cutting = |c: &&FrontContact| c.forward.mode == Mode::Yield && c.forward.yield_n > 0.0;
        self.contacts.iter().filter(cutting).map(|c| self.segments[c.marker].length_m).sum()
    }

    /// The markers of the edge, without those of its ends.
    fn of_edge(&self) -> std::ops::Range<usize> {
        self.counts[0]..self.counts[0] + self.counts[1]
    }

    /// Whether the outline goes on without a corner from the marker `left` to the next.
    fn goes_on(&self, left: usize) -> bool {
        let edge = self.of_edge();
        let next = left.wrapping_add(1);
        next != edge.start && next != edge.end
    }

    fn anchor(&self, index: usize) -> Option<&Anchor> {
        match self.markers.get(index)? {
            Marker::On(anchor) => Some(anchor),
            _ => None,
        }
    }

    /// A neighbour of a marker that is in contact.
    fn beside(&self, index: usize, pose: &Pose) -> Option<Beside> {
        let of = |at: usize| {
            let anchor = *self.anchor(at)?;
            let chord_m = self.segments[index].outline_m() - self.segments[at].outline_m();
            Some(Beside { anchor, chord_m: pose.orientation * chord_m })
        };
        of(index.wrapping_sub(1)).or_else(|| of(index + 1))
    }

    /// The anchors of two neighbouring markers where they stand in one piece of material.
    fn segment(&self, body: &Body, left: usize) -> Option<[&Anchor; 2]> {
        let ends = [self.anchor(left)?, self.anchor(left + 1)?];
        let gap = (ends[0].swept_m - ends[1].swept_m).norm();
        (gap < CHAIN_GAP_VOXELS * body.state.grid.voxel_size_m()).then_some(ends)
    }
}

/// How far behind it the spring of a marker acts that has slid by a fraction of the way from its own point of the chain to
/// the one beside. Where other elements carry that, the spring acts between where the springs of the two points do.
fn slid_behind_m(body: &Body, anchor: &Anchor, forward: &Vec3, fraction: f64, [own, beside]: [ChainPoint; 2]) -> f64 {
    if own.elements == beside.elements {
        return own.behind_m + (beside.behind_m - own.behind_m) * fraction;
    }
    let acts_at_m = own.acts_at_m + (beside.acts_at_m - own.acts_at_m) * fraction;
    (anchor.current_m(body) - acts_at_m).dot(forward)
}
