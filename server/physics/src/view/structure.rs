//! Structure as viewers are told of it.

use crate::grid::{LinkId, MaterialPoint, VoxelId};
use crate::likeness::{Likeness, LikenessChange};
use crate::surface::delta::{BodyStructure, BoundQuad, BoundVertex, HeldVertex, LatticeElement, LatticeNode};
use crate::surface::{Surface, VertexId};

/// The whole of an object.
pub(super) fn whole(object: &Likeness, surface: &Surface) -> BodyStructure {
    BodyStructure {
        nodes: (0..object.node_count() as u32).map(|id| node(object, id)).collect(),
        elements: (0..object.elements().len() as u32).map(|id| element(object, id)).collect(),
        vertices: surface.vertices().map(|(id, _)| bind(object, surface, id)).collect(),
        held: held(object, surface, surface.vertices().map(|(id, _)| id)),
        quads: surface.quads().map(|(id, quad)| BoundQuad { id, vertices: *quad }).collect(),
        node_count: object.node_count() as u32,
    }
}

/// Brings an object's surface up to date after a change that the object has followed; what that changes of it.
pub(super) fn patch(object: &Likeness, surface: &mut Surface, change: &LikenessChange) -> BodyStructure {
    let parted: Vec<LinkId> = change.parted.iter().map(|(link, _)| *link).collect();
    let rebound: Vec<VoxelId> = change.rebound.iter().map(|(voxel, _)| *voxel).collect();
    let touched = surface.rebuild_touched(object.grid(), &parted, &rebound);
    let quad = |id: &u32| BoundQuad { id: *id, vertices: *surface.quad(*id).expect("the surface named this quad") };
    BodyStructure {
        nodes: change.nodes.iter().map(|(id, _)| node(object, *id)).collect(),
        elements: change.elements.iter().map(|changed| element(object, changed.id)).collect(),
        vertices: touched.upserted_vertices.iter().map(|id| bind(object, surface, *id)).collect(),
        held: held(object, surface, touched.upserted_vertices.iter().copied()),
        quads: touched.upserted_quads.iter().map(quad).collect(),
        node_count: object.node_count() as u32,
    }
}

fn bind(object: &Likeness, surface: &Surface, id: VertexId) -> BoundVertex {
    let vertex = surface.vertex(id).expect("the surface named this vertex");
    let element = object.element_of(vertex.voxel);
    let position = vertex.position_m.map(f64::from).into();
    let local = object.local_coordinates(element, &position).map(|c| c as f32);
    let material = object.grid().voxels()[vertex.voxel.index()].material;
    BoundVertex { id, element: element as u32, local, material }
}

/// Those among `ids` that lie in elements of which something is held.
fn held(object: &Likeness, surface: &Surface, ids: impl Iterator<Item = VertexId>) -> Vec<HeldVertex> {
    let weights = |id: VertexId| {
        let vertex = surface.vertex(id).expect("the surface named this vertex");
        let point = MaterialPoint { position_m: vertex.position_m.map(f64::from).into(), voxel: vertex.voxel };
        let is_held = object.is_held(object.element_of(vertex.voxel));
        is_held.then(|| HeldVertex { id, weights: object.weights(&point).weights.map(|w| w as f32) })
    };
    ids.filter_map(weights).collect()
}

fn node(object: &Likeness, id: u32) -> LatticeNode {
    LatticeNode { id, rest_m: object.rest_position_m(id as usize).map(|c| c as f32).into() }
}

fn element(object: &Likeness, id: u32) -> LatticeElement {
    LatticeElement { id, nodes: object.elements()[id as usize].nodes }
}
