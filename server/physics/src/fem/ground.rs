//! What holds four elements: the ground points of [`super::held`] beside their corners.

use super::lanes;
use super::lanes::set_lane;
use super::matrices::{GROUND, Ground, GroundStiffness};
use wide::f64x4;

/// Stiffness between corners and ground points of four elements, N/m; zero where nothing is held.
#[derive(Clone)]
pub(super) struct GroundLanes {
    /// By degree of freedom of the corners.
    coupling: Box<[[f64x4; GROUND]; 24]>,
    own: Box<[[f64x4; GROUND]; GROUND]>,
}

/// What holds four elements.
#[derive(Clone)]
pub struct GroundBlock {
    /// All bits where an element is held.
    is_held: f64x4,
    /// Its cell's lower corner at rest, m, scene frame.
    origin_m: [f64x4; 3],
    /// What the ground points contribute to the mean deformation gradient.
    pub(super) gradient: [f64x4; 9],
    pub(super) stiffness: GroundLanes,
}

/// Ground points in the rest frames of four elements: relative to the lower corner.
pub(super) struct GroundPoints {
    pub(super) position_m: [f64x4; GROUND],
    pub(super) displacement_m: [f64x4; GROUND],
}

impl Default for GroundLanes {
    fn default() -> Self {
        let zero = f64x4::ZERO;
        Self { coupling: Box::new([[zero; GROUND]; 24]), own: Box::new([[zero; GROUND]; GROUND]) }
    }
}

impl GroundLanes {
    pub(super) fn set(&mut self, lane: usize, stiffness: Option<&GroundStiffness>) {
        for (row, lanes) in self.coupling.iter_mut().enumerate() {
            let value = |i: usize| stiffness.map_or(0.0, |s| s.coupling[row][i]);
            lanes.iter_mut().enumerate().for_each(|(i, k)| set_lane(k, lane, value(i)));
        }
        for (row, lanes) in self.own.iter_mut().enumerate() {
            let value = |i: usize| stiffness.map_or(0.0, |s| s.own[row][i]);
            lanes.iter_mut().enumerate().for_each(|(i, k)| set_lane(k, lane, value(i)));
        }
    }

    /// Adds the force of the ground points' displacements on the corners to `force_n`, and returns that on the ground
    /// points, of the corners' displacements too.
    #[inline(always)]
    pub(super) fn add_force(
        &self,
        corners_m: &[f64x4; 24],
        ground_m: &[f64x4; GROUND],
        force_n: &mut [f64x4; 24],
    ) -> [f64x4; GROUND] {
        let mut on_ground_n = [f64x4::ZERO; GROUND];
        for (row, k) in self.coupling.iter().enumerate() {
            for i in 0..GROUND {
                force_n[row] = k[i].mul_add(ground_m[i], force_n[row]);
                on_ground_n[i] = k[i].mul_add(corners_m[row], on_ground_n[i]);
            }
        }
        for (row, k) in self.own.iter().enumerate() {
            on_ground_n[row] += lanes::dot(k, ground_m);
        }
        on_ground_n
    }
}

impl Default for GroundBlock {
    fn default() -> Self {
        let zero = f64x4::ZERO;
        Self { is_held: zero, origin_m: [zero; 3], gradient: [zero; 9], stiffness: GroundLanes::default() }
    }
}

impl GroundBlock {
    /// Sets what holds the element of a lane, whose mean shape gradients are `mean_gradient`, in a cell of `edge_m` at
    /// `origin_m`; `None`: nothing.
    pub(super) fn set(
        &mut self,
        lane: usize,
        ground: Option<&Ground>,
        (origin_m, edge_m): ([f64; 3], f64),
        mean_gradient: &[[f64; 3]; 8],
    ) {
        set_lane(&mut self.is_held, lane, f64::from_bits(if ground.is_some() { u64::MAX } else { 0 }));
        for i in 0..3 {
            set_lane(&mut self.origin_m[i], lane, origin_m[i]);
            for j in 0..3 {
                // At rest F is 1.
                let corners: f64 = (0..8).filter(|c| c >> i & 1 == 1).map(|c| edge_m * mean_gradient[c][j]).sum();
                let rest = if i == j { 1.0 } else { 0.0 };
                let missing = if ground.is_some() { rest - corners } else { 0.0 };
                set_lane(&mut self.gradient[3 * i + j], lane, missing);
            }
        }
        self.stiffness.set(lane, ground.map(|g| &g.stiffness));
    }

    /// Whether any of the four is held.
    pub(super) fn any(&self) -> bool {
        self.is_held.to_array().iter().any(|lane| lane.to_bits() != 0)
    }

    /// What positions are taken relative to, m: the held elements' rest position, the others' first corner `x`.
    #[inline(always)]
    pub(super) fn origin_m(&self, first: [f64x4; 3]) -> [f64x4; 3] {
        [0, 1, 2].map(|i| self.is_held.bitselect(self.origin_m[i], first[i]))
    }

    /// The ground points as elements that have turned by `r` see them; `free_edges_m` as the block has them.
    #[inline(always)]
    pub(super) fn points(&self, r: &[f64x4; 9], edge_m: f64x4, free_edges_m: Option<&[f64x4; 9]>) -> GroundPoints {
        // R^T e_j is row j of R.
        let position_m = r.map(|entry| edge_m * entry);
        let mut displacement_m = position_m;
        match free_edges_m {
            Some(edges_m) => (0..9).for_each(|i| displacement_m[i] -= edges_m[3 * (i % 3) + i / 3]),
            None => (0..3).for_each(|i| displacement_m[4 * i] -= edge_m),
        }
        GroundPoints { position_m, displacement_m }
    }
}
