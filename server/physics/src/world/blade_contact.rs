//! One blade in one body: its front, its flanks and the elements near it.

use crate::body::Body;
use crate::contact::broad::NearElements;
use crate::contact::flank::WallsBeside;
use crate::contact::{Contact, Misjudged, Mode, Solution};
use crate::fracture::{BladeMotion, Crack, Front, FrontBook, Tissue};
use crate::grid::{Crossing, LinkId};
use crate::grow::make_room;
use crate::solve::spring::ROOM_FOR_SPRINGS;
use crate::tool::ToolPath;
use crate::tool::blade::Blade;
use crate::tool::scissors::Mount;
use crate::view::Touch;
use crate::walk::Kept;
use serde::{Deserialize, Serialize};

/// What one blade of a tool does in one body.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct BladeContact {
    blade: Kept<Blade>,
    mount: Mount,
    pub(super) front: Front,
    pub(super) flanks: Vec<Contact>,
    beside: WallsBeside,
    #[serde(skip)]
    near: NearElements,
}

impl BladeContact {
    pub(super) fn new(blade: Blade, mount: Mount, body: &Body) -> Self {
        let front = Front::new(&blade, body);
        Self {
            front,
            blade: blade.into(),
            mount,
            flanks: Vec::new(),
            beside: WallsBeside::default(),
            near: NearElements::default(),
        }
    }

    pub(super) fn scale_penalties(&mut self, factor: f64) {
        self.blade.penalty_factor = factor;
    }

    pub(super) fn reserve(&mut self, walls: usize, elements: usize) {
        self.front.reserve();
        make_room(&mut self.flanks, walls.min(ROOM_FOR_SPRINGS));
        self.beside.reserve(walls);
        self.near.reserve(elements);
    }

    pub(super) fn settle(&mut self, dt_s: f64, velocity_change: &[[f64; 3]], solution: Solution) -> Misjudged {
        let mut wrong = Misjudged::default();
        if solution.is_solved() {
            for front in &mut self.front.contacts {
                wrong += front.settle(dt_s, velocity_change, solution);
            }
        }
        for flank in &mut self.flanks {
            wrong += flank.settle(dt_s, &flank.ends.weights.sum(velocity_change), solution);
        }
        wrong
    }

    pub(super) fn come_to_rest(&mut self) {
        let of_front = self.front.contacts.iter_mut().flat_map(|c| [&mut c.forward, &mut c.lateral, &mut c.along]);
        of_front.chain(&mut self.flanks).for_each(Contact::stay);
    }

    pub(super) fn lift(&mut self) {
        self.front.lift();
        self.flanks.clear();
        self.beside.clear();
    }

    /// Number of springs that there is room for against so many walls.
    pub(super) fn most_springs(&self, walls: usize) -> usize {
        self.front.most_springs() + walls.min(ROOM_FOR_SPRINGS)
    }

    pub(super) fn springs(&self) -> impl Iterator<Item = &Contact> {
        let dragging = self.front.contacts.iter().map(|c| &c.along);
        self.pressing().chain(dragging)
    }

    /// Those that hold a pose.
    pub(super) fn pressing(&self) -> impl Iterator<Item = &Contact> {
        self.front.contacts.iter().flat_map(|c| [&c.forward, &c.lateral]).chain(&self.flanks)
    }

    /// Finds what it touches.
    pub(super) fn detect(&mut self, body: &Body, crack: &Crack, path: &ToolPath) {
        let motion = motion(&self.blade, self.mount, path);
        let poses = [&motion.before, &motion.pose];
        let swept = motion.blade.swept_boxes(poses, body.state.grid.voxel_size_m());
        let met = self.near.find(body, swept);
        let tissue = Tissue { body, near: &self.near, crack };
        if path.entered {
            self.front.enter(&tissue, &motion);
        }
        self.front.detect(&tissue, &motion, met);
        self.beside.contacts(body, &motion.blade.flanks, poses, &mut self.flanks);
        for flank in &mut self.flanks {
            flank.stiffness_n_per_m *= self.blade.penalty_factor;
            flank.rub(body, self.blade.flank_friction.unwrap_or_default());
        }
    }

    /// Whether the edge is in the tissue or a flank at a wall of a cut.
    pub(super) fn touches(&self) -> bool {
        !self.front.contacts.is_empty() || self.flanks.iter().any(|flank| flank.mode != Mode::Off)
    }

    /// Where the blade stands in the tissue, for those who look.
    pub(super) fn touch(&self, body: &Body, path: &ToolPath) -> Touch<'_> {
        let depths_m = self.front.contacts.iter().map(|contact| {
            let forward = &contact.forward;
            (forward.ends.tool_point_m - forward.ends.weights.place_m(&body.state.position_m)).dot(&forward.direction)
        });
        let depth_m = depths_m.fold(0.0, f64::max);
        Touch { blade: &self.blade, pose: motion(&self.blade, self.mount, path).pose, depth_m }
    }

    pub(super) fn advance(
        &mut self,
        (body, crack): (&Body, &mut Crack),
        path: &ToolPath,
        in_tension: bool,
        parting: &mut Vec<(LinkId, Crossing)>,
    ) -> FrontBook {
        self.front.advance(body, crack, &motion(&self.blade, self.mount, path), in_tension, parting)
    }
}

/// The blade and its own poses where its tool goes along `path`.
fn motion<'a>(blade: &'a Blade, mount: Mount, path: &ToolPath) -> BladeMotion<'a> {
    let before = mount.edge_pose(&path.before, path.opening_before);
    BladeMotion { blade, before, pose: mount.edge_pose(&path.pose, path.opening) }
}
