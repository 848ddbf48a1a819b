//! Figures as SVG and PNG: what to show is data, how it looks stands here once.
//!
//! A [`Figure`] has one or several [`Chart`]s, a chart two axes and its curves. Deliberately absent: styles to
//! choose from, and knowledge of what is plotted.

use plotters::drawing::DrawingAreaErrorKind;
use plotters::prelude::DrawingBackend;

mod axis;
mod chart;
mod curve;
mod figure;
mod legend;

pub use axis::Axis;
pub use chart::{Chart, Stretch};
pub use curve::{BLACK, BLUE, COLOURS, Curve, GREEN, GREY, OCHRE, PALE, RED, VIOLET};
pub use figure::{Figure, PlotError};
pub use plotters::style::RGBColor;

/// Font of all text. The machine may have no fonts and no fontconfig, so it comes with the program.
const FONT: &str = "sans-serif";

/// What drawing on a backend leads to.
type DrawResult<B> = Result<(), DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>>;
