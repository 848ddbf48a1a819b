//! A body as far as those who look at it need it: a copy of its own, which follows it by what its steps change.
//!
//! Whoever has it needs no body, so that surfaces are made, adapted and told on other threads than those that step.

mod change;
mod placement;

pub(crate) use change::LikenessChange;
pub(crate) use placement::{Placed, Placement};

use std::sync::Arc;

use crate::Vec3;
use crate::body::{Body, Description, Material};
use crate::fem::held::VoxelCorners;
use crate::grid::levels::ElementPlace;
use crate::grid::{Grid, Ijk, VoxelId};

/// What an object's surface is made of and bound to: voxels and links, elements and nodes, and what is held.
pub(crate) struct Likeness {
    description: Arc<Description>,
    grid: Grid,
    /// log2 of the smallest elements' edge in voxels.
    exponent: u8,
    /// By element.
    elements: Vec<ElementPlace>,
    /// By element: the corners of its voxels, where something of it is held.
    held: Vec<Option<Box<VoxelCorners>>>,
    /// Place of each node in the lattice.
    nodes: Vec<Ijk>,
    /// Element of each voxel.
    owner: Vec<u32>,
}

impl Likeness {
    pub(crate) fn of(body: &Body) -> Self {
        let elements = 0..body.base().elements.len();
        Self {
            description: Arc::clone(&body.description),
            grid: body.state.grid.clone(),
            exponent: body.base().exponent,
            elements: body.base().elements.iter().map(|element| element.place()).collect(),
            held: elements.map(|element| body.held_corners(element).cloned().map(Box::new)).collect(),
            nodes: body.base().nodes.clone(),
            owner: body.base().owner.clone(),
        }
    }

    /// Voxels, and the links between them.
    pub(crate) fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Every element, by id.
    pub(crate) fn elements(&self) -> &[ElementPlace] {
        &self.elements
    }

    /// Number of things that it names, as [`LikenessChange::len`] counts them.
    pub(crate) fn len(&self) -> usize {
        self.grid.voxels().len() + self.elements.len() + self.nodes.len()
    }

    /// Number of nodes.
    pub(crate) fn node_count(&self) -> usize {
        self.nodes.len()
    }

    /// Edge of the smallest elements, m.
    fn lattice_edge_m(&self) -> f64 {
        self.grid.voxel_size_m() * f64::from(1u32 << self.exponent)
    }

    /// Reference position of a node, m.
    pub(crate) fn rest_position_m(&self, node: usize) -> Vec3 {
        let edge_m = self.lattice_edge_m();
        self.grid.origin_m() + Vec3::from(self.nodes[node].map(|c| f64::from(c) * edge_m))
    }

    /// Element of a voxel.
    pub(crate) fn element_of(&self, voxel: VoxelId) -> usize {
        self.owner[voxel.index()] as usize
    }

    /// Edge of an element, m.
    pub(crate) fn element_edge_m(&self, element: usize) -> f64 {
        f64::from(self.elements[element].size) * self.lattice_edge_m()
    }

    /// Coordinates of a reference position in the cell of an element; 0..=1 inside it.
    pub(crate) fn local_coordinates(&self, element: usize, position_m: &Vec3) -> [f64; 3] {
        self.elements[element].local_coordinates(&((position_m - self.grid.origin_m()) / self.lattice_edge_m()))
    }

    /// Material of a voxel.
    pub(crate) fn material_of(&self, voxel: VoxelId) -> &Material {
        &self.description.materials[self.grid.voxels()[voxel.index()].material as usize]
    }

    /// Whether something of an element is held.
    pub(crate) fn is_held(&self, element: usize) -> bool {
        self.held[element].is_some()
    }

    /// Corners of an element's cell at rest, m.
    fn cell_corners_m(&self, element: usize) -> [Vec3; 8] {
        self.elements[element].nodes.map(|node| self.rest_position_m(node as usize))
    }

    /// Place of a voxel in the cell of its element, in voxels.
    fn voxel_in_cell(&self, element: usize, voxel: VoxelId) -> Ijk {
        let (at, cell) = (self.grid.voxels()[voxel.index()].ijk, self.elements[element].cell);
        [0, 1, 2].map(|a| at[a] - (cell[a] << self.exponent))
    }
}
