//! Which nodes the elements of a level read and add to, chunk by chunk.
//!
//! The elements of a chunk work on a buffer of their own, small enough to stay close to a core; a node
//! then sums its entries of the few chunks around it in a fixed order. So the bits do not depend on the
//! number of threads, and nothing has to be coloured.
//!
//! Hanging nodes are no unknowns: within a chunk they take their values from their masters and hand
//! theirs what acts on them, so that the level's system is `Z^T A Z` with Z the interpolation of all
//! nodes from the others.

use super::lists::Lists;
use crate::grid::levels::{Level, NONE};
use crate::grow::grow;
use crate::workers::Slices;
use std::ops::{AddAssign, Mul};

/// Elements per block of the operator: as many as an `f32` vector has lanes.
pub const LANES: usize = 8;
/// Elements per chunk.
pub const CHUNK_ELEMENTS: usize = 128;

/// A hanging node of a chunk, by slots.
#[derive(Clone, Copy, Debug, PartialEq)]
struct HangingSlot {
    slot: u16,
    masters: [(u16, f32); 4],
}

/// The nodes of one chunk; its elements name them by slot.
#[derive(Clone, Debug, Default, PartialEq)]
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
    /// Where the buffer of each chunk begins among all of them, and where the last one ends.
    offsets: Vec<u32>,
    /// Entries of each node among all buffers; a hanging node has none.
    entries: Lists<u32>,
    /// Slots of the nodes of the chunk that was numbered last.
    slot_of: Vec<u32>,
}

/// Equal where they number the same nodes alike.
impl PartialEq for Assembly {
    fn eq(&self, other: &Self) -> bool {
        (&self.chunks, &self.entries) == (&other.chunks, &other.entries)
    }
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

    /// The unknowns, by slot.
    #[must_use]
    pub fn unknowns(&self) -> &[u32] {
        &self.unknowns
    }

    /// Whether some of its nodes hang.
    #[must_use]
    pub fn has_hanging(&self) -> bool {
        !self.hanging.is_empty()
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
    /// Takes the connectivity of a level of which `changed` elements, ascending, are new or have other nodes
    /// than before; `None`: all. Returns the chunks whose numbering changed, ascending.
    pub fn set_topology(&mut self, level: &Level, changed: Option<&[u32]>) -> Vec<usize> {
        let (elements, nodes) = (level.elements.len(), level.nodes.len());
        grow(&mut self.slot_of, nodes, NONE);
        self.chunks.resize_with(elements.div_ceil(CHUNK_ELEMENTS), Chunk::default);
        let mut renumbered: Vec<usize> = match changed {
            // What hangs depends on elements of other chunks too.
            Some(changed) if !level.is_graded() => changed.iter().map(|e| *e as usize / CHUNK_ELEMENTS).collect(),
            _ => (0..self.chunks.len()).collect(),
        };
        renumbered.dedup();
        for &index in &renumbered {
            let first = index * CHUNK_ELEMENTS;
            let range = first..elements.min(first + CHUNK_ELEMENTS);
            self.chunks[index].number(level, range, &mut self.slot_of);
        }
        self.offsets.clear();
        self.offsets.push(0);
        for chunk in &self.chunks {
            self.offsets.push(self.offsets[self.offsets.len() - 1] + chunk.len() as u32);
        }
        let entries = self
            .chunks
            .iter()
            .zip(&self.offsets)
            .flat_map(|(chunk, &offset)| chunk.unknowns.iter().zip(offset..).map(|(node, entry)| (*node, entry)));
        self.entries.fill(nodes, entries);
        renumbered
    }

    /// The chunks, in the order of the elements.
    #[must_use]
    pub fn chunks(&self) -> &[Chunk] {
        &self.chunks
    }

    /// Length of the buffers of all chunks.
    #[must_use]
    pub fn buffer_len(&self) -> usize {
        self.offsets[self.chunks.len()] as usize
    }

    /// Where the buffer of a chunk lies among all of them.
    #[must_use]
    pub fn buffer_of(&self, chunk: usize) -> std::ops::Range<usize> {
        self.offsets[chunk] as usize..self.offsets[chunk + 1] as usize
    }

    /// The buffers of all chunks, one after the other, to be shared out chunk by chunk.
    pub fn by_chunk<'a, E>(&'a self, buffers: &'a mut [E]) -> Buffers<'a, E> {
        Buffers { entries: buffers, offsets: &self.offsets }
    }

    /// A node's entries among the buffers of all chunks.
    #[inline(always)]
    #[must_use]
    pub fn entries(&self, node: usize) -> &[u32] {
        self.entries.list(node)
    }
}

/// Buffers of chunks, one after the other.
pub struct Buffers<'a, E> {
    /// The buffers' entries.
    pub entries: &'a mut [E],
    offsets: &'a [u32],
}

impl<E: Send> Slices for Buffers<'_, E> {
    fn count(&self) -> usize {
        self.offsets.len() - 1
    }
    fn cut(self, middle: usize) -> (Self, Self) {
        let at = (self.offsets[middle] - self.offsets[0]) as usize;
        let (low, high) = self.entries.split_at_mut(at);
        (
            Self { entries: low, offsets: &self.offsets[..=middle] },
            Self { entries: high, offsets: &self.offsets[middle..] },
        )
    }
}
