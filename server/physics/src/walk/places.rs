//! Where the numbers of plain data lie in its bytes.

use super::walker::walk;
use super::{Place, Visitor};
use serde::Serialize;
use std::ops::Range;

/// Numbers by the fields that they are in, whichever element.
#[derive(Default)]
struct Places {
    fields: Vec<&'static str>,
    at: usize,
    found: Vec<(String, Range<usize>)>,
}

impl Visitor for Places {
    const KEPT_BY_HASH: bool = false;

    fn word(&mut self, _: u64, bytes: usize) {
        self.found.push((self.fields.join("."), self.at..self.at + bytes));
        self.at += bytes;
    }

    fn enter(&mut self, place: Place) {
        self.fields.push(match place {
            Place::Field(name) => name,
            Place::Element(_) => "[]",
        });
    }

    fn leave(&mut self) {
        self.fields.pop();
    }
}

/// Each number's field and its bytes.
pub fn places(value: &impl Serialize) -> Vec<(String, Range<usize>)> {
    let mut places = Places::default();
    walk(value, &mut places);
    places.found
}
