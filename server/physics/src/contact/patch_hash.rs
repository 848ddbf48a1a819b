//! Broad phase of tissue against tissue: a spatial hash of the patches of all surfaces.

use crate::Vec3;
use crate::body::Body;

/// A patch of a body's surface where it is now.
#[derive(Clone, Copy, Debug)]
pub struct PlacedPatch {
    /// Index of the body.
    pub body: u32,
    /// Index into the body's patches.
    pub patch: u32,
    /// Position, m, scene frame.
    pub at_m: Vec3,
    /// Velocity, m/s, scene frame.
    pub velocity_m_per_s: Vec3,
    /// Outward unit normal as its element has turned, scene frame.
    pub normal: Vec3,
}

impl PlacedPatch {
    /// A patch of a body, given by both their indices, with its nodes at `position_m`.
    #[must_use]
    pub fn of(body: &Body, position_m: &[[f64; 3]], [index, patch]: [u32; 2]) -> Self {
        let data = &body.boundary().patches()[patch as usize];
        let weights = body.weights(&data.point);
        Self {
            body: index,
            patch,
            at_m: weights.place_m(position_m),
            velocity_m_per_s: weights.sum(&body.state.velocity_m_per_s),
            normal: body.rotation(data.element as usize) * data.normal,
        }
    }
}

const NONE: u32 = u32::MAX;
/// Buckets per patch, at least: few cells then share one.
const BUCKETS_PER_PATCH: usize = 2;

fn buckets(patches: usize) -> usize {
    (BUCKETS_PER_PATCH * patches).next_power_of_two()
}

/// Patches by the cell of space that they lie in (Teschner et al. 2003).
#[derive(Clone, Debug, Default)]
pub struct PatchHash {
    cell_m: f64,
    placed: Vec<PlacedPatch>,
    cells: Vec<[i32; 3]>,
    /// First patch of each bucket, and the next one after each patch.
    heads: Vec<u32>,
    next: Vec<u32>,
}

impl PatchHash {
    /// Room for so many patches.
    pub fn reserve(&mut self, patches: usize) {
        let more = patches.saturating_sub(self.placed.len());
        self.placed.reserve(more);
        self.cells.reserve(more);
        self.next.reserve(more);
        self.heads.reserve(buckets(patches).saturating_sub(self.heads.len()));
    }

    /// Empties it.
    pub fn clear(&mut self) {
        self.placed.clear();
        self.cells.clear();
        self.next.clear();
    }

    /// Adds a patch; [`Self::build`] makes it found.
    pub fn push(&mut self, patch: PlacedPatch) {
        self.placed.push(patch);
    }

    /// The patches that were added.
    #[must_use]
    pub fn placed(&self) -> &[PlacedPatch] {
        &self.placed
    }

    /// Sorts the patches into cells twice as wide as `reach_m`.
    pub fn build(&mut self, reach_m: f64) {
        self.cell_m = 2.0 * reach_m;
        self.heads.clear();
        self.heads.resize(buckets(self.placed.len()), NONE);
        self.cells.clear();
        self.next.clear();
        for index in 0..self.placed.len() {
            let cell = self.cell(&self.placed[index].at_m);
            let bucket = self.bucket(cell);
            self.cells.push(cell);
            self.next.push(self.heads[bucket]);
            self.heads[bucket] = index as u32;
        }
    }

    fn cell(&self, at_m: &Vec3) -> [i32; 3] {
        let c = at_m / self.cell_m;
        [c.x.floor() as i32, c.y.floor() as i32, c.z.floor() as i32]
    }

    fn bucket(&self, cell: [i32; 3]) -> usize {
        let [i, j, k] = cell.map(|c| c as u32);
        let mixed = i.wrapping_mul(73_856_093) ^ j.wrapping_mul(19_349_663) ^ k.wrapping_mul(83_492_791);
        mixed as usize & (self.heads.len() - 1)
    }

    /// Index of every patch within `reach_m` of a point along each axis, in a fixed order.
    pub fn near(&self, at_m: Vec3, reach_m: f64) -> impl Iterator<Item = usize> + '_ {
        let (low, high) = (self.cell(&at_m.add_scalar(-reach_m)), self.cell(&at_m.add_scalar(reach_m)));
        let across = [0, 1, 2].map(|a| i64::from(high[a]) - i64::from(low[a]) + 1);
        let cells = across.into_iter().fold(1i64, i64::saturating_mul);
        // Where more cells than patches are within reach, all patches are looked at.
        let (all, cells) = if cells > self.placed.len() as i64 { (self.placed.len(), 0) } else { (0, cells) };
        let in_cells = (0..cells).flat_map(move |n| {
            let along = [n % across[0], n / across[0] % across[1], n / across[0] / across[1]];
            let cell = [0, 1, 2].map(|a| low[a] + along[a] as i32);
            let mut at = self.heads[self.bucket(cell)];
            std::iter::from_fn(move || {
                while at != NONE {
                    let index = at as usize;
                    at = self.next[index];
                    if self.cells[index] == cell {
                        return Some(index);
                    }
                }
                None
            })
        });
        in_cells.chain(0..all).filter(move |index| (self.placed[*index].at_m - at_m).amax() <= reach_m)
    }
}
