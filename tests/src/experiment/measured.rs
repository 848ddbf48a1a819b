//! A needle in bovine liver, as published.

/// Depth at which the needle meets the surface, m.
const CONTACT_M: f64 = 0.008;
/// Depth of the capsule's puncture under the surface, m, and the force at it, N.
pub const PUNCTURE: (f64, f64) = (0.0191 - CONTACT_M, 1.42);
/// Uncertainty of a reading, m and N.
pub const READING: (f64, f64) = (2e-4, 0.02);

/// Depth of the needle, mm, and force on it, N, on its way in: A. M. Okamura, C. Simone and M. D. O'Leary, "Force
/// modeling for needle insertion into soft tissue", IEEE Trans. Biomed. Eng. 51 (10), 2004, 1707-1716, the figure of
/// force over needle depth in bovine liver, read by eye off a copy. An 18 gauge (1.27 mm) bevelled needle at 3 mm/s, as
/// stated with the copy. The force rises from 8 mm on, the capsule gives at 19.1 mm.
const READINGS: [(f64, f64); 26] = [
    (8.0, 0.0),
    (10.0, 0.04),
    (11.5, 0.11),
    (12.5, 0.17),
    (13.2, 0.22),
    (13.9, 0.28),
    (14.5, 0.36),
    (15.1, 0.42),
    (15.7, 0.49),
    (16.4, 0.60),
    (16.8, 0.71),
    (17.2, 0.82),
    (17.6, 0.90),
    (18.1, 1.06),
    (18.5, 1.21),
    (19.1, 1.42),
    (19.3, 0.15),
    (19.9, 0.40),
    (20.5, 0.25),
    (21.2, 0.30),
    (22.0, 0.34),
    (23.0, 0.38),
    (24.2, 0.46),
    (24.9, 0.55),
    (25.3, 0.47),
    (26.0, 0.50),
];

/// Depth under the surface, m, and force, N.
#[must_use]
pub fn points() -> Vec<(f64, f64)> {
    READINGS.iter().map(|(depth_mm, force_n)| (depth_mm * 1e-3 - CONTACT_M, *force_n)).collect()
}

/// Force at a depth under the surface before the capsule gives, N.
#[must_use]
pub fn loading_n(depth_m: f64) -> f64 {
    at(&points(), depth_m, |point| point)
}

/// Depth under the surface at which the force is first this one, m.
#[must_use]
pub fn loading_depth_m(force_n: f64) -> f64 {
    at(&points(), force_n, |(depth_m, force_n)| (force_n, depth_m))
}

/// Linear between the points that `axes` makes of them, up to the puncture.
fn at(points: &[(f64, f64)], x: f64, axes: impl Fn((f64, f64)) -> (f64, f64)) -> f64 {
    let loading = points.iter().take_while(|(depth_m, _)| *depth_m < PUNCTURE.0 + READING.0);
    let loading: Vec<_> = loading.map(|point| axes(*point)).filter(|point| point.0 >= 0.0).collect();
    let after = loading.partition_point(|point| point.0 < x).clamp(1, loading.len() - 1);
    let [(x0, y0), (x1, y1)] = [loading[after - 1], loading[after]];
    y0 + (y1 - y0) * (x - x0) / (x1 - x0)
}
