//! The edge of a blade: a polyline in the tool frame, and the frame that each segment of it cuts in.

use super::frame::BladeFrame;
use crate::Vec3;
use crate::scene::edge::STEEPEST;
use serde::{Deserialize, Serialize};

/// A straight piece of an edge, tool frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Piece {
    /// Its middle, m.
    pub middle_m: Vec3,
    /// Unit tangent.
    pub along: Vec3,
    /// Its length, m.
    pub length_m: f64,
    /// Arc length from the edge's middle to the piece's, m.
    pub arc_m: f64,
}

impl Piece {
    fn at(&self, arc_m: f64) -> Vec3 {
        let half = 0.5 * self.length_m;
        self.middle_m + self.along * (arc_m - self.arc_m).clamp(-half, half)
    }
}

/// One segment of an edge, tool frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct EdgeSegment {
    /// Its middle, m; of an end of the edge, [`Self::clearance_m`] behind the outline.
    pub middle_m: Vec3,
    /// Along the segment's chord, forward, across.
    pub frame: BladeFrame,
    /// How far its middle stands behind the outline, m.
    pub clearance_m: f64,
    /// Its length along the edge, m.
    pub length_m: f64,
    /// Arc length from its middle to the nearer end of the edge, m.
    pub from_end_m: f64,
}

impl EdgeSegment {
    /// Its middle on the outline, m.
    #[must_use]
    pub fn outline_m(&self) -> Vec3 {
        self.middle_m + self.frame.forward * self.clearance_m
    }
}

/// Which end of an edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum EdgeEnd {
    /// Where its first point is.
    First,
    /// Where its last one is.
    Last,
}

/// A polyline of the pieces of an edge, tool frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Edge {
    points_m: Vec<Vec3>,
    pieces: Vec<Piece>,
    length_m: f64,
}

impl Edge {
    /// Through `points_m`, tool frame: at least two, no two in a row alike.
    #[must_use]
    pub fn through(points_m: Vec<Vec3>) -> Self {
        let length_m: f64 = points_m.windows(2).map(|ends| (ends[1] - ends[0]).norm()).sum();
        let mut from_start = 0.0;
        let pieces = points_m.windows(2).map(|ends| {
            let span = ends[1] - ends[0];
            let piece = span.norm();
            let arc_m = from_start + 0.5 * piece - 0.5 * length_m;
            from_start += piece;
            Piece { middle_m: 0.5 * (ends[0] + ends[1]), along: span / piece, length_m: piece, arc_m }
        });
        let pieces = pieces.collect();
        Self { points_m, pieces, length_m }
    }

    /// Its points, m.
    #[must_use]
    pub fn points_m(&self) -> &[Vec3] {
        &self.points_m
    }

    /// Its pieces, from the first point to the last.
    #[must_use]
    pub fn pieces(&self) -> &[Piece] {
        &self.pieces
    }

    /// Arc length, m.
    #[must_use]
    pub fn length_m(&self) -> f64 {
        self.length_m
    }

    /// The piece at an arc length from the edge's middle, m.
    fn piece_at(&self, arc_m: f64) -> &Piece {
        let after = self.pieces.partition_point(|p| p.arc_m + 0.5 * p.length_m < arc_m);
        &self.pieces[after.min(self.pieces.len() - 1)]
    }

    /// Equal segments of the edge, no longer than `longest_m` along it.
    #[must_use]
    pub(crate) fn segments(&self, longest_m: f64) -> Vec<EdgeSegment> {
        let count = (self.length_m / longest_m).ceil().max(1.0) as usize;
        let half_m = 0.5 * self.length_m / count as f64;
        let segment = |index: usize| {
            let arc_m = ((index as f64 + 0.5) / count as f64 - 0.5) * self.length_m;
            let piece = self.piece_at(arc_m);
            let [from, to] = [arc_m - half_m, arc_m + half_m].map(|arc_m| self.piece_at(arc_m).at(arc_m));
            // A segment that folds back within its own length may have no chord, or none that cuts.
            let chord = (to - from).try_normalize(half_m).filter(|chord| chord.y.abs() < STEEPEST);
            EdgeSegment {
                middle_m: piece.at(arc_m),
                frame: BladeFrame::of_tangent(chord.unwrap_or(piece.along)),
                clearance_m: 0.0,
                length_m: 2.0 * half_m,
                from_end_m: 0.5 * self.length_m - arc_m.abs(),
            }
        };
        (0..count).map(segment).collect()
    }

    /// Equal segments, no longer than `longest_m`, of an end of the edge up to a spine `height_m` above it: in the order
    /// in which they follow on the edge's, round the outline. The cut that an edge makes ends at the outline, and tissue
    /// that works to and fro by a little does not press on the end of a blade that only comes down: its segments touch
    /// half a segment later, where the last one of the edge stands too.
    pub(crate) fn end_segments(&self, end: EdgeEnd, height_m: f64, longest_m: f64) -> Vec<EdgeSegment> {
        let (point_m, frame) = self.end(end);
        let count = (height_m / longest_m).ceil().max(1.0) as usize;
        let length_m = height_m / count as f64;
        let clearance_m = 0.5 * longest_m.min(0.5 * self.length_m);
        let segment = |index: usize| {
            let from_edge_m = (index as f64 + 0.5) * length_m;
            let from_end_m = from_edge_m.min(height_m - from_edge_m);
            let middle_m = point_m + Vec3::y() * from_edge_m - frame.forward * clearance_m;
            EdgeSegment { middle_m, frame, clearance_m, length_m, from_end_m }
        };
        let up = (0..count).map(segment);
        match end {
            EdgeEnd::First => up.rev().collect(),
            EdgeEnd::Last => up.collect(),
        }
    }

    /// Where an end is, m, and the directions in which it cuts: out of the blade, in its surface.
    fn end(&self, end: EdgeEnd) -> (Vec3, BladeFrame) {
        let (point, piece, along) = match end {
            EdgeEnd::First => (self.points_m.first(), self.pieces.first(), -Vec3::y()),
            EdgeEnd::Last => (self.points_m.last(), self.pieces.last(), Vec3::y()),
        };
        let tangent = piece.map_or(Vec3::x(), |piece| piece.along);
        let level = (tangent - Vec3::y() * tangent.y).normalize() * along.y;
        (point.copied().unwrap_or_default(), BladeFrame { along, forward: level, normal: level.cross(&along) })
    }
}
