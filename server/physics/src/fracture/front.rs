//! The front: a chain of markers along a blade's edge.
//!
//! Each marker has a share of the edge's width and, once in contact, a material point X that the edge
//! pushes on. The push is a spring of the contact's compliance whose force per length is capped: at
//! `initiation_ratio Gc` until it first gives, at Gc from then on (Griffith: the energy release rate
//! of a sharp edge is the edge-normal force per length). While it is capped, X advances through the
//! material by what the edge moved beyond the spring; the strip between the old and the new chain is
//! the cut. Where the link ahead is parted already the cap is zero.

use super::sweep::links_across;
use crate::body::{Body, MaterialPoint};
use crate::contact::broad::SpatialHash;
use crate::contact::{Contact, ContactWeights, Mode, narrow};
use crate::grid::{Crossing, Link, LinkId, VoxelId};
use crate::tool::Pose;
use crate::tool::blade::{Blade, BladeFrame};
use crate::{Mat3, Vec3};

/// Markers per voxel edge.
const MARKERS_PER_VOXEL: f64 = 2.0;
/// A front does not advance by more than this many voxels in a step.
const MAX_ADVANCE_VOXELS: f64 = 2.0;
/// A front advances through the deformed material in steps of at most this share of a voxel, and in
/// so many of them at most.
const MARCH_VOXELS: f64 = 0.25;
const MAX_MARCH_STEPS: u32 = 64;
/// A contact that has opened by this share of a voxel is let go where nothing is cut.
const RELEASE_VOXELS: f64 = 0.5;
/// A marker this many voxels beside its edge has lost it.
const LOST_VOXELS: f64 = 2.0;
/// Neighbouring markers farther apart than this in the material stand in different pieces of it.
const CHAIN_GAP_VOXELS: f64 = 8.0;
/// A cut starts this far outside the point where the edge came in, so that the voxels at the surface
/// part too.
const START_VOXELS: f64 = 0.5;
/// Strips are shifted by this share of a voxel toward the blade's positive side: a voxel centre that
/// lies on the blade's plane, give or take the drift of the front, is on its negative side for every
/// link and every strip.
const NUDGE_VOXELS: f64 = 1e-3;
/// A surface faces the edge where the cosine between its inward normal and the cutting direction is
/// above this.
const FACING: f64 = 0.2;
/// Virgin contact slides sideways where the sideways force exceeds this share of the forward one.
const EDGE_GRIP: f64 = 1.0;
/// Compression between H and a of a material that stiffens, over `H / sqrt(c)`.
const SATURATED_GAP: f64 = 1.2;
/// Least compliance of the contact, times E: keeps the spring finite where the formula goes negative.
const LEAST_COMPLIANCE: f64 = 0.1;

/// What lies ahead of a marker.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Ahead {
    /// Material that holds, with its fracture energy (infinite: cannot be cut) and initiation ratio.
    Intact { fracture_energy_j_per_m2: f64, initiation_ratio: f64 },
    /// A cut that is there already.
    Parted,
    /// The outside.
    Outside,
}

/// A marker in contact.
#[derive(Clone, Copy, Debug)]
struct Anchor {
    /// Reference position of the front, m.
    position_m: Vec3,
    /// Where the material that has been swept ends here, m: `position_m` as the last sweep left it.
    /// Strips start exactly where the last ones ended, so that the cut has no gaps.
    swept_m: Vec3,
    /// Where the cut begins here, m; moves with `position_m` until the marker yields.
    start_m: Vec3,
    /// The voxels at the ends of the next link; the force is shared between them.
    voxels: [VoxelId; 2],
    ahead: Ahead,
    yielded: bool,
    mode: Mode,
    /// Energy in the spring at the end of the last step, J.
    stored_j: f64,
}

/// One share of the edge.
#[derive(Clone, Copy, Debug)]
enum Marker {
    /// Not in the tissue.
    Outside,
    /// In the tissue without having entered through a surface (put down inside, or drawn backward).
    Buried,
    /// In contact.
    On(Anchor),
}

/// The springs of one marker during a step.
#[derive(Clone, Copy, Debug)]
pub struct FrontContact {
    marker: usize,
    /// Along the cutting direction.
    pub forward: Contact,
    /// Along the blade's normal; acts while `forward` does.
    pub lateral: Contact,
}

/// Energy and area booked by a front in one step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrontBook {
    /// Energy in the springs at the end of the step, J.
    pub stored_j: f64,
    /// Gc times the area swept, J.
    pub fracture_j: f64,
    /// Work of the capped force on what slipped past, less `fracture_j`, J.
    pub slip_j: f64,
    /// Energy set free as markers dropped from initiation to propagation, J.
    pub initiation_j: f64,
    /// Dissipation of the springs' implicit step and of re-anchoring, J.
    pub numerical_j: f64,
    /// Area swept through intact material, m^2.
    pub area_m2: f64,
}

impl FrontBook {
    /// Adds another front's book.
    pub fn add(&mut self, other: &Self) {
        self.stored_j += other.stored_j;
        self.fracture_j += other.fracture_j;
        self.slip_j += other.slip_j;
        self.initiation_j += other.initiation_j;
        self.numerical_j += other.numerical_j;
        self.area_m2 += other.area_m2;
    }
}

/// The front of one blade in one body.
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

    /// Energy in springs that were let go since this was last asked, J.
    pub fn take_dropped_j(&mut self) -> f64 {
        std::mem::take(&mut self.dropped_j)
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
            };
            let was = self.markers[index];
            self.markers[index] = match was {
                Marker::On(anchor) => edge.keep(body, hash, anchor),
                Marker::Outside => edge.enter(body, hash, self.beside(index)),
                Marker::Buried => match narrow::locate(body, hash, &edge.now_m) {
                    Some(_) => Marker::Buried,
                    None => Marker::Outside,
                },
            };
            if let (Marker::On(anchor), false) = (&was, matches!(self.markers[index], Marker::On(_))) {
                self.dropped_j += anchor.stored_j;
            }
            if let Marker::On(anchor) = &self.markers[index] {
                let (forward, lateral) = edge.springs(body, anchor);
                self.contacts.push(FrontContact { marker: index, forward, lateral });
            }
        }
    }

    /// Advances the markers that gave way, finds the links their strips cross, and books the energy.
    pub fn advance(&mut self, body: &Body, motion: &BladeMotion<'_>, links: &mut Vec<(LinkId, Crossing)>) -> FrontBook {
        let mut book = FrontBook::default();
        let frame = BladeFrame::of(&motion.pose);
        for contact in &self.contacts {
            let Marker::On(anchor) = &mut self.markers[contact.marker] else { continue };
            let virgin = !anchor.yielded;
            let step = settle_marker(body, anchor, contact, &frame, self.share_m, &mut book);
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

    /// Number of springs that the front may have at most.
    #[must_use]
    pub fn most_springs(&self) -> usize {
        2 * self.markers.len()
    }

    /// Parts the links between where the chain was and where it is now. Neighbours
    /// share their edges of the strip, consecutive strips the chain between them: no link slips
    /// through, whichever markers move.
    fn sweep(&mut self, body: &Body, frame: &BladeFrame, links: &mut Vec<(LinkId, Crossing)>) {
        let count = self.markers.len();
        let mut target = std::mem::take(&mut self.target);
        target.clear();
        target
            .extend((0..count).map(|i| self.anchor(i).map_or(Vec3::zeros(), |a| a.position_m + a.nudge(body, frame))));
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
                    let beside = if side < 0.0 { index.checked_sub(1) } else { Some(index + 1) };
                    let outside =
                        beside.and_then(|i| self.markers.get(i)).is_some_and(|m| matches!(m, Marker::Outside));
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
}

/// Books one marker's step and returns how far its point advances, reference configuration.
fn settle_marker(
    body: &Body,
    anchor: &mut Anchor,
    contact: &FrontContact,
    frame: &BladeFrame,
    share_m: f64,
    book: &mut FrontBook,
) -> Vec3 {
    let forward = &contact.forward;
    let (k, force) = (forward.stiffness_n_per_m, forward.force_n);
    let spring = |gap: f64| 0.5 * k * gap.max(0.0) * gap.max(0.0);
    let mut advance = 0.0;
    if forward.mode == Mode::Yield {
        advance = (forward.gap_m - forward.yield_n / k).max(0.0);
        advance = advance.min(MAX_ADVANCE_VOXELS * body.grid.voxel_size_m());
    }
    let lateral = 0.5 * contact.lateral.force_n * contact.lateral.gap_m;
    let stored = if forward.mode == Mode::Off { 0.0 } else { spring(forward.gap_m - advance) } + lateral;
    let work = force * (forward.gap_m - forward.gap_before_m)
        + contact.lateral.force_n * (contact.lateral.gap_m - contact.lateral.gap_before_m);
    let lost = work - (stored - anchor.stored_j) - force * advance;
    if forward.mode == Mode::Yield && !anchor.yielded {
        book.initiation_j += lost;
    } else {
        book.numerical_j += lost;
    }
    book.slip_j += force * advance;
    book.stored_j += stored;
    anchor.stored_j = stored;
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
        let grip = EDGE_GRIP * force / contact.lateral.stiffness_n_per_m;
        let excess = contact.lateral.gap_m - contact.lateral.gap_m.clamp(-grip, grip);
        step += anchor.pull_back(body, &frame.normal) * excess;
    }
    step
}

/// One share of the edge during a step.
struct Edge {
    before_m: Vec3,
    now_m: Vec3,
    frame: BladeFrame,
    half_width_m: f64,
    share_m: f64,
}

impl Edge {
    /// A marker that was in contact: still is, or has let go.
    fn keep(&self, body: &Body, hash: &SpatialHash, mut anchor: Anchor) -> Marker {
        let h = body.grid.voxel_size_m();
        anchor.look_ahead(body, &self.frame);
        let offset = self.now_m - anchor.current_m(body);
        if offset.dot(&self.frame.normal).abs() > LOST_VOXELS * h {
            return Marker::Buried;
        }
        let opened = offset.dot(&self.frame.forward) < -RELEASE_VOXELS * h;
        let gone = opened && (!anchor.yielded || narrow::locate(body, hash, &self.now_m).is_none());
        if gone { Marker::Outside } else { Marker::On(anchor) }
    }

    /// A marker that was outside: still is, or the edge has come in through a surface.
    fn enter(&self, body: &Body, hash: &SpatialHash, beside: Option<(f64, Anchor)>) -> Marker {
        let Some(point) = narrow::locate(body, hash, &self.now_m) else { return Marker::Outside };
        let (nodes, n) = body.weights(&point);
        let tissue: Vec3 =
            nodes.iter().zip(n).map(|(node, n)| Vec3::from(body.velocity_m_per_s[*node as usize]) * n).sum();
        let approach = (self.now_m - self.before_m - tissue * body.dt_s()).dot(&self.frame.forward);
        if approach <= 0.0 {
            return Marker::Buried;
        }
        let mut anchor = Anchor {
            position_m: point.position_m,
            swept_m: point.position_m,
            start_m: point.position_m,
            voxels: [point.voxel; 2],
            ahead: Ahead::Outside,
            yielded: false,
            mode: Mode::Off,
            stored_j: 0.0,
        };
        let back = anchor.pull_back(body, &self.frame.forward);
        anchor.position_m = surface_behind(body, point.position_m, back, approach);
        if let Some((side, neighbour)) = beside
            && grazes(body, &anchor.position_m, &back)
        {
            return self.join(body, side, neighbour);
        }
        anchor.start_m = anchor.position_m;
        anchor.look_ahead(body, &self.frame);
        anchor.swept_m = anchor.position_m + anchor.nudge(body, &self.frame);
        Marker::On(anchor)
    }

    /// The edge came in through a side of the tissue that bulges along it, past a neighbour that is in
    /// contact already: the marker goes on with the neighbour's front as soon as there is material
    /// for it there. (Where the edge itself is, it would stand deeper than the front by the contact's
    /// compression.)
    fn join(&self, body: &Body, side: f64, neighbour: Anchor) -> Marker {
        let mut anchor = neighbour;
        anchor.position_m -= neighbour.pull_back(body, &self.frame.along) * (side * self.share_m);
        anchor.start_m = anchor.position_m;
        anchor.stored_j = 0.0;
        anchor.ahead = Ahead::Outside;
        anchor.look_ahead(body, &self.frame);
        anchor.swept_m = anchor.position_m + anchor.nudge(body, &self.frame);
        if anchor.ahead == Ahead::Outside { Marker::Outside } else { Marker::On(anchor) }
    }

    fn springs(&self, body: &Body, anchor: &Anchor) -> (Contact, Contact) {
        let weights = anchor.weights(body);
        let at = weights.sum(&body.position_m);
        let velocity = weights.sum(&body.velocity_m_per_s);
        let k = anchor.stiffness_n_per_m2(body, &self.frame, self.half_width_m) * self.share_m;
        let spring = |direction: Vec3| Contact {
            weights,
            direction,
            tool_point_m: self.now_m,
            tool_point_before_m: self.before_m,
            stiffness_n_per_m: k,
            gap_before_m: (self.before_m - at).dot(&direction),
            gap_predicted_m: (self.now_m - at - velocity * body.dt_s()).dot(&direction),
            gap_m: 0.0,
            force_n: 0.0,
            limit_n: f64::INFINITY,
            yield_n: 0.0,
            slack_m: 0.0,
            bilateral: false,
            mode: Mode::Off,
        };
        let mut forward = spring(self.frame.forward);
        (forward.limit_n, forward.yield_n) = anchor.limits_n(body, &self.frame, self.share_m);
        forward.mode = if forward.limit_n == 0.0 && forward.gap_predicted_m > 0.0 { Mode::Yield } else { anchor.mode };
        let mut lateral = spring(self.frame.normal);
        lateral.bilateral = true;
        lateral.mode = lateral_mode(&forward);
        (forward, lateral)
    }
}

/// The edge holds the material beside it while it presses on material that holds.
fn lateral_mode(forward: &Contact) -> Mode {
    if forward.mode != Mode::Off && forward.yield_n > 0.0 { Mode::Spring } else { Mode::Off }
}

impl FrontContact {
    /// Takes the solution's change of velocity; returns whether a mode had to change.
    pub fn settle(&mut self, dt_s: f64, velocity_change: &[[f64; 3]]) -> bool {
        let changed = self.forward.settle(dt_s, velocity_change);
        self.lateral.take_solution(dt_s, velocity_change);
        self.lateral.mode = lateral_mode(&self.forward);
        changed
    }
}

impl Anchor {
    fn points(&self) -> [MaterialPoint; 2] {
        self.voxels.map(|voxel| MaterialPoint { position_m: self.position_m, voxel })
    }

    /// Scene position of the front's material point, m.
    fn current_m(&self, body: &Body) -> Vec3 {
        let [a, b] = self.points();
        0.5 * (body.current_m(&a) + body.current_m(&b))
    }

    fn weights(&self, body: &Body) -> ContactWeights {
        let mut weights = ContactWeights::default();
        for point in self.points() {
            let (nodes, n) = body.weights(&point);
            nodes.iter().zip(n).for_each(|(node, n)| weights.add(*node, 0.5 * n));
        }
        weights
    }

    fn gradient(&self, body: &Body) -> Mat3 {
        let [a, b] = self.points();
        0.5 * (body.deformation_gradient(&a) + body.deformation_gradient(&b))
    }

    /// `F^-1 d`: the reference vector that the deformation takes to a scene direction. Where the
    /// material is squeezed to a fifth or less, as if it were squeezed to a fifth.
    fn pull_back(&self, body: &Body, direction: &Vec3) -> Vec3 {
        let pulled = self.gradient(body).try_inverse().map_or(*direction, |inverse| inverse * direction);
        let length = pulled.norm();
        if length.is_finite() && length > 0.0 { pulled * (length.min(5.0) / length) } else { *direction }
    }

    /// The reference vector from the front to the point that lies `distance` farther along the cutting
    /// direction in the scene, at most as far as the material ahead stays what it is. In short steps:
    /// under the edge soft tissue is squeezed to a third, a few millimetres on it is not.
    fn march(&self, body: &Body, frame: &BladeFrame, distance: f64) -> Vec3 {
        let longest = MARCH_VOXELS * body.grid.voxel_size_m();
        let from = self.current_m(body);
        let mut ahead = *self;
        for _ in 0..MAX_MARCH_STEPS {
            let left = distance - (ahead.current_m(body) - from).dot(&frame.forward);
            if left <= 1e-3 * distance {
                break;
            }
            let step = ahead.pull_back(body, &frame.forward) * left;
            ahead.position_m += step * (longest / step.norm()).min(1.0);
            ahead.look_ahead(body, frame);
            if ahead.ahead != self.ahead {
                break;
            }
        }
        ahead.position_m - self.position_m
    }

    /// The shift of strips that settles on which side a centre on the blade's plane is.
    fn nudge(&self, body: &Body, frame: &BladeFrame) -> Vec3 {
        let normal = (self.gradient(body).transpose() * frame.normal).try_normalize(0.0).unwrap_or(frame.normal);
        normal * (NUDGE_VOXELS * body.grid.voxel_size_m())
    }

    /// Finds the link that the blade's plane crosses ahead: so far ahead that the crossing of the
    /// column it is looked for in cannot lie behind the front, where the blade itself has parted it.
    fn look_ahead(&mut self, body: &Body, frame: &BladeFrame) {
        let grid = &body.grid;
        let h = grid.voxel_size_m();
        let f = self.gradient(body);
        let ahead = self.pull_back(body, &frame.forward).normalize();
        let normal = f.transpose() * frame.normal;
        let axis = normal.iamax();
        // A point of the plane half a voxel off in one of the other axes is this far off along `ahead`.
        let along = |a: usize| (ahead[a] - ahead[axis] * normal[a] / normal[axis]).abs();
        let reach = 0.5 * (0..3).filter(|a| *a != axis).map(along).sum::<f64>();
        let at = self.position_m + ahead * (reach.max(0.5) * h);
        let cell = grid.cell_of(&at);
        let centre = grid.centre_m(cell);
        // The plane's height over the centre of the column, not over the marker.
        let across: f64 = (0..3).filter(|a| *a != axis).map(|a| normal[a] * (centre[a] - at[a])).sum();
        let height = (at[axis] - across / normal[axis] - grid.origin_m()[axis]) / h - 0.5;
        let mut lower = cell;
        lower[axis] = height.floor() as i32;
        let link = LinkId { cell: lower, axis: axis as u8 };
        let ends = [grid.voxel_at(link.cell), grid.voxel_at(link.upper())];
        if let Some(any) = ends[0].or(ends[1]) {
            self.voxels = [ends[0].unwrap_or(any), ends[1].unwrap_or(any)];
        }
        self.ahead = match grid.link(link) {
            Link::Parted(_) => Ahead::Parted,
            Link::Intact | Link::Boundary(_) if grid.signed_distance_m(&at) < 0.0 => {
                let material = body.material_of(self.voxels[0]);
                Ahead::Intact {
                    fracture_energy_j_per_m2: fracture_energy(body, link),
                    initiation_ratio: material.initiation_ratio,
                }
            }
            // Past the last link what held there holds on to the surface.
            _ if grid.signed_distance_m(&self.position_m) < 0.0 => self.ahead,
            _ => Ahead::Outside,
        };
        // Beyond an old cut the crack is there already: nothing has to be initiated.
        self.yielded |= self.ahead == Ahead::Parted;
    }

    /// Width of the strip that a share of the edge cuts, reference configuration: the material has
    /// spread along the edge. A blade that goes on at the same force in a state that goes with it
    /// spends `F dz` on `w dz` of reference area, so that `F = Gc w` is in reference width however the
    /// material is squeezed ahead of the edge.
    fn reference_width_m(&self, body: &Body, frame: &BladeFrame, share_m: f64) -> f64 {
        let ahead = self.pull_back(body, &frame.forward).normalize();
        ahead.cross(&(self.pull_back(body, &frame.along) * share_m)).norm()
    }

    /// Force at which the marker gives, and the force it goes on at, N. It starts at a line load on
    /// the surface as it stands, and goes on at Gc per reference area.
    fn limits_n(&self, body: &Body, frame: &BladeFrame, share_m: f64) -> (f64, f64) {
        match self.ahead {
            Ahead::Intact { fracture_energy_j_per_m2, initiation_ratio } => {
                let steady = fracture_energy_j_per_m2 * self.reference_width_m(body, frame, share_m);
                let start = fracture_energy_j_per_m2 * initiation_ratio * share_m;
                (if self.yielded { steady } else { start.max(steady) }, steady)
            }
            Ahead::Parted | Ahead::Outside => (0.0, 0.0),
        }
    }

    /// Stiffness of the contact per length of edge: in series with the composite element, it gives
    /// the compliance that a line load of half-width a has on the continuum wherever it stands in
    /// its cell, `k = E / (2 (1 - nu^2) / pi ln(H / a) - 0.24 + 0.65 (1 - nu^2) / 0.7975 4 xi (1 - xi))`,
    /// H the element's edge, xi the place across the blade in the cell. Stiffened tissue stiffens it;
    /// and as its strain under the edge saturates, between H and a it gives by no more than
    /// `H / sqrt(c)` or so at the load at which it is cut (the integral of the strain
    /// `eps exp(c eps^2) = sigma / E` over that range).
    fn stiffness_n_per_m2(&self, body: &Body, frame: &BladeFrame, half_width_m: f64) -> f64 {
        let material = body.material_of(self.voxels[0]);
        let element = body.element_of(self.voxels[0]);
        let axis = (self.gradient(body).transpose() * frame.normal).iamax();
        let xi = body.local_coordinates(element, &self.position_m)[axis].clamp(0.0, 1.0);
        let plane = 1.0 - material.poisson_ratio * material.poisson_ratio;
        let line = 2.0 * plane / std::f64::consts::PI * ln(body.element_edge_m() / half_width_m);
        let compliance = line - 0.24 + 0.65 * plane / 0.7975 * 4.0 * xi * (1.0 - xi);
        let small = material.young_modulus_pa * body.stiffening(element) / compliance.max(LEAST_COMPLIANCE);
        let c = 0.5 * material.law.stiffening_rate_per_pa * material.young_modulus_pa;
        let load = material.fracture_energy_j_per_m2.unwrap_or(0.0) * material.initiation_ratio;
        small.max(load * c.sqrt() / (SATURATED_GAP * body.element_edge_m()))
    }
}

/// Parts the intact links across a quadrilateral, but for those that cannot be cut.
fn part_quad(body: &Body, [a, b, c, d]: [Vec3; 4], links: &mut Vec<(LinkId, Crossing)>) {
    for triangle in [[a, b, c], [a, c, d]] {
        links_across(&body.grid, triangle, |link, crossing| {
            if body.grid.is_intact(link) && fracture_energy(body, link).is_finite() {
                links.push((link, crossing));
            }
        });
    }
}

/// Natural logarithm through the vector library's own polynomial: the same bits on every machine.
fn ln(x: f64) -> f64 {
    wide::f64x4::splat(x).ln().to_array()[0]
}

/// Fracture energy of a link: the lesser of its ends', infinite where neither end can be cut.
fn fracture_energy(body: &Body, link: LinkId) -> f64 {
    [link.cell, link.upper()]
        .into_iter()
        .filter_map(|cell| body.grid.voxel_at(cell))
        .map(|v| body.material_of(v).fracture_energy_j_per_m2.unwrap_or(f64::INFINITY))
        .fold(f64::INFINITY, f64::min)
}

/// The point of the object's surface behind `inside` along `-back`, at most about `approach` away in
/// scene distance; where there is none the edge came in through a cut, `approach` back.
fn surface_behind(body: &Body, inside: Vec3, back: Vec3, approach: f64) -> Vec3 {
    let h = body.grid.voxel_size_m();
    let distance = |s: f64| body.grid.signed_distance_m(&(inside - back * s));
    let reach = 1.5 * approach + 0.5 * h;
    let step = 0.25 * h;
    let (mut low, mut high) = (0.0, step);
    while distance(high) < 0.0 {
        if high > reach {
            return inside - back * approach;
        }
        (low, high) = (high, high + step);
    }
    for _ in 0..30 {
        let middle = 0.5 * (low + high);
        if distance(middle) < 0.0 { low = middle } else { high = middle }
    }
    inside - back * low
}

/// Gradient of the signed distance over a voxel around `at`.
fn outward(body: &Body, at: &Vec3) -> Vec3 {
    let grid = &body.grid;
    let h = grid.voxel_size_m();
    Vec3::from_fn(|a, _| {
        let offset = Vec3::from_fn(|b, _| if a == b { 0.5 * h } else { 0.0 });
        (grid.signed_distance_m(&(at + offset)) - grid.signed_distance_m(&(at - offset))) / h
    })
}

/// Whether `at` is on a surface that runs along the direction `ahead`, rather than facing it.
fn grazes(body: &Body, at: &Vec3, ahead: &Vec3) -> bool {
    let on_surface = body.grid.signed_distance_m(at) > -0.25 * body.grid.voxel_size_m();
    let normal = outward(body, at);
    on_surface && normal.dot(ahead) > -FACING * normal.norm() * ahead.norm()
}

/// Moves a reference point to the object's surface along the signed distance's gradient.
fn onto_surface(body: &Body, at: Vec3) -> Vec3 {
    let grid = &body.grid;
    let gradient = outward(body, &at);
    let size2 = gradient.norm_squared();
    if size2.is_finite() && size2 > 0.01 { at - gradient * (grid.signed_distance_m(&at) / size2) } else { at }
}
