//! Profile of the surface beside an indentation: an open uniform B-spline (paper Fig. 8, Eq. 16 to 19).

use crate::body::Body;
use crate::grid::VoxelId;

/// The material's share of the reach is at most this many times what the elements need: a dent that wide
/// they show themselves.
const WIDEST: f64 = 2.0;
/// Least reach in voxels: with fewer vertices the end of the profile shows as a bend, of 5 degrees with 4,
/// of 3 with 6.
const LEAST_REACH_VOXELS: f64 = 6.0;
/// Bulge of an incompressible material over the depth of the indentation: the paper's `tau/E` with its
/// tau of 0.2 MPa and the 2 MPa of most of its scenes.
const INCOMPRESSIBLE_BULGE: f64 = 0.1;
/// Knots of a clamped cubic with six control points.
const KNOTS: [f64; 10] = [0.0, 0.0, 0.0, 0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0, 1.0, 1.0, 1.0];

/// How far and in what form a material follows an indentation.
///
/// The paper's `g_max = V/E` (Eq. 17) asks for a V in N/m, which it calls empirical. The force per
/// length that the edge exerts before the material gives, `initiation_ratio * Gc`, is such a number:
/// V/E is then the width of the dent of a line load, wider in softer and in tougher material. What the
/// elements cannot show is added, one of their edges: they follow an edge no narrower than that.
///
/// `gamma = tau/E` (Eq. 18) has no limit: in a liver of 10 kPa the bulge would be 20 times the
/// indentation. It stands for the volume that is kept, so it goes by Poisson's ratio here; it is a share
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
    pub fn at(body: &Body, voxel: VoxelId) -> Self {
        let material = body.material_of(voxel);
        let edge_m = body.element_edge_m(body.element_of(voxel));
        let least_m = edge_m.max(LEAST_REACH_VOXELS * body.grid.voxel_size_m());
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
        let abscissa = [0.0, 0.2 * cosine, 1.0 / 3.0, 5.0 / 6.0, 11.0 / 12.0, 1.0];
        let ordinate = [-1.0, 0.2 * sine - 1.0, self.bulge, 0.0, 0.0, 0.0];
        -spline(&ordinate, parameter_at(&abscissa, level)).0
    }
}

/// The parameter at which a rising spline has a value in 0..1: Newton's method, kept to an interval.
fn parameter_at(control: &[f64; 6], value: f64) -> f64 {
    let (mut low, mut high, mut t) = (0.0, 1.0, value);
    for _ in 0..20 {
        let (found, slope) = spline(control, t);
        let excess = found - value;
        if excess.abs() < 1e-9 {
            break;
        }
        if excess > 0.0 {
            high = t
        } else {
            low = t
        }
        let next = t - excess / slope;
        t = if next > low && next < high { next } else { 0.5 * (low + high) };
    }
    t
}

/// Value and derivative of the spline by de Boor's algorithm.
fn spline(control: &[f64; 6], t: f64) -> (f64, f64) {
    let span = if t < KNOTS[4] {
        3
    } else if t < KNOTS[5] {
        4
    } else {
        5
    };
    let mut d = [control[span - 3], control[span - 2], control[span - 1], control[span]];
    let mut slope = 0.0;
    for degree in 1..=3 {
        if degree == 3 {
            slope = 3.0 * (d[3] - d[2]) / (KNOTS[span + 1] - KNOTS[span]);
        }
        for j in (degree..=3).rev() {
            let (from, to) = (KNOTS[span - 3 + j], KNOTS[span + 1 + j - degree]);
            let share = (t - from) / (to - from);
            d[j] = d[j - 1] + share * (d[j] - d[j - 1]);
        }
    }
    (d[3], slope)
}

#[cfg(test)]
mod tests {
    use super::*;

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
            let (value, slope) = spline(&control, t);
            assert!((value - expected).abs() < 1e-12, "{t}: {value} {expected}");
            let difference = (spline(&control, t + 1e-6).0 - spline(&control, t - 1e-6).0) / 2e-6;
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
    fn a_deeper_indentation_is_steeper_and_an_incompressible_material_bulges_more() {
        let slope = |depth_m: f64| (1.0 - PROFILE.share(2e-5, depth_m)) * depth_m;
        // Deeper and, by its slope, steeper for its depth.
        assert!(slope(0.02) > 3.0 * slope(0.01));
        let flat = Profile { bulge: 0.0, ..PROFILE };
        assert!((0..100).all(|i| flat.share(2e-4 * f64::from(i), 0.01) >= 0.0));
    }
}
