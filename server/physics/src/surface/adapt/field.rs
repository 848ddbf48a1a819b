//! Where the vertices are before and after they are adapted, and what is known of them meanwhile.

use super::mesh::{Mesh, Slot};
use super::quality;
use super::reached::Reached;
use crate::Vec3;
use crate::likeness::Placed;

/// Values by slot; only those of the present turn mean anything, so that nothing is ever cleared.
#[derive(Default)]
pub struct Store {
    vertices: Vec<Vertex>,
    /// The turn of one tool's edge or flanks, and the first turn of the step.
    turn: u64,
    first: u64,
    /// Vertices that were looked at in this step.
    seen: Vec<Slot>,
}

#[derive(Clone, Copy)]
struct Vertex {
    turn: u64,
    /// Where the element has it, m.
    carried_m: Vec3,
    /// Where it was when the turn began, m.
    base_m: Vec3,
    /// Where it is, m.
    adapted_m: Vec3,
    reached: Option<Reached>,
    /// On a blade: it stays there.
    held: bool,
}

const UNSEEN: Vertex = Vertex {
    turn: 0,
    carried_m: Vec3::new(0.0, 0.0, 0.0),
    base_m: Vec3::new(0.0, 0.0, 0.0),
    adapted_m: Vec3::new(0.0, 0.0, 0.0),
    reached: None,
    held: false,
};

impl Store {
    /// Begins a step: every vertex is where its element has it.
    pub(crate) fn begin_step(&mut self, mesh: &Mesh) {
        if self.vertices.len() != mesh.len() {
            self.vertices.resize(mesh.len(), UNSEEN);
            self.seen = Vec::with_capacity(mesh.len());
        }
        self.seen.clear();
        self.turn += 1;
        self.first = self.turn;
    }

    /// Begins another turn, in which the vertices begin where the last one left them.
    pub(crate) fn begin_turn(&mut self) {
        self.turn += 1;
    }

    /// Vertices that have moved in this step, by how much, m, and whether onto a blade.
    pub fn moved(&self) -> impl Iterator<Item = (Slot, Vec3, bool)> + '_ {
        let seen = self.seen.iter().map(|slot| (*slot, &self.vertices[*slot as usize]));
        seen.filter(|(_, vertex)| vertex.adapted_m != vertex.carried_m)
            .map(|(slot, vertex)| (slot, vertex.adapted_m - vertex.carried_m, vertex.held))
    }

    /// Number of vertices that were looked at in this step.
    #[cfg(test)]
    pub fn seen(&self) -> usize {
        self.seen.len()
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
    #[inline]
    fn vertex(&mut self, slot: Slot) -> &mut Vertex {
        if self.store.vertices[slot as usize].turn < self.store.turn {
            self.begin(slot);
        }
        &mut self.store.vertices[slot as usize]
    }

    /// Brings a vertex into this turn.
    #[cold]
    fn begin(&mut self, slot: Slot) {
        let store = &mut *self.store;
        let vertex = &mut store.vertices[slot as usize];
        if vertex.turn < store.first {
            let carried_m = self.body.current_m(&self.mesh.point(slot));
            *vertex = Vertex { turn: store.turn, carried_m, base_m: carried_m, adapted_m: carried_m, ..UNSEEN };
            store.seen.push(slot);
        } else {
            *vertex = Vertex { turn: store.turn, base_m: vertex.adapted_m, reached: None, ..*vertex };
        }
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

    /// Sets what the march knows of a vertex.
    pub fn reach(&mut self, slot: Slot, reached: Reached) {
        self.vertex(slot).reached = Some(reached);
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
