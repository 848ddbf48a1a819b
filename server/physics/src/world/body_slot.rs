//! A body in the world: what tools do to it in a step, and what the step does with it.

use super::activity::Activity;
use super::tension::Tension;
use super::tool_contact::ToolContact;
use crate::body::{self, Body, Lost, TopologyChange};
use crate::contact::ends::point_springs;
use crate::contact::{Contact, Misjudged, Mode, Solution};
use crate::fracture::Crack;
use crate::grid::{Crossing, LinkId};
use crate::grow::{grow, make_room};
use crate::ledger::BodyLedger;
use crate::solve::spring::{POINT_NODES, PointSpring, ROOM_FOR_SPRINGS};
use crate::tool::part::ToolPart;
use crate::walk::WalkError;
use crate::workers::Workers;
use serde::{Deserialize, Serialize};

/// Ends of cuts that a marker may make until links part: in less than a voxel's way forward, some along. Ours.
const ENDS_PER_MARKER: usize = 4;

/// A body with the step data that belongs to it.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct BodySlot {
    pub(super) body: Body,
    /// Where its cuts end.
    pub(super) crack: Crack,
    /// By part of the tools.
    pub(super) contacts: Vec<ToolContact>,
    /// Present where the body may tear.
    pub(super) tension: Option<Tension>,
    /// The solution of the last solve: the next one's guess.
    pub(super) velocity_change: body::Nodal,
    pub(super) ledger: BodyLedger,
    /// Version of its surface when its state was given out to be set, if it was since the last step.
    pub(super) edited: Option<u64>,
    pub(super) activity: Activity,
    /// Norm of the impulses that loads and contacts applied to its island in the last solve, N s.
    pub(super) applied_n_s: f64,
    /// Energy in the springs of its fronts and of its ties at the end of the last step that was taken of it, J.
    pub(super) front_stored_j: f64,
    #[serde(skip)]
    pub(super) scratch: SlotScratch,
}

/// What a step begins anew.
#[derive(Default)]
pub(super) struct SlotScratch {
    /// What contacts give the nodes, (node, N s).
    pub(super) impulses: Vec<(u32, [f64; 3])>,
    /// How many of the impulses are the tools'; they come first.
    pub(super) tool_impulses: usize,
    /// The first of the bodies that it presses on, or that press on those: they are solved as one.
    pub(super) island: usize,
    /// What brakes took of the motion of its nodes, m/s; empty where they took nothing.
    pub(super) taken_m_per_s: body::Nodal,
    /// Links that fronts have crossed.
    pub(super) parting: Vec<(LinkId, Crossing)>,
    /// Links that were parted in this step, and what that changed.
    pub(super) parted: Vec<LinkId>,
    pub(super) change: TopologyChange,
}

/// A copy begins with nothing.
impl Clone for SlotScratch {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl BodySlot {
    pub(super) fn new(mut body: Body, parts: &[ToolPart], may_tear: bool) -> Self {
        // As fine as the finest smooth part of a tool asks for.
        if let Some(radius_m) = parts.iter().filter_map(|part| part.shape.smooth_radius_m()).reduce(f64::min) {
            body.resolve_boundary(radius_m);
        }
        let contacts = parts.iter().map(|part| ToolContact::new(&part.shape, &body)).collect();
        let energy = body.energy();
        let mut slot = Self {
            velocity_change: vec![[0.0; 3]; body.node_count()],
            ledger: BodyLedger::at_rest(energy),
            body,
            crack: Crack::default(),
            contacts,
            tension: None,
            edited: None,
            activity: Activity::Awake { still_steps: 0 },
            applied_n_s: 0.0,
            front_stored_j: 0.0,
            scratch: SlotScratch::default(),
        };
        if may_tear {
            slot.feel_pull();
        }
        slot.reserve(0);
        slot
    }

    /// Completes a body that was read from a file by what never changes of one like it.
    ///
    /// # Errors
    /// What was read does not fit together, or not to the scene.
    pub(super) fn complete(&mut self, like: &Self, workers: &Workers<'_>) -> Result<(), WalkError> {
        self.body.complete(&like.body, workers)?;
        let nodes = self.body.node_count();
        let cohesive = self.tension.iter().flat_map(|tension| &tension.cohesive.contacts);
        let mut springs = self.contacts.iter().flat_map(ToolContact::springs).chain(cohesive);
        let alike = self.contacts.iter().zip(&like.contacts).all(|(own, like)| own.is_like(like));
        let fits = self.contacts.len() == like.contacts.len()
            && alike
            && self.velocity_change.len() == nodes
            && springs.all(|spring| spring.ends.weights.fits(nodes));
        if fits { Ok(()) } else { Err(WalkError::new("contacts are not of the tools and the body".into())) }
    }

    /// Room for the contacts there may be until links part again, `tissue_springs` of them with tissue, of these no more
    /// than [`ROOM_FOR_SPRINGS`]: a step in between allocates nothing.
    pub(super) fn reserve(&mut self, tissue_springs: usize) {
        self.contacts.iter_mut().for_each(|contact| contact.reserve(&self.body));
        let of_tools: usize = self.contacts.iter().map(|contact| contact.most_springs(&self.body)).sum();
        let markers: usize = self.contacts.iter().map(ToolContact::markers).sum();
        self.crack.reserve(ENDS_PER_MARKER * markers);
        let of_cohesive = self.tension.as_ref().map_or(0, |tension| tension.cohesive.count());
        let springs = of_tools + of_cohesive + tissue_springs.min(ROOM_FOR_SPRINGS);
        self.scratch.impulses.clear();
        make_room(&mut self.scratch.impulses, POINT_NODES * springs);
        self.body.reserve(springs);
    }

    pub(super) fn detect_cohesive(&mut self, dt_s: f64) {
        self.tension.iter_mut().for_each(|tension| tension.cohesive.detect(&self.body, dt_s));
    }

    /// Loads the solver with the contacts as they are now, and with what other tissue does: impulses (node, N s) and
    /// springs. Returns the norm of the impulses applied, N s.
    pub(super) fn load_system(
        &mut self,
        workers: &Workers<'_>,
        of_tissue: (impl Iterator<Item = (u32, [f64; 3])>, impl Iterator<Item = PointSpring>),
        dt_s: f64,
    ) -> f64 {
        grow(&mut self.velocity_change, self.body.node_count(), [0.0; 3]);
        self.scratch.impulses.clear();
        let of_tools = || self.contacts.iter().flat_map(ToolContact::springs);
        let cohesive = || self.tension.iter().flat_map(|tension| &tension.cohesive.contacts);
        for contact in of_tools().chain(cohesive()).filter(|c| c.mode != Mode::Off) {
            contact.add_impulses(dt_s, &mut self.scratch.impulses);
        }
        self.scratch.tool_impulses = self.scratch.impulses.len();
        self.scratch.impulses.extend(of_tissue.0);
        self.body.set_springs(point_springs(of_tools().chain(cohesive()), dt_s).chain(of_tissue.1));
        let scale = self.body.applied_impulse_norm(workers, &self.scratch.impulses);
        self.body.load_system(workers, &self.scratch.impulses, &self.velocity_change);
        scale
    }

    /// Gives the solver's operator the springs of all that presses, and those of other tissue, as tools feel them.
    pub(super) fn set_quasi_static_springs(&mut self, of_tissue: impl Iterator<Item = PointSpring>, dt_s: f64) {
        let cohesive = self.tension.iter().flat_map(|tension| &tension.cohesive.contacts);
        let pressing = self.contacts.iter().flat_map(ToolContact::pressing).chain(cohesive);
        self.body.set_springs(pressing.map(|contact| contact.quasi_static_spring(dt_s)).chain(of_tissue));
    }

    /// Whether links may part in this step.
    pub(super) fn may_part(&self) -> bool {
        let tears = self.tension.as_ref().is_some_and(|tension| !tension.is_idle());
        !self.is_asleep() && (tears || self.contacts.iter().any(ToolContact::has_front))
    }

    pub(super) fn settle_contacts(&mut self, dt_s: f64, solution: Solution) -> Misjudged {
        let mut wrong = Misjudged::default();
        for contact in &mut self.contacts {
            wrong += contact.settle(dt_s, &self.velocity_change, solution);
        }
        for spring in self.tension.iter_mut().flat_map(|tension| &mut tension.cohesive.contacts) {
            wrong += spring.settle(dt_s, &spring.ends.weights.sum(&self.velocity_change), solution);
        }
        wrong
    }

    /// A state that was set from outside is what the next step starts from and goes back to, if it is
    /// finite; cuts that were made may go on. Returns whether there are any.
    pub(super) fn take_edits(&mut self, workers: &Workers<'_>) -> bool {
        let Some(version) = self.edited.take() else { return false };
        self.wake();
        grow(&mut self.velocity_change, self.body.node_count(), [0.0; 3]);
        self.body.evaluate(workers, 20);
        if self.body.find_lost(f64::INFINITY).is_none() {
            self.body.save_state(workers);
            self.ledger.after = self.body.energy();
        }
        let is_cut = self.body.boundary().version() != version;
        if is_cut && self.tension.is_some() {
            self.feel_pull();
        }
        is_cut
    }

    /// From now on something pulls at the body: its cuts may go on by themselves, if it can be cut.
    pub(super) fn feel_pull(&mut self) {
        if self.body.description.materials.iter().any(|m| m.fracture_energy_j_per_m2.is_some()) {
            self.tension = Some(Tension::new(&self.body));
        }
    }

    /// Pieces that are lost go back to where the last step led them, at rest; tools that touch them are lifted, and
    /// what holds them together lets go.
    pub(super) fn roll_back(&mut self, workers: &Workers<'_>, lost: &Lost) {
        self.wake();
        self.body.restore_lost(workers, lost);
        let (body, velocity_change) = (&self.body, &mut self.velocity_change);
        let changes = velocity_change.iter_mut().enumerate();
        changes.filter(|(node, _)| body.is_lost_at(lost, *node as u32)).for_each(|(_, change)| *change = [0.0; 3]);
        let is_at_lost = |contact: &Contact| contact.ends.weights.iter().any(|(node, _)| body.is_lost_at(lost, node));
        self.contacts.iter_mut().filter(|c| c.springs().any(is_at_lost)).for_each(ToolContact::lift);
        let cohesive = self.tension.iter_mut().map(|tension| &mut tension.cohesive);
        cohesive.filter(|springs| springs.contacts.iter().any(is_at_lost)).for_each(|springs| springs.release());
        self.ledger = BodyLedger::at_rest(self.body.energy());
    }

    /// Work of the tools on the body in the step, J.
    pub(super) fn tool_work_j(&self) -> f64 {
        self.contacts.iter().map(ToolContact::work_j).sum()
    }
}
