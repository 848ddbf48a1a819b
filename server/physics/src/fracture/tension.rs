//! Tension ahead of a cut: pulled tissue pays part of what parts it, `q_c = Gc - G_el`.
//!
//! A front is looked at in stations an element apart, one a step in turn; between stations the energy release rate is
//! interpolated along the chain.

use super::release::{Tip, released_j_per_m};
use crate::Vec3;
use crate::body::Body;

/// A share of a front that has begun to cut, reference configuration.
#[derive(Clone, Copy, Debug)]
pub(super) struct Share {
    /// Which marker it belongs to.
    pub(super) marker: usize,
    /// Where the front stands, m.
    pub(super) position_m: Vec3,
    /// Unit vector into the material that holds.
    pub(super) ahead: Vec3,
    /// Along the front, as long as the share, m.
    pub(super) along_m: Vec3,
}

/// What tension adds along one front, by marker.
#[derive(Clone, Debug, Default)]
pub(super) struct Tension {
    /// Energy release rate where there are stations, J/m^2; marker, value.
    stations: Vec<(usize, f64)>,
    next: usize,
}

impl Tension {
    /// Forgets what was found.
    pub(super) fn clear(&mut self) {
        self.stations.clear();
        self.next = 0;
    }

    /// Looks at the next station of a front that consists of `shares`.
    pub(super) fn look(&mut self, body: &Body, shares: &[Share]) {
        let Some(first) = shares.first() else { return self.clear() };
        let every = (body.lattice_edge_m() / first.along_m.norm()).ceil().max(1.0) as usize;
        let count = shares.len().div_ceil(every);
        self.next = (self.next + 1) % count;
        // In the middle of its share of the front.
        let at = (self.next * shares.len() + shares.len() / 2) / count;
        let share = &shares[at];
        let value = energy_release_rate(body, share, shares);
        match self.stations.binary_search_by_key(&share.marker, |s| s.0) {
            Ok(known) => self.stations[known].1 = value,
            Err(place) => self.stations.insert(place, (share.marker, value)),
        }
        let alive = |marker: usize| shares.binary_search_by_key(&marker, |s| s.marker).is_ok();
        self.stations.retain(|s| alive(s.0));
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

fn energy_release_rate(body: &Body, share: &Share, shares: &[Share]) -> f64 {
    let along = share.along_m - share.ahead * share.along_m.dot(&share.ahead);
    let tip = Tip {
        position_m: share.position_m,
        ahead: share.ahead,
        along: along.normalize(),
        element_edge_m: body.lattice_edge_m(),
    };
    let length_m: f64 =
        shares.iter().map(|s| s.along_m.norm() * tip.share_along(&(s.position_m - share.position_m))).sum();
    (released_j_per_m(body, &tip) / length_m).max(0.0)
}
