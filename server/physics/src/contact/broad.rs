//! Broad phase: a spatial hash of the deformed elements near a tool.

use crate::Vec3;
use crate::body::Body;
use crate::math::Aabb;

/// Elements that there is room for before any is near. A tool is near a few hundred where elements are a tenth of its
/// width; a step that finds more allocates, once.
const ROOM_FOR_ELEMENTS: usize = 512;

/// Elements by the cells of space that their boxes cover, near one tool.
#[derive(Clone, Default)]
pub struct SpatialHash {
    cell_m: f64,
    /// Elements near the tool and their boxes, ascending.
    boxes: Vec<(u32, Aabb)>,
    /// (cell, index into `boxes`), sorted.
    entries: Vec<([i32; 3], u32)>,
}

impl SpatialHash {
    /// Room for the elements of a body, but for no more than [`ROOM_FOR_ELEMENTS`]: one of about the size of a cell
    /// covers up to eight cells.
    pub fn reserve(&mut self, elements: usize) {
        let elements = elements.min(ROOM_FOR_ELEMENTS);
        self.boxes.clear();
        self.boxes.reserve(elements);
        self.entries.clear();
        self.entries.reserve(8 * elements);
    }

    /// Fills the hash with the elements of `body` whose boxes meet `near`.
    pub fn rebuild(&mut self, body: &Body, near: &Aabb) {
        self.rebuild_near(body, [*near]);
    }

    /// Fills the hash with the elements of `body` whose boxes meet any of those; returns which of them are met.
    pub fn rebuild_near<const N: usize>(&mut self, body: &Body, near: [Aabb; N]) -> [bool; N] {
        self.boxes.clear();
        self.entries.clear();
        self.cell_m = body.lattice_edge_m();
        // The surface is up to so far beyond the voxels that elements are made of.
        let skin_m = 0.5 * body.state.grid.voxel_size_m();
        let mut met = [false; N];
        for id in body.elements_near(near) {
            let aabb = body.element_box(id).grown(skin_m);
            for (near, met) in near.iter().zip(&mut met).filter(|(near, _)| aabb.meets(near)) {
                *met = true;
                // Only what can be asked for: an inflated element does not flood the hash.
                let (low, high) = (self.cell(&aabb.min_m.sup(&near.min_m)), self.cell(&aabb.max_m.inf(&near.max_m)));
                for k in low[2]..=high[2] {
                    for j in low[1]..=high[1] {
                        for i in low[0]..=high[0] {
                            self.entries.push(([i, j, k], self.boxes.len() as u32));
                        }
                    }
                }
            }
            self.boxes.push((id as u32, aabb));
        }
        // Where two of those places meet, an element was entered twice.
        self.entries.sort_unstable();
        self.entries.dedup();
        met
    }

    fn cell(&self, p: &Vec3) -> [i32; 3] {
        let c = p / self.cell_m;
        [c.x.floor() as i32, c.y.floor() as i32, c.z.floor() as i32]
    }

    /// Elements whose boxes hold a point, ascending.
    pub fn around(&self, point_m: &Vec3) -> impl Iterator<Item = u32> + '_ {
        let (cell, point) = (self.cell(point_m), Aabb { min_m: *point_m, max_m: *point_m });
        let start = self.entries.partition_point(|e| e.0 < cell);
        let same_cell = self.entries[start..].iter().take_while(move |e| e.0 == cell);
        same_cell.map(|e| &self.boxes[e.1 as usize]).filter(move |b| b.1.meets(&point)).map(|b| b.0)
    }
}
