//! What the velocity solve of a body works with.

use super::element::Homogenised;
use super::geometric_stiffness::GeometricStiffness;
use crate::fem::block::ElementBlock;
use crate::grid::levels::Level;
use crate::math::Nodal;
use crate::params::StepParams;
use crate::solve::multigrid::Multigrid;
use crate::walk::Kept;
use serde::{Deserialize, Serialize};

/// Matrices, loads and factors, made of the description and the state.
///
/// What only preconditions, and what tangents may leave out, follows the state with a lag: it is made anew once
/// the state is far enough from that which it was made of. So the solver is no function of the state, and a snapshot
/// that is to go on to the same bits keeps it too.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct Solver {
    /// Time step, tolerance and most iterations of the solves to come.
    pub(super) params: StepParams,
    #[serde(skip)]
    /// Stiffness, mass, damping and laws of the elements, in their own frames, four elements to a block.
    pub(super) blocks: Vec<ElementBlock>,
    #[serde(skip)]
    /// Moduli of the patterns of materials met so far.
    pub(super) homogenised: Homogenised,
    #[serde(skip)]
    /// Loads of each element at its corners, N, scene frame.
    pub(super) element_loads_n: Vec<[[f64; 3]; 8]>,
    #[serde(skip)]
    /// Their sums at the nodes: all that acts from outside but contact, N, scene frame.
    pub(super) external_n: Nodal,
    /// Geometric stiffness of the elements whose cells are not full, ids ascending.
    pub(super) geometric: Kept<Vec<GeometricStiffness>>,
    /// Which of these were the last to follow the stress: they take turns.
    pub(super) geometric_turn: usize,
    /// The system's operator, the coarse matrices above it and the factor of the coarsest.
    pub(super) multigrid: Multigrid,
    /// `psi'` that the operator's matrix of each element was last made with.
    pub(super) applied_stiffening: Vec<f64>,
    /// The same of the matrix that the coarse matrices were last made of.
    pub(super) coarse_stiffening: Vec<f64>,
    /// Bound on how far any element has turned since the smoothers' diagonals were made, rad.
    pub(super) turned_rad: f64,
    /// Bound on how much any element's geometric stiffness has changed since then, over `V E`.
    pub(super) unsmoothed: f64,
}

impl Solver {
    /// For a body of these levels; its matrices and loads are still to be made.
    pub(super) fn new(levels: &[Level], params: StepParams) -> Self {
        Self {
            params,
            blocks: Vec::new(),
            homogenised: Homogenised::default(),
            element_loads_n: Vec::new(),
            external_n: Vec::new(),
            geometric: Kept::default(),
            geometric_turn: 0,
            multigrid: Multigrid::new(levels),
            applied_stiffening: Vec::new(),
            coarse_stiffening: Vec::new(),
            turned_rad: 0.0,
            unsmoothed: 0.0,
        }
    }
}
