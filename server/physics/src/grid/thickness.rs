//! Where an object is thin: limbs, necks and sheets that a level has few elements across for.

use super::{Grid, Ijk};

/// Distance that stands for "no such cell", in voxels squared; larger than any in a grid.
const FAR: f32 = 1e12;
/// A limb juts out of the balls in the object by more than the corner of a box does: so far from their middles, in their
/// radii, where the corner is at the square root of three.
const BEYOND_CORNERS: f32 = 1.75;
/// So much of what bears a limb goes with it, in radii: where the limb bends most. Three necks of 1.1 to 2.3 elements
/// are off by 13.5, 8.7 and 5.9 % without it, by 1.4, 5.4 and 3.2 % with it, by little less with twice as much.
const ROOT: f32 = 0.5;
/// What a ball may be smaller, in voxels: its middle lies between voxels.
const ROUNDED: f32 = 0.25;

/// How thick an object is around each of its voxels.
pub struct Thickness<'a> {
    grid: &'a Grid,
    to_outside: Distances,
}

impl<'a> Thickness<'a> {
    /// Of what a grid holds.
    #[must_use]
    pub fn of(grid: &'a Grid) -> Self {
        Self { grid, to_outside: Distances::to_cells(grid, |cell| grid.voxel_at(cell).is_none()) }
    }

    /// For each voxel whether the object is thinner there than this: whether it lies in no ball of this diameter in the
    /// object, but in what juts out of such balls farther than corners do, or beside that.
    #[must_use]
    pub fn thinner_than(&self, thickness_m: f64) -> Vec<bool> {
        let Self { grid, to_outside } = self;
        let radius = (thickness_m / grid.voxel_size_m() / 2.0) as f32;
        let to_middles = Distances::to_cells(grid, |cell| to_outside.squared(cell) >= (radius - ROUNDED).powi(2));
        let is_beyond = |cell: Ijk, radii: f32| to_middles.squared(cell) > (radii * radius).powi(2);
        let to_limbs =
            Distances::to_cells(grid, |cell| grid.voxel_at(cell).is_some() && is_beyond(cell, BEYOND_CORNERS));
        let is_thin = |cell: Ijk| is_beyond(cell, 1.0) && to_limbs.squared(cell) <= (BEYOND_CORNERS * radius).powi(2);
        let to_thin = Distances::to_cells(grid, |cell| grid.voxel_at(cell).is_some() && is_thin(cell));
        grid.voxels().iter().map(|voxel| to_thin.squared(voxel.ijk) <= (ROOT * radius).powi(2)).collect()
    }
}

/// Squared distance of each cell's centre to the nearest of some cells', in voxels, over the box `-1..dims + 1`
/// (Felzenszwalb and Huttenlocher 2012).
pub(super) struct Distances {
    dims: [usize; 3],
    squared: Vec<f32>,
}

impl Distances {
    pub(super) fn to_cells(grid: &Grid, is_one: impl Fn(Ijk) -> bool) -> Self {
        let dims = grid.dims().map(|d| d as usize + 2);
        let mut squared = Vec::with_capacity(dims.iter().product());
        for z in 0..dims[2] {
            for y in 0..dims[1] {
                squared.extend((0..dims[0]).map(|x| if is_one([x, y, z].map(|c| c as i32 - 1)) { 0.0 } else { FAR }));
            }
        }
        let mut line = Vec::new();
        for (axis, stride) in [1, dims[0], dims[0] * dims[1]].into_iter().enumerate() {
            for first in (0..squared.len()).filter(|slot| slot / stride % dims[axis] == 0) {
                let slots = (0..dims[axis]).map(|i| first + i * stride);
                line.clear();
                line.extend(slots.clone().map(|slot| squared[slot]));
                lower_envelope(&line, slots, &mut squared);
            }
        }
        Self { dims, squared }
    }

    /// Whether a cell, which may lie outside of the box, is one of those or meets one by a face, an edge or a corner.
    pub(super) fn is_beside(&self, cell: Ijk) -> bool {
        (0..3).all(|a| (-1..=self.dims[a] as i32 - 2).contains(&cell[a])) && self.squared(cell) < 3.5
    }

    fn squared(&self, cell: Ijk) -> f32 {
        let [x, y, z] = cell.map(|c| (c + 1) as usize);
        self.squared[(z * self.dims[1] + y) * self.dims[0] + x]
    }
}

/// Sets `values` at `slots` to the least over `j` of `line[j] + (i - j)^2`.
fn lower_envelope(line: &[f32], slots: impl Iterator<Item = usize>, values: &mut [f32]) {
    // The parabolas that are lowest somewhere, each from where on it is.
    let mut lowest: Vec<(usize, f32)> = Vec::with_capacity(line.len());
    for (j, height) in line.iter().enumerate().filter(|(_, height)| **height < FAR) {
        let from = loop {
            let Some(&(last, from)) = lowest.last() else { break f32::NEG_INFINITY };
            let (a, b) = (last as f32, j as f32);
            let meets = ((height + b * b) - (line[last] + a * a)) / (2.0 * (b - a));
            if meets > from {
                break meets;
            }
            lowest.pop();
        };
        lowest.push((j, from));
    }
    let mut at = 0;
    for (i, slot) in slots.enumerate() {
        while lowest.get(at + 1).is_some_and(|(_, from)| *from < i as f32) {
            at += 1;
        }
        values[slot] = lowest.get(at).map_or(FAR, |(j, _)| line[*j] + (i as f32 - *j as f32).powi(2));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::voxelize::voxelize;
    use crate::scene::{Meshes, object_of};

    fn voxels_of(shape: &str) -> Grid {
        voxelize(&object_of(shape), &Meshes::new()).unwrap()
    }

    fn share_thinner(grid: &Grid, thickness_m: f64) -> f64 {
        let thin = Thickness::of(grid).thinner_than(thickness_m);
        thin.iter().filter(|is_thin| **is_thin).count() as f64 / thin.len() as f64
    }

    #[test]
    fn boxes_sheets_and_cylinders_are_as_thick_as_they_are() {
        for (shape, thickness_m) in [
            ("{ box = { min_m = [0.0, 0.0, 0.0], max_m = [24.0, 30.0, 12.0] } }", 12.0),
            ("{ box = { min_m = [0.0, 0.0, 0.0], max_m = [40.0, 30.0, 5.0] } }", 5.0),
            ("{ capsule = { from_m = [0.2, 0.1, 0.0], to_m = [40.3, 10.0, 5.0], radius_m = 6.0 } }", 12.0),
            ("{ sphere = { center_m = [0.3, 0.2, 0.1], radius_m = 9.0 } }", 18.0),
        ] {
            let grid = voxels_of(shape);
            assert_eq!(
                share_thinner(&grid, thickness_m - 1.5),
                0.0,
                "{shape}: thicker than a thinner one, at corners too"
            );
            assert_eq!(share_thinner(&grid, thickness_m + 2.0), 1.0, "{shape}: thinner than a thicker one");
        }
    }

    #[test]
    fn of_two_balls_with_a_neck_the_neck_is_thin() {
        let ball = |x: f64| format!("{{ sphere = {{ center_m = [{x:?}, 0.0, 0.0], radius_m = 10.0 }} }}");
        let neck = "{ capsule = { from_m = [-16.0, 0.0, 0.0], to_m = [16.0, 0.0, 0.0], radius_m = 3.0 } }";
        let parts = [ball(-20.0), ball(20.0), neck.to_owned()].join(", ");
        let grid = voxels_of(&format!("{{ smooth_union = {{ blend_m = 0.5, parts = [{parts}] }} }}"));
        for (voxel, is_thin) in grid.voxels().iter().zip(Thickness::of(&grid).thinner_than(10.0)) {
            let x = grid.centre_m(voxel.ijk).x;
            assert!(!is_thin || x.abs() < 13.0, "a ball is no neck: {x}");
            assert!(is_thin || x.abs() > 9.0, "the neck is thin: {x}");
        }
    }
}
