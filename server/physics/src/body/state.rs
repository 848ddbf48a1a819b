//! What a step changes of a body.

use super::evaluation::ChunkSums;
use super::held::HeldElements;
use super::parts::RigidParts;
use super::rollback::SavedState;
use crate::Vec3;
use crate::boundary::Boundary;
use crate::fem::block::{ElementState, LANES};
use crate::grid::cell_sizes::CellSizes;
use crate::grid::levels::Level;
use crate::grid::units::VoxelUnits;
use crate::grid::{Grid, voxelize};
use crate::grow::grow;
use crate::math::Nodal;
use crate::scene::{Meshes, ObjectDesc, SceneError};
use crate::solve::assembly::CHUNK_ELEMENTS;
use crate::walk::{Kept, WalkError};
use serde::{Deserialize, Serialize};
use wide::f64x4;

/// Coarsening stops at this many nodes, those of 2x2x2 cells: a dense factor of that size costs less than another
/// level, and pieces of a body that was cut to shreds still have few enough to be factored as one.
const COARSEST_NODES: usize = 27;

/// Where a body is, how it moves and what of it is parted, with what the last step found at it. Two bodies of one
/// description and equal states differ only in what their solvers lag behind.
#[derive(Clone, Serialize, Deserialize)]
pub struct State {
    /// Voxels, and the links between them that are intact.
    pub(crate) grid: Grid,
    /// Composite elements: the level that is solved on, then the levels above it. Ids stay when links part.
    pub(crate) levels: Kept<Vec<Level>>,
    /// Position of each node, by node, m, scene frame.
    pub position_m: Nodal,
    /// Velocity of each node, by node, m/s, scene frame.
    pub velocity_m_per_s: Nodal,
    /// Rotation, strain memory, force and energy of each element as last evaluated, four elements to a block.
    pub(super) elements: Vec<ElementState>,
    /// What the elements add to the right side as last evaluated, xyz0 by slot of the chunks' buffers, N, scene frame.
    pub(super) balance_n: Vec<f64x4>,
    /// Energies and bounds as last evaluated, by chunk of the solver's assembly.
    pub(super) chunks: Vec<ChunkSums>,
    /// Elements of which something is held, and what.
    pub(super) held: Kept<HeldElements>,
    /// The separate pieces, and how those that nothing holds turn.
    pub(super) rigid: RigidParts,
    /// The surface and the walls of cuts, in the reference configuration.
    pub(super) boundary: Boundary,
    /// Where the last step led to, to go back to.
    pub(super) saved: SavedState,
}

impl State {
    /// At rest in the reference configuration; nothing is evaluated yet.
    pub(super) fn at_rest(grid: Grid, object: &ObjectDesc, meshes: &Meshes) -> Result<Self, SceneError> {
        let levels = build_levels(&grid, object, meshes)?;
        let mut state = Self {
            grid,
            position_m: Vec::new(),
            velocity_m_per_s: Vec::new(),
            levels: levels.into(),
            elements: Vec::new(),
            balance_n: Vec::new(),
            chunks: Vec::new(),
            held: Kept::default(),
            rigid: RigidParts::default(),
            boundary: Boundary::default(),
            saved: SavedState::default(),
        };
        let nodes = state.levels[0].nodes.len();
        grow(&mut state.position_m, nodes, [0.0; 3]);
        grow(&mut state.velocity_m_per_s, nodes, [0.0; 3]);
        (0..nodes).for_each(|node| state.position_m[node] = state.rest_position_m(node).into());
        Ok(state)
    }

    /// Whether what was read from a file fits together, and to a body of the same scene.
    ///
    /// # Errors
    /// It does not.
    pub(super) fn check(&self, like: &Self) -> Result<(), WalkError> {
        if self.levels.len() != like.levels.len() {
            return Err(WalkError::new(format!("{} levels, not {}", self.levels.len(), like.levels.len())));
        }
        let mut units = self.grid.voxels().len();
        for (index, (level, like)) in self.levels.iter().zip(like.levels.iter()).enumerate() {
            level.check(like, units).map_err(|what| WalkError::new(format!("level {index}: {what} do not fit")))?;
            units = level.elements.len();
        }
        let (nodes, elements) = (self.levels[0].nodes.len(), self.levels[0].elements.len());
        let fits = [self.position_m.len(), self.velocity_m_per_s.len()] == [nodes; 2]
            && self.elements.len() == elements.div_ceil(LANES)
            && self.chunks.len() == elements.div_ceil(CHUNK_ELEMENTS)
            && self.held.fits(&self.levels[0])
            && self.rigid.fits(elements, nodes);
        if fits { Ok(()) } else { Err(WalkError::new("a body's state is not of its elements".into())) }
    }

    /// Edge of the smallest composite elements, m.
    pub(super) fn lattice_edge_m(&self) -> f64 {
        self.grid.voxel_size_m() * f64::from(1u32 << self.levels[0].exponent)
    }

    /// Reference position of a node, m, scene frame.
    pub(super) fn rest_position_m(&self, node: usize) -> Vec3 {
        let edge_m = self.lattice_edge_m();
        self.grid.origin_m() + Vec3::from(self.levels[0].nodes[node].map(|c| f64::from(c) * edge_m))
    }
}

/// The level that is solved on, graded where the object states finer regions or is thin, and those above it.
fn build_levels(grid: &Grid, object: &ObjectDesc, meshes: &Meshes) -> Result<Vec<Level>, SceneError> {
    let wanted = voxelize::wanted_levels(grid, object, meshes, grid.voxel_size_m())?;
    let exponent = wanted.iter().copied().fold(object.level, u8::min);
    let dims = grid.dims().map(|d| (d + (1 << exponent) - 1) >> exponent);
    let mut finest = std::collections::BTreeMap::new();
    for (voxel, wanted) in grid.voxels().iter().zip(wanted).filter(|(_, wanted)| *wanted < object.level) {
        let level = finest.entry(voxel.ijk.map(|c| c >> exponent)).or_insert(wanted);
        *level = wanted.min(*level);
    }
    let log2 = |level: u8| level - exponent;
    let sizes = CellSizes::graded(dims, log2(object.level), |cell| log2(*finest.get(&cell).unwrap_or(&object.level)));
    let mut levels = vec![Level::base(&VoxelUnits { grid, exponent }, sizes)];
    loop {
        let last = &levels[levels.len() - 1];
        let small = last.nodes.len() <= COARSEST_NODES && !last.is_graded();
        if small || last.dims().iter().all(|d| *d <= 1) {
            return Ok(levels);
        }
        let above = last.above();
        levels.push(above);
    }
}
