//! Studies of convergence as log-log plots.

use std::ops::Range;
use std::path::Path;

use anyhow::{Context, Result};
use kerf_server::plot_font::{FONT, register_plot_font};
use plotters::coord::Shift;
use plotters::prelude::*;

use super::Study;

const SIZE_PX: (u32, u32) = (900, 640);
const COLOURS: [RGBColor; 4] =
    [RGBColor(31, 88, 140), RGBColor(176, 36, 24), RGBColor(40, 120, 60), RGBColor(130, 90, 20)];
const GREY: RGBColor = RGBColor(110, 110, 110);

/// Draws a study to `verification-<file>.svg` and `.png` in a directory.
///
/// # Errors
/// A file cannot be written.
pub fn draw(study: &Study, directory: &Path) -> Result<()> {
    register_plot_font();
    let path = |extension: &str| directory.join(format!("verification-{}.{extension}", study.file));
    let (svg, png) = (path("svg"), path("png"));
    figure(study, &SVGBackend::new(&svg, SIZE_PX).into_drawing_area()).with_context(|| svg.display().to_string())?;
    figure(study, &BitMapBackend::new(&png, SIZE_PX).into_drawing_area()).with_context(|| png.display().to_string())
}

fn figure<B: DrawingBackend>(study: &Study, area: &DrawingArea<B, Shift>) -> Result<()>
where
    B::ErrorType: 'static,
{
    area.fill(&WHITE)?;
    let area = area.margin(8, 0, 0, 0).titled(&study.title, (FONT, 22))?;
    let points = || study.series.iter().flat_map(|s| &s.points);
    let (sizes, errors) = (range(points().map(|p| p.0), 1.25), range(points().map(|p| 100.0 * p.1.abs()), 2.0));
    let mut chart = ChartBuilder::on(&area)
        .margin(10)
        .margin_right(24)
        .x_label_area_size(56)
        .y_label_area_size(84)
        .build_cartesian_2d(sizes.log_scale().base(2.0), errors.log_scale())?;
    chart
        .configure_mesh()
        .x_desc(study.size_of)
        .y_desc(format!("error, %: {}", study.error_of))
        .x_label_formatter(&|x| label(*x))
        .y_label_formatter(&|y| label(*y))
        .label_style((FONT, 15))
        .axis_desc_style((FONT, 16))
        .bold_line_style(GREY.mix(0.35))
        .light_line_style(GREY.mix(0.12))
        .draw()?;
    for (series, colour) in study.series.iter().zip(COLOURS) {
        let line: Vec<(f64, f64)> = series.points.iter().map(|(h, e)| (*h, 100.0 * e.abs())).collect();
        chart.draw_series(line.iter().map(|p| Circle::new(*p, 4, colour.filled())))?;
        chart
            .draw_series(LineSeries::new(line, colour.stroke_width(2)))?
            .label(series.summary())
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 24, y)], colour.stroke_width(2)));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::LowerRight)
        .background_style(WHITE.mix(0.85))
        .border_style(GREY.mix(0.5))
        .label_font((FONT, 15))
        .draw()?;
    area.present()?;
    Ok(())
}

fn label(value: f64) -> String {
    // Powers of ten and their halves come with rounding in the last digit.
    format!("{}", (value * 1e6).round() / 1e6)
}

/// From the least to the greatest value, widened by a factor.
fn range(values: impl Iterator<Item = f64>, room: f64) -> Range<f64> {
    let (low, high) = values.fold((f64::INFINITY, 0.0f64), |(low, high), v| (low.min(v), high.max(v)));
    low / room..high * room
}
