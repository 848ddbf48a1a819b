//! Grids for the tests of the surface: solids with exact crossings, random ones, and cuts.

use crate::Vec3;
use crate::grid::{Crossing, Grid, Ijk, LinkId, Voxel};

/// A half-space `normal . x < offset`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plane {
    pub(super) normal: Vec3,
    pub(super) offset_m: f64,
}

impl Plane {
    pub(super) fn through(point_m: Vec3, normal: Vec3) -> Self {
        let normal = normal.normalize();
        Self { normal, offset_m: normal.dot(&point_m) }
    }

    fn distance_m(&self, point_m: &Vec3) -> f64 {
        self.normal.dot(point_m) - self.offset_m
    }
}

/// The cells of a box.
pub(super) fn cells(dims: [i32; 3]) -> impl Iterator<Item = Ijk> {
    (0..dims[2]).flat_map(move |k| (0..dims[1]).flat_map(move |j| (0..dims[0]).map(move |i| [i, j, k])))
}

/// A solid that is inside where `level_m` is negative, with crossings where it is zero on a link and
/// its gradient as the normal.
pub(super) fn implicit_solid(dims: [i32; 3], voxel_size_m: f64, level_m: impl Fn(&Vec3) -> f64) -> Grid {
    let centre_m = |cell: Ijk| Vec3::from_fn(|a, _| (f64::from(cell[a]) + 0.5) * voxel_size_m);
    let voxels = cells(dims).filter(|c| level_m(&centre_m(*c)) < 0.0).map(|ijk| Voxel { ijk, material: 0 }).collect();
    let boundary = |link: LinkId| {
        let (lower, upper) = (centre_m(link.cell), centre_m(link.upper()));
        let at = |t: f64| lower.lerp(&upper, t);
        let (mut inside, mut outside) = if level_m(&lower) < 0.0 { (0.0, 1.0) } else { (1.0, 0.0) };
        for _ in 0..40 {
            let middle = (inside + outside) / 2.0;
            *if level_m(&at(middle)) < 0.0 { &mut inside } else { &mut outside } = middle;
        }
        crossing_at(inside, gradient(&level_m, &at(inside), 1e-6 * voxel_size_m))
    };
    Grid::new(voxel_size_m, Vec3::zeros(), dims, voxels, |c| level_m(&centre_m(c)) as f32, boundary)
}

fn gradient(level_m: &impl Fn(&Vec3) -> f64, point_m: &Vec3, step_m: f64) -> Vec3 {
    Vec3::from_fn(|axis, _| {
        let step = Vec3::ith(axis, step_m);
        level_m(&(point_m + step)) - level_m(&(point_m - step))
    })
}

fn crossing_at(t: f64, normal: Vec3) -> Crossing {
    Crossing { t: t as f32, normal: normal.normalize().map(|c| c as f32).into() }
}

/// An axis-aligned box.
pub(super) fn box_solid(dims: [i32; 3], voxel_size_m: f64, min_m: Vec3, max_m: Vec3) -> Grid {
    implicit_solid(dims, voxel_size_m, |x| (min_m - x).sup(&(x - max_m)).max())
}

/// A sphere in the middle of a cubic grid.
pub(super) fn sphere_solid(cells: i32, voxel_size_m: f64, radius_m: f64) -> Grid {
    let centre = Vec3::repeat(f64::from(cells) * voxel_size_m / 2.0);
    implicit_solid([cells; 3], voxel_size_m, |x| (x - centre).norm() - radius_m)
}

/// Any solid: the cells that `filled` names, with crossings and normals of no meaning.
pub(super) fn arbitrary_solid(dims: [i32; 3], filled: &[bool]) -> Grid {
    let voxels = cells(dims).zip(filled).filter(|(_, f)| **f).map(|(ijk, _)| Voxel { ijk, material: 0 }).collect();
    Grid::new(1.0, Vec3::zeros(), dims, voxels, |_| 0.0, arbitrary_crossing)
}

/// A crossing that is a function of the link and otherwise arbitrary.
pub(super) fn arbitrary_crossing(link: LinkId) -> Crossing {
    let [i, j, k] = link.cell.map(f64::from);
    let seed = 1.7 * i + 2.3 * j + 3.1 * k + 0.9 * f64::from(link.axis);
    crossing_at(seed.sin().abs(), Vec3::new((3.0 * seed).sin(), (5.0 * seed).cos(), (7.0 * seed).sin()))
}

/// Every link with both ends inside, intact or not.
pub(super) fn inner_links(grid: &Grid) -> Vec<LinkId> {
    let of_voxel = |v: &Voxel| (0..3).map(|axis| LinkId { cell: v.ijk, axis }).collect::<Vec<_>>();
    grid.voxels().iter().flat_map(of_voxel).filter(|link| grid.voxel_at(link.upper()).is_some()).collect()
}

/// Parts the intact links that cross the plane where `reached` holds, and returns them.
pub(super) fn cut(grid: &mut Grid, plane: &Plane, reached: impl Fn(&Vec3) -> bool) -> Vec<LinkId> {
    let mut links = inner_links(grid);
    links.retain(|link| {
        let (lower, upper) = (grid.centre_m(link.cell), grid.centre_m(link.upper()));
        let (at_lower, at_upper) = (plane.distance_m(&lower), plane.distance_m(&upper));
        if (at_lower < 0.0) == (at_upper < 0.0) {
            return false;
        }
        let t = at_lower / (at_lower - at_upper);
        let normal = plane.normal * (at_upper - at_lower).signum();
        reached(&lower.lerp(&upper, t)) && grid.part(*link, crossing_at(t, normal))
    });
    links
}
