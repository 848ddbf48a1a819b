//! Curves, and how each is drawn.

use plotters::style::RGBColor;

/// A dark blue.
pub const BLUE: RGBColor = RGBColor(31, 88, 140);
/// A dark red.
pub const RED: RGBColor = RGBColor(176, 36, 24);
/// A dark green.
pub const GREEN: RGBColor = RGBColor(40, 120, 60);
/// An ochre.
pub const OCHRE: RGBColor = RGBColor(200, 140, 20);
/// A violet.
pub const VIOLET: RGBColor = RGBColor(110, 60, 140);
/// For what others are compared with.
pub const BLACK: RGBColor = RGBColor(40, 40, 40);
/// For lines that guide the eye.
pub const GREY: RGBColor = RGBColor(110, 110, 110);
/// For what stays in the background.
pub const PALE: RGBColor = RGBColor(200, 200, 200);
/// The colours of curves that name none, by their place in the chart.
pub const COLOURS: [RGBColor; 6] = [BLUE, RED, GREEN, OCHRE, VIOLET, GREY];

/// How a curve is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Mark {
    Line,
    Dashes,
    Dots,
    /// A line and a dot at each point.
    DottedLine,
    /// A line and a ring of this radius, px, at each point.
    RingedLine(i32),
    /// What the points enclose.
    Area,
}

impl Mark {
    /// Whether a line goes through all points.
    pub(crate) fn has_line(self) -> bool {
        matches!(self, Self::Line | Self::DottedLine | Self::RingedLine(_))
    }
}

/// A curve.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// Its name in the legend; none where it is empty.
    pub label: String,
    /// Points, by what the axes show.
    pub points: Vec<(f64, f64)>,
    /// Written beside each point.
    pub(crate) tag: Option<String>,
    pub(crate) mark: Mark,
    pub(crate) colour: Option<RGBColor>,
}

impl Curve {
    fn new(label: &str, points: Vec<(f64, f64)>, mark: Mark) -> Self {
        Self { label: label.into(), points, tag: None, mark, colour: None }
    }

    /// A line through the points.
    #[must_use]
    pub fn line(label: &str, points: Vec<(f64, f64)>) -> Self {
        Self::new(label, points, Mark::Line)
    }

    /// A broken line from one point to another.
    #[must_use]
    pub fn dashes(label: &str, from: (f64, f64), to: (f64, f64)) -> Self {
        Self::new(label, vec![from, to], Mark::Dashes)
    }

    /// The points alone.
    #[must_use]
    pub fn dots(label: &str, points: Vec<(f64, f64)>) -> Self {
        Self::new(label, points, Mark::Dots)
    }

    /// A line through the points, and the points.
    #[must_use]
    pub fn dotted_line(label: &str, points: Vec<(f64, f64)>) -> Self {
        Self::new(label, points, Mark::DottedLine)
    }

    /// A line through the points, and rings about them, which leave to be seen what lies below.
    #[must_use]
    pub fn ringed_line(label: &str, points: Vec<(f64, f64)>, radius_px: i32) -> Self {
        Self::new(label, points, Mark::RingedLine(radius_px))
    }

    /// The area that the points go round.
    #[must_use]
    pub fn area(label: &str, rim: Vec<(f64, f64)>) -> Self {
        Self::new(label, rim, Mark::Area)
    }

    /// The same in a colour.
    #[must_use]
    pub fn coloured(self, colour: RGBColor) -> Self {
        Self { colour: Some(colour), ..self }
    }

    /// The same with a word beside each point.
    #[must_use]
    pub fn tagged(self, tag: &str) -> Self {
        Self { tag: Some(tag.into()), ..self }
    }
}
