//! The force on a tool over time, as a picture: what a run of the demo leaves.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Once;

use plotters::coord::Shift;
use plotters::element::DashedPathElement;
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};

/// State of the tool at one time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    /// Simulated time, s.
    pub time_s: f64,
    /// Force on the tool against its cutting direction, N.
    pub force_n: f64,
    /// How far the edge is below the undeformed surface, m; negative above it.
    pub depth_m: f64,
}

/// A plot could not be made.
#[derive(Debug, thiserror::Error)]
pub enum PlotError {
    /// There are no samples, or one of them is not finite.
    #[error("{0}")]
    Samples(&'static str),
    /// The file could not be drawn or written.
    #[error("cannot draw {path}: {message}")]
    Draw {
        /// The file.
        path: PathBuf,
        /// What went wrong.
        message: String,
    },
}

/// A stroke: a stretch of time in which the edge is below the surface.
#[derive(Clone, Debug, PartialEq)]
struct Stroke {
    time_s: Range<f64>,
}

const SIZE_PX: (u32, u32) = (1200, 760);
const FORCE_PANEL_PX: u32 = 480;
const FORCE_COLOUR: RGBColor = RGBColor(176, 36, 24);
const DEPTH_COLOUR: RGBColor = RGBColor(31, 88, 140);
const STROKE_COLOUR: RGBColor = RGBColor(240, 236, 226);
const REFERENCE_COLOUR: RGBColor = RGBColor(70, 70, 70);
const FONT: &str = "sans-serif";

/// Draws force over time above depth over time, with the strokes shaded and numbered and
/// `reference_n` (for a steady cut: Gc times the width of the edge) as a dashed line, to
/// `path_without_ext` with `.svg` and with `.png` added. Returns the two paths.
///
/// # Errors
/// [`PlotError::Samples`] without finite samples, [`PlotError::Draw`] if a file cannot be written.
pub fn force_over_time(
    path_without_ext: &Path,
    samples: &[Sample],
    reference_n: Option<f64>,
    title: &str,
) -> Result<[PathBuf; 2], PlotError> {
    if samples.is_empty() {
        return Err(PlotError::Samples("there are no samples to plot"));
    }
    if !samples.iter().all(|s| s.time_s.is_finite() && s.force_n.is_finite() && s.depth_m.is_finite()) {
        return Err(PlotError::Samples("a sample is not finite"));
    }
    register_plot_font();
    let figure = Figure { samples, reference_n, title, strokes: strokes(samples) };
    let [svg, png] = ["svg", "png"].map(|extension| {
        // Not `with_extension`, which would cut a name at its last dot.
        let mut path = path_without_ext.as_os_str().to_owned();
        path.push(".");
        path.push(extension);
        PathBuf::from(path)
    });
    drawn(&svg, figure.draw(SVGBackend::new(&svg, SIZE_PX)))?;
    drawn(&png, figure.draw(BitMapBackend::new(&png, SIZE_PX)))?;
    Ok([svg, png])
}

fn drawn<E: std::error::Error>(path: &Path, result: Result<(), E>) -> Result<(), PlotError> {
    result.map_err(|error| PlotError::Draw { path: path.to_owned(), message: error.to_string() })
}

/// The machine may have no fonts and no fontconfig, so the text's font comes with the program.
fn register_plot_font() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let registered = register_font(FONT, FontStyle::Normal, dejavu::sans::regular());
        assert!(registered.is_ok(), "the built-in font is a font");
    });
}

/// Stretches in which the edge is below the surface.
fn strokes(samples: &[Sample]) -> Vec<Stroke> {
    samples
        .chunk_by(|a, b| (a.depth_m > 0.0) == (b.depth_m > 0.0))
        .filter(|run| run[0].depth_m > 0.0)
        .map(|run| Stroke { time_s: run[0].time_s..run[run.len() - 1].time_s })
        .collect()
}

/// From the least to the greatest value and zero, with some room above and below.
fn padded_range(values: impl Iterator<Item = f64>) -> Range<f64> {
    let (low, high) = values.fold((0.0f64, 0.0f64), |(low, high), v| (low.min(v), high.max(v)));
    let room = if high > low { 0.06 * (high - low) } else { 1.0 };
    let below = if low < 0.0 { room } else { 0.0 };
    low - below..high + room
}

/// A line, piece by piece: as one path it would overshoot where it turns back within a pixel.
fn segments(
    line: impl Iterator<Item = (f64, f64)> + Clone,
    colour: RGBColor,
) -> impl Iterator<Item = PathElement<(f64, f64)>> {
    line.clone().zip(line.skip(1)).map(move |(from, to)| PathElement::new([from, to], colour.stroke_width(2)))
}

/// All that a picture shows.
struct Figure<'a> {
    samples: &'a [Sample],
    reference_n: Option<f64>,
    title: &'a str,
    strokes: Vec<Stroke>,
}

type DrawResult<B> = Result<(), DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>>;

impl Figure<'_> {
    fn draw<B: DrawingBackend>(&self, backend: B) -> DrawResult<B> {
        let root = backend.into_drawing_area();
        root.fill(&WHITE)?;
        let root = root.margin(8, 0, 0, 0).titled(self.title, (FONT, 24))?;
        let (upper, lower) = root.split_vertically(FORCE_PANEL_PX);
        self.draw_force(&upper)?;
        self.draw_depth(&lower)?;
        root.present()
    }

    fn time_range_s(&self) -> Range<f64> {
        let (first, last) = (self.samples[0].time_s, self.samples[self.samples.len() - 1].time_s);
        first..if last > first { last } else { first + 1.0 }
    }

    fn draw_force<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> DrawResult<B> {
        let forces_n = self.samples.iter().map(|s| s.force_n).chain(self.reference_n);
        let range_n = padded_range(forces_n);
        let mut chart = panel(area, 10).build_cartesian_2d(self.time_range_s(), range_n.clone())?;
        for (number, stroke) in self.strokes.iter().enumerate() {
            chart.draw_series([shade(stroke, &range_n)])?;
            let label = format!("stroke {}", number + 1);
            let style = (FONT, 16).into_font().color(&REFERENCE_COLOUR);
            chart.draw_series([Text::new(label, (stroke.time_s.start, range_n.end), style)])?;
        }
        chart
            .configure_mesh()
            .y_desc("force on the tool, N")
            .x_labels(12)
            .x_label_formatter(&|_| String::new())
            .label_style((FONT, 16))
            .axis_desc_style((FONT, 18))
            .light_line_style(WHITE.mix(0.0))
            .draw()?;
        let line = self.samples.iter().map(|s| (s.time_s, s.force_n));
        chart
            .draw_series(segments(line, FORCE_COLOUR))?
            .label("force")
            .legend(|(x, y)| PathElement::new([(x, y), (x + 24, y)], FORCE_COLOUR.stroke_width(2)));
        if let Some(reference_n) = self.reference_n {
            let ends = [self.time_range_s().start, self.time_range_s().end].map(|time_s| (time_s, reference_n));
            chart
                .draw_series(DashedLineSeries::new(ends, 9, 6, REFERENCE_COLOUR.stroke_width(2)))?
                .label(format!("Gc w = {reference_n:.3} N"))
                .legend(|(x, y)| DashedPathElement::new([(x, y), (x + 24, y)], 7, 5, REFERENCE_COLOUR.stroke_width(2)));
        }
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperRight)
            .background_style(WHITE.mix(0.85))
            .border_style(REFERENCE_COLOUR.mix(0.4))
            .label_font((FONT, 16))
            .draw()
    }

    fn draw_depth<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> DrawResult<B> {
        let depth_mm = |s: &Sample| s.depth_m * 1e3;
        let range_mm = padded_range(self.samples.iter().map(depth_mm));
        // Deeper is lower.
        let mut chart = panel(area, 50).build_cartesian_2d(self.time_range_s(), range_mm.end..range_mm.start)?;
        chart.draw_series(self.strokes.iter().map(|stroke| shade(stroke, &range_mm)))?;
        chart
            .configure_mesh()
            .x_desc("time, s")
            .y_desc("depth, mm")
            .x_labels(12)
            .y_labels(6)
            .label_style((FONT, 16))
            .axis_desc_style((FONT, 18))
            .light_line_style(WHITE.mix(0.0))
            .draw()?;
        let line = self.samples.iter().map(|s| (s.time_s, depth_mm(s)));
        chart.draw_series(segments(line, DEPTH_COLOUR))?;
        Ok(())
    }
}

/// A chart with the margins both panels share, so that their time axes are aligned.
fn panel<'a, 'b, B: DrawingBackend>(area: &'a DrawingArea<B, Shift>, time_labels_px: u32) -> ChartBuilder<'a, 'b, B> {
    let mut builder = ChartBuilder::on(area);
    builder.margin(10).margin_right(24).x_label_area_size(time_labels_px).y_label_area_size(80);
    builder
}

fn shade(stroke: &Stroke, values: &Range<f64>) -> Rectangle<(f64, f64)> {
    let corners = [(stroke.time_s.start, values.start), (stroke.time_s.end, values.end)];
    Rectangle::new(corners, STROKE_COLOUR.filled())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two strokes: press, give, cut on at the plateau, lift.
    fn two_strokes() -> Vec<Sample> {
        (0..4000)
            .map(|i| {
                let time_s = f64::from(i) * 1e-3;
                let phase_s = time_s % 2.0;
                let depth_m = 0.03 * (phase_s - 0.3).min(1.7 - phase_s);
                let force_n = match phase_s {
                    p if p < 0.3 => 0.0,
                    p if p < 0.8 => 16.0 * ((p - 0.3) / 0.5).powi(2),
                    p if p < 1.0 => 8.0 + 8.0 * (-(p - 0.8) / 0.03).exp() + 0.2 * (400.0 * p).sin(),
                    _ => 0.0,
                };
                Sample { time_s, force_n, depth_m }
            })
            .collect()
    }

    #[test]
    fn strokes_are_the_stretches_below_the_surface() {
        let found = strokes(&two_strokes());
        assert_eq!(found.len(), 2);
        assert!((found[1].time_s.start - 2.3).abs() < 2e-3 && (found[1].time_s.end - 3.7).abs() < 2e-3, "{found:?}");
    }

    #[test]
    fn a_plot_is_left_as_svg_and_png_without_system_fonts() {
        let directory = tempfile::tempdir().unwrap();
        let base = directory.path().join("force.v1");
        let [svg, png] = force_over_time(&base, &two_strokes(), Some(8.0), "Two strokes").unwrap();
        assert_eq!(svg.file_name().unwrap(), "force.v1.svg");
        let text = std::fs::read_to_string(svg).unwrap();
        for expected in ["Two strokes", "Gc w = 8.000 N", "stroke 2", "depth, mm", "force on the tool, N"] {
            assert!(text.contains(expected), "{expected} is missing");
        }
        let bytes = std::fs::read(png).unwrap();
        assert!(bytes.starts_with(b"\x89PNG") && bytes.len() > 10_000);
    }

    #[test]
    fn samples_that_cannot_be_drawn_are_refused() {
        let path = Path::new("unused");
        for samples in [vec![], vec![Sample { force_n: f64::NAN, ..Sample::default() }]] {
            assert!(matches!(force_over_time(path, &samples, None, ""), Err(PlotError::Samples(_))));
        }
    }

    #[test]
    fn constant_samples_still_have_a_range() {
        assert_eq!(padded_range([0.0, 0.0].into_iter()), 0.0..1.0);
        assert_eq!(padded_range([-1.0, 0.0].into_iter()), -1.06..0.06);
    }
}
