//! Narrow phase: where a point of a tool is in the material, by signed distance in the reference
//! configuration.

use super::broad::NearElements;
use crate::Vec3;
use crate::body::Body;
use crate::grid::{Grid, MaterialPoint, VoxelId};

/// A point within this fraction of an element's edge of its boundary is in it, so that rounding does not put
/// a point between two elements into neither. Rounding is some 1e-13 of an edge.
const BOUNDARY: f64 = 1e-9;

/// The material point that lies at a scene position, if it is inside the tissue: behind the object's own surface, in an
/// element that maps it there and that carries it.
#[must_use]
pub fn locate(body: &Body, near: &NearElements, point_m: &Vec3) -> Option<MaterialPoint> {
    let grid = &body.state.grid;
    near.around(point_m).find_map(|element| {
        let position_m = body.invert_map(element as usize, point_m)?;
        let middle_m = body.rest_centre_m(element as usize);
        let drawn_in_m = position_m + (middle_m - position_m) * BOUNDARY;
        let carries = |voxel: &VoxelId| body.element_of(*voxel) == element as usize;
        let own = grid.voxel_at(grid.cell_of(&drawn_in_m));
        if own.is_some_and(|voxel| !carries(&voxel)) || grid.signed_distance_m(&position_m) >= 0.0 {
            return None;
        }
        let voxel = own.or_else(|| voxel_behind(grid, &drawn_in_m, carries))?;
        Some(MaterialPoint { position_m, voxel })
    })
}

/// The nearest of such voxels to a reference position between the surface and a voxel whose centre is outside.
fn voxel_behind(grid: &Grid, position_m: &Vec3, is_such: impl Fn(&VoxelId) -> bool) -> Option<VoxelId> {
    let cell = grid.cell_of(position_m);
    let is_outside = grid.signed_distance_m(&grid.centre_m(cell)) >= 0.0;
    let distance_m = |voxel: &VoxelId| (grid.centre_m(grid.voxels()[voxel.index()].ijk) - position_m).norm();
    let around = grid.voxels_around(cell).filter(|voxel| is_outside && is_such(voxel));
    around.min_by(|a, b| distance_m(a).total_cmp(&distance_m(b)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Aabb;

    const BALL: &str = r#"
version = 1
name = "ball"
[[objects]]
name = "ball"
shape = { ellipsoid = { center_m = [0.0, 0.0, 0.0], semi_axes_m = [0.03, 0.03, 0.03] } }
voxel_size_m = 0.0025
level = 2
material = { young_modulus_pa = 1e5, poisson_ratio = 0.4 }
"#;

    #[test]
    fn what_is_behind_the_surface_is_in_the_tissue_and_what_is_before_it_is_not() {
        let body = Body::of_text(BALL);
        let mut near = NearElements::default();
        near.find(&body, [Aabb::around([Vec3::repeat(-0.04), Vec3::repeat(0.04)])]);
        let h = body.state.grid.voxel_size_m();
        for turn in 0..2000 {
            // Evenly over the sphere.
            let y = (f64::from(turn) + 0.5) / 1000.0 - 1.0;
            let (sin, cos) = (2.4 * f64::from(turn)).sin_cos();
            let out = Vec3::new(cos * (1.0 - y * y).sqrt(), y, sin * (1.0 - y * y).sqrt());
            // The surface is trilinear between the centres of voxels.
            let [inside, outside] = [-0.1, 0.1].map(|off| locate(&body, &near, &(out * (0.03 + off * h))));
            assert!(inside.is_some() && outside.is_none(), "{out:?}: {inside:?}, {outside:?}");
        }
    }
}
