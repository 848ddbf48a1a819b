//! Curves over an axis, as SVG and PNG.

use std::ops::Range;
use std::path::Path;

use anyhow::{Context, Result};
use kerf_server::plot_font::{FONT, register_plot_font};
use plotters::coord::Shift;
use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint, Ranged};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;

const SIZE_PX: (u32, u32) = (1000, 560);
const GREY: RGBColor = RGBColor(110, 110, 110);
const COLOURS: [RGBColor; 5] = [
    RGBColor(60, 60, 60),
    RGBColor(31, 88, 140),
    RGBColor(200, 140, 20),
    RGBColor(176, 36, 24),
    RGBColor(110, 60, 140),
];

/// What is marked of a decade, with a number and without.
const BOLD_MARKS: [f64; 3] = [1.0, 2.0, 5.0];
const LIGHT_MARKS: [f64; 9] = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0];

/// How values lie along an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Scale {
    /// From zero.
    Linear,
    Log10,
}

/// An axis: what it shows, with its unit.
#[derive(Clone, Copy, Debug)]
pub struct Axis {
    what: &'static str,
    scale: Scale,
}

impl Axis {
    /// From zero.
    #[must_use]
    pub fn linear(what: &'static str) -> Self {
        Self { what, scale: Scale::Linear }
    }

    /// By decades.
    #[must_use]
    pub fn log(what: &'static str) -> Self {
        Self { what, scale: Scale::Log10 }
    }

    fn place(&self, value: f64) -> f64 {
        if self.scale == Scale::Log10 { value.log10() } else { value }
    }

    fn label(&self, place: f64) -> String {
        let value = if self.scale == Scale::Log10 { 10f64.powf(place) } else { place };
        // A power of ten comes with rounding in its last digits.
        format!("{}", (value * 1e6).round() / 1e6)
    }

    /// From the least to the greatest value, with some room.
    fn places(&self, values: impl Iterator<Item = f64>) -> Places {
        let places = values.map(|value| self.place(value));
        let (low, high) = places.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        let low = if self.scale == Scale::Linear { low.min(0.0) } else { low - 0.1 };
        let high = high + 0.05 * (high - low) + 0.05 * f64::from(u8::from(self.scale == Scale::Log10));
        Places { scale: self.scale, range: low..high }
    }
}

/// Places along an axis, with its marks.
struct Places {
    scale: Scale,
    range: Range<f64>,
}

impl Ranged for Places {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, place: &f64, limit: (i32, i32)) -> i32 {
        RangedCoordf64::from(self.range.clone()).map(place, limit)
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if self.scale == Scale::Linear {
            return RangedCoordf64::from(self.range.clone()).key_points(hint);
        }
        let marks: &[f64] = if hint.weight().allow_light_points() { &LIGHT_MARKS } else { &BOLD_MARKS };
        let decades = self.range.start.floor() as i32..=self.range.end.floor() as i32;
        decades
            .flat_map(|decade| marks.iter().map(move |mark| f64::from(decade) + mark.log10()))
            .filter(|place| self.range.contains(place))
            .collect()
    }

    fn range(&self) -> Range<f64> {
        self.range.clone()
    }
}

/// How a curve is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mark {
    /// A line through its points.
    Line,
    /// Its points alone.
    Points,
}

/// A curve.
#[derive(Clone, Debug)]
pub struct Curve {
    /// Name.
    pub label: String,
    /// Points, by what the axes show.
    pub points: Vec<(f64, f64)>,
    /// How it is drawn.
    mark: Mark,
}

impl Curve {
    /// A line.
    #[must_use]
    pub fn line(label: &str, points: Vec<(f64, f64)>) -> Self {
        Self { label: label.into(), points, mark: Mark::Line }
    }

    /// Points.
    #[must_use]
    pub fn dots(label: &str, points: Vec<(f64, f64)>) -> Self {
        Self { label: label.into(), points, mark: Mark::Points }
    }
}

/// A plot.
#[derive(Clone, Debug)]
pub struct Figure {
    /// Name of its files.
    pub file: &'static str,
    /// Title.
    pub title: String,
    /// Axis to the right.
    pub x: Axis,
    /// Axis up.
    pub y: Axis,
    /// Curves.
    pub curves: Vec<Curve>,
}

impl Figure {
    /// Writes `<file>.svg` and `.png` to a folder.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn draw(&self, folder: &Path) -> Result<()> {
        register_plot_font();
        let path = |extension: &str| folder.join(format!("{}.{extension}", self.file));
        let (svg, png) = (path("svg"), path("png"));
        self.on(&SVGBackend::new(&svg, SIZE_PX).into_drawing_area()).with_context(|| svg.display().to_string())?;
        self.on(&BitMapBackend::new(&png, SIZE_PX).into_drawing_area()).with_context(|| png.display().to_string())
    }

    fn on<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Result<()>
    where
        B::ErrorType: 'static,
    {
        area.fill(&WHITE)?;
        let area = area.margin(8, 0, 0, 0).titled(&self.title, (FONT, 20))?;
        let points = || self.curves.iter().flat_map(|curve| &curve.points);
        let (x, y) = (self.x.places(points().map(|p| p.0)), self.y.places(points().map(|p| p.1)));
        let mut chart = ChartBuilder::on(&area)
            .margin(10)
            .margin_right(24)
            .x_label_area_size(52)
            .y_label_area_size(76)
            .build_cartesian_2d(x, y)?;
        chart
            .configure_mesh()
            .x_desc(self.x.what)
            .y_desc(self.y.what)
            .x_label_formatter(&|place| self.x.label(*place))
            .y_label_formatter(&|place| self.y.label(*place))
            .label_style((FONT, 14))
            .axis_desc_style((FONT, 15))
            .bold_line_style(GREY.mix(0.3))
            .light_line_style(GREY.mix(0.1))
            .draw()?;
        for (curve, colour) in self.curves.iter().zip(COLOURS) {
            let line: Vec<_> = curve.points.iter().map(|p| (self.x.place(p.0), self.y.place(p.1))).collect();
            let series = match curve.mark {
                Mark::Line => chart.draw_series(LineSeries::new(line, colour.stroke_width(2)))?,
                Mark::Points => chart.draw_series(line.iter().map(|p| Circle::new(*p, 5, colour.filled())))?,
            };
            series.label(&curve.label).legend(move |(x, y)| {
                let width = if curve.mark == Mark::Line { 24 } else { 6 };
                PathElement::new(
                    [(x + 24 - width, y), (x + 24, y)],
                    colour.stroke_width(if width == 6 { 6 } else { 2 }),
                )
            });
        }
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperRight)
            .background_style(WHITE.mix(0.85))
            .border_style(GREY.mix(0.5))
            .label_font((FONT, 14))
            .draw()?;
        area.present()?;
        Ok(())
    }
}
