//! Flanks of a blade against the walls of the cut it stands in.

use super::{COMES_OUT_VOXELS_PER_S, Contact, Mode, ToolEnds};
use crate::body::Body;
use crate::boundary::{PatchKey, SurfacePatch};
use crate::grow::make_room;
use crate::math::cofactor;
use crate::tool::Pose;
use crate::tool::flanks::{FlankFace, FlankPoint, Flanks};
use serde::{Deserialize, Serialize};

/// Walls closer to the edge than this many voxels, or than half an element, are left to the front: the last row of
/// parted links lies within a voxel of it, and the springs of the front hold what is nearer. Under a wedge of 0.3 rad
/// that slices a soft block half of it adds 5 % to the mean force, of friction and of what spreads the walls, twice
/// takes 5 % off.
const FRONT_ZONE_VOXELS: f64 = 2.0;
/// Walls farther than this many voxels from the blade's middle surface are not looked at: farther than a wall comes
/// within a step, 2 voxels of 3 mm at 60 Hz being 0.36 m/s. More costs only time; less lets a fast wall through.
const REACH_VOXELS: f64 = 2.0;
/// A wall that is this fraction of a voxel in or out of the blade need not change its mode within the
/// step: the next one decides from the gap it predicts. Walls that hang at the blade would otherwise
/// cost a solve each time they touch. The force that this may get wrong for a step is a twentieth of a voxel's strain,
/// in proportion to it.
const SLACK_VOXELS: f64 = 0.05;

/// A wall that comes beside the blade deeper than its middle surface by this many voxels did not get there by
/// pressing on the flank: it is of a cut that the blade crosses, or of a piece that has just come free. It is not
/// pushed out. What has pressed on it since the step before is kept whatever its depth, so that this decides on the
/// first contact alone. Half or twice changes no bit of a stroke of a wedge that meets no other cut.
const OF_ANOTHER_CUT_VOXELS: f64 = 0.5;

/// Walls that stand at one blade, from step to step.
#[derive(Clone, Default, Serialize, Deserialize)]
pub struct WallsBeside {
    /// In the order of the boundary's walls.
    walls: Vec<WallBeside>,
    /// Those of the step before.
    before: Vec<WallBeside>,
}

/// A wall that stands at a blade.
#[derive(Clone, Copy, Serialize, Deserialize)]
struct WallBeside {
    key: (PatchKey, FlankSide),
    /// How far its spring is compressed at the end of the step, m.
    compressed_m: f64,
    /// Whether it has a spring.
    is_near: bool,
}

/// The flank that a wall looks at. A wall that turns round looks at the other one, from the far side of the
/// blade: it has not come there by pressing on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
enum FlankSide {
    /// Ahead of the middle surface along its normal.
    Ahead,
    Behind,
}

impl FlankSide {
    fn sign(self) -> f64 {
        match self {
            Self::Ahead => 1.0,
            Self::Behind => -1.0,
        }
    }
}

impl WallsBeside {
    /// Room for so many walls.
    pub fn reserve(&mut self, walls: usize) {
        for beside in [&mut self.walls, &mut self.before] {
            make_room(beside, walls);
        }
    }

    /// Forgets them.
    pub fn clear(&mut self) {
        self.walls.clear();
    }

    /// Contacts of the flanks at `pose` with the walls they press on or are about to. `out` has those of the step before.
    pub fn contacts(&mut self, body: &Body, flanks: &Flanks, [before, pose]: [&Pose; 2], out: &mut Vec<Contact>) {
        let place = pose.orientation.inverse();
        for (wall, contact) in self.walls.iter_mut().filter(|wall| wall.is_near).zip(&*out) {
            wall.compressed_m = contact.compressed_m();
        }
        out.clear();
        std::mem::swap(&mut self.walls, &mut self.before);
        self.walls.clear();
        for patch in body.boundary().walls() {
            let local = place * (body.current_m(&patch.point) - pose.position_m);
            let Some(nearest) = flanks.nearest(&local, REACH_VOXELS * body.state.grid.voxel_size_m()) else { continue };
            if !(front_zone_m(body, patch)..=flanks.height_m()).contains(&nearest.height_m) {
                continue;
            }
            let wall = Wall::beside(body, patch, flanks, nearest, pose);
            let key = (patch.key(), wall.side);
            let known = self.before.binary_search_by_key(&key, |wall| wall.key).ok();
            if known.is_none() && wall.is_of_another_cut(body) {
                continue;
            }
            let compressed_m = known.map_or(0.0, |index| self.before[index].compressed_m);
            let contact = wall.contact(body, before, pose, compressed_m);
            self.walls.push(WallBeside { key, compressed_m: 0.0, is_near: contact.is_some() });
            out.extend(contact);
        }
    }
}

/// Height above the edge up to which a wall is left to the front, m.
fn front_zone_m(body: &Body, patch: &SurfacePatch) -> f64 {
    (FRONT_ZONE_VOXELS * body.state.grid.voxel_size_m()).max(0.5 * body.element_edge_m(patch.element as usize))
}

/// A wall and the flank on its side.
struct Wall<'a> {
    patch: &'a SurfacePatch,
    beside: FlankPoint,
    side: FlankSide,
    face: FlankFace,
    /// How deep it is beyond the blade's middle surface, m.
    beyond_middle_m: f64,
}

impl<'a> Wall<'a> {
    fn beside(body: &Body, patch: &'a SurfacePatch, flanks: &Flanks, beside: FlankPoint, pose: &Pose) -> Self {
        let turned = cofactor(&body.deformation_gradient(&patch.point)) * patch.normal;
        // The blade stands where the wall looks.
        let looks_back = turned.dot(&(pose.orientation * beside.normal)) < 0.0;
        let side = if looks_back { FlankSide::Ahead } else { FlankSide::Behind };
        let face = flanks.face(&beside, side.sign());
        Self { patch, beside, side, face, beyond_middle_m: -side.sign() * beside.offset_m }
    }

    fn is_of_another_cut(&self, body: &Body) -> bool {
        self.beyond_middle_m > OF_ANOTHER_CUT_VOXELS * body.state.grid.voxel_size_m()
    }

    /// The spring between the wall and the flank, as stiff as the element behind the wall: `E A / H`. It
    /// starts in the mode that the tissue's velocity predicts, `compressed_m` as the last step left it.
    fn contact(&self, body: &Body, before: &Pose, pose: &Pose, compressed_m: f64) -> Option<Contact> {
        let (patch, face) = (self.patch, &self.face);
        let h = body.state.grid.voxel_size_m();
        let young = body.material_of(patch.point.voxel).young_modulus_pa;
        let along_tool = [before, pose].map(|pose| pose.transform(&self.beside.position_m));
        let mut contact = Contact {
            ends: ToolEnds::of(body, &patch.point, along_tool),
            direction: pose.orientation * face.outward,
            stiffness_n_per_m: young * patch.area_m2 / body.element_edge_m(patch.element as usize),
            slack_m: SLACK_VOXELS * h,
            pull_slack_m: SLACK_VOXELS * h,
            ..Contact::default()
        };
        let drift = body.dt_s() * contact.ends.weights.sum(&body.state.velocity_m_per_s).dot(&contact.direction);
        let travel = (contact.ends.tool_point_m - contact.ends.tool_point_before_m).dot(&contact.direction);
        contact.gap_before_m = face.depth_m - travel;
        contact.gap_predicted_m = face.depth_m - drift;
        contact.begin_compressed_by(compressed_m, COMES_OUT_VOXELS_PER_S * body.dt_s() * h);
        contact.mode = if contact.gap_predicted_m > 0.0 { Mode::Spring } else { Mode::Off };
        (contact.gap_predicted_m > -0.5 * h).then_some(contact)
    }
}
