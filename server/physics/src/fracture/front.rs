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
/// A contact that has opened by this share of a voxel is let go where nothing is cut.
const RELEASE_VOXELS: f64 = 0.5;
/// A marker this many voxels beside its edge has lost it.
const LOST_VOXELS: f64 = 2.0;
/// The strip that is swept starts this share of a voxel behind the front, so that consecutive strips
/// overlap and no link slips through between them.
const OVERLAP_VOXELS: f64 = 0.25;
/// Virgin contact slides sideways where the sideways force exceeds this share of the forward one.
const EDGE_GRIP: f64 = 1.0;
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
    /// Energy in springs that were let go in this step's detection, J.
    dropped_j: f64,
    /// Positions of the markers before and after the front advanced.
    old: Vec<Option<Vec3>>,
    new: Vec<Option<Vec3>>,
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
            old: Vec::with_capacity(count),
            new: Vec::with_capacity(count),
            contacts: Vec::with_capacity(count),
        }
    }

    /// Forgets every contact; what is inside now counts as put down inside.
    pub fn lift(&mut self) {
        self.markers.iter_mut().for_each(|m| *m = Marker::Outside);
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

    /// Length of the edge that is yielding against intact material, m.
    #[must_use]
    pub fn cutting_length_m(&self) -> f64 {
        let cutting = |c: &&FrontContact| c.forward.mode == Mode::Yield && c.forward.yield_n > 0.0;
        self.contacts.iter().filter(cutting).count() as f64 * self.share_m
    }

    /// Whether any marker is in contact.
    #[must_use]
    pub fn touches(&self) -> bool {
        self.markers.iter().any(|m| matches!(m, Marker::On(_)))
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
        self.dropped_j = 0.0;
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
                Marker::Outside => edge.enter(body, hash),
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
        let mut book = FrontBook { numerical_j: self.dropped_j, ..FrontBook::default() };
        let frame = BladeFrame::of(&motion.pose);
        write_positions(&self.markers, &mut self.old);
        for contact in &self.contacts {
            let Marker::On(anchor) = &mut self.markers[contact.marker] else { continue };
            let step = settle_marker(body, anchor, contact, &frame, &mut book);
            anchor.position_m += step;
        }
        write_positions(&self.markers, &mut self.new);
        for contact in &self.contacts {
            if contact.forward.mode == Mode::Yield {
                self.sweep(body, contact.marker, links, &mut book);
            }
        }
        book.slip_j -= book.fracture_j;
        self.follow_edge(body, motion, &frame);
        self.drop_outside(body);
        book
    }

    /// Number of springs that the front may have at most.
    #[must_use]
    pub fn most_springs(&self) -> usize {
        2 * self.markers.len()
    }

    /// Links across the strip of one marker, from the middle to its left neighbour to the middle to
    /// its right one; the strips of a chain without gaps have no gaps.
    fn sweep(&self, body: &Body, index: usize, links: &mut Vec<(LinkId, Crossing)>, book: &mut FrontBook) {
        let (Some(from), Some(to), Marker::On(anchor)) = (self.old[index], self.new[index], &self.markers[index])
        else {
            return;
        };
        let Some(ahead) = (to - from).try_normalize(0.0) else { return };
        let back = ahead * (OVERLAP_VOXELS * body.grid.voxel_size_m());
        let mut area = 0.0;
        for toward in [-1, 1] {
            let (a, b) = (self.border(index, toward, &self.old, from), self.border(index, toward, &self.new, to));
            area += 0.5 * ((b - from).cross(&(to - a))).norm();
            for triangle in [[from - back, a - back, b], [from - back, b, to]] {
                links_across(&body.grid, triangle, |link, crossing| {
                    if body.grid.is_intact(link) && fracture_energy(body, link).is_finite() {
                        links.push((link, crossing));
                    }
                });
            }
        }
        if let Ahead::Intact { fracture_energy_j_per_m2, .. } = anchor.ahead {
            book.area_m2 += area;
            book.fracture_j += fracture_energy_j_per_m2 * area;
        }
    }

    /// Border of a marker's share in a chain: half way to its neighbour, or as far beyond its own
    /// point as the other border is before it.
    fn border(&self, index: usize, toward: i32, chain: &[Option<Vec3>], at: Vec3) -> Vec3 {
        let neighbour = |side: i32| {
            let other = usize::try_from(index as i32 + side).ok()?;
            let position = (*chain.get(other)?)?;
            ((position - at).norm() < 4.0 * self.share_m).then_some(position)
        };
        match (neighbour(toward), neighbour(-toward)) {
            (Some(next), _) => 0.5 * (at + next),
            (None, Some(previous)) => at + 0.5 * (at - previous),
            (None, None) => at,
        }
    }

    /// Slides markers along the chain to where their share of the edge is now.
    fn follow_edge(&mut self, body: &Body, motion: &BladeMotion<'_>, frame: &BladeFrame) {
        let count = self.markers.len();
        for index in 0..count {
            let Marker::On(anchor) = self.markers[index] else { continue };
            let edge = motion.pose.transform(&motion.blade.sample(index, count));
            let slip = (edge - anchor.current_m(body)).dot(&frame.along);
            let next = if slip > 0.0 { index + 1 } else { index.wrapping_sub(1) };
            let beside = self.new.get(next).copied().flatten();
            let shift = match beside.filter(|p| (p - anchor.position_m).norm() < 4.0 * self.share_m) {
                Some(position) => (position - anchor.position_m) * (slip.abs() / self.share_m).min(1.0),
                None => anchor.pull_back(body, &frame.along) * slip,
            };
            let mut moved = anchor;
            moved.position_m += shift;
            if !moved.yielded {
                moved.position_m = onto_surface(body, moved.position_m);
            }
            self.markers[index] = Marker::On(moved);
        }
    }

    /// Markers that have come out of the material on the other side are outside.
    fn drop_outside(&mut self, body: &Body) {
        for marker in &mut self.markers {
            if let Marker::On(anchor) = marker
                && anchor.ahead == Ahead::Outside
                && body.grid.signed_distance_m(&anchor.position_m) > 0.0
                && anchor.yielded
            {
                *marker = Marker::Outside;
            }
        }
    }
}

fn write_positions(markers: &[Marker], out: &mut Vec<Option<Vec3>>) {
    out.clear();
    out.extend(markers.iter().map(|marker| match marker {
        Marker::On(anchor) => Some(anchor.position_m),
        _ => None,
    }));
}

/// Books one marker's step and returns how far its point advances, reference configuration.
fn settle_marker(
    body: &Body,
    anchor: &mut Anchor,
    contact: &FrontContact,
    frame: &BladeFrame,
    book: &mut FrontBook,
) -> Vec3 {
    let forward = &contact.forward;
    let (k, force) = (forward.stiffness_n_per_m, forward.force_n());
    let spring = |gap: f64| 0.5 * k * gap.max(0.0) * gap.max(0.0);
    let mut advance = 0.0;
    if forward.mode == Mode::Yield {
        advance = (forward.gap_m - forward.yield_n / k).max(0.0);
        advance = advance.min(MAX_ADVANCE_VOXELS * body.grid.voxel_size_m());
    }
    let lateral = 0.5 * contact.lateral.force_n() * contact.lateral.gap_m;
    let stored = if forward.mode == Mode::Off { 0.0 } else { spring(forward.gap_m - advance) } + lateral;
    let work = force * (forward.gap_m - forward.gap_before_m)
        + contact.lateral.force_n() * (contact.lateral.gap_m - contact.lateral.gap_before_m);
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
    anchor.yielded |= forward.mode == Mode::Yield;
    let mut step = anchor.pull_back(body, &frame.forward) * advance;
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
    fn enter(&self, body: &Body, hash: &SpatialHash) -> Marker {
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
            voxels: [point.voxel; 2],
            ahead: Ahead::Outside,
            yielded: false,
            mode: Mode::Off,
            stored_j: 0.0,
        };
        let back = anchor.pull_back(body, &self.frame.forward);
        anchor.position_m = surface_behind(body, point.position_m, back, approach);
        anchor.look_ahead(body, &self.frame);
        Marker::On(anchor)
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
            limit_n: f64::INFINITY,
            yield_n: 0.0,
            slack_m: 0.0,
            bilateral: false,
            mode: Mode::Off,
        };
        let mut forward = spring(self.frame.forward);
        (forward.limit_n, forward.yield_n) = anchor.limits_n(self.share_m);
        forward.mode = if forward.limit_n == 0.0 && forward.gap_predicted_m > 0.0 { Mode::Yield } else { anchor.mode };
        let mut lateral = spring(self.frame.normal);
        lateral.bilateral = true;
        (forward, lateral)
    }
}

impl FrontContact {
    /// Takes the solution's change of velocity; returns whether a mode had to change.
    pub fn settle(&mut self, dt_s: f64, velocity_change: &[[f64; 3]]) -> bool {
        let changed = self.forward.settle(dt_s, velocity_change);
        let holds = self.forward.mode != Mode::Off && self.forward.yield_n > 0.0;
        self.lateral.mode = if holds { Mode::Spring } else { Mode::Off };
        self.lateral.gap_m = self.lateral.gap_predicted_m
            - dt_s * self.lateral.weights.sum(velocity_change).dot(&self.lateral.direction);
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

    /// Finds the link that the blade's plane crosses half a voxel ahead.
    fn look_ahead(&mut self, body: &Body, frame: &BladeFrame) {
        let grid = &body.grid;
        let h = grid.voxel_size_m();
        let f = self.gradient(body);
        let ahead = self.pull_back(body, &frame.forward).normalize();
        let normal = f.transpose() * frame.normal;
        let at = self.position_m + ahead * (0.5 * h);
        let axis = normal.iamax();
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
            _ => Ahead::Outside,
        };
        // Beyond an old cut the crack is there already: nothing has to be initiated.
        self.yielded |= self.ahead == Ahead::Parted;
    }

    /// Force at which the marker gives, and the force it goes on at, N.
    fn limits_n(&self, share_m: f64) -> (f64, f64) {
        match self.ahead {
            Ahead::Intact { fracture_energy_j_per_m2, initiation_ratio } => {
                let steady = fracture_energy_j_per_m2 * share_m;
                (if self.yielded { steady } else { steady * initiation_ratio }, steady)
            }
            Ahead::Parted | Ahead::Outside => (0.0, 0.0),
        }
    }

    /// Stiffness of the contact per length of edge: in series with the composite element, it gives
    /// the compliance that a line load of half-width a has on the continuum wherever it stands in
    /// its cell, `k = E / (2 (1 - nu^2) / pi ln(H / a) - 0.24 + 0.65 (1 - nu^2) / 0.7975 4 xi (1 - xi))`,
    /// H the element's edge, xi the place across the blade in the cell. Stiffened tissue stiffens it.
    fn stiffness_n_per_m2(&self, body: &Body, frame: &BladeFrame, half_width_m: f64) -> f64 {
        let material = body.material_of(self.voxels[0]);
        let element = body.element_of(self.voxels[0]);
        let axis = (self.gradient(body).transpose() * frame.normal).iamax();
        let xi = body.local_coordinates(element, &self.position_m)[axis].clamp(0.0, 1.0);
        let plane = 1.0 - material.poisson_ratio * material.poisson_ratio;
        let line = 2.0 * plane / std::f64::consts::PI * ln(body.element_edge_m() / half_width_m);
        let compliance = line - 0.24 + 0.65 * plane / 0.7975 * 4.0 * xi * (1.0 - xi);
        material.young_modulus_pa * body.stiffening(element) / compliance.max(LEAST_COMPLIANCE)
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

/// Moves a reference point to the object's surface along the signed distance's gradient.
fn onto_surface(body: &Body, at: Vec3) -> Vec3 {
    let grid = &body.grid;
    let h = grid.voxel_size_m();
    let gradient = Vec3::from_fn(|a, _| {
        let offset = Vec3::from_fn(|b, _| if a == b { 0.5 * h } else { 0.0 });
        (grid.signed_distance_m(&(at + offset)) - grid.signed_distance_m(&(at - offset))) / h
    });
    let size2 = gradient.norm_squared();
    if size2.is_finite() && size2 > 0.01 { at - gradient * (grid.signed_distance_m(&at) / size2) } else { at }
}
