//! A body that can be pulled: its cuts may go on by themselves, and what tension opens has to be paid for.

use crate::body::{Body, TopologyChange};
use crate::fracture::FrontBook;
use crate::fracture::tear::Tearing;
use crate::fracture::ties::Ties;
use crate::grid::{Crossing, LinkId};

/// Tearing in one body.
#[derive(Clone)]
pub(super) struct Pulled {
    tearing: Tearing,
    pub(super) ties: Ties,
}

impl Pulled {
    /// Whether there is nothing to tear and nothing tied.
    pub(super) fn is_idle(&self) -> bool {
        self.tearing.is_empty() && self.ties.contacts.is_empty()
    }

    /// From the cuts that a body has.
    pub(super) fn new(body: &Body) -> Self {
        Self { tearing: Tearing::of(body), ties: Ties::default() }
    }

    /// Concludes the step of the ties and lets cuts go on where it `looks`; `front` is what the body's blades have
    /// booked.
    pub(super) fn advance(
        &mut self,
        body: &Body,
        front: &FrontBook,
        looks: bool,
        links: &mut Vec<(LinkId, Crossing)>,
    ) -> FrontBook {
        let tied = self.ties.conclude(body);
        let torn = self.tearing.advance(body, looks, links);
        // What the blades' forces leave to the tissue.
        self.ties.owe(torn.fracture_j - front.slip_j);
        FrontBook {
            stored_j: tied.stored_j,
            fracture_j: torn.fracture_j,
            slip_j: tied.dissipated_j - torn.fracture_j,
            numerical_j: tied.numerical_j,
            area_m2: torn.area_m2,
            ..FrontBook::default()
        }
    }

    /// Follows what parted.
    pub(super) fn follow(&mut self, body: &Body, parted: &[LinkId], change: &TopologyChange) {
        self.tearing.update(body, parted);
        if !change.split_nodes.is_empty() {
            self.ties.tie(&change.split_nodes, &body.pull_n(), body.lattice_edge_m());
        }
    }
}
