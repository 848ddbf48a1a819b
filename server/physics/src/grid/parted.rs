//! Where the links that are parted stand in the order in which they parted.

use std::collections::BTreeMap;

/// Places of the parted links by their keys. Nearly all that is asked is whether a link is intact: one bit says it.
#[derive(Clone, Debug, Default)]
pub(super) struct PartedPlaces {
    is_parted: Vec<u64>,
    places: BTreeMap<u32, u32>,
}

impl PartedPlaces {
    /// No link is parted of those whose keys are below `bound`.
    pub(super) fn none(bound: usize) -> Self {
        Self { is_parted: vec![0; bound.div_ceil(u64::BITS as usize)], places: BTreeMap::new() }
    }

    pub(super) fn contains(&self, key: usize) -> bool {
        self.is_parted[key / 64] >> (key % 64) & 1 == 1
    }

    /// The place of a link, if it is parted.
    pub(super) fn place(&self, key: usize) -> Option<usize> {
        self.contains(key).then(|| self.places[&(key as u32)] as usize)
    }

    /// Gives a link a place.
    pub(super) fn insert(&mut self, key: usize, place: usize) {
        self.is_parted[key / 64] |= 1 << (key % 64);
        self.places.insert(key as u32, place as u32);
    }

    /// Takes a parted link out; returns its place.
    pub(super) fn remove(&mut self, key: usize) -> usize {
        self.is_parted[key / 64] &= !(1 << (key % 64));
        self.places.remove(&(key as u32)).expect("the link is parted") as usize
    }
}
