//! Where the vertices are before and after they are adapted, and what is known of them meanwhile.

use super::mesh::{Mesh, Slot};
use super::quality;
use super::reached::Reached;
use crate::Vec3;
use crate::likeness::Placed;

/// Values of the vertices that were looked at in a step, side by side: those of a blade's surroundings, of a surface that
/// may be large.
#[derive(Default)]
pub struct Store {
    vertices: Vec<Vertex>,
    /// By slot: where its values are, if they are those of this slot. So nothing is ever cleared (Briggs and Torczon
    /// 1993).
    places: Vec<u32>,
    /// The turn of one tool's edge or flanks.
    turn: u32,
}

/// What is known of a vertex.
pub(super) struct Vertex {
    slot: Slot,
    turn: u32,
    /// Where the element has it, m.
    carried_m: Vec3,
    /// Where it was when the turn began, m.
    pub(super) base_m: Vec3,
    /// Where it is, m.
    adapted_m: Vec3,
    /// What the march knows of it.
    pub(super) reached: Option<Reached>,
    /// On a blade: it stays there.
    held: bool,
}

impl Store {
    /// Begins a step: every vertex is where its element has it.
    pub(crate) fn begin_step(&mut self, mesh: &Mesh) {
        self.places.resize(mesh.len(), 0);
        self.vertices.clear();
        self.turn = 0;
    }

    /// Begins another turn, in which the vertices begin where the last one left them.
    pub(crate) fn begin_turn(&mut self) {
        self.turn += 1;
    }

    /// Vertices that have moved in this step, by how much, m, and whether onto a blade.
    pub fn moved(&self) -> impl Iterator<Item = (Slot, Vec3, bool)> + '_ {
        let moved = self.vertices.iter().filter(|vertex| vertex.adapted_m != vertex.carried_m);
        moved.map(|vertex| (vertex.slot, vertex.adapted_m - vertex.carried_m, vertex.held))
    }

    /// Number of vertices that were looked at in this step.
    #[cfg(test)]
    pub fn seen(&self) -> usize {
        self.vertices.len()
    }
}

/// The store with what it is filled from.
pub struct Field<'a> {
    /// The body whose surface it is.
    pub body: Placed<'a>,
    /// Its surface.
    pub mesh: &'a Mesh,
    /// The values.
    pub store: &'a mut Store,
}

impl Field<'_> {
    /// Where the values of a vertex are in this turn.
    #[inline]
    pub(super) fn place(&mut self, slot: Slot) -> usize {
        let place = self.store.places[slot as usize] as usize;
        match self.store.vertices.get(place) {
            Some(vertex) if vertex.slot == slot && vertex.turn == self.store.turn => place,
            _ => self.begin(slot, place),
        }
    }

    /// The values at a place.
    #[inline]
    pub(super) fn at(&self, place: usize) -> &Vertex {
        &self.store.vertices[place]
    }

    /// The values at a place.
    #[inline]
    pub(super) fn at_mut(&mut self, place: usize) -> &mut Vertex {
        &mut self.store.vertices[place]
    }

    #[inline]
    fn vertex(&mut self, slot: Slot) -> &mut Vertex {
        let place = self.place(slot);
        self.at_mut(place)
    }

    /// Brings a vertex into this turn; its place.
    #[cold]
    fn begin(&mut self, slot: Slot, place: usize) -> usize {
        let store = &mut *self.store;
        let turn = store.turn;
        if let Some(vertex) = store.vertices.get_mut(place).filter(|vertex| vertex.slot == slot) {
            (vertex.turn, vertex.base_m, vertex.reached) = (turn, vertex.adapted_m, None);
            return place;
        }
        let carried_m = self.body.current_m(&self.mesh.point(slot));
        let place = store.vertices.len();
        store.places[slot as usize] = place as u32;
        let (base_m, adapted_m) = (carried_m, carried_m);
        store.vertices.push(Vertex { slot, turn, carried_m, base_m, adapted_m, reached: None, held: false });
        place
    }

    /// Where a vertex was when the turn began, m.
    pub(crate) fn base_m(&mut self, slot: Slot) -> Vec3 {
        self.vertex(slot).base_m
    }

    /// Normal of a triangle when the turn began, as long as twice its area.
    pub fn normal(&mut self, a: Slot, b: Slot, c: Slot) -> Vec3 {
        let from = self.base_m(a);
        (self.base_m(b) - from).cross(&(self.base_m(c) - from))
    }

    /// What the march knows of a vertex.
    pub fn reached(&mut self, slot: Slot) -> Option<Reached> {
        self.vertex(slot).reached
    }

    /// Whether a vertex is on a blade.
    pub(crate) fn is_held(&mut self, slot: Slot) -> bool {
        self.vertex(slot).held
    }

    /// Moves a vertex.
    pub fn move_to(&mut self, slot: Slot, to_m: Vec3) {
        self.vertex(slot).adapted_m = to_m;
    }

    /// Moves a vertex onto a blade.
    pub fn hold(&mut self, slot: Slot, at_m: Vec3) {
        let vertex = self.vertex(slot);
        (vertex.adapted_m, vertex.held) = (at_m, true);
    }

    /// The quality of the triangles at a vertex were it moved (Eq. 14); `None` where one of them would be
    /// turned over or worse than is accepted, against where the elements have them.
    pub(crate) fn quality_at(&mut self, slot: Slot, to_m: Vec3) -> Option<f64> {
        let (mesh, own_m) = (self.mesh, self.vertex(slot).carried_m);
        mesh.triangles_at(slot).try_fold(0.0, |sum, others| {
            let [(b_m, to_b_m), (c_m, to_c_m)] = others.map(|other| {
                let other = self.vertex(other);
                (other.carried_m, other.adapted_m)
            });
            Some(sum + quality::acceptable([own_m, b_m, c_m], [to_m, to_b_m, to_c_m])?)
        })
    }
}
