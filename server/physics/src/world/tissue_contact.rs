//! Tissue against tissue: parts, flaps and bodies that press on each other, within a step.

use super::body_slot::BodySlot;
use super::part_groups::PartGroups;
use super::tool::Tool;
use crate::Vec3;
use crate::body::{Body, Lost};
use crate::boundary::{Boundary, PatchKey, SurfacePatch};
use crate::contact::candidates::{Candidates, Reach};
use crate::contact::ends::{TissueEnd, TissueEnds};
use crate::contact::press::{Approach, MARGIN_VOXELS, PatchOf, PlacedPatch, Plane, PointBelow, approach, meet};
use crate::contact::{Contact, ContactWeights, Friction, Misjudged, Mode, Solution, TissueContact, pressed_m};
use crate::grow::make_room;
use crate::ledger::ContactLedger;
use crate::solve::pcg::{Factor, System, Systems};
use crate::solve::spring::{PointSpring, ROOM_FOR_SPRINGS};
use crate::workers::Workers;
use serde::{Deserialize, Serialize};

/// Stiffness of an interface over that of the half elements on both sides of it: pressed bodies are softer
/// by a twentieth of an element than if they were one. Halved, by a tenth; doubled, by a fortieth, at more iterations.
const STIFFNESS: f64 = 20.0;
/// A spring that is off may find itself this fraction of a voxel deep without another solve within the step. The force
/// that is missing then is `20 E A / H` of it, 2 % of a voxel's strain; it is there in the next step.
const SLACK_VOXELS: f64 = 1e-3;
/// What is found deeper than this many voxels at the beginning of a step is pushed out as if it were so
/// deep: a spring that finds itself deep in tissue would throw it out. At this depth the interface carries
/// a pressure of `E` and more, so that halving or doubling it changes nothing that is pressed by less than that.
const MOST_PUSH_VOXELS: f64 = 0.25;
/// Elements that a surface may move by in a step and still be caught: 17 mm, a step of a metre per second
/// at 60 Hz, of the smallest elements in use. It bounds what is searched, and only where something moves so fast.
const MOST_TRAVEL_ELEMENTS: f64 = 16.0;

/// Patches that may meet others before a step allocates: of most of a surface none does.
const ROOM_FOR_CANDIDATES: usize = 1024;

/// Surfaces that one patch may approach at once before a step allocates.
const ROOM_FOR_APPROACHES: usize = 256;

/// Springs between tissue and tissue, and what they are found with.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct TissueContacts {
    /// By body.
    carried: Vec<Carried>,
    #[serde(skip)]
    candidates: Candidates,
    /// By candidate.
    #[serde(skip)]
    placed: Vec<PlacedPatch>,
    /// By candidate; `None` where the tissue is crushed flat.
    #[serde(skip)]
    planes: Vec<Option<Plane>>,
    /// Of one candidate to others, with their places: scratch.
    #[serde(skip)]
    approaches: Vec<(usize, Approach)>,
    springs: Vec<TissueContact>,
    #[serde(skip)]
    bridges: Vec<Bridge>,
    #[serde(skip)]
    groups: PartGroups,
}

/// What the patches of a body's surface carry from step to step.
#[derive(Clone, Default, Serialize, Deserialize)]
struct Carried {
    /// Version of the surface.
    version: u64,
    keys: Vec<PatchKey>,
    /// Work done on each patch's spring since it touched, J: it never holds more.
    work_j: Vec<f64>,
    /// The same before the last step: scratch.
    #[serde(skip)]
    before_j: Vec<f64>,
}

impl Carried {
    /// Follows a surface that has changed. A patch that gains or loses area keeps what its spring holds.
    fn follow(&mut self, boundary: &Boundary) {
        if self.version == boundary.version() {
            return;
        }
        let mut before = self.keys.iter().zip(&self.work_j).peekable();
        let work_j = boundary.patches().iter().map(|patch| {
            while before.next_if(|(key, _)| **key < patch.key()).is_some() {}
            before.next_if(|(key, _)| **key == patch.key()).map_or(0.0, |(_, work_j)| *work_j)
        });
        let work_j: Vec<f64> = work_j.collect();
        let keys = boundary.patches().iter().map(SurfacePatch::key).collect();
        let before_j = vec![0.0; work_j.len()];
        *self = Self { version: boundary.version(), keys, work_j, before_j };
    }
}

/// A spring between two bodies, as the solver sees it.
#[derive(Clone, Copy)]
struct Bridge {
    ends: [(u32, PointSpring); 2],
}

/// Bodies that press on each other: one system of equations.
pub(super) struct Island<'a> {
    pub(super) slots: &'a mut [BodySlot],
    pub(super) tissue: Option<&'a mut TissueContacts>,
    /// The island's number: the first of its bodies.
    pub(super) id: usize,
    pub(super) dt_s: f64,
    /// Whether modes may change before the solve's end.
    pub(super) may_change: bool,
}

impl Island<'_> {
    /// Takes the solution so far; returns how wrong modes were.
    pub(super) fn settle(&mut self, workers: &Workers<'_>, solution: Solution) -> Misjudged {
        let mut wrong = Misjudged::default();
        for slot in self.slots.iter_mut().filter(|slot| slot.scratch.island == self.id) {
            slot.body.take_velocity_change(workers, &mut slot.velocity_change);
            wrong += slot.settle_contacts(self.dt_s, solution);
        }
        if let Some(tissue) = &mut self.tissue {
            wrong += tissue.settle(self.slots, self.id, self.dt_s, solution);
        }
        wrong
    }
}

impl TissueContacts {
    /// The surfaces of all bodies.
    pub(super) fn new(slots: &[BodySlot]) -> Self {
        let mut contact = Self {
            carried: vec![Carried::default(); slots.len()],
            candidates: Candidates::default(),
            placed: Vec::new(),
            planes: Vec::new(),
            approaches: Vec::new(),
            springs: Vec::new(),
            bridges: Vec::new(),
            groups: PartGroups::default(),
        };
        contact.follow_anew(slots);
        contact
    }

    /// Whether it is of the surfaces of these bodies.
    pub(super) fn fits(&self, slots: &[BodySlot]) -> bool {
        let is_of = |(carried, body): (&Carried, &Body)| {
            let patches = body.boundary().patches();
            carried.version == body.boundary().version()
                && carried.work_j.len() == patches.len()
                && carried.keys.iter().copied().eq(patches.iter().map(SurfacePatch::key))
        };
        let is_in = |end: &TissueEnd| {
            let fits =
                |slot: &BodySlot| end.weights.fits(slot.body.node_count()) && end.weights.iter().next().is_some();
            slots.get(end.body as usize).is_some_and(fits)
        };
        let patches = |spring: &TissueContact| self.carried[spring.ends.ends[0].body as usize].keys.len();
        self.carried.len() == slots.len()
            && self.carried.iter().zip(bodies(slots)).all(is_of)
            && self.springs.iter().all(|s| s.ends.ends.iter().all(is_in) && (s.ends.patch as usize) < patches(s))
    }

    /// Most springs that there may be until links part again.
    pub(super) fn most_springs(&self) -> usize {
        self.carried.iter().map(|carried| carried.keys.len()).sum()
    }

    /// Takes surfaces that were set from outside.
    pub(super) fn follow_anew(&mut self, slots: &[BodySlot]) {
        self.candidates.forget();
        self.carry(slots);
    }

    /// Takes what the parting of links changed in the surfaces in this step.
    pub(super) fn follow(&mut self, slots: &[BodySlot]) {
        self.candidates.follow(bodies(slots), |index| slots[index].scratch.change.elements.as_slice());
        self.carry(slots);
    }

    fn carry(&mut self, slots: &[BodySlot]) {
        self.keep_sleeping(slots);
        self.carried.iter_mut().zip(bodies(slots)).for_each(|(carried, body)| carried.follow(body.boundary()));
        self.reserve(slots);
    }

    /// Lets go of the pieces of a body that are lost: a step that is taken back leaves no force to go on from.
    pub(super) fn release(&mut self, slots: &[BodySlot], index: usize, lost: &Lost) {
        let body = &slots[index].body;
        let is_lost = |end: &TissueEnd| {
            let mut nodes = end.weights.iter();
            end.body as usize == index && nodes.any(|(node, _)| body.is_lost_at(lost, node))
        };
        let Self { springs, carried, .. } = self;
        springs.retain(|spring| {
            let keeps = !spring.ends.ends.iter().any(is_lost);
            if !keeps {
                carried[spring.ends.ends[0].body as usize].work_j[spring.ends.patch as usize] = 0.0;
            }
            keeps
        });
    }

    /// Lets go of all springs but those of bodies that sleep.
    fn keep_sleeping(&mut self, slots: &[BodySlot]) {
        self.springs.retain(|spring| slots[spring.ends.ends[0].body as usize].is_asleep());
    }

    /// Wakes the bodies that a spring joins to one that is awake. Returns whether there were any.
    pub(super) fn rouse(&self, slots: &mut [BodySlot], tools: &[Tool]) -> bool {
        let mut roused = false;
        for spring in &self.springs {
            let ends = spring.ends.ends.map(|end| end.body as usize);
            let [a, b] = ends.map(|body| slots[body].is_asleep());
            if a != b {
                slots[ends[usize::from(b)]].rouse(tools);
                roused = true;
            }
        }
        roused
    }

    /// The springs of bodies that sleep go on as they are.
    pub(super) fn come_to_rest(&mut self, slots: &[BodySlot]) {
        let sleeps = |spring: &&mut TissueContact| slots[spring.ends.ends[0].body as usize].is_asleep();
        self.springs.iter_mut().filter(sleeps).for_each(Contact::come_to_rest);
    }

    /// What they give a body in a step while nothing moves, (node, N s).
    pub(super) fn resting_impulses(&self, body: usize, dt_s: f64) -> impl Iterator<Item = (u32, [f64; 3])> {
        self.springs.iter().filter(|spring| spring.force_n != 0.0).flat_map(move |spring| {
            let impulse = spring.direction * (dt_s * spring.force_n);
            spring.ends.weights_in(body as u32).map(move |(node, w)| (node, (impulse * w).into()))
        })
    }

    /// Makes room for what there may be until links part again.
    pub(super) fn reserve(&mut self, slots: &[BodySlot]) {
        let most = self.most_springs();
        self.candidates.reserve(bodies(slots), most);
        self.placed.clear();
        make_room(&mut self.placed, most.min(ROOM_FOR_CANDIDATES));
        self.planes.clear();
        make_room(&mut self.planes, most.min(ROOM_FOR_CANDIDATES));
        self.approaches.clear();
        make_room(&mut self.approaches, ROOM_FOR_APPROACHES);
        let springs = most.min(ROOM_FOR_SPRINGS);
        make_room(&mut self.springs, springs);
        self.bridges.clear();
        make_room(&mut self.bridges, if slots.len() > 1 { springs } else { 0 });
        self.groups.reserve(slots);
    }

    /// Finds the patches that meet a surface in this step. Between bodies that sleep all stays as it is.
    pub(super) fn detect(&mut self, slots: &[BodySlot], dt_s: f64) {
        self.keep_sleeping(slots);
        let reach = reach(slots);
        if !self.candidates.hold(bodies(slots)) {
            self.candidates.look_again(bodies(slots), reach);
        }
        self.placed.clear();
        self.planes.clear();
        for [body, patch] in self.candidates.patches() {
            let of = &slots[body as usize].body;
            self.placed.push(PlacedPatch::of(of, [body, patch]));
            self.planes.push(Plane::of(of, &of.boundary().patches()[patch as usize]));
        }
        let mut approaches = std::mem::take(&mut self.approaches);
        for (index, placed) in self.placed.iter().enumerate() {
            let point = self.patch_of(slots, index);
            let sleeps = |index: usize| slots[self.placed[index].body as usize].is_asleep();
            approaches.clear();
            approaches.extend(self.candidates.others(index).filter_map(|other| {
                if sleeps(index) && sleeps(other) {
                    return None;
                }
                let is_near = reach.meets(placed, &self.placed[other], dt_s);
                let found = if is_near { approach(&point, &self.patch_of(slots, other), dt_s) } else { None };
                Some((other, found?))
            }));
            // Of the surfaces that are under it the one whose middle is nearest.
            approaches.sort_unstable_by(|(i, a), (j, b)| a.aside_m.total_cmp(&b.aside_m).then(i.cmp(j)));
            let mut met = approaches.iter().filter_map(|(other, approach)| {
                let surface = self.patch_of(slots, *other);
                Some((surface, meet(&point, &surface, approach, dt_s)?))
            });
            if let Some((surface, below)) = met.next() {
                let work_j = self.carried[placed.body as usize].work_j[placed.patch as usize];
                self.springs.push(spring(&point, &surface, &below, work_j, dt_s));
            }
        }
        self.approaches = approaches;
    }

    /// A candidate.
    fn patch_of<'a>(&'a self, slots: &'a [BodySlot], index: usize) -> PatchOf<'a> {
        let placed = &self.placed[index];
        let body = &slots[placed.body as usize].body;
        let patch = &body.boundary().patches()[placed.patch as usize];
        PatchOf { body, patch, placed, plane: self.planes[index].as_ref() }
    }

    /// The springs that act on a body.
    fn acting_in(&self, body: u32) -> impl Iterator<Item = &TissueContact> {
        let acts = move |s: &&TissueContact| s.mode != Mode::Off && s.ends.ends.iter().any(|end| end.body == body);
        self.springs.iter().filter(acts)
    }

    /// What they add to the body's matrix.
    pub(super) fn point_springs(&self, body: usize, dt_s: f64) -> impl Iterator<Item = PointSpring> {
        self.acting_in(body as u32).map(move |spring| spring.point_spring(spring.ends.weights_in(body as u32), dt_s))
    }

    /// What they add to the body's right side, (node, N s).
    pub(super) fn impulses(&self, body: usize, dt_s: f64) -> impl Iterator<Item = (u32, [f64; 3])> {
        self.acting_in(body as u32).flat_map(move |spring| {
            let impulse = spring.impulse(dt_s);
            spring.ends.weights_in(body as u32).map(move |(node, w)| (node, (impulse * w).into()))
        })
    }

    /// Gives each body the number of its island: the first of the bodies that springs join it to.
    pub(super) fn number_islands(&self, slots: &mut [BodySlot]) {
        for spring in self.springs.iter().filter(|s| s.ends.joins_bodies()) {
            let [a, b] = [0, 1].map(|end| slots[spring.ends.ends[end].body as usize].scratch.island);
            if a == b {
                continue;
            }
            let (low, high) = (a.min(b), a.max(b));
            slots.iter_mut().filter(|slot| slot.scratch.island == high).for_each(|slot| slot.scratch.island = low);
        }
    }

    /// Lets parts that press on each other gain the momentum that is missing as one.
    pub(super) fn join_parts(&mut self, slots: &mut [BodySlot]) {
        let pressing = self.springs.iter().filter(|s| s.mode != Mode::Off);
        self.groups.join(slots, pressing);
    }

    /// Takes the springs between bodies as they are now to the solver.
    pub(super) fn build_bridges(&mut self, slots: &[BodySlot], dt_s: f64) {
        self.bridges.clear();
        for spring in self.springs.iter().filter(|s| s.mode != Mode::Off && s.ends.joins_bodies()) {
            let ends = spring.ends.ends.map(|end| {
                let own = spring.point_spring(spring.ends.weights_in(end.body), dt_s);
                (end.body, slots[end.body as usize].body.among_unknowns(&own))
            });
            self.bridges.push(Bridge { ends });
        }
    }

    /// Takes the solution of an island; returns how wrong modes were.
    pub(super) fn settle(&mut self, slots: &[BodySlot], island: usize, dt_s: f64, solution: Solution) -> Misjudged {
        let mut wrong = Misjudged::default();
        for spring in self.springs.iter_mut().filter(|s| slots[s.ends.ends[0].body as usize].scratch.island == island) {
            let change = spring.ends.relative(|body| &slots[body as usize].velocity_change);
            wrong += spring.settle(dt_s, &change, solution);
        }
        wrong
    }

    /// Books the springs' energies and what friction took, and keeps the work done on them, from which the next step's
    /// begin and which limits its friction.
    pub(super) fn conclude(&mut self, ledger: &mut ContactLedger, dt_s: f64) {
        for Carried { work_j, before_j, .. } in &mut self.carried {
            before_j.clone_from(work_j);
            work_j.fill(0.0);
        }
        for spring in &self.springs {
            ledger.add(spring, dt_s);
            let TissueEnds { ends: [point, _], patch } = &spring.ends;
            let Carried { work_j, before_j, .. } = &mut self.carried[point.body as usize];
            if spring.force_n > 0.0 {
                work_j[*patch as usize] = (before_j[*patch as usize] + spring.work_j()).max(0.0);
            }
        }
    }

    /// Springs of the last step; none where links parted in it.
    pub(super) fn springs(&self) -> &[TissueContact] {
        &self.springs
    }
}

fn bodies(slots: &[BodySlot]) -> impl ExactSizeIterator<Item = &Body> + Clone {
    slots.iter().map(|slot| &slot.body)
}

/// How far patches may be from what they meet.
fn reach(slots: &[BodySlot]) -> Reach {
    let edge_m = bodies(slots).map(Body::largest_edge_m).fold(0.0, f64::max);
    let voxel_m = bodies(slots).map(|body| body.state.grid.voxel_size_m()).fold(0.0, f64::max);
    Reach { still_m: edge_m + MARGIN_VOXELS * voxel_m, most_travel_m: MOST_TRAVEL_ELEMENTS * edge_m }
}

/// The spring of a patch that meets a surface. The surface's own patches have springs on this one in turn,
/// so that each has half of the interface's stiffness. It starts in the mode that its depth says: what the velocity
/// predicts is, in tissue at rest, what the last solve left of its residual.
fn spring(point: &PatchOf<'_>, surface: &PatchOf<'_>, below: &PointBelow, work_j: f64, dt_s: f64) -> TissueContact {
    let ends = [(point, &point.patch.point, 1.0), (surface, &below.point, -1.0)]
        .map(|(of, at, sign)| TissueEnd { body: of.placed.body, weights: ContactWeights::of(of.body, at, sign) });
    let bodies = [point.body, surface.body];
    let velocity: Vec3 = ends.iter().zip(bodies).map(|(end, body)| end.weights.sum(&body.state.velocity_m_per_s)).sum();
    // Of the two half elements, in series.
    let compliance: f64 = [point, surface].map(PatchOf::compliance_m_per_pa).iter().sum();
    let closing = velocity.dot(&below.normal);
    let voxel_m = point.body.state.grid.voxel_size_m();
    let stiffness_n_per_m = STIFFNESS * point.patch.area_m2 / compliance;
    // What is found deeper than work has pressed it does not push for that: it would make energy.
    let pressed_m = pressed_m(stiffness_n_per_m, work_j);
    let depth_before_m = (-below.distance_m).min(MOST_PUSH_VOXELS * voxel_m).min(pressed_m);
    let depth_predicted_m = depth_before_m - dt_s * closing;
    let [mu, of_surface] = [(point, point.patch.point.voxel), (surface, below.point.voxel)]
        .map(|(of, voxel)| of.body.material_of(voxel).friction_coefficient);
    let limit_n = (mu * of_surface).sqrt() * stiffness_n_per_m * depth_before_m.max(0.0);
    Contact {
        ends: TissueEnds { ends, patch: point.placed.patch },
        direction: below.normal,
        stiffness_n_per_m,
        share_of_compliance: 1.0 / (1.0 + STIFFNESS),
        gap_before_m: depth_before_m,
        gap_predicted_m: depth_predicted_m,
        gap_m: depth_predicted_m,
        slack_m: SLACK_VOXELS * voxel_m,
        mode: if depth_before_m > 0.0 { Mode::Spring } else { Mode::Off },
        friction: Friction::in_tissue(limit_n, velocity - below.normal * closing),
        ..Contact::default()
    }
}

impl Systems for Island<'_> {
    fn is_moot(&mut self, workers: &Workers<'_>, residual_n_s: f64) -> bool {
        let is_moot = self.may_change && self.settle(workers, Solution::Trial).norm_n_s() > residual_n_s;
        if is_moot {
            self.settle(workers, Solution::Rough);
        }
        is_moot
    }

    fn for_each(&mut self, mut visit: impl FnMut(&mut System<'_>)) {
        let id = self.id;
        self.slots.iter_mut().filter(|slot| slot.scratch.island == id).for_each(|slot| visit(&mut slot.body.system()));
    }

    fn couple(&mut self, factor: Factor) {
        for bridge in self.tissue.iter().flat_map(|tissue| &tissue.bridges) {
            let [(a, of_a), (b, of_b)] = &bridge.ends;
            let [a, b] = [*a as usize, *b as usize];
            if self.slots[a].scratch.island != self.id {
                continue;
            }
            let at_a = of_a.value(self.slots[a].body.system().factor(factor));
            let at_b = of_b.value(self.slots[b].body.system().factor(factor));
            self.slots[a].body.add_to_product(of_a, at_b);
            self.slots[b].body.add_to_product(of_b, at_a);
        }
    }
}
