//! What a composite element lacks of the compliance under an edge that is thinner than it.

use std::f64::consts::PI;

/// Least compliance of the contact, times E: keeps the spring finite under an edge of more than 0.7 H, where the
/// formula ends. Ours. Sharper edges do not change by a bit with half or twice of it.
const LEAST_COMPLIANCE: f64 = 0.03;
/// The elements' surplus for an edge of half-width H at a node, over `(1 - nu^2)`, by powers of nu; fitted, with the
/// four that follow, to solutions with resolved edges (`blade_stiffness::`). Twice of it makes the edge come in
/// later: the area of a cut falls by 2 %, the force differs by 5 % of its peak, rms.
const AT_NODE: [f64; 3] = [0.909, 0.27, 0.21];
/// What full FEM (k = 1) gives beyond that, by powers of nu: its volume is sampled at one point. Fitted as above.
const AT_NODE_OF_VOXELS: [f64; 3] = [0.0, 0.25, 0.38];
/// Fraction of the surplus that is gone in the middle between two nodes. Fitted as above; 1 at most. Half moves the
/// first peak by 1.4 %, the mean force by 0.1 %.
const BETWEEN_NODES: f64 = 0.782;
/// Fraction that it gains where the surface lies in the middle between nodes. Fitted as above. Half or twice moves
/// the first peak by 1.3 %, the mean force by 0.4 %.
const WITHIN_CELL: f64 = 0.04;
/// What the contact gives less at an end of the edge, over `(1 - nu^2)`, falling to nothing at H from it: the
/// elements do not see how sharp an end is. Fitted to edges of 2 to 16 H over a block. Half or twice moves the first
/// peak by up to 1.7 %, the mean force by 0.7 %.
const AT_END: f64 = 0.25;

/// Where an edge stands in an element of `2^level` voxels a side, lengths over the element's edge.
#[derive(Clone, Copy, Debug)]
pub(super) struct EdgeInElement {
    /// Half-width of the edge.
    pub(super) half_width: f64,
    /// Distance from the nearer end of the edge.
    pub(super) from_end: f64,
    /// Four times the variance of the nodes' places about the edge, under the weights that the load is
    /// shared with: 0 at a node, 1 in the middle between two. In the surface, across the edge.
    pub(super) across: f64,
    /// The same into the surface.
    pub(super) inward: f64,
}

/// Compliance of the contact per length of edge, times E: in series with elements of edge H, it gives
/// the indentation of the continuum by a rigid flat edge of half-width a,
///
/// `(1 - nu^2) [2 / pi ln(H / a) - g (1 - 0.782 s) - e]`, `g = g(nu, k) (1 + 0.04 s')`,
///
/// s and s' the spreads of the load across the edge and into the surface, e what the ends add.
/// The logarithm is the half plane's (Johnson, Contact Mechanics, 1985, section 2.7) between H and a. A load
/// that is shared between nodes with weights w meets the compliance `w^T G w` of the elements, which
/// within a cell is linear in the variance of w: hence s. The numbers are the elements' own, in plane
/// strain, against a layer of the continuum on a rigid base; g is good to 1 %, 3 % in cells that are partly
/// filled: `cargo test --release -p kerf-physics -- --ignored --nocapture blade_stiffness_sweep::` measures them.
pub(super) fn line_compliance(poisson_ratio: f64, level: u8, edge: &EdgeInElement) -> f64 {
    let nu = poisson_ratio;
    let polynomial = |c: [f64; 3]| c[0] + nu * (c[1] + nu * c[2]);
    let voxels = 1.0 / f64::from(1u32 << (4 * u32::from(level)));
    let surplus = polynomial(AT_NODE) + voxels * polynomial(AT_NODE_OF_VOXELS);
    let placed = surplus * (1.0 + WITHIN_CELL * edge.inward) * (1.0 - BETWEEN_NODES * edge.across);
    let end = AT_END * (1.0 - edge.from_end).max(0.0);
    ((1.0 - nu * nu) * (2.0 / PI * -ln(edge.half_width) - placed - end)).max(LEAST_COMPLIANCE)
}

/// Natural logarithm through the vector library's own polynomial: the same bits on every machine.
fn ln(x: f64) -> f64 {
    wide::f64x4::splat(x).ln().to_array()[0]
}
