//! Four elements side by side: their data, their state, and what an evaluation finds of them.

use super::ground::{GroundBlock, GroundLanes};
use super::lanes::{PACKED, pack, set_lane};
use super::matrices::{ElementMatrices, GROUND};
use super::packed::{MOST_SHARED, PackedMatrix, Shared};
use super::viscosity::{BranchState, Viscosity, ViscosityBlock};
use crate::Mat3;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use wide::{f32x4, f64x4};

/// Lanes per block.
pub const LANES: usize = 4;

/// What four elements have in their rest frames besides their stiffness.
#[derive(Clone, PartialEq)]
pub struct ElementShapes {
    /// Packed mass between corners, kg, lower triangle by rows.
    pub mass_kg: [f64x4; 36],
    /// Shape gradients averaged over the filled volume, 1/m.
    pub mean_gradient: [[f64x4; 3]; 8],
    /// Edge of the element's cell, m.
    pub edge_m: f64x4,
    /// Filled volume, m^3.
    pub volume_m3: f64x4,
}

/// Constant data of four elements.
#[derive(Clone)]
pub struct ElementBlock {
    /// Slots of each corner and lane in the buffers of the chunk; unused lanes have slot 0 and zero
    /// matrices.
    pub slots: [[u16; LANES]; 8],
    /// Stiffness, N/m.
    pub stiffness: PackedMatrix<f64x4>,
    /// The rest, stored once for blocks that have it in common.
    pub shapes: Arc<ElementShapes>,
    /// Rayleigh damping in proportion to mass, 1/s.
    pub alpha_per_s: f64x4,
    /// Rayleigh damping in proportion to stiffness, s.
    pub beta_s: f64x4,
    /// Present where any of the four stiffens with strain.
    pub stiffening: Option<StiffeningBlock>,
    /// Present where any of the four relaxes.
    pub viscosity: Option<Box<ViscosityBlock>>,
    /// Present where any of the four is held.
    pub ground: Option<Box<GroundBlock>>,
    /// Edges of the cells if they were free, m, `3 * axis + edge`; present where any of the four is strained in life.
    pub free_edges_m: Option<Box<[f64x4; 9]>>,
}

/// Nodal values of a chunk of elements, xyz0, by slot: what blocks read.
#[derive(Clone, Debug, Default)]
pub struct NodalBuffers {
    /// Positions, m.
    pub position_m: Vec<f64x4>,
    /// Velocities, m/s.
    pub velocity_m_per_s: Vec<f64x4>,
    /// How the step changed the velocities, m/s; empty where there was no step.
    pub velocity_change: Vec<f64x4>,
}

/// What an evaluation of four elements found.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Evaluation {
    /// Elastic energy, J.
    pub elastic_j: f64x4,
    /// Kinetic energy, J.
    pub kinetic_j: f64x4,
    /// What the step did to the energies.
    pub step: StepTerms<f64x4>,
    /// Square of the largest angle that an element has turned by, rad^2.
    pub turned_rad2: f64x4,
}

/// How well the step's quadratic model of its potential held for four elements, J; see
/// [`crate::body::Body::find_overshot`].
#[derive(Clone, Copy, Default)]
pub struct ModelFit {
    /// How far the potential is above the model.
    pub above_j: f64x4,
    /// `1/2 dx^T H dx`, H the model's second derivative: by how much the model falls if the step goes to its bottom.
    pub descent_j: f64x4,
}

impl Evaluation {
    /// Of the step that was evaluated, `before_j` the elastic energy where it began.
    pub fn model_fit(&self, before_j: f64x4) -> ModelFit {
        let step = &self.step;
        ModelFit {
            above_j: self.elastic_j - before_j + step.viscous_j + step.force_work_j - step.elastic_j,
            descent_j: step.elastic_j + self.kinetic_j + f64x4::splat(0.5) * step.damping_j,
        }
    }
}

/// Data of the strain-stiffening law of four elements.
#[derive(Clone)]
pub struct StiffeningBlock {
    /// Galerkin stiffness, N/m.
    pub galerkin: PackedMatrix<f64x4>,
    /// `2 c / E`, 1/Pa; 0 where the element is linear.
    pub rate_per_pa: f64x4,
    /// What goes with the Galerkin stiffness at the ground points; present where any of the four is held.
    pub(super) ground: Option<GroundLanes>,
}

/// State and results of four elements.
#[derive(Clone, Serialize, Deserialize)]
pub struct ElementState {
    /// Rotation as a quaternion, xyzw.
    pub rotation: [f64x4; 4],
    /// The same as a row-major matrix, for the solver.
    pub rotation_matrix: [f32x4; 9],
    /// `psi'`: factor on the Galerkin stiffness' part; 1 where linear.
    pub stiffening: f64x4,
    /// `psi'' / V`, and the local Galerkin force it goes with.
    pub curvature: f64x4,
    /// Local Galerkin force, N; zero where linear.
    pub galerkin_force_n: [f64x4; 24],
    /// Elastic force, N, scene frame.
    pub force_n: [f64x4; 24],
    /// Elastic energy but for what relaxes, J.
    pub elastic_j: f64x4,
    /// Present where any of the four relaxes.
    pub branch: Option<Box<BranchState>>,
    /// Force on the ground points, N, rest frame; present where any of the four is held.
    pub ground_force_n: Option<Box<[f64x4; GROUND]>>,
}

impl Default for ElementState {
    fn default() -> Self {
        let zero = f64x4::ZERO;
        Self {
            rotation: [zero, zero, zero, f64x4::ONE],
            rotation_matrix: [0, 1, 2, 3, 4, 5, 6, 7, 8].map(|i| f32x4::splat(if i % 4 == 0 { 1.0 } else { 0.0 })),
            stiffening: f64x4::ONE,
            curvature: zero,
            galerkin_force_n: [zero; 24],
            force_n: [zero; 24],
            elastic_j: zero,
            branch: None,
            ground_force_n: None,
        }
    }
}

/// Energies of a step of four elements or, in [`crate::body::StepEnergies`], of a body, J. Rotations and forces are
/// those of the step's beginning, `v` is the velocity at its end, `dx = dt v`.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct StepTerms<E> {
    /// Work against inertia, `dv^T M v`: kinetic energy grows by this less `1/2 dv^T M dv`.
    pub inertial_work_j: E,
    /// `1/2 dx^T K dx`.
    pub elastic_j: E,
    /// Work of the elastic forces, `f . dx`.
    pub force_work_j: E,
    /// Rayleigh damping, `dt v^T (alpha M + beta K) v`.
    pub damping_j: E,
    /// What the dashpots of relaxing materials dissipated.
    pub viscous_j: E,
}

/// What blocks have in common.
#[derive(Default)]
pub struct SharedByBlocks {
    matrices: Shared<f64x4>,
    shapes: Vec<Arc<ElementShapes>>,
}

/// Properties of one element that are not in its matrices.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ElementLaw {
    /// Rayleigh damping in proportion to mass, 1/s.
    pub alpha_per_s: f64,
    /// Rayleigh damping in proportion to stiffness, s.
    pub beta_s: f64,
    /// `2 c / E` of the strain-stiffening law, 1/Pa; 0: linear.
    pub stiffening_rate_per_pa: f64,
    /// What relaxes in time, if anything does.
    pub viscosity: Option<Viscosity>,
    /// Stretch to the shape that it would take if it were free, if that is not the one in life.
    pub free_stretch: Option<Mat3>,
}

impl Default for ElementBlock {
    fn default() -> Self {
        let shapes = ElementShapes {
            mass_kg: [f64x4::ZERO; 36],
            mean_gradient: [[f64x4::ZERO; 3]; 8],
            edge_m: f64x4::ONE,
            volume_m3: f64x4::ONE,
        };
        Self {
            slots: [[0; LANES]; 8],
            stiffness: PackedMatrix::default(),
            shapes: Arc::new(shapes),
            alpha_per_s: f64x4::ZERO,
            beta_s: f64x4::ZERO,
            stiffening: None,
            viscosity: None,
            ground: None,
            free_edges_m: None,
        }
    }
}

impl Evaluation {
    /// Takes in what was found for other elements.
    pub fn join(&mut self, other: &Self) {
        self.elastic_j += other.elastic_j;
        self.kinetic_j += other.kinetic_j;
        self.step.inertial_work_j += other.step.inertial_work_j;
        self.step.elastic_j += other.step.elastic_j;
        self.step.force_work_j += other.step.force_work_j;
        self.step.damping_j += other.step.damping_j;
        self.step.viscous_j += other.step.viscous_j;
        self.turned_rad2 = self.turned_rad2.fast_max(other.turned_rad2);
    }
}

impl ElementBlock {
    /// Sets the slots of a lane's corners.
    pub fn set_slots(&mut self, lane: usize, slots: &[u16; 8]) {
        (0..8).for_each(|corner| self.slots[corner][lane] = slots[corner]);
    }

    /// Sets the matrices of a lane, of a cell of `edge_m` whose lower corner is at `origin_m`; its branch for steps
    /// of `dt_s`.
    pub fn set_matrices(
        &mut self,
        lane: usize,
        (origin_m, edge_m): ([f64; 3], f64),
        matrices: &ElementMatrices,
        law: ElementLaw,
        dt_s: f64,
    ) {
        self.stiffness.set(lane, &pack(&matrices.stiffness));
        let shapes = Arc::make_mut(&mut self.shapes);
        for a in 0..8 {
            for b in 0..=a {
                set_lane(&mut shapes.mass_kg[a * (a + 1) / 2 + b], lane, matrices.mass_kg[a][b]);
            }
            for i in 0..3 {
                set_lane(&mut shapes.mean_gradient[a][i], lane, matrices.mean_gradient[a][i]);
            }
        }
        set_lane(&mut shapes.edge_m, lane, edge_m);
        set_lane(&mut shapes.volume_m3, lane, matrices.volume_m3);
        set_lane(&mut self.alpha_per_s, lane, law.alpha_per_s);
        set_lane(&mut self.beta_s, lane, law.beta_s);
        if law.stiffening_rate_per_pa > 0.0 {
            let block = self.stiffening.get_or_insert_with(|| StiffeningBlock {
                galerkin: PackedMatrix::default(),
                rate_per_pa: f64x4::ZERO,
                ground: None,
            });
            set_lane(&mut block.rate_per_pa, lane, law.stiffening_rate_per_pa);
            block.galerkin.set(lane, &pack(&matrices.stiffness_measured));
        } else if let Some(block) = &mut self.stiffening {
            set_lane(&mut block.rate_per_pa, lane, 0.0);
            block.galerkin.set(lane, &[0.0; PACKED]);
        }
        if law.viscosity.is_some() || self.viscosity.is_some() {
            self.viscosity.get_or_insert_default().set(lane, law.viscosity.as_ref(), dt_s);
        }
        self.set_free_stretch(lane, law.free_stretch);
        if matrices.ground.is_some() || self.ground.is_some() {
            let ground = self.ground.get_or_insert_default();
            ground.set(lane, matrices.ground.as_ref(), (origin_m, edge_m), &matrices.mean_gradient);
            if !ground.any() {
                self.ground = None;
            }
        }
        if let Some(stiffening) = &mut self.stiffening {
            let before = stiffening.ground.take();
            stiffening.ground = self.ground.is_some().then(|| before.unwrap_or_default());
            let measured = matrices.ground.as_ref().filter(|_| law.stiffening_rate_per_pa > 0.0).map(|g| &g.measured);
            stiffening.ground.iter_mut().for_each(|ground| ground.set(lane, measured));
        }
    }

    fn set_free_stretch(&mut self, lane: usize, stretch: Option<Mat3>) {
        if stretch.is_none() && self.free_edges_m.is_none() {
            return;
        }
        let (stretch, edge_m) = (stretch.unwrap_or_else(Mat3::identity), self.shapes.edge_m);
        let edges_m = self
            .free_edges_m
            .get_or_insert_with(|| Box::new(std::array::from_fn(|i| if i % 4 == 0 { edge_m } else { f64x4::ZERO })));
        for (i, edge) in edges_m.iter_mut().enumerate() {
            set_lane(edge, lane, stretch[(i / 3, i % 3)] * edge_m.as_array()[lane]);
        }
    }

    /// Stores matrices and shapes once where the elements have them in common with each other or with
    /// those of blocks before.
    pub fn share_matrices(&mut self, shared: &mut SharedByBlocks) {
        self.stiffness.share(&mut shared.matrices);
        if let Some(stiffening) = &mut self.stiffening {
            stiffening.galerkin.share(&mut shared.matrices);
        }
        match shared.shapes.iter().find(|shapes| **shapes == self.shapes) {
            Some(known) => self.shapes = Arc::clone(known),
            // Where elements differ, blocks hardly ever agree.
            None if shared.shapes.len() < MOST_SHARED && self.is_uniform() => {
                shared.shapes.push(Arc::clone(&self.shapes));
            }
            None => {}
        }
    }

    fn is_uniform(&self) -> bool {
        let mut values = self.shapes.mass_kg.iter().chain(self.shapes.mean_gradient.as_flattened());
        values.all(|v| v.as_array().iter().all(|lane| *lane == v.as_array()[0]))
    }

    /// Values at each corner's components, from those by slot.
    #[inline(always)]
    pub(super) fn gather(&self, values: &[f64x4]) -> [f64x4; 24] {
        let mut out = [f64x4::ZERO; 24];
        let last = values.len() - 1;
        for (corner, slots) in self.slots.iter().enumerate() {
            let at = |lane: usize| values[usize::from(slots[lane]).min(last)];
            let [x, y, z, _] = f64x4::transpose([at(0), at(1), at(2), at(3)]);
            out[3 * corner] = x;
            out[3 * corner + 1] = y;
            out[3 * corner + 2] = z;
        }
        out
    }

    /// Adds a force on each corner's components, N, scene frame, to the sums by slot.
    #[inline(always)]
    pub(super) fn add_to_balance(&self, balance_n: &mut [f64x4], force_n: impl Fn(usize) -> f64x4) {
        let last = balance_n.len() - 1;
        for (corner, slots) in self.slots.iter().enumerate() {
            let [x, y, z] = [0, 1, 2].map(|i| force_n(3 * corner + i));
            let lanes = f64x4::transpose([x, y, z, f64x4::ZERO]);
            for lane in 0..LANES {
                balance_n[usize::from(slots[lane]).min(last)] += lanes[lane];
            }
        }
    }
}
