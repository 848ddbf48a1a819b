//! The front: a chain of markers along a blade's edge.
//!
//! Each marker has a share of the edge's width and, once in contact, a material point X that the edge
//! pushes on through a spring whose force is capped. While it is capped, X advances through the
//! material by what the edge moved beyond the spring; the strip between the old and the new chain is
//! the cut.

use super::anchor::{Ahead, Anchor};
use super::book::FrontBook;
use super::entry::{inward, onto_surface};
use super::marker::{Edge, Marker};
use super::springs::FrontContact;
use super::sweep::part_quad;
use crate::Vec3;
use crate::body::Body;
use crate::contact::broad::SpatialHash;
use crate::contact::{Mode, narrow};
use crate::grid::{Crossing, LinkId};
use crate::tool::Pose;
use crate::tool::blade::{Blade, BladeFrame};

/// Markers per voxel edge.
const MARKERS_PER_VOXEL: f64 = 2.0;
/// Neighbouring markers farther apart than this in the material stand in different pieces of it.
const CHAIN_GAP_VOXELS: f64 = 8.0;
/// A cut starts this far outside the point where the edge came in, so that the voxels at the surface
/// part too.
const START_VOXELS: f64 = 0.5;

/// The front of one blade in one body.
#[derive(Clone)]
pub struct Front {
    markers: Vec<Marker>,
    share_m: f64,
    /// Energy in springs that were let go since it was last taken, J.
    dropped_j: f64,
    /// Where the chain stands and starts, and where its strip ends: scratch, kept between steps.
    chain: Vec<Option<(Vec3, Vec3)>>,
    target: Vec<Vec3>,
    /// Springs of the step that is being taken.
    pub contacts: Vec<FrontContact>,
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
        let count = blade.sample_count(body.grid.voxel_size_m() / MARKERS_PER_VOXEL);
        Self {
            markers: vec![Marker::Outside; count],
            share_m: blade.width_m / count as f64,
            dropped_j: 0.0,
            chain: Vec::with_capacity(count),
            target: Vec::with_capacity(count),
            contacts: Vec::with_capacity(count),
        }
    }

    /// Number of springs that the front may have at most.
    #[must_use]
    pub fn most_springs(&self) -> usize {
        2 * self.markers.len()
    }

    /// Room for a spring on every marker, which a copy of a front lacks.
    pub fn reserve(&mut self) {
        let count = self.markers.len();
        self.chain.reserve(count.saturating_sub(self.chain.len()));
        self.target.reserve(count.saturating_sub(self.target.len()));
        self.contacts.reserve(count.saturating_sub(self.contacts.len()));
    }

    /// Forgets every contact; what is inside now counts as put down inside.
    pub fn lift(&mut self) {
        for marker in &mut self.markers {
            if let Marker::On(anchor) = marker {
                self.dropped_j += anchor.stored_j;
            }
            *marker = Marker::Outside;
        }
        self.contacts.clear();
    }

    /// Marks the samples of a blade put down at `pose` inside the tissue as buried.
    pub fn enter(&mut self, body: &Body, hash: &SpatialHash, blade: &Blade, pose: &Pose) {
        self.lift();
        let count = self.markers.len();
        for (index, marker) in self.markers.iter_mut().enumerate() {
            if narrow::locate(body, hash, &pose.transform(&blade.sample(index, count))).is_some() {
                *marker = Marker::Buried;
            }
        }
    }

    /// Finds which markers touch the tissue and sets up their springs.
    pub fn detect(&mut self, body: &Body, hash: &SpatialHash, motion: &BladeMotion<'_>) {
        self.contacts.clear();
        let frame = BladeFrame::of(&motion.pose);
        let count = self.markers.len();
        for index in 0..count {
            let sample = motion.blade.sample(index, count);
            let edge = Edge {
                before_m: motion.before.transform(&sample),
                now_m: motion.pose.transform(&sample),
                frame,
                half_width_m: motion.blade.edge_half_width_m,
                share_m: self.share_m,
                from_end_m: 0.5 * motion.blade.width_m - sample.x.abs(),
            };
            let was = self.markers[index];
            let now = match was {
                Marker::On(anchor) => edge.keep(body, hash, anchor),
                Marker::Outside => edge.enter(body, hash, self.beside(index)),
                Marker::Buried => edge.emerge(body, hash),
            };
            match (&was, &now) {
                (_, Marker::On(anchor)) => self.contacts.push(FrontContact::new(body, index, &edge, anchor)),
                (Marker::On(let_go), _) => self.dropped_j += let_go.stored_j,
                _ => {}
            }
            self.markers[index] = now;
        }
    }

    /// Advances the markers that gave way, finds the links their strips cross, and books the energy.
    pub fn advance(&mut self, body: &Body, motion: &BladeMotion<'_>, links: &mut Vec<(LinkId, Crossing)>) -> FrontBook {
        let mut book = FrontBook::default();
        let frame = BladeFrame::of(&motion.pose);
        for contact in &self.contacts {
            let Marker::On(anchor) = &mut self.markers[contact.marker] else { continue };
            let virgin = !anchor.yielded;
            let step = contact.conclude(body, anchor, &frame, self.share_m, &mut book);
            if virgin && anchor.yielded {
                anchor.start_m = anchor.position_m;
                self.open_beside(body, contact.marker, &frame, links);
            }
            if let Marker::On(anchor) = &mut self.markers[contact.marker] {
                anchor.position_m += step;
            }
        }
        self.sweep(body, &frame, links);
        book.slip_j -= book.fracture_j;
        self.follow_edge(body, motion, &frame);
        self.drop_outside(body, &mut book);
        book
    }

    /// Parts what lies between the surface, the marker `index` that is about to start cutting, and the
    /// cut of a neighbour that started before it: on a curved surface the edge comes in share by share.
    fn open_beside(&self, body: &Body, index: usize, frame: &BladeFrame, links: &mut Vec<(LinkId, Crossing)>) {
        let Some(own) = self.anchor(index) else { return };
        let out = own.pull_back(body, &frame.forward).normalize() * (-START_VOXELS * body.grid.voxel_size_m());
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
    fn sweep(&mut self, body: &Body, frame: &BladeFrame, links: &mut Vec<(LinkId, Crossing)>) {
        let count = self.markers.len();
        let mut target = std::mem::take(&mut self.target);
        target.clear();
        target.extend((0..count).map(|i| self.anchor(i).map_or(Vec3::zeros(), |a| a.strip_end_m(body, frame))));
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
                    // The chain ends here: half a share beyond at the blade's end, and up to the next
                    // marker where that one is outside the material.
                    let half = own.pull_back(body, &frame.along) * (0.5 * side * self.share_m);
                    let beside = if left == index { index + 1 } else { left };
                    let outside = matches!(self.markers.get(beside), Some(Marker::Outside));
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

    /// Slides markers along the chain to where their share of the edge is now.
    fn follow_edge(&mut self, body: &Body, motion: &BladeMotion<'_>, frame: &BladeFrame) {
        let mut chain = std::mem::take(&mut self.chain);
        chain.clear();
        chain.extend((0..self.markers.len()).map(|i| self.anchor(i).map(|a| (a.position_m, a.start_m))));
        let count = self.markers.len();
        let gap = CHAIN_GAP_VOXELS * body.grid.voxel_size_m();
        for index in 0..count {
            let Marker::On(anchor) = self.markers[index] else { continue };
            let edge = motion.pose.transform(&motion.blade.sample(index, count));
            let slip = (edge - anchor.current_m(body)).dot(&frame.along);
            let next = if slip > 0.0 { index + 1 } else { index.wrapping_sub(1) };
            let beside = chain.get(next).copied().flatten().filter(|b| (b.0 - anchor.position_m).norm() < gap);
            let mut moved = anchor;
            match beside {
                Some((position, start)) => {
                    let share = (slip.abs() / self.share_m).min(1.0);
                    moved.position_m += (position - anchor.position_m) * share;
                    moved.start_m += (start - anchor.start_m) * share;
                }
                None => {
                    let shift = anchor.pull_back(body, &frame.along) * slip;
                    moved.position_m += shift;
                    moved.start_m += shift;
                }
            }
            if !moved.yielded {
                moved.position_m = onto_surface(body, moved.position_m);
                moved.start_m = moved.position_m;
                moved.inward = inward(body, &moved.position_m, &moved.inward).unwrap_or(moved.inward);
            }
            self.markers[index] = Marker::On(moved);
        }
        self.chain = chain;
    }

    /// Markers that have come out of the material on the other side are outside.
    fn drop_outside(&mut self, body: &Body, book: &mut FrontBook) {
        for marker in &mut self.markers {
            if let Marker::On(anchor) = marker
                && anchor.ahead == Ahead::Outside
                && body.grid.signed_distance_m(&anchor.position_m) > 0.0
            {
                book.stored_j -= anchor.stored_j;
                book.numerical_j += anchor.stored_j;
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
        self.contacts.iter().filter(cutting).count() as f64 * self.share_m
    }

    /// Folds the front's state into a hash.
    pub fn fold_into(&self, hasher: &mut crate::hash::StateHasher) {
        for marker in &self.markers {
            match marker {
                Marker::Outside => hasher.word(0),
                Marker::Buried => hasher.word(1),
                Marker::On(anchor) => {
                    hasher.word(2 + u64::from(anchor.yielded));
                    hasher.floats(anchor.position_m.as_slice());
                }
            }
        }
    }

    fn anchor(&self, index: usize) -> Option<&Anchor> {
        match self.markers.get(index)? {
            Marker::On(anchor) => Some(anchor),
            _ => None,
        }
    }

    /// A neighbour of a marker that is in contact, and on which side of the marker it stands.
    fn beside(&self, index: usize) -> Option<(f64, Anchor)> {
        let side = |side: f64, at: usize| self.anchor(at).map(|anchor| (side, *anchor));
        side(-1.0, index.wrapping_sub(1)).or_else(|| side(1.0, index + 1))
    }

    /// The anchors of two neighbouring markers where they stand in one piece of material.
    fn segment(&self, body: &Body, left: usize) -> Option<[&Anchor; 2]> {
        let ends = [self.anchor(left)?, self.anchor(left + 1)?];
        let gap = (ends[0].swept_m - ends[1].swept_m).norm();
        (gap < CHAIN_GAP_VOXELS * body.grid.voxel_size_m()).then_some(ends)
    }
}
