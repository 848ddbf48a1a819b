//! Springs between points of the tissue and something outside it, in the system matrix.

use super::assembly::LANES;
use super::vectors::times;
use wide::{f32x4, u32x8};

/// Most nodes that a point is spread over: the corners of two elements, and as many more where those of
/// them that hang are moved by others.
pub const POINT_NODES: usize = 32;

/// Springs between surfaces that there is room for before any press. A blade in an organ has fewer at its flanks. A step
/// that finds more allocates, once: their room stays.
pub const ROOM_FOR_SPRINGS: usize = 256;

/// A point of the tissue held by springs: adds `w w^T (x) S` to the system matrix.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PointSpring {
    nodes: [u32; POINT_NODES],
    weights: [f32; POINT_NODES],
    count: usize,
    /// Columns of `S = dt^2 sum k d d^T` over the springs at the point, kg.
    stiffness: [f32x4; 3],
}

impl PointSpring {
    /// A spring of `stiffness` k dt^2 along the unit vector `direction` at a point with `weights`.
    #[must_use]
    pub fn new(weights: impl Iterator<Item = (u32, f64)>, direction: [f64; 3], stiffness: f64) -> Self {
        let mut spring = Self::default();
        weights.for_each(|(node, w)| spring.add_weight(node, w as f32));
        spring.add_direction(direction, stiffness);
        spring
    }

    /// Adds a spring along another direction at the same point.
    pub fn add_direction(&mut self, direction: [f64; 3], stiffness: f64) {
        let [x, y, z] = direction;
        for (column, along) in self.stiffness.iter_mut().zip(direction) {
            let k = stiffness * along;
            *column += f32x4::new([(k * x) as f32, (k * y) as f32, (k * z) as f32, 0.0]);
        }
    }

    fn add_weight(&mut self, node: u32, weight: f32) {
        let found = self.place(node);
        if found == self.count {
            self.nodes[found] = node;
            self.count += 1;
        }
        self.weights[found] += weight;
    }

    /// Where a node is among those of the point, or the place after them.
    fn place(&self, node: u32) -> usize {
        let (groups, []) = self.nodes.as_chunks::<LANES>() else { unreachable!("whole groups") };
        let is_node = |group: &[u32; LANES]| u32x8::from(*group).simd_eq(u32x8::splat(node)).to_bitmask();
        let found = groups.iter().take(self.count.div_ceil(LANES)).enumerate().find_map(|(index, group)| {
            let lane = is_node(group).trailing_zeros() as usize;
            (lane < LANES).then_some(LANES * index + lane)
        });
        // Behind them are zeros, which are a node's number too.
        found.map_or(self.count, |found| found.min(self.count))
    }

    /// The same springs with every node spread over those that move it.
    #[must_use]
    pub fn spread<I: Iterator<Item = (usize, f32)>>(&self, masters: impl Fn(usize) -> I) -> Self {
        let mut spread = Self { stiffness: self.stiffness, ..Self::default() };
        for (node, w) in self.entries() {
            masters(node).for_each(|(master, share)| spread.add_weight(master as u32, w * share));
        }
        spread
    }

    /// Nodes and weights of the point.
    #[inline(always)]
    pub fn entries(&self) -> impl Iterator<Item = (usize, f32)> + '_ {
        self.nodes[..self.count].iter().zip(&self.weights).map(|(n, w)| (*n as usize, *w))
    }

    /// Rows of S, kg.
    #[must_use]
    pub fn stiffness(&self) -> [[f64; 4]; 3] {
        self.stiffness.map(|column| column.to_array().map(f64::from))
    }

    /// Entries (xx, yy, zz) and (xy, xz, yz) of S.
    #[must_use]
    pub fn diagonal(&self) -> [f32x4; 2] {
        let [x, y, z] = self.stiffness.map(|c| c.to_array());
        [f32x4::new([x[0], y[1], z[2], 0.0]), f32x4::new([y[0], z[0], z[1], 0.0])]
    }

    /// `w . x`.
    #[inline(always)]
    #[must_use]
    pub fn value(&self, x: &[f32x4]) -> f32x4 {
        self.entries().fold(f32x4::ZERO, |sum, (node, w)| f32x4::splat(w).mul_add(x[node], sum))
    }

    /// What the springs add at each node of the point where the point moves by `at`: `w (x) S at`.
    #[inline(always)]
    pub fn shares(&self, at: f32x4) -> impl Iterator<Item = (usize, f32x4)> + '_ {
        let force = times(&self.stiffness, at);
        self.entries().map(move |(node, w)| (node, f32x4::splat(w) * force))
    }

    /// What the springs add at each node of the point: `(w w^T (x) S) x`.
    pub fn forces<'a>(&'a self, x: &[f32x4]) -> impl Iterator<Item = (usize, f32x4)> + 'a {
        self.shares(self.value(x))
    }
}
