//! The energy release rate of a crack front, from the elastic energy around it (domain form of the
//! J-integral: Shih, Moran and Nakamura 1986).
//!
//! A tube around the front, and whatever pushes on the material inside, goes on with it by `q = phi d` along the
//! cut. What flows into the tube beyond the work of that push is `G` per length of front:
//!
//! `G int phi ds = int_free W q . n dA - int (W I - (F - F_0)^T P) : grad q dV - int ((F - F_0)^T b) . q dV`
//!
//! phi is 1 near the front and falls to 0 across a ring of elements. F_0, the mean of F over the ring, is how the
//! push goes on in the scene: it works on `F_0 q`. On the faces of the cut q . n = 0.

use crate::Vec3;
use crate::body::Body;
use crate::fem::composite::shape_functions;
use serde::{Deserialize, Serialize};

/// Radius within which phi is 1, in element edges: nodes that share in a contact at the front stay within it. Half
/// adds 1.3 % to the mean force of slicing and lets the contact's own strain in; at twice phi falls from 1 to 0 at
/// once, and the first peak of a liver rises by 25 %.
pub(super) const INNER: f64 = 1.5;
/// Radius beyond which phi is 0, in element edges. Ours: as near as leaves two elements for the slope. Half, as a
/// step at the inner one, moves the mean force by 0.4 %; twice takes in what is held, and the first peak of a liver
/// rises by 12 %, the mean force by 0.1 %.
const OUTER: f64 = 3.0;
/// Half-width along the front of what one integral sees, in element edges. Ours: an integral of one element is noise.
/// Half or twice moves the mean force by 0.6 %.
const HALF_WIDTH: f64 = 2.0;
/// Distance of a cube's corners from its middle over its edge, and a little more.
const HALF_DIAGONAL: f64 = 0.867;

/// A place on a crack front, reference configuration.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Tip {
    /// Where it is, m.
    pub position_m: Vec3,
    /// Unit vector from the cut into the material that holds.
    pub ahead: Vec3,
    /// Unit vector along the front.
    pub along: Vec3,
    /// Edge of the elements there, m.
    pub element_edge_m: f64,
}

impl Tip {
    /// How much a place on the front counts: the integral of this over the front's length is what
    /// [`Released::j_per_m`] is per. It is phi as the elements see it, linear between their corners.
    #[must_use]
    pub fn weight_at(&self, body: &Body, position_m: &Vec3) -> f64 {
        let edge_m = body.lattice_edge_m();
        let at = (position_m - body.state.grid.origin_m()) / edge_m;
        let cell = at.map(f64::floor);
        let centre_m = body.state.grid.origin_m() + cell.add_scalar(0.5) * edge_m;
        let n = shape_functions((at - cell).into());
        self.phi_at_corners(&centre_m, edge_m).map_or(0.0, |phi| phi.iter().zip(n).map(|(phi, n)| phi * n).sum())
    }

    /// phi at the corners of a cube; `None` where it is 0 at all of them.
    fn phi_at_corners(&self, centre_m: &Vec3, edge_m: f64) -> Option<[f64; 8]> {
        let offset_m = centre_m - self.position_m;
        let along_m = offset_m.dot(&self.along);
        let across2_m2 = offset_m.norm_squared() - along_m * along_m;
        let corner_m = HALF_DIAGONAL * edge_m;
        let is_near = along_m.abs() < HALF_WIDTH * self.element_edge_m + corner_m
            && across2_m2 < (OUTER * self.element_edge_m + corner_m).powi(2);
        if !is_near {
            return None;
        }
        let half = 0.5 * edge_m;
        let phi = std::array::from_fn(|c| {
            let sign = |axis: usize| if c >> axis & 1 == 0 { -half } else { half };
            let (x, y, z) = (offset_m.x + sign(0), offset_m.y + sign(1), offset_m.z + sign(2));
            let along_m = x * self.along.x + y * self.along.y + z * self.along.z;
            let across_m = (x * x + y * y + z * z - along_m * along_m).max(0.0).sqrt();
            let across = (OUTER - across_m / self.element_edge_m) / (OUTER - INNER);
            across.clamp(0.0, 1.0) * (1.0 - along_m.abs() / (HALF_WIDTH * self.element_edge_m)).max(0.0)
        });
        (phi != [0.0; 8]).then_some(phi)
    }
}

/// What a front sets free as it goes on.
#[derive(Clone, Copy, Debug)]
pub struct Released {
    /// Energy beyond the work of what pushes on the front, per length that it advances, times the length of front that
    /// counts, J/m: over the integral of [`Tip::weight_at`] along the front, the energy release rate.
    pub j_per_m: f64,
    /// `F_0 d`: how far what pushes goes on in the scene, per length that the front advances.
    pub carried: Vec3,
}

/// What the front at `tip` sets free.
#[must_use]
pub fn released(body: &Body, tip: &Tip) -> Released {
    let mut sum = Sum::default();
    let reach = (OUTER * OUTER + HALF_WIDTH * HALF_WIDTH).sqrt();
    for_each_element(body, tip, reach, |element| sum.add(body, element, tip));
    let carried = if sum.weight > 0.0 { sum.direction / sum.weight } else { tip.ahead };
    Released { j_per_m: sum.released_j - sum.push_n.dot(&carried), carried }
}

/// Elastic energy of the elements beside `tip`, J: of a cell and its neighbours.
#[must_use]
pub(super) fn held_around_j(body: &Body, tip: &Tip) -> f64 {
    let mut held_j = 0.0;
    for_each_element(body, tip, 1.0, |element| held_j += body.elastic_energy_j(element));
    held_j
}

/// Calls `visit` with the elements of the cells that a box around `tip` meets, `reach` times their edge to each side.
fn for_each_element(body: &Body, tip: &Tip, reach: f64, mut visit: impl FnMut(usize)) {
    let reach_m = Vec3::repeat(reach * tip.element_edge_m);
    let lattice = |p: Vec3| ((p - body.state.grid.origin_m()) / body.lattice_edge_m()).map(|c| c.floor() as i32);
    let (low, high) = (lattice(tip.position_m - reach_m), lattice(tip.position_m + reach_m));
    for k in low.z..=high.z {
        for j in low.y..=high.y {
            for i in low.x..=high.x {
                body.base().elements_in([i, j, k]).for_each(|element| visit(element as usize));
            }
        }
    }
}

/// Sums over the elements of a tube.
#[derive(Default)]
struct Sum {
    released_j: f64,
    push_n: Vec3,
    direction: Vec3,
    weight: f64,
}

impl Sum {
    fn add(&mut self, body: &Body, element: usize, tip: &Tip) {
        let Some(phi) = tip.phi_at_corners(&body.rest_centre_m(element), body.element_edge_m(element)) else { return };
        let moved = body.move_material(element, &phi, &tip.ahead);
        let volume_m3 = body.filled_volume_m3(element);
        let weight = moved.slope.norm() * volume_m3;
        let flux_m2 = body.surface_integral_m2(element, &phi).dot(&tip.ahead);
        self.released_j += moved.released_j + flux_m2 * (moved.elastic_j / volume_m3);
        self.push_n += moved.push_n;
        self.direction += moved.direction * weight;
        self.weight += weight;
    }
}
