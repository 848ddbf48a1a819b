//! The crack of a body: where its cuts end, to a fraction of a voxel, whoever drives them.
//!
//! Links say which voxels a cut has gone between, and not how far beyond the last of them it stands. A crack keeps that
//! as ends: pieces of front, about as long as what a marker of an edge cuts. An end stays where it is along the front and
//! goes on with the cut, under whichever blade, or tension, drives it. A blade that comes to an end from behind is in a
//! cut up to there; one that comes from ahead has to cut up to there, whichever links have parted. What has been cut is
//! therefore paid once.

use crate::Vec3;
use crate::body::Body;
use crate::grow::make_room;
use crate::math::Aabb;
use serde::{Deserialize, Serialize};

/// How far ahead and behind an end is looked for, in voxels: beyond the link ahead, which a front that has not parted it
/// cannot have passed. Ours.
const REACH_VOXELS: f64 = 1.5;
/// No end farther away than this along any axis is crossed, in voxels: an end reaches no farther than a voxel and a half to
/// each side, six times what its part of an edge is long.
const FAR_VOXELS: f64 = 2.0 + REACH_VOXELS + BESIDE_VOXELS;
/// An end farther than this beside the plane of a blade is of another cut, in voxels: links tell cuts apart that are one
/// voxel apart.
const BESIDE_VOXELS: f64 = 0.5;
/// A front that is no farther off along the edge, in voxels, may have parted the link ahead. Ours: links part where a front
/// passes the middle of their column of voxels.
const ASIDE_VOXELS: f64 = 1.0;
/// How far past its own ends a piece of front is taken to go on, over half its length, where no other covers what is
/// beyond: above what two strokes differ by in how far they stretch tissue along the edge. Ours. Beyond a bend of an edge
/// a front is not where its neighbour's would go on.
const BEYOND: f64 = 1.1;
/// Least share of an end's length across a way for the way to cross it: a steeper one runs along it.
const LEAST_ACROSS: f64 = 0.5;
/// A front that is nearer than this to an end is at it, in voxels: above rounding.
pub(super) const AT_VOXELS: f64 = 1e-6;
/// Ends per voxel edge of what tension opens: as many as there are markers to a voxel.
const ENDS_PER_VOXEL: f64 = 2.0;

/// A piece of front, reference configuration.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct End {
    /// Its middle, m.
    position_m: Vec3,
    /// From its middle to where it ends along the front, m.
    half_m: Vec3,
    /// Unit direction in which the cut goes on.
    ahead: Vec3,
}

/// The ends of a body's cuts, in the order in which they were made.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Crack {
    ends: Vec<End>,
    /// Ends near the front that is looked at: scratch, kept between steps.
    #[serde(skip)]
    near: Vec<u32>,
}

/// The way of a marker through the material, reference configuration.
#[derive(Clone, Copy, Debug)]
pub(super) struct Way {
    /// Where it begins, m.
    pub(super) position_m: Vec3,
    /// Unit direction of the way.
    pub(super) ahead: Vec3,
    /// Unit direction of the front, across the way.
    pub(super) along: Vec3,
}

impl Way {
    /// Of a front along `along`, as far as that is across the way.
    pub(super) fn new(position_m: Vec3, ahead: Vec3, along: &Vec3) -> Self {
        let across = along - ahead * along.dot(&ahead);
        Self { position_m, ahead, along: across.normalize() }
    }

    /// What an offset is along the front, ahead, and beside the plane of the two, m.
    fn components_m(&self, offset_m: &Vec3) -> [f64; 3] {
        [self.along, self.ahead, self.ahead.cross(&self.along)].map(|axis| offset_m.dot(&axis))
    }

    /// Where an end crosses it nearby: how far ahead, m, and how far from the end's middle, over half of its length.
    fn crosses(&self, end: &End, voxel_size_m: f64) -> Option<(f64, f64)> {
        self.meets(end, voxel_size_m).filter(|(ahead_m, _)| ahead_m.abs() <= REACH_VOXELS * voxel_size_m)
    }

    /// The same however far ahead or behind.
    fn meets(&self, end: &End, voxel_size_m: f64) -> Option<(f64, f64)> {
        let to = end.position_m - self.position_m;
        let aside_m = to.dot(&self.along);
        let half_m = end.half_m.dot(&self.along);
        if aside_m.abs() > BEYOND * half_m.abs() || half_m.abs() < LEAST_ACROSS * end.half_m.norm() {
            return None;
        }
        let from_middle = -aside_m / half_m;
        let [_, ahead_m, beside_m] = self.components_m(&(to + end.half_m * from_middle));
        (beside_m.abs() <= BESIDE_VOXELS * voxel_size_m).then_some((ahead_m, from_middle.abs()))
    }

    /// How far ahead an end is that goes the same way beside it, m.
    fn has_beside(&self, end: &End, voxel_size_m: f64) -> Option<f64> {
        let [aside_m, ahead_m, beside_m] = self.components_m(&(end.position_m - self.position_m));
        let near = ahead_m.abs() <= REACH_VOXELS * voxel_size_m
            && aside_m.abs() <= ASIDE_VOXELS * voxel_size_m
            && beside_m.abs() <= BESIDE_VOXELS * voxel_size_m;
        (near && end.ahead.dot(&self.ahead) > 0.0).then_some(ahead_m)
    }
}

/// What a marker finds on its way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct OnWay {
    /// How far ahead the cut that the marker is in ends, m: behind it where it has gone beyond.
    pub(super) front_m: Option<f64>,
    /// How far ahead a cut ends that comes the other way, m.
    pub(super) facing_m: Option<f64>,
    /// How far ahead the farthest end is that goes the same way, up to a voxel beside the way, m.
    pub(super) farthest_m: Option<f64>,
}

/// A straight piece of a front that has gone on, reference configuration.
#[derive(Clone, Copy, Debug)]
pub(super) struct Span {
    pub(super) from_m: Vec3,
    pub(super) to_m: Vec3,
    /// Unit direction in which it went.
    pub(super) ahead: Vec3,
    /// How far it went in the step, m.
    pub(super) went_m: f64,
}

impl Crack {
    /// Whether nothing is cut.
    pub(super) fn is_empty(&self) -> bool {
        self.ends.is_empty()
    }

    /// Room for so many more ends.
    pub(crate) fn reserve(&mut self, more: usize) {
        let count = self.ends.len() + more;
        make_room(&mut self.ends, count);
        make_room(&mut self.near, count);
    }

    /// What of the crack lies on a way.
    pub(super) fn on_way(&self, way: &Way, voxel_size_m: f64) -> OnWay {
        let mut found = OnWay::default();
        // The farther of those whose own length the way crosses; else the one that it passes nearest.
        let mut beyond = [f64::INFINITY; 2];
        // Most ends of a body that is much cut are far away.
        let is_far = |end: &End| (end.position_m - way.position_m).amax() > FAR_VOXELS * voxel_size_m;
        for end in self.ends.iter().filter(|end| !is_far(end)) {
            if let Some(ahead_m) = way.has_beside(end, voxel_size_m) {
                found.farthest_m = Some(found.farthest_m.map_or(ahead_m, |farthest_m| ahead_m.max(farthest_m)));
            }
            let Some((ahead_m, from_middle)) = way.crosses(end, voxel_size_m) else { continue };
            let faces = end.ahead.dot(&way.ahead) < 0.0;
            let (best, best_beyond) = match faces {
                true => (&mut found.facing_m, &mut beyond[1]),
                false => (&mut found.front_m, &mut beyond[0]),
            };
            let past = (from_middle - 1.0).max(0.0);
            let is_better = past < *best_beyond || past == 0.0 && best.is_none_or(|best| ahead_m > best);
            if is_better {
                (*best, *best_beyond) = (Some(ahead_m), past);
            }
        }
        // An end that a front has left behind beside the way, as at a side of the object, says nothing where the cut of the
        // way itself has gone on.
        if found.front_m.is_none() && found.farthest_m.is_some() && self.ends_beyond(way, voxel_size_m) {
            found.farthest_m = None;
        }
        found
    }

    /// Whether a cut that goes the same way ends ahead on it, however far.
    fn ends_beyond(&self, way: &Way, voxel_size_m: f64) -> bool {
        let is_beyond = |end: &End| way.meets(end, voxel_size_m).is_some_and(|(ahead_m, _)| ahead_m > 0.0);
        self.ends.iter().any(|end| end.ahead.dot(&way.ahead) > 0.0 && is_beyond(end))
    }

    /// An end where a front stands that has none yet; `half_m` along it to each side.
    pub(super) fn begin(&mut self, way: &Way, half_m: f64) {
        self.ends.push(End { position_m: way.position_m, half_m: way.along * half_m, ahead: way.ahead });
    }

    /// Takes the ends along that a front has passed. One that it meets is gone, and its own with it: there is nothing
    /// left between the two.
    pub(super) fn follow(&mut self, body: &Body, spans: &[Span]) {
        if spans.is_empty() || self.ends.is_empty() {
            return;
        }
        let grid = &body.state.grid;
        let (at_m, voxel_size_m) = (AT_VOXELS * grid.voxel_size_m(), grid.voxel_size_m());
        let farthest_m = spans.iter().map(|span| span.went_m).fold(REACH_VOXELS * voxel_size_m, f64::max);
        let around = Aabb::around(spans.iter().flat_map(|span| [span.from_m, span.to_m])).grown(2.0 * farthest_m);
        self.near.clear();
        let is_near = |end: &End| around.contains(&end.position_m);
        self.near.extend(self.ends.iter().enumerate().filter(|(_, end)| is_near(end)).map(|(index, _)| index as u32));
        for span in spans {
            let mut has_met = false;
            for index in &self.near {
                let end = &mut self.ends[*index as usize];
                let Some(passed_m) = span.passed_m(end, voxel_size_m) else { continue };
                if end.ahead.dot(&span.ahead) < 0.0 {
                    has_met |= passed_m > -at_m;
                } else if passed_m > 0.0 {
                    end.go_on(span, passed_m);
                }
            }
            for index in self.near.iter().filter(|_| has_met) {
                let end = &mut self.ends[*index as usize];
                if span.passed_m(end, voxel_size_m).is_some_and(|passed_m| passed_m > -at_m) {
                    end.half_m = Vec3::zeros();
                }
            }
        }
        // Those that were met, and those that have come out of the object.
        let mut some_gone = false;
        for index in &self.near {
            let end = &mut self.ends[*index as usize];
            if grid.signed_distance_m(&end.position_m) >= 0.0 {
                end.half_m = Vec3::zeros();
            }
            some_gone |= end.half_m == Vec3::zeros();
        }
        if some_gone {
            self.ends.retain(|end| end.half_m != Vec3::zeros());
        }
    }

    /// Tension has opened a strip from the line `way` begins on, `reach_m` along it to each side, by `length_m`. Ends in
    /// it are where it ends now. Returns what of the strip's area had been cut already, m^2, less what a cut ended short of
    /// it.
    pub(super) fn tear(&mut self, body: &Body, way: &Way, reach_m: [f64; 2], length_m: f64) -> f64 {
        let voxel_size_m = body.state.grid.voxel_size_m();
        let [low_m, high_m] = reach_m;
        let (mut cut_m2, mut width_m) = (0.0, 0.0);
        self.ends.retain(|end| {
            let [aside_m, ahead_m, beside_m] = way.components_m(&(end.position_m - way.position_m));
            let is_in = (low_m..=high_m).contains(&aside_m)
                && (-voxel_size_m..=length_m).contains(&ahead_m)
                && beside_m.abs() <= BESIDE_VOXELS * voxel_size_m
                && end.ahead.dot(&way.ahead) > 0.0;
            if is_in {
                let end_m = 2.0 * end.half_m.dot(&way.along).abs();
                cut_m2 += end_m * ahead_m;
                width_m += end_m;
            }
            !is_in
        });
        let count = (ENDS_PER_VOXEL * (high_m - low_m) / voxel_size_m).ceil().max(1.0);
        let half_m = 0.5 * (high_m - low_m) / count;
        for index in 0..count as u32 {
            let aside_m = low_m + half_m * f64::from(2 * index + 1);
            let position_m = way.position_m + way.along * aside_m + way.ahead * length_m;
            if body.state.grid.signed_distance_m(&position_m) < 0.0 {
                self.begin(&Way { position_m, ..*way }, half_m);
            }
        }
        if width_m > 0.0 { cut_m2 / width_m * (high_m - low_m) } else { 0.0 }
    }
}

impl End {
    /// Goes on to where the front is.
    fn go_on(&mut self, span: &Span, by_m: f64) {
        self.position_m += span.ahead * by_m;
        self.half_m = (span.to_m - span.from_m).normalize() * self.half_m.norm();
        self.ahead = span.ahead;
    }
}

impl Span {
    /// How far ahead of an end the front is now, m; none where it was not beside it in the step.
    fn passed_m(&self, end: &End, voxel_size_m: f64) -> Option<f64> {
        let to = end.position_m - self.from_m;
        let length = self.to_m - self.from_m;
        let along = length - self.ahead * length.dot(&self.ahead);
        if end.half_m.dot(&along).abs() < LEAST_ACROSS * end.half_m.norm() * along.norm() {
            return None;
        }
        let share = to.dot(&along) / along.norm_squared();
        if !(-AT_VOXELS..=1.0 + AT_VOXELS).contains(&share) {
            return None;
        }
        let passed = length * share - to;
        let passed_m = passed.dot(&self.ahead);
        let beside_m = (passed - self.ahead * passed_m).norm();
        let reach_m = self.went_m + REACH_VOXELS * voxel_size_m;
        (beside_m <= BESIDE_VOXELS * voxel_size_m && passed_m.abs() <= reach_m).then_some(passed_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCENE: &str = r#"
version = 1
name = "bar"
[[objects]]
name = "bar"
shape = { box = { min_m = [0.0, 0.0, 0.0], max_m = [0.08, 0.04, 0.02] } }
voxel_size_m = 0.005
material = { young_modulus_pa = 1e5, poisson_ratio = 0.4 }
"#;
    const H_M: f64 = 0.005;

    /// A cut across the bar's width that goes along x, 21.5 mm in, in two ends.
    fn cut_bar() -> (Body, Crack, Way) {
        let body = Body::of_text(SCENE);
        let way = Way::new(Vec3::new(0.0215, 0.021, 0.01), Vec3::x(), &Vec3::z());
        let mut crack = Crack::default();
        for z in [0.005, 0.015] {
            crack.begin(&Way { position_m: Vec3::new(0.0215, 0.021, z), ..way }, 0.005);
        }
        (body, crack, way)
    }

    /// A way along x, or against it, from a place.
    fn from_m(x: f64, ahead: f64) -> Way {
        Way::new(Vec3::new(x, 0.0212, 0.008), Vec3::x() * ahead, &Vec3::z())
    }

    #[test]
    fn a_cut_ends_at_one_place_from_behind_and_from_ahead() {
        let (_, crack, _) = cut_bar();
        let near = |found: Option<f64>, wanted: f64| (found.unwrap() - wanted).abs() < 1e-12;
        let behind = crack.on_way(&from_m(0.0185, 1.0), H_M);
        assert!(near(behind.front_m, 0.003) && behind.facing_m.is_none(), "{behind:?}");
        let ahead = crack.on_way(&from_m(0.0255, -1.0), H_M);
        assert!(near(ahead.facing_m, 0.004) && ahead.front_m.is_none(), "{ahead:?}");
        assert_eq!(crack.on_way(&from_m(0.005, 1.0), H_M), OnWay::default(), "too far to tell");
    }

    #[test]
    fn an_end_that_was_left_behind_beside_a_cut_says_nothing_of_it() {
        let (_, mut crack, way) = cut_bar();
        let beside = from_m(0.0185, 1.0);
        // A short end near the bar's side, and the cut's own ends far ahead.
        crack.ends.iter_mut().for_each(|end| end.position_m.x = 0.06);
        crack.begin(&Way { position_m: Vec3::new(0.0215, 0.021, 0.0115), ..way }, 0.001);
        assert_eq!(crack.on_way(&beside, H_M), OnWay::default());
        crack.ends.retain(|end| end.position_m.x < 0.06);
        assert!(crack.on_way(&beside, H_M).farthest_m.is_some(), "that of a neighbour which cuts first");
    }

    #[test]
    fn what_tension_opens_is_what_no_blade_had_cut_and_a_blade_goes_on_from_there() {
        let (body, mut crack, way) = cut_bar();
        // A strip of 10 mm from the line between the last parted links and the next, 20 mm in: 1.5 mm of it is cut.
        let from = Way { position_m: Vec3::new(0.02, 0.021, 0.01), ..way };
        let cut_m2 = crack.tear(&body, &from, [-0.01, 0.01], 0.01);
        assert!((cut_m2 - 0.02 * 0.0015).abs() < 1e-12, "{cut_m2} of it had been cut");
        let found = crack.on_way(&from_m(0.0285, 1.0), H_M);
        assert!((found.front_m.unwrap() - 0.0015).abs() < 1e-12, "{found:?}");
        assert_eq!(crack.on_way(&from_m(0.0185, 1.0), H_M).front_m, None, "the end has gone on");
    }

    #[test]
    fn fronts_that_meet_leave_nothing() {
        let (body, mut crack, _) = cut_bar();
        let span = |x: f64, went_m: f64| Span {
            from_m: Vec3::new(x, 0.021, 0.0),
            to_m: Vec3::new(x, 0.021, 0.02),
            ahead: -Vec3::x(),
            went_m,
        };
        crack.follow(&body, &[span(0.022, 0.001)]);
        assert!(!crack.is_empty(), "half a millimetre holds");
        crack.follow(&body, &[span(0.0214, 0.0006)]);
        assert!(crack.is_empty());
    }
}
