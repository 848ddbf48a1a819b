//! The surface of a body, kept once: its own, and the walls of its cuts.
//!
//! A facet is a voxel's face there. An element's facets are summed up at two resolutions: by the way they look and
//! what lies across the cut ([`SurfacePatch`]), which is what tissue and blades press on; and, where a smooth tool is
//! in the scene, in patches as fine as that asks for ([`Skin`]).
//!
//! Links only ever part, so facets only ever come up. An update goes through the facets of the elements that changed
//! and of those across their cuts, not through their voxels.

mod facet;
mod patch;
mod skin;
mod solid;

pub use patch::{PatchKey, SurfacePatch};
pub use skin::{Skin, SkinPatch};
pub(crate) use solid::Solid;

use crate::Vec3;
use crate::grid::LinkId;
use crate::grid::levels::LevelChange;
use facet::Facets;
use serde::{Deserialize, Serialize};

/// The surface of a body.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Boundary {
    #[serde(skip)]
    facets: Facets,
    /// By [`SurfacePatch::key`], ascending.
    #[serde(skip)]
    patches: Vec<SurfacePatch>,
    /// Which of the patches are walls of cuts, ascending.
    #[serde(skip)]
    walls: Vec<u32>,
    /// Present where a smooth tool is in the scene.
    #[serde(skip)]
    skin: Option<Skin>,
    version: u64,
}

impl Boundary {
    /// The whole surface.
    pub(crate) fn of(solid: Solid<'_>) -> Self {
        let mut boundary = Self { facets: Facets::of(solid), ..Self::default() };
        let all: Vec<u32> = (0..solid.level.elements.len() as u32).collect();
        boundary.sum_up(solid, &all);
        boundary
    }

    /// Keeps it in patches as fine as a smooth tool of this radius asks for, too.
    pub(crate) fn resolve(&mut self, solid: Solid<'_>, radius_m: f64) {
        self.skin = Some(Skin::of(solid, &self.facets, radius_m));
    }

    /// Makes anew what follows from the solid, as finely as `like` is kept: `self` was read from a file.
    pub(crate) fn complete(&mut self, solid: Solid<'_>, like: &Self) {
        let version = self.version;
        *self = Self { version, ..Self::of(solid) };
        self.skin = like.skin.as_ref().map(|skin| skin.made_anew(solid, &self.facets));
    }

    /// Takes what came up as links were `parted` in the grid and the elements changed with them.
    pub(crate) fn follow(&mut self, solid: Solid<'_>, parted: &[LinkId], change: &LevelChange) {
        let touched = self.facets.follow(solid, parted, change);
        self.sum_up(solid, &touched);
        if let Some(skin) = &mut self.skin {
            skin.update(solid, &self.facets, &touched);
        }
    }

    fn sum_up(&mut self, solid: Solid<'_>, touched: &[u32]) {
        patch::update(&mut self.patches, solid, &self.facets, touched);
        self.walls.clear();
        let walls = self.patches.iter().enumerate().filter(|(_, patch)| patch.across.is_some());
        self.walls.extend(walls.map(|(index, _)| index as u32));
        self.version += 1;
    }

    /// Goes up whenever the surface changes.
    #[must_use]
    pub fn version(&self) -> u64 {
        self.version
    }

    /// The patches of the whole surface, by [`SurfacePatch::key`].
    #[must_use]
    pub fn patches(&self) -> &[SurfacePatch] {
        &self.patches
    }

    /// Those of them that are walls of cuts.
    pub fn walls(&self) -> impl ExactSizeIterator<Item = &SurfacePatch> {
        self.walls.iter().map(|index| &self.patches[*index as usize])
    }

    /// The surface in finer patches, where a smooth tool is in the scene.
    #[must_use]
    pub fn skin(&self) -> Option<&Skin> {
        self.skin.as_ref()
    }

    /// `int N_a n dA` over the facets of an element, n out of it, by corner a, m^2.
    pub(crate) fn moments_m2(&self, solid: Solid<'_>, element: usize) -> &[Vec3; 8] {
        self.facets.moments_m2(solid, element)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Grid;
    use crate::grid::cell_sizes::CellSizes;
    use crate::grid::levels::Level;
    use crate::grid::units::VoxelUnits;
    use crate::grid::{Crossing, Ijk, Voxel};

    const EXPONENT: u8 = 2;

    /// A ball of a radius of 8 voxels of 2.5 mm, in elements of 4 voxels a side.
    fn ball() -> (Grid, Level) {
        let offset = |cell: Ijk| Vec3::from(cell.map(|c| f64::from(c) - 8.5));
        let cells = (0..18).flat_map(|k| (0..18).flat_map(move |j| (0..18).map(move |i| [i, j, k])));
        let voxels = cells.filter(|cell| offset(*cell).norm() < 8.0).map(|ijk| Voxel { ijk, material: 0 }).collect();
        let distance = |cell: Ijk| (2.5e-3 * (offset(cell).norm() - 8.0)) as f32;
        let crossing = |link: LinkId| {
            let [low, high] = [link.cell, link.upper()].map(|cell| offset(cell).norm() - 8.0);
            let t = low / (low - high);
            let at = offset(link.cell) + Vec3::ith(link.axis as usize, t);
            Crossing { t: t as f32, normal: at.normalize().map(|c| c as f32).into() }
        };
        let grid = Grid::new(2.5e-3, Vec3::zeros(), [18; 3], voxels, distance, crossing);
        let level = Level::base(&VoxelUnits { grid: &grid, exponent: EXPONENT }, CellSizes::graded([5; 3], 0, |_| 0));
        (grid, level)
    }

    /// Parts the links up from a layer of cells, in columns of `x`.
    fn part(grid: &mut Grid, level: &mut Level, y: i32, x: std::ops::Range<i32>) -> (Vec<LinkId>, LevelChange) {
        let crossing = Crossing { t: 0.5, normal: [0.0, 1.0, 0.0] };
        let links = (0..18).flat_map(|z| x.clone().map(move |x| LinkId { cell: [x, y, z], axis: 1 }));
        let parted: Vec<LinkId> = links.filter(|link| grid.part(*link, crossing)).collect();
        let cells = parted.iter().flat_map(|link| [link.cell, link.upper()]).map(|c| c.map(|x| x >> EXPONENT));
        let change = level.update(&VoxelUnits { grid, exponent: EXPONENT }, cells.collect::<Vec<_>>().into_iter());
        (parted, change)
    }

    fn moments(boundary: &Boundary, solid: Solid<'_>) -> Vec<[Vec3; 8]> {
        (0..solid.level.elements.len()).map(|element| *boundary.moments_m2(solid, element)).collect()
    }

    #[test]
    fn a_ball_has_the_surface_of_a_sphere_at_both_resolutions() {
        let (grid, level) = ball();
        let solid = Solid { grid: &grid, level: &level };
        let mut boundary = Boundary::of(solid);
        boundary.resolve(solid, 1e-2);
        let sphere_m2 = 4.0 * std::f64::consts::PI * 0.02_f64.powi(2);
        let patches_m2: f64 = boundary.patches().iter().map(|patch| patch.area_m2).sum();
        let elements = 0..level.elements.len() as u32;
        let skin = boundary.skin().unwrap();
        let skin_m2: f64 = elements.flat_map(|element| skin.of_element(element)).map(|patch| patch.area_m2).sum();
        assert!((patches_m2 / sphere_m2 - 1.0).abs() < 0.05, "{patches_m2} of {sphere_m2}");
        assert!((skin_m2 / patches_m2 - 1.0).abs() < 1e-12, "{skin_m2} of {patches_m2}");
        assert!(skin.len() > boundary.patches().len());
        let open_m2: Vec3 = moments(&boundary, solid).iter().flatten().sum();
        assert!(open_m2.norm() < 0.01 * sphere_m2, "{open_m2:?}");
    }

    #[test]
    fn it_follows_cuts_to_what_it_would_be_if_it_were_made_anew() {
        let (mut grid, mut level) = ball();
        let mut boundary = Boundary::of(Solid { grid: &grid, level: &level });
        boundary.resolve(Solid { grid: &grid, level: &level }, 1e-2);
        // Within a layer of elements: half way, on by a column, and through; then between two layers.
        for (y, x) in [(9, 0..9), (9, 9..10), (9, 10..18), (7, 0..9), (7, 9..18)] {
            let (parted, change) = part(&mut grid, &mut level, y, x);
            assert!(parted.len() > 10);
            let solid = Solid { grid: &grid, level: &level };
            boundary.follow(solid, &parted, &change);
            let mut anew = Boundary::of(solid);
            anew.resolve(solid, 1e-2);
            assert_eq!(boundary.patches(), anew.patches());
            assert_eq!(boundary.walls, anew.walls);
            assert_eq!(boundary.skin(), anew.skin());
            assert_eq!(moments(&boundary, solid), moments(&anew, solid));
        }
        // A wall has two sides, which close each other.
        assert!(boundary.walls().len() > 20);
        let walls: Vec3 = boundary.walls().map(|wall| wall.normal * wall.area_m2).sum();
        assert!(walls.norm() < 1e-12, "{walls:?}");
    }
}
