//! A symmetric V-cycle over the levels of composite elements: the preconditioner of the solve.
//!
//! Coarse operators are Galerkin products of the one below, element by element and in the rest frame,
//! turned by each coarse element's own rotation; parts are never joined through a coarse cell because
//! coarse elements are components of linked children.

use super::assembly::LANES;
use super::coarsest::{Coarsest, orthonormal};
use super::cycle_level::CycleLevel;
use super::lag;
use super::operator::Operator;
use super::spring::{POINT_NODES, PointSpring};
use crate::fem::lanes::{PACKED, pack, unpack};
use crate::grid::levels::{Level, LevelChange};
use crate::walk::WalkError;
use crate::workers::{Grain, Workers};
use serde::{Deserialize, Serialize};
use wide::f32x4;

/// No eigenvalue of `D^-1 A` is larger: an element or a spring that moves n unknowns takes at most n times what
/// it has on their diagonals.
const MOST_EIGENVALUE: f32 = POINT_NODES as f32;
/// Blocks of coarse elements per chunk of parallel work.
const BLOCKS_PER_CHUNK: usize = 32;
/// Of their rotations: 20 us a chunk.
const ROTATION_GRAIN: Grain = Grain { chunk: BLOCKS_PER_CHUNK, least: 1 };

/// The levels of one object, the finest (the one that is solved on) first.
#[derive(Clone, Serialize, Deserialize)]
pub struct Multigrid {
    #[serde(with = "super::lag")]
    levels: Vec<CycleLevel>,
    coarsest: Coarsest,
}

/// `P^T A P` with `P = weights (x) I3`, packed in and out.
fn galerkin(child: &[f64; PACKED], weights: &[[f64; 8]; 8]) -> [f64; PACKED] {
    let full = unpack(child);
    let mut half = [[0.0; 24]; 24];
    for a in 0..8 {
        for p in 0..8 {
            let w = weights[a][p];
            if w != 0.0 {
                for i in 0..3 {
                    for column in 0..24 {
                        half[3 * p + i][column] += w * full[3 * a + i][column];
                    }
                }
            }
        }
    }
    let mut out = [[0.0; 24]; 24];
    for b in 0..8 {
        for q in 0..8 {
            let w = weights[b][q];
            if w != 0.0 {
                for row in 0..24 {
                    for j in 0..3 {
                        out[row][3 * q + j] += w * half[row][3 * b + j];
                    }
                }
            }
        }
    }
    pack(&out)
}

impl Multigrid {
    /// Builds the cycle over `hierarchy`, finest first. The matrices of the finest level are to be set
    /// through [`Operator::set_matrix`] and then completed by [`Self::rebuild`].
    #[must_use]
    pub fn new(hierarchy: &[Level]) -> Self {
        let mut levels: Vec<CycleLevel> = hierarchy.iter().map(CycleLevel::new).collect();
        for (i, level) in levels.iter_mut().enumerate() {
            level.set_topology(&hierarchy[i], hierarchy.get(i + 1), None);
        }
        let coarsest = Coarsest::new(&levels[levels.len() - 1].operator);
        Self { levels, coarsest }
    }

    /// Completes a cycle of which only is there what follows the state with a lag, as it was read, by what a new cycle
    /// over `hierarchy` has. The matrices of the finest level and all rotations are still to be set, and
    /// [`Self::invert_diagonals`] to be called.
    pub fn complete(&mut self, hierarchy: &[Level]) -> Result<(), WalkError> {
        let fresh = Self::new(hierarchy);
        let read = std::mem::replace(self, fresh);
        lag::complete(read.levels, &mut self.levels, hierarchy)?;
        self.coarsest.take_factors(read.coarsest)
    }

    /// Inverts every diagonal as it is. Springs are dropped.
    pub fn invert_diagonals(&mut self, workers: &Workers<'_>) {
        self.levels.iter_mut().for_each(|level| level.operator.invert_diagonal(workers));
    }

    /// Estimates the smoothers' eigenvalues afresh, and higher than they were: the estimates stay when links
    /// part and may lie below the new truth, and a smoother made for too short a spectrum is indefinite.
    pub fn widen_spectrum(&mut self, workers: &Workers<'_>) {
        for level in &mut self.levels {
            let before = level.largest_eigenvalue;
            level.estimate_eigenvalue(workers);
            level.largest_eigenvalue = level.largest_eigenvalue.max((1.3 * before).min(MOST_EIGENVALUE));
        }
    }

    /// The finest level's operator.
    #[must_use]
    pub fn operator(&self) -> &Operator {
        &self.levels[0].operator
    }

    /// The finest level's operator.
    pub fn operator_mut(&mut self) -> &mut Operator {
        &mut self.levels[0].operator
    }

    /// Takes the elements and nodes of `hierarchy`, changed as `changes` of each level say; `None`: all of
    /// them. There is room for the matrices of new elements of the finest level, which are to be set before
    /// [`Self::update_changed`]. Returns the chunks of the finest level whose numbering changed.
    pub fn set_topology(&mut self, hierarchy: &[Level], changes: Option<&[LevelChange]>) -> Vec<usize> {
        let elements: Option<Vec<Vec<u32>>> = changes.map(|c| c.iter().map(LevelChange::elements).collect());
        let mut renumbered = Vec::new();
        for (i, level) in self.levels.iter_mut().enumerate() {
            let changed = elements.as_ref().map(|e| [&e[i][..], e.get(i + 1).map_or(&[][..], |above| &above[..])]);
            let chunks = level.set_topology(&hierarchy[i], hierarchy.get(i + 1), changed);
            if i == 0 {
                renumbered = chunks;
            }
        }
        renumbered
    }

    /// Recomputes what `changes` and other matrices of `elements` touched above the finest level, whose matrices already
    /// reflect them. [`Self::update_rotations`] and [`Self::update_diagonals`] complete it.
    pub fn update_changed(&mut self, hierarchy: &[Level], changes: &[LevelChange], elements: &[u32]) {
        let mut touched: Vec<u32> =
            changes[1..].first().map_or(Vec::new(), |c| elements_in_cells(&hierarchy[1], &c.touched_cells));
        if let Some(above) = hierarchy.get(1) {
            touched.extend(elements.iter().map(|element| above.owner[*element as usize]));
            touched.sort_unstable();
            touched.dedup();
        }
        self.rebuild_coarse(&mut touched);
        self.factor_coarsest();
    }

    /// Recomputes the coarse matrices above all elements, the coarsest factor and the eigenvalues.
    pub fn rebuild(&mut self, workers: &Workers<'_>, hierarchy: &[Level]) {
        let mut all = hierarchy.get(1).map_or(Vec::new(), |level| (0..level.elements.len() as u32).collect());
        self.rebuild_coarse(&mut all);
        self.factor_coarsest();
        self.update_rotations(workers);
        self.update_diagonals(workers);
        self.levels.iter_mut().for_each(|l| l.estimate_eigenvalue(workers));
    }

    fn factor_coarsest(&mut self) {
        self.coarsest = Coarsest::new(&self.levels[self.levels.len() - 1].operator);
    }

    /// Recomputes the matrices of `elements` of the second level and of everything above them;
    /// `elements` are used up.
    pub fn rebuild_coarse(&mut self, elements: &mut Vec<u32>) {
        for i in 1..self.levels.len() {
            let (below, above) = self.levels.split_at_mut(i);
            let (child, parent) = (&below[i - 1], &mut above[0]);
            for &element in elements.iter() {
                let mut sum = [0.0; PACKED];
                for &c in child.children.list(element as usize) {
                    let weights = child.weights(c as usize, &parent.operator);
                    let part = galerkin(&child.operator.matrix(c as usize), &weights);
                    (0..PACKED).for_each(|j| sum[j] += part[j]);
                }
                parent.operator.set_matrix(element as usize, &sum);
            }
            if parent.parent.is_empty() {
                break;
            }
            elements.iter_mut().for_each(|e| *e = parent.parent[*e as usize]);
            elements.sort_unstable();
            elements.dedup();
        }
        elements.clear();
    }

    /// Coarse rotations from the finest level's.
    pub fn update_rotations(&mut self, workers: &Workers<'_>) {
        for i in 1..self.levels.len() {
            let (below, above) = self.levels.split_at_mut(i);
            inherit_rotations(workers, &below[i - 1], &mut above[0].operator);
        }
        let last = self.levels.len() - 1;
        self.coarsest.update_rotations(&self.levels[last].operator);
    }

    /// Every diagonal. Springs are dropped.
    pub fn update_diagonals(&mut self, workers: &Workers<'_>) {
        self.levels.iter_mut().for_each(|l| l.operator.update_diagonal(workers));
    }

    /// Stores once what blocks of elements have in common: for matrices that stay until links part.
    pub fn share_matrices(&mut self) {
        self.levels.iter_mut().for_each(|l| l.operator.share_matrices());
    }

    /// Room for `count` springs on every level.
    pub fn reserve_springs(&mut self, count: usize) {
        self.levels.iter_mut().for_each(|l| l.operator.reserve_springs(count));
        if count > 0 {
            self.coarsest.reserve(count);
        }
    }

    /// Replaces the springs on every level.
    pub fn set_springs(&mut self, springs: impl Iterator<Item = PointSpring>) {
        let first = &mut self.levels[0];
        first.operator.set_springs(springs, first.largest_eigenvalue);
        for i in 1..self.levels.len() {
            let (below, above) = self.levels.split_at_mut(i);
            let fine = &below[i - 1];
            let spread = |node: usize| fine.prolongation[node].iter();
            let spread = fine.operator.springs().iter().map(|s| s.spread(spread));
            above[0].operator.set_springs(spread, above[0].largest_eigenvalue);
        }
        self.coarsest.set_springs(&self.levels[self.levels.len() - 1].operator);
    }

    /// The finest level, whose `b` is the residual to be preconditioned.
    pub(super) fn finest_mut(&mut self) -> &mut CycleLevel {
        &mut self.levels[0]
    }

    /// Right side of the finest level; after a solve what is left of the residual.
    pub fn residual(&self) -> &[f32x4] {
        &self.levels[0].b
    }

    /// One V-cycle on `A x = b` of the finest level, from zero.
    pub fn precondition(&mut self, workers: &Workers<'_>) {
        self.cycle(workers, 0);
    }

    fn cycle(&mut self, workers: &Workers<'_>, i: usize) {
        let last = i + 1 == self.levels.len();
        let level = &mut self.levels[i];
        if last {
            if i > 0 {
                self.coarsest.solve(&level.operator, &level.b, &mut level.x);
            } else {
                level.smooth(workers, true);
            }
            return;
        }
        level.smooth(workers, true);
        let (fine, coarse) = self.levels.split_at_mut(i + 1);
        fine[i].restrict(workers, &mut coarse[0].b);
        self.cycle(workers, i + 1);
        let (fine, coarse) = self.levels.split_at_mut(i + 1);
        fine[i].prolongate(workers, &coarse[0].x);
        fine[i].smooth(workers, false);
    }
}

fn elements_in_cells(level: &Level, cells: &[[i32; 3]]) -> Vec<u32> {
    let mut elements: Vec<u32> = cells.iter().flat_map(|&cell| level.elements_in(cell)).collect();
    elements.sort_unstable();
    elements
}

/// The rotation of a coarse element is the normalised sum of its children's.
fn inherit_rotations(workers: &Workers<'_>, child: &CycleLevel, parent: &mut Operator) {
    let count = parent.element_count();
    workers.for_chunks(&mut parent.blocks[..], ROTATION_GRAIN, |chunk, blocks| {
        for (index, block) in (chunk * BLOCKS_PER_CHUNK..).zip(blocks) {
            for lane in 0..LANES.min(count - index * LANES) {
                let mut sum = [0.0; 9];
                for &element in child.children.list(index * LANES + lane) {
                    let r = child.operator.rotation(element as usize);
                    (0..9).for_each(|i| sum[i] += r[i]);
                }
                block.set_rotation(lane, &orthonormal(&sum));
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::composite::{CompositeTables, Field, FilledVoxel};
    use crate::fem::material::Elastic;
    use crate::grid::cell_sizes::CellSizes;
    use crate::grid::units::VoxelUnits;
    use crate::grid::voxelize::voxelize;
    use crate::grid::{Crossing, Grid, LinkId};
    use crate::scene::SceneDesc;
    use crate::solve::vectors::NodeVector;

    const SCENE: &str = r#"
        version = 1
        name = "block"
        [[objects]]
        name = "block"
        shape = { box = { min_m = [0.0, 0.0, 0.0], max_m = [0.2, 0.13, 0.15] } }
        voxel_size_m = 0.01
        level = 0
        material = { young_modulus_pa = 1e5, poisson_ratio = 0.4 }
    "#;

    /// `A_above x` against `P^T A P x` of the level below, largest difference over the largest entry.
    fn coarse_operator_error(sizes: CellSizes, grid: &Grid) -> f32 {
        let base = Level::base(&VoxelUnits { grid, exponent: 0 }, sizes);
        let above = base.above();
        let levels = [base, above];
        let mut multigrid = Multigrid::new(&levels);
        multigrid.set_topology(&levels, None);
        let elastic = Elastic::new(1e5, 0.3, 1000.0);
        for (element, data) in levels[0].elements.iter().enumerate() {
            let tables = CompositeTables::new(data.size.ilog2() as u8, 0.01);
            let filled: Vec<_> =
                (0..data.size.pow(3) as usize).map(|voxel| FilledVoxel::whole(voxel, elastic)).collect();
            multigrid.operator_mut().set_matrix(element, &pack(&tables.assemble(&filled, Field::Trilinear).stiffness));
        }
        let workers = Workers::serial();
        multigrid.rebuild(&workers, &levels);
        let entry = |i: usize| f32x4::new([(i as f32).sin(), (1.7 * i as f32).cos(), (0.3 * i as f32).sin(), 0.0]);
        let x: NodeVector = (0..levels[1].nodes.len()).map(entry).collect();
        let (below, above) = multigrid.levels.split_at_mut(1);
        let (below, above) = (&mut below[0], &mut above[0]);
        let mut direct = vec![f32x4::ZERO; x.len()];
        above.operator.apply(&workers, &x, &mut direct);
        below.x.fill(f32x4::ZERO);
        below.prolongate(&workers, &x);
        below.b.fill(f32x4::ZERO);
        let mut through = vec![f32x4::ZERO; x.len()];
        below.restrict(&workers, &mut through);
        let largest = |v: &[f32x4]| v.iter().flat_map(|v| v.to_array()).fold(0.0, |most: f32, v| most.max(v.abs()));
        // The residual of b = 0 is -A P x.
        let difference: Vec<f32x4> = direct.iter().zip(&through).map(|(a, b)| *a + *b).collect();
        largest(&difference) / largest(&direct)
    }

    #[test]
    fn a_coarse_operator_is_the_galerkin_product_also_where_nodes_hang() {
        let desc = SceneDesc::from_toml("block.toml", SCENE).expect("a scene");
        let grid = voxelize(&desc.objects[0], &Default::default()).expect("a valid object");
        let graded = || CellSizes::graded(grid.dims(), 1, |cell| u8::from(cell[0] >= 8));
        for sizes in [CellSizes::uniform(grid.dims()), graded()] {
            let error = coarse_operator_error(sizes, &grid);
            assert!(error < 1e-5, "{error}");
        }
    }

    #[test]
    fn what_cuts_change_step_by_step_is_what_a_new_cycle_has() {
        let desc = SceneDesc::from_toml("block.toml", SCENE).expect("a scene");
        let mut grid = voxelize(&desc.objects[0], &Default::default()).expect("a valid object");
        let mut levels = vec![Level::base(&VoxelUnits { grid: &grid, exponent: 0 }, CellSizes::uniform(grid.dims()))];
        while levels[levels.len() - 1].nodes.len() > 60 {
            levels.push(levels[levels.len() - 1].above());
        }
        let mut multigrid = Multigrid::new(&levels);
        let mut random = 7u64;
        let mut below = |n: i32| {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((random >> 33) % n as u64) as i32
        };
        for _ in 0..8 {
            let crossing = Crossing { t: 0.5, normal: [1.0, 0.0, 0.0] };
            let links: Vec<LinkId> =
                (0..300).map(|_| LinkId { cell: [below(20), below(13), below(15)], axis: below(3) as u8 }).collect();
            let parted = links.iter().filter(|link| grid.part(**link, crossing));
            let touched: Vec<[i32; 3]> = parted.flat_map(|link| [link.cell, link.upper()]).collect();
            let units = VoxelUnits { grid: &grid, exponent: 0 };
            let mut changes = vec![levels[0].update(&units, touched.into_iter())];
            for i in 1..levels.len() {
                let touched = changes[i - 1].touched_cells.clone();
                let (below, above) = levels.split_at_mut(i);
                changes.push(above[0].update(&below[i - 1], touched.into_iter().map(|c| c.map(|x| x >> 1))));
            }
            multigrid.set_topology(&levels, Some(&changes));
            let fresh = Multigrid::new(&levels);
            for (updated, fresh) in multigrid.levels.iter().zip(&fresh.levels) {
                assert!(updated.operator.assembly() == fresh.operator.assembly());
                assert_eq!(updated.prolongation, fresh.prolongation);
                assert_eq!(updated.restriction, fresh.restriction);
                assert_eq!((&updated.place, &updated.children), (&fresh.place, &fresh.children));
            }
        }
        assert!(levels[0].elements.len() == grid.voxels().len() && levels[1].nodes.len() > 7 * 8 * 9);
    }
}
