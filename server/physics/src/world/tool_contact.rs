//! One tool in one body: what it does there depends on what it is.

use super::blade_contact::BladeContact;
use crate::body::Body;
use crate::contact::Contact;
use crate::contact::flank::Walls;
use crate::contact::grip::Grip;
use crate::fracture::FrontBook;
use crate::grid::{Crossing, LinkId};
use crate::hash::StateHasher;
use crate::tool::{ToolPath, ToolShape};

/// What one tool does in one body.
#[derive(Clone)]
pub(super) enum ToolContact {
    /// Its edges cut.
    Edges(Vec<BladeContact>),
    /// Its jaws hold.
    Grip(Grip),
}

impl ToolContact {
    pub(super) fn new(shape: &ToolShape, body: &Body, pulled: bool) -> Self {
        match shape {
            ToolShape::Blade(blade) => Self::Edges(vec![BladeContact::new(blade.clone(), body, pulled)]),
            ToolShape::Grasper(grasper) => Self::Grip(Grip::new(*grasper, body)),
        }
    }

    fn edges(&self) -> &[BladeContact] {
        match self {
            Self::Edges(edges) => edges,
            Self::Grip(_) => &[],
        }
    }

    fn edges_mut(&mut self) -> &mut [BladeContact] {
        match self {
            Self::Edges(edges) => edges,
            Self::Grip(_) => &mut [],
        }
    }

    /// Springs that belong to no edge.
    fn grip_springs(&self) -> &[Contact] {
        match self {
            Self::Edges(_) => &[],
            Self::Grip(grip) => &grip.contacts,
        }
    }

    /// Every spring between the tool and the body.
    pub(super) fn springs(&self) -> impl Iterator<Item = &Contact> {
        self.edges().iter().flat_map(BladeContact::springs).chain(self.grip_springs())
    }

    /// The springs that make up the tool's wrench: those with a force, and all that hold.
    pub(super) fn acting(&self) -> impl Iterator<Item = &Contact> {
        let pressing = self.edges().iter().flat_map(BladeContact::springs).filter(|c| c.force_n != 0.0);
        pressing.chain(self.grip_springs())
    }

    /// The springs but for those of the fronts, which book their own.
    pub(super) fn beside_fronts(&self) -> impl Iterator<Item = &Contact> {
        self.edges().iter().flat_map(|edge| &edge.flanks).chain(self.grip_springs())
    }

    /// Whether jaws hold some of the body.
    pub(super) fn holds(&self) -> bool {
        matches!(self, Self::Grip(grip) if !grip.contacts.is_empty())
    }

    /// Whether an edge touches the body.
    pub(super) fn has_front(&self) -> bool {
        self.edges().iter().any(|edge| !edge.front.contacts.is_empty())
    }

    /// Makes room for all that may touch until links part again. Returns the number of springs that is.
    pub(super) fn reserve(&mut self, body: &Body, walls: &Walls) -> usize {
        let elements = body.base().elements.len();
        match self {
            Self::Edges(edges) => {
                edges.iter_mut().for_each(|edge| edge.reserve(walls, elements));
                edges.iter().map(|edge| edge.front.most_springs() + walls.len()).sum()
            }
            Self::Grip(grip) => {
                grip.reserve(elements);
                grip.most_springs()
            }
        }
    }

    pub(super) fn lift(&mut self) {
        match self {
            Self::Edges(edges) => edges.iter_mut().for_each(BladeContact::lift),
            Self::Grip(grip) => grip.let_go(),
        }
    }

    pub(super) fn detect(&mut self, body: &Body, walls: &Walls, path: &ToolPath) {
        match self {
            Self::Edges(edges) => edges.iter_mut().for_each(|edge| edge.detect(body, walls, path)),
            Self::Grip(grip) => grip.detect(body, path),
        }
    }

    /// Takes the solution's change of velocity; returns whether a mode had to change.
    pub(super) fn settle(&mut self, dt_s: f64, velocity_change: &[[f64; 3]]) -> bool {
        let mut changed = false;
        match self {
            Self::Edges(edges) => {
                for edge in edges {
                    changed |= edge.settle(dt_s, velocity_change);
                }
            }
            Self::Grip(grip) => {
                for contact in &mut grip.contacts {
                    changed |= contact.settle(dt_s, velocity_change);
                }
            }
        }
        changed
    }

    /// Advances the fronts of its edges; see [`crate::fracture::Front::advance`].
    pub(super) fn advance(&mut self, body: &Body, path: &ToolPath, parting: &mut Vec<(LinkId, Crossing)>) -> FrontBook {
        let mut book = FrontBook::default();
        self.edges_mut().iter_mut().for_each(|edge| book.add(&edge.advance(body, path, parting)));
        book
    }

    /// Energy in springs of fronts that were let go since this was last asked, J.
    pub(super) fn take_dropped_j(&mut self) -> f64 {
        self.edges_mut().iter_mut().map(|edge| edge.front.take_dropped_j()).sum()
    }

    /// Length of edge that is yielding against intact material, m.
    pub(super) fn cutting_length_m(&self) -> f64 {
        self.edges().iter().map(|edge| edge.front.cutting_length_m()).sum()
    }

    /// Folds what lasts from step to step into a hash.
    pub(super) fn fold_into(&self, hasher: &mut StateHasher) {
        match self {
            Self::Edges(edges) => edges.iter().for_each(|edge| edge.front.fold_into(hasher)),
            Self::Grip(grip) => grip.fold_into(hasher),
        }
    }
}
