//! Broad phase: the boxes of the deformed elements near a tool.

use crate::Vec3;
use crate::body::Body;
use crate::grow::make_room;
use crate::math::Aabb;

/// Elements that there is room for before any is near. A tool is near a few hundred where elements are a tenth of its
/// width; a step that finds more allocates, once.
const ROOM_FOR_ELEMENTS: usize = 512;
/// Elements with a box around all of them: neighbours in number are mostly neighbours in space.
const GROUP: usize = 16;

/// Elements near one tool.
#[derive(Clone, Default)]
pub struct NearElements {
    /// They and their boxes, ascending.
    boxes: Vec<(u32, Aabb)>,
    /// Boxes around groups of them.
    groups: Vec<Aabb>,
}

impl NearElements {
    /// Room for the elements of a body, but for no more than [`ROOM_FOR_ELEMENTS`].
    pub fn reserve(&mut self, elements: usize) {
        let elements = elements.min(ROOM_FOR_ELEMENTS);
        self.boxes.clear();
        make_room(&mut self.boxes, elements);
        self.groups.clear();
        make_room(&mut self.groups, elements.div_ceil(GROUP));
    }

    /// Finds the elements of `body` whose boxes meet any of `near`; returns which of those are met.
    pub fn find<const N: usize>(&mut self, body: &Body, near: [Aabb; N]) -> [bool; N] {
        self.boxes.clear();
        // The surface is up to so far beyond the voxels that elements are made of.
        let skin_m = 0.5 * body.state.grid.voxel_size_m();
        let mut met = [false; N];
        for id in body.elements_near(near) {
            let aabb = body.element_box(id).grown(skin_m);
            let meets = near.map(|near| aabb.meets(&near));
            if meets.contains(&true) {
                self.boxes.push((id as u32, aabb));
                (0..N).for_each(|i| met[i] |= meets[i]);
            }
        }
        let around = |group: &[(u32, Aabb)]| group.iter().fold(Aabb::around([]), |all, (_, one)| all.with(one));
        self.groups.clear();
        self.groups.extend(self.boxes.chunks(GROUP).map(around));
        met
    }

    /// Elements whose boxes hold a point, ascending.
    pub fn around(&self, point_m: &Vec3) -> impl Iterator<Item = u32> {
        let groups = self.groups.iter().zip(self.boxes.chunks(GROUP));
        let met = groups.filter(|(group, _)| group.contains(point_m)).flat_map(|(_, boxes)| boxes);
        met.filter(|(_, aabb)| aabb.contains(point_m)).map(|(id, _)| *id)
    }
}
