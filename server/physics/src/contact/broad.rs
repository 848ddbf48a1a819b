//! Broad phase: a spatial hash of the deformed elements near a tool.

use crate::Vec3;
use crate::body::Body;

/// Axis-aligned box in the scene frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aabb {
    /// Lower corner, m.
    pub min_m: Vec3,
    /// Upper corner, m.
    pub max_m: Vec3,
}

impl Aabb {
    /// The smallest box around `points`.
    pub fn around(points: impl IntoIterator<Item = Vec3>) -> Self {
        let mut aabb = Self { min_m: Vec3::repeat(f64::INFINITY), max_m: Vec3::repeat(f64::NEG_INFINITY) };
        for p in points {
            aabb.min_m = aabb.min_m.inf(&p);
            aabb.max_m = aabb.max_m.sup(&p);
        }
        aabb
    }

    /// The box grown by `margin_m` on every side.
    #[must_use]
    pub fn grown(self, margin_m: f64) -> Self {
        Self { min_m: self.min_m.add_scalar(-margin_m), max_m: self.max_m.add_scalar(margin_m) }
    }

    /// Whether two boxes meet.
    #[must_use]
    pub fn meets(&self, other: &Self) -> bool {
        (0..3).all(|a| self.min_m[a] <= other.max_m[a] && other.min_m[a] <= self.max_m[a])
    }
}

/// Elements by the cells of space that their boxes cover, near one tool.
#[derive(Default)]
pub struct SpatialHash {
    cell_m: f64,
    /// (cell, element), sorted.
    entries: Vec<([i32; 3], u32)>,
}

impl SpatialHash {
    /// Fills the hash with the elements of `body` whose boxes meet `near`.
    pub fn rebuild(&mut self, body: &Body, near: &Aabb) {
        self.entries.clear();
        self.cell_m = body.element_edge_m();
        for (id, element) in body.base().elements.iter().enumerate() {
            let aabb = Aabb::around(element.nodes.iter().map(|n| body.position_m[*n as usize].into()));
            if !aabb.meets(near) {
                continue;
            }
            // Only what can be asked for: an inflated element does not flood the hash.
            let (low, high) = (self.cell(&aabb.min_m.sup(&near.min_m)), self.cell(&aabb.max_m.inf(&near.max_m)));
            for k in low[2]..=high[2] {
                for j in low[1]..=high[1] {
                    for i in low[0]..=high[0] {
                        self.entries.push(([i, j, k], id as u32));
                    }
                }
            }
        }
        self.entries.sort_unstable();
    }

    fn cell(&self, p: &Vec3) -> [i32; 3] {
        let c = p / self.cell_m;
        [c.x.floor() as i32, c.y.floor() as i32, c.z.floor() as i32]
    }

    /// Elements whose boxes cover the cell of a point, ascending.
    pub fn near(&self, point_m: &Vec3) -> impl Iterator<Item = u32> + '_ {
        let cell = self.cell(point_m);
        let start = self.entries.partition_point(|e| e.0 < cell);
        self.entries[start..].iter().take_while(move |e| e.0 == cell).map(|e| e.1)
    }

    /// Whether no element is near.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }
}
