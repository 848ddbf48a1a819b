//! What steps change of what a likeness has.

use super::Likeness;
use crate::body::{Body, TopologyChange};
use crate::fem::held::VoxelCorners;
use crate::grid::levels::ElementPlace;
use crate::grid::{Crossing, Ijk, Link, LinkId, VoxelId};

/// What one or several steps in which links parted have changed of a body.
#[derive(Clone, Debug, Default)]
pub(crate) struct LikenessChange {
    /// Links that parted, and where.
    pub(crate) parted: Vec<(LinkId, Crossing)>,
    /// Voxels that moved to another element; of one that is named twice the last counts.
    pub(crate) rebound: Vec<(VoxelId, u32)>,
    /// New or changed elements, ids ascending.
    pub(crate) elements: Vec<ChangedElement>,
    /// New nodes, ids ascending.
    pub(crate) nodes: Vec<(u32, Ijk)>,
}

/// An element as it is now.
#[derive(Clone, Debug)]
pub(crate) struct ChangedElement {
    pub(crate) id: u32,
    place: ElementPlace,
    held: Option<Box<VoxelCorners>>,
}

impl LikenessChange {
    /// Of a step that parted these links of a body.
    pub(crate) fn of(body: &Body, parted: &[LinkId], change: &TopologyChange) -> Self {
        let crossing = |link: &LinkId| match body.state.grid.link(*link) {
            Link::Parted(crossing) => Some((*link, crossing)),
            Link::Intact | Link::Boundary(_) | Link::Outside => None,
        };
        let element = |id: &u32| ChangedElement {
            id: *id,
            place: body.base().elements[*id as usize].place(),
            held: body.held_corners(*id as usize).cloned().map(Box::new),
        };
        Self {
            parted: parted.iter().filter_map(crossing).collect(),
            rebound: change.rebound_voxels.iter().map(|voxel| (*voxel, body.element_of(*voxel) as u32)).collect(),
            elements: change.elements.iter().map(element).collect(),
            nodes: change.split_nodes.iter().map(|(new, _)| (*new, body.base().nodes[*new as usize])).collect(),
        }
    }

    /// Goes on with what a later step has changed.
    pub(crate) fn append(&mut self, next: Self) {
        self.parted.extend(next.parted);
        self.rebound.extend(next.rebound);
        self.nodes.extend(next.nodes);
        self.elements.retain(|known| next.elements.binary_search_by_key(&known.id, |new| new.id).is_err());
        self.elements.extend(next.elements);
        self.elements.sort_by_key(|element| element.id);
    }

    /// Number of things that it names.
    pub(crate) fn len(&self) -> usize {
        self.parted.len() + self.rebound.len() + self.elements.len() + self.nodes.len()
    }
}

impl Likeness {
    /// Takes over what has changed.
    pub(crate) fn follow(&mut self, change: &LikenessChange) {
        for (link, crossing) in &change.parted {
            self.grid.part(*link, *crossing);
        }
        for (voxel, element) in &change.rebound {
            self.owner[voxel.index()] = *element;
        }
        for ChangedElement { id, place, held } in &change.elements {
            let id = *id as usize;
            if id == self.elements.len() {
                self.elements.push(*place);
                self.held.push(None);
            }
            self.elements[id] = *place;
            self.held[id].clone_from(held);
        }
        self.nodes.extend(change.nodes.iter().map(|(_, at)| *at));
    }
}
