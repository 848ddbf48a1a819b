//! Where runs are compared: material points fixed in the reference configuration.

use kerf_physics::{Body, Grid, MaterialPoint, Scene, SceneError, Vec3, VoxelId};
use serde::{Deserialize, Serialize};

/// A point of an object's reference configuration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// Index into the scene's objects.
    pub object: usize,
    /// Reference position, m, scene frame.
    pub position_m: [f64; 3],
}

/// `count` centres of voxels at the surface, spread evenly: each the farthest from those before it. Centres,
/// since each side of a cut has its own.
///
/// # Errors
/// An object that cannot be voxelized.
pub fn on_surface(scene: &Scene, count: usize) -> Result<Vec<Point>, SceneError> {
    let mut candidates = Vec::new();
    for (object, grid) in grids(scene)?.iter().enumerate() {
        let cells = grid.voxels().iter().map(|voxel| voxel.ijk);
        let at_surface = cells.filter(|cell| Grid::links_of(*cell).any(|(_, other)| grid.voxel_at(other).is_none()));
        candidates.extend(at_surface.map(|cell| Point { object, position_m: grid.centre_m(cell).into() }));
    }
    let mut distance2_m2 = vec![f64::INFINITY; candidates.len()];
    let mut chosen: Vec<Point> = Vec::new();
    let mut next = 0;
    while chosen.len() < count.min(candidates.len()) {
        chosen.push(candidates[next]);
        for (distance2, candidate) in distance2_m2.iter_mut().zip(&candidates) {
            let away = Vec3::from(candidate.position_m) - Vec3::from(candidates[next].position_m);
            *distance2 = distance2.min(away.norm_squared());
        }
        // The first of equals.
        next = (0..candidates.len()).rev().max_by(|a, b| distance2_m2[*a].total_cmp(&distance2_m2[*b])).unwrap_or(0);
    }
    Ok(chosen)
}

/// The middles of the upper faces of the topmost voxels along x, in the middle of the first object: from its
/// least to its greatest x.
///
/// # Errors
/// An object that cannot be voxelized.
pub fn along_top(scene: &Scene) -> Result<Vec<Point>, SceneError> {
    let grids = grids(scene)?;
    let Some(grid) = grids.first() else { return Ok(Vec::new()) };
    let [nx, ny, nz] = grid.dims();
    let top = |x: i32| (0..ny).rev().map(|y| [x, y, nz / 2]).find(|cell| grid.voxel_at(*cell).is_some());
    let up = Vec3::y() * (0.5 * grid.voxel_size_m());
    Ok((0..nx).filter_map(top).map(|cell| Point { object: 0, position_m: (grid.centre_m(cell) + up).into() }).collect())
}

fn grids(scene: &Scene) -> Result<Vec<Grid>, SceneError> {
    let objects = scene.desc.objects.iter();
    objects.map(|object| kerf_physics::voxelize(object, &scene.meshes)).collect()
}

/// Points as they lie in the voxels of a run, which may be larger than those they were chosen in.
#[derive(Debug)]
pub struct Followed(Vec<(usize, MaterialPoint)>);

impl Followed {
    /// Each point in the voxel that holds it; in the nearest where none does.
    #[must_use]
    pub fn new(bodies: &[&Body], points: &[Point]) -> Self {
        let follow = |point: &Point| {
            let position_m = Vec3::from(point.position_m);
            let voxel = voxel_of(bodies[point.object].grid(), &position_m);
            (point.object, MaterialPoint { position_m, voxel })
        };
        Self(points.iter().map(follow).collect())
    }

    /// Displacements, m, scene frame.
    #[must_use]
    pub fn displacements_m(&self, bodies: &[&Body]) -> Vec<[f32; 3]> {
        let moved = |(object, point): &(usize, MaterialPoint)| {
            (bodies[*object].current_m(point) - point.position_m).map(|u| u as f32).into()
        };
        self.0.iter().map(moved).collect()
    }
}

fn voxel_of(grid: &Grid, position_m: &Vec3) -> VoxelId {
    let away = |id: &u32| (grid.centre_m(grid.voxels()[*id as usize].ijk) - position_m).norm_squared();
    let nearest = || (0..grid.voxels().len() as u32).min_by(|a, b| away(a).total_cmp(&away(b)));
    let held = grid.voxel_at(grid.cell_of(position_m));
    held.unwrap_or_else(|| VoxelId(nearest().expect("an object has voxels")))
}

#[cfg(test)]
mod tests {
    use kerf_physics::{NoClock, StepInputs, Workers, World, verification};
    use kerf_scenes::catalog;

    use super::*;

    #[test]
    fn points_are_many_distinct_and_apart() {
        let scene = catalog::builtin("liver").unwrap();
        let points = on_surface(&scene, 100).unwrap();
        assert_eq!(points.len(), 100);
        let position = |index: usize| Vec3::from(points[index].position_m);
        let apart = |(a, b): (usize, usize)| (position(a) - position(b)).norm();
        let pairs = (0..100).flat_map(|a| (0..a).map(move |b| (a, b)));
        let least = pairs.map(apart).fold(f64::INFINITY, f64::min);
        // A surface of some 0.08 m^2 among 100 points: 28 mm of a side each.
        assert!(least > 0.014, "{least}");
    }

    #[test]
    fn points_follow_a_rigid_motion_in_voxels_of_any_size() {
        let mut scene = catalog::builtin("jelly").unwrap().into_scene();
        scene.desc.gravity_m_per_s2 = [0.0; 3];
        scene.desc.objects[0].fixed.clear();
        scene.desc.objects[0].material.rayleigh_alpha_per_s = 0.0;
        let points = on_surface(&scene, 50).unwrap();
        let size_m = scene.desc.objects[0].voxel_size_m.unwrap();
        for scale in [1.0, 1.7] {
            scene.desc.objects[0].voxel_size_m = Some(size_m * scale);
            let mut world = World::new(&scene.clone().judge().unwrap()).unwrap();
            for velocity in &mut verification::state_mut(verification::body_mut(&mut world, 0)).velocity_m_per_s {
                *velocity = [0.5, -0.25, 1.0];
            }
            (0..10).for_each(|_| {
                world.step(&Workers::serial(), &NoClock, &StepInputs::default());
            });
            for u in Followed::new(&world.bodies(), &points).displacements_m(&world.bodies()) {
                for (moved, meant) in u.iter().zip([0.005, -0.0025, 0.01]) {
                    assert!((moved - meant).abs() < 2e-6, "{u:?}");
                }
            }
        }
    }
}
