//! What is kept for viewers: the surfaces, and what the last step changed in the structure. It exists
//! from the first time somebody asks for a keyframe.

use crate::body::{Body, TopologyChange};
use crate::grid::LinkId;
use crate::hash::StateHasher;
use crate::surface::delta::{
    BodyStructure, BoundQuad, BoundVertex, Keyframe, LatticeElement, LatticeNode, TopologyPatch, hash_body,
};
use crate::surface::{Surface, VertexId};

/// Surfaces of every body, and the last patch.
pub(crate) struct View {
    surfaces: Vec<Surface>,
    patch: Option<TopologyPatch>,
}

impl View {
    pub(crate) fn new<'a>(bodies: impl Iterator<Item = &'a Body>) -> Self {
        Self { surfaces: bodies.map(|b| Surface::build(&b.grid)).collect(), patch: None }
    }

    pub(crate) fn surfaces(&self) -> &[Surface] {
        &self.surfaces
    }

    pub(crate) fn patch(&self) -> Option<&TopologyPatch> {
        self.patch.as_ref()
    }

    pub(crate) fn clear_patch(&mut self) {
        self.patch = None;
    }

    pub(crate) fn keyframe<'a>(&self, bodies: impl Iterator<Item = &'a Body> + Clone, version: u64) -> Keyframe {
        Keyframe {
            topology_version: version,
            bodies: bodies.clone().zip(&self.surfaces).map(|(body, surface)| whole(body, surface)).collect(),
            surface_hash: self.hash(bodies),
        }
    }

    /// Follows a step that parted `parted` links of each body and makes the patch to `version`.
    pub(crate) fn update<'a>(
        &mut self,
        bodies: impl Iterator<Item = (&'a Body, &'a [LinkId], &'a TopologyChange)> + Clone,
        version: u64,
    ) {
        let patches = bodies
            .clone()
            .zip(&mut self.surfaces)
            .map(|((body, parted, change), surface)| patch(body, surface, parted, change))
            .collect();
        self.patch = Some(TopologyPatch {
            from_version: version - 1,
            to_version: version,
            bodies: patches,
            surface_hash: self.hash(bodies.map(|b| b.0)),
        });
    }

    pub(crate) fn hash<'a>(&self, bodies: impl Iterator<Item = &'a Body>) -> u64 {
        let mut hasher = StateHasher::default();
        for (body, surface) in bodies.zip(&self.surfaces) {
            let vertices = surface.vertices().map(|(id, _)| bind(body, surface, id));
            let quads = surface.quads().map(|(id, quad)| BoundQuad { id, vertices: *quad });
            hash_body(&mut hasher, vertices, quads);
        }
        hasher.finish()
    }
}

fn bind(body: &Body, surface: &Surface, id: VertexId) -> BoundVertex {
    let vertex = surface.vertex(id).expect("the surface named this vertex");
    let element = body.element_of(vertex.voxel);
    let position = vertex.position_m.map(f64::from).into();
    BoundVertex { id, element: element as u32, local: body.local_coordinates(element, &position).map(|c| c as f32) }
}

fn node(body: &Body, id: u32) -> LatticeNode {
    LatticeNode { id, rest_m: body.rest_position_m(id as usize).map(|c| c as f32).into() }
}

fn element(body: &Body, id: u32) -> LatticeElement {
    LatticeElement { id, nodes: body.base().elements[id as usize].nodes }
}

fn whole(body: &Body, surface: &Surface) -> BodyStructure {
    BodyStructure {
        nodes: (0..body.node_count() as u32).map(|id| node(body, id)).collect(),
        elements: (0..body.base().elements.len() as u32).map(|id| element(body, id)).collect(),
        vertices: surface.vertices().map(|(id, _)| bind(body, surface, id)).collect(),
        quads: surface.quads().map(|(id, quad)| BoundQuad { id, vertices: *quad }).collect(),
        removed_vertices: Vec::new(),
        removed_quads: Vec::new(),
        node_count: body.node_count() as u32,
    }
}

fn patch(body: &Body, surface: &mut Surface, parted: &[LinkId], change: &TopologyChange) -> BodyStructure {
    let touched = surface.rebuild_touched(&body.grid, parted, &change.rebound_voxels);
    let quad = |id: &u32| BoundQuad { id: *id, vertices: *surface.quad(*id).expect("the surface named this quad") };
    BodyStructure {
        nodes: change.nodes.iter().map(|id| node(body, *id)).collect(),
        elements: change.elements.iter().map(|id| element(body, *id)).collect(),
        vertices: touched.upserted_vertices.iter().map(|id| bind(body, surface, *id)).collect(),
        quads: touched.upserted_quads.iter().map(quad).collect(),
        removed_vertices: touched.removed_vertices,
        removed_quads: touched.removed_quads,
        node_count: body.node_count() as u32,
    }
}
