//! Broad phase of tissue against tissue: a spatial hash of points (Teschner et al. 2003).

use crate::Vec3;
use crate::grow::make_room;

const NONE: u32 = u32::MAX;
/// Buckets per point, at least: few cells then share one.
const BUCKETS_PER_POINT: usize = 2;

fn buckets(points: usize) -> usize {
    (BUCKETS_PER_POINT * points).next_power_of_two()
}

/// Points by the cell of space that they lie in.
#[derive(Debug, Default)]
pub(super) struct PointHash {
    cells_per_m: f64,
    points: Vec<Point>,
    /// First point of each bucket.
    heads: Vec<u32>,
}

#[derive(Clone, Copy, Debug)]
struct Point {
    at_m: Vec3,
    cell: [i32; 3],
    /// What it is called outside.
    name: u32,
    /// The next one of its bucket.
    next: u32,
}

impl PointHash {
    /// Room for so many points.
    pub(super) fn reserve(&mut self, points: usize) {
        make_room(&mut self.points, points);
        make_room(&mut self.heads, buckets(points));
    }

    /// Sorts points, each with its name, into cells twice as wide as `reach_m`.
    pub(super) fn build(&mut self, points: impl Iterator<Item = (u32, Vec3)>, reach_m: f64) {
        self.cells_per_m = 0.5 / reach_m;
        self.points.clear();
        let cells_per_m = self.cells_per_m;
        self.points.extend(points.map(|(name, at_m)| Point { at_m, cell: cell(&at_m, cells_per_m), name, next: NONE }));
        self.heads.clear();
        self.heads.resize(buckets(self.points.len()), NONE);
        for index in 0..self.points.len() {
            let bucket = self.bucket(self.points[index].cell);
            self.points[index].next = self.heads[bucket];
            self.heads[bucket] = index as u32;
        }
    }

    fn bucket(&self, cell: [i32; 3]) -> usize {
        let [i, j, k] = cell.map(|c| c as u32);
        let mixed = i.wrapping_mul(73_856_093) ^ j.wrapping_mul(19_349_663) ^ k.wrapping_mul(83_492_791);
        mixed as usize & (self.heads.len() - 1)
    }

    /// Name of every point within `reach_m` of another along each axis, in a fixed order.
    pub(super) fn near(&self, at_m: Vec3, reach_m: f64) -> impl Iterator<Item = usize> + '_ {
        let [low, high] = [-reach_m, reach_m].map(|by_m| cell(&at_m.add_scalar(by_m), self.cells_per_m));
        let across = [0, 1, 2].map(|a| i64::from(high[a]) - i64::from(low[a]) + 1);
        let cells = across.into_iter().fold(1i64, i64::saturating_mul);
        // Where more cells than points are within reach, all points are looked at.
        let (all, cells) = if cells > self.points.len() as i64 { (self.points.len(), 0) } else { (0, cells) };
        let in_cells = (0..cells).flat_map(move |n| {
            let along = [n % across[0], n / across[0] % across[1], n / across[0] / across[1]];
            let cell = [0, 1, 2].map(|a| low[a] + along[a] as i32);
            let mut at = self.heads[self.bucket(cell)];
            std::iter::from_fn(move || {
                while at != NONE {
                    let point = &self.points[at as usize];
                    at = point.next;
                    if point.cell == cell {
                        return Some(point);
                    }
                }
                None
            })
        });
        in_cells
            .chain(&self.points[..all])
            .filter(move |point| (point.at_m - at_m).amax() <= reach_m)
            .map(|point| point.name as usize)
    }
}

fn cell(at_m: &Vec3, cells_per_m: f64) -> [i32; 3] {
    (at_m * cells_per_m).map(|c| c.floor() as i32).into()
}
