//! The surfaces of a scene as viewers see them: made of its [`Structure`], which a view follows change by change, and
//! adapted to the blades of a [`Frame`].
//!
//! A view needs no world: a world that steps hands over what a step has left ([`crate::World::write_frame`],
//! [`crate::World::structure_change`]) and knows nothing of surfaces, so that another thread makes them.

mod change;
mod frame;
mod structure;

pub use change::StructureChange;
pub use frame::Frame;
pub(crate) use frame::Touch;

use crate::body::Body;
use crate::likeness::{Likeness, LikenessChange, Placed};
use crate::surface::Surface;
use crate::surface::adapt::Adaptation;
use crate::surface::delta::{AdaptedVertex, BodyStructure, Keyframe, TopologyPatch};
use crate::surface::hash::{ObjectHash, surface_hash};

/// What the objects of a scene are made of at one topology version: voxels, links, elements, nodes.
pub struct Structure {
    version: u64,
    objects: Vec<Likeness>,
}

impl Structure {
    pub(crate) fn of<'a>(bodies: impl Iterator<Item = &'a Body>, version: u64) -> Self {
        Self { version, objects: bodies.map(Likeness::of).collect() }
    }

    /// Number of things in it, as [`StructureChange::len`] counts them.
    #[must_use]
    pub fn len(&self) -> usize {
        self.objects.iter().map(Likeness::len).sum()
    }

    /// Whether there is nothing in it.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// The surfaces of a scene.
pub struct View {
    version: u64,
    objects: Vec<ObjectView>,
}

/// An object's surface and the hash of what viewers know of it.
struct ObjectView {
    likeness: Likeness,
    surface: Surface,
    hash: ObjectHash,
    /// From when a tool first touches the object.
    adaptation: Option<Adaptation>,
}

impl View {
    /// Contours every object.
    #[must_use]
    pub fn new(structure: Structure) -> Self {
        let Structure { version, objects } = structure;
        Self { version, objects: objects.into_iter().map(ObjectView::new).collect() }
    }

    /// Each object's surface.
    pub fn surfaces(&self) -> impl Iterator<Item = &Surface> {
        self.objects.iter().map(|object| &object.surface)
    }

    /// Follows a change that begins at its version, and makes a patch of it.
    pub fn follow(&mut self, change: &StructureChange) -> TopologyPatch {
        assert_eq!(change.from_version, self.version, "changes are followed in order");
        self.version = change.to_version;
        let bodies =
            self.objects.iter_mut().zip(&change.objects).map(|(object, change)| object.follow(change)).collect();
        let StructureChange { from_version, to_version, .. } = *change;
        TopologyPatch { from_version, to_version, bodies, surface_hash: self.surface_hash() }
    }

    /// Adapts the surfaces to the blades that touch them in a frame of its version.
    pub fn adapt(&mut self, frame: &Frame) {
        self.objects.iter_mut().zip(&frame.objects).for_each(|(object, at)| object.adapt(at));
    }

    /// The surfaces are where the elements have them.
    pub(crate) fn clear_adaptation(&mut self) {
        self.objects.iter_mut().filter_map(|object| object.adaptation.as_mut()).for_each(Adaptation::clear);
    }

    /// Vertices of an object's surface that are adapted to the blades that touched it in the last frame, ids ascending.
    #[must_use]
    pub fn adapted_vertices(&self, object: usize) -> &[AdaptedVertex] {
        self.objects[object].adaptation.as_ref().map_or(&[], Adaptation::offsets)
    }

    /// Displacements of an object's nodes in a frame, xyz interleaved, m, scene frame, appended to `out`.
    pub fn node_displacements_m(&self, frame: &Frame, object: usize, out: &mut Vec<f32>) {
        self.objects[object].placed(&frame.objects[object]).node_displacements_m(out);
    }

    /// The whole structure as it is now.
    #[must_use]
    pub fn keyframe(&self) -> Keyframe {
        let bodies = self.objects.iter().map(|object| structure::whole(&object.likeness, &object.surface));
        Keyframe { topology_version: self.version, bodies: bodies.collect(), surface_hash: self.surface_hash() }
    }

    /// Hash of the surfaces' structure; see [`crate::surface::hash`].
    #[must_use]
    pub fn surface_hash(&self) -> u64 {
        surface_hash(self.objects.iter().map(|object| &object.hash))
    }
}

impl ObjectView {
    fn new(likeness: Likeness) -> Self {
        let surface = Surface::build(likeness.grid());
        let mut hash = ObjectHash::default();
        hash.follow(&structure::whole(&likeness, &surface));
        Self { likeness, surface, hash, adaptation: None }
    }

    fn placed<'a>(&'a self, at: &'a frame::ObjectFrame) -> Placed<'a> {
        Placed { likeness: &self.likeness, at: &at.placement }
    }

    fn follow(&mut self, change: &LikenessChange) -> BodyStructure {
        self.likeness.follow(change);
        let patch = structure::patch(&self.likeness, &mut self.surface, change);
        self.hash.follow(&patch);
        if let Some(adaptation) = &mut self.adaptation {
            adaptation.follow(&self.surface, &patch);
        }
        patch
    }

    fn adapt(&mut self, at: &frame::ObjectFrame) {
        if at.dents().is_empty() {
            self.adaptation.iter_mut().for_each(Adaptation::clear);
            return;
        }
        let adaptation = self.adaptation.get_or_insert_with(|| {
            let mut adaptation = Adaptation::default();
            adaptation.follow(&self.surface, &structure::whole(&self.likeness, &self.surface));
            adaptation
        });
        adaptation.adapt(Placed { likeness: &self.likeness, at: &at.placement }, at.dents());
    }
}
