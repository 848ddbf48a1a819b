//! Where an edge comes in through the object's own surface, by the grid's signed distance.

use crate::Vec3;
use crate::body::Body;

/// A surface faces the edge where the cosine between its inward normal and the cutting direction is above this, 78
/// degrees and less. Ours: an edge that slides along a side does not come in there. Half or twice changes no bit of a
/// stroke that comes down on a top.
const FACING: f64 = 0.2;
/// Quarters of a voxel over which the surface is looked for: a thousand voxels, more than an object has
/// across. In an element that is inflated without bounds a step back is next to none in the material.
const MOST_SEARCH_STEPS: u32 = 4000;

/// The point of the object's surface behind `inside` along `-back`, at most about `approach` away in
/// scene distance; where there is none the edge came in through a cut, `approach` back.
pub(super) fn surface_behind(body: &Body, inside: Vec3, back: Vec3, approach: f64) -> Vec3 {
    let h = body.state.grid.voxel_size_m();
    let distance = |s: f64| body.state.grid.signed_distance_m(&(inside - back * s));
    let reach = 1.5 * approach + 0.5 * h;
    let step = 0.25 * h;
    let (mut low, mut high) = (0.0, step);
    let mut steps = 0;
    while distance(high) < 0.0 {
        steps += 1;
        if high > reach || steps > MOST_SEARCH_STEPS {
            return inside - back * approach;
        }
        (low, high) = (high, high + step);
    }
    for _ in 0..30 {
        let middle = 0.5 * (low + high);
        if distance(middle) < 0.0 { low = middle } else { high = middle }
    }
    inside - back * low
}

/// Gradient of the signed distance over a voxel around `at`.
fn outward(body: &Body, at: &Vec3) -> Vec3 {
    let grid = &body.state.grid;
    let h = grid.voxel_size_m();
    Vec3::from_fn(|a, _| {
        let offset = Vec3::from_fn(|b, _| if a == b { 0.5 * h } else { 0.0 });
        (grid.signed_distance_m(&(at + offset)) - grid.signed_distance_m(&(at - offset))) / h
    })
}

/// Unit normal into the object's surface at `at`, looked for half a voxel `toward` the inside: a flat side
/// of the object may be where the grid's samples end. `None` where distance has no direction.
pub(super) fn inward(body: &Body, at: &Vec3, toward: &Vec3) -> Option<Vec3> {
    let normal = outward(body, &(at + toward * (0.5 * body.state.grid.voxel_size_m())));
    let finite = normal.iter().all(|c| c.is_finite());
    normal.try_normalize(0.1).filter(|_| finite).map(|outward| -outward)
}

/// Whether `at` is on the object's surface.
pub(super) fn is_on_surface(body: &Body, at: &Vec3) -> bool {
    body.state.grid.signed_distance_m(at) > -0.25 * body.state.grid.voxel_size_m()
}

/// Whether the surface at `at` runs along the direction `ahead`, rather than facing it.
pub(super) fn grazes(body: &Body, at: &Vec3, ahead: &Vec3) -> bool {
    let normal = outward(body, at);
    normal.dot(ahead) > -FACING * normal.norm() * ahead.norm()
}

/// Moves a reference point to the object's surface along the signed distance's gradient.
pub(super) fn onto_surface(body: &Body, at: Vec3) -> Vec3 {
    let grid = &body.state.grid;
    let gradient = outward(body, &at);
    let size2 = gradient.norm_squared();
    if size2.is_finite() && size2 > 0.01 { at - gradient * (grid.signed_distance_m(&at) / size2) } else { at }
}
