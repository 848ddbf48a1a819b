//! One tool in one body: its front, its flanks and the elements near it.

use crate::Vec3;
use crate::body::Body;
use crate::contact::broad::{Aabb, SpatialHash};
use crate::contact::flank::Walls;
use crate::contact::{Contact, Mode};
use crate::fracture::{BladeMotion, Front};

/// What one tool does in one body.
pub(super) struct ToolContact {
    pub(super) front: Front,
    pub(super) flanks: Vec<Contact>,
    pub(super) hash: SpatialHash,
}

impl ToolContact {
    pub(super) fn lift(&mut self) {
        self.front.lift();
        self.flanks.clear();
    }

    /// Whether the edge is in the tissue or a flank at a wall of a cut.
    pub(super) fn touches(&self) -> bool {
        !self.front.contacts.is_empty() || self.flanks.iter().any(|flank| flank.mode != Mode::Off)
    }

    /// How far the edge has gone past the points it presses on, at most, m.
    pub(super) fn deepest_m(&self, body: &Body) -> f64 {
        let depths = self.front.contacts.iter().map(|contact| {
            let forward = &contact.forward;
            (forward.tool_point_m - forward.weights.sum(&body.position_m)).dot(&forward.direction)
        });
        depths.fold(0.0, f64::max)
    }

    pub(super) fn springs(&self) -> impl Iterator<Item = &Contact> {
        self.front.contacts.iter().flat_map(|c| [&c.forward, &c.lateral]).chain(&self.flanks)
    }

    pub(super) fn detect(&mut self, body: &Body, walls: &Walls, motion: &BladeMotion<'_>, entered: bool) {
        let half = 0.5 * motion.blade.width_m;
        let ends = [motion.before, motion.pose]
            .into_iter()
            .flat_map(|pose| [-half, half].map(|x| pose.transform(&Vec3::new(x, 0.0, 0.0))));
        self.hash.rebuild(body, &Aabb::around(ends).grown(body.grid.voxel_size_m()));
        if entered {
            self.front.enter(body, &self.hash, motion.blade, &motion.pose);
        }
        self.front.detect(body, &self.hash, motion);
        self.flanks.clear();
        if !walls.is_empty() {
            walls.contacts(body, motion.blade, &motion.before, &motion.pose, &mut self.flanks);
        }
    }
}
