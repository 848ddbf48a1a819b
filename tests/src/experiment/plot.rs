//! Measured and computed force over depth.

use std::path::Path;

use anyhow::{Context, Result};
use kerf_server::plot_font::{FONT, register_plot_font};
use plotters::coord::Shift;
use plotters::prelude::*;

use super::run::Run;
use super::{DEPTH_M, Row, measured};

const SIZE_PX: (u32, u32) = (1000, 600);
const GREY: RGBColor = RGBColor(110, 110, 110);
const BLUE: RGBColor = RGBColor(31, 88, 140);
const OCHRE: RGBColor = RGBColor(176, 110, 20);
/// Depth over which the computed force is averaged, m: the front goes on by voxels.
const WINDOW_M: f64 = 2.5e-4;
const MOST_N: f64 = 1.6;

/// Draws `experiment.svg` and `.png`: the first row, the last, and what the corners span.
pub fn draw(rows: &[Row], corners: &[Run], folder: &Path) -> Result<()> {
    register_plot_font();
    let path = |extension: &str| folder.join(format!("experiment.{extension}"));
    let (svg, png) = (path("svg"), path("png"));
    let on_svg = figure(rows, corners, &SVGBackend::new(&svg, SIZE_PX).into_drawing_area());
    on_svg.with_context(|| svg.display().to_string())?;
    figure(rows, corners, &BitMapBackend::new(&png, SIZE_PX).into_drawing_area())
        .with_context(|| png.display().to_string())
}

fn figure<B: DrawingBackend>(rows: &[Row], corners: &[Run], area: &DrawingArea<B, Shift>) -> Result<()>
where
    B::ErrorType: 'static,
{
    area.fill(&WHITE)?;
    let area = area.margin(8, 0, 0, 0).titled("An 18 gauge needle into bovine liver at 3 mm/s", (FONT, 20))?;
    let mut chart = ChartBuilder::on(&area)
        .margin(10)
        .margin_right(24)
        .x_label_area_size(52)
        .y_label_area_size(68)
        .build_cartesian_2d(0.0..1e3 * DEPTH_M, 0.0..MOST_N)?;
    chart
        .configure_mesh()
        .x_desc("depth under the surface, mm")
        .y_desc("force on the needle, N")
        .label_style((FONT, 14))
        .axis_desc_style((FONT, 15))
        .bold_line_style(GREY.mix(0.3))
        .light_line_style(GREY.mix(0.1))
        .draw()?;
    chart
        .draw_series([Polygon::new(band(corners), BLUE.mix(0.18))])?
        .label("E 5.4 to 15 kPa, Gc 158 to 170 J/m²")
        .legend(|(x, y)| Rectangle::new([(x, y - 5), (x + 24, y + 5)], BLUE.mix(0.18).filled()));
    let lines =
        [("the scene: nothing fitted", rows.first(), BLUE), ("initiation ratio fitted: 6.8", rows.last(), OCHRE)];
    for (label, row, colour) in lines {
        let row = row.context("there are rows")?;
        chart
            .draw_series(LineSeries::new(smooth(&row.run), colour.stroke_width(2)))?
            .label(label)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 24, y)], colour.stroke_width(2)));
    }
    let points = measured::points().into_iter().map(|(depth_m, force_n)| (1e3 * depth_m, force_n));
    chart
        .draw_series(points.map(|point| Circle::new(point, 4, BLACK.filled())))?
        .label("measured: Okamura, Simone and O'Leary 2004")
        .legend(|(x, y)| Circle::new((x + 12, y), 4, BLACK.filled()));
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperLeft)
        .background_style(WHITE.mix(0.85))
        .border_style(GREY.mix(0.5))
        .label_font((FONT, 14))
        .draw()?;
    area.present()?;
    Ok(())
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
