//! Algebraic quality of a triangle (paper Eq. 10 to 15).

use crate::Vec3;

/// No adapted triangle is worse than this, unless it was so before it was adapted, and then not worse
/// than it was. The equilateral triangle has 1, an isosceles one of height a tenth of its base 4.4.
pub const WORST: f64 = 8.0;

/// `|H|_F^2 / (2 det H)` of the triangle with this [`normal`], `H` the map from the equilateral triangle of
/// unit side to it:
/// 1 for an equilateral triangle of any size, infinite for a degenerate one.
///
/// Eq. 14 has the norm `F_n`, not squared: that would measure a triangle in 1/m, so that the largest
/// counted as the best. Of the matrices of Eq. 11 to 13 remain the sides and the area:
/// `|H|_F^2 = 2/3 sum of sides^2`, `det H = 4 area / sqrt 3`.
pub fn measure([a, b, c]: [Vec3; 3], normal: &Vec3) -> f64 {
    const SCALE: f64 = 2.0 * 1.732_050_807_568_877_2;
    let sides2 = (b - a).norm_squared() + (c - b).norm_squared() + (a - c).norm_squared();
    sides2 / (SCALE * normal.norm())
}

/// Normal of a triangle, as long as twice its area.
pub fn normal([a, b, c]: [Vec3; 3]) -> Vec3 {
    (b - a).cross(&(c - a))
}

/// Whether a triangle has been turned over: `D_n <= 0` under Eq. 15.
///
/// Eq. 10 sets up the local frame by the triangle itself, in which `D_n` is never negative. The frame
/// here is that of the triangle before it was adapted, so that `D_n` is its area as seen from there: the
/// two [`normal`]s point apart, or one of them is not a number.
pub(crate) fn is_turned_over(before: &Vec3, after: &Vec3) -> bool {
    !matches!(before.dot(after).partial_cmp(&0.0), Some(std::cmp::Ordering::Greater))
}

/// The measure of `after`, if it may stand for `before`.
#[must_use]
pub(crate) fn acceptable(before: [Vec3; 3], after: [Vec3; 3]) -> Option<f64> {
    let [normal_before, normal_after] = [before, after].map(normal);
    if is_turned_over(&normal_before, &normal_after) {
        return None;
    }
    let quality = measure(after, &normal_after);
    // Hardly ever is the second asked.
    let stands = quality <= WORST || quality <= measure(before, &normal_before);
    stands.then_some(quality)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Vector2};

    fn triangle(points: [[f64; 3]; 3]) -> [Vec3; 3] {
        points.map(Vec3::from)
    }

    /// Eq. 10 to 14 as they stand, the norm squared.
    fn by_the_paper([a, b, c]: [Vec3; 3]) -> f64 {
        let x = (b - a).normalize();
        let z = x.cross(&(c - a)).normalize();
        let y = z.cross(&x);
        let local = |p: Vec3| Vector2::new((p - a).dot(&x), (p - a).dot(&y));
        let jacobian = Matrix2::from_columns(&[local(b), local(c)]);
        let ideal = Matrix2::new(1.0, 0.5, 0.0, 3.0_f64.sqrt() / 2.0);
        let h = jacobian * ideal.try_inverse().unwrap();
        h.norm_squared() / (2.0 * h.determinant())
    }

    #[test]
    fn the_measure_is_that_of_the_weighted_jacobian() {
        for points in [
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            [[0.1, 0.2, 0.3], [2.0, -1.0, 0.4], [0.5, 0.5, 3.0]],
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.1, 0.0]],
        ] {
            let triangle = triangle(points);
            let (ours, papers) = (measure(triangle, &normal(triangle)), by_the_paper(triangle));
            assert!((ours - papers).abs() < 1e-12 * papers, "{ours} {papers}");
            let smaller = triangle.map(|p| p * 1e-3);
            let smaller = measure(smaller, &normal(smaller));
            assert!((ours - smaller).abs() < 1e-9 * ours, "size does not matter");
        }
    }

    #[test]
    fn the_equilateral_triangle_is_the_best_and_a_line_is_refused() {
        let best = triangle([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.75_f64.sqrt(), 0.0]]);
        assert!((measure(best, &normal(best)) - 1.0).abs() < 1e-12);
        let line = triangle([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]);
        assert_eq!(acceptable(best, line), None);
        let [a, b, c] = best;
        assert!(
            is_turned_over(&normal(best), &normal([a, c, b])) && !is_turned_over(&normal(best), &normal([b, c, a]))
        );
        assert_eq!(acceptable(best, [a, c, b]), None);
    }
}
