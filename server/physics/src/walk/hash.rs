//! A hash over plain data.

use super::Visitor;
use super::walker::walk;
use crate::hash::StateHasher;
use serde::Serialize;

/// Hashers that take the words in turn: a multiplication need not wait for the one before.
const LANES: usize = 4;

struct Folded {
    /// The next word's first: indexed by the count, they would have to lie in memory.
    lanes: [StateHasher; LANES],
    count: usize,
}

impl Visitor for Folded {
    const KEPT_BY_HASH: bool = true;

    #[inline]
    fn word(&mut self, value: u64, _: usize) {
        let [mut next, a, b, c] = self.lanes;
        next.word(value);
        self.lanes = [a, b, c, next];
        self.count += 1;
    }
}

/// Hash over every number in `value`, by its bits.
#[must_use]
pub fn hash(value: &impl Serialize) -> u64 {
    let mut folded = Folded { lanes: [StateHasher::default(); LANES], count: 0 };
    walk(value, &mut folded);
    // As they would stand had each kept its place.
    folded.lanes.rotate_right(folded.count % LANES);
    let mut hasher = StateHasher::default();
    hasher.word(folded.count as u64);
    folded.lanes.iter().for_each(|lane| hasher.word(lane.finish()));
    hasher.finish()
}
