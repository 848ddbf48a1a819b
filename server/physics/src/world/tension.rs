//! Tension in a body: its cuts may go on by themselves, and what tension opens has to be paid for.

use crate::body::{Body, TopologyChange};
use crate::fracture::cohesive::CohesiveSprings;
use crate::fracture::tear::{Tearing, Torn};
use crate::fracture::{Crack, FrontBook};
use crate::grid::{Crossing, LinkId};
use serde::{Deserialize, Serialize};

/// Tearing in one body, and the cohesive springs that pay for it.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct Tension {
    tearing: Tearing,
    pub(super) cohesive: CohesiveSprings,
}

impl Tension {
    /// Whether there is nothing to tear and no cohesive spring.
    pub(super) fn is_idle(&self) -> bool {
        self.tearing.is_empty() && self.cohesive.contacts.is_empty()
    }

    /// From the cuts that a body has.
    pub(super) fn new(body: &Body) -> Self {
        Self { tearing: Tearing::of(body), cohesive: CohesiveSprings::default() }
    }

    /// Concludes the step of the cohesive springs and lets cuts go on; `front` is what the body's blades have booked.
    /// Returns how many ends of cuts were looked at too.
    pub(super) fn advance(
        &mut self,
        (body, crack): (&Body, &mut Crack),
        front: &FrontBook,
        links: &mut Vec<(LinkId, Crossing)>,
    ) -> (FrontBook, u32) {
        let paid = self.cohesive.conclude(body);
        let Torn { cost: torn, looks } = self.tearing.advance(body, crack, links);
        // What the blades' forces leave to the tissue.
        self.cohesive.owe(torn.fracture_j - front.slip_j);
        let book = FrontBook {
            stored_j: paid.stored_j,
            fracture_j: torn.fracture_j,
            slip_j: paid.dissipated_j - torn.fracture_j,
            lost_j: paid.lost_j,
            area_m2: torn.area_m2,
            ..FrontBook::default()
        };
        (book, looks)
    }

    /// Follows what parted.
    pub(super) fn follow(&mut self, body: &Body, parted: &[LinkId], change: &TopologyChange) {
        self.tearing.update(body, parted);
        self.cohesive.join(body, &change.split_nodes);
    }
}
