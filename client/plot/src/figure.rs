//! A figure: a title over charts, in two files.

use std::path::{Path, PathBuf};
use std::sync::Once;

use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};

use crate::chart::Chart;
use crate::{DrawResult, FONT};

/// How several charts stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Layout {
    /// Side by side, of one width.
    Row,
    /// Two above each other, the upper one of this height with the title, px.
    Column(u32),
}

/// A picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// Name of its files.
    pub file: String,
    /// Title.
    pub title: String,
    size_px: (u32, u32),
    charts: Vec<Chart>,
    layout: Layout,
}

/// A figure could not be drawn.
#[derive(Debug, thiserror::Error)]
pub enum PlotError {
    /// A chart has no points, or one that is not finite.
    #[error("{file}: {what}")]
    Points {
        /// The figure's.
        file: String,
        /// What is wrong.
        what: &'static str,
    },
    /// A file could not be drawn or written.
    #[error("cannot draw {}: {message}", path.display())]
    Draw {
        /// The file.
        path: PathBuf,
        /// What went wrong.
        message: String,
    },
}

impl Figure {
    /// A figure of one chart.
    #[must_use]
    pub fn new(file: &str, title: &str, chart: Chart) -> Self {
        Self::row(file, title, vec![chart])
    }

    /// Charts side by side.
    #[must_use]
    pub fn row(file: &str, title: &str, charts: Vec<Chart>) -> Self {
        Self { file: file.into(), title: title.into(), size_px: (1000, 560), charts, layout: Layout::Row }
    }

    /// Two charts above each other, both on the lower one's axis to the right; the upper one is `upper_px` high with
    /// the title.
    #[must_use]
    pub fn column(file: &str, title: &str, charts: [Chart; 2], upper_px: u32) -> Self {
        Self { layout: Layout::Column(upper_px), ..Self::row(file, title, charts.into()) }
    }

    /// The same with another width and height, px.
    #[must_use]
    pub fn sized(self, size_px: (u32, u32)) -> Self {
        Self { size_px, ..self }
    }

    /// Writes `<file>.svg` and `.png` to a folder and returns their paths.
    ///
    /// # Errors
    /// There is nothing to be drawn, or a file cannot be written.
    pub fn draw(&self, folder: &Path) -> Result<[PathBuf; 2], PlotError> {
        self.refuse_points()?;
        register_plot_font();
        let [svg, png] = ["svg", "png"].map(|extension| folder.join(format!("{}.{extension}", self.file)));
        drawn(&svg, self.draw_on(SVGBackend::new(&svg, self.size_px)))?;
        drawn(&png, self.draw_on(BitMapBackend::new(&png, self.size_px)))?;
        Ok([svg, png])
    }

    fn refuse_points(&self) -> Result<(), PlotError> {
        let refuse = |what| Err(PlotError::Points { file: self.file.clone(), what });
        for chart in &self.charts {
            let mut points = chart.curves.iter().flat_map(|curve| &curve.points).peekable();
            if points.peek().is_none() {
                return refuse("there are no points to plot");
            }
            if !points.all(|(x, y)| x.is_finite() && y.is_finite()) {
                return refuse("a point is not finite");
            }
        }
        Ok(())
    }

    fn draw_on<B: DrawingBackend>(&self, backend: B) -> DrawResult<B> {
        let area = backend.into_drawing_area();
        area.fill(&WHITE)?;
        let area = area.margin(8, 0, 0, 0).titled(&self.title, (FONT, 20))?;
        let panels = match self.layout {
            Layout::Row => area.split_evenly((1, self.charts.len())),
            Layout::Column(upper_px) => <[_; 2]>::from(area.split_vertically(upper_px)).into(),
        };
        for (index, (chart, panel)) in self.charts.iter().zip(&panels).enumerate() {
            chart.draw(panel, self.layout == Layout::Row || index + 1 == self.charts.len())?;
        }
        area.present()
    }
}

fn drawn<E: std::error::Error>(path: &Path, result: Result<(), E>) -> Result<(), PlotError> {
    result.map_err(|error| PlotError::Draw { path: path.to_owned(), message: error.to_string() })
}

fn register_plot_font() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let registered = register_font(FONT, FontStyle::Normal, dejavu::sans::regular());
        assert!(registered.is_ok(), "the built-in font is a font");
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Axis, Curve, Stretch};

    #[test]
    fn curves_of_every_kind_are_left_as_svg_and_png_without_system_fonts() {
        let points = || vec![(1.0, 2.0), (10.0, 3.0), (100.0, 2.5)];
        let curves = vec![
            Curve::area("area", points()),
            Curve::line("line", points()),
            Curve::dashes("dashes", (1.0, 1.0), (100.0, 3.0)),
            Curve::dots("dots", points()).tagged("tag"),
            Curve::dotted_line("dotted", points()),
            Curve::ringed_line("ringed", points(), 6),
            Curve::line("", points()).coloured(crate::GREY),
        ];
        let stretch = Stretch { label: "stretch".into(), range: 2.0..5.0 };
        let upper =
            Chart::new(Axis::log("x, m"), Axis::linear("upper, N"), curves.clone()).with_stretches(vec![stretch]);
        let lower = Chart::new(Axis::log("x, m"), Axis::linear("lower, mm").downward(), curves);
        let figure = Figure::column("a.b", "All kinds", [upper, lower], 300);
        let folder = tempfile::tempdir().unwrap();
        let [svg, png] = figure.draw(folder.path()).unwrap();
        assert_eq!(svg.file_name().unwrap(), "a.b.svg");
        let text = std::fs::read_to_string(svg).unwrap();
        let words =
            ["All kinds", "x, m", "upper, N", "lower, mm", "area", "dashes", "dotted", "ringed", "tag", "stretch"];
        for word in words {
            assert!(text.contains(word), "{word} is missing");
        }
        let bytes = std::fs::read(png).unwrap();
        assert!(bytes.starts_with(b"\x89PNG") && bytes.len() > 10_000);
    }

    #[test]
    fn a_chart_has_no_more_lines_of_a_grid_than_numbers() {
        let chart = Chart::new(Axis::linear("x"), Axis::linear("y"), vec![Curve::dots("", vec![(1.0, 1.0)])]);
        let folder = tempfile::tempdir().unwrap();
        let [svg, _] = Figure::new("grid", "", chart).draw(folder.path()).unwrap();
        let text = std::fs::read_to_string(svg).unwrap();
        let visible = text.matches("<line").count() - text.matches("opacity=\"0\"").count();
        assert!(visible <= 2 * text.matches("<text").count(), "{visible} lines");
    }

    #[test]
    fn points_that_cannot_be_drawn_are_refused() {
        for points in [vec![], vec![(0.0, f64::NAN)]] {
            let chart = Chart::new(Axis::linear("x"), Axis::linear("y"), vec![Curve::line("", points)]);
            let refused = Figure::new("unused", "", chart).draw(Path::new("nowhere"));
            assert!(matches!(refused, Err(PlotError::Points { .. })));
        }
    }
}
