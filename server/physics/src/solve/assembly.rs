//! Which nodes the elements of a level read and add to, chunk by chunk.
//!
//! The elements of a chunk work on a buffer of their own, small enough to stay close to a core; a node
//! then sums its entries of the few chunks around it in a fixed order. So the bits do not depend on the
//! number of threads, and nothing has to be coloured.
//!
//! Hanging nodes are no unknowns: within a chunk they take their values from their masters and hand
//! theirs what acts on them, so that the level's system is `Z^T A Z` with Z the interpolation of all
//! nodes from the others.

use crate::grid::levels::{Level, NONE};
use std::ops::{AddAssign, Mul};

/// Elements per chunk.
pub const CHUNK_ELEMENTS: usize = 512;
/// Bits of a [`Source`] that say which slot of the chunk.
const SLOT_BITS: u32 = 13;

/// Where a node's value lies among the chunks' buffers.
#[derive(Clone, Copy, Debug, Default)]
struct Source(u32);

/// A hanging node of a chunk, by slots.
#[derive(Clone, Copy, Debug)]
struct HangingSlot {
    slot: u16,
    masters: [(u16, f32); 4],
}

/// The nodes of one chunk; its elements name them by slot.
#[derive(Clone, Debug, Default)]
pub struct Chunk {
    /// Unknowns, ascending; the hanging nodes' slots come after them.
    unknowns: Vec<u32>,
    hanging: Vec<HangingSlot>,
    /// Slots of each element's corners.
    corners: Vec<[u16; 8]>,
}

/// The chunks of a level and the way back from the nodes.
#[derive(Clone, Debug, Default)]
pub struct Assembly {
    chunks: Vec<Chunk>,
    /// Sources of node n are `sources[first[n]..first[n + 1]]`; a hanging node has none.
    first: Vec<u32>,
    sources: Vec<Source>,
    /// Slot of each node while a chunk is numbered, [`NONE`] between.
    slot_of: Vec<u32>,
}

/// What an element's corner holds, or adds up.
pub trait Entry: Copy + Default + AddAssign + Send + Sync {
    /// The value `weight` times.
    #[must_use]
    fn scaled(self, weight: f32) -> Self;
}

impl Entry for wide::f32x4 {
    fn scaled(self, weight: f32) -> Self {
        self * Self::splat(weight)
    }
}

impl Entry for wide::f64x4 {
    fn scaled(self, weight: f32) -> Self {
        self.mul(Self::splat(f64::from(weight)))
    }
}

impl Chunk {
    /// Length of a buffer for the chunk.
    #[must_use]
    pub fn len(&self) -> usize {
        self.unknowns.len() + self.hanging.len()
    }

    /// Whether the chunk has no nodes.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.unknowns.is_empty()
    }

    /// Slots of the corners of the chunk's n-th element.
    #[must_use]
    pub fn corners(&self, element: usize) -> &[u16; 8] {
        &self.corners[element]
    }

    /// Fills a buffer with the values of a nodal vector.
    pub fn load<E: Entry, V: Copy>(&self, vector: &[V], read: impl Fn(V) -> E, buffer: &mut [E]) {
        for (slot, node) in buffer.iter_mut().zip(&self.unknowns) {
            *slot = read(vector[*node as usize]);
        }
        for hanging in &self.hanging {
            let mut value = E::default();
            for (master, w) in hanging.masters {
                value += buffer[master as usize].scaled(w);
            }
            buffer[hanging.slot as usize] = value;
        }
    }

    /// Hands what the hanging nodes of a buffer hold to their masters, `share(weight)` times.
    pub fn hand_over<E: Entry>(&self, buffer: &mut [E], share: impl Fn(f32) -> f32) {
        for hanging in &self.hanging {
            let value = std::mem::take(&mut buffer[hanging.slot as usize]);
            for (master, w) in hanging.masters {
                buffer[master as usize] += value.scaled(share(w));
            }
        }
    }

    /// Numbers the nodes of `elements`.
    fn number(&mut self, level: &Level, elements: std::ops::Range<usize>, slot_of: &mut [u32]) {
        self.unknowns.clear();
        self.hanging.clear();
        let mut hanging = Vec::new();
        for node in elements.clone().flat_map(|e| level.elements[e].nodes) {
            match level.hanging_node(node) {
                None => self.unknowns.push(node),
                Some(node) => {
                    hanging.push(node);
                    self.unknowns.extend(node.masters.iter().filter(|m| m.1 != 0.0).map(|m| m.0));
                }
            }
        }
        self.unknowns.sort_unstable();
        self.unknowns.dedup();
        hanging.sort_unstable_by_key(|h| h.node);
        hanging.dedup_by_key(|h| h.node);
        let nodes = self.unknowns.iter().copied().chain(hanging.iter().map(|h| h.node));
        nodes.enumerate().for_each(|(slot, node)| slot_of[node as usize] = slot as u32);
        let slot = |node: u32| slot_of[node as usize] as u16;
        self.hanging.extend(hanging.iter().map(|h| HangingSlot {
            slot: slot(h.node),
            masters: h.masters.map(|(node, w)| if w == 0.0 { (0, 0.0) } else { (slot(node), w) }),
        }));
        self.corners.clear();
        self.corners.extend(elements.map(|e| level.elements[e].nodes.map(slot)));
    }
}

impl Assembly {
    /// Takes the connectivity of a level.
    pub fn set_topology(&mut self, level: &Level) {
        let (elements, nodes) = (level.elements.len(), level.nodes.len());
        self.slot_of.resize(nodes, NONE);
        self.chunks.resize_with(elements.div_ceil(CHUNK_ELEMENTS), Chunk::default);
        for (index, chunk) in self.chunks.iter_mut().enumerate() {
            let first = index * CHUNK_ELEMENTS;
            chunk.number(level, first..elements.min(first + CHUNK_ELEMENTS), &mut self.slot_of);
        }
        self.first.clear();
        self.first.resize(nodes + 1, 0);
        for node in self.chunks.iter().flat_map(|c| &c.unknowns) {
            self.first[*node as usize] += 1;
        }
        let mut end = 0;
        for first in &mut self.first {
            end += *first;
            *first = end;
        }
        // Filled from the back, the ends become the beginnings.
        self.sources.resize(end as usize, Source::default());
        for (index, chunk) in self.chunks.iter().enumerate().rev() {
            for (slot, &node) in chunk.unknowns.iter().enumerate().rev() {
                self.first[node as usize] -= 1;
                self.sources[self.first[node as usize] as usize] = Source((index as u32) << SLOT_BITS | slot as u32);
            }
        }
    }

    /// The chunks, in the order of the elements.
    #[must_use]
    pub fn chunks(&self) -> &[Chunk] {
        &self.chunks
    }

    /// Slots of the corners of an element in its chunk.
    #[must_use]
    pub fn corners(&self, element: usize) -> &[u16; 8] {
        self.chunks[element / CHUNK_ELEMENTS].corners(element % CHUNK_ELEMENTS)
    }

    /// Number of nodes, hanging ones included.
    #[must_use]
    pub fn node_count(&self) -> usize {
        self.first.len() - 1
    }

    /// Chunk and slot of each of a node's entries.
    #[inline(always)]
    pub fn entries(&self, node: usize) -> impl Iterator<Item = (usize, usize)> + '_ {
        let sources = &self.sources[self.first[node] as usize..self.first[node + 1] as usize];
        sources.iter().map(|s| ((s.0 >> SLOT_BITS) as usize, (s.0 & ((1 << SLOT_BITS) - 1)) as usize))
    }
}
