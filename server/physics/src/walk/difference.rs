//! Where two values of a type first differ.

use super::walker::walk;
use super::{Place, Visitor};
use serde::Serialize;
use std::fmt::Write as _;

struct Words(Vec<u64>);

impl Visitor for Words {
    const KEPT_BY_HASH: bool = false;

    fn word(&mut self, value: u64, _: usize) {
        self.0.push(value);
    }
}

struct Compared {
    with: Vec<u64>,
    at: usize,
    path: Vec<Place>,
    found: Option<String>,
}

impl Visitor for Compared {
    const KEPT_BY_HASH: bool = false;

    fn word(&mut self, value: u64, _: usize) {
        let other = self.with.get(self.at);
        self.at += 1;
        if self.found.is_none() && other != Some(&value) {
            self.found = Some(told(&self.path));
        }
    }

    fn enter(&mut self, place: Place) {
        self.path.push(place);
    }

    fn leave(&mut self) {
        self.path.pop();
    }
}

/// A path as people write it.
pub(super) fn told(path: &[Place]) -> String {
    path.iter().fold(String::new(), |mut told, place| {
        match place {
            Place::Field(name) if told.is_empty() => told.push_str(name),
            Place::Field(name) => write!(told, ".{name}").expect("a string grows"),
            Place::Element(index) => write!(told, "[{index}]").expect("a string grows"),
        }
        told
    })
}

/// Path of the first number in which the two differ.
#[must_use]
pub fn difference<T: Serialize>(a: &T, b: &T) -> Option<String> {
    let mut words = Words(Vec::new());
    walk(b, &mut words);
    let mut compared = Compared { with: words.0, at: 0, path: Vec::new(), found: None };
    walk(a, &mut compared);
    compared.found.or_else(|| (compared.at < compared.with.len()).then(|| "the end".into()))
}
