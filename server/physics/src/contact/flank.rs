//! Flanks of a blade against the walls of the cut it stands in.

use super::{Contact, Mode};
use crate::Vec3;
use crate::body::{Body, MaterialPoint, TopologyChange};
use crate::grid::{Grid, Link, LinkId, VoxelId};
use crate::tool::Pose;
use crate::tool::flanks::{FlankPoint, Flanks};

/// Walls closer to the edge than this many voxels, or than half an element, are left to the front.
const FRONT_ZONE_VOXELS: f64 = 2.0;
/// Walls farther than this many voxels from the blade's middle surface are not looked at.
const REACH_VOXELS: f64 = 2.0;
/// A wall that is this share of a voxel in or out of the blade need not change its mode within the
/// step: the next one decides from the gap it predicts. Walls that hang at the blade would otherwise
/// cost a solve each time they touch.
const SLACK_VOXELS: f64 = 0.05;

/// The wall points of one element that look along the same axis, as one.
#[derive(Clone, Copy, Debug)]
struct Patch {
    element: u32,
    /// Face of the voxels that the wall is on, as in [`Grid::links_of`].
    face: u8,
    /// Mean of the crossings, carried by one of the voxels.
    point: MaterialPoint,
    /// Mean outward normal, reference configuration.
    normal: Vec3,
    /// Area of the crossings, m^2.
    area_m2: f64,
}

/// The walls of all cuts of a body, by element.
#[derive(Clone, Default)]
pub struct Walls {
    patches: Vec<Patch>,
}

impl Walls {
    /// Whether nothing is cut.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.patches.is_empty()
    }

    /// Number of patches: no blade has more flank contacts.
    #[must_use]
    pub fn len(&self) -> usize {
        self.patches.len()
    }

    /// Takes the walls of what `parted` and `change` touched; costs in proportion to that.
    pub fn update(&mut self, body: &Body, parted: &[LinkId], change: &TopologyChange) {
        let ends = parted.iter().flat_map(|link| [link.cell, link.upper()]);
        let owners = ends.filter_map(|cell| body.grid.voxel_at(cell)).map(|v| body.element_of(v) as u32);
        let mut touched: Vec<u32> = change.elements.iter().copied().chain(owners).collect();
        touched.sort_unstable();
        touched.dedup();
        self.patches.retain(|p| touched.binary_search(&p.element).is_err());
        touched.iter().for_each(|&element| self.add_element(body, element));
        self.patches.sort_unstable_by_key(|p| (p.element, p.face));
    }

    /// Adds the patches of an element that is cut through. One with walls that face each other is
    /// still in one piece: both would press on the same field.
    fn add_element(&mut self, body: &Body, element: u32) {
        let mut faces = [None; 6];
        for voxel in body.voxels_of(element as usize) {
            let cell = body.grid.voxels()[voxel.index()].ijk;
            for (face, (link, _)) in Grid::links_of(cell).enumerate() {
                if let Link::Parted(crossing) = body.grid.link(link) {
                    let mut at = body.grid.centre_m(link.cell);
                    at[link.axis as usize] += f64::from(crossing.t) * body.grid.voxel_size_m();
                    let normal = Vec3::from(crossing.normal.map(f64::from));
                    let outward = if face % 2 == 1 { normal } else { -normal };
                    let area = body.grid.voxel_size_m().powi(2) * normal[link.axis as usize].abs();
                    faces[face].get_or_insert(Sum::new(voxel)).add(at, outward, area);
                }
            }
        }
        for face in 0..6 {
            if let (Some(sum), None) = (&faces[face], &faces[face ^ 1]) {
                self.patches.push(sum.patch(element, face as u8));
            }
        }
    }

    /// Contacts of the flanks at `pose` with the walls they press on or are about to.
    pub fn contacts(&self, body: &Body, flanks: &Flanks, before: &Pose, pose: &Pose, out: &mut Vec<Contact>) {
        let place = pose.orientation.inverse();
        out.extend(self.patches.iter().filter_map(|patch| {
            let local = place * (body.current_m(&patch.point) - pose.position_m);
            let beside = flanks.nearest(&local, REACH_VOXELS * body.grid.voxel_size_m())?;
            let behind = (patch.front_zone_m(body)..=flanks.height_m()).contains(&beside.height_m);
            behind.then(|| patch.contact(body, flanks, &beside, before, pose))?
        }));
    }
}

/// Area-weighted sums over wall points.
#[derive(Clone, Copy)]
struct Sum {
    voxel: VoxelId,
    position: Vec3,
    normal: Vec3,
    area_m2: f64,
}

impl Sum {
    fn new(voxel: VoxelId) -> Self {
        Self { voxel, position: Vec3::zeros(), normal: Vec3::zeros(), area_m2: 0.0 }
    }

    fn add(&mut self, at: Vec3, outward: Vec3, area: f64) {
        self.position += at * area;
        self.normal += outward * area;
        self.area_m2 += area;
    }

    fn patch(&self, element: u32, face: u8) -> Patch {
        let point = MaterialPoint { position_m: self.position / self.area_m2, voxel: self.voxel };
        Patch { element, face, point, normal: self.normal, area_m2: self.area_m2 }
    }
}

impl Patch {
    /// Height above the edge up to which the wall is left to the front, m.
    fn front_zone_m(&self, body: &Body) -> f64 {
        (FRONT_ZONE_VOXELS * body.grid.voxel_size_m()).max(0.5 * body.element_edge_m(self.element as usize))
    }

    /// The spring between the wall and the flank on its side, as stiff as the element behind the wall:
    /// `E A / H`. It starts in the mode that the tissue's velocity predicts.
    fn contact(
        &self,
        body: &Body,
        flanks: &Flanks,
        beside: &FlankPoint,
        before: &Pose,
        pose: &Pose,
    ) -> Option<Contact> {
        let h = body.grid.voxel_size_m();
        let turned = body.deformation_gradient(&self.point).try_inverse()?.transpose() * self.normal;
        // The blade stands where the wall looks.
        let side = if turned.dot(&(pose.orientation * beside.normal)) < 0.0 { 1.0 } else { -1.0 };
        let face = flanks.face(beside, side);
        let young = body.material_of(self.point.voxel).young_modulus_pa;
        let mut contact = Contact {
            direction: pose.orientation * face.outward,
            tool_point_m: pose.transform(&beside.position_m),
            tool_point_before_m: before.transform(&beside.position_m),
            stiffness_n_per_m: young * self.area_m2 / body.element_edge_m(self.element as usize),
            limit_n: f64::INFINITY,
            slack_m: SLACK_VOXELS * h,
            ..Contact::default()
        };
        let (nodes, n) = body.weights(&self.point);
        nodes.into_iter().zip(n).for_each(|(node, n)| contact.weights.add(node, n));
        let drift = body.dt_s() * contact.weights.sum(&body.velocity_m_per_s).dot(&contact.direction);
        let travel = (contact.tool_point_m - contact.tool_point_before_m).dot(&contact.direction);
        contact.gap_before_m = face.depth_m - travel;
        contact.gap_predicted_m = face.depth_m - drift;
        contact.mode = if contact.gap_predicted_m > 0.0 { Mode::Spring } else { Mode::Off };
        (contact.gap_predicted_m > -0.5 * h).then_some(contact)
    }
}
