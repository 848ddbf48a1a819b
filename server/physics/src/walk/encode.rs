//! Plain data as bytes: every number at its own width, least byte first; a sequence after its length.

use super::Visitor;
use super::walker::walk;
use crate::hash::StateHasher;
use serde::Serialize;

struct Bytes<'a>(&'a mut Vec<u8>);

impl Visitor for Bytes<'_> {
    const KEPT_BY_HASH: bool = false;

    #[inline]
    fn word(&mut self, value: u64, bytes: usize) {
        self.0.extend_from_slice(&value.to_le_bytes()[..bytes]);
    }
}

/// Appends `value`.
pub fn encode(value: &impl Serialize, bytes: &mut Vec<u8>) {
    walk(value, &mut Bytes(bytes));
}

/// Another one for any two files of a length that differ within one word, and for nearly any others.
#[must_use]
pub fn checksum(bytes: &[u8]) -> u64 {
    let mut hasher = StateHasher::default();
    let (words, rest) = bytes.as_chunks::<8>();
    words.iter().for_each(|word| hasher.word(u64::from_le_bytes(*word)));
    rest.iter().for_each(|byte| hasher.word(u64::from(*byte)));
    hasher.word(bytes.len() as u64);
    hasher.finish()
}
