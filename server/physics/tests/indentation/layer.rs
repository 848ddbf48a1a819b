//! The fine reference in plane strain: a rigid flat edge on an elastic layer bonded to a rigid base.

use std::f64::consts::PI;

/// Indentation of the layer by a rigid frictionless edge of half-width a, per load per length of edge,
/// times E: `2 (1 - nu^2) / pi (ln(2 D / a) + d0)`, exact but for a share `(a / D)^2`.
///
/// A line load P moves the layer's surface by `2 (1 - nu^2) P / (pi E) int_0^inf L(w) cos(w x / D) / w dw`,
/// `L = (2 kappa sinh 2w - 4w) / (2 kappa cosh 2w + 4 w^2 + 1 + kappa^2)`, `kappa = 3 - 4 nu` (Vorovich,
/// Aleksandrov and Babeshko 1974), which is `-ln(x / D) + d0` near the load; the capacity of a strip of
/// half-width a is `a / 2`.
pub fn compliance(poisson_ratio: f64, depth_over_half_width: f64) -> f64 {
    let kappa = 3.0 - 4.0 * poisson_ratio;
    // d0 = int_0^inf (L - 1 + exp(-w)) / w dw, by Simpson's rule; beyond w = 40 the integrand is 1e-17.
    let integrand = |w: f64| {
        let (sinh, cosh) = ((2.0 * w).sinh(), (2.0 * w).cosh());
        let l = (2.0 * kappa * sinh - 4.0 * w) / (2.0 * kappa * cosh + 4.0 * w * w + 1.0 + kappa * kappa);
        (l - 1.0 + (-w).exp()) / w
    };
    let (from, to, panels) = (1e-6, 40.0, 8000u32);
    let step = (to - from) / f64::from(panels);
    let sum: f64 = (0..=panels)
        .map(|i| {
            let weight = if i == 0 || i == panels { 1.0 } else { 2.0 + 2.0 * f64::from(i % 2) };
            weight * integrand(from + step * f64::from(i))
        })
        .sum();
    2.0 * (1.0 - poisson_ratio * poisson_ratio) / PI * ((2.0 * depth_over_half_width).ln() + sum * step / 3.0)
}
