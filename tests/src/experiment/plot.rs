//! Measured and computed force over depth.

use kerf_plot::{Axis, BLACK, BLUE, Chart, Curve, Figure, OCHRE};

use super::run::Run;
use super::{DEPTH_M, Row, measured};

/// Depth over which the computed force is averaged, m: the front goes on by voxels.
const WINDOW_M: f64 = 2.5e-4;
const MOST_N: f64 = 1.6;

/// `experiment`: the first row, the last, and what the corners span.
pub fn figure(rows: &[Row], corners: &[Run]) -> Figure {
    let band = Curve::area("E 5.4 to 15 kPa, Gc 158 to 170 J/m²", band(corners)).coloured(BLUE);
    let lines =
        [("the scene: nothing fitted", rows.first(), BLUE), ("initiation ratio fitted: 6.8", rows.last(), OCHRE)];
    let line =
        |(label, row, colour): (&str, Option<&Row>, _)| Some(Curve::line(label, smooth(&row?.run)).coloured(colour));
    let points = measured::points().into_iter().map(|(depth_m, force_n)| (1e3 * depth_m, force_n)).collect();
    let points = Curve::dots("measured: Okamura, Simone and O'Leary 2004", points).coloured(BLACK);
    let curves = std::iter::once(band).chain(lines.into_iter().filter_map(line)).chain([points]).collect();
    let x = Axis::linear("depth under the surface, mm").over(0.0..1e3 * DEPTH_M);
    let y = Axis::linear("force on the needle, N").over(0.0..MOST_N);
    let chart = Chart::new(x, y, curves);
    Figure::new("experiment", "An 18 gauge needle into bovine liver at 3 mm/s", chart)
}

/// Depth, mm, and mean force, N, by windows.
fn smooth(run: &Run) -> Vec<(f64, f64)> {
    let windows = (DEPTH_M / WINDOW_M).round() as u32;
    let window = |i: u32| {
        let from_m = f64::from(i) * WINDOW_M;
        (1e3 * (from_m + 0.5 * WINDOW_M), run.mean_force_n(from_m, from_m + WINDOW_M))
    };
    (0..windows).map(window).collect()
}

/// What lies between the least and the most of the runs at each depth.
fn band(corners: &[Run]) -> Vec<(f64, f64)> {
    let curves: Vec<_> = corners.iter().map(smooth).collect();
    let bound = |pick: fn(f64, f64) -> f64, from: f64| {
        let at = |i: usize| (curves[0][i].0, curves.iter().map(|curve| curve[i].1).fold(from, pick));
        (0..curves.first().map_or(0, Vec::len)).map(at).collect::<Vec<_>>()
    };
    let (least, most) = (bound(f64::min, f64::INFINITY), bound(f64::max, f64::NEG_INFINITY));
    least.into_iter().chain(most.into_iter().rev()).collect()
}
