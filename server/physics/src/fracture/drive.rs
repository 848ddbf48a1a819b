//! Tension ahead of a cut: pulled tissue pays part of what parts it, `q_c = Gc - G_el`.
//!
//! A front is looked at in stations an element apart, one a step in turn; between stations the energy release rate is
//! interpolated along the chain.

use super::release::{Tip, released_j_per_m};
use crate::Vec3;
use crate::body::Body;

/// A piece of a front that has begun to cut, reference configuration.
#[derive(Clone, Copy, Debug)]
pub(super) struct Piece {
    /// Which marker it belongs to.
    pub(super) marker: usize,
    /// Where the front stands, m.
    pub(super) position_m: Vec3,
    /// Unit vector into the material that holds.
    pub(super) ahead: Vec3,
    /// Along the front, as long as the piece, m.
    pub(super) along_m: Vec3,
}

/// What tension adds along one front, by marker.
#[derive(Clone, Debug, Default)]
pub(super) struct Tension {
    /// Energy release rate where there are stations, J/m^2; marker, value.
    stations: Vec<(usize, f64)>,
    next: usize,
    /// The front: scratch, kept between steps.
    pieces: Vec<Piece>,
}

impl Tension {
    /// Forgets what was found.
    pub(super) fn clear(&mut self) {
        self.stations.clear();
        self.next = 0;
    }

    /// Looks at the next station of a front that consists of `pieces`, by marker.
    pub(super) fn look(&mut self, body: &Body, pieces: impl Iterator<Item = Piece>) {
        self.pieces.clear();
        self.pieces.extend(pieces);
        let Some(first) = self.pieces.first() else { return self.clear() };
        let every = (body.lattice_edge_m() / first.along_m.norm()).ceil().max(1.0) as usize;
        let count = self.pieces.len().div_ceil(every);
        self.next = (self.next + 1) % count;
        // In the middle of its part of the front.
        let station = &self.pieces[(self.next * self.pieces.len() + self.pieces.len() / 2) / count];
        let value = energy_release_rate(body, station, &self.pieces);
        match self.stations.binary_search_by_key(&station.marker, |s| s.0) {
            Ok(known) => self.stations[known].1 = value,
            Err(place) => self.stations.insert(place, (station.marker, value)),
        }
        let pieces = &self.pieces;
        self.stations.retain(|s| pieces.binary_search_by_key(&s.0, |p| p.marker).is_ok());
    }

    /// Energy release rate at a marker, J/m^2; none where nothing pulls.
    pub(super) fn at(&self, marker: usize) -> f64 {
        let after = self.stations.partition_point(|s| s.0 < marker);
        let ends = [after.checked_sub(1).map(|i| self.stations[i]), self.stations.get(after).copied()];
        match ends {
            [Some((_, only)), None] | [None, Some((_, only))] => only,
            [Some((a, low)), Some((b, high))] => low + (high - low) * (marker - a) as f64 / (b - a) as f64,
            [None, None] => 0.0,
        }
    }
}

fn energy_release_rate(body: &Body, station: &Piece, pieces: &[Piece]) -> f64 {
    let along = station.along_m - station.ahead * station.along_m.dot(&station.ahead);
    let tip = Tip {
        position_m: station.position_m,
        ahead: station.ahead,
        along: along.normalize(),
        element_edge_m: body.lattice_edge_m(),
    };
    let length_m = |p: &Piece| p.along_m.norm() * tip.share_at(body, &p.position_m);
    (released_j_per_m(body, &tip) / pieces.iter().map(length_m).sum::<f64>()).max(0.0)
}
