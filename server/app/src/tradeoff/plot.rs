//! The plots: error against load, and the profile of a scene without tools.

use std::ops::Range;
use std::path::Path;

use anyhow::{Context, Result};
use kerf_scenes::dial::{Front, FrontPoint};
use plotters::coord::{CoordTranslate, Shift};
use plotters::prelude::*;

use super::process::Run;
use super::report::{is_on_front, label};
use super::sweep;
use crate::plot_font::{FONT, register_plot_font};

const SIZE_PX: (u32, u32) = (1000, 700);
/// By level.
const COLOURS: [RGBColor; 5] = [
    RGBColor(31, 88, 140),
    RGBColor(40, 120, 60),
    RGBColor(176, 36, 24),
    RGBColor(130, 90, 20),
    RGBColor(110, 50, 130),
];
const GREY: RGBColor = RGBColor(110, 110, 110);
const PALE: RGBColor = RGBColor(200, 200, 200);
/// Least error drawn, %: a logarithm has no 0, which the reference's own setting has.
const LEAST_PERCENT: f64 = 1e-3;

/// Draws error against load to `pareto.svg` and `pareto.png`; dominated settings are grey.
///
/// # Errors
/// A file cannot be written.
pub fn pareto(front: &Front, folder: &Path) -> Result<()> {
    register_plot_font();
    let (svg, png) = (folder.join("pareto.svg"), folder.join("pareto.png"));
    draw_pareto(front, &SVGBackend::new(&svg, SIZE_PX).into_drawing_area())
        .with_context(|| svg.display().to_string())?;
    draw_pareto(front, &BitMapBackend::new(&png, SIZE_PX).into_drawing_area())
        .with_context(|| png.display().to_string())
}

/// Draws the height of the top over x at the end of the reference and of the runs to `profile.svg` and
/// `profile.png`.
///
/// # Errors
/// A file cannot be written.
pub fn profile(scene: &str, reference: &Run, runs: &[Run], folder: &Path) -> Result<()> {
    register_plot_font();
    let (svg, png) = (folder.join("profile.svg"), folder.join("profile.png"));
    draw_profile(scene, reference, runs, &SVGBackend::new(&svg, SIZE_PX).into_drawing_area())
        .with_context(|| svg.display().to_string())?;
    draw_profile(scene, reference, runs, &BitMapBackend::new(&png, SIZE_PX).into_drawing_area())
        .with_context(|| png.display().to_string())
}

fn place(point: &FrontPoint) -> (f64, f64) {
    (point.load(), (100.0 * point.error()).max(LEAST_PERCENT))
}

fn draw_pareto<B: DrawingBackend>(front: &Front, area: &DrawingArea<B, Shift>) -> Result<()>
where
    B::ErrorType: 'static,
{
    area.fill(&WHITE)?;
    let area = area.margin(8, 0, 0, 0).titled(&format!("{}: error against load", front.notes["scene"]), (FONT, 22))?;
    let places = || front.points.iter().map(place);
    let (loads, errors) = (range(places().map(|p| p.0).chain([1.0]), 1.6), range(places().map(|p| p.1), 1.5));
    let mut chart = ChartBuilder::on(&area)
        .margin(10)
        .margin_right(24)
        .x_label_area_size(56)
        .y_label_area_size(84)
        .build_cartesian_2d(loads.log_scale(), errors.clone().log_scale())?;
    chart
        .configure_mesh()
        .x_desc("load: time of computing per simulated time, one thread")
        .y_desc("error, %: the larger of displacement's and force's, rms")
        .x_label_formatter(&|x| decimal(*x))
        .y_label_formatter(&|y| decimal(*y))
        .label_style((FONT, 15))
        .axis_desc_style((FONT, 16))
        .bold_line_style(GREY.mix(0.3))
        .light_line_style(GREY.mix(0.1))
        .draw()?;
    let real_time = [(1.0, errors.start), (1.0, errors.end)];
    chart.draw_series(LineSeries::new(real_time, GREY))?;
    let (mut best, dominated): (Vec<&FrontPoint>, Vec<&FrontPoint>) =
        front.points.iter().partition(|point| is_on_front(point, front));
    best.sort_by(|a, b| a.load().total_cmp(&b.load()));
    chart.draw_series(dominated.iter().map(|point| Circle::new(place(point), 4, PALE.filled())))?;
    chart.draw_series(LineSeries::new(best.iter().map(|point| place(point)), GREY))?;
    for (index, point) in best.iter().enumerate() {
        let colour = COLOURS[usize::from(point.level) % COLOURS.len()];
        let number = format!("{}", index + 1);
        let name = format!("{number}  {}", label(point));
        let marked = EmptyElement::at(place(point))
            + Circle::new((0, 0), 5, colour.filled())
            + Text::new(number, (4, -19), (FONT, 14).into_font());
        chart.draw_series([marked])?.label(name).legend(move |(x, y)| Circle::new((x + 10, y), 5, colour.filled()));
    }
    legend(&mut chart, SeriesLabelPosition::UpperRight)?;
    area.present()?;
    Ok(())
}

fn draw_profile<B: DrawingBackend>(
    scene: &str,
    reference: &Run,
    runs: &[Run],
    area: &DrawingArea<B, Shift>,
) -> Result<()>
where
    B::ErrorType: 'static,
{
    area.fill(&WHITE)?;
    let area = area.margin(8, 0, 0, 0).titled(&format!("{scene}: its top at the end, in the middle"), (FONT, 22))?;
    let line = |run: &Run| -> Vec<(f64, f64)> {
        let moved = |(point, u): (&super::points::Point, &[f32; 3])| {
            (1e3 * (point.position_m[0] + f64::from(u[0])), 1e3 * (point.position_m[1] + f64::from(u[1])))
        };
        run.job.profile.iter().zip(&run.profile_m).map(moved).collect()
    };
    let lines: Vec<_> = std::iter::once(reference).chain(runs).map(line).collect();
    let xs = span(lines.iter().flatten().map(|p| p.0), 0.02);
    let ys = span(lines.iter().flatten().map(|p| p.1), 0.15);
    let mut chart = ChartBuilder::on(&area)
        .margin(10)
        .margin_right(24)
        .x_label_area_size(56)
        .y_label_area_size(84)
        .build_cartesian_2d(xs, ys)?;
    chart
        .configure_mesh()
        .x_desc("x, mm")
        .y_desc("height, mm")
        .label_style((FONT, 15))
        .axis_desc_style((FONT, 16))
        .bold_line_style(GREY.mix(0.3))
        .light_line_style(GREY.mix(0.1))
        .draw()?;
    for (index, run) in std::iter::once(reference).chain(runs).enumerate() {
        let colour = if index == 0 { BLACK } else { COLOURS[(index - 1) % COLOURS.len()] };
        let what = if index == 0 { "reference".to_owned() } else { sweep::name_of(run.job.setting.element) };
        let label = format!("{what}, level {}: {:.2} ms a step", run.job.setting.level, run.cost.median_ms);
        chart
            .draw_series(LineSeries::new(lines[index].iter().copied(), colour.stroke_width(2)))?
            .label(label)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 24, y)], colour.stroke_width(2)));
    }
    legend(&mut chart, SeriesLabelPosition::LowerRight)?;
    area.present()?;
    Ok(())
}

fn legend<'a, B, C>(chart: &mut ChartContext<'a, B, C>, position: SeriesLabelPosition) -> Result<()>
where
    B: DrawingBackend + 'a,
    B::ErrorType: 'static,
    C: CoordTranslate,
{
    chart
        .configure_series_labels()
        .position(position)
        .background_style(WHITE.mix(0.85))
        .border_style(GREY.mix(0.5))
        .label_font((FONT, 15))
        .draw()?;
    Ok(())
}

fn decimal(value: f64) -> String {
    // Powers of ten come with rounding in the last digit.
    format!("{}", (value * 1e6).round() / 1e6)
}

/// From the least to the greatest value, widened by a factor.
fn range(values: impl Iterator<Item = f64>, room: f64) -> Range<f64> {
    let (low, high) = values.fold((f64::INFINITY, 0.0f64), |(low, high), v| (low.min(v), high.max(v)));
    low / room..high * room
}

/// From the least to the greatest value, widened by a share of their distance.
fn span(values: impl Iterator<Item = f64>, room: f64) -> Range<f64> {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    let room = room * (high - low).max(1e-6);
    low - room..high + room
}
