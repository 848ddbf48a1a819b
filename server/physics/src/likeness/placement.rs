//! Where a frame has a body.

use super::Likeness;
use crate::Vec3;
use crate::body::{Body, PointWeights};
use crate::grid::MaterialPoint;
use crate::math::{Aabb, Nodal};
use crate::solve::assembly::CHUNK_ELEMENTS;

/// Where the nodes of a body are.
#[derive(Clone, Debug, Default)]
pub(crate) struct Placement {
    /// By node, m, scene frame.
    position_m: Nodal,
    /// Boxes around chunks of elements, m, scene frame.
    chunk_boxes: Vec<Aabb>,
}

impl Placement {
    /// Takes over where a body is; allocates nothing unless it has grown.
    pub(crate) fn write(&mut self, body: &Body) {
        self.position_m.clone_from(&body.state.position_m);
        self.chunk_boxes.clear();
        self.chunk_boxes.extend(body.chunk_boxes());
    }
}

/// A body at its place.
#[derive(Clone, Copy)]
pub(crate) struct Placed<'a> {
    pub(crate) likeness: &'a Likeness,
    pub(crate) at: &'a Placement,
}

impl<'a> Placed<'a> {
    /// Edge of a voxel, m.
    pub(crate) fn voxel_size_m(&self) -> f64 {
        self.likeness.grid.voxel_size_m()
    }

    /// What moves a material point.
    pub(crate) fn weights(&self, point: &MaterialPoint) -> PointWeights {
        self.likeness.weights(point)
    }

    /// Scene position of a material point, m.
    pub(crate) fn current_m(&self, point: &MaterialPoint) -> Vec3 {
        self.weights(point).place_m(&self.at.position_m)
    }

    /// A box around where an element is, what is held of it included.
    pub(crate) fn element_box(&self, element: usize) -> Aabb {
        let nodes = self.likeness.elements[element].nodes.iter();
        let at = nodes.map(|node| Vec3::from(self.at.position_m[*node as usize]));
        let held = self.likeness.held[element].iter().flat_map(|_| self.likeness.cell_corners_m(element));
        Aabb::around(at.chain(held))
    }

    /// Elements whose boxes may meet `near`, ascending: those of the chunks whose boxes do.
    pub(crate) fn elements_near(&self, near: &Aabb) -> impl Iterator<Item = usize> + use<'a> {
        let (near, elements) = (*near, self.likeness.elements.len());
        let met = self.at.chunk_boxes.iter().enumerate().filter(move |(_, bounds)| near.meets(bounds));
        met.flat_map(move |(index, _)| index * CHUNK_ELEMENTS..elements.min((index + 1) * CHUNK_ELEMENTS))
    }

    /// Displacements of the nodes, xyz interleaved, m, scene frame, appended to `out`.
    pub(crate) fn node_displacements_m(&self, out: &mut Vec<f32>) {
        for (node, x) in self.at.position_m.iter().enumerate() {
            let rest = self.likeness.rest_position_m(node);
            out.extend((0..3).map(|i| (x[i] - rest[i]) as f32));
        }
    }
}

impl Likeness {
    /// What moves a material point.
    pub(crate) fn weights(&self, point: &MaterialPoint) -> PointWeights {
        let MaterialPoint { position_m, voxel } = point;
        let element = self.element_of(*voxel);
        let (nodes, local) = (self.elements[element].nodes, self.local_coordinates(element, position_m));
        let Some(corners) = &self.held[element] else { return PointWeights::in_element(nodes, local) };
        let weights = corners.weights(self.voxel_in_cell(element, *voxel), local);
        PointWeights::beside_held(nodes, weights, &self.cell_corners_m(element), position_m)
    }
}
