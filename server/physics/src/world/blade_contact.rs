//! One blade in one body: its front, its flanks and the elements near it.

use crate::body::Body;
use crate::contact::Contact;
use crate::contact::broad::{Aabb, SpatialHash};
use crate::contact::flank::Walls;
use crate::fracture::{BladeMotion, Front, FrontBook};
use crate::grid::{Crossing, LinkId};
use crate::tool::ToolPath;
use crate::tool::blade::Blade;
use crate::tool::scissors::Mount;

/// What one blade of a tool does in one body.
#[derive(Clone)]
pub(super) struct BladeContact {
    blade: Blade,
    mount: Mount,
    pub(super) front: Front,
    pub(super) flanks: Vec<Contact>,
    hash: SpatialHash,
}

impl BladeContact {
    pub(super) fn new(blade: Blade, mount: Mount, body: &Body, pulled: bool) -> Self {
        let front = Front::new(&blade, body, pulled);
        Self { front, blade, mount, flanks: Vec::new(), hash: SpatialHash::default() }
    }

    pub(super) fn reserve(&mut self, walls: &Walls, elements: usize) {
        self.front.reserve();
        self.flanks.clear();
        self.flanks.reserve(walls.len());
        self.hash.reserve(elements);
    }

    pub(super) fn settle(&mut self, dt_s: f64, velocity_change: &[[f64; 3]]) -> bool {
        let mut changed = false;
        for front in &mut self.front.contacts {
            changed |= front.settle(dt_s, velocity_change);
        }
        for flank in &mut self.flanks {
            changed |= flank.settle(dt_s, velocity_change);
        }
        changed
    }

    pub(super) fn lift(&mut self) {
        self.front.lift();
        self.flanks.clear();
    }

    pub(super) fn springs(&self) -> impl Iterator<Item = &Contact> {
        self.front.contacts.iter().flat_map(|c| [&c.forward, &c.lateral]).chain(&self.flanks)
    }

    pub(super) fn detect(&mut self, body: &Body, walls: &Walls, path: &ToolPath) {
        let motion = motion(&self.blade, self.mount, path);
        let edge_m = motion.blade.edge.points_m();
        let swept = edge_m.iter().flat_map(|at| [motion.before.transform(at), motion.pose.transform(at)]);
        self.hash.rebuild(body, &Aabb::around(swept).grown(body.grid.voxel_size_m()));
        if path.entered {
            self.front.enter(body, &self.hash, &motion.pose);
        }
        self.front.detect(body, &self.hash, &motion);
        self.flanks.clear();
        if !walls.is_empty() {
            walls.contacts(body, &motion.blade.flanks, &motion.before, &motion.pose, &mut self.flanks);
        }
    }

    pub(super) fn advance(&mut self, body: &Body, path: &ToolPath, parting: &mut Vec<(LinkId, Crossing)>) -> FrontBook {
        self.front.advance(body, &motion(&self.blade, self.mount, path), parting)
    }
}

/// The blade and its own poses where its tool goes along `path`.
fn motion<'a>(blade: &'a Blade, mount: Mount, path: &ToolPath) -> BladeMotion<'a> {
    let before = mount.edge_pose(&path.before, path.opening_before);
    BladeMotion { blade, before, pose: mount.edge_pose(&path.pose, path.opening) }
}
