//! Axes: where values lie on them, and what is marked.

use std::ops::Range;

use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint, Ranged};
use plotters::coord::types::RangedCoordf64;

/// What is marked of a decade, with a number and without.
const BOLD_MARKS: [f64; 3] = [1.0, 2.0, 5.0];
const LIGHT_MARKS: [f64; 9] = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0];
/// Room beyond the greatest value, and beyond the least where the axis does not end at zero, over their distance.
const ROOM: f64 = 0.05;

/// How values lie along an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Scale {
    /// Zero is on it.
    FromZero,
    /// Zero need not be on it.
    Fitted,
    Log10,
}

/// An axis: what it shows, with its unit.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    pub(crate) what: String,
    scale: Scale,
    /// Instead of the values' own.
    ends: Option<Range<f64>>,
    is_downward: bool,
}

impl Axis {
    fn new(what: &str, scale: Scale) -> Self {
        Self { what: what.into(), scale, ends: None, is_downward: false }
    }

    /// Linear, with zero on it.
    #[must_use]
    pub fn linear(what: &str) -> Self {
        Self::new(what, Scale::FromZero)
    }

    /// Linear, from the least to the greatest value.
    #[must_use]
    pub fn fitted(what: &str) -> Self {
        Self::new(what, Scale::Fitted)
    }

    /// By decades.
    #[must_use]
    pub fn log(what: &str) -> Self {
        Self::new(what, Scale::Log10)
    }

    /// The same from one value to another.
    #[must_use]
    pub fn over(self, ends: Range<f64>) -> Self {
        Self { ends: Some(ends), ..self }
    }

    /// The same with greater values lower.
    #[must_use]
    pub fn downward(self) -> Self {
        Self { is_downward: true, ..self }
    }

    /// Where a value lies.
    pub(crate) fn place(&self, value: f64) -> f64 {
        if self.scale == Scale::Log10 { value.log10() } else { value }
    }

    /// The number at a place.
    pub(crate) fn label(&self, place: f64) -> String {
        let value = if self.scale == Scale::Log10 { 10f64.powf(place) } else { place };
        // A power of ten comes with rounding in its last digits.
        format!("{}", (value * 1e6).round() / 1e6)
    }

    /// From the least to the greatest value, with some room.
    pub(crate) fn places(&self, values: impl Iterator<Item = f64>) -> Places {
        let range = match &self.ends {
            Some(ends) => self.place(ends.start)..self.place(ends.end),
            None => self.range(values.map(|value| self.place(value))),
        };
        Places { scale: self.scale, range: if self.is_downward { range.end..range.start } else { range } }
    }

    fn range(&self, places: impl Iterator<Item = f64>) -> Range<f64> {
        let zero = if self.scale == Scale::FromZero { [0.0; 2] } else { [f64::INFINITY, f64::NEG_INFINITY] };
        let [low, high] = places.fold(zero, |[low, high], place| [low.min(place), high.max(place)]);
        let room = if high > low { ROOM * (high - low) } else { 1.0 };
        let ends_at_zero = self.scale == Scale::FromZero && low == 0.0;
        low - if ends_at_zero { 0.0 } else { room }..high + room
    }
}

/// Places along an axis, with its marks.
pub(crate) struct Places {
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
        if self.scale != Scale::Log10 {
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

#[cfg(test)]
mod tests {
    use super::*;

    fn range(axis: &Axis, values: &[f64]) -> Range<f64> {
        axis.places(values.iter().copied()).range
    }

    #[test]
    fn an_axis_from_zero_ends_there_and_has_room_elsewhere() {
        assert_eq!(range(&Axis::linear(""), &[0.0, 2.0]), 0.0..2.1);
        assert_eq!(range(&Axis::linear(""), &[-1.0, 0.0]), -1.05..0.05);
        assert_eq!(range(&Axis::linear("").downward(), &[4.0]), 4.2..0.0);
        assert_eq!(range(&Axis::fitted(""), &[1.0, 3.0]), 0.9..3.1);
    }

    #[test]
    fn constant_values_still_have_a_range() {
        assert_eq!(range(&Axis::linear(""), &[0.0, 0.0]), 0.0..1.0);
        assert_eq!(range(&Axis::fitted(""), &[7.0]), 6.0..8.0);
    }

    #[test]
    fn decades_lie_evenly_and_are_told_without_rounding() {
        let axis = Axis::log("").over(0.01..100.0);
        assert_eq!(range(&axis, &[]), -2.0..2.0);
        assert_eq!(["0.01", "0.2"], [-2.0, 0.2f64.log10()].map(|place| axis.label(place)));
    }
}
