//! The anchor of a marker in contact: the material point X that its segment of the edge pushes on.
//!
//! The push is a spring of the contact's compliance whose force per length is capped: at
//! `initiation_ratio Gc` until it first gives, at Gc from then on (Griffith: the energy release rate
//! of a sharp edge is the edge-normal force per length). Where the link ahead is parted already the
//! cap is zero.

use serde::{Deserialize, Serialize};
use std::f64::consts::FRAC_1_SQRT_2;

use super::compliance::{EdgeInElement, line_compliance};
use super::crack::{AT_VOXELS, Crack, OnWay, Way};
use super::drive::Strained;
use super::travel::Travel;
use crate::body::Body;
use crate::contact::{ContactWeights, Mode};
use crate::grid::{Link, LinkId, MaterialPoint, VoxelId};
use crate::tool::frame::BladeFrame;
use crate::{Mat3, Vec3};

/// A front advances through the deformed material in steps of at most this fraction of a voxel. Ours. Half or twice
/// moves the mean force by 0.1 and 0.7 %, the first peak by 2 %, the area of the cut by 1 %.
const MARCH_VOXELS: f64 = 0.25;
/// And in so many of them at most: 16 voxels, what [`super::springs`] lets it advance by.
const MAX_MARCH_STEPS: u32 = 64;
/// Strips are shifted by this fraction of a voxel toward the blade's positive side: a voxel centre that lies on the
/// blade's plane, give or take the drift of the front, is on its negative side for every link and every strip. Ours:
/// above rounding, far below a voxel. Half or twice moves forces by 0.1 %, one link in 465.
const NUDGE_VOXELS: f64 = 1e-3;
/// Compression between H and a of a material that stiffens, over `H / sqrt(c)`: the integral at
/// [`Anchor::stiffness_n_per_m2`], ours. Where c is 10 and Gc/(E H) 0.2, half of it lowers the first peak by 8 %; twice
/// raises it by 6 %, takes 8 % off the mean force of slicing, and takes a third more iterations. Where c is 0 nothing
/// knows of it.
const SATURATED_GAP: f64 = 1.2;
/// What two points in two cells spread the load less than its variance says, over the square of how far they reach
/// across the node between them: in compliance, two columns of nodes are 1.2 times as far apart at a distance of 2 H
/// as at H, not four times (measured as the rest of `line_compliance`). Half or twice moves no force by 1e-4 where
/// the edge is along the lattice.
const TWO_CELLS: f64 = 2.8;

/// A marker this near to where the cut ends is there, voxels: neighbours that cut take the end on by about that in a step,
/// and it must not run after it for nothing. Ours.
const CAUGHT_UP_VOXELS: f64 = 0.05;

/// A link that was ahead is so as long as it is that near to being the next, voxels: a marker that stands where links change
/// would go to and fro between two elements, and push each in turn. Ours.
const KEPT_VOXELS: f64 = 0.1;

/// What lies ahead of a marker.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) enum Ahead {
    /// Material that holds, with its fracture energy (infinite: cannot be cut) and initiation ratio.
    Intact { fracture_energy_j_per_m2: f64, initiation_ratio: f64 },
    /// A cut that is there already.
    Parted,
    /// The outside.
    Outside,
}

/// The link that the blade's plane crosses ahead of a marker, reference configuration.
#[derive(Clone, Copy, Debug)]
pub(super) struct LinkAhead {
    pub(super) link: LinkId,
    /// Where the plane crosses it, m.
    pub(super) crossing_m: Vec3,
    /// Unit direction in which the front goes.
    pub(super) ahead: Vec3,
    /// The point of the plane whose column of voxels it is looked for in, m.
    pub(super) near_m: Vec3,
}

/// The material point of a marker in contact.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct Anchor {
    /// Reference position of the front, m.
    pub(super) position_m: Vec3,
    /// Where the material that has been swept ends here, m: `position_m` as the last sweep left it.
    /// Strips start exactly where the last ones ended, so that the cut has no gaps.
    pub(super) swept_m: Vec3,
    /// Where the cut begins here, m; moves with `position_m` until the marker yields.
    pub(super) start_m: Vec3,
    /// The voxels whose elements carry the contact. The force is shared between them: where material is
    /// joined, between the points `spread_m` to either side, else between the ends of the next link.
    voxels: [VoxelId; 2],
    /// Half of the distance between the two points, across the edge, m.
    spread_m: Vec3,
    /// Half-width of the edge, m.
    half_width_m: f64,
    pub(super) ahead: Ahead,
    /// Where the crack ends on its way as the step began, reference configuration: up to its own front it is in a cut,
    /// and what is before one that faces it holds, whichever links have parted.
    fronts: FrontsAhead,
    /// The link that it found ahead.
    link: Option<LinkId>,
    /// Where it was when it looked ahead, reference configuration, m.
    looked_m: Vec3,
    /// Unit normal into the surface that the edge came in through, reference configuration.
    pub(super) inward: Vec3,
    /// Whether it has given: from then on it gives at Gc.
    pub(super) yielded: bool,
    /// How the edge has gone through the material since it yielded.
    pub(super) travel: Travel,
    /// What the forward spring did at the end of the last step.
    pub(super) mode: Mode,
    /// Energy in its springs at the end of the last step, J.
    pub(super) stored_j: f64,
    /// What of it is in the lateral spring, J.
    pub(super) beside_j: f64,
    /// Stiffness of the spring in the last step over what it relaxes to.
    pub(super) unrelaxed: f64,
    /// How far its spring acts behind it along the cutting direction, m. Elements that the front comes to place it
    /// elsewhere than those before: the spring stays as it is, and takes that up over an element's way.
    pub(super) behind_m: f64,
}

/// Ends of the crack on the way of a marker, reference configuration.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
struct FrontsAhead {
    /// Where the cut that it is in ends ahead, m.
    own_m: Option<Vec3>,
    /// Where one ends that faces it, m.
    facing_m: Option<Vec3>,
    /// Whether the crack has an end here, at the marker or behind it.
    is_at_own: bool,
    /// Up to where its neighbours have cut, m, where no cut has come past the marker: what is before that holds at the
    /// marker, whichever links they parted.
    neighbours_m: Option<Vec3>,
}

impl FrontsAhead {
    fn on(way: &Way, found: OnWay, voxel_size_m: f64) -> Self {
        let at_m = CAUGHT_UP_VOXELS * voxel_size_m;
        let ahead = |distance_m: Option<f64>| {
            distance_m.filter(|distance_m| *distance_m > at_m).map(|distance_m| way.position_m + way.ahead * distance_m)
        };
        let is_at_own = found.front_m.is_some_and(|distance_m| distance_m <= at_m);
        let is_uncut = is_at_own || found.front_m.is_none();
        let neighbours_m =
            found.farthest_m.filter(|_| is_uncut).map(|distance_m| way.position_m + way.ahead * distance_m);
        Self { own_m: ahead(found.front_m), facing_m: ahead(found.facing_m), is_at_own, neighbours_m }
    }
}

impl Anchor {
    /// An anchor at `point` under a surface that faces `inward`, with nothing ahead of it yet.
    pub(super) fn at(point: MaterialPoint, inward: Vec3, half_width_m: f64) -> Self {
        Self {
            position_m: point.position_m,
            swept_m: point.position_m,
            start_m: point.position_m,
            voxels: [point.voxel; 2],
            spread_m: Vec3::zeros(),
            half_width_m,
            ahead: Ahead::Outside,
            fronts: FrontsAhead::default(),
            link: None,
            looked_m: point.position_m,
            inward,
            yielded: false,
            travel: Travel::default(),
            mode: Mode::Off,
            stored_j: 0.0,
            beside_j: 0.0,
            unrelaxed: 1.0,
            behind_m: 0.0,
        }
    }

    /// Starts the cut where the anchor is: what lies ahead is seen from here, strips begin here.
    pub(super) fn start_here(&mut self, body: &Body, crack: &Crack, frame: &BladeFrame) {
        self.look_ahead(body, crack, frame);
        self.start(body, frame);
    }

    /// Starts beside a neighbour that it was copied from: what that sees of the crack it sees too.
    pub(super) fn start_beside(&mut self, body: &Body, frame: &BladeFrame) {
        self.find_link_ahead(body, frame);
        self.start(body, frame);
    }

    fn start(&mut self, body: &Body, frame: &BladeFrame) {
        self.behind_m = 0.0;
        self.start_m = self.position_m;
        self.swept_m = self.strip_end_m(body, frame);
    }

    /// The elements that carry it.
    pub(super) fn elements(&self, body: &Body) -> [usize; 2] {
        self.voxels.map(|voxel| body.element_of(voxel))
    }

    fn points(&self) -> [MaterialPoint; 2] {
        let [a, b] = self.voxels;
        [(a, -self.spread_m), (b, self.spread_m)]
            .map(|(voxel, aside)| MaterialPoint { position_m: self.position_m + aside, voxel })
    }

    /// Scene position of the front's material point, m.
    pub(super) fn current_m(&self, body: &Body) -> Vec3 {
        let [a, b] = self.points();
        0.5 * (body.current_m(&a) + body.current_m(&b))
    }

    /// Goes on in the material, reference configuration, m.
    pub(super) fn go_on(&mut self, body: &Body, by_m: Vec3) {
        self.position_m += by_m;
        self.behind_m *= (-by_m.norm() / body.element_edge_m(body.element_of(self.voxels[0]))).exp();
    }

    /// What the gap of its spring falls by as it goes on to `next`, m.
    pub(super) fn advance_m(&self, next: &Self, body: &Body, frame: &BladeFrame) -> f64 {
        (next.current_m(body) - self.current_m(body)).dot(&frame.forward) - (next.behind_m - self.behind_m)
    }

    pub(super) fn weights(&self, body: &Body) -> ContactWeights {
        let mut weights = ContactWeights::default();
        for point in self.points() {
            weights.add_point(&body.weights(&point), 0.5);
        }
        weights
    }

    fn gradient(&self, body: &Body) -> Mat3 {
        let [a, b] = self.points();
        let first = body.deformation_gradient(&a);
        // Within one element both points move with one field.
        if body.element_of(a.voxel) == body.element_of(b.voxel) {
            return first;
        }
        0.5 * (first + body.deformation_gradient(&b))
    }

    /// `F^-1 d`: the reference vector that the deformation takes to a scene direction. Where the
    /// material is squeezed to a fifth or less, as if it were squeezed to a fifth.
    pub(super) fn pull_back(&self, body: &Body, direction: &Vec3) -> Vec3 {
        pulled_back(&self.gradient(body), direction)
    }

    /// The reference vector from the front to the point that lies `distance` farther along the cutting
    /// direction in the scene, at most as far as the material ahead stays what it is, and how far that is in the scene.
    /// In short steps: under the edge soft tissue is squeezed to a third, a few millimetres on it is not.
    pub(super) fn march(&self, body: &Body, frame: &BladeFrame, distance: f64) -> (Vec3, f64) {
        if distance <= 0.0 {
            return (Vec3::zeros(), 0.0);
        }
        let longest = MARCH_VOXELS * body.state.grid.voxel_size_m();
        let mut ahead = *self;
        let mut left = distance;
        for _ in 0..MAX_MARCH_STEPS {
            if left <= 1e-3 * distance {
                break;
            }
            let step = ahead.pull_back(body, &frame.forward) * left;
            let most = longest.min(ahead.next_front_m(&step.normalize(), longest));
            ahead.go_on(body, step * (most / step.norm()).min(1.0));
            ahead.find_link_ahead(body, frame);
            left = distance - self.advance_m(&ahead, body, frame);
            if ahead.ahead != self.ahead {
                break;
            }
        }
        (ahead.position_m - self.position_m, distance - left)
    }

    /// The shift of strips that settles on which side a centre on the blade's plane is.
    pub(super) fn nudge(&self, body: &Body, frame: &BladeFrame) -> Vec3 {
        let normal = (self.gradient(body).transpose() * frame.normal).try_normalize(0.0).unwrap_or(frame.normal);
        normal * (NUDGE_VOXELS * body.state.grid.voxel_size_m())
    }

    /// Where the strip that is swept now ends here, m.
    pub(super) fn strip_end_m(&self, body: &Body, frame: &BladeFrame) -> Vec3 {
        self.position_m + self.nudge(body, frame)
    }

    /// Its way through the material.
    pub(super) fn way(&self, body: &Body, frame: &BladeFrame) -> Way {
        self.way_in(&self.gradient(body), frame)
    }

    /// The same where the deformation gradient is known.
    fn way_in(&self, f: &Mat3, frame: &BladeFrame) -> Way {
        Way::new(self.position_m, pulled_back(f, &frame.forward).normalize(), &pulled_back(f, &frame.along))
    }

    /// Finds what lies ahead: where the body's crack ends, and the link that is next.
    pub(super) fn look_ahead(&mut self, body: &Body, crack: &Crack, frame: &BladeFrame) {
        let held = matches!(self.ahead, Ahead::Intact { .. });
        self.fronts = FrontsAhead::default();
        let mut f = self.gradient(body);
        if !crack.is_empty() {
            let way = self.way_in(&f, frame);
            let h = body.state.grid.voxel_size_m();
            let found = crack.on_way(&way, h);
            self.fronts = FrontsAhead::on(&way, found, h);
            if held {
                // Where it cuts already it is the front, and not that of its neighbours beside it.
                self.fronts.own_m = None;
            } else if self.fronts.is_at_own {
                self.position_m += way.ahead * found.front_m.map_or(0.0, |left_m| left_m.max(0.0));
                f = self.gradient(body);
            }
        }
        self.find_link_ahead_in(body, &f, frame);
        self.looked_m = self.position_m;
    }

    /// Whether it is in the material, and near enough to where it looked ahead to be carried by the same voxels.
    pub(super) fn knows_ahead(&self, body: &Body) -> bool {
        let grid = &body.state.grid;
        (self.position_m - self.looked_m).norm() <= MARCH_VOXELS * grid.voxel_size_m()
            && grid.signed_distance_m(&self.position_m) < 0.0
    }

    /// Whether the body keeps where the front is here.
    pub(super) fn is_at_end(&self) -> bool {
        self.fronts.is_at_own
    }

    /// Distance to where what is ahead changes, m, no more than `longest_m`.
    fn next_front_m(&self, ahead: &Vec3, longest_m: f64) -> f64 {
        let next = if self.ahead == Ahead::Parted { self.fronts.own_m } else { self.fronts.facing_m };
        let distance_m = next.map_or(longest_m, |at_m| (at_m - self.position_m).dot(ahead));
        if distance_m > 0.0 { distance_m } else { longest_m }
    }

    /// Finds the link that the blade's plane crosses ahead: so far ahead that the crossing of the
    /// column it is looked for in cannot lie behind the front, where the blade itself has parted it.
    pub(super) fn find_link_ahead(&mut self, body: &Body, frame: &BladeFrame) {
        self.find_link_ahead_in(body, &self.gradient(body), frame);
    }

    /// The same where the deformation gradient is known.
    fn find_link_ahead_in(&mut self, body: &Body, f: &Mat3, frame: &BladeFrame) {
        let grid = &body.state.grid;
        let h = grid.voxel_size_m();
        let LinkAhead { link, near_m: at, ahead, crossing_m } = self.link_ahead(body, f, frame);
        let axis = link.axis as usize;
        let ends = [grid.voxel_at(link.cell), grid.voxel_at(link.upper())];
        let before = *self;
        self.link = Some(link);
        self.spread_m = Vec3::zeros();
        match ends {
            [Some(lower), Some(upper)] if joined(body, lower, upper) => {
                // One field: each point moves with the element that it is in, so that the weights go on
                // without a step as they cross from cell to cell.
                let beyond = self.position_m[axis] - grid.origin_m()[axis] >= h * f64::from(link.upper()[axis]);
                let middle = if beyond { upper } else { lower };
                let aside = self.across(f, frame) * (FRAC_1_SQRT_2 * self.half_width_m);
                let carrier = |aside: Vec3| {
                    let mut near = at + aside;
                    near[axis] = self.position_m[axis] + aside[axis];
                    grid.voxel_at(grid.cell_of(&near)).filter(|v| joined(body, middle, *v)).unwrap_or(middle)
                };
                self.voxels = [carrier(-aside), carrier(aside)];
                self.spread_m = aside;
            }
            [Some(lower), Some(upper)] => self.voxels = self.sides(body, lower, upper),
            [Some(any), None] | [None, Some(any)] => self.voxels = [any; 2],
            [None, None] => {}
        }
        let is_ahead =
            |front_m: Option<Vec3>| front_m.is_some_and(|at_m| (at_m - self.position_m).dot(&ahead) > AT_VOXELS * h);
        let neighbours_parted = self.fronts.neighbours_m.is_some_and(|at_m| (at_m - crossing_m).dot(&ahead) > 0.0);
        let holds = || Ahead::Intact {
            fracture_energy_j_per_m2: fracture_energy(body, link),
            initiation_ratio: body.material_of(self.voxels[0]).initiation_ratio,
        };
        self.ahead = match grid.link(link) {
            Link::Intact | Link::Parted(_) if is_ahead(self.fronts.own_m) => Ahead::Parted,
            Link::Parted(_) if is_ahead(self.fronts.facing_m) || neighbours_parted => holds(),
            Link::Parted(_) => Ahead::Parted,
            Link::Intact | Link::Boundary(_) if grid.signed_distance_m(&at) < 0.0 => holds(),
            // A sheet thinner than half a voxel ends before the link that it lies in.
            Link::Intact if grid.signed_distance_m(&self.position_m) < 0.0 => holds(),
            // Past the last link what held there holds on to the surface.
            _ if grid.signed_distance_m(&self.position_m) < 0.0 => self.ahead,
            _ => Ahead::Outside,
        };
        // Beyond an old cut the crack is there already: nothing has to be initiated.
        self.yielded |= self.ahead == Ahead::Parted;
        if !self.yielded || !matches!(self.ahead, Ahead::Intact { .. }) {
            self.behind_m = 0.0;
        } else if self.elements(body) != before.elements(body) {
            self.behind_m += (self.current_m(body) - before.current_m(body)).dot(&frame.forward);
        }
    }

    /// The voxels that carry the contact across a cut: both while its sides are one place still, so that nothing jumps as
    /// links part; else the one that moves on with what carried it: a flap that has folded away or a chip that has
    /// fallen is elsewhere.
    fn sides(&self, body: &Body, lower: VoxelId, upper: VoxelId) -> [VoxelId; 2] {
        let [a_m, b_m] =
            [lower, upper].map(|voxel| body.current_m(&MaterialPoint { position_m: self.position_m, voxel }));
        let reach_m =
            [lower, upper].map(|voxel| body.element_edge_m(body.element_of(voxel))).into_iter().fold(0.0, f64::max);
        if (a_m - b_m).norm() <= reach_m {
            return [lower, upper];
        }
        let was_m = self.current_m(body);
        [if (a_m - was_m).norm() <= (b_m - was_m).norm() { lower } else { upper }; 2]
    }

    /// The link that [`Self::find_link_ahead`] finds, under the deformation gradient `f`: the one that it found before while
    /// that is about as far.
    fn link_ahead(&self, body: &Body, f: &Mat3, frame: &BladeFrame) -> LinkAhead {
        let next = self.link_beyond(body, f, frame, 0.0);
        if self.link == Some(next.link) {
            return next;
        }
        let kept = self.link_beyond(body, f, frame, KEPT_VOXELS);
        if self.link == Some(kept.link) { kept } else { next }
    }

    /// The link ahead of a point that is so far ahead, voxels.
    fn link_beyond(&self, body: &Body, f: &Mat3, frame: &BladeFrame, beyond_voxels: f64) -> LinkAhead {
        let grid = &body.state.grid;
        let h = grid.voxel_size_m();
        let ahead = pulled_back(f, &frame.forward).normalize();
        let normal = f.transpose() * frame.normal;
        let axis = normal.iamax();
        // A point of the plane half a voxel off in one of the other axes is this far off along `ahead`.
        let along = |a: usize| (ahead[a] - ahead[axis] * normal[a] / normal[axis]).abs();
        let reach = 0.5 * (0..3).filter(|a| *a != axis).map(along).sum::<f64>();
        let at = self.position_m + ahead * ((reach.max(0.5) + beyond_voxels) * h);
        let cell = grid.cell_of(&at);
        let centre = grid.centre_m(cell);
        // The plane's height over the centre of the column, not over the marker.
        let across: f64 = (0..3).filter(|a| *a != axis).map(|a| normal[a] * (centre[a] - at[a])).sum();
        let height = (at[axis] - across / normal[axis] - grid.origin_m()[axis]) / h - 0.5;
        let mut lower = cell;
        lower[axis] = height.floor() as i32;
        let mut crossing_m = centre;
        crossing_m[axis] = grid.origin_m()[axis] + h * (height + 0.5);
        LinkAhead { link: LinkId { cell: lower, axis: axis as u8 }, near_m: at, crossing_m, ahead }
    }

    /// The link ahead as the material is deformed now.
    pub(super) fn next_link(&self, body: &Body, frame: &BladeFrame) -> LinkAhead {
        self.link_ahead(body, &self.gradient(body), frame)
    }

    /// Width of the strip that a segment of the edge cuts, reference configuration: the material has
    /// spread along the edge. A blade that goes on at the same force in a state that goes with it
    /// spends `F dz` on `w dz` of reference area, so that `F = Gc w` is in reference width however the
    /// material is squeezed ahead of the edge.
    pub(super) fn reference_width_m(&self, body: &Body, frame: &BladeFrame, segment_m: f64) -> f64 {
        let f = self.gradient(body);
        let ahead = pulled_back(&f, &frame.forward).normalize();
        ahead.cross(&(pulled_back(&f, &frame.along) * segment_m)).norm()
    }

    /// Gc of what lies ahead at the speed at which the front goes on; none where nothing holds.
    pub(super) fn toughness_j_per_m2(&self, body: &Body) -> Option<f64> {
        let Ahead::Intact { fracture_energy_j_per_m2, .. } = self.ahead else { return None };
        let rate = body.material_of(self.voxels[0]).toughness_rate;
        let factor = rate.map_or(1.0, |rate| rate.factor(self.travel.speed_m_per_s()));
        Some(fracture_energy_j_per_m2 * factor)
    }

    /// Force at which the marker gives, and the force it goes on at, N. It starts at a line load on
    /// the surface as it stands, and goes on at Gc per reference area, as far as the edge does not slice and the
    /// body is not strained: then at what [`Strained`] says.
    pub(super) fn limits_n(&self, body: &Body, frame: &BladeFrame, segment_m: f64, strained: &Strained) -> (f64, f64) {
        let (Ahead::Intact { initiation_ratio, .. }, Some(toughness)) = (self.ahead, self.toughness_j_per_m2(body))
        else {
            return (0.0, 0.0);
        };
        let slice_push = self.travel.slice_push();
        let width_m = self.reference_width_m(body, frame, segment_m);
        let steady = strained.push_n_per_m(toughness) * width_m / (1.0 + slice_push * slice_push);
        let start = (toughness * initiation_ratio - strained.release_j_per_m2.max(0.0)).max(0.0) * segment_m;
        (if self.yielded { steady } else { start.max(steady) }, steady)
    }

    /// Unit direction across the edge in the surface that it came in through, reference configuration.
    fn across(&self, f: &Mat3, frame: &BladeFrame) -> Vec3 {
        pulled_back(f, &frame.along).cross(&self.inward).try_normalize(0.0).unwrap_or(frame.normal)
    }

    /// Stiffness of the contact per length of edge, now and when all has relaxed, N/m^2, `from_end_m` away
    /// from the nearer end of the edge: see [`line_compliance`]. Stiffened tissue stiffens it; and as its
    /// strain under the edge saturates, between H and a it gives by no more than `H / sqrt(c)` or so at the
    /// load at which it is cut (the integral of the strain `eps exp(c eps^2) = sigma / E` over that range).
    /// It relaxes as the elements around it do: exact while its dent grows in proportion to theirs.
    pub(super) fn stiffness_n_per_m2(&self, body: &Body, frame: &BladeFrame, from_end_m: f64) -> [f64; 2] {
        let across = self.across(&self.gradient(body), frame);
        let place = self.place_in_element(body, &across, from_end_m);
        let of = |voxel: VoxelId| {
            let material = body.material_of(voxel);
            let element = body.element_of(voxel);
            let compliance = line_compliance(material.poisson_ratio, body.element_level(element), &place);
            let c = 0.5 * material.law.stiffening_rate_per_pa * material.young_modulus_pa;
            let load = material.fracture_energy_j_per_m2.unwrap_or(0.0) * material.initiation_ratio;
            let least = load * c.sqrt() / (SATURATED_GAP * body.element_edge_m(element));
            let stiffness = |factor: f64| (material.young_modulus_pa * factor / compliance).max(least);
            let factor = body.stiffening(element);
            let relaxed = stiffness(factor);
            let now = material.law.viscosity.map_or(relaxed, |viscosity| {
                stiffness(factor + viscosity.modulus_ratio * body.unrelaxed_share(element))
            });
            [now, relaxed]
        };
        let [a, b] = self.voxels.map(of);
        [0, 1].map(|i| 0.5 * (a[i] + b[i]))
    }

    fn place_in_element(&self, body: &Body, across: &Vec3, from_end_m: f64) -> EdgeInElement {
        let elements = self.voxels.map(|voxel| body.element_of(voxel));
        let edge_m = body.element_edge_m(elements[0]);
        let local =
            |element: usize, at: &Vec3| Vec3::from(body.local_coordinates(element, at).map(|x| x.clamp(0.0, 1.0)));
        let about = |xi: Vec3| xi.map(|x| 4.0 * x * (1.0 - x));
        let middle = local(elements[0], &self.position_m);
        let squared = across.component_mul(across);
        let spread = if elements[0] == elements[1] {
            // A linear field: two points are as their middle.
            squared.dot(&about(middle))
        } else {
            let [a, b] = self.points().map(|p| about(local(body.element_of(p.voxel), &p.position_m)));
            let aside = self.spread_m / edge_m;
            // How far the points reach across the nearest plane of nodes.
            let at = body.local_coordinates(elements[0], &self.position_m);
            let over = |i: usize| (aside[i].powi(2) - (at[i] - at[i].round()).powi(2)).max(0.0);
            let off = (0..3).map(over).sum::<f64>();
            0.5 * squared.dot(&(a + b)) + 4.0 * aside.norm_squared() - TWO_CELLS * off
        };
        EdgeInElement {
            half_width: self.half_width_m / edge_m,
            from_end: from_end_m / edge_m,
            across: spread,
            inward: self.inward.component_mul(&self.inward).dot(&about(middle)),
        }
    }
}

/// `F^-1 d`, bounded as [`Anchor::pull_back`] says.
fn pulled_back(f: &Mat3, direction: &Vec3) -> Vec3 {
    let pulled = f.try_inverse().map_or(*direction, |inverse| inverse * direction);
    let length = pulled.norm();
    if length.is_finite() && length > 0.0 { pulled * (length.min(5.0) / length) } else { *direction }
}

/// Whether two voxels belong to one element, or to elements that share every node at which their cells
/// touch: the displacement is continuous from one to the other.
fn joined(body: &Body, a: VoxelId, b: VoxelId) -> bool {
    let [a, b] = [a, b].map(|voxel| &body.base().elements[body.element_of(voxel)]);
    let apart = [0, 1, 2].map(|i| b.cell[i] - a.cell[i]);
    // The corner of b that stands where a corner of a does.
    let same_place = |corner: usize| {
        (0..3).try_fold(0usize, |sum, i| {
            let bit = (corner >> i & 1) as i32 - apart[i];
            (0..=1).contains(&bit).then_some(sum | (bit as usize) << i)
        })
    };
    let mut shared = (0..8).filter_map(|corner| Some(a.nodes[corner] == b.nodes[same_place(corner)?])).peekable();
    shared.peek().is_some() && shared.all(|same| same)
}

/// Fracture energy of a link: the lesser of its ends', infinite where neither end can be cut.
pub(super) fn fracture_energy(body: &Body, link: LinkId) -> f64 {
    [link.cell, link.upper()]
        .into_iter()
        .filter_map(|cell| body.state.grid.voxel_at(cell))
        .map(|v| body.material_of(v).fracture_energy_j_per_m2.unwrap_or(f64::INFINITY))
        .fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::workers::Workers;

    const SCENE: &str = r#"
version = 1
name = "bar"
[[objects]]
name = "bar"
shape = { box = { min_m = [0.0, 0.0, 0.0], max_m = [0.08, 0.02, 0.02] } }
voxel_size_m = 0.005
level = 0
material = { young_modulus_pa = 1e5, poisson_ratio = 0.4 }
"#;

    /// The bar cut through its middle, what is beyond moved down.
    fn cut_bar(down_m: f64) -> Body {
        let mut body = Body::of_text(SCENE);
        let crossing = crate::grid::Crossing { t: 0.5, normal: [1.0, 0.0, 0.0] };
        let cells = (0..4).flat_map(|y| (0..4).map(move |z| [7, y, z]));
        let links: Vec<_> = cells.map(|cell| (LinkId { cell, axis: 0 }, crossing)).collect();
        let parted = body.part_links(&links).parted;
        body.update_topology(&Workers::serial(), &parted);
        let beyond =
            body.part_of_node((0..body.node_count()).find(|n| body.rest_position_m(*n).x > 0.07).unwrap() as u32);
        for node in (0..body.node_count()).filter(|n| body.part_of_node(*n as u32) == beyond).collect::<Vec<_>>() {
            body.state.position_m[node][1] -= down_m;
        }
        body
    }

    /// How far an anchor between the two sides is below where it was built, m.
    fn below_m(body: &Body) -> f64 {
        let position_m = Vec3::new(0.0401, 0.015, 0.01);
        let own = body.state.grid.voxel_at([7, 2, 2]).unwrap();
        let mut anchor = Anchor::at(MaterialPoint { position_m, voxel: own }, -Vec3::y(), 1e-4);
        let frame = BladeFrame { forward: -Vec3::y(), along: Vec3::z(), normal: Vec3::x() };
        anchor.find_link_ahead(body, &frame);
        assert_eq!(anchor.ahead, Ahead::Parted);
        position_m.y - anchor.current_m(body).y
    }

    #[test]
    fn an_anchor_over_a_cut_stands_between_its_sides_until_one_is_elsewhere() {
        assert!((below_m(&cut_bar(1e-3)) - 0.5e-3).abs() < 1e-9);
        assert!(below_m(&cut_bar(1.0)).abs() < 1e-9, "what it stood on has not moved");
    }
}
