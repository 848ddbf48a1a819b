//! One part of a tool in one body: what it does there depends on what it is.

use super::blade_contact::BladeContact;
use crate::body::Body;
use crate::contact::grasp::Grasp;
use crate::contact::palpation::Palpation;
use crate::contact::{Contact, Misjudged, Solution};
use crate::fracture::{Crack, FrontBook};
use crate::grid::{Crossing, LinkId};
use crate::tool::scissors::Mount;
use crate::tool::{ToolPath, ToolShape};
use crate::view::Touch;
use serde::{Deserialize, Serialize};

/// What one part of a tool does in one body.
#[derive(Clone, Serialize, Deserialize)]
pub(super) enum ToolContact {
    /// Its edges cut.
    Edges(Vec<BladeContact>),
    /// Its jaws hold.
    Grasp(Grasp),
    /// It presses.
    Palpation(Palpation),
}

impl ToolContact {
    pub(super) fn new(shape: &ToolShape, body: &Body) -> Self {
        match shape {
            ToolShape::Blade(blade) => Self::Edges(vec![BladeContact::new(blade.clone(), Mount::Fixed, body)]),
            ToolShape::Scissors(scissors) => {
                let edge = |mount| BladeContact::new(scissors.blade.clone(), mount, body);
                Self::Edges(scissors.mounts().map(edge).into())
            }
            ToolShape::Grasper(grasper) => Self::Grasp(Grasp::new(*grasper, body)),
            ToolShape::Probe(capsule) => Self::Palpation(Palpation::new(*capsule)),
        }
    }

    /// Whether it is of a tool of the same kind.
    pub(super) fn is_like(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Edges(own), Self::Edges(other)) => {
                own.len() == other.len() && own.iter().zip(other).all(|(own, other)| own.front.is_like(&other.front))
            }
            (Self::Grasp(_), Self::Grasp(_)) | (Self::Palpation(_), Self::Palpation(_)) => true,
            _ => false,
        }
    }

    fn edges(&self) -> &[BladeContact] {
        match self {
            Self::Edges(edges) => edges,
            Self::Grasp(_) | Self::Palpation(_) => &[],
        }
    }

    fn edges_mut(&mut self) -> &mut [BladeContact] {
        match self {
            Self::Edges(edges) => edges,
            Self::Grasp(_) | Self::Palpation(_) => &mut [],
        }
    }

    /// Springs that belong to no edge.
    fn other_springs(&self) -> &[Contact] {
        match self {
            Self::Edges(_) => &[],
            Self::Grasp(grasp) => &grasp.contacts,
            Self::Palpation(palpation) => &palpation.contacts,
        }
    }

    /// Every spring between the tool and the body.
    pub(super) fn springs(&self) -> impl Iterator<Item = &Contact> {
        self.edges().iter().flat_map(BladeContact::springs).chain(self.other_springs())
    }

    /// Whether it touches the body, or is about to.
    pub(super) fn has_springs(&self) -> bool {
        self.springs().next().is_some()
    }

    /// The springs go on as they are.
    pub(super) fn come_to_rest(&mut self) {
        match self {
            Self::Edges(edges) => edges.iter_mut().for_each(BladeContact::come_to_rest),
            Self::Grasp(Grasp { contacts, .. }) | Self::Palpation(Palpation { contacts, .. }) => {
                contacts.iter_mut().for_each(Contact::stay);
            }
        }
    }

    /// The springs that make up the tool's wrench: those with a force, and all that hold.
    pub(super) fn acting(&self) -> impl Iterator<Item = &Contact> {
        let holds = self.holds();
        self.springs().filter(move |c| holds || c.force_n != 0.0)
    }

    /// Work of the tool on the body in the step, J.
    pub(super) fn work_j(&self) -> f64 {
        let moved_m = |c: &Contact| c.ends.tool_point_m - c.ends.tool_point_before_m;
        self.acting().map(|c| c.applied_n().dot(&moved_m(c))).sum()
    }

    /// Those of them that hold a pose: all that depends on where the tool is rather than on how it moves.
    pub(super) fn pressing(&self) -> impl Iterator<Item = &Contact> {
        let holds = self.holds();
        let springs = self.edges().iter().flat_map(BladeContact::pressing).chain(self.other_springs());
        springs.filter(move |c| holds || c.force_n != 0.0)
    }

    /// The springs but for those of the fronts, which book their own.
    pub(super) fn beside_fronts(&self) -> impl Iterator<Item = &Contact> {
        self.edges().iter().flat_map(|edge| &edge.flanks).chain(self.other_springs())
    }

    /// Whether jaws hold some of the body.
    pub(super) fn holds(&self) -> bool {
        matches!(self, Self::Grasp(grasp) if !grasp.contacts.is_empty())
    }

    /// The blades that are in the tissue or at a wall of a cut, where the tool is.
    pub(super) fn touching<'a>(&'a self, body: &'a Body, path: ToolPath) -> impl Iterator<Item = Touch<'a>> {
        self.edges().iter().filter(|edge| edge.touches()).map(move |edge| edge.touch(body, &path))
    }

    /// Whether an edge touches the body.
    pub(super) fn has_front(&self) -> bool {
        self.edges().iter().any(|edge| !edge.front.contacts.is_empty())
    }

    /// Makes room for all that may touch until links part again.
    pub(super) fn reserve(&mut self, body: &Body) {
        let (walls, elements) = (body.boundary().walls().len(), body.base().elements.len());
        match self {
            Self::Edges(edges) => edges.iter_mut().for_each(|edge| edge.reserve(walls, elements)),
            Self::Grasp(grasp) => grasp.reserve(elements),
            Self::Palpation(palpation) => palpation.reserve(body),
        }
    }

    /// Number of markers on its edges.
    pub(super) fn markers(&self) -> usize {
        self.edges().iter().map(|edge| edge.front.markers()).sum()
    }

    /// Number of springs that there may be until links part again.
    pub(super) fn most_springs(&self, body: &Body) -> usize {
        match self {
            Self::Edges(edges) => edges.iter().map(|edge| edge.most_springs(body.boundary().walls().len())).sum(),
            Self::Grasp(grasp) => grasp.most_springs(),
            Self::Palpation(_) => Palpation::most_springs(body),
        }
    }

    /// Sets the factor on the penalties of its edges and their flanks.
    pub(super) fn scale_penalties(&mut self, factor: f64) {
        self.edges_mut().iter_mut().for_each(|edge| edge.scale_penalties(factor));
    }

    pub(super) fn lift(&mut self) {
        match self {
            Self::Edges(edges) => edges.iter_mut().for_each(BladeContact::lift),
            Self::Grasp(grasp) => grasp.let_go(),
            Self::Palpation(palpation) => palpation.clear(),
        }
    }

    pub(super) fn detect(&mut self, body: &Body, crack: &Crack, path: &ToolPath) {
        match self {
            Self::Edges(edges) => edges.iter_mut().for_each(|edge| edge.detect(body, crack, path)),
            Self::Grasp(grasp) => grasp.detect(body, path),
            Self::Palpation(palpation) => palpation.detect(body, path),
        }
    }

    /// Takes the solution's change of velocity; returns how wrong modes were.
    pub(super) fn settle(&mut self, dt_s: f64, velocity_change: &[[f64; 3]], solution: Solution) -> Misjudged {
        let mut wrong = Misjudged::default();
        match self {
            Self::Edges(edges) => {
                for edge in edges {
                    wrong += edge.settle(dt_s, velocity_change, solution);
                }
            }
            Self::Grasp(Grasp { contacts, .. }) | Self::Palpation(Palpation { contacts, .. }) => {
                for contact in contacts {
                    wrong += contact.settle(dt_s, &contact.ends.weights.sum(velocity_change), solution);
                }
            }
        }
        wrong
    }

    /// Advances the fronts of its edges; see [`crate::fracture::Front::advance`].
    pub(super) fn advance(
        &mut self,
        (body, crack): (&Body, &mut Crack),
        path: &ToolPath,
        in_tension: bool,
        parting: &mut Vec<(LinkId, Crossing)>,
    ) -> FrontBook {
        let mut book = FrontBook::default();
        self.edges_mut().iter_mut().for_each(|edge| book.add(&edge.advance((body, crack), path, in_tension, parting)));
        book
    }

    /// Samples what the strained body adds to the drive of its fronts.
    pub(super) fn sample_drive(&mut self, body: &Body) {
        self.edges_mut().iter_mut().for_each(|edge| edge.front.sample_drive(body));
    }

    /// Energy in springs of fronts that were let go since this was last asked, J.
    pub(super) fn take_dropped_j(&mut self) -> f64 {
        self.edges_mut().iter_mut().map(|edge| edge.front.take_dropped_j()).sum()
    }

    /// Length of edge that is yielding against intact material, m.
    pub(super) fn cutting_length_m(&self) -> f64 {
        self.edges().iter().map(|edge| edge.front.cutting_length_m()).sum()
    }
}
