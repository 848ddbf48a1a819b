//! What a world hands over to those who show it, and the view that it keeps itself for callers without one.

use super::World;
use super::body_slot::BodySlot;
use super::own_view::OwnView;
use super::scratch::Scratch;
use super::state::State;
use super::tool::Tool;
use crate::body::Body;
use crate::likeness::LikenessChange;
use crate::stage::{Lap, Stage, StageClock};
use crate::surface::Surface;
use crate::surface::delta::{AdaptedVertex, Keyframe, TopologyPatch};
use crate::view::{Frame, Structure, StructureChange, Touch, View};

/// The blades that touch a body.
fn touches<'a>(slot: &'a BodySlot, tools: &'a [Tool]) -> impl Iterator<Item = Touch<'a>> {
    let placed = tools.iter().zip(&slot.contacts);
    placed.filter_map(|(tool, contact)| Some(contact.touching(&slot.body, tool.path()?))).flatten()
}

impl State {
    fn structure(&self) -> Structure {
        Structure::of(self.bodies(), self.topology_version)
    }

    fn structure_change(&self) -> Option<StructureChange> {
        let object = |slot: &BodySlot| LikenessChange::of(&slot.body, &slot.scratch.parted, &slot.scratch.change);
        let has_parted = self.slots.iter().any(|slot| !slot.scratch.parted.is_empty());
        has_parted.then(|| StructureChange {
            from_version: self.topology_version - 1,
            to_version: self.topology_version,
            objects: self.slots.iter().map(object).collect(),
        })
    }

    fn write_frame(&self, frame: &mut Frame) {
        frame.objects.resize_with(self.slots.len(), Default::default);
        for (object, slot) in frame.objects.iter_mut().zip(&self.slots) {
            object.write(&slot.body, touches(slot, &self.tools));
        }
    }

    fn is_touched(&self) -> bool {
        self.slots.iter().any(|slot| touches(slot, &self.tools).next().is_some())
    }
}

/// What viewers see of links that have parted, where there are any.
pub(super) fn follow(state: &State, scratch: &mut Scratch) {
    if let Some((own, change)) = scratch.view.as_mut().zip(state.structure_change()) {
        own.patch = Some(own.view.follow(&change));
    }
}

impl World {
    /// What the objects are made of as the last step left them, for a [`View`] to begin with: a copy of their voxels,
    /// links, elements and nodes.
    #[must_use]
    pub fn structure(&self) -> Structure {
        self.state.structure()
    }

    /// What the last step changed of that; `None` where no link parted in it.
    #[must_use]
    pub fn structure_change(&self) -> Option<StructureChange> {
        self.state.structure_change()
    }

    /// Writes into `frame` where the last step has left the objects, and the blades that touch them: a copy of their
    /// nodes' positions. A frame that is used again allocates nothing, unless objects have grown.
    pub fn write_frame(&self, frame: &mut Frame) {
        self.state.write_frame(frame);
    }

    /// Contours nothing more until the surface is asked for again; it will then be the same as if it
    /// had been followed.
    pub fn forget_surface(&mut self) {
        self.scratch.view = None;
    }

    /// What the objects look like, contoured if nobody has asked yet, and the slots of the bodies it shows.
    pub(super) fn view(&mut self) -> (&View, &[BodySlot]) {
        let state = &self.state;
        let own = self.scratch.view.get_or_insert_with(|| OwnView {
            view: View::new(state.structure()),
            frame: Frame::default(),
            patch: None,
            is_adapted: false,
        });
        (&own.view, &state.slots)
    }

    /// Each body with its surface, which is contoured if nobody has yet.
    pub fn bodies_and_surfaces(&mut self) -> impl Iterator<Item = (&Body, &Surface)> {
        let (view, slots) = self.view();
        slots.iter().map(|s| &s.body).zip(view.surfaces())
    }

    /// Structure of the scene as it is now. From the first call on, steps that part links make a
    /// [`TopologyPatch`], until [`World::forget_surface`].
    #[must_use]
    pub fn keyframe(&mut self) -> Keyframe {
        self.view().0.keyframe()
    }

    /// What the last step changed in the structure; `None` where no link parted, or where nobody
    /// has asked for a keyframe since the surface was forgotten.
    #[must_use]
    pub fn topology_patch(&self) -> Option<&TopologyPatch> {
        self.scratch.view.as_ref()?.patch.as_ref()
    }

    /// Adapts the surface to the blades that touch it, for who is about to look at what the last step left:
    /// most steps nobody sees. The time, ns, goes into the profile of that step; `None` where nothing is to be
    /// adapted, where it has been, or where nobody has asked for the surface since it was forgotten.
    pub fn adapt_surface(&mut self, clock: &dyn StageClock) -> Option<u64> {
        let (state, own) = (&self.state, self.scratch.view.as_mut()?);
        if own.is_adapted || !state.is_touched() {
            return None;
        }
        let mut lap = Lap::start(clock);
        state.write_frame(&mut own.frame);
        own.view.adapt(&own.frame);
        own.is_adapted = true;
        lap.end(Stage::Adaptation);
        let took_ns = lap.finish().stage_ns[Stage::Adaptation as usize];
        self.output.profile.stage_ns[Stage::Adaptation as usize] = took_ns;
        took_ns
    }

    /// Vertices of an object's surface that are adapted to the blades that touch it, ids ascending: as
    /// [`World::adapt_surface`] has them after the last step, none before. The mechanics does not know of
    /// them, nor does any hash.
    #[must_use]
    pub fn adapted_vertices(&self, object: usize) -> &[AdaptedVertex] {
        self.scratch.view.as_ref().map_or(&[], |own| own.view.adapted_vertices(object))
    }

    /// Hash of the surface's structure; see [`crate::surface::hash`].
    #[must_use]
    pub fn surface_hash(&mut self) -> u64 {
        self.view().0.surface_hash()
    }
}
