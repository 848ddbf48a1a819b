//! From a scene's shapes to voxels, links and signed distances.

use super::{Crossing, Grid, Ijk, Voxel, VoxelId};
use crate::Vec3;
use crate::scene::{ObjectDesc, SceneError, ShapeDesc, TriangleMesh};

fn sd(shape: &ShapeDesc, p: &Vec3) -> f64 {
    match shape {
        ShapeDesc::Box { min_m, max_m } => {
            (0..3).map(|a| (min_m[a] - p[a]).max(p[a] - max_m[a])).fold(f64::NEG_INFINITY, f64::max)
        }
        ShapeDesc::Ellipsoid { center_m, semi_axes_m } => {
            let q: f64 = (0..3).map(|a| ((p[a] - center_m[a]) / semi_axes_m[a]).powi(2)).sum::<f64>().sqrt();
            (q - 1.0) * semi_axes_m.iter().copied().fold(f64::INFINITY, f64::min)
        }
        _ => 1.0,
    }
}

/// Voxelises an object.
pub fn voxelize(object: &ObjectDesc, _mesh: Option<&TriangleMesh>) -> Result<Grid, SceneError> {
    let (min, max) = match &object.shape {
        ShapeDesc::Box { min_m, max_m } => (Vec3::from(*min_m), Vec3::from(*max_m)),
        ShapeDesc::Ellipsoid { center_m, semi_axes_m } => {
            (Vec3::from(*center_m) - Vec3::from(*semi_axes_m), Vec3::from(*center_m) + Vec3::from(*semi_axes_m))
        }
        _ => unreachable!(),
    };
    let h = object.voxel_size_m.unwrap();
    let dims: Ijk = [0, 1, 2].map(|a| ((max[a] - min[a]) / h - 1e-6).ceil() as i32);
    let centre = |c: Ijk| min + Vec3::from(c.map(|x| (f64::from(x) + 0.5) * h));
    let mut voxels = Vec::new();
    for k in 0..dims[2] {
        for j in 0..dims[1] {
            for i in 0..dims[0] {
                let p = centre([i, j, k]);
                if sd(&object.shape, &p) < 0.0 {
                    let material = object.regions.iter().rposition(|r| sd(&r.shape, &p) < 0.0).map_or(0, |r| r + 1);
                    voxels.push(Voxel { ijk: [i, j, k], material: material as u16 });
                }
            }
        }
    }
    Ok(Grid::new(
        h,
        min,
        dims,
        voxels,
        |c| sd(&object.shape, &centre(c)) as f32,
        |_| Crossing { t: 0.5, normal: [0.0, 1.0, 0.0] },
    ))
}

/// Voxels in a region.
pub fn region_voxels(grid: &Grid, shape: &ShapeDesc, _mesh: Option<&TriangleMesh>) -> Vec<VoxelId> {
    (0..grid.voxels().len() as u32)
        .map(VoxelId)
        .filter(|v| sd(shape, &grid.centre_m(grid.voxels()[v.index()].ijk)) < 0.0)
        .collect()
}
