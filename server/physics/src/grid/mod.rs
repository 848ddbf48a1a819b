//! Fine voxels and the links between face neighbours: the topology of one object.
//!
//! Invariants: a link is one record shared by its two voxels and is either intact or has a crossing;
//! a crossing never goes away; voxels are never added or removed. Voxel `(i, j, k)` is the cube
//! `origin + h [i, i+1] x [j, j+1] x [k, k+1]` of the reference configuration.

pub(crate) mod cell_sizes;
pub(crate) mod implicit;
pub(crate) mod lattice;
pub(crate) mod levels;
mod mesh;
mod mesh_faces;
pub mod missed;
mod parted;
mod ranked;
mod small_pieces;
pub mod thickness;
pub(crate) mod units;
pub mod voxelize;

use crate::Vec3;
use crate::walk::{Kept, WalkError};
use parted::PartedPlaces;
use ranked::RankedSet;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

pub use small_pieces::LeftOut;

/// Integer coordinates of a voxel.
pub type Ijk = [i32; 3];

/// Index of a voxel in [`Grid::voxels`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct VoxelId(pub u32);

impl VoxelId {
    /// As a slice index.
    #[must_use]
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// A point of the reference configuration, followed through the element of one of its voxels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MaterialPoint {
    /// Reference position, m.
    pub position_m: Vec3,
    /// Voxel whose element it moves with.
    pub voxel: VoxelId,
}

/// One fine voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Voxel {
    /// Integer coordinates, each in `0..dims[axis]`.
    pub ijk: Ijk,
    /// Index into the object's material list (0 = the object's own, then its regions in order).
    pub material: u16,
}

/// A link of the lattice: the segment from the centre of cell `cell` to that of its neighbour in
/// `+axis`. Either end may be outside the object.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct LinkId {
    /// Cell at the link's lower end; coordinates from -1.
    pub cell: Ijk,
    /// 0, 1, 2 for x, y, z.
    pub axis: u8,
}

impl LinkId {
    /// The cell at the link's upper end.
    #[must_use]
    pub fn upper(self) -> Ijk {
        let mut cell = self.cell;
        cell[self.axis as usize] += 1;
        cell
    }
}

/// Where a surface crosses a link, and its normal there.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Crossing {
    /// Position along the link from its lower end, in 0..=1.
    pub t: f32,
    /// Unit normal of the surface in the reference configuration. On a link to the outside it points
    /// out of the object; on a parted link it points from the lower to the upper end's side.
    pub normal: [f32; 3],
}

/// State of a link that has at least one end inside the object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Link {
    /// Both ends inside, material connected.
    Intact,
    /// Both ends inside, parted by a blade.
    Parted(Crossing),
    /// One end outside: the object's own surface.
    Boundary(Crossing),
    /// Both ends outside.
    Outside,
}

/// No piece of fewer voxels is built or set free, an eighth of a composite element at k = 4: it could neither be
/// seen for what it is nor be carried by the elements' corners, which its few voxels hardly load.
pub const LEAST_PIECE_VOXELS: usize = 8;

/// Least extent of what is filled along an axis, in voxels: what a surface only grazes is to have some stiffness.
const LEAST_EXTENT: f64 = 0.05;

/// Links that are a cell's: those to its upper neighbours.
const LINKS_OF_CELL: usize = 3;

/// Voxels, links and crossings of one object: what never changes, which copies share, and the links that are parted.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Grid {
    #[serde(skip)]
    cells: Arc<Cells>,
    /// Where the links that are parted stand among them.
    #[serde(skip)]
    places: PartedPlaces,
    /// Links that are parted, and where.
    parted: Kept<Vec<(LinkId, Crossing)>>,
}

/// What of a grid never changes.
#[derive(Clone, Debug, Default)]
struct Cells {
    voxel_size_m: f64,
    origin_m: Vec3,
    dims: [i32; 3],
    /// By z, then y, then x.
    voxels: Vec<Voxel>,
    /// Slots of the cells that they fill, in the box `-1..dims + 1`, x fastest.
    filled: RankedSet,
    /// Keys of the links that the object's own surface crosses.
    at_surface: RankedSet,
    /// Where it crosses them, in this order.
    crossings: Vec<Crossing>,
    /// Signed distance at the centre of each cell of the same box, m, negative inside.
    signed_distance_m: Vec<f32>,
    left_out: LeftOut,
}

impl Grid {
    /// A grid of `voxels` in a box of `dims` cells. `signed_distance_m(ijk)` is sampled at the cell
    /// centres of the box `-1..dims + 1`; `boundary(link)` gives the crossing of each link that has
    /// exactly one end inside.
    #[must_use]
    pub fn new(
        voxel_size_m: f64,
        origin_m: Vec3,
        dims: [i32; 3],
        mut voxels: Vec<Voxel>,
        signed_distance_m: impl Fn(Ijk) -> f32,
        boundary: impl Fn(LinkId) -> Crossing,
    ) -> Self {
        let count = dims.iter().map(|d| (d + 2) as usize).product();
        voxels.sort_unstable_by_key(|voxel| [voxel.ijk[2], voxel.ijk[1], voxel.ijk[0]]);
        voxels.shrink_to_fit();
        let mut cells = Cells { voxel_size_m, origin_m, dims, voxels, ..Cells::default() };
        let slots = cells.voxels.iter().map(|voxel| cells.slot(voxel.ijk).expect("voxel lies in the box"));
        cells.filled = RankedSet::new(count, slots);
        cells.signed_distance_m.reserve_exact(count);
        cells.signed_distance_m.extend(cells.lattice().map(signed_distance_m));
        let links = cells.lattice().flat_map(|cell| (0..3u8).map(move |axis| LinkId { cell, axis }));
        let is_inside = |cell: Ijk| cells.voxel_at(cell).is_some();
        let at_surface: Vec<LinkId> = links.filter(|link| is_inside(link.cell) != is_inside(link.upper())).collect();
        let keys = at_surface.iter().map(|link| cells.key(*link).expect("link lies in the box"));
        cells.at_surface = RankedSet::new(LINKS_OF_CELL * count, keys);
        cells.crossings = at_surface.into_iter().map(boundary).collect();
        cells.crossings.shrink_to_fit();
        let places = PartedPlaces::none(LINKS_OF_CELL * count);
        Self { cells: Arc::new(cells), places, parted: Kept::default() }
    }

    /// Takes all that never changes of a grid of the same object: `self` was read from a file. Refuses links that cannot
    /// be parted.
    pub(crate) fn complete(&mut self, like: &Self) -> Result<(), WalkError> {
        self.cells = Arc::clone(&like.cells);
        self.places = PartedPlaces::none(LINKS_OF_CELL * self.cells.signed_distance_m.len());
        for (link, crossing) in std::mem::take(&mut *self.parted) {
            // Of a link that no lattice has the upper end cannot even be asked for.
            let is_in_box = link.axis < 3 && self.slot(link.cell).is_some();
            if !is_in_box || !self.part(link, crossing) {
                return Err(WalkError::new(format!("{link:?} is parted, and no link of the object")));
            }
        }
        Ok(())
    }

    fn slot(&self, cell: Ijk) -> Option<usize> {
        self.cells.slot(cell)
    }

    fn key(&self, link: LinkId) -> usize {
        self.cells.key(link).expect("link lies in the box")
    }

    /// Gives voxels a material.
    fn set_material(&mut self, voxels: &[VoxelId], material: u16) {
        let cells = Arc::make_mut(&mut self.cells);
        voxels.iter().for_each(|id| cells.voxels[id.index()].material = material);
    }

    /// Says what of the shape was left out.
    fn set_left_out(&mut self, left_out: LeftOut) {
        Arc::make_mut(&mut self.cells).left_out = left_out;
    }

    /// Edge length of a voxel, m.
    #[must_use]
    pub fn voxel_size_m(&self) -> f64 {
        self.cells.voxel_size_m
    }

    /// Reference position of the corner (0, 0, 0) of voxel (0, 0, 0), m.
    #[must_use]
    pub fn origin_m(&self) -> Vec3 {
        self.cells.origin_m
    }

    /// Extent of the box that holds every voxel, in voxels.
    #[must_use]
    pub fn dims(&self) -> [i32; 3] {
        self.cells.dims
    }

    /// What of the shape was left out.
    #[must_use]
    pub fn left_out(&self) -> LeftOut {
        self.cells.left_out
    }

    /// Every voxel.
    #[must_use]
    pub fn voxels(&self) -> &[Voxel] {
        &self.cells.voxels
    }

    /// The voxel at `cell`, if the object fills it.
    #[must_use]
    pub fn voxel_at(&self, cell: Ijk) -> Option<VoxelId> {
        self.cells.voxel_at(cell)
    }

    /// Voxels in `cell` and in the 26 cells around it.
    pub(crate) fn voxels_around(&self, cell: Ijk) -> impl Iterator<Item = VoxelId> + '_ {
        let around = (0..27).map(move |n| [cell[0] - 1 + n % 3, cell[1] - 1 + n / 3 % 3, cell[2] - 1 + n / 9]);
        around.filter_map(|cell| self.voxel_at(cell))
    }

    /// Centre of a cell in the reference configuration, m.
    #[must_use]
    pub fn centre_m(&self, cell: Ijk) -> Vec3 {
        self.origin_m() + Vec3::from_fn(|a, _| (f64::from(cell[a]) + 0.5) * self.voxel_size_m())
    }

    /// The cell that holds a reference position.
    #[must_use]
    pub fn cell_of(&self, position_m: &Vec3) -> Ijk {
        let local = (position_m - self.origin_m()) / self.voxel_size_m();
        [local.x.floor() as i32, local.y.floor() as i32, local.z.floor() as i32]
    }

    /// State of a link.
    #[must_use]
    pub fn link(&self, link: LinkId) -> Link {
        let lower = self.voxel_at(link.cell).is_some();
        let upper = self.voxel_at(link.upper()).is_some();
        match (lower, upper) {
            (false, false) => Link::Outside,
            (true, true) => {
                let place = self.places.place(self.key(link));
                place.map_or(Link::Intact, |place| Link::Parted(self.parted[place].1))
            }
            _ => {
                let place = self.cells.at_surface.rank(self.key(link));
                Link::Boundary(self.cells.crossings[place.expect("the surface crosses the link") as usize])
            }
        }
    }

    /// How far the object fills a voxel and what lies between it and the surface, along each axis and in voxels: half a
    /// voxel to each side, or up to where the surface crosses the link. Of a surface that is oblique each axis counts by
    /// the square of the normal's share: along any axis the links that cross it bound all of what lies inside.
    #[must_use]
    pub(crate) fn filled_extents(&self, voxel: VoxelId) -> [f64; 3] {
        let cell = self.cells.voxels[voxel.index()].ijk;
        let mut extents = [1.0; 3];
        for (link, _) in Self::links_of(cell) {
            if let Link::Boundary(Crossing { t, normal }) = self.link(link) {
                let axis = link.axis as usize;
                let reach = if link.cell == cell { f64::from(t) } else { 1.0 - f64::from(t) };
                extents[axis] += f64::from(normal[axis]).powi(2) * (reach - 0.5);
            }
        }
        extents.map(|extent| extent.max(LEAST_EXTENT))
    }

    /// The share of a voxel that the object fills, with what of it reaches beyond the voxel up to the surface.
    #[must_use]
    pub(crate) fn filled_share(&self, voxel: VoxelId) -> f64 {
        self.filled_extents(voxel).iter().product()
    }

    /// Whether the face neighbours at the link's ends are both inside and connected.
    #[must_use]
    pub fn is_intact(&self, link: LinkId) -> bool {
        let (Some(lower), Some(upper)) = (self.slot(link.cell), self.slot(link.upper())) else { return false };
        let is_filled = |slot| self.cells.filled.contains(slot);
        is_filled(lower) && is_filled(upper) && !self.places.contains(LINKS_OF_CELL * lower + usize::from(link.axis))
    }

    /// Parts an intact link; a link that is parted already keeps its first crossing.
    /// Returns whether the link was intact.
    pub fn part(&mut self, link: LinkId, crossing: Crossing) -> bool {
        let intact = self.is_intact(link);
        if intact {
            self.places.insert(self.key(link), self.parted.len());
            self.parted.push((link, crossing));
        }
        intact
    }

    /// Makes a parted link intact again.
    pub(crate) fn rejoin(&mut self, link: LinkId) {
        let place = self.places.remove(self.key(link));
        self.parted.swap_remove(place);
        if let Some(&(moved, _)) = self.parted.get(place) {
            self.places.insert(self.key(moved), place);
        }
    }

    /// The voxels connected with `voxel` where there are fewer than `limit` of them; else `None`.
    #[must_use]
    pub(crate) fn small_piece(&self, voxel: Ijk, limit: usize) -> Option<Vec<Ijk>> {
        let mut piece = vec![voxel];
        let mut next = 0;
        while next < piece.len() {
            for (link, other) in Self::links_of(piece[next]) {
                if self.is_intact(link) && !piece.contains(&other) {
                    piece.push(other);
                    if piece.len() == limit {
                        return None;
                    }
                }
            }
            next += 1;
        }
        Some(piece)
    }

    /// The six links of a cell with their other ends: -x, +x, -y, +y, -z, +z.
    pub fn links_of(cell: Ijk) -> impl Iterator<Item = (LinkId, Ijk)> {
        (0..6u8).map(move |face| Self::link_of(cell, face))
    }

    /// One of these.
    pub(crate) fn link_of(cell: Ijk, face: u8) -> (LinkId, Ijk) {
        let axis = (face / 2) as usize;
        let mut other = cell;
        other[axis] += if face.is_multiple_of(2) { -1 } else { 1 };
        let lower = if face.is_multiple_of(2) { other } else { cell };
        (LinkId { cell: lower, axis: axis as u8 }, other)
    }

    /// Signed distance at a cell's centre, m, if it was sampled there.
    fn sampled_distance_m(&self, cell: Ijk) -> Option<f64> {
        Some(f64::from(self.cells.signed_distance_m[self.cells.slot(cell)?]))
    }

    /// Signed distance to the object's own (uncut) surface at a reference position, m, negative
    /// inside; trilinear between cell centres, `f64::INFINITY` outside the sampled box.
    #[must_use]
    pub fn signed_distance_m(&self, position_m: &Vec3) -> f64 {
        let local = (position_m - self.origin_m()) / self.voxel_size_m() - Vec3::repeat(0.5);
        let base = local.map(f64::floor);
        let frac = local - base;
        let base = [base.x as i32, base.y as i32, base.z as i32];
        let mut value = 0.0;
        for corner in 0..8 {
            let mut weight = 1.0;
            let mut cell = base;
            for axis in 0..3 {
                let up = (corner >> axis) & 1;
                cell[axis] += up;
                weight *= if up == 1 { frac[axis] } else { 1.0 - frac[axis] };
            }
            let Some(slot) = self.slot(cell) else { return f64::INFINITY };
            value += weight * f64::from(self.cells.signed_distance_m[slot]);
        }
        value
    }
}

impl Cells {
    /// The cells of the box, x fastest.
    fn lattice(&self) -> impl Iterator<Item = Ijk> + use<> {
        let [nx, ny, nz] = self.dims;
        (-1..=nz).flat_map(move |z| (-1..=ny).flat_map(move |y| (-1..=nx).map(move |x| [x, y, z])))
    }

    fn slot(&self, cell: Ijk) -> Option<usize> {
        let mut slot = 0usize;
        for axis in (0..3).rev() {
            if cell[axis] < -1 || cell[axis] > self.dims[axis] {
                return None;
            }
            slot = slot * (self.dims[axis] + 2) as usize + (cell[axis] + 1) as usize;
        }
        Some(slot)
    }

    /// The number of a link in the box, of those of its lower cell.
    fn key(&self, link: LinkId) -> Option<usize> {
        Some(LINKS_OF_CELL * self.slot(link.cell)? + usize::from(link.axis))
    }

    fn voxel_at(&self, cell: Ijk) -> Option<VoxelId> {
        self.filled.rank(self.slot(cell)?).map(VoxelId)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parted_links_that_the_object_does_not_have_are_refused() {
        let voxels = [0, 1].map(|i| Voxel { ijk: [i, 0, 0], material: 0 });
        let crossing = Crossing { t: 0.5, normal: [1.0, 0.0, 0.0] };
        let whole = Grid::new(1.0, Vec3::zeros(), [2, 1, 1], voxels.to_vec(), |_| 0.0, |_| crossing);
        let complete = |cell, axis| {
            let mut read = whole.clone();
            read.parted.push((LinkId { cell, axis }, crossing));
            read.complete(&whole)
        };
        assert!(complete([0, 0, 0], 0).is_ok());
        for (cell, axis) in [([1, 0, 0], 0), ([0, 0, 0], 3), ([0, 0, 0], 255), ([i32::MAX; 3], 0), ([i32::MIN; 3], 2)] {
            assert!(complete(cell, axis).is_err(), "{cell:?}, axis {axis}");
        }
    }
}
