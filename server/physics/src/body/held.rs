//! What of the body is held, element by element.

use super::Body;
use super::loads::Hold;
use crate::Vec3;
use crate::fem::held::{Corner, HeldVoxel, VoxelCorners, hold};
use crate::fem::matrices::ElementMatrices;
use crate::grid::levels::Level;
use crate::grid::{Grid, Ijk, VoxelId};
use crate::grow::grow;
use crate::math::Aabb;
use crate::solve::assembly::CHUNK_ELEMENTS;
use serde::{Deserialize, Serialize};

/// Elements that touch what is held.
#[derive(Clone, Default, Serialize, Deserialize)]
pub(super) struct HeldElements {
    /// Ascending.
    elements: Vec<u32>,
    /// By element; present in those.
    corners: Vec<Option<Box<VoxelCorners>>>,
    /// By element; its nodes that would stand still, if elements around them agreed.
    nodes: Vec<Option<u8>>,
    /// Around their cells at rest, by chunk of elements, m.
    boxes: Vec<Aabb>,
}

impl HeldElements {
    pub(super) fn elements(&self) -> &[u32] {
        &self.elements
    }

    /// The corners of an element's voxels, if it is held.
    pub(super) fn corners(&self, element: usize) -> Option<&VoxelCorners> {
        self.corners[element].as_deref()
    }

    /// Boxes around what of each chunk of elements is held, m, scene frame; empty where nothing is.
    pub(super) fn boxes(&self) -> &[Aabb] {
        &self.boxes
    }

    /// Whether they are of the elements of a level.
    pub(super) fn fits(&self, level: &Level) -> bool {
        let elements = level.elements.len();
        let lengths = [self.corners.len(), self.nodes.len()] == [elements; 2];
        let chunks = self.boxes.len() == elements.div_ceil(CHUNK_ELEMENTS);
        let told = self.corners.iter().zip(0..).filter_map(|(corners, element)| corners.as_ref().map(|_| element));
        let is_of = |element: usize| self.corners(element).is_some_and(|c| c.fits(level.exponent_of(element)));
        lengths
            && chunks
            && told.eq(self.elements.iter().copied())
            && self.elements.iter().all(|element| is_of(*element as usize))
    }

    pub(super) fn resize(&mut self, elements: usize) {
        self.corners.resize_with(elements, || None);
        grow(&mut self.nodes, elements, None);
    }

    fn set(&mut self, element: usize, corners: Option<Box<VoxelCorners>>, nodes: Option<u8>) {
        let found = self.elements.binary_search(&(element as u32));
        match (found, corners.is_some()) {
            (Err(at), true) => self.elements.insert(at, element as u32),
            (Ok(at), false) => {
                self.elements.remove(at);
            }
            _ => {}
        }
        self.corners[element] = corners;
        self.nodes[element] = nodes;
    }
}

impl Body {
    /// Whether something of an element is held.
    #[must_use]
    pub(crate) fn is_held(&self, element: usize) -> bool {
        self.state.held.corners(element).is_some()
    }

    /// Whether anything of it is held.
    pub(crate) fn is_anything_held(&self) -> bool {
        !self.state.held.elements().is_empty()
    }

    /// The corners of an element's voxels, if something of it is held.
    pub(crate) fn held_corners(&self, element: usize) -> Option<&VoxelCorners> {
        self.state.held.corners(element)
    }

    /// Finds out what of `elements` is held, and which nodes around them stand still; returns the elements that are held
    /// otherwise than before, ascending.
    pub(super) fn find_held(&mut self, elements: &[u32]) -> Vec<u32> {
        let mut changed = elements.to_vec();
        changed.retain(|element| self.find_held_corners(*element as usize));
        let around = self.held_around(elements);
        changed.extend(around.into_iter().filter(|element| self.find_still_nodes(*element as usize)));
        changed.sort_unstable();
        changed.dedup();
        changed
    }

    /// Finds out what of an element is held; returns whether that changed.
    fn find_held_corners(&mut self, element: usize) -> bool {
        let voxels = self.voxels_of(element);
        let mut corners = self.voxel_corners(element, &voxels);
        let before = self.state.held.corners(element);
        if let (Some(corners), Some(before)) = (&mut corners, before) {
            corners.set_nodes(before.still(), before.lone());
        }
        let changed = corners.as_deref() != before;
        let nodes = corners.as_ref().and_then(|corners| {
            let low = self.first_voxel_of(element);
            corners.held_nodes(voxels.iter().map(|voxel| from(self.state.grid.voxels()[voxel.index()].ijk, low)))
        });
        self.state.held.set(element, corners, nodes);
        changed
    }

    /// Finds out which nodes of an element stand still, those that every element around them is to be held at, and which no
    /// other element has. Returns whether that changed.
    fn find_still_nodes(&mut self, element: usize) -> bool {
        let nodes = self.base().elements[element].nodes;
        let (mut still, mut lone) = (0, 0);
        for (a, node) in nodes.into_iter().enumerate() {
            let around = self.elements_at(self.base().nodes[node as usize]);
            still |= u8::from(self.stands_still(node, &around)) << a;
            lone |= u8::from(self.is_lone(element, node, &around)) << a;
        }
        let corners = self.state.held.corners[element].as_deref_mut().expect("it is held");
        let changed = (corners.still(), corners.lone()) != (still, lone);
        corners.set_nodes(still, lone);
        changed
    }

    /// Whether no element but this one has a node, of those around it.
    fn is_lone(&self, element: usize, node: u32, around: &[u32]) -> bool {
        let mut others = around.iter().filter(|e| **e as usize != element);
        others.all(|e| !self.base().elements[*e as usize].nodes.contains(&node))
    }

    /// Whether every element around a node is to be held at it.
    fn stands_still(&self, node: u32, around: &[u32]) -> bool {
        let base = self.base();
        // Where small elements meet large ones nodes go where others take them.
        let alike = around.iter().all(|e| base.elements[*e as usize].size == base.elements[around[0] as usize].size);
        alike
            && around.iter().all(|e| {
                let Some(corner) = base.elements[*e as usize].nodes.iter().position(|n| *n == node) else {
                    return true;
                };
                self.state.held.nodes[*e as usize].is_some_and(|nodes| nodes >> corner & 1 == 1)
            })
    }

    /// The corners of an element's voxels; `None` where none is held.
    fn voxel_corners(&self, element: usize, voxels: &[VoxelId]) -> Option<Box<VoxelCorners>> {
        let is_beside = |voxel: &&VoxelId| self.description.holds[voxel.index()] >= Hold::Beside;
        if !voxels.iter().any(|voxel| is_beside(&voxel)) {
            return None;
        }
        let low = self.first_voxel_of(element);
        let mut corners = VoxelCorners::new(self.element_level(element));
        for voxel in voxels {
            let cell = self.state.grid.voxels()[voxel.index()].ijk;
            for corner in self.shared_corners(element, cell) {
                corners.set(from(corner, low), Corner::Shared);
            }
        }
        let mut seen = vec![false; corners.len()];
        for voxel in voxels.iter().filter(is_beside) {
            let cell = self.state.grid.voxels()[voxel.index()].ijk;
            for corner in (0..8).map(|c| [0, 1, 2].map(|a| cell[a] + (c >> a & 1))) {
                let at = from(corner, low);
                if !std::mem::replace(&mut seen[corners.index(at)], true) && self.is_held_at(element, corner) {
                    corners.set(at, Corner::Held);
                }
            }
        }
        corners.any_held().then(|| Box::new(corners))
    }

    /// Corners of a voxel of `element` that voxels of other elements have too, across intact links.
    fn shared_corners(&self, element: usize, cell: Ijk) -> impl Iterator<Item = Ijk> + '_ {
        let across = Grid::links_of(cell).enumerate().filter(move |(_, (link, other))| {
            let beyond = self.state.grid.voxel_at(*other).filter(|_| self.state.grid.is_intact(*link));
            beyond.is_some_and(|voxel| self.element_of(voxel) != element)
        });
        across.flat_map(move |(face, _)| {
            let (axis, side) = (face / 2, face % 2);
            (0..8).filter(move |c| c >> axis & 1 == side).map(move |c| [0, 1, 2].map(|a| cell[a] + (c as i32 >> a & 1)))
        })
    }

    /// Whether a corner of voxels of `element`, in voxels, is one of a held voxel: of the element itself, or of
    /// those that it is linked to around the corner.
    fn is_held_at(&self, element: usize, corner: Ijk) -> bool {
        let is_held = |voxel: &VoxelId| self.description.holds[voxel.index()] == Hold::Held;
        let held = |cell: Ijk| self.state.grid.voxel_at(cell).filter(is_held);
        let owners: Vec<u32> =
            cells_around(corner).filter_map(held).map(|voxel| self.base().owner[voxel.index()]).collect();
        if owners.is_empty() || owners.contains(&(element as u32)) {
            return !owners.is_empty();
        }
        let neighbours =
            |element: u32| self.base().elements[element as usize].neighbours.iter().map(|(_, other)| *other);
        let is_beside_owner = |element: u32| neighbours(element).any(|other| owners.contains(&other));
        // For most corners that is all there is to find out.
        if is_beside_owner(element as u32) {
            return true;
        }
        let around = self.base().elements_beside(cells_around(corner));
        let mut linked = vec![element as u32];
        let mut next = 0;
        while next < linked.len() {
            for other in neighbours(linked[next]).filter(|other| around.contains(other)) {
                if !linked.contains(&other) {
                    if is_beside_owner(other) {
                        return true;
                    }
                    linked.push(other);
                }
            }
            next += 1;
        }
        false
    }

    /// The matrices of an element as its voxels are held.
    pub(super) fn held_matrices(&self, element: usize, voxels: &[VoxelId], plain: ElementMatrices) -> ElementMatrices {
        let Some(corners) = self.state.held.corners(element) else { return plain };
        let low = self.first_voxel_of(element);
        let most_pa = self.most_shear_modulus_pa(voxels.iter().map(|v| self.state.grid.voxels()[v.index()].material));
        let free = voxels.iter().filter(|voxel| self.description.holds[voxel.index()] != Hold::Held);
        let voxels: Vec<HeldVoxel> = free
            .map(|voxel| HeldVoxel {
                at: from(self.state.grid.voxels()[voxel.index()].ijk, low),
                elastic: self.material_of(*voxel).elastic.at_most(most_pa),
                share: self.state.grid.filled_share(*voxel),
            })
            .collect();
        hold(&plain, corners, &voxels, &self.description.single_voxel)
    }

    /// Elements of the cells around a place of nodes.
    fn elements_at(&self, place: Ijk) -> Vec<u32> {
        self.base().elements_beside(cells_around(place.map(|x| x << self.base().exponent)))
    }

    /// Elements that are held around the nodes of `elements`, ascending.
    fn held_around(&self, elements: &[u32]) -> Vec<u32> {
        let nodes = elements.iter().flat_map(|element| self.base().elements[*element as usize].nodes);
        let mut places: Vec<Ijk> = nodes.map(|node| self.base().nodes[node as usize]).collect();
        places.sort_unstable();
        places.dedup();
        let mut around: Vec<u32> = places.into_iter().flat_map(|place| self.elements_at(place)).collect();
        around.retain(|element| self.is_held(*element as usize));
        around.sort_unstable();
        around.dedup();
        around
    }

    /// Elements that are held in or beside cells, ascending.
    pub(super) fn held_beside(&self, cells: &[Ijk]) -> Vec<u32> {
        let touches = |element: &u32| {
            let data = &self.base().elements[*element as usize];
            cells.iter().any(|cell| {
                let size = self.base().sizes().at(*cell).unwrap_or(1);
                (0..3).all(|a| cell[a] <= data.cell[a] + data.size && data.cell[a] <= cell[a] + size)
            })
        };
        self.state.held.elements().iter().copied().filter(touches).collect()
    }

    /// Makes the boxes around what of each chunk of elements is held.
    pub(super) fn bound_held(&mut self) {
        let empty = Aabb::around([]);
        let mut boxes = vec![empty; self.state.chunks.len()];
        for element in self.state.held.elements.iter().map(|element| *element as usize) {
            let chunk = &mut boxes[element / CHUNK_ELEMENTS];
            *chunk = chunk.with(&Aabb::around(self.cell_corners_m(element)));
        }
        self.state.held.boxes = boxes;
    }

    /// Lower corner of an element's cell, in voxels.
    pub(super) fn first_voxel_of(&self, element: usize) -> Ijk {
        self.base().elements[element].cell.map(|c| c << self.base().exponent)
    }

    /// A box around where an element is.
    pub(crate) fn element_box(&self, element: usize) -> Aabb {
        let nodes = self.base().elements[element].nodes;
        let at = nodes.iter().map(|node| Vec3::from(self.state.position_m[*node as usize]));
        // What is held is where it was, whatever the nodes around it do.
        Aabb::around(at.chain(self.state.held.corners(element).into_iter().flat_map(|_| self.cell_corners_m(element))))
    }

    /// Corners of an element's cell at rest, m.
    pub(super) fn cell_corners_m(&self, element: usize) -> [Vec3; 8] {
        self.base().elements[element].nodes.map(|node| self.rest_position_m(node as usize))
    }
}

/// The eight voxels around a corner.
fn cells_around(corner: Ijk) -> impl Iterator<Item = Ijk> + Clone {
    (0..8).map(move |c| [0, 1, 2].map(|a| corner[a] - (c >> a & 1)))
}

/// A place in voxels from another.
pub(super) fn from(at: Ijk, low: Ijk) -> Ijk {
    [0, 1, 2].map(|a| at[a] - low[a])
}
