//! The system matrix of one level, `A = sum_e R_e A_e R_e^T + contacts`, eight elements at a time.
//!
//! `A_e = (1 + alpha dt) M_e + (dt^2 + beta dt) (K_e + H_e)`: mass, stiffness and held voxels. Blocks of
//! elements add to the buffer of their chunk, see [`super::assembly`]. Node vectors are padded to four
//! components: a node is one load, and eight nodes become lanes by a transpose in registers.

use super::assembly::{Assembly, CHUNK_ELEMENTS, Chunk, LANES};
use super::diagonal::{Diagonal, invert};
use super::rows::{MOST_ROW_NODES, RowBuffers, RowEdges};
use super::spring::{POINT_NODES, PointSpring};
use super::vectors::{NODE_GRAIN, NODES_PER_CHUNK, NodeVector, times};
use crate::fem::lanes::{self, PACKED};
use crate::fem::packed::{PackedMatrix, Shared};
use crate::grid::levels::{HangingNode, Level};
use crate::grow::{grow, make_room};
use crate::walk::{Kept, KeptHash};
use crate::workers::{Grain, Workers};
use wide::{f32x4, f32x8, f64x4};

/// Blocks per chunk of elements.
const BLOCKS_PER_CHUNK: usize = CHUNK_ELEMENTS / LANES;
/// Of sums over the chunks of elements: 5 us a chunk.
const ELEMENT_GRAIN: Grain = Grain { chunk: 1, least: 4 };

/// Eight elements.
#[derive(Clone)]
pub struct OperatorBlock {
    /// `A_e` in the rest frame.
    pub(super) matrix: PackedMatrix<f32x8>,
    /// Rotation of each element, row-major.
    pub rotation: [f32x8; 9],
}

/// Where the corners of a chunk's elements lie in its buffer, block by block.
#[derive(Clone)]
enum Corners {
    /// All of its blocks are rows.
    Rows(Vec<RowEdges>),
    /// By corner and lane.
    Each(Vec<[[u16; LANES]; 8]>),
}

/// One level's system matrix.
#[derive(Clone)]
pub struct Operator {
    /// Blocks of elements, by element id.
    pub blocks: Vec<OperatorBlock>,
    /// Of the blocks' matrices.
    matrices_hash: KeptHash,
    /// Springs that act now, between unknowns.
    springs: Vec<PointSpring>,
    element_nodes: Vec<[u32; 8]>,
    assembly: Assembly,
    /// By chunk.
    corners: Vec<Corners>,
    /// What the elements of each chunk read, and what they add up.
    values: NodeVector,
    sums: NodeVector,
    /// The unknowns that move each hanging node.
    hanging: Vec<HangingNode>,
    /// Of the elements alone.
    diagonal: Kept<Diagonal>,
    /// Of the springs alone; zero but while they are summed.
    spring_diagonal: Diagonal,
    /// Nodes that carry springs.
    sprung: Vec<u32>,
    /// Columns of the inverse diagonal block of each node.
    inverse: Vec<[f32x4; 3]>,
}

/// Components of the corners, one element per lane. Slots and values are those of one chunk.
#[inline(always)]
#[allow(unsafe_code, reason = "a gather of lanes: 64 checks a block are a tenth of a product")]
fn gather(corners: &[[u16; LANES]; 8], values: &[f32x4]) -> [f32x8; 24] {
    let at = |slot: u16| {
        #[cfg(any(test, debug_assertions))]
        assert!(usize::from(slot) < values.len());
        // SAFETY: a chunk gives out slots below its length, and `Assembly::by_chunk` buffers of that length.
        unsafe { *values.get_unchecked(usize::from(slot)) }
    };
    let corner = |c: usize| lanes::split(corners[c].map(at));
    let c = [corner(0), corner(1), corner(2), corner(3), corner(4), corner(5), corner(6), corner(7)];
    bytemuck::cast(c)
}

/// Adds what each lane has for its corners. Slots and sums are those of one chunk.
#[inline(always)]
#[allow(unsafe_code, reason = "a scatter of lanes, as the gather")]
fn scatter(corners: &[[u16; LANES]; 8], y: &[f32x8; 24], sums: &mut [f32x4]) {
    for (corner, slots) in corners.iter().enumerate() {
        let vectors = lanes::join([y[3 * corner], y[3 * corner + 1], y[3 * corner + 2]]);
        for (slot, vector) in slots.iter().zip(vectors) {
            #[cfg(any(test, debug_assertions))]
            assert!(usize::from(*slot) < sums.len());
            // SAFETY: as in `gather`.
            unsafe { *sums.get_unchecked_mut(usize::from(*slot)) += vector };
        }
    }
}

impl Corners {
    /// Of the first `elements` of a chunk.
    fn of(chunk: &Chunk, elements: usize) -> Self {
        let block = |first: usize| {
            let mut corners = [[0; LANES]; 8];
            for lane in 0..LANES.min(elements - first) {
                let slots = chunk.corners(first + lane);
                (0..8).for_each(|corner| corners[corner][lane] = slots[corner]);
            }
            corners
        };
        let blocks = (0..elements).step_by(LANES).map(block);
        let fits = chunk.len() <= MOST_ROW_NODES && !chunk.has_hanging();
        let rows = || blocks.clone().map(|corners| RowEdges::of(&corners)).collect::<Option<_>>();
        match fits.then(rows).flatten() {
            Some(rows) => Self::Rows(rows),
            None => Self::Each(blocks.collect()),
        }
    }
}

impl OperatorBlock {
    fn new() -> Self {
        let (zero, one) = (f32x8::ZERO, f32x8::ONE);
        Self { matrix: PackedMatrix::default(), rotation: [one, zero, zero, zero, one, zero, zero, zero, one] }
    }

    /// Sets the rotation of a lane, row-major.
    pub fn set_rotation(&mut self, lane: usize, rotation: &[f64; 9]) {
        for (slot, value) in self.rotation.iter_mut().zip(rotation) {
            slot.as_mut_array()[lane] = *value as f32;
        }
    }

    /// Rows of the diagonal block of a corner in the rest frame.
    #[inline(always)]
    fn corner_block(&self, corner: usize) -> [[f32x8; 3]; 3] {
        let start = lanes::diagonal_entry(corner);
        let m: [f32x8; 6] = std::array::from_fn(|i| self.matrix.entry(start + i));
        [[m[0], m[1], m[3]], [m[1], m[2], m[4]], [m[3], m[4], m[5]]]
    }
}

/// What every element adds up at its corners. A trait and not a closure: it is to be inlined wherever it
/// is called, or its arguments go through memory.
trait BlockTerm: Sync {
    /// Of the elements of a block, from the values `u` at their corners.
    fn of(&self, block: &OperatorBlock, u: &[f32x8; 24]) -> [f32x8; 24];
    /// How much of it a hanging node hands to a master that moves it with `weight`.
    fn share(weight: f32) -> f32;
}

/// `R A_e R^T u`.
struct Product;

/// `(R B R^T)_ij` of each corner's diagonal block B for three pairs (i, j).
struct RotatedDiagonal([(usize, usize); 3]);

impl BlockTerm for Product {
    #[inline(always)]
    fn of(&self, block: &OperatorBlock, u: &[f32x8; 24]) -> [f32x8; 24] {
        lanes::rotate(&block.rotation, &block.matrix.apply(&lanes::rotate_back(&block.rotation, u)))
    }

    fn share(weight: f32) -> f32 {
        weight
    }
}

impl BlockTerm for RotatedDiagonal {
    #[inline(always)]
    fn of(&self, block: &OperatorBlock, _: &[f32x8; 24]) -> [f32x8; 24] {
        let row = |i: usize| [block.rotation[3 * i], block.rotation[3 * i + 1], block.rotation[3 * i + 2]];
        let dot = |a: [f32x8; 3], b: [f32x8; 3]| a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]));
        let mut out = [f32x8::ZERO; 24];
        for corner in 0..8 {
            let corner_block = block.corner_block(corner);
            for (slot, (i, j)) in self.0.into_iter().enumerate() {
                out[3 * corner + slot] = dot(corner_block.map(|b| dot(b, row(i))), row(j));
            }
        }
        out
    }

    fn share(weight: f32) -> f32 {
        weight * weight
    }
}

impl Operator {
    /// An operator over the elements of `level`, all matrices zero.
    #[must_use]
    pub fn new(level: &Level) -> Self {
        let mut operator = Self::empty();
        operator.set_topology(level, None);
        operator
    }

    /// An operator over nothing.
    fn empty() -> Self {
        Self {
            blocks: Vec::new(),
            matrices_hash: KeptHash::default(),
            springs: Vec::new(),
            element_nodes: Vec::new(),
            assembly: Assembly::default(),
            corners: Vec::new(),
            values: Vec::new(),
            sums: Vec::new(),
            hanging: Vec::new(),
            diagonal: Kept::default(),
            spring_diagonal: Diagonal::default(),
            sprung: Vec::new(),
            inverse: Vec::new(),
        }
    }

    /// What of an operator follows the state with a lag, and nothing else.
    pub(super) fn lagging(diagonal: Kept<Diagonal>, matrices: Vec<PackedMatrix<f32x8>>) -> Self {
        let block = |matrix| OperatorBlock { matrix, ..OperatorBlock::new() };
        Self { diagonal, blocks: matrices.into_iter().map(block).collect(), ..Self::empty() }
    }

    /// Takes what of `read` follows the state with a lag; [`Self::invert_diagonal`] completes it.
    pub(super) fn take_lag(&mut self, read: Self) {
        self.diagonal = read.diagonal;
        self.blocks.iter_mut().zip(read.blocks).for_each(|(block, read)| block.matrix = read.matrix);
        self.matrices_hash.forget();
    }

    pub(super) fn matrices_hash(&self) -> &KeptHash {
        &self.matrices_hash
    }

    pub(super) fn diagonal(&self) -> &Kept<Diagonal> {
        &self.diagonal
    }

    /// Number of nodes, hanging ones included.
    #[must_use]
    pub fn node_count(&self) -> usize {
        self.inverse.len()
    }

    /// Number of elements.
    #[must_use]
    pub fn element_count(&self) -> usize {
        self.element_nodes.len()
    }

    /// Takes new connectivity, changed as [`Assembly::set_topology`] says; matrices of elements that were
    /// there before are kept. Returns the chunks whose numbering changed.
    pub fn set_topology(&mut self, level: &Level, changed: Option<&[u32]>) -> Vec<usize> {
        let (elements, node_count) = (level.elements.len(), level.nodes.len());
        self.hanging.clear();
        self.hanging.extend(level.hanging());
        let renumbered = self.assembly.set_topology(level, changed);
        grow(&mut self.element_nodes, elements, [0; 8]);
        grow(&mut self.blocks, elements.div_ceil(LANES), OperatorBlock::new());
        self.matrices_hash.forget();
        self.corners.resize_with(self.assembly.chunks().len(), || Corners::Each(Vec::new()));
        grow(&mut self.values, self.assembly.buffer_len(), f32x4::ZERO);
        grow(&mut self.sums, self.assembly.buffer_len(), f32x4::ZERO);
        for &index in &renumbered {
            let chunk = &self.assembly.chunks()[index];
            let first = index * CHUNK_ELEMENTS;
            let range = first..elements.min(first + CHUNK_ELEMENTS);
            range.clone().for_each(|e| self.element_nodes[e] = level.elements[e].nodes);
            self.corners[index] = Corners::of(chunk, range.len());
        }
        grow(&mut self.inverse, node_count, [f32x4::ZERO; 3]);
        self.diagonal.resize(node_count);
        self.spring_diagonal.resize(node_count);
        self.springs.clear();
        self.sprung.clear();
        renumbered
    }

    /// Which nodes the elements touch.
    #[must_use]
    pub fn assembly(&self) -> &Assembly {
        &self.assembly
    }

    /// Nodes that hang, ascending.
    #[must_use]
    pub fn hanging(&self) -> &[HangingNode] {
        &self.hanging
    }

    /// Whether a node hangs.
    #[must_use]
    pub fn hangs(&self, node: u32) -> bool {
        self.hanging.binary_search_by_key(&node, |h| h.node).is_ok()
    }

    /// Nodes of an element.
    #[must_use]
    pub fn element_nodes(&self, element: usize) -> &[u32; 8] {
        &self.element_nodes[element]
    }

    /// Sets the packed matrix of an element.
    pub fn set_matrix(&mut self, element: usize, packed: &[f64; PACKED]) {
        self.matrices_hash.forget();
        self.blocks[element / LANES].matrix.set(element % LANES, packed);
    }

    /// Sets the packed matrices of those of four elements from `first` on that are `written`.
    pub fn set_matrices(&mut self, first: usize, packed: &[f64x4; PACKED], written: [bool; 4]) {
        self.matrices_hash.forget();
        self.blocks[first / LANES].matrix.set_lanes(first % LANES, packed, written);
    }

    /// Stores once what blocks have in common.
    pub fn share_matrices(&mut self) {
        let mut shared = Vec::new();
        self.matrices_hash.forget();
        self.blocks.iter_mut().for_each(|b| b.matrix.share(&mut shared));
    }

    /// Stores once what the elements of the block of one have in common with each other or with those that `shared` has.
    pub fn share_matrix(&mut self, element: usize, shared: &mut Shared<f32x8>) {
        self.matrices_hash.forget();
        self.blocks[element / LANES].matrix.share(shared);
    }

    /// The packed matrix of an element, as set.
    #[must_use]
    pub fn matrix(&self, element: usize) -> [f64; PACKED] {
        let (block, lane) = (&self.blocks[element / LANES], element % LANES);
        std::array::from_fn(|i| block.matrix.at(i, lane))
    }

    /// The rotation of an element, row-major.
    #[must_use]
    pub fn rotation(&self, element: usize) -> [f64; 9] {
        let (block, lane) = (&self.blocks[element / LANES], element % LANES);
        std::array::from_fn(|i| f64::from(block.rotation[i].as_array()[lane]))
    }

    /// `y = A x`.
    pub fn apply(&mut self, workers: &Workers<'_>, x: &[f32x4], y: &mut [f32x4]) {
        self.multiply(workers, x);
        self.read_products(workers, y);
    }

    /// Makes `A x` readable through [`Self::product_at`].
    pub fn multiply(&mut self, workers: &Workers<'_>, x: &[f32x4]) {
        self.evaluate_blocks(workers, Some(x), &Product);
        for spring in &self.springs {
            for (node, force) in spring.forces(x) {
                // Whichever of the node's entries: they are added up.
                if let Some(entry) = self.assembly.entries(node).first() {
                    self.sums[*entry as usize] += force;
                }
            }
        }
    }

    /// Adds to the product at a node.
    #[inline(always)]
    pub fn add_to_product(&mut self, node: usize, force: f32x4) {
        // Whichever of the node's entries: they are added up.
        if let Some(entry) = self.assembly.entries(node).first() {
            self.sums[*entry as usize] += force;
        }
    }

    /// A spring with every node spread over the unknowns that move it.
    #[must_use]
    pub fn among_unknowns(&self, spring: &PointSpring) -> PointSpring {
        if self.hanging.is_empty() { *spring } else { spring.spread(|node| masters_of(&self.hanging, node)) }
    }

    /// The product at a node; zero at hanging ones.
    #[inline(always)]
    #[must_use]
    pub fn product_at(&self, node: usize) -> f32x4 {
        let entries = self.assembly.entries(node);
        entries.iter().fold(f32x4::ZERO, |sum, entry| sum + self.sums[*entry as usize])
    }

    fn read_products(&self, workers: &Workers<'_>, y: &mut [f32x4]) {
        workers.for_chunks(y, NODE_GRAIN, |chunk, y| {
            for (node, y) in (chunk * NODES_PER_CHUNK..).zip(y) {
                *y = self.product_at(node);
            }
        });
    }

    /// Sums what `term` has for each block and the values of `x` at its corners, which are of no meaning
    /// where there is no `x`.
    fn evaluate_blocks<T: BlockTerm>(&mut self, workers: &Workers<'_>, x: Option<&[f32x4]>, term: &T) {
        let Self { blocks, assembly, corners, values, sums, .. } = self;
        let buffers = (assembly.by_chunk(values), assembly.by_chunk(sums));
        workers.for_chunks(buffers, ELEMENT_GRAIN, |index, (values, sums)| {
            let (values, sums, chunk) = (values.entries, sums.entries, &assembly.chunks()[index]);
            let blocks = blocks[index * BLOCKS_PER_CHUNK..].iter();
            match &corners[index] {
                Corners::Rows(edges) => {
                    let mut buffers = RowBuffers::new();
                    x.iter().for_each(|x| buffers.load(x, chunk.unknowns()));
                    for (block, edges) in blocks.zip(edges) {
                        buffers.add(edges, &term.of(block, &buffers.gather(edges)));
                    }
                    buffers.write(sums);
                }
                Corners::Each(corners) => {
                    x.iter().for_each(|x| chunk.load(x, |v| v, values));
                    sums.fill(f32x4::ZERO);
                    for (block, corners) in blocks.zip(corners) {
                        scatter(corners, &term.of(block, &gather(corners, values)), sums);
                    }
                    chunk.hand_over(sums, T::share);
                }
            }
        });
    }

    /// Recomputes the inverse diagonal blocks from matrices and rotations. Springs are dropped.
    pub fn update_diagonal(&mut self, workers: &Workers<'_>) {
        let mut diagonal = std::mem::take(&mut self.diagonal);
        self.sum_diagonals(workers, [(0, 0), (1, 1), (2, 2)], &mut diagonal.on);
        self.sum_diagonals(workers, [(0, 1), (0, 2), (1, 2)], &mut diagonal.off);
        self.diagonal = diagonal;
        self.invert_diagonal(workers);
    }

    /// Inverts the diagonal blocks as they are. Springs are dropped.
    pub(super) fn invert_diagonal(&mut self, workers: &Workers<'_>) {
        self.springs.clear();
        self.sprung.clear();
        let data = (&self.diagonal.on[..], &self.diagonal.off[..], &mut self.inverse[..]);
        workers.for_chunks(data, NODE_GRAIN, |_, (on, off, inverse)| {
            for (first, inverse) in inverse.chunks_mut(LANES).enumerate() {
                let at = |v: &[f32x4]| -> [f32x4; LANES] {
                    std::array::from_fn(|i| v.get(first * LANES + i).copied().unwrap_or_default())
                };
                let inverted = invert(at(on), at(off));
                inverse.copy_from_slice(&inverted[..inverse.len()]);
            }
        });
    }

    /// Sums three entries of the elements' diagonal blocks at the nodes. Without the entries between a
    /// hanging node and its masters: they would make the masters' smaller.
    fn sum_diagonals(&mut self, workers: &Workers<'_>, entries: [(usize, usize); 3], sums: &mut [f32x4]) {
        self.evaluate_blocks(workers, None, &RotatedDiagonal(entries));
        self.read_products(workers, sums);
    }

    /// Room for `count` springs.
    pub fn reserve_springs(&mut self, count: usize) {
        self.springs.clear();
        make_room(&mut self.springs, count);
        make_room(&mut self.sprung, POINT_NODES * count);
    }

    /// Springs that act now.
    #[must_use]
    pub fn springs(&self) -> &[PointSpring] {
        &self.springs
    }

    /// Replaces the springs; costs in proportion to the nodes that carry one or carried one.
    pub fn set_springs(&mut self, springs: impl Iterator<Item = PointSpring>, largest_eigenvalue: f32) {
        self.springs.clear();
        if self.hanging.is_empty() {
            self.springs.extend(springs);
        } else {
            let expanded = springs.map(|s| s.spread(|node| masters_of(&self.hanging, node)));
            self.springs.extend(expanded);
        }
        let mut sprung = std::mem::take(&mut self.sprung);
        self.invert_at(&sprung);
        sprung.clear();
        for spring in &self.springs {
            let [on, off] = spring.diagonal();
            let reach: f32 = spring.entries().map(|(_, w)| w.abs()).sum();
            for (node, w) in spring.entries() {
                let square = f32x4::splat(w.abs() * reach / largest_eigenvalue);
                if self.spring_diagonal.on[node] == f32x4::ZERO {
                    sprung.push(node as u32);
                }
                self.spring_diagonal.on[node] += square * on;
                self.spring_diagonal.off[node] += square * off;
            }
        }
        self.invert_at(&sprung);
        for &node in &sprung {
            self.spring_diagonal.on[node as usize] = f32x4::ZERO;
            self.spring_diagonal.off[node as usize] = f32x4::ZERO;
        }
        self.sprung = sprung;
    }

    fn invert_at(&mut self, nodes: &[u32]) {
        for nodes in nodes.chunks(LANES) {
            let sum = |a: &NodeVector, b: &NodeVector| -> [f32x4; LANES] {
                std::array::from_fn(|i| nodes.get(i).map_or(f32x4::ZERO, |&n| a[n as usize] + b[n as usize]))
            };
            let on = sum(&self.diagonal.on, &self.spring_diagonal.on);
            let off = sum(&self.diagonal.off, &self.spring_diagonal.off);
            for (&node, inverse) in nodes.iter().zip(invert(on, off)) {
                self.inverse[node as usize] = inverse;
            }
        }
    }

    /// `D^-1 r` at a node.
    #[inline(always)]
    #[must_use]
    pub fn precondition_node(&self, node: usize, r: f32x4) -> f32x4 {
        times(&self.inverse[node], r)
    }
}

/// The unknowns that move a node, and how much.
pub fn masters_of(hanging: &[HangingNode], node: usize) -> impl Iterator<Item = (usize, f32)> + use<> {
    let masters = match hanging.binary_search_by_key(&(node as u32), |h| h.node) {
        Ok(found) => hanging[found].masters,
        Err(_) => [(node as u32, 1.0), (0, 0.0), (0, 0.0), (0, 0.0)],
    };
    masters.into_iter().filter(|(_, w)| *w != 0.0).map(|(master, w)| (master as usize, w))
}
