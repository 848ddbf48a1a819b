//! A smooth tool on the surface of one body: it presses and slides, rubs where the material does, cuts nothing.

use super::{COMES_OUT_VOXELS_PER_S, Contact, ContactWeights, Mode, ToolEnds};
use crate::Vec3;
use crate::body::Body;
use crate::boundary::{Skin, SkinPatch};
use crate::grow::make_room;
use crate::math::{Aabb, cofactor};
use crate::solve::spring::ROOM_FOR_SPRINGS;
use crate::tool::ToolPath;
use crate::tool::capsule::Capsule;
use serde::{Deserialize, Serialize};

/// What an element lacks of a dent: of the depth of a patch in the middle of its face, over `H (1 - nu^2) / E` times the
/// pressure on it. Fitted to spheres on a half-space whose dent has a radius of 0.4 to 4 H (`probe_tool::`). Half of
/// it makes a dent of H 5 % stiffer, twice 9 % softer.
const LACKS_BETWEEN_NODES: f64 = 0.35;
/// Fraction of it that a node does not lack: a load that is shared between nodes with weights w meets `w^T G w` of their
/// compliances, linear in the variance of w, as under an edge
/// (`fracture/compliance.rs`). Fitted as above: at 0 a dent of half of H is 20 % softer over a node than between nodes.
const LESS_AT_NODES: f64 = 0.8;
/// Patches this many voxels from the tool may come to touch it within the step: what tissue moves by itself in one.
/// More costs time alone; what comes faster is caught a step later.
const MARGIN_VOXELS: f64 = 0.5;
/// A patch this fraction of a voxel in or out of the tool need not change its mode within the step. The force on it is
/// wrong by so much of a voxel's indentation for a step, in proportion.
const SLACK_VOXELS: f64 = 0.01;

/// What one smooth tool does in one body.
#[derive(Clone, Serialize, Deserialize)]
pub struct Palpation {
    capsule: Capsule,
    /// Springs of the step that is being taken.
    pub contacts: Vec<Contact>,
    /// The patches that they press on.
    pressed: Vec<Pressed>,
    /// Those of the step before, by key.
    before: Vec<Pressed>,
}

/// A patch that the tool presses on.
#[derive(Clone, Copy, Serialize, Deserialize)]
struct Pressed {
    /// The voxel and its side.
    key: (u32, u8),
    /// Gap of its spring beyond the compression of its bed, m.
    shift_m: f64,
    /// Compression of its bed at the end of the step, m.
    compressed_m: f64,
}

impl Palpation {
    /// A tool that touches nothing.
    #[must_use]
    pub fn new(capsule: Capsule) -> Self {
        Self { capsule, contacts: Vec::new(), pressed: Vec::new(), before: Vec::new() }
    }

    /// Makes room for a contact on every patch.
    pub fn reserve(&mut self, body: &Body) {
        let most = Self::most_springs(body);
        make_room(&mut self.contacts, most);
        for pressed in [&mut self.pressed, &mut self.before] {
            make_room(pressed, most);
        }
    }

    /// One for each patch, of as many as there is room for.
    #[must_use]
    pub fn most_springs(body: &Body) -> usize {
        body.boundary().skin().map_or(0, Skin::len).min(ROOM_FOR_SPRINGS)
    }

    /// Forgets every contact.
    pub fn clear(&mut self) {
        self.contacts.clear();
        self.pressed.clear();
    }

    /// Finds which patches the tool meets on its way and sets up their springs.
    pub fn detect(&mut self, body: &Body, path: &ToolPath) {
        std::mem::swap(&mut self.pressed, &mut self.before);
        for (pressed, contact) in self.before.iter_mut().zip(&self.contacts) {
            pressed.compressed_m = if contact.force_n > 0.0 { contact.gap_m - pressed.shift_m } else { 0.0 };
        }
        self.before.sort_unstable_by_key(|pressed| pressed.key);
        self.clear();
        let Some(skin) = body.boundary().skin() else { return };
        let ends = [path.before, path.pose].into_iter().flat_map(|pose| {
            [-1.0, 1.0].map(|side| pose.transform(&(Vec3::x() * (side * self.capsule.half_length_m))))
        });
        // What the tissue itself moves in a step is less than the margin, or else its next step will do.
        let margin_m = MARGIN_VOXELS * body.state.grid.voxel_size_m();
        let near = Aabb::around(ends).grown(self.capsule.radius_m + margin_m + 2.0 * body.state.grid.voxel_size_m());
        for element in body.elements_near([near]) {
            for patch in skin.of_element(element as u32) {
                let Some(mut pressing) = contact(body, &self.capsule, patch, path, margin_m) else { continue };
                let key = (patch.point.voxel.0, patch.side);
                let known = self.before.binary_search_by_key(&key, |pressed| pressed.key).ok();
                pressing.begin_compressed_by(
                    known.map_or(0.0, |index| self.before[index].compressed_m),
                    COMES_OUT_VOXELS_PER_S * body.dt_s() * body.state.grid.voxel_size_m(),
                );
                let shift_m = Bed::under(body, patch, self.capsule.radius_m).press(&mut pressing);
                pressing.rub(body, body.material_of(patch.point.voxel).friction_coefficient);
                self.contacts.push(pressing);
                self.pressed.push(Pressed { key, shift_m, compressed_m: 0.0 });
            }
        }
    }
}

/// What the element behind a patch cannot show of a dent that is narrower than itself, as a bed of springs (Winkler) in
/// series with it, a part of H thick. Under a sphere that presses on a circle of radius a it gives by
/// `0.42 thickness / a` of the sphere's depth, as the elements' own error goes. Under a tool that is small beside H it
/// is as thick as the tool's radius at most: its dent is no wider. It stiffens and relaxes as the elements do, and by
/// its own compression e, as `e + e^5`, so that nothing goes through it.
struct Bed {
    /// Force over compression of a patch that is hardly pressed, N/m.
    stiffness_n_per_m: f64,
    thickness_m: f64,
}

impl Bed {
    fn under(body: &Body, patch: &SkinPatch, radius_m: f64) -> Self {
        let element = patch.element as usize;
        let material = body.material_of(patch.point.voxel);
        let at = Vec3::from(body.local_coordinates(element, &patch.point.position_m).map(|x| x.clamp(0.0, 1.0)));
        let normal = patch.normal.try_normalize(f64::MIN_POSITIVE).unwrap_or_else(Vec3::zeros);
        // Four times the variance of the weights, in the surface: 0 at a node, 1 in the middle of a face.
        let in_surface = normal.map(|n| 0.5 * (1.0 - n * n));
        let spread = in_surface.dot(&at.map(|x| 4.0 * x * (1.0 - x)));
        let lacks_m = LACKS_BETWEEN_NODES * (1.0 - LESS_AT_NODES * (1.0 - spread)) * body.element_edge_m(element);
        let thickness_m = lacks_m * radius_m / (lacks_m + radius_m);
        let branch = material.law.viscosity;
        let unrelaxed = branch.map_or(0.0, |branch| branch.modulus_ratio * body.unrelaxed_share(element));
        let modulus_pa = material.young_modulus_pa * (body.stiffening(element) + unrelaxed);
        let plane_pa = modulus_pa / (1.0 - material.poisson_ratio * material.poisson_ratio);
        Self { stiffness_n_per_m: plane_pa * patch.area_m2 / thickness_m, thickness_m }
    }

    /// Makes a contact its tangent where it is compressed as at the beginning of the step. Returns how far the gap is from
    /// the compression, m.
    fn press(&self, contact: &mut Contact) -> f64 {
        let [stiffness_n_per_m, shift_m, more_stored_j] = self.tangent(contact.gap_before_m);
        (contact.stiffness_n_per_m, contact.more_stored_j) = (stiffness_n_per_m, more_stored_j);
        contact.gap_before_m += shift_m;
        contact.gap_predicted_m += shift_m;
        shift_m
    }

    /// The spring that is its tangent where it is compressed by so much: its stiffness, N/m, how far its gap is from that,
    /// m, and what is stored in the bed beyond it, J.
    fn tangent(&self, compressed_m: f64) -> [f64; 3] {
        let (x, k) = (compressed_m.max(0.0), self.stiffness_n_per_m);
        let e4 = (x / self.thickness_m).powi(4);
        let (stiffness, force, stored) = (k * (1.0 + 5.0 * e4), k * x * (1.0 + e4), k * x * x * (0.5 + e4 / 6.0));
        [stiffness, force / stiffness - x, stored - 0.5 * force * force / stiffness]
    }
}

/// The contact between a patch and the tool along the tool's normal, without a stiffness; `None` where they are apart, or
/// where the patch looks away.
fn contact(body: &Body, capsule: &Capsule, patch: &SkinPatch, path: &ToolPath, margin_m: f64) -> Option<Contact> {
    let weights = ContactWeights::of(body, &patch.point, 1.0);
    let at = weights.place_m(&body.state.position_m);
    let predicted = at + weights.sum(&body.state.velocity_m_per_s) * body.dt_s();
    let nearest = capsule.nearest_after(&path.before.to_local(&at), &path.pose.to_local(&predicted));
    if nearest.distance_m > margin_m {
        return None;
    }
    let direction = path.pose.orientation * nearest.normal;
    let turned = cofactor(&body.deformation_gradient(&patch.point)) * patch.normal;
    if turned.dot(&direction) >= 0.0 {
        return None;
    }
    let (before, now) = (path.before.transform(&nearest.surface_m), path.pose.transform(&nearest.surface_m));
    Some(Contact {
        ends: ToolEnds { weights, tool_point_m: now, tool_point_before_m: before },
        direction,
        gap_before_m: (before - at).dot(&direction),
        gap_predicted_m: -nearest.distance_m,
        slack_m: SLACK_VOXELS * body.state.grid.voxel_size_m(),
        pull_slack_m: SLACK_VOXELS * body.state.grid.voxel_size_m(),
        mode: if nearest.distance_m < 0.0 { Mode::Spring } else { Mode::Off },
        ..Contact::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tangent_of_a_bed_has_its_force_and_its_energy() {
        let bed = Bed { stiffness_n_per_m: 300.0, thickness_m: 2e-3 };
        let force_n = |x: f64| 300.0 * x * (1.0 + (x / 2e-3).powi(4));
        for x in [0.0, 1e-4, 2e-3, 5e-3] {
            let [stiffness, shift_m, more_j] = bed.tangent(x);
            let slope = (force_n(x + 1e-8) - force_n(x - 1e-8)) / 2e-8;
            assert!((stiffness / slope - 1.0).abs() < 1e-6, "{stiffness} {slope}");
            assert!((stiffness * (x + shift_m) - force_n(x)).abs() < 1e-12, "at {x}");
            let work_j: f64 = (0..1000).map(|i| force_n((f64::from(i) + 0.5) * x / 1000.0) * x / 1000.0).sum();
            let stored_j = 0.5 * stiffness * (x + shift_m).powi(2) + more_j;
            assert!((stored_j - work_j).abs() <= 1e-4 * work_j, "{stored_j} {work_j}");
        }
        assert_eq!(bed.tangent(-1e-3), [300.0, 0.0, 0.0]);
    }
}
