//! Profile of the surface beside an indentation: an open uniform B-spline (paper Fig. 8, Eq. 16 to 19).

use crate::grid::VoxelId;
use crate::likeness::Likeness;

/// The material's share of the reach is at most this many times what the elements need: a dent that wide
/// they show themselves.
const WIDEST: f64 = 2.0;
/// Least reach in voxels: with fewer vertices the end of the profile shows as a bend, of 5 degrees with 4,
/// of 3 with 6.
const LEAST_REACH_VOXELS: f64 = 6.0;
/// Bulge of an incompressible material over the depth of the indentation: the paper's `tau/E` with its
/// tau of 0.2 MPa and the 2 MPa of most of its scenes.
const INCOMPRESSIBLE_BULGE: f64 = 0.1;
/// Control points before the end at which the profile is back at the surface (Eq. 19).
const END_ABSCISSAS: [f64; 3] = [5.0 / 6.0, 11.0 / 12.0, 1.0];

/// How far and in what form a material follows an indentation.
///
/// The paper's `g_max = V/E` (Eq. 17) asks for a V in N/m, which it calls empirical. The force per
/// length that the edge exerts before the material gives, `initiation_ratio * Gc`, is such a number:
/// V/E is then the width of the dent of a line load, wider in softer and in tougher material. What the
/// elements cannot show is added, one of their edges: they follow an edge no narrower than that.
///
/// `gamma = tau/E` (Eq. 18) has no limit: in a liver of 10 kPa the bulge would be 20 times the
/// indentation. It stands for the volume that is kept, so it goes by Poisson's ratio here; it is a fraction
/// of the indentation's depth, as the other ordinates are. The slope is `s = a/g_max`, as Eq. 18 has it;
/// the text's ratio is the other way round. `theta = atan(s/a)` would be an angle of 1/m: it is
/// `atan(s)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Profile {
    /// Geodesic distance at which the deformed region ends, m.
    pub reach_m: f64,
    /// Ordinate of the third control point over the indentation's depth.
    pub bulge: f64,
}

impl Profile {
    /// Of the material and the element of a voxel.
    #[must_use]
    pub fn at(body: &Likeness, voxel: VoxelId) -> Self {
        let material = body.material_of(voxel);
        let edge_m = body.element_edge_m(body.element_of(voxel));
        let least_m = edge_m.max(LEAST_REACH_VOXELS * body.grid().voxel_size_m());
        let force_n_per_m = material.fracture_energy_j_per_m2.map(|gc| gc * material.initiation_ratio);
        // What cannot be cut is dented without limit.
        let dent_m = force_n_per_m.map_or(f64::INFINITY, |v| v / material.young_modulus_pa);
        Self {
            reach_m: least_m + dent_m.min(WIDEST * least_m),
            bulge: INCOMPRESSIBLE_BULGE * 2.0 * material.poisson_ratio,
        }
    }

    /// Displacement of the surface at a geodesic distance from an indentation of depth `depth_m`, over
    /// that depth: 1 at the indentation, negative where it bulges, 0 with slope and curvature 0 at the
    /// end of the region.
    #[must_use]
    pub fn share(&self, distance_m: f64, depth_m: f64) -> f64 {
        let level = distance_m / self.reach_m;
        if level >= 1.0 {
            return 0.0;
        }
        let slope = depth_m / self.reach_m;
        let cosine = 1.0 / (1.0 + slope * slope).sqrt();
        let sine = slope * cosine;
        let [far, farther, end] = END_ABSCISSAS;
        let abscissa = [0.0, 0.2 * cosine, 1.0 / 3.0, far, farther, end];
        let ordinate = [-1.0, 0.2 * sine - 1.0, self.bulge, 0.0, 0.0, 0.0];
        let (span, at) = place_of(&abscissa, level);
        -Cubic::of_span(&ordinate, span).at(at).0
    }

    /// Geodesic distance from which on an indentation of this depth moves nothing by `negligible_m`; not less than
    /// where the last span of the profile begins.
    #[must_use]
    pub fn end_m(&self, depth_m: f64, negligible_m: f64) -> f64 {
        // The last span: its abscissas do not depend on the depth, its ordinate is what the third control point
        // leaves there, bulge/6 at its beginning, times (1 - at)^3.
        let [far, farther, end] = END_ABSCISSAS;
        let abscissa = Cubic::of_span(&[0.0, 0.0, 1.0 / 3.0, far, farther, end], 2);
        let at = 1.0 - (6.0 * negligible_m / (self.bulge * depth_m)).cbrt();
        self.reach_m * abscissa.at(at.max(0.0)).0
    }
}

/// A span of the spline as a polynomial in 0..=1, from the constant up.
struct Cubic([f64; 4]);

impl Cubic {
    /// One of the three spans of a clamped uniform cubic spline with six control points, by its Bezier points.
    fn of_span([c0, c1, c2, c3, c4, c5]: &[f64; 6], span: usize) -> Self {
        let [before, behind] = [0.5 * (c1 + c2), 0.5 * (c3 + c4)];
        let [low, high] = [(2.0 * c2 + c3) / 3.0, (c2 + 2.0 * c3) / 3.0];
        let [first, second] = [0.5 * (before + low), 0.5 * (high + behind)];
        let [a, b, c, d] = match span {
            0 => [*c0, *c1, before, first],
            1 => [first, low, high, second],
            _ => [second, behind, *c4, *c5],
        };
        Self([a, 3.0 * (b - a), 3.0 * (a - 2.0 * b + c), d - a + 3.0 * (b - c)])
    }

    /// Value and derivative.
    fn at(&self, t: f64) -> (f64, f64) {
        let [a, b, c, d] = self.0;
        (a + t * (b + t * (c + t * d)), b + t * (2.0 * c + t * 3.0 * d))
    }
}

/// The span in which a rising spline has a value in 0..1, and where in it: Newton's method, kept to an interval.
fn place_of(control: &[f64; 6], value: f64) -> (usize, f64) {
    let ends = [1, 2].map(|span| Cubic::of_span(control, span).0[0]);
    let span = ends.iter().filter(|end| value >= **end).count();
    let cubic = Cubic::of_span(control, span);
    let (mut low, mut high, mut t) = (0.0, 1.0, 0.5);
    for _ in 0..20 {
        let (found, slope) = cubic.at(t);
        let excess = found - value;
        if excess.abs() < 1e-12 {
            break;
        }
        if excess > 0.0 {
            high = t
        } else {
            low = t
        }
        let next = t - excess / slope;
        t = if next >= low && next <= high { next } else { 0.5 * (low + high) };
    }
    (span, t)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Knots of a clamped cubic with six control points.
    const KNOTS: [f64; 10] = [0.0, 0.0, 0.0, 0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0, 1.0, 1.0, 1.0];
    const PROFILE: Profile = Profile { reach_m: 0.02, bulge: 0.1 };

    /// The B-spline by its definition, the recursion of Cox and de Boor.
    fn basis(i: usize, degree: usize, t: f64) -> f64 {
        if degree == 0 {
            return f64::from(u8::from(KNOTS[i] <= t && t < KNOTS[i + 1]));
        }
        let ratio = |a: f64, b: f64| if b == 0.0 { 0.0 } else { a / b };
        ratio(t - KNOTS[i], KNOTS[i + degree] - KNOTS[i]) * basis(i, degree - 1, t)
            + ratio(KNOTS[i + degree + 1] - t, KNOTS[i + degree + 1] - KNOTS[i + 1]) * basis(i + 1, degree - 1, t)
    }

    #[test]
    fn the_spline_is_the_one_of_its_basis_and_its_slope_its_derivative() {
        let control = [-1.0, 0.3, 0.7, -0.2, 0.4, 0.9];
        for step in 0..100 {
            let t = 0.00499 + 0.0099 * f64::from(step);
            let expected: f64 = (0..6).map(|i| control[i] * basis(i, 3, t)).sum();
            let spline = |t: f64| {
                let span = (3.0 * t).floor();
                let (value, slope) = Cubic::of_span(&control, span as usize).at(3.0 * t - span);
                (value, 3.0 * slope)
            };
            let (value, slope) = spline(t);
            assert!((value - expected).abs() < 1e-12, "{t}: {value} {expected}");
            let difference = (spline(t + 1e-6).0 - spline(t - 1e-6).0) / 2e-6;
            assert!((slope - difference).abs() < 1e-4, "{t}: {slope} {difference}");
        }
    }

    #[test]
    fn the_profile_starts_at_the_indentation_bulges_and_ends_smoothly() {
        for depth_m in [1e-6, 1e-3, 0.01, 0.05] {
            let at = |level: f64| PROFILE.share(level * PROFILE.reach_m, depth_m);
            assert!((at(0.0) - 1.0).abs() < 1e-6);
            let lowest = (0..1000).map(|i| at(f64::from(i) * 1e-3)).fold(f64::INFINITY, f64::min);
            assert!((-0.1..-0.01).contains(&lowest), "depth {depth_m}: bulge {lowest}");
            // Third order at the end: twice as near, eight times as small.
            let (far, near) = (at(0.98), at(0.99));
            assert!((far / near - 8.0).abs() < 0.5 && far.abs() < 1e-4, "{far} {near}");
            assert_eq!(at(1.0), 0.0);
            assert!((0..999).all(|i| (at(f64::from(i) * 1e-3) - at(f64::from(i + 1) * 1e-3)).abs() < 0.05));
        }
    }

    #[test]
    fn nothing_moves_beyond_the_end() {
        for depth_m in [1e-7, 1e-4, 1e-3, 0.02] {
            let end_m = PROFILE.end_m(depth_m, 1e-6);
            assert!(end_m <= PROFILE.reach_m);
            let moved = |distance_m: f64| (depth_m * PROFILE.share(distance_m, depth_m)).abs();
            assert!((0..100).all(|i| moved(end_m * (1.0 + 0.005 * f64::from(i))) < 1.000_001e-6));
            assert!(depth_m < 1e-3 || moved(0.999 * end_m) > 1e-6, "and not long before it");
        }
    }

    #[test]
    fn a_deeper_indentation_is_steeper_and_an_incompressible_material_bulges_more() {
        let slope = |depth_m: f64| (1.0 - PROFILE.share(2e-5, depth_m)) * depth_m;
        // Deeper and, by its slope, steeper for its depth.
        assert!(slope(0.02) > 3.0 * slope(0.01));
        let flat = Profile { bulge: 0.0, ..PROFILE };
        assert!((0..100).all(|i| flat.share(2e-4 * f64::from(i), 0.01) >= 0.0));
    }
}
