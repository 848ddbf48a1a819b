//! Products of elements that stand in rows along x, side by side as their lanes are.
//!
//! The nodes of such a row follow each other, so that with each component by itself (`x x x ..`, not
//! `x y z 0 x y z 0 ..`) a corner of eight elements is one load: a node is transposed once per chunk
//! and not once for each of its eight elements, which is most of a product's time.

use super::assembly::LANES;
use crate::fem::lanes;
use wide::{f32x4, f32x8};

/// Most nodes of a chunk of rows: their buffers are on the stack.
pub const MOST_ROW_NODES: usize = 384;

/// Of each of the four edges along x of a block's elements, the slot of the first of its nine nodes,
/// which follow each other.
#[derive(Clone, Copy)]
pub struct RowEdges([u16; 4]);

/// The last slot that an edge may begin at: it has one node more than there are lanes.
const LAST_EDGE: u16 = (MOST_ROW_NODES - LANES - 1) as u16;

/// The nodes of one chunk, each component by itself.
pub struct RowBuffers {
    values: [[f32; MOST_ROW_NODES]; 3],
    /// What elements add at their corners of lower x, by the corner's slot.
    near: [[f32; MOST_ROW_NODES]; 3],
    /// What elements add at their corners of higher x, by the slot of the corner before, `LANES` on: two
    /// sums, since a load of what was stored one lane off would wait for the store.
    far: [[f32; LANES + MOST_ROW_NODES]; 3],
}

impl RowEdges {
    /// The slots as they are. That none is beyond the last is known of chunks that fit; said here, no access
    /// needs a check.
    #[inline(always)]
    fn slots(&self) -> [usize; 4] {
        self.0.map(|slot| usize::from(slot.min(LAST_EDGE)))
    }

    /// From the slots of a block's corners by corner and lane; `None` where they do not follow each other.
    pub fn of(corners: &[[u16; LANES]; 8]) -> Option<Self> {
        let follows = |c: usize, lane: usize| corners[c][lane] as usize == corners[c & !1][0] as usize + lane + (c & 1);
        (0..8).all(|c| (0..LANES).all(|lane| follows(c, lane))).then(|| Self([0, 2, 4, 6].map(|c| corners[c][0])))
    }
}

#[inline(always)]
fn load(from: &[f32]) -> f32x8 {
    let lanes: &[f32; LANES] = from.first_chunk().expect("as many as lanes");
    (*lanes).into()
}

#[inline(always)]
fn store(to: &mut [f32], v: f32x8) {
    *to.first_chunk_mut().expect("as many as lanes") = v.to_array();
}

#[inline(always)]
fn add(to: &mut [f32], v: f32x8) {
    store(to, load(to) + v);
}

impl RowBuffers {
    /// Of zeros.
    #[inline(always)]
    pub fn new() -> Self {
        const { assert!(MOST_ROW_NODES.is_multiple_of(LANES)) };
        Self {
            values: [[0.0; MOST_ROW_NODES]; 3],
            near: [[0.0; MOST_ROW_NODES]; 3],
            far: [[0.0; LANES + MOST_ROW_NODES]; 3],
        }
    }

    /// Takes the values of a vector at `nodes`.
    #[inline(always)]
    pub fn load(&mut self, vector: &[f32x4], nodes: &[u32]) {
        let (groups, rest) = nodes.as_chunks::<LANES>();
        for (group, nodes) in groups.iter().enumerate() {
            self.load_group(group * LANES, nodes.map(|node| vector[node as usize]));
        }
        let at = |i: usize| rest.get(i).map_or(f32x4::ZERO, |node| vector[*node as usize]);
        if !rest.is_empty() {
            self.load_group(groups.len() * LANES, std::array::from_fn(at));
        }
    }

    #[inline(always)]
    fn load_group(&mut self, at: usize, nodes: [f32x4; LANES]) {
        for (values, component) in self.values.iter_mut().zip(lanes::split(nodes)) {
            store(&mut values[at..], component);
        }
    }

    /// Components of the corners of a block, one element per lane.
    #[inline(always)]
    pub fn gather(&self, edges: &RowEdges) -> [f32x8; 24] {
        let mut u = [f32x8::ZERO; 24];
        for (edge, slot) in edges.slots().into_iter().enumerate() {
            for i in 0..3 {
                let nodes = &self.values[i][slot..slot + LANES + 1];
                u[6 * edge + i] = load(nodes);
                u[6 * edge + 3 + i] = load(&nodes[1..]);
            }
        }
        u
    }

    /// Adds what each lane of a block has for its corners.
    #[inline(always)]
    pub fn add(&mut self, edges: &RowEdges, y: &[f32x8; 24]) {
        for (edge, slot) in edges.slots().into_iter().enumerate() {
            for i in 0..3 {
                add(&mut self.near[i][slot..slot + LANES], y[6 * edge + i]);
                add(&mut self.far[i][slot + LANES..slot + 2 * LANES], y[6 * edge + 3 + i]);
            }
        }
    }

    /// What the elements have added up, by slot.
    #[inline(always)]
    pub fn write(&self, sums: &mut [f32x4]) {
        let group_sum = |at: usize| -> [f32x4; LANES] {
            let sum = |i: usize| load(&self.near[i][at..]) + load(&self.far[i][at + LANES - 1..]);
            lanes::join([sum(0), sum(1), sum(2)])
        };
        let (groups, rest) = sums.as_chunks_mut::<LANES>();
        for (group, sums) in groups.iter_mut().enumerate() {
            *sums = group_sum(group * LANES);
        }
        if !rest.is_empty() {
            rest.copy_from_slice(&group_sum(groups.len() * LANES)[..rest.len()]);
        }
    }
}
