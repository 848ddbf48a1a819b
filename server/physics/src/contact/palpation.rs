//! A smooth tool on the surface of one body: it presses and slides, rubs where the material does, cuts nothing.

use super::{Contact, ContactWeights, Mode, ToolEnds};
use crate::Vec3;
use crate::body::Body;
use crate::boundary::{Skin, SkinPatch};
use crate::math::Aabb;
use crate::tool::ToolPath;
use crate::tool::capsule::Capsule;

/// Stiffness of a patch over Young's modulus times its edge: under a sphere that presses on a circle of radius a it
/// gives by `0.5 edge / (30 a)` of the sphere's depth. Halved, it gives by twice that; doubled, by half, and solves
/// take longer.
const STIFFNESS: f64 = 30.0;
/// Patches this many voxels from the tool may come to touch it within the step: what tissue moves by itself in one.
/// More costs time alone; what comes faster is caught a step later.
const MARGIN_VOXELS: f64 = 0.5;
/// A patch this fraction of a voxel in or out of the tool need not change its mode within the step. The force on it is
/// wrong by so much of a voxel's indentation for a step, in proportion.
const SLACK_VOXELS: f64 = 0.01;

/// What one smooth tool does in one body.
#[derive(Clone)]
pub struct Palpation {
    capsule: Capsule,
    /// Springs of the step that is being taken.
    pub contacts: Vec<Contact>,
}

impl Palpation {
    /// A tool that touches nothing.
    #[must_use]
    pub fn new(capsule: Capsule) -> Self {
        Self { capsule, contacts: Vec::new() }
    }

    /// Makes room for a contact on every patch. Returns the number of springs that is.
    pub fn reserve(&mut self, body: &Body) -> usize {
        let patches = body.boundary().skin().map_or(0, Skin::len);
        self.contacts.reserve(patches.saturating_sub(self.contacts.len()));
        patches
    }

    /// Forgets every contact.
    pub fn clear(&mut self) {
        self.contacts.clear();
    }

    /// Finds which patches the tool meets on its way and sets up their springs.
    pub fn detect(&mut self, body: &Body, path: &ToolPath) {
        self.clear();
        let Some(skin) = body.boundary().skin() else { return };
        let ends = [path.before, path.pose].into_iter().flat_map(|pose| {
            [-1.0, 1.0].map(|side| pose.transform(&(Vec3::x() * (side * self.capsule.half_length_m))))
        });
        // What the tissue itself moves in a step is less than the margin, or else its next step will do.
        let margin_m = MARGIN_VOXELS * body.state.grid.voxel_size_m();
        let near = Aabb::around(ends).grown(self.capsule.radius_m + margin_m + 2.0 * body.state.grid.voxel_size_m());
        for element in body.elements_near(&near) {
            for patch in skin.of_element(element as u32) {
                let Some(mut pressing) = contact(body, &self.capsule, patch, path, margin_m) else { continue };
                pressing.rub(body, body.material_of(patch.point.voxel).friction_coefficient);
                self.contacts.push(pressing);
            }
        }
    }
}

/// The unilateral spring between a patch and the tool, `30 E psi' sqrt(A)` stiff with the tissue's
/// stiffening psi', along the tool's normal; `None` where they are apart, or where the patch looks away.
fn contact(body: &Body, capsule: &Capsule, patch: &SkinPatch, path: &ToolPath, margin_m: f64) -> Option<Contact> {
    let weights = ContactWeights::of(body, &patch.point, 1.0);
    let at = weights.place_m(&body.state.position_m);
    let predicted = at + weights.sum(&body.state.velocity_m_per_s) * body.dt_s();
    let nearest = capsule.nearest_after(&path.before.to_local(&at), &path.pose.to_local(&predicted));
    if nearest.distance_m > margin_m {
        return None;
    }
    let direction = path.pose.orientation * nearest.normal;
    let turned = body.deformation_gradient(&patch.point).try_inverse()?.transpose() * patch.normal;
    if turned.dot(&direction) >= 0.0 {
        return None;
    }
    let (before, now) = (path.before.transform(&nearest.surface_m), path.pose.transform(&nearest.surface_m));
    let young_modulus_pa = body.material_of(patch.point.voxel).young_modulus_pa;
    let stiffened_pa = young_modulus_pa * body.stiffening(patch.element as usize);
    Some(Contact {
        ends: ToolEnds { weights, tool_point_m: now, tool_point_before_m: before },
        direction,
        stiffness_n_per_m: STIFFNESS * stiffened_pa * patch.area_m2.sqrt(),
        gap_before_m: (before - at).dot(&direction),
        gap_predicted_m: -nearest.distance_m,
        slack_m: SLACK_VOXELS * body.state.grid.voxel_size_m(),
        pull_slack_m: SLACK_VOXELS * body.state.grid.voxel_size_m(),
        mode: if nearest.distance_m < 0.0 { Mode::Spring } else { Mode::Off },
        ..Contact::default()
    })
}
