//! One tool in one body: its front, its flanks and the elements near it.

use crate::body::Body;
use crate::contact::Contact;
use crate::contact::broad::{Aabb, SpatialHash};
use crate::contact::flank::Walls;
use crate::contact::friction::FlankFriction;
use crate::fracture::{BladeMotion, Front};

/// What one tool does in one body.
pub(super) struct ToolContact {
    pub(super) front: Front,
    pub(super) flanks: Vec<Contact>,
    pub(super) friction: Option<FlankFriction>,
    pub(super) hash: SpatialHash,
}

impl ToolContact {
    pub(super) fn lift(&mut self) {
        self.front.lift();
        self.flanks.clear();
        self.friction.iter_mut().for_each(|f| f.contacts.clear());
    }

    /// Number of springs that there may be at most against these walls.
    pub(super) fn most_springs(&self, walls: &Walls) -> usize {
        self.front.most_springs() + walls.len() * (1 + 2 * usize::from(self.friction.is_some()))
    }

    pub(super) fn springs(&self) -> impl Iterator<Item = &Contact> {
        let dragging = self.front.contacts.iter().map(|c| &c.along);
        self.pressing().chain(dragging).chain(self.rubbing())
    }

    /// The contacts that hold a pose: all that depends on where the tool is rather than on how it moves.
    pub(super) fn pressing(&self) -> impl Iterator<Item = &Contact> {
        self.front.contacts.iter().flat_map(|c| [&c.forward, &c.lateral]).chain(&self.flanks)
    }

    /// What rubs on the flanks.
    pub(super) fn rubbing(&self) -> impl Iterator<Item = &Contact> {
        self.friction.iter().flat_map(|f| &f.contacts)
    }

    pub(super) fn detect(&mut self, body: &Body, walls: &Walls, motion: &BladeMotion<'_>, entered: bool) {
        let edge_m = motion.blade.edge.points_m();
        let swept = edge_m.iter().flat_map(|at| [motion.before.transform(at), motion.pose.transform(at)]);
        self.hash.rebuild(body, &Aabb::around(swept).grown(body.grid.voxel_size_m()));
        if entered {
            self.front.enter(body, &self.hash, &motion.pose);
        }
        self.front.detect(body, &self.hash, motion);
        self.flanks.clear();
        if !walls.is_empty() {
            walls.contacts(body, &motion.blade.flanks, &motion.before, &motion.pose, &mut self.flanks);
        }
        if let Some(friction) = &mut self.friction {
            friction.detect(body, &self.flanks);
        }
    }
}
