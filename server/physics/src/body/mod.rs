//! One soft body: what it is made of, its state, what solves for its motion, and room to work in.

mod build;
mod description;
mod element;
mod eshelby;
mod evaluation;
mod flap;
mod forces;
mod geometric_stiffness;
mod held;
mod interpolate;
mod loads;
mod material;
mod memory;
mod overshoot;
mod parts;
mod put_away;
mod quasi_static;
mod relax;
mod rest;
mod rigid;
mod rigid_motion;
mod rollback;
mod scratch;
mod solve;
mod solver;
mod state;
mod topology;
mod toughness_rate;
mod turn;

pub use crate::math::Nodal;
pub use description::Description;
pub use element::MOST_CONTRAST;
pub use evaluation::BodyEnergy;
pub(crate) use evaluation::StepEnergies;
pub use interpolate::PointWeights;
pub use material::Material;
pub(crate) use quasi_static::Response;
pub use relax::Relaxation;
pub(crate) use relax::share_of_rest;
pub(crate) use rigid_motion::Totals;
pub(crate) use rollback::Lost;
pub use state::State;
pub use topology::{PartedLinks, TopologyChange};
pub(crate) use toughness_rate::ToughnessRate;

use crate::Vec3;
use crate::boundary::{Boundary, Solid};
use crate::fem::block::LANES;
use crate::fem::composite::CompositeTables;
use crate::grid::levels::Level;
use crate::grid::units::{Units, VoxelUnits};
use crate::grid::{Grid, VoxelId, voxelize};
use crate::making::{MakingStage, Teller};
use crate::params::StepParams;
use crate::scene::{Scene, SceneError};
use crate::workers::Workers;
use scratch::Scratch;
use serde::{Deserialize, Serialize};
use solver::Solver;
use std::sync::Arc;

/// One soft body. A copy shares the description and leaves the scratch out; before steps are taken of it,
/// `Body::reserve` makes room for them.
#[derive(Clone, Serialize, Deserialize)]
pub struct Body {
    /// What it is made of and what acts on it: constant.
    #[serde(skip, default = "Description::absent")]
    pub(crate) description: Arc<Description>,
    /// What a step changes.
    pub(crate) state: State,
    /// What the velocity solve works with.
    solver: Solver,
    /// Room to work in.
    #[serde(skip)]
    scratch: Scratch,
}

impl Body {
    /// Voxelises an object of the scene and builds its elements at rest.
    ///
    /// # Errors
    /// What is wrong with the object's shape.
    pub(crate) fn new(
        scene: &Scene,
        index: usize,
        params: StepParams,
        workers: &Workers<'_>,
    ) -> Result<Self, SceneError> {
        Self::made(scene, index, params, workers, &mut Teller::new(scene.desc.objects.len(), &mut |_| ()))
    }

    /// The same, and tells how far it is.
    pub(crate) fn made(
        scene: &Scene,
        index: usize,
        params: StepParams,
        workers: &Workers<'_>,
        teller: &mut Teller<'_>,
    ) -> Result<Self, SceneError> {
        teller.object(index);
        let object = &scene.desc.objects[index];
        let here = |error: SceneError| error.within(&format!("objects[{index}]"));
        let grid = voxelize::voxelize(object, &scene.meshes).map_err(here)?;
        let loads = loads::loads_of(&grid, object, &scene.meshes).map_err(here)?;
        teller.counted(grid.voxels().len(), 0);
        teller.stage(MakingStage::Elements);
        let state = State::at_rest(grid, object, &scene.meshes).map_err(here)?;
        let exponents = state.levels[0].exponent..=object.level;
        let description = Description {
            name: object.name.clone(),
            materials: object.materials().map(Material::from).collect(),
            fracture_rule: object.fracture_rule,
            element_kind: object.element,
            gravity_m_per_s2: scene.desc.gravity_m_per_s2.into(),
            holds: loads.holds,
            voxel_loads: loads.of_voxels,
            face_loads: loads.of_faces,
            single_voxel: CompositeTables::new(0, state.grid.voxel_size_m()),
            tables: exponents.map(|exponent| CompositeTables::new(exponent, state.grid.voxel_size_m())).collect(),
        };
        teller.counted(state.grid.voxels().len(), state.levels[0].elements.len());
        teller.stage(MakingStage::Solver);
        let solver = Solver::new(&state.levels, params);
        let mut body = Self { description: Arc::new(description), state, solver, scratch: Scratch::default() };
        body.rebuild_all(workers);
        Ok(body)
    }

    /// Room for steps with up to `springs` springs: they allocate nothing.
    pub(crate) fn reserve(&mut self, springs: usize) {
        self.solver.multigrid.reserve_springs(springs);
        self.scratch.fit(&self.state.levels[0], self.solver.multigrid.operator().assembly());
    }

    /// Voxels, and the links between them that are intact.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.state.grid
    }

    /// Number of composite elements.
    #[must_use]
    pub fn element_count(&self) -> usize {
        self.base().elements.len()
    }

    /// The level that is solved on.
    #[must_use]
    pub(crate) fn base(&self) -> &Level {
        &self.state.levels[0]
    }

    pub(crate) fn solid(&self) -> Solid<'_> {
        Solid { grid: &self.state.grid, level: &self.state.levels[0] }
    }

    /// Its surface and the walls of its cuts.
    #[must_use]
    pub(crate) fn boundary(&self) -> &Boundary {
        &self.state.boundary
    }

    /// Keeps the surface in patches as fine as a smooth tool of this radius asks for, too.
    pub(crate) fn resolve_boundary(&mut self, radius_m: f64) {
        let solid = Solid { grid: &self.state.grid, level: &self.state.levels[0] };
        self.state.boundary.resolve(solid, radius_m);
    }

    /// `int phi n dA` over the surface of an element, n out of it, m^2; phi by its corners, trilinear between.
    pub(crate) fn surface_integral_m2(&self, element: usize, phi: &[f64; 8]) -> Vec3 {
        let moments_m2 = self.state.boundary.moments_m2(self.solid(), element);
        moments_m2.iter().zip(phi).map(|(moment, phi)| moment * *phi).sum()
    }

    /// Relative tolerance of the solves.
    #[must_use]
    pub(crate) fn relative_tolerance(&self) -> f64 {
        self.solver.params.relative_tolerance
    }

    /// Time step, s.
    #[must_use]
    pub(crate) fn dt_s(&self) -> f64 {
        self.solver.params.dt_s
    }

    /// Factor by which strain has stiffened an element.
    #[must_use]
    pub(crate) fn stiffening(&self, element: usize) -> f64 {
        self.state.elements[element / LANES].stiffening.as_array()[element % LANES]
    }

    /// Edge of a composite element, m.
    #[must_use]
    pub(crate) fn element_edge_m(&self, element: usize) -> f64 {
        f64::from(self.base().elements[element].size) * self.lattice_edge_m()
    }

    /// Edge of the largest composite elements, m.
    #[must_use]
    pub(crate) fn largest_edge_m(&self) -> f64 {
        self.lattice_edge_m() * f64::from(1u32 << (self.description.tables.len() - 1))
    }

    /// Rotation of an element.
    #[must_use]
    pub(crate) fn rotation(&self, element: usize) -> crate::Mat3 {
        let r = &self.state.elements[element / LANES].rotation_matrix;
        crate::Mat3::from_row_iterator(r.iter().map(|entry| f64::from(entry.as_array()[element % LANES])))
    }

    /// Level of a composite element: log2 of its edge in voxels.
    #[must_use]
    pub fn element_level(&self, element: usize) -> u8 {
        self.base().exponent_of(element)
    }

    /// Edge of the smallest composite elements, m.
    #[must_use]
    pub fn lattice_edge_m(&self) -> f64 {
        self.state.lattice_edge_m()
    }

    /// Centre of an element's cell at rest, m.
    #[must_use]
    pub fn rest_centre_m(&self, element: usize) -> Vec3 {
        let data = &self.base().elements[element];
        let half = 0.5 * f64::from(data.size);
        self.state.grid.origin_m() + Vec3::from(data.cell.map(|c| f64::from(c) + half)) * self.lattice_edge_m()
    }

    /// Number of nodes.
    #[must_use]
    pub fn node_count(&self) -> usize {
        self.base().nodes.len()
    }

    /// Reference position of a node, m.
    #[must_use]
    pub fn rest_position_m(&self, node: usize) -> Vec3 {
        self.state.rest_position_m(node)
    }

    /// Material of a voxel.
    #[must_use]
    pub(crate) fn material_of(&self, voxel: VoxelId) -> &Material {
        &self.description.materials[self.state.grid.voxels()[voxel.index()].material as usize]
    }

    /// Number of separate pieces.
    #[must_use]
    pub fn part_count(&self) -> u32 {
        self.state.rigid.part_count()
    }

    /// Total mass, kg.
    #[must_use]
    pub fn mass_kg(&self) -> f64 {
        (0..self.state.grid.voxels().len()).map(|v| self.voxel_mass_kg(VoxelId(v as u32))).sum()
    }

    /// Mass of what fills a voxel, kg.
    pub(crate) fn voxel_mass_kg(&self, voxel: VoxelId) -> f64 {
        let filled_m3 = self.state.grid.filled_share(voxel) * self.state.grid.voxel_size_m().powi(3);
        self.material_of(voxel).elastic.density_kg_per_m3 * filled_m3
    }

    /// Voxels of an element, in the order of its cell.
    pub(crate) fn voxels_of(&self, element: usize) -> Vec<VoxelId> {
        let mut voxels = Vec::new();
        self.for_each_voxel_of(element, |voxel| voxels.push(voxel));
        voxels
    }

    /// Visits the voxels of an element, in the order of its cell.
    pub(crate) fn for_each_voxel_of(&self, element: usize, mut visit: impl FnMut(VoxelId)) {
        let base = self.base();
        let units = VoxelUnits { grid: &self.state.grid, exponent: base.exponent };
        units.in_cell(base.elements[element].cell, base.elements[element].size, &mut |v| {
            if base.owner[v as usize] as usize == element {
                visit(VoxelId(v));
            }
        });
    }

    /// Coordinates of a reference position in the cell of an element; 0..=1 inside it.
    #[must_use]
    pub(crate) fn local_coordinates(&self, element: usize, position_m: &Vec3) -> [f64; 3] {
        self.solid().local_coordinates(element, position_m)
    }
}

#[cfg(test)]
impl Body {
    /// The first object of a scene, at rest, in steps of a millisecond.
    pub(crate) fn of_text(scene_toml: &str) -> Self {
        let desc = crate::scene::SceneDesc::from_toml("scene.toml", scene_toml).expect("a scene");
        let params = StepParams { dt_s: 1e-3, relative_tolerance: 1e-3, max_iterations: 200 };
        Self::new(&Scene { desc, meshes: Default::default() }, 0, params, &Workers::serial()).expect("a body")
    }
}
