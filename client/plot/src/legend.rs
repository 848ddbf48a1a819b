//! Where a legend stands: where it covers the least of the curves.

use plotters::chart::SeriesLabelPosition;

/// A place or a size, px, right and down.
type Px = (i32, i32);

/// Size of an entry of a legend, and what its frame adds; the letters of its font are so wide in the mean.
const ENTRY_HEIGHT_PX: i32 = 20;
pub(crate) const LETTER_WIDTH_PX: i32 = 7;
const FRAME_PX: Px = (44, 10);
/// From the chart's edge to the legend.
const MARGIN_PX: i32 = 10;

/// Size of a legend of these names.
pub(crate) fn size_px<'a>(names: impl Iterator<Item = &'a str>) -> Px {
    let (entries, longest) = names.fold((0, 0), |(n, longest), name| (n + 1, longest.max(name.chars().count())));
    (LETTER_WIDTH_PX * longest as i32 + FRAME_PX.0, ENTRY_HEIGHT_PX * entries + FRAME_PX.1)
}

/// The position at which a legend of this size covers the fewest of the points; of equal ones the first, corners before
/// middles. Points are counted from the chart's upper left.
pub(crate) fn freest(chart: Px, legend: Px, points: &[Px]) -> SeriesLabelPosition {
    use SeriesLabelPosition::{
        LowerLeft, LowerMiddle, LowerRight, MiddleLeft, MiddleMiddle, MiddleRight, UpperLeft, UpperMiddle, UpperRight,
    };
    // By halves of the way from the left and from the top.
    let positions = [
        (UpperRight, 2, 0),
        (UpperLeft, 0, 0),
        (LowerRight, 2, 2),
        (LowerLeft, 0, 2),
        (MiddleRight, 2, 1),
        (MiddleLeft, 0, 1),
        (UpperMiddle, 1, 0),
        (LowerMiddle, 1, 2),
        (MiddleMiddle, 1, 1),
    ];
    let covered = |halves: Px| {
        let start = |chart: i32, legend: i32, halves: i32| MARGIN_PX + (chart - legend - 2 * MARGIN_PX) * halves / 2;
        let (x, y) = (start(chart.0, legend.0, halves.0), start(chart.1, legend.1, halves.1));
        let is_covered = |point: &&Px| (x..x + legend.0).contains(&point.0) && (y..y + legend.1).contains(&point.1);
        points.iter().filter(is_covered).count()
    };
    let best = positions.into_iter().min_by_key(|(_, right, down)| covered((*right, *down)));
    best.map_or(UpperRight, |(position, ..)| position)
}

/// Points along a line between places, about as far apart as a pixel.
pub(crate) fn along(places: &[Px]) -> impl Iterator<Item = Px> {
    places.windows(2).flat_map(|ends| {
        let [(x, y), (to_x, to_y)] = [ends[0], ends[1]];
        let pieces = (to_x - x).abs().max((to_y - y).abs()).max(1);
        (0..=pieces).map(move |i| (x + (to_x - x) * i / pieces, y + (to_y - y) * i / pieces))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const CHART: Px = (400, 300);
    const LEGEND: Px = (100, 50);

    fn position(line: &[Px]) -> String {
        format!("{:?}", freest(CHART, LEGEND, &along(line).collect::<Vec<_>>()))
    }

    #[test]
    fn a_legend_stands_beside_the_curves() {
        assert_eq!(position(&[]), "UpperRight");
        assert_eq!(position(&[(0, 30), (400, 30)]), "LowerRight", "under a line along the top");
        assert_eq!(position(&[(0, 280), (400, 20)]), "UpperLeft", "over one that rises");
        assert_eq!(position(&[(400, 30), (0, 30), (0, 270), (400, 270)]), "MiddleRight", "within a bracket");
    }

    #[test]
    fn the_size_is_that_of_the_longest_name_and_of_all_lines() {
        assert_eq!(size_px(["force", "Gc w = 120 N"].into_iter()), (128, 50));
    }
}
