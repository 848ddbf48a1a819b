//! Room that a body's step works in.

use super::quasi_static::InertiaScratch;
use crate::fem::block::{LANES, ModelFit, NodalBuffers};
use crate::grid::levels::Level;
use crate::grow::{grow, make_room};
use crate::math::Nodal;
use crate::solve::assembly::Assembly;
use crate::solve::pcg::PcgScratch;
use crate::solve::vectors::NodeVector;
use wide::f64x4;

/// Vectors that are written before they are read in every step: nothing in them survives one.
#[derive(Default)]
pub(super) struct Scratch {
    /// Right side of the velocity solve but for contact, N s, by node, scene frame.
    pub(super) right_side: Nodal,
    /// What of the right side is for turning, N s, by node; empty while nothing turns.
    pub(super) turning: Nodal,
    /// Sums of impulses of which a norm is wanted, N s, by node, scene frame.
    pub(super) applied: Nodal,
    /// The right side with contact as the solver takes it, N s, by node, xyz0.
    pub(super) right_side_f32: NodeVector,
    /// The solver's guess and then its solution, m/s, by node, xyz0.
    pub(super) solution: NodeVector,
    /// Search directions of the conjugate gradients.
    pub(super) pcg: PcgScratch,
    /// Products of masses.
    pub(super) inertia: InertiaScratch,
    /// Nodal values as the elements of each chunk read them, by chunk.
    pub(super) nodal: Vec<NodalBuffers>,
    /// How well the last step's model of its potential held, four elements to a block.
    pub(super) fits: Vec<ModelFit>,
    /// What stands in the elements' buffers while their places change.
    pub(super) balance_n: Vec<f64x4>,
    /// Elements of the level above whose matrices are to be made anew.
    pub(super) stale_parents: Vec<u32>,
}

/// A copy begins with nothing.
impl Clone for Scratch {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl Scratch {
    /// Makes room for a level that is assembled as `assembly` says.
    pub(super) fn fit(&mut self, level: &Level, assembly: &Assembly) {
        let nodes = level.nodes.len();
        grow(&mut self.right_side, nodes, [0.0; 3]);
        grow(&mut self.applied, nodes, [0.0; 3]);
        grow(&mut self.right_side_f32, nodes, Default::default());
        grow(&mut self.solution, nodes, Default::default());
        self.pcg.resize(nodes);
        self.nodal.resize_with(assembly.chunks().len(), Default::default);
        for (nodal, chunk) in self.nodal.iter_mut().zip(assembly.chunks()) {
            for values in [&mut nodal.position_m, &mut nodal.velocity_m_per_s, &mut nodal.velocity_change] {
                grow(values, chunk.len(), f64x4::ZERO);
            }
        }
        grow(&mut self.fits, level.elements.len().div_ceil(LANES), ModelFit::default());
        self.stale_parents.clear();
        make_room(&mut self.stale_parents, level.elements.len());
    }
}
