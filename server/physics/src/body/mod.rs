//! One soft body: its voxels, its hierarchy of elements, their matrices and their state.

mod element;
mod eshelby;
mod forces;
mod geometric_stiffness;
mod interpolate;
mod memory;
mod relax;
mod rest;
mod rigid;
mod rollback;
mod solve;
mod topology;
mod toughness_rate;

pub use crate::grid::{LEAST_PIECE_VOXELS, MaterialPoint};
pub use forces::BodyEnergy;
pub(crate) use forces::StepEnergies;
pub use relax::Relaxation;
pub(crate) use rigid::Totals;
pub use topology::{PartedLinks, TopologyChange};
pub(crate) use toughness_rate::ToughnessRate;

use crate::Vec3;
use crate::boundary::{Boundary, Solid};
use crate::fem::composite::{CompositeTables, shape_functions};
use crate::fem::corotation::{ElementBlock, ElementLaw, ElementState, LANES, SharedByBlocks};
use crate::fem::lanes::diagonal_entry;
use crate::fem::material::Elastic;
use crate::fem::viscosity::Viscosity;
use crate::grid::cell_sizes::CellSizes;
use crate::grid::levels::{Level, LevelChange, Units, VoxelUnits};
use crate::grid::{Grid, VoxelId, voxelize};
use crate::params::StepParams;
use crate::scene::{ElementKind, Face, FractureRule, LoadDesc, MaterialDesc, Meshes, ObjectDesc, Scene, SceneError};
use crate::solve::assembly::CHUNK_ELEMENTS;
use crate::solve::multigrid::Multigrid;
use crate::solve::operator::NodeVector;
use crate::solve::pcg::PcgScratch;
use crate::workers::Workers;
use std::sync::Arc;
use wide::f64x4;

/// Coarsening stops at this many nodes, those of 2x2x2 cells: a dense factor of that size costs less than another
/// level, and pieces of a body that was cut to shreds still have few enough to be factored as one.
const COARSEST_NODES: usize = 27;
/// Stiffness of a held voxel over `E h`: its compliance adds less than a hundredth of a voxel of
/// tissue to what it holds.
const HOLD_STIFFNESS: f64 = 300.0;

/// A node is firmly held where the hold is this many times as stiff as the element.
const FIRM_HOLD: f64 = 10.0;

/// A node-wise vector in `f64`.
pub type Nodal = Vec<[f64; 3]>;

/// Material of a voxel as the step uses it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Young's modulus, Pa.
    pub young_modulus_pa: f64,
    /// Poisson's ratio.
    pub poisson_ratio: f64,
    /// Lame constants and density.
    pub elastic: Elastic,
    /// Damping, stiffening and relaxation.
    pub law: ElementLaw,
    /// Fracture energy, J/m^2; `None`: cannot be cut.
    pub fracture_energy_j_per_m2: Option<f64>,
    /// Energy release rate at which a front starts over the fracture energy.
    pub initiation_ratio: f64,
    /// How the fracture energy rises with the speed of the front.
    pub(crate) toughness_rate: Option<ToughnessRate>,
    /// Coefficient of friction of tissue on tissue.
    pub friction_coefficient: f64,
}

impl From<&MaterialDesc> for Material {
    fn from(desc: &MaterialDesc) -> Self {
        Self {
            young_modulus_pa: desc.young_modulus_pa,
            poisson_ratio: desc.poisson_ratio,
            elastic: Elastic::new(desc.young_modulus_pa, desc.poisson_ratio, desc.density_kg_per_m3),
            law: ElementLaw {
                alpha_per_s: desc.rayleigh_alpha_per_s,
                beta_s: desc.rayleigh_beta_s,
                stiffening_rate_per_pa: 2.0 * desc.strain_stiffening / desc.young_modulus_pa,
                viscosity: desc.viscosity.map(|v| Viscosity {
                    modulus_ratio: v.relaxing_modulus_ratio,
                    relaxation_time_s: v.relaxation_time_s,
                }),
            },
            fracture_energy_j_per_m2: desc.fracture_energy_j_per_m2,
            initiation_ratio: desc.initiation_ratio,
            toughness_rate: desc.rate.map(ToughnessRate::from),
            friction_coefficient: desc.friction_coefficient,
        }
    }
}

/// What acts on a voxel besides its elasticity.
#[derive(Clone, Copy, Debug, Default)]
struct VoxelLoad {
    held: bool,
    /// Force at the voxel's centre other than gravity, N.
    force_n: Vec3,
}

/// A traction's resultant on one face of a voxel. It acts at the face: half a voxel inside, a bar of
/// n voxels would stretch by (n - 1) / n of what it should.
#[derive(Clone, Copy, Debug)]
struct FaceLoad {
    voxel: VoxelId,
    face: Face,
    force_n: Vec3,
}

/// One soft body.
#[derive(Clone)]
pub struct Body {
    /// Name in the scene.
    pub name: String,
    /// Voxels and links.
    pub grid: Grid,
    /// Composite elements: the level that is solved on, then the levels above it.
    pub levels: Vec<Level>,
    /// Materials by voxel's material index.
    pub materials: Vec<Material>,
    /// Node positions, m, scene frame.
    pub position_m: Nodal,
    /// Node velocities, m/s, scene frame.
    pub velocity_m_per_s: Nodal,
    /// Loads of each node other than contact, N.
    external_n: Nodal,
    voxel_loads: Vec<VoxelLoad>,
    /// By voxel, ascending.
    face_loads: Vec<FaceLoad>,
    /// Each element's part of `external_n`, by corner.
    element_loads_n: Vec<[[f64; 3]; 8]>,
    gravity_m_per_s2: Vec3,
    /// By log2 of an element's size in lattice cells.
    tables: Arc<[CompositeTables]>,
    element_kind: ElementKind,
    /// What decides where a blade parts it.
    pub fracture_rule: FractureRule,
    homogenised: element::Homogenised,
    blocks: Vec<ElementBlock>,
    states: Vec<ElementState>,
    /// By chunk of the solver's assembly.
    chunks: Vec<forces::ElementChunk>,
    /// What the elements add to the right side, in the chunks' buffers, N.
    balance_n: Vec<f64x4>,
    /// Elements with held voxels and their 8x8 penalty, lower triangle by rows, N/m.
    holds: Vec<(u32, [f64; 36])>,
    /// By element.
    geometric: Vec<geometric_stiffness::GeometricStiffness>,
    /// Whose turn it is to follow the stress.
    geometric_turn: usize,
    multigrid: Multigrid,
    pcg: PcgScratch,
    /// `psi'` that the solver's matrix and the coarse matrices were last made with.
    applied_stiffening: Vec<f64>,
    coarse_stiffening: Vec<f64>,
    /// Bound on how far any element has turned since the smoothers' diagonals were made, rad.
    turned_rad: f64,
    /// Bound on how much any element's geometric stiffness has changed since then, over `V E`.
    unsmoothed: f64,
    rigid: rigid::RigidParts,
    boundary: Boundary,
    scratch: Scratch,
    saved: rollback::FiniteState,
    params: StepParams,
}

#[derive(Clone, Default)]
struct Scratch {
    right_side: Nodal,
    applied: Nodal,
    right_side_f32: NodeVector,
    solution: NodeVector,
    stale_parents: Vec<u32>,
}

impl Scratch {
    fn resize(&mut self, elements: usize, nodes: usize) {
        self.right_side.resize(nodes, [0.0; 3]);
        self.applied.resize(nodes, [0.0; 3]);
        self.right_side_f32.resize(nodes, Default::default());
        self.solution.resize(nodes, Default::default());
        self.stale_parents.clear();
        self.stale_parents.reserve(elements);
    }
}

impl Body {
    /// Voxelises an object of the scene and builds its elements at rest.
    ///
    /// # Errors
    /// What is wrong with the object's shape.
    pub fn new(scene: &Scene, index: usize, params: StepParams, workers: &Workers<'_>) -> Result<Self, SceneError> {
        let object = &scene.desc.objects[index];
        let grid = voxelize::voxelize(object, &scene.meshes)?;
        let loads = loads_of(&grid, object, &scene.meshes)?;
        let levels = build_levels(&grid, object, &scene.meshes)?;
        let gravity = scene.desc.gravity_m_per_s2.into();
        let mut body = Self::at_rest(object, grid, levels, loads, gravity, params);
        body.rebuild_all(workers);
        Ok(body)
    }

    fn at_rest(
        object: &ObjectDesc,
        grid: Grid,
        levels: Vec<Level>,
        (voxel_loads, face_loads): (Vec<VoxelLoad>, Vec<FaceLoad>),
        gravity_m_per_s2: Vec3,
        params: StepParams,
    ) -> Self {
        let exponents = levels[0].exponent..=object.level;
        let materials = object.materials().map(Material::from).collect();
        let mut body = Self {
            name: object.name.clone(),
            tables: exponents.map(|exponent| CompositeTables::new(exponent, grid.voxel_size_m())).collect(),
            element_kind: object.element,
            fracture_rule: object.fracture_rule,
            homogenised: element::Homogenised::default(),
            multigrid: Multigrid::new(&levels),
            grid,
            levels,
            materials,
            position_m: Vec::new(),
            velocity_m_per_s: Vec::new(),
            external_n: Vec::new(),
            voxel_loads,
            face_loads,
            element_loads_n: Vec::new(),
            gravity_m_per_s2,
            blocks: Vec::new(),
            states: Vec::new(),
            chunks: Vec::new(),
            balance_n: Vec::new(),
            holds: Vec::new(),
            geometric: Vec::new(),
            geometric_turn: 0,
            pcg: PcgScratch::default(),
            applied_stiffening: Vec::new(),
            coarse_stiffening: Vec::new(),
            turned_rad: 0.0,
            unsmoothed: 0.0,
            rigid: rigid::RigidParts::default(),
            boundary: Boundary::default(),
            scratch: Scratch::default(),
            saved: rollback::FiniteState::default(),
            params,
        };
        body.position_m = (0..body.node_count()).map(|n| body.rest_position_m(n).into()).collect();
        body.velocity_m_per_s = vec![[0.0; 3]; body.node_count()];
        body
    }

    /// The level that is solved on.
    #[must_use]
    pub fn base(&self) -> &Level {
        &self.levels[0]
    }

    pub(crate) fn solid(&self) -> Solid<'_> {
        Solid { grid: &self.grid, level: &self.levels[0] }
    }

    /// Its surface and the walls of its cuts.
    #[must_use]
    pub fn boundary(&self) -> &Boundary {
        &self.boundary
    }

    /// Keeps the surface in patches as fine as a smooth tool of this radius asks for, too.
    pub(crate) fn resolve_boundary(&mut self, radius_m: f64) {
        let solid = Solid { grid: &self.grid, level: &self.levels[0] };
        self.boundary.resolve(solid, radius_m);
    }

    /// `int phi n dA` over the surface of an element, n out of it, m^2; phi by its corners, trilinear between.
    pub(crate) fn surface_integral_m2(&self, element: usize, phi: &[f64; 8]) -> Vec3 {
        let moments_m2 = self.boundary.moments_m2(self.solid(), element);
        moments_m2.iter().zip(phi).map(|(moment, phi)| moment * *phi).sum()
    }

    /// Relative tolerance of the solves.
    #[must_use]
    pub fn relative_tolerance(&self) -> f64 {
        self.params.relative_tolerance
    }

    /// Sets the relative tolerance of the solves to come.
    pub(crate) fn set_relative_tolerance(&mut self, relative_tolerance: f64) {
        self.params.relative_tolerance = relative_tolerance;
    }

    /// Time step, s.
    #[must_use]
    pub fn dt_s(&self) -> f64 {
        self.params.dt_s
    }

    /// Factor by which strain has stiffened an element.
    #[must_use]
    pub fn stiffening(&self, element: usize) -> f64 {
        self.states[element / LANES].stiffening.as_array()[element % LANES]
    }

    /// Edge of a composite element, m.
    #[must_use]
    pub(crate) fn element_edge_m(&self, element: usize) -> f64 {
        f64::from(self.base().elements[element].size) * self.lattice_edge_m()
    }

    /// Edge of the largest composite elements, m.
    #[must_use]
    pub(crate) fn largest_edge_m(&self) -> f64 {
        self.lattice_edge_m() * f64::from(1u32 << (self.tables.len() - 1))
    }

    /// Rotation of an element.
    #[must_use]
    pub fn rotation(&self, element: usize) -> crate::Mat3 {
        let r = &self.states[element / LANES].rotation_matrix;
        crate::Mat3::from_row_iterator(r.iter().map(|entry| f64::from(entry.as_array()[element % LANES])))
    }

    /// Level of a composite element: log2 of its edge in voxels.
    #[must_use]
    pub fn element_level(&self, element: usize) -> u8 {
        self.base().exponent + self.base().elements[element].size.ilog2() as u8
    }

    /// Edge of the smallest composite elements, m.
    #[must_use]
    pub fn lattice_edge_m(&self) -> f64 {
        self.grid.voxel_size_m() * f64::from(1u32 << self.base().exponent)
    }

    /// Centre of an element's cell at rest, m.
    #[must_use]
    pub fn rest_centre_m(&self, element: usize) -> Vec3 {
        let data = &self.base().elements[element];
        let half = 0.5 * f64::from(data.size);
        self.grid.origin_m() + Vec3::from(data.cell.map(|c| f64::from(c) + half)) * self.lattice_edge_m()
    }

    /// Number of nodes.
    #[must_use]
    pub fn node_count(&self) -> usize {
        self.base().nodes.len()
    }

    /// Reference position of a node, m.
    #[must_use]
    pub fn rest_position_m(&self, node: usize) -> Vec3 {
        let edge = self.lattice_edge_m();
        self.grid.origin_m() + Vec3::from(self.base().nodes[node].map(|c| f64::from(c) * edge))
    }

    /// Material of a voxel.
    #[must_use]
    pub(crate) fn material_of(&self, voxel: VoxelId) -> &Material {
        &self.materials[self.grid.voxels()[voxel.index()].material as usize]
    }

    /// Number of separate pieces.
    #[must_use]
    pub fn part_count(&self) -> u32 {
        self.rigid.part_count()
    }

    /// Total mass, kg.
    #[must_use]
    pub fn mass_kg(&self) -> f64 {
        let volume = self.grid.voxel_size_m().powi(3);
        (0..self.grid.voxels().len())
            .map(|v| self.material_of(VoxelId(v as u32)).elastic.density_kg_per_m3 * volume)
            .sum()
    }

    /// Voxels of an element, in the order of its cell.
    pub(crate) fn voxels_of(&self, element: usize) -> Vec<VoxelId> {
        let base = self.base();
        let units = VoxelUnits { grid: &self.grid, exponent: base.exponent };
        let mut voxels = Vec::new();
        units.in_cell(base.elements[element].cell, base.elements[element].size, &mut |v| {
            if base.owner[v as usize] as usize == element {
                voxels.push(VoxelId(v));
            }
        });
        voxels
    }

    /// Recomputes the matrices, the hold and the loads of an element from its voxels.
    fn rebuild_element(&mut self, element: usize) {
        let voxels = self.voxels_of(element);
        self.element_loads_n[element] = self.element_loads(element, &voxels);
        let matrices = self.element_matrices(element, &voxels);
        let law = self.mean_law(&voxels);
        let edge = self.element_edge_m(element);
        let (block, state) = (&mut self.blocks[element / LANES], &mut self.states[element / LANES]);
        block.set_matrices(element % LANES, edge, &matrices, law, self.params.dt_s);
        if block.viscosity.is_some() {
            state.branch.get_or_insert_default();
        }
        self.holds.retain(|(e, _)| *e as usize != element);
        if voxels.iter().any(|v| self.voxel_loads[v.index()].held) {
            let hold = self.hold_matrix(&voxels);
            self.holds.push((element as u32, hold));
            self.holds.sort_unstable_by_key(|h| h.0);
        }
        self.begin_geometric_stiffness(element, &voxels);
    }

    /// Damping and stiffening of an element: means over its voxels; and what relaxes of it.
    fn mean_law(&self, voxels: &[VoxelId]) -> ElementLaw {
        let viscosity = self.mean_viscosity(voxels);
        let mut mean = ElementLaw { alpha_per_s: 0.0, beta_s: 0.0, stiffening_rate_per_pa: 0.0, viscosity };
        let weight = 1.0 / voxels.len() as f64;
        for &voxel in voxels {
            let law = self.material_of(voxel).law;
            mean.alpha_per_s += weight * law.alpha_per_s;
            mean.beta_s += weight * law.beta_s;
            mean.stiffening_rate_per_pa += weight * law.stiffening_rate_per_pa;
        }
        mean
    }

    /// Coordinates of a reference position in the cell of an element; 0..=1 inside it.
    #[must_use]
    pub(crate) fn local_coordinates(&self, element: usize, position_m: &Vec3) -> [f64; 3] {
        self.solid().local_coordinates(element, position_m)
    }

    /// A held voxel is held at its eight corners, through the interpolation of its element.
    fn hold_matrix(&self, voxels: &[VoxelId]) -> [f64; 36] {
        let mut hold = [0.0; 36];
        let h = self.grid.voxel_size_m();
        for &voxel in voxels.iter().filter(|v| self.voxel_loads[v.index()].held) {
            let stiffness = HOLD_STIFFNESS * self.material_of(voxel).young_modulus_pa * h / 8.0;
            let element = self.base().owner[voxel.index()] as usize;
            let centre = self.grid.centre_m(self.grid.voxels()[voxel.index()].ijk);
            for corner in 0..8 {
                let offset = Vec3::from([0, 1, 2].map(|a| ((corner >> a & 1) as f64 - 0.5) * h));
                let n = shape_functions(self.local_coordinates(element, &(centre + offset)));
                for a in 0..8 {
                    for b in 0..=a {
                        hold[a * (a + 1) / 2 + b] += stiffness * n[a] * n[b];
                    }
                }
            }
        }
        hold
    }

    /// Whether a node is held so firmly that it hardly moves.
    fn held_nodes(&self) -> Vec<bool> {
        let mut held = vec![false; self.node_count()];
        for (element, hold) in &self.holds {
            let (block, lane) = (&self.blocks[*element as usize / LANES], *element as usize % LANES);
            for (corner, &node) in self.base().elements[*element as usize].nodes.iter().enumerate() {
                let stiffness = block.stiffness.at(diagonal_entry(corner), lane);
                held[node as usize] |= hold[corner * (corner + 3) / 2] > FIRM_HOLD * stiffness;
            }
        }
        held
    }

    /// Loads at the corners of an element, from gravity and its voxels' own forces.
    fn element_loads(&self, element: usize, voxels: &[VoxelId]) -> [[f64; 3]; 8] {
        let volume = self.grid.voxel_size_m().powi(3);
        let mut loads = [[0.0; 3]; 8];
        for &voxel in voxels {
            let weight = self.gravity_m_per_s2 * (self.material_of(voxel).elastic.density_kg_per_m3 * volume);
            let force = weight + self.voxel_loads[voxel.index()].force_n;
            if force == Vec3::zeros() {
                continue;
            }
            // N at the centre is the mean of N over the voxel: trilinear along each axis.
            self.distribute(&mut loads, element, &self.grid.centre_m(self.grid.voxels()[voxel.index()].ijk), &force);
        }
        for &voxel in voxels {
            let first = self.face_loads.partition_point(|l| l.voxel < voxel);
            for load in self.face_loads[first..].iter().take_while(|l| l.voxel == voxel) {
                let (axis, step) = load.face.axis_and_step();
                let mut at = self.grid.centre_m(self.grid.voxels()[voxel.index()].ijk);
                at[axis] += 0.5 * f64::from(step) * self.grid.voxel_size_m();
                self.distribute(&mut loads, element, &at, &load.force_n);
            }
        }
        loads
    }

    /// Sums the elements' loads at the nodes.
    fn rebuild_external_forces(&mut self) {
        self.external_n.clear();
        self.external_n.resize(self.levels[0].nodes.len(), [0.0; 3]);
        for (element, loads) in self.levels[0].elements.iter().zip(&self.element_loads_n) {
            for (&node, load) in element.nodes.iter().zip(loads) {
                (0..3).for_each(|i| self.external_n[node as usize][i] += load[i]);
            }
        }
    }

    /// Distributes a force at a reference position over the corners of an element.
    fn distribute(&self, loads: &mut [[f64; 3]; 8], element: usize, at_m: &Vec3, force_n: &Vec3) {
        let n = shape_functions(self.local_coordinates(element, at_m));
        for (load, n) in loads.iter_mut().zip(n) {
            (0..3).for_each(|i| load[i] += n * force_n[i]);
        }
    }

    /// Builds every matrix from scratch and evaluates forces at the current state.
    fn rebuild_all(&mut self, workers: &Workers<'_>) {
        self.resize_blocks();
        for element in 0..self.base().elements.len() {
            self.rebuild_element(element);
        }
        self.number_nodes(None);
        self.boundary = Boundary::of(self.solid());
        self.rebuild_external_forces();
        self.rigid = rigid::RigidParts::new(self);
        self.evaluate(workers, 20);
        for element in 0..self.base().elements.len() {
            self.write_matrix(element);
        }
        self.write_rotations(workers);
        self.multigrid.rebuild(workers, &self.levels);
        let mut shared = SharedByBlocks::default();
        self.blocks.iter_mut().for_each(|b| b.share_matrices(&mut shared));
        self.share_system_matrices();
        self.save_finite_state(workers);
    }

    /// The system's matrices of elements that stiffen come and go with their strain.
    fn share_system_matrices(&mut self) {
        if self.blocks.iter().all(|b| b.stiffening.is_none()) {
            self.multigrid.share_matrices();
        }
    }

    /// Takes the levels' nodes into the solver and into the blocks, changed as `changes` of each level say;
    /// `None`: all of them. Returns the chunks of elements whose numbering changed.
    fn number_nodes(&mut self, changes: Option<&[LevelChange]>) -> Vec<usize> {
        let places = |multigrid: &Multigrid| -> Vec<std::ops::Range<usize>> {
            let assembly = multigrid.operator().assembly();
            (0..assembly.chunks().len()).map(|chunk| assembly.buffer_of(chunk)).collect()
        };
        let before = places(&self.multigrid);
        let renumbered = self.multigrid.set_topology(&self.levels, &self.held_nodes(), changes);
        let assembly = self.multigrid.operator().assembly();
        let mut balance_n = vec![f64x4::ZERO; assembly.buffer_len()];
        for (chunk, (from, to)) in before.into_iter().zip(places(&self.multigrid)).enumerate() {
            if renumbered.binary_search(&chunk).is_err() {
                balance_n[to].copy_from_slice(&self.balance_n[from]);
            }
        }
        self.balance_n = balance_n;
        self.chunks.resize_with(assembly.chunks().len(), Default::default);
        let elements = self.levels[0].elements.len();
        for &index in &renumbered {
            let (chunk, first) = (&assembly.chunks()[index], index * CHUNK_ELEMENTS);
            self.chunks[index].resize(chunk);
            for element in first..elements.min(first + CHUNK_ELEMENTS) {
                self.blocks[element / LANES].set_slots(element % LANES, chunk.corners(element - first));
            }
        }
        renumbered
    }

    fn resize_blocks(&mut self) {
        let elements = self.base().elements.len();
        let blocks = elements.div_ceil(LANES);
        self.blocks.resize_with(blocks, ElementBlock::default);
        self.states.resize_with(blocks, ElementState::default);
        self.scratch.resize(elements, self.levels[0].nodes.len());
        self.pcg.resize(self.levels[0].nodes.len());
        self.element_loads_n.resize(elements, [[0.0; 3]; 8]);
        self.applied_stiffening.resize(elements, 1.0);
        self.coarse_stiffening.resize(elements, 1.0);
    }
}

/// The level that is solved on, graded where the object states finer regions, and those above it.
fn build_levels(grid: &Grid, object: &ObjectDesc, meshes: &Meshes) -> Result<Vec<Level>, SceneError> {
    let exponent = object.finer.iter().map(|finer| finer.level).fold(object.level, u8::min);
    let dims = grid.dims().map(|d| (d + (1 << exponent) - 1) >> exponent);
    let mut finest = std::collections::BTreeMap::new();
    for finer in &object.finer {
        for voxel in voxelize::region_voxels(grid, &finer.shape, meshes)? {
            let cell = grid.voxels()[voxel.index()].ijk.map(|c| c >> exponent);
            let level = finest.entry(cell).or_insert(object.level);
            *level = finer.level.min(*level);
        }
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

fn loads_of(grid: &Grid, object: &ObjectDesc, meshes: &Meshes) -> Result<(Vec<VoxelLoad>, Vec<FaceLoad>), SceneError> {
    let mut loads = vec![VoxelLoad::default(); grid.voxels().len()];
    let mut face_loads = Vec::new();
    for shape in &object.fixed {
        for voxel in voxelize::region_voxels(grid, shape, meshes)? {
            loads[voxel.index()].held = true;
        }
    }
    let h = grid.voxel_size_m();
    for load in &object.loads {
        match load {
            LoadDesc::BodyForce { region, force_n_per_m3 } => {
                for voxel in voxelize::region_voxels(grid, region, meshes)? {
                    loads[voxel.index()].force_n += Vec3::from(*force_n_per_m3) * h.powi(3);
                }
            }
            LoadDesc::Traction { region, face, traction_pa } => {
                let (axis, step) = face.axis_and_step();
                for voxel in voxelize::region_voxels(grid, region, meshes)? {
                    let mut beyond = grid.voxels()[voxel.index()].ijk;
                    beyond[axis] += step;
                    if grid.voxel_at(beyond).is_none() {
                        face_loads.push(FaceLoad { voxel, face: *face, force_n: Vec3::from(*traction_pa) * h * h });
                    }
                }
            }
        }
    }
    face_loads.sort_by_key(|load: &FaceLoad| load.voxel);
    Ok((loads, face_loads))
}

impl Face {
    /// The axis of the face's normal and which way it points.
    fn axis_and_step(self) -> (usize, i32) {
        match self {
            Face::MinX => (0, -1),
            Face::MaxX => (0, 1),
            Face::MinY => (1, -1),
            Face::MaxY => (1, 1),
            Face::MinZ => (2, -1),
            Face::MaxZ => (2, 1),
        }
    }
}
