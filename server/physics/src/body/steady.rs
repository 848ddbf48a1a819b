//! What keeps stressed elements steady whose cells are not full.
//!
//! A stressed element resists being turned by its stress alone, which the corotational matrix does not have. Where a
//! few voxels of a cell hang on, little else resists: each step would throw them past where they are to stand, for
//! ever. `S = sigma V / H^2 (I - 1 1^T / 8)` over the corners, with the stress sigma and the filled volume V, bounds what
//! is missing. It acts on the change of velocity alone: where elements come to rest, and what moves evenly, stays as it is, and
//! without stress there is none.

use super::Body;
use crate::fem::corotation::{LANES, set_lane};

/// Strain below which the matrix does without, and half of what any element is steadied for at most.
const LEAST_STRAIN: f64 = 0.02;
const MOST_STRAIN: f64 = 0.5;
/// Of a stiffness k that acts explicitly on what has the inertia m + dt^2 s, steps of dt stay bounded where k is below
/// 4 (m / dt^2 + s).
const NEEDED_SHARE: f64 = 0.25;
/// What is put in is this much more than is needed, so that it need not follow each step, and is changed where the
/// need has outgrown it or is down to a share of it.
const MARGIN: f64 = 1.5;
const LEAST_USED: f64 = 0.3;
/// No element gets more inertia than so many times its own: over steps that are long beside its own vibrations, which
/// the stiffness damps, it would only keep it going.
const MOST_INERTIA: f64 = 2.0;
/// A cell that is filled by this share is full.
const FULL: f64 = 1.0 - 1e-9;

impl Body {
    /// Brings the matrices of stressed elements to what keeps them steady now; returns whether any changed.
    pub(super) fn steady_elements(&mut self) -> bool {
        let mut changed = false;
        for element in 0..self.base().elements.len() {
            let (block, lane) = (element / LANES, element % LANES);
            let (edge_m, volume_m3) = (self.element_edge_m(element), self.filled_volume_m3(element));
            if volume_m3 > FULL * edge_m.powi(3) {
                continue;
            }
            let energy_j = self.states[block].elastic_j.as_array()[lane];
            let young_pa = self.young_modulus_pa[element];
            let strain = (2.0 * energy_j / (young_pa * volume_m3)).sqrt().min(MOST_STRAIN);
            let applied = self.blocks[block].steadying_n_per_m.as_array()[lane];
            let of_strain = young_pa * volume_m3 / (edge_m * edge_m);
            let needed = if strain > LEAST_STRAIN {
                let most = MOST_INERTIA * self.element_mass_kg(element) / (self.params.dt_s * self.params.dt_s);
                (NEEDED_SHARE * strain * of_strain).min(most / MARGIN)
            } else {
                0.0
            };
            if needed > applied || needed < LEAST_USED * applied {
                set_lane(&mut self.blocks[block].steadying_n_per_m, lane, MARGIN * needed);
                self.write_matrix(element);
                changed = true;
            }
        }
        changed
    }

    fn element_mass_kg(&self, element: usize) -> f64 {
        (0..8).flat_map(|a| (0..8).map(move |b| (a, b))).map(|(a, b)| self.mass_between_kg(element, a, b)).sum()
    }
}
