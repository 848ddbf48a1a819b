//! Plain data part by part: what two values differ in is told without having both.

use super::difference::told;
use super::walker::walk;
use super::{Place, Visitor};
use crate::hash::StateHasher;
use serde::Serialize;

struct Parts {
    depth: usize,
    path: Vec<Place>,
    found: Vec<(String, StateHasher)>,
}

impl Visitor for Parts {
    const KEPT_BY_HASH: bool = true;

    fn word(&mut self, value: u64, _: usize) {
        let path = told(&self.path[..self.path.len().min(self.depth)]);
        match self.found.last_mut() {
            Some((last, hasher)) if *last == path => hasher.word(value),
            _ => {
                let mut hasher = StateHasher::default();
                hasher.word(value);
                self.found.push((path, hasher));
            }
        }
    }

    fn enter(&mut self, place: Place) {
        self.path.push(place);
    }

    fn leave(&mut self) {
        self.path.pop();
    }
}

/// Paths of the parts of `value` down to a depth, in the order of the walk, each with a hash over what is in it. How many
/// elements a sequence has is a part by the path of the sequence.
#[must_use]
pub fn parts(value: &impl Serialize, depth: usize) -> Vec<(String, u64)> {
    let mut parts = Parts { depth, path: Vec::new(), found: Vec::new() };
    walk(value, &mut parts);
    parts.found.into_iter().map(|(path, hasher)| (path, hasher.finish())).collect()
}
