//! From a scene's shapes to voxels, links and signed distances.

use super::implicit::Implicit;
use super::lattice::{Bounds, Lattice};
use super::mesh::{self, Columns, MeshSolid};
use super::small_pieces::{self, LeftOut};
use super::thickness::Thickness;
use super::{Crossing, Grid, Ijk, LinkId, Voxel, VoxelId};
use crate::Vec3;
use crate::scene::toughness::{carries, composite_edge_m};
use crate::scene::{Meshes, ObjectDesc, PlacedMesh, SceneError, ShapeDesc, TriangleMesh};

/// Cells from a mesh's surface within which its signed distance is exact; beyond, it is this many
/// voxels with the right sign.
const BAND_CELLS: i32 = 4;
/// Steps in which a link is searched for its first crossing.
const LINK_STEPS: u32 = 8;
/// Change of the fraction of a link at which a search for its crossing ends: what is filled of a box adds up to its
/// volume within 1e-9 of a voxel.
const SHARE_TOLERANCE: f64 = 1e-9;
/// Secants of such a search at most. Most take 4 to 7; without a limit a distance that is not finite would never end it.
const MOST_SECANTS: u32 = 60;

/// The voxels whose centre lies in a shape, ascending.
///
/// # Errors
/// A mesh that is absent, open or degenerate.
pub fn region_voxels(grid: &Grid, shape: &ShapeDesc, meshes: &Meshes) -> Result<Vec<VoxelId>, SceneError> {
    let lattice = Lattice::of(grid);
    let ids = (0..grid.voxels().len() as u32).map(VoxelId);
    let cell = |id: &VoxelId| grid.voxels()[id.index()].ijk;
    Ok(match Solid::new(shape, meshes)? {
        Solid::Implicit(shape) => ids.filter(|id| shape.sample(&grid.centre_m(cell(id))).distance_m < 0.0).collect(),
        Solid::Mesh(solid) => {
            let inside = solid.cut_by(lattice).inside().map_err(shape_error)?;
            ids.filter(|id| inside[lattice.slot(cell(id))]).collect()
        }
    })
}

/// The level that each voxel's element is to have: the object's, lower in its finer regions and, by
/// `object.min_elements_across`, where it is thin, but there none on which elements would fold under a blade. `grid` may
/// have other voxels than the object, whose edge is `voxel_size_m`.
///
/// # Errors
/// As [`region_voxels`].
pub fn wanted_levels(
    grid: &Grid,
    object: &ObjectDesc,
    meshes: &Meshes,
    voxel_size_m: f64,
) -> Result<Vec<u8>, SceneError> {
    let mut levels = vec![object.level; grid.voxels().len()];
    if let Some(across) = object.min_elements_across {
        let thickness = Thickness::of(grid);
        let is_carried = |level: u8| carries(object, voxel_size_m, level);
        for level in (1..=object.level).rev().take_while(|level| is_carried(level - 1)) {
            let is_thin = thickness.thinner_than(across * composite_edge_m(voxel_size_m, level));
            // What is not thin on a level is not on a lower one either, whatever the lattice says.
            let thin = levels.iter_mut().zip(is_thin).filter(|(wanted, is_thin)| *is_thin && **wanted == level);
            thin.for_each(|(wanted, _)| *wanted = level - 1);
        }
    }
    for finer in &object.finer {
        for voxel in region_voxels(grid, &finer.shape, meshes)? {
            levels[voxel.index()] = levels[voxel.index()].min(finer.level);
        }
    }
    Ok(levels)
}

/// What can be told of an object before it is voxelized.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measures {
    /// Edge length of its voxels, m.
    pub voxel_size_m: f64,
    /// Edge lengths of the box around it, m; `None` where it depends on a mesh that is not at hand.
    pub extent_m: Option<Vec3>,
}

/// Size of an object and of its voxels; `None` where its voxels depend on a mesh that is not in `meshes`.
///
/// # Errors
/// A mesh that cannot be used, or a lattice beyond the limit of cells.
pub fn measures(object: &ObjectDesc, meshes: &Meshes) -> Result<Option<Measures>, SceneError> {
    if object.shape.mesh().is_some_and(|mesh| !meshes.contains_key(&mesh.key)) {
        return Ok(object.voxel_size_m.map(|voxel_size_m| Measures { voxel_size_m, extent_m: None }));
    }
    let (bounds, bulge_m) = extent(&object.shape, meshes)?;
    let voxel_size_m = size_within(object, &bounds);
    Lattice::over(&bounds, bulge_m, voxel_size_m)?;
    Ok(Some(Measures { voxel_size_m, extent_m: Some(bounds.extent_m()) }))
}

/// Edge length of an object's voxels alone, as [`measures`] has it, m.
///
/// # Errors
/// As there.
pub fn voxel_size_m(object: &ObjectDesc, meshes: &Meshes) -> Result<Option<f64>, SceneError> {
    Ok(measures(object, meshes)?.map(|measures| measures.voxel_size_m))
}

fn size_within(object: &ObjectDesc, bounds: &Bounds) -> f64 {
    let by_resolution = || bounds.extent_m().max() / f64::from(object.resolution.unwrap_or(1));
    object.voxel_size_m.unwrap_or_else(by_resolution)
}

pub(super) fn extent(shape: &ShapeDesc, meshes: &Meshes) -> Result<(Bounds, f64), SceneError> {
    match (shape.mesh(), Implicit::new(shape)) {
        (_, Some(implicit)) => Ok((implicit.bounds(), implicit.bulge_m())),
        (Some(PlacedMesh { key, scale_m_per_unit, offset_m }), None) => {
            let mesh = find(meshes, &key)?;
            let bounds = mesh::bounds(mesh, scale_m_per_unit, &Vec3::from(offset_m)).map_err(shape_error)?;
            Ok((bounds, 0.0))
        }
        _ => Err(shape_error("a part of a union is a box, sphere, ellipsoid or capsule".into())),
    }
}

fn find<'a>(meshes: &'a Meshes, file: &str) -> Result<&'a TriangleMesh, SceneError> {
    meshes.get(file).ok_or_else(|| shape_error(format!("the mesh `{file}` was not read")))
}

pub(super) fn shape_error(message: String) -> SceneError {
    SceneError::Field { field: "shape".into(), message }
}

/// A shape ready to be sampled.
pub(super) enum Solid {
    Implicit(Implicit),
    Mesh(Box<MeshSolid>),
}

impl Solid {
    pub(super) fn new(shape: &ShapeDesc, meshes: &Meshes) -> Result<Self, SceneError> {
        match (shape.mesh(), Implicit::new(shape)) {
            (_, Some(implicit)) => Ok(Self::Implicit(implicit)),
            (Some(PlacedMesh { key, scale_m_per_unit, offset_m }), None) => {
                let mesh = find(meshes, &key)?;
                let solid = MeshSolid::new(mesh, scale_m_per_unit, &Vec3::from(offset_m)).map_err(shape_error)?;
                Ok(Self::Mesh(Box::new(solid)))
            }
            _ => Err(shape_error("a part of a union is a box, sphere, ellipsoid or capsule".into())),
        }
    }
}

/// A shape sampled at the cells of a lattice.
struct Samples {
    lattice: Lattice,
    /// Whether each cell's centre is inside.
    inside: Vec<bool>,
    /// Signed distance at each cell's centre, m.
    distance_m: Vec<f32>,
    surface: Surface,
}

/// What the crossings are found from.
enum Surface {
    Implicit(Implicit),
    Mesh(Box<MeshSolid>, Box<Columns>),
}

impl Samples {
    fn new(solid: Solid, lattice: Lattice) -> Result<Self, SceneError> {
        Ok(match solid {
            Solid::Implicit(shape) => {
                let sample = |cell| shape.sample(&lattice.centre_m(cell)).distance_m;
                let mut sampled = (Vec::with_capacity(lattice.len()), Vec::with_capacity(lattice.len()));
                sampled.extend(lattice.cells().map(sample).map(|d| (d < 0.0, d as f32)));
                let (inside, distance_m) = sampled;
                Self { lattice, inside, distance_m, surface: Surface::Implicit(shape) }
            }
            Solid::Mesh(solid) => {
                let columns = solid.cut_by(lattice);
                solid.refuse_overlap(&columns).map_err(shape_error)?;
                let inside = columns.inside().map_err(shape_error)?;
                let distance_m = mesh_distances(&solid, &lattice, &inside);
                Self { lattice, inside, distance_m, surface: Surface::Mesh(solid, Box::new(columns)) }
            }
        })
    }

    /// Leaves out what is too small to be carried.
    fn leave_out_small_pieces(&mut self) -> LeftOut {
        let Self { lattice, inside, distance_m, .. } = self;
        small_pieces::leave_out(lattice, inside, |slot| distance_m[slot] = distance_m[slot].abs())
    }

    fn is_inside(&self, cell: Ijk) -> bool {
        self.inside[self.lattice.slot(cell)]
    }

    /// First and last cell, per axis, of the box that holds every inside cell.
    fn occupied(&self) -> Option<(Ijk, Ijk)> {
        let inside = self.lattice.cells().zip(&self.inside).filter(|(_, inside)| **inside);
        inside.map(|(cell, _)| (cell, cell)).reduce(|(first, last), (cell, _)| {
            let lower = std::array::from_fn(|a| first[a].min(cell[a]));
            (lower, std::array::from_fn(|a| last[a].max(cell[a])))
        })
    }

    /// Crossing of a link with exactly one end inside.
    fn crossing(&self, link: LinkId) -> Crossing {
        let lower_is_inside = self.is_inside(link.cell);
        match &self.surface {
            Surface::Mesh(solid, columns) => columns.crossing(solid, link, lower_is_inside),
            Surface::Implicit(shape) => {
                let (lower_m, upper_m) = (self.lattice.centre_m(link.cell), self.lattice.centre_m(link.upper()));
                let (from_m, to_m) = if lower_is_inside { (lower_m, upper_m) } else { (upper_m, lower_m) };
                let share = first_crossing(shape, &from_m, &to_m);
                let t = if lower_is_inside { share } else { 1.0 - share };
                let normal = shape.sample(&(from_m + (to_m - from_m) * share)).normal;
                Crossing { t: t as f32, normal: normal.cast().into() }
            }
        }
    }
}

/// Fraction of the way from an inside to an outside point at which a shape is first left.
fn first_crossing(shape: &Implicit, from_m: &Vec3, to_m: &Vec3) -> f64 {
    let distance_m = |share: f64| shape.sample(&(from_m + (to_m - from_m) * share)).distance_m;
    let mut inside = (0.0, distance_m(0.0));
    for step in 1..=LINK_STEPS {
        let share = f64::from(step) / f64::from(LINK_STEPS);
        let next = (share, distance_m(share));
        if next.1 >= 0.0 {
            return crossing_between(distance_m, inside, next);
        }
        inside = next;
    }
    1.0
}

/// Where a distance becomes zero between a share at which it is negative and one at which it is not, by secants of which
/// one end may stay only with half its distance (the Illinois form of the false position).
fn crossing_between(distance_m: impl Fn(f64) -> f64, mut inside: (f64, f64), mut outside: (f64, f64)) -> f64 {
    let mut last = f64::NAN;
    let mut was_inside = None;
    for _ in 0..MOST_SECANTS {
        let share = outside.0 - outside.1 * (outside.0 - inside.0) / (outside.1 - inside.1);
        let found = (share, distance_m(share));
        if found.1 == 0.0 || (share - last).abs() < SHARE_TOLERANCE {
            return share;
        }
        last = share;
        let is_inside = found.1 < 0.0;
        let (moved, kept) = if is_inside { (&mut inside, &mut outside) } else { (&mut outside, &mut inside) };
        *moved = found;
        if was_inside == Some(is_inside) {
            kept.1 *= 0.5;
        }
        was_inside = Some(is_inside);
    }
    last
}

/// Signed distances to a mesh: exact in a band about the surface, of the right sign beyond.
fn mesh_distances(solid: &MeshSolid, lattice: &Lattice, inside: &[bool]) -> Vec<f32> {
    let near = near_surface(lattice, inside);
    let far_m = f64::from(BAND_CELLS) * lattice.voxel_size_m;
    let distance = |(cell, (inside, near)): (Ijk, (&bool, bool))| {
        let size_m = if near { solid.distance_m(&lattice.centre_m(cell)) } else { far_m };
        (if *inside { -size_m } else { size_m }) as f32
    };
    lattice.cells().zip(inside.iter().zip(near)).map(distance).collect()
}

/// The cells within [`BAND_CELLS`], along each axis, of one that differs from a face neighbour.
fn near_surface(lattice: &Lattice, inside: &[bool]) -> Vec<bool> {
    let mut near = vec![false; lattice.len()];
    for axis in 0..3 {
        for cell in lattice.cells().filter(|cell| cell[axis] < lattice.dims[axis]) {
            let (here, next) = (lattice.slot(cell), lattice.slot(LinkId { cell, axis: axis as u8 }.upper()));
            if inside[here] != inside[next] {
                (near[here], near[next]) = (true, true);
            }
        }
    }
    for axis in 0..3 {
        near = widened(lattice, &near, axis);
    }
    near
}

/// Marks every cell within [`BAND_CELLS`] of a marked one along an axis.
fn widened(lattice: &Lattice, marked: &[bool], axis: usize) -> Vec<bool> {
    let mut wide = vec![false; marked.len()];
    for cell in lattice.cells().filter(|cell| marked[lattice.slot(*cell)]) {
        let mut other = cell;
        for i in (cell[axis] - BAND_CELLS).max(-1)..=(cell[axis] + BAND_CELLS).min(lattice.dims[axis]) {
            other[axis] = i;
            wide[lattice.slot(other)] = true;
        }
    }
    wide
}

/// Voxelizes an object: a voxel is inside where its centre is.
///
/// Pieces of fewer than [`super::LEAST_PIECE_VOXELS`] are left out where there is a larger one, and counted in
/// [`Grid::left_out`]. The lattice is centred on the shape's bounding box, so a box of a whole number of voxels is filled
/// by exactly those voxels. Voxels are ordered by z, then y, then x.
///
/// # Errors
/// A field within the object that cannot be voxelized, with the reason: a mesh that is absent, open or
/// degenerate, a lattice beyond the limit, a shape that holds no voxel's centre.
pub fn voxelize(object: &ObjectDesc, meshes: &Meshes) -> Result<Grid, SceneError> {
    let (bounds, bulge_m) = extent(&object.shape, meshes)?;
    let size_m = size_within(object, &bounds);
    let mut samples = Samples::new(Solid::new(&object.shape, meshes)?, Lattice::over(&bounds, bulge_m, size_m)?)?;
    let left_out = samples.leave_out_small_pieces();
    let Some((first, last)) = samples.occupied() else {
        let extent_m = bounds.extent_m();
        let message = format!(
            "no voxel's centre lies inside: the shape, {:.3e} x {:.3e} x {:.3e} m, is empty or thinner than a \
             voxel of {size_m:.3e} m",
            extent_m.x, extent_m.y, extent_m.z,
        );
        return Err(shape_error(message));
    };
    let lattice = samples.lattice.part(first, last);
    let within_samples = |cell: Ijk| std::array::from_fn(|a| cell[a] + first[a]);
    let filled = lattice.cells().filter(|cell| samples.is_inside(within_samples(*cell)));
    let mut grid = Grid::new(
        size_m,
        lattice.origin_m,
        lattice.dims,
        filled.map(|ijk| Voxel { ijk, material: 0 }).collect(),
        |cell| samples.distance_m[samples.lattice.slot(within_samples(cell))],
        |link| samples.crossing(LinkId { cell: within_samples(link.cell), axis: link.axis }),
    );
    grid.set_left_out(left_out);
    assign_materials(grid, object, meshes)
}

/// Gives each voxel the material of the last region that holds it.
fn assign_materials(mut grid: Grid, object: &ObjectDesc, meshes: &Meshes) -> Result<Grid, SceneError> {
    for (i, region) in object.regions.iter().enumerate() {
        let held = region_voxels(&grid, &region.shape, meshes).map_err(|e| e.within(&format!("regions[{i}]")))?;
        grid.set_material(&held, i as u16 + 1);
    }
    Ok(grid)
}
