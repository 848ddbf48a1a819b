//! Where a segment of an edge comes into the tissue on its way from one pose to the next.

use crate::Vec3;
use crate::body::Body;
use crate::contact::broad::NearElements;
use crate::contact::narrow;
use crate::grid::MaterialPoint;

/// Voxels between the points of the way that are looked at: a sheet of one voxel is not jumped, which twice of it
/// may. Half costs twice the looks. Strokes into thick tissue do not change by a bit.
const SPACING_VOXELS: f64 = 0.5;
/// Points of a way at most: 17 mm, a step of a metre per second at 60 Hz, in voxels of 0.13 mm.
const MOST_POINTS: f64 = 256.0;

/// The first point of a way that is in the tissue.
pub(super) struct WayIn {
    /// Where it is in the material.
    pub(super) point: MaterialPoint,
    /// Where it is, and the last point before it that was looked at, m, scene frame.
    pub(super) at_m: Vec3,
    pub(super) last_m: Vec3,
    /// Fraction of the way between the two.
    pub(super) fraction: f64,
}

/// The way in between two positions; the tissue as it is at the beginning of the step.
pub(super) fn way_in(body: &Body, near: &NearElements, before_m: &Vec3, now_m: &Vec3) -> Option<WayIn> {
    let way_m = now_m - before_m;
    let count = (way_m.norm() / (SPACING_VOXELS * body.state.grid.voxel_size_m())).ceil().clamp(1.0, MOST_POINTS);
    let fraction = 1.0 / count;
    let mut last_m = *before_m;
    for step in 1..=count as u32 {
        let left = fraction * (count - f64::from(step));
        let at_m = now_m - way_m * left;
        if let Some(point) = narrow::locate(body, near, &at_m) {
            return Some(WayIn { point, at_m, last_m, fraction });
        }
        last_m = at_m;
    }
    None
}
