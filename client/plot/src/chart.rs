//! A chart: two axes, and curves on them.

use std::ops::Range;

use plotters::coord::Shift;
use plotters::element::DashedPathElement;
use plotters::prelude::*;

use crate::axis::{Axis, Places};
use crate::curve::{COLOURS, Curve, GREY, Mark};
use crate::{DrawResult, FONT, legend};

/// Colour of [`Stretch`]es.
const SHADE: RGBColor = RGBColor(240, 236, 226);
const LINE_PX: u32 = 2;
const DOT_PX: i32 = 4;
/// Middle of the names of stretches, below the chart's upper end.
const STRETCH_NAME_PX: i32 = 12;
/// Length of a line in the legend.
const SAMPLE_PX: i32 = 24;
/// Opacity of areas.
const AREA_OPACITY: f64 = 0.18;
/// From a point to the word beside it.
const TAG_OFFSET_PX: (i32, i32) = (4, -19);

/// A stretch of the axis to the right that is shaded.
#[derive(Clone, Debug, PartialEq)]
pub struct Stretch {
    /// Written at its upper left.
    pub label: String,
    /// By what the axis shows.
    pub range: Range<f64>,
}

/// Curves on two axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Chart {
    /// Axis to the right.
    pub x: Axis,
    /// Axis up.
    pub y: Axis,
    /// Later ones over earlier ones.
    pub curves: Vec<Curve>,
    /// Under the curves.
    pub stretches: Vec<Stretch>,
}

type Context<'a, B> = ChartContext<'a, B, Cartesian2d<Places, Places>>;

impl Chart {
    /// Curves on two axes; the legend stands where it covers the least of them.
    #[must_use]
    pub fn new(x: Axis, y: Axis, curves: Vec<Curve>) -> Self {
        Self { x, y, curves, stretches: Vec::new() }
    }

    /// The same with shaded stretches.
    #[must_use]
    pub fn with_stretches(self, stretches: Vec<Stretch>) -> Self {
        Self { stretches, ..self }
    }

    /// Draws the chart; without numbers at its axis to the right where a chart below has the same.
    pub(crate) fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>, has_x_numbers: bool) -> DrawResult<B> {
        let points = || self.curves.iter().flat_map(|curve| &curve.points);
        let (x, y) = (self.x.places(points().map(|p| p.0)), self.y.places(points().map(|p| p.1)));
        let heights = y.range();
        let mut chart = ChartBuilder::on(area)
            .margin(10)
            .margin_right(24)
            .x_label_area_size(if has_x_numbers { 52 } else { 10 })
            .y_label_area_size(76)
            .build_cartesian_2d(x, y)?;
        for stretch in &self.stretches {
            let [from, to] = [stretch.range.start, stretch.range.end].map(|x| self.x.place(x));
            chart.draw_series([Rectangle::new([(from, heights.start), (to, heights.end)], SHADE.filled())])?;
            let style = (FONT, 14).into_font().color(&GREY);
            chart.draw_series([Text::new(stretch.label.clone(), (from, heights.end), style)])?;
        }
        let mut mesh = chart.configure_mesh();
        mesh.y_desc(&self.y.what)
            .label_style((FONT, 14))
            .axis_desc_style((FONT, 15))
            .bold_line_style(GREY.mix(0.3))
            .light_line_style(TRANSPARENT);
        let x_number = |place: &f64| if has_x_numbers { self.x.label(*place) } else { String::new() };
        let y_number = |place: &f64| self.y.label(*place);
        mesh.x_label_formatter(&x_number).y_label_formatter(&y_number);
        if has_x_numbers {
            mesh.x_desc(&self.x.what);
        }
        mesh.draw()?;
        for (curve, colour) in self.curves.iter().zip(COLOURS.iter().cycle()) {
            self.draw_curve(&mut chart, curve, curve.colour.unwrap_or(*colour))?;
        }
        self.draw_legend(&mut chart)
    }

    fn draw_curve<'a, B: DrawingBackend + 'a>(
        &self,
        chart: &mut Context<'a, B>,
        curve: &Curve,
        colour: RGBColor,
    ) -> DrawResult<B> {
        let places: Vec<_> = curve.points.iter().map(|p| (self.x.place(p.0), self.y.place(p.1))).collect();
        // Piece by piece: as one path it would overshoot where it turns back within a pixel.
        let line = || places.windows(2).map(|ends| PathElement::new(ends, colour.stroke_width(LINE_PX)));
        if let Some((radius_px, style)) = dot(curve.mark, colour) {
            chart.draw_series(places.iter().map(|place| Circle::new(*place, radius_px, style)))?;
        }
        if let Some(tag) = &curve.tag {
            let word = |place: &(f64, f64)| {
                EmptyElement::at(*place) + Text::new(tag.clone(), TAG_OFFSET_PX, (FONT, 14).into_font())
            };
            chart.draw_series(places.iter().map(word))?;
        }
        let drawn = match curve.mark {
            Mark::Line | Mark::DottedLine | Mark::RingedLine(_) => chart.draw_series(line())?,
            Mark::Dashes => {
                chart.draw_series(DashedLineSeries::new(places.iter().copied(), 9, 6, colour.stroke_width(LINE_PX)))?
            }
            Mark::Dots => chart.draw_series(std::iter::empty::<Pixel<_>>())?,
            Mark::Area => chart.draw_series([Polygon::new(places.clone(), colour.mix(AREA_OPACITY))])?,
        };
        if curve.label.is_empty() {
            return Ok(());
        }
        let (named, mark) = (drawn.label(&curve.label), curve.mark);
        if mark == Mark::Dashes {
            let line = colour.stroke_width(LINE_PX);
            named.legend(move |(x, y)| DashedPathElement::new([(x, y), (x + SAMPLE_PX, y)], 7, 5, line));
        } else {
            named.legend(move |at| {
                let [line, area] =
                    [mark.has_line(), mark == Mark::Area].map(|is_shown| colour.mix(f64::from(is_shown)));
                let (radius_px, style) = dot(mark, colour).unwrap_or((0, TRANSPARENT.into()));
                EmptyElement::at(at)
                    + Rectangle::new([(0, -5), (SAMPLE_PX, 5)], area.mix(AREA_OPACITY).filled())
                    + PathElement::new([(0, 0), (SAMPLE_PX, 0)], line.stroke_width(LINE_PX))
                    + Circle::new((SAMPLE_PX / 2, 0), radius_px, style)
            });
        }
        Ok(())
    }

    fn draw_legend<'a, B: DrawingBackend + 'a>(&self, chart: &mut Context<'a, B>) -> DrawResult<B> {
        if self.curves.iter().all(|curve| curve.label.is_empty()) {
            return Ok(());
        }
        let (right, down) = chart.plotting_area().get_pixel_range();
        let on_chart = |point: &(f64, f64)| {
            let (x, y) = chart.backend_coord(&(self.x.place(point.0), self.y.place(point.1)));
            (x - right.start, y - down.start)
        };
        let drawn = self.curves.iter().flat_map(|curve| {
            let places: Vec<_> = curve.points.iter().map(on_chart).collect();
            if curve.mark == Mark::Dots { places } else { legend::along(&places).collect() }
        });
        // The names of stretches stand along the top.
        let names_of_stretches = self.stretches.iter().flat_map(|stretch| {
            let (x, _) = chart.backend_coord(&(self.x.place(stretch.range.start), 0.0));
            let width_px = legend::LETTER_WIDTH_PX * stretch.label.chars().count() as i32;
            legend::along(&[(x - right.start, STRETCH_NAME_PX), (x - right.start + width_px, STRETCH_NAME_PX)])
                .filter(move |_| width_px > 0)
                .collect::<Vec<_>>()
        });
        let drawn = drawn.chain(names_of_stretches);
        let names = self.curves.iter().map(|curve| curve.label.as_str()).filter(|name| !name.is_empty());
        let size_px = (right.end - right.start, down.end - down.start);
        let position = legend::freest(size_px, legend::size_px(names), &drawn.collect::<Vec<_>>());
        chart
            .configure_series_labels()
            .position(position)
            .background_style(WHITE.mix(0.85))
            .border_style(GREY.mix(0.5))
            .label_font((FONT, 14))
            .draw()
    }
}

/// Radius, px, and style of a mark's dots.
fn dot(mark: Mark, colour: RGBColor) -> Option<(i32, ShapeStyle)> {
    match mark {
        Mark::Dots | Mark::DottedLine => Some((DOT_PX, colour.filled())),
        Mark::RingedLine(radius_px) => Some((radius_px, colour.stroke_width(LINE_PX))),
        Mark::Line | Mark::Dashes | Mark::Area => None,
    }
}
