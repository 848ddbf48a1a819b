//! Flanks of a blade against the walls of the cut it stands in.

use super::Contact;
use crate::Vec3;
use crate::body::{Body, MaterialPoint};
use crate::grid::{Link, LinkId};
use crate::tool::Pose;
use crate::tool::blade::{Blade, BladeFrame};

/// Walls closer to the edge than this many voxels are left to the front.
const FRONT_ZONE_VOXELS: f64 = 2.0;
/// Stiffness of a wall's contact per area, over `E / h`.
const WALL_STIFFNESS: f64 = 2.0;

/// Sum over the wall points of one element on one side of a blade.
struct Wall {
    key: (u32, bool),
    points: f64,
    weights: Vec<(u32, f64)>,
    depth: f64,
    tool_point: Vec3,
    stiffness: f64,
}

/// Contacts of the flanks at `pose`, one for each element and side that they press on: the mean of
/// the element's wall points, with the stiffness of all of them.
pub fn flank_contacts(body: &Body, cut: &[LinkId], blade: &Blade, before: &Pose, pose: &Pose, out: &mut Vec<Contact>) {
    let frame = BladeFrame::of(pose);
    let mut walls: Vec<Wall> = Vec::new();
    for &link in cut {
        let Link::Parted(crossing) = body.grid.link(link) else { continue };
        let lower = body.grid.centre_m(link.cell);
        let mut at = lower;
        at[link.axis as usize] += f64::from(crossing.t) * body.grid.voxel_size_m();
        for (cell, upper) in [(link.cell, false), (link.upper(), true)] {
            let Some(voxel) = body.grid.voxel_at(cell) else { continue };
            let point = MaterialPoint { position_m: at, voxel };
            if let Some(hit) = wall_point(body, &point, upper, crossing.normal, blade, pose, &frame) {
                add_to_wall(&mut walls, body, &point, hit);
            }
        }
    }
    walls.sort_unstable_by_key(|w| w.key);
    out.extend(walls.into_iter().filter_map(|wall| wall.into_contact(&frame, before, pose, body)));
}

/// A wall point near the flank: whether it belongs on the blade's +normal side, its depth into the
/// blade and its place on the blade in the tool frame.
struct Hit {
    positive_side: bool,
    depth: f64,
    local: Vec3,
}

fn wall_point(
    body: &Body,
    point: &MaterialPoint,
    upper: bool,
    normal: [f32; 3],
    blade: &Blade,
    pose: &Pose,
    frame: &BladeFrame,
) -> Option<Hit> {
    let h = body.grid.voxel_size_m();
    let local = pose.orientation.inverse() * (body.current_m(point) - pose.position_m);
    let beside = local.x.abs() <= 0.5 * blade.width_m
        && (FRONT_ZONE_VOXELS * h..=blade.height_m).contains(&local.y)
        && local.z.abs() <= FRONT_ZONE_VOXELS * h;
    if !beside {
        return None;
    }
    let f = body.deformation_gradient(point);
    let n = f.try_inverse()?.transpose() * Vec3::from(normal.map(f64::from));
    let positive_side = (n.dot(&frame.normal) > 0.0) == upper;
    let outward = if positive_side { local.z } else { -local.z };
    Some(Hit { positive_side, depth: 0.5 * blade.thickness_m - outward, local })
}

fn add_to_wall(walls: &mut Vec<Wall>, body: &Body, point: &MaterialPoint, hit: Hit) {
    let key = (body.element_of(point.voxel) as u32, hit.positive_side);
    let index = walls.iter().position(|w| w.key == key).unwrap_or_else(|| {
        let none = Vec3::zeros();
        walls.push(Wall { key, points: 0.0, weights: Vec::new(), depth: 0.0, tool_point: none, stiffness: 0.0 });
        walls.len() - 1
    });
    let wall = &mut walls[index];
    let (nodes, n) = body.weights(point);
    for (node, n) in nodes.into_iter().zip(n) {
        match wall.weights.iter_mut().find(|e| e.0 == node) {
            Some(entry) => entry.1 += n,
            None => wall.weights.push((node, n)),
        }
    }
    let h = body.grid.voxel_size_m();
    wall.points += 1.0;
    wall.depth += hit.depth;
    wall.tool_point += Vec3::new(hit.local.x, hit.local.y, 0.0);
    wall.stiffness += WALL_STIFFNESS * body.material_of(point.voxel).young_modulus_pa * h;
}

impl Wall {
    fn into_contact(self, frame: &BladeFrame, before: &Pose, pose: &Pose, body: &Body) -> Option<Contact> {
        let mut contact = Contact {
            direction: if self.key.1 { frame.normal } else { -frame.normal },
            stiffness_n_per_m: self.stiffness,
            gap_before_m: self.depth / self.points,
            limit_n: f64::INFINITY,
            ..Contact::default()
        };
        self.weights.iter().for_each(|(node, w)| contact.weights.add(*node, w / self.points));
        let local = self.tool_point / self.points;
        contact.tool_point_m = pose.transform(&local);
        contact.tool_point_before_m = before.transform(&local);
        let tissue = contact.weights.sum(&body.velocity_m_per_s);
        contact.gap_predicted_m = contact.gap_before_m - body.dt_s() * tissue.dot(&contact.direction);
        let travel = (contact.tool_point_m - contact.tool_point_before_m).dot(&contact.direction);
        contact.gap_before_m -= travel;
        (contact.gap_predicted_m > -0.5 * body.grid.voxel_size_m()).then_some(contact)
    }
}
