//! What is kept for viewers: the surfaces, and what the last step changed in the structure. It exists
//! from when somebody asks for a keyframe until the surface is forgotten.

use crate::body::{Body, MaterialPoint, TopologyChange};
use crate::grid::LinkId;
use crate::surface::adapt::{Adaptation, Dent};
use crate::surface::delta::{
    AdaptedVertex, BodyStructure, BoundQuad, BoundVertex, HeldVertex, Keyframe, LatticeElement, LatticeNode,
    TopologyPatch,
};
use crate::surface::hash::{ObjectHash, surface_hash};
use crate::surface::{Surface, VertexId};
use crate::tool::Pose;
use crate::tool::blade::Blade;

/// What every object shows, and the last patch.
pub(crate) struct View {
    objects: Vec<ObjectView>,
    patch: Option<TopologyPatch>,
    /// The tools that touch an object.
    dents: Vec<Dent>,
    /// The surfaces are adapted to where the tools are now.
    is_adapted: bool,
}

/// A tool that touches an object.
pub(crate) struct Touch<'a> {
    pub(crate) blade: &'a Blade,
    pub(crate) pose: Pose,
    /// How far the edge has gone past the points it presses on, at most, m.
    pub(crate) depth_m: f64,
}

/// An object's surface and the hash of what viewers know of it.
struct ObjectView {
    surface: Surface,
    hash: ObjectHash,
    /// From when a tool first touches the object.
    adaptation: Option<Adaptation>,
}

impl View {
    pub(crate) fn new<'a>(bodies: impl Iterator<Item = &'a Body>) -> Self {
        Self { objects: bodies.map(ObjectView::new).collect(), patch: None, dents: Vec::new(), is_adapted: false }
    }

    pub(crate) fn surfaces(&self) -> impl Iterator<Item = &Surface> {
        self.objects.iter().map(|object| &object.surface)
    }

    pub(crate) fn patch(&self) -> Option<&TopologyPatch> {
        self.patch.as_ref()
    }

    /// Forgets what the last step changed, and where the surface was adapted to it.
    pub(crate) fn begin_step(&mut self) {
        self.patch = None;
        self.is_adapted = false;
        self.objects.iter_mut().filter_map(|object| object.adaptation.as_mut()).for_each(Adaptation::clear);
    }

    /// Whether the surface is adapted already since the step began.
    pub(crate) fn is_adapted(&self) -> bool {
        self.is_adapted
    }

    /// Adapts an object's surface to the blades that touch it.
    pub(crate) fn adapt<'a>(&mut self, object: usize, body: &Body, touches: impl Iterator<Item = Touch<'a>>) {
        let mut count = 0;
        for touch in touches {
            if self.dents.len() == count {
                self.dents.push(Dent::default());
            }
            let dent = &mut self.dents[count];
            dent.blade.place(touch.blade, &touch.pose);
            dent.depth_m = touch.depth_m;
            count += 1;
        }
        self.objects[object].adapt(body, &self.dents[..count]);
        self.is_adapted = true;
    }

    pub(crate) fn adapted(&self, object: usize) -> &[AdaptedVertex] {
        self.objects[object].adaptation.as_ref().map_or(&[], Adaptation::offsets)
    }

    pub(crate) fn keyframe<'a>(&self, bodies: impl Iterator<Item = &'a Body>, version: u64) -> Keyframe {
        Keyframe {
            topology_version: version,
            bodies: bodies.zip(self.surfaces()).map(|(body, surface)| whole(body, surface)).collect(),
            surface_hash: self.hash(),
        }
    }

    /// Follows a step that parted `parted` links of each body and makes the patch to `version`.
    pub(crate) fn update<'a>(
        &mut self,
        bodies: impl Iterator<Item = (&'a Body, &'a [LinkId], &'a TopologyChange)>,
        version: u64,
    ) {
        let objects = self.objects.iter_mut();
        let patches =
            bodies.zip(objects).map(|((body, parted, change), object)| object.update(body, parted, change)).collect();
        self.patch = Some(TopologyPatch {
            from_version: version - 1,
            to_version: version,
            bodies: patches,
            surface_hash: self.hash(),
        });
    }

    pub(crate) fn hash(&self) -> u64 {
        surface_hash(self.objects.iter().map(|object| &object.hash))
    }
}

impl ObjectView {
    fn new(body: &Body) -> Self {
        let surface = Surface::build(&body.state.grid);
        let mut hash = ObjectHash::default();
        hash.follow(&whole(body, &surface));
        Self { surface, hash, adaptation: None }
    }

    fn update(&mut self, body: &Body, parted: &[LinkId], change: &TopologyChange) -> BodyStructure {
        let patch = patch(body, &mut self.surface, parted, change);
        self.hash.follow(&patch);
        if let Some(adaptation) = &mut self.adaptation {
            adaptation.follow(&self.surface, &patch);
        }
        patch
    }

    fn adapt(&mut self, body: &Body, dents: &[Dent]) {
        let adaptation = self.adaptation.get_or_insert_with(|| {
            let mut adaptation = Adaptation::default();
            adaptation.follow(&self.surface, &whole(body, &self.surface));
            adaptation
        });
        adaptation.adapt(body, dents);
    }
}

fn bind(body: &Body, surface: &Surface, id: VertexId) -> BoundVertex {
    let vertex = surface.vertex(id).expect("the surface named this vertex");
    let element = body.element_of(vertex.voxel);
    let position = vertex.position_m.map(f64::from).into();
    let local = body.local_coordinates(element, &position).map(|c| c as f32);
    let material = body.state.grid.voxels()[vertex.voxel.index()].material;
    BoundVertex { id, element: element as u32, local, material }
}

/// Those among `ids` that lie in elements of which something is held.
fn held(body: &Body, surface: &Surface, ids: impl Iterator<Item = VertexId>) -> Vec<HeldVertex> {
    let weights = |id: VertexId| {
        let vertex = surface.vertex(id).expect("the surface named this vertex");
        let point = MaterialPoint { position_m: vertex.position_m.map(f64::from).into(), voxel: vertex.voxel };
        let is_held = body.is_held(body.element_of(vertex.voxel));
        is_held.then(|| HeldVertex { id, weights: body.weights(&point).weights.map(|w| w as f32) })
    };
    ids.filter_map(weights).collect()
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
        held: held(body, surface, surface.vertices().map(|(id, _)| id)),
        quads: surface.quads().map(|(id, quad)| BoundQuad { id, vertices: *quad }).collect(),
        node_count: body.node_count() as u32,
    }
}

fn patch(body: &Body, surface: &mut Surface, parted: &[LinkId], change: &TopologyChange) -> BodyStructure {
    let touched = surface.rebuild_touched(&body.state.grid, parted, &change.rebound_voxels);
    let quad = |id: &u32| BoundQuad { id: *id, vertices: *surface.quad(*id).expect("the surface named this quad") };
    BodyStructure {
        nodes: change.split_nodes.iter().map(|(new, _)| node(body, *new)).collect(),
        elements: change.elements.iter().map(|id| element(body, *id)).collect(),
        vertices: touched.upserted_vertices.iter().map(|id| bind(body, surface, *id)).collect(),
        held: held(body, surface, touched.upserted_vertices.iter().copied()),
        quads: touched.upserted_quads.iter().map(quad).collect(),
        node_count: body.node_count() as u32,
    }
}
