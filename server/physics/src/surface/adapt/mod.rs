//! Adaptation of the surface to a blade that dents or cuts it (paper section 2.3): what the composite
//! elements are too coarse to show.
//!
//! Vertices that the blade touches are projected onto it (`indentation`); the surface around them
//! follows by a B-spline (`profile`) of the geodesic distance (`geodesic`). It is for the eye alone:
//! the mechanics never reads it, and it stands beside the surface, as offsets from where the elements
//! have the vertices.
//!
//! Every vertex is moved on the condition that no triangle at it turns over or gets worse than
//! [`quality::WORST`]; one that cannot be projected stays where the surface around it takes it.

pub mod blade_body;
mod field;
mod geodesic;
mod indentation;
mod mesh;
mod profile;
pub mod quality;
mod reached;

#[cfg(test)]
mod tests;

use crate::likeness::Placed;
use crate::math::Aabb;
use crate::surface::Surface;
use crate::surface::delta::{AdaptedVertex, BodyStructure};
use blade_body::BladeBody;
use field::{Field, Store};
use geodesic::March;
use indentation::{Indentation, NEAR_VOXELS, Near};
use mesh::{Mesh, Slot};

/// What a vertex moves by where all of it is not accepted.
const SHARES: [f64; 4] = [1.0, 0.75, 0.5, 0.25];
/// Displacements below this are not worth a move, in voxels: a hundredth of a pixel where a voxel is ten.
const NEGLIGIBLE_VOXELS: f64 = 1e-3;

/// A blade that touches an object.
#[derive(Default)]
pub(crate) struct Dent {
    pub(crate) blade: BladeBody,
    /// How far its edge has gone past the points it presses on, at most, m.
    pub(crate) depth_m: f64,
}

/// The adaptation of one object's surface, from when a tool first touches it while somebody looks.
#[derive(Default)]
pub(crate) struct Adaptation {
    mesh: Mesh,
    store: Store,
    near: Vec<Near>,
    indentation: Indentation,
    march: March,
    /// Vertices of the deformed region, the nearest to the blade first.
    order: Vec<Slot>,
    offsets: Vec<AdaptedVertex>,
}

impl Adaptation {
    /// Takes over what has changed in the surface, or the whole of it at first.
    pub(crate) fn follow(&mut self, surface: &Surface, change: &BodyStructure) {
        self.mesh.follow(surface, change);
        self.offsets.clear();
    }

    /// Vertices that are not where their elements have them, ids ascending.
    pub(crate) fn offsets(&self) -> &[AdaptedVertex] {
        &self.offsets
    }

    /// The surface is where the elements have it.
    pub(crate) fn clear(&mut self) {
        self.offsets.clear();
    }

    /// Adapts the surface to the blades that touch it. Costs in proportion to what lies around them.
    pub(crate) fn adapt(&mut self, body: Placed<'_>, dents: &[Dent]) {
        self.store.begin_step(&self.mesh);
        for dent in dents {
            self.find_near(body, &dent.blade);
            self.turn(body, |indentation, field, near, march| indentation.project(field, dent, near, march));
            self.turn(body, |_, field, near, march| indentation::clear_flanks(field, &dent.blade, near, march));
        }
        self.offsets.clear();
        self.offsets.extend(self.store.moved().map(|(slot, by_m, on_blade)| AdaptedVertex {
            id: self.mesh.id(slot),
            offset_m: by_m.map(|c| c as f32).into(),
            on_blade,
        }));
        self.offsets.sort_unstable_by_key(|vertex| vertex.id);
    }

    /// Finds the vertices near a blade.
    fn find_near(&mut self, body: Placed<'_>, blade: &BladeBody) {
        let box_near = blade.around(NEAR_VOXELS * body.voxel_size_m());
        let elements = body.elements_near(&box_near).filter(|element| box_of(body, *element).meets(&box_near));
        self.store.begin_turn();
        let field = &mut Field { body, mesh: &self.mesh, store: &mut self.store };
        let slots = elements.flat_map(|element| self.mesh.bound_to(element));
        self.near.clear();
        self.near.extend(slots.filter_map(|slot| Near::find(field, blade, *slot)));
    }

    /// Puts vertices on the blade and lets the surface around them follow.
    fn turn(&mut self, body: Placed<'_>, project: impl FnOnce(&mut Indentation, &mut Field<'_>, &[Near], &mut March)) {
        self.store.begin_turn();
        let field = &mut Field { body, mesh: &self.mesh, store: &mut self.store };
        self.march.clear();
        project(&mut self.indentation, field, &self.near, &mut self.march);
        self.order.clear();
        self.march.run(field, &mut self.order);
        for slot in &self.order {
            deform(field, *slot, NEGLIGIBLE_VOXELS * body.voxel_size_m());
        }
    }
}

/// The box around an element and what lies as far outside it as its vertices may.
fn box_of(body: Placed<'_>, element: usize) -> Aabb {
    body.element_box(element).grown(body.voxel_size_m())
}

/// Moves a vertex of the region by the profile (Eq. 19), as far as its triangles allow.
fn deform(field: &mut Field<'_>, slot: Slot, negligible_m: f64) {
    let Some(reached) = field.reached(slot) else { return };
    if field.is_held(slot) {
        return;
    }
    let (by_m, profile) = (reached.carried.by_m, reached.carried.profile);
    let offset_m = by_m * profile.share(reached.distance_m, by_m.norm());
    if offset_m.norm() < negligible_m {
        return;
    }
    let base_m = field.base_m(slot);
    let allowed = SHARES.into_iter().find(|share| field.quality_at(slot, base_m + offset_m * *share).is_some());
    if let Some(share) = allowed {
        field.move_to(slot, base_m + offset_m * share);
    }
}
