//! A chart: two axes, and curves on them.

use std::ops::Range;

use plotters::coord::Shift;
use plotters::element::DashedPathElement;
use plotters::prelude::*;

use crate::axis::{Axis, Places};
use crate::curve::{COLOURS, Curve, GREY, Mark};
use crate::{FONT, figure::DrawResult};

/// Colour of [`Stretch`]es.
const SHADE: RGBColor = RGBColor(240, 236, 226);
const LINE_PX: u32 = 2;
const DOT_PX: u32 = 4;
/// Length of a line in the legend.
const SAMPLE_PX: i32 = 24;
/// From a point to the word beside it.
const TAG_OFFSET_PX: (i32, i32) = (4, -19);

/// Where the legend stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Corner {
    /// At the top, left.
    UpperLeft,
    /// At the top, right. Default.
    #[default]
    UpperRight,
    /// At the bottom, right.
    LowerRight,
    /// Half-way up, left.
    MiddleLeft,
}

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
    /// Where the legend stands, if a curve has a name.
    pub legend: Corner,
}

type Context<'a, B> = ChartContext<'a, B, Cartesian2d<Places, Places>>;

impl Chart {
    /// Curves on two axes; legend at the upper right.
    #[must_use]
    pub fn new(x: Axis, y: Axis, curves: Vec<Curve>) -> Self {
        Self { x, y, curves, stretches: Vec::new(), legend: Corner::default() }
    }

    /// The same with its legend elsewhere.
    #[must_use]
    pub fn with_legend(self, legend: Corner) -> Self {
        Self { legend, ..self }
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
            .light_line_style(GREY.mix(0.1));
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
        let (line, dot) = (colour.stroke_width(LINE_PX), colour.filled());
        // Piece by piece: as one path it would overshoot where it turns back within a pixel.
        let pieces = || places.windows(2).map(|ends| PathElement::new(ends, line));
        let dots = |radius_px: u32, style: ShapeStyle| {
            places.iter().map(move |place| Circle::new(*place, radius_px as i32, style))
        };
        let sample = move |(x, y)| PathElement::new([(x, y), (x + SAMPLE_PX, y)], line);
        let dot_sample =
            move |(x, y), radius_px: u32, style| Circle::new((x + SAMPLE_PX / 2, y), radius_px as i32, style);
        if let Some(tag) = &curve.tag {
            let word = |place: &(f64, f64)| {
                EmptyElement::at(*place) + Text::new(tag.clone(), TAG_OFFSET_PX, (FONT, 14).into_font())
            };
            chart.draw_series(places.iter().map(word))?;
        }
        let drawn = match curve.mark {
            Mark::Line => chart.draw_series(pieces())?.legend(sample),
            Mark::Dashes => chart
                .draw_series(DashedLineSeries::new(places.iter().copied(), 9, 6, line))?
                .legend(move |(x, y)| DashedPathElement::new([(x, y), (x + SAMPLE_PX, y)], 7, 5, line)),
            Mark::Dots => chart.draw_series(dots(DOT_PX, dot))?.legend(move |at| dot_sample(at, DOT_PX, dot)),
            Mark::DottedLine | Mark::RingedLine(_) => {
                let (radius_px, style) =
                    if let Mark::RingedLine(radius_px) = curve.mark { (radius_px, line) } else { (DOT_PX, dot) };
                chart.draw_series(dots(radius_px, style))?;
                chart
                    .draw_series(pieces())?
                    .legend(move |at| EmptyElement::at(at) + sample((0, 0)) + dot_sample((0, 0), radius_px, style))
            }
            Mark::Area => {
                let fill = colour.mix(0.18);
                chart
                    .draw_series([Polygon::new(places.clone(), fill)])?
                    .legend(move |(x, y)| Rectangle::new([(x, y - 5), (x + SAMPLE_PX, y + 5)], fill.filled()))
            }
        };
        if !curve.label.is_empty() {
            drawn.label(&curve.label);
        }
        Ok(())
    }

    fn draw_legend<'a, B: DrawingBackend + 'a>(&self, chart: &mut Context<'a, B>) -> DrawResult<B> {
        if self.curves.iter().all(|curve| curve.label.is_empty()) {
            return Ok(());
        }
        chart
            .configure_series_labels()
            .position(match self.legend {
                Corner::UpperLeft => SeriesLabelPosition::UpperLeft,
                Corner::UpperRight => SeriesLabelPosition::UpperRight,
                Corner::LowerRight => SeriesLabelPosition::LowerRight,
                Corner::MiddleLeft => SeriesLabelPosition::MiddleLeft,
            })
            .background_style(WHITE.mix(0.85))
            .border_style(GREY.mix(0.5))
            .label_font((FONT, 14))
            .draw()
    }
}
