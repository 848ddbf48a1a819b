//! What of a shape its voxels miss: parts that lie between their centres, and volume.

use std::collections::BTreeSet;

use super::implicit::Implicit;
use super::lattice::{Bounds, Lattice, MAX_CELLS};
use super::thickness::Distances;
use super::voxelize::{Solid, extent, shape_error};
use super::{Grid, Ijk};
use crate::Vec3;
use crate::scene::{Meshes, SceneError, ShapeDesc};

/// Probes along a voxel's edge: the middle one is its centre.
const PROBES: i32 = 3;
/// A cell whose centre is so far from the surface, in voxels, is wholly on one side: half of its diagonal, and what a
/// union's distance is off.
const WHOLLY: f64 = 1.0;

/// A connected part of a shape that no voxel stands for, nor lies beside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MissedPart {
    /// The box around it.
    pub bounds: Bounds,
    /// How thick it is, to a third of a voxel; the median over it, m.
    pub thickness_m: f64,
}

/// What of a shape its voxels miss.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Missed {
    /// The largest part. Of meshes it is not told where probes at a third of a voxel are more cells than a lattice may have.
    pub largest_part: Option<MissedPart>,
    /// Volume of the shape, m³, beside which that of the voxels' surface is to be held: of a mesh exactly, if it is
    /// closed and wound one way round; of a formula by cells of half a voxel.
    pub shape_volume_m3: f64,
}

impl Missed {
    /// Of the voxels of a shape.
    ///
    /// # Errors
    /// As [`super::voxelize::voxelize`].
    pub fn of(grid: &Grid, shape: &ShapeDesc, meshes: &Meshes) -> Result<Self, SceneError> {
        let (bounds, bulge_m) = extent(shape, meshes)?;
        let lattice = Lattice::over(&bounds, bulge_m, grid.voxel_size_m())?;
        let probes = Lattice {
            origin_m: lattice.origin_m,
            voxel_size_m: lattice.voxel_size_m / f64::from(PROBES),
            dims: lattice.dims.map(|d| d * PROBES),
        };
        let to_voxels = Distances::to_cells(grid, |cell| grid.voxel_at(cell).is_some());
        let has_no_voxel_beside = |cell: &Ijk| !to_voxels.is_beside(grid.cell_of(&lattice.centre_m(*cell)));
        let alone = lattice.cells().filter(has_no_voxel_beside);
        let (missed, shape_volume_m3): (BTreeSet<Ijk>, f64) = match Solid::new(shape, meshes)? {
            Solid::Implicit(shape) => {
                let is_near = |cell: &Ijk| {
                    centre_distance_m(grid, &shape, &lattice.centre_m(*cell)) < WHOLLY * grid.voxel_size_m()
                };
                let is_inside = |probe: &Ijk| shape.sample(&probes.centre_m(*probe)).distance_m < 0.0;
                let missed = alone.filter(is_near).flat_map(probes_of).filter(is_inside).collect();
                (missed, formula_volume_m3(grid, &shape, lattice))
            }
            Solid::Mesh(solid) if probes.len() as f64 > MAX_CELLS => (BTreeSet::new(), solid.volume_m3().abs()),
            Solid::Mesh(solid) => {
                let inside = solid.cut_by(probes).inside().map_err(shape_error)?;
                let is_inside = |probe: &Ijk| {
                    (0..3).all(|a| (0..probes.dims[a]).contains(&probe[a])) && inside[probes.slot(*probe)]
                };
                (alone.flat_map(probes_of).filter(is_inside).collect(), solid.volume_m3().abs())
            }
        };
        Ok(Self { largest_part: largest_part(missed, &probes), shape_volume_m3 })
    }
}

/// The probes in a cell.
fn probes_of(cell: Ijk) -> impl Iterator<Item = Ijk> {
    let place = |i: i32| [i % PROBES, i / PROBES % PROBES, i / PROBES / PROBES];
    (0..PROBES.pow(3)).map(move |i| std::array::from_fn(|a| cell[a] * PROBES + place(i)[a]))
}

/// The part with most of these probes. One with a voxel's centre was left out as too small to be carried: that is told
/// elsewhere.
fn largest_part(mut missed: BTreeSet<Ijk>, probes: &Lattice) -> Option<MissedPart> {
    let is_centre = |probe: &Ijk| probe.iter().all(|i| i.rem_euclid(PROBES) == PROBES / 2);
    let parts = std::iter::from_fn(|| take_part(&mut missed));
    let part = parts.filter(|part| !part.iter().any(is_centre)).max_by_key(BTreeSet::len)?;
    let mut across: Vec<i32> = part.iter().map(|probe| cells_across(&part, *probe)).collect();
    across.sort_unstable();
    let half = Vec3::repeat(0.5 * probes.voxel_size_m);
    let boxes = part.iter().map(|probe| probes.centre_m(*probe)).map(|c| Bounds { min_m: c - half, max_m: c + half });
    Some(MissedPart {
        bounds: boxes.reduce(Bounds::with)?,
        thickness_m: f64::from(across[across.len() / 2]) * probes.voxel_size_m,
    })
}

/// Takes out what hangs together by faces with the first of some cells.
fn take_part(cells: &mut BTreeSet<Ijk>) -> Option<BTreeSet<Ijk>> {
    let first = cells.pop_first()?;
    let (mut part, mut open) = (BTreeSet::from([first]), vec![first]);
    while let Some(cell) = open.pop() {
        let beside = Grid::links_of(cell).map(|(_, other)| other).filter(|other| cells.remove(other));
        let from = open.len();
        open.extend(beside);
        part.extend(&open[from..]);
    }
    Some(part)
}

/// The least number of cells of a part in a row through one of them.
fn cells_across(part: &BTreeSet<Ijk>, cell: Ijk) -> i32 {
    let run = |axis: usize, step: i32| {
        let moved = |n: i32| std::array::from_fn(|a| cell[a] + if a == axis { n * step } else { 0 });
        (1..).take_while(|n| part.contains(&moved(*n))).count() as i32
    };
    (0..3).map(|axis| 1 + run(axis, 1) + run(axis, -1)).min().expect("three axes")
}

/// Volume of a formula by cells of half a voxel, of which the distance of its centre says how much is filled, m³.
fn formula_volume_m3(grid: &Grid, shape: &Implicit, lattice: Lattice) -> f64 {
    let voxel_m = grid.voxel_size_m();
    let half_m = 0.5 * voxel_m;
    let filled = |at_m: &Vec3| (0.5 - shape.sample(at_m).distance_m / half_m).clamp(0.0, 1.0);
    let of_cell = |centre_m: Vec3| {
        let distance_m = centre_distance_m(grid, shape, &centre_m);
        if distance_m.abs() > WHOLLY * voxel_m {
            return if distance_m < 0.0 { 1.0 } else { 0.0 };
        }
        let sign = |bit: u32| if bit == 0 { -0.5 } else { 0.5 };
        let eighth = |c: u32| centre_m + Vec3::new(sign(c & 1), sign(c >> 1 & 1), sign(c >> 2 & 1)) * half_m;
        (0..8).map(eighth).map(|at_m| filled(&at_m)).sum::<f64>() / 8.0
    };
    lattice.cells().map(|cell| of_cell(lattice.centre_m(cell))).sum::<f64>() * voxel_m.powi(3)
}

/// Signed distance at the centre of a cell, m: as the grid has it from when it was voxelized, or else by the formula.
fn centre_distance_m(grid: &Grid, shape: &Implicit, centre_m: &Vec3) -> f64 {
    grid.sampled_distance_m(grid.cell_of(centre_m)).unwrap_or_else(|| shape.sample(centre_m).distance_m)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::grid::voxelize::voxelize;
    use crate::scene::{ObjectDesc, TriangleMesh, object_of};

    const AXES: [&str; 2] = ["[0.0, 0.0, 0.0]", "[10.3, 10.1, 10.2]"];

    fn found(object: &ObjectDesc, meshes: &Meshes) -> Missed {
        Missed::of(&voxelize(object, meshes).unwrap(), &object.shape, meshes).unwrap()
    }

    fn missed(object: &ObjectDesc, meshes: &Meshes) -> Option<MissedPart> {
        found(object, meshes).largest_part
    }

    /// A block with a fin of some thickness, from x = 10 to 20, in the plane z = 5.
    fn finned(thickness_m: f64) -> ObjectDesc {
        let (low, high) = (5.0 - thickness_m / 2.0, 5.0 + thickness_m / 2.0);
        object_of(&format!(
            "{{ smooth_union = {{ blend_m = 0.0, parts = [
               {{ box = {{ min_m = [0.0, 0.0, 0.0], max_m = [10.0, 10.0, 10.0] }} }},
               {{ box = {{ min_m = [10.0, 0.0, {low}], max_m = [20.0, 10.0, {high}] }} }}] }} }}"
        ))
    }

    #[test]
    fn a_fin_between_the_centres_of_voxels_is_missed_with_its_place_and_thickness() {
        // The centres lie at 4.5 and 5.5: a fin of 1.2 m holds both, one of .7 m neither.
        assert_eq!(missed(&finned(1.2), &Meshes::new()), None);
        let fin = missed(&finned(0.7), &Meshes::new()).unwrap();
        assert!((fin.thickness_m - 0.7).abs() < 0.34, "{fin:?}");
        // What is beside a voxel is not missed: the first of the ten along x.
        assert!((fin.bounds.min_m - Vec3::new(11.0, 0.0, 4.667)).norm() < 0.01, "{fin:?}");
        assert!((fin.bounds.max_m - Vec3::new(20.0, 10.0, 5.333)).norm() < 0.01, "{fin:?}");
    }

    #[test]
    fn of_what_voxels_stand_for_nothing_is_missed() {
        for shape in [
            format!("{{ box = {{ min_m = {}, max_m = {} }} }}", AXES[0], AXES[1]),
            format!("{{ capsule = {{ from_m = {}, to_m = {}, radius_m = 2.2 }} }}", AXES[0], AXES[1]),
            format!("{{ ellipsoid = {{ center_m = {}, semi_axes_m = {} }} }}", AXES[0], "[9.0, 3.1, 1.3]"),
        ] {
            assert_eq!(missed(&object_of(&shape), &Meshes::new()), None, "{shape}");
        }
    }

    /// Two boxes of triangles: a block of 10 m, and a plate at some height over its top.
    fn block_and_plate(thickness_m: f64, above_m: f64) -> TriangleMesh {
        const FACES: [[u32; 3]; 12] = [
            [0, 2, 1],
            [1, 2, 3],
            [4, 5, 6],
            [5, 7, 6],
            [0, 1, 4],
            [1, 5, 4],
            [2, 6, 3],
            [3, 6, 7],
            [0, 4, 2],
            [2, 4, 6],
            [1, 3, 5],
            [3, 7, 5],
        ];
        let mut mesh = TriangleMesh::default();
        for (from, height) in [(0.0, 10.0), (10.0 + above_m, thickness_m)] {
            let first = mesh.positions.len() as u32;
            let corner =
                |c: usize| [10.0 * (c & 1) as f64, 10.0 * (c >> 1 & 1) as f64, from + height * (c >> 2 & 1) as f64];
            mesh.positions.extend((0..8).map(corner));
            mesh.triangles.extend(FACES.map(|face| face.map(|v| v + first)));
        }
        mesh
    }

    #[test]
    fn a_plate_of_a_mesh_is_missed_as_one_of_a_formula() {
        let object = object_of("{ mesh = { file = 'm', scale_m_per_unit = 1.0 } }");
        let of = |thickness_m: f64, above_m: f64| Meshes::from([("m".into(), block_and_plate(thickness_m, above_m))]);
        // In all 13 m high: centres lie at whole metres and a half.
        let plate = missed(&object, &of(0.4, 2.6)).unwrap();
        assert!((plate.thickness_m - 0.4).abs() < 0.34 && plate.bounds.min_m.z > 12.5, "{plate:?}");
        assert_eq!(missed(&object, &of(1.0, 2.0)), None);
    }

    #[test]
    fn volumes_are_those_of_the_formulas() {
        let axes = [9.0, 3.1, 2.3];
        for (shape, volume_m3) in [
            (format!("{{ box = {{ min_m = {}, max_m = {} }} }}", AXES[0], AXES[1]), 10.3 * 10.1 * 10.2),
            ("{ sphere = { center_m = [0.3, 0.2, 0.1], radius_m = 7.0 } }".into(), 4.0 / 3.0 * PI * 343.0),
            (
                format!("{{ ellipsoid = {{ center_m = {}, semi_axes_m = {axes:?} }} }}", AXES[0]),
                4.0 / 3.0 * PI * axes.iter().product::<f64>(),
            ),
            (
                "{ smooth_union = { blend_m = 0.0, parts = [{ sphere = { center_m = [0.3, 0.2, 0.1], radius_m = 8.0 } }],
                   without = [{ sphere = { center_m = [0.3, 0.2, 0.1], radius_m = 7.3 } }] } }"
                    .into(),
                4.0 / 3.0 * PI * (512.0 - 389.017),
            ),
        ] {
            let object = object_of(&shape);
            let found_m3 = found(&object, &Meshes::new()).shape_volume_m3;
            // Where the surface bends within a cell, it is taken for flat.
            assert!((found_m3 / volume_m3 - 1.0).abs() < 1e-2, "{shape}: {found_m3}, not {volume_m3}");
        }
        let object = object_of("{ mesh = { file = 'm', scale_m_per_unit = 2.0 } }");
        let meshes = Meshes::from([("m".into(), block_and_plate(0.4, 2.6))]);
        let found_m3 = found(&object, &meshes).shape_volume_m3;
        assert!((found_m3 - 8.0 * 1040.0).abs() < 1e-6, "{found_m3}");
    }
}
