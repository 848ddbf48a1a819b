//! A blade as a body: the surface that its edge rules along the tool's +y, thickened.

use crate::Vec3;
use crate::math::Aabb;
use crate::tool::Pose;
use crate::tool::blade::Blade;

/// Segments that are looked at together: where a point is far from all of them, one distance tells.
const SEGMENTS_PER_GROUP: usize = 16;
/// For rounding, where a line passes through the end of a group.
const MARGIN: f64 = 1.0 + 1e-9;

/// A blade at its pose, scene frame. The edge is a chain of points; between two of them the flanks are
/// the parallelogram `edge + t * up`, with material on either side of it up to [`BladeBody::half_width_m`].
///
/// Where the edge bends the flanks of its segments meet without a mitre: a blade is thin against the
/// radius it bends with.
#[derive(Clone, Debug, Default)]
pub struct BladeBody {
    /// Edge points in order, m.
    edge_m: Vec<Vec3>,
    segments: Vec<Segment>,
    /// By [`SEGMENTS_PER_GROUP`] segments.
    groups: Vec<Group>,
    /// Most length of a segment over its part across `up`.
    steepest: f64,
    /// Spine direction, unit.
    up: Vec3,
    height_m: f64,
    edge_half_width_m: f64,
    thickness_m: f64,
    /// Height over which the edge widens to the thickness, m.
    bevel_m: f64,
}

/// Coordinates of a point beside a segment of the edge.
#[derive(Clone, Copy, Debug)]
pub struct Foot {
    /// Length of the edge up to the point's foot, m; beyond the ends it is less than zero or more than
    /// the edge's length.
    pub arc_m: f64,
    /// Height above the edge, m.
    pub height_m: f64,
    /// Distance from the ruled surface along [`Foot::normal`], m.
    pub beside_m: f64,
    /// Distance from the nearest segment, square root of the squares beyond its ends and beside it, m.
    pub apart_m: f64,
    /// Normal of the ruled surface, unit: along x up, the tool's +z for a straight edge.
    pub normal: Vec3,
}

/// Where a line passes through the ruled surface.
#[derive(Clone, Copy, Debug)]
pub struct Passage {
    /// Fraction of the way from the line's beginning to its end.
    pub share: f64,
    /// Length of the edge up to there, m.
    pub arc_m: f64,
    /// Height above the edge, m.
    pub height_m: f64,
}

/// A segment of the edge: its beginning, its vector over the square of its part across `up`, its
/// normal, and the edge's length before it and in it.
#[derive(Clone, Debug)]
struct Segment {
    from_m: Vec3,
    per_length: Vec3,
    slope: f64,
    normal: Vec3,
    before_m: f64,
    length_m: f64,
}

/// Segments are no farther than `reach_m` from the line along `up` through `middle_m`.
#[derive(Clone, Debug)]
struct Group {
    middle_m: Vec3,
    reach_m: f64,
}

impl BladeBody {
    /// Puts a blade where it is now.
    pub fn place(&mut self, blade: &Blade, pose: &Pose) {
        self.edge_m.clear();
        self.edge_m.extend(blade.edge.points_m().iter().map(|point| pose.transform(point)));
        self.up = pose.orientation * Vec3::y();
        self.rule();
        self.height_m = blade.flanks.height_m();
        self.edge_half_width_m = blade.edge_half_width_m;
        self.thickness_m = blade.flanks.thickness_m();
        self.bevel_m = blade.flanks.wedge_height_m().unwrap_or(self.thickness_m);
    }

    /// Spine direction, unit, scene frame; the blade cuts against it.
    #[must_use]
    pub fn up(&self) -> Vec3 {
        self.up
    }

    /// Length of the edge, m.
    #[must_use]
    pub(crate) fn edge_length_m(&self) -> f64 {
        self.segments.last().map_or(0.0, |last| last.before_m + last.length_m)
    }

    /// Half of the thickness at a height above the edge, m. Where no wedge is stated the edge widens to the
    /// blade over a height equal to its thickness: a cutting angle of a knife, of which the mechanics knows nothing.
    #[must_use]
    pub(crate) fn half_width_m(&self, height_m: f64) -> f64 {
        let behind = (0.5 * self.thickness_m).max(self.edge_half_width_m);
        let share = if self.bevel_m > 0.0 { (height_m / self.bevel_m).clamp(0.0, 1.0) } else { 1.0 };
        self.edge_half_width_m + share * (behind - self.edge_half_width_m)
    }

    /// The box around the blade and `margin_m` more.
    #[must_use]
    pub fn around(&self, margin_m: f64) -> Aabb {
        let spine = self.up * self.height_m;
        Aabb::around(self.edge_m.iter().flat_map(|point| [*point, point + spine])).grown(margin_m)
    }

    /// A point of the edge, m; held to its ends.
    #[must_use]
    pub(crate) fn edge_point_m(&self, arc_m: f64) -> Vec3 {
        let arc_m = arc_m.max(0.0);
        let ends = self.edge_m.windows(2).zip(&self.segments);
        let mut reached = ends.filter(|(_, segment)| arc_m <= segment.before_m + segment.length_m);
        match reached.next() {
            Some((ends, segment)) => ends[0].lerp(&ends[1], (arc_m - segment.before_m) / segment.length_m),
            None => self.edge_m.last().copied().unwrap_or_default(),
        }
    }

    /// Sets up the segments that the edge rules.
    fn rule(&mut self) {
        let (up, mut before_m) = (self.up, 0.0);
        self.segments.clear();
        self.segments.extend(self.edge_m.windows(2).map(|ends| {
            let along = ends[1] - ends[0];
            let length_m = along.norm();
            let rise = along.dot(&up);
            let across = along - up * rise;
            let segment = Segment {
                from_m: ends[0],
                per_length: across * (length_m / across.norm_squared()),
                slope: rise / length_m,
                normal: across.cross(&up).normalize(),
                before_m,
                length_m,
            };
            before_m += length_m;
            segment
        }));
        self.steepest = self.segments.iter().map(|segment| segment.per_length.norm()).fold(1.0, f64::max);
        self.groups.clear();
        let count = self.segments.len();
        self.groups.extend((0..count).step_by(SEGMENTS_PER_GROUP).map(|first| {
            let points = &self.edge_m[first..=(first + SEGMENTS_PER_GROUP).min(count)];
            let middle_m = points.iter().sum::<Vec3>() / points.len() as f64;
            let reach_m = points.iter().map(|point| across_m(&(point - middle_m), &up)).fold(0.0, f64::max);
            Group { middle_m, reach_m }
        }));
    }

    /// The segments of groups, with the number of the first, in order.
    fn grouped(&self) -> impl Iterator<Item = (&Group, usize, &[Segment])> {
        let chunks = self.segments.chunks(SEGMENTS_PER_GROUP).enumerate();
        self.groups.iter().zip(chunks).map(|(group, (index, segments))| (group, index * SEGMENTS_PER_GROUP, segments))
    }

    /// The coordinates of a point beside the segment it is nearest to, if one is within `reach_m`.
    #[must_use]
    pub fn foot(&self, point_m: &Vec3, reach_m: f64) -> Option<Foot> {
        let last = self.segments.len().saturating_sub(1);
        let mut nearest: Option<(usize, Foot)> = None;
        let mut least2 = reach_m * reach_m;
        for (group, first, segments) in self.grouped() {
            let away_m = (across_m(&(point_m - group.middle_m), &self.up) - group.reach_m).max(0.0);
            if away_m * away_m > least2 {
                continue;
            }
            for (index, segment) in segments.iter().enumerate() {
                let foot = segment.foot(point_m, &self.up);
                let along = foot.arc_m - segment.before_m;
                let outside = (-along).max(along - segment.length_m).max(0.0);
                let distance2 = outside * outside + foot.beside_m * foot.beside_m;
                if distance2 < least2 {
                    (least2, nearest) = (distance2, Some((first + index, foot)));
                }
            }
        }
        let (index, foot) = nearest?;
        let segment = &self.segments[index];
        // Only the ends of the edge go on beyond themselves.
        let held = (foot.arc_m - segment.before_m).clamp(
            if index == 0 { f64::NEG_INFINITY } else { 0.0 },
            if index == last { f64::INFINITY } else { segment.length_m },
        );
        Some(Foot { arc_m: segment.before_m + held, apart_m: least2.sqrt(), ..foot })
    }

    /// Whether a line of this length that begins at a foot may pass through the ruled surface.
    #[must_use]
    pub(crate) fn may_pass(&self, foot: &Foot, length_m: f64) -> bool {
        foot.apart_m <= self.steepest * length_m * MARGIN
    }

    /// Whether a foot is on the ruled surface.
    #[must_use]
    pub(crate) fn is_beside(&self, foot: &Foot) -> bool {
        (0.0..=self.edge_length_m()).contains(&foot.arc_m) && (0.0..=self.height_m).contains(&foot.height_m)
    }

    /// Where the line between two points passes through the ruled surface.
    #[must_use]
    pub fn passage(&self, from_m: &Vec3, to_m: &Vec3) -> Option<Passage> {
        let (middle_m, half_m) = (from_m.lerp(to_m, 0.5), 0.5 * across_m(&(to_m - from_m), &self.up));
        let near =
            |group: &Group| across_m(&(middle_m - group.middle_m), &self.up) <= (group.reach_m + half_m) * MARGIN;
        let groups = self.grouped().filter(|(group, ..)| near(group));
        groups.flat_map(|(.., segments)| segments).find_map(|segment| {
            let [from, to] = [from_m, to_m].map(|point| segment.foot(point, &self.up));
            if (from.beside_m < 0.0) == (to.beside_m < 0.0) {
                return None;
            }
            let share = from.beside_m / (from.beside_m - to.beside_m);
            let arc_m = from.arc_m + share * (to.arc_m - from.arc_m);
            let height_m = from.height_m + share * (to.height_m - from.height_m);
            let within = (0.0..=segment.length_m).contains(&(arc_m - segment.before_m))
                && (0.0..=self.height_m).contains(&height_m);
            within.then_some(Passage { share, arc_m, height_m })
        })
    }

    /// The point of the flank on one side (1: that of the normal, -1: the other) beside a point.
    #[must_use]
    pub(crate) fn flank_point_m(&self, point_m: &Vec3, foot: &Foot, side: f64) -> Vec3 {
        point_m + foot.normal * (side * self.half_width_m(foot.height_m) - foot.beside_m)
    }
}

/// Length of the part of a vector that is across `up`, m.
fn across_m(vector_m: &Vec3, up: &Vec3) -> f64 {
    (vector_m - up * vector_m.dot(up)).norm()
}

impl Segment {
    fn foot(&self, point_m: &Vec3, up: &Vec3) -> Foot {
        let from = point_m - self.from_m;
        let along = from.dot(&self.per_length);
        Foot {
            arc_m: self.before_m + along,
            height_m: from.dot(up) - along * self.slope,
            beside_m: from.dot(&self.normal),
            apart_m: 0.0,
            normal: self.normal,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An edge of three points with a bend in the cutting direction and one aside.
    fn bent() -> BladeBody {
        let mut blade = BladeBody {
            edge_m: vec![Vec3::new(-0.03, 0.0, 0.0), Vec3::new(0.0, -0.01, 0.0), Vec3::new(0.03, 0.0, 0.02)],
            up: Vec3::y(),
            height_m: 0.05,
            edge_half_width_m: 5e-5,
            thickness_m: 2e-3,
            bevel_m: 2e-3,
            ..BladeBody::default()
        };
        blade.rule();
        blade
    }

    #[test]
    fn groups_of_segments_hide_none() {
        let wave = |i: u32| {
            let x = 1e-3 * f64::from(i);
            Vec3::new(x, 2e-3 * (200.0 * x).cos(), 4e-3 * (150.0 * x).sin())
        };
        let place = |groups: bool| {
            let mut blade = BladeBody { edge_m: (0..100).map(wave).collect(), ..bent() };
            blade.rule();
            if !groups {
                blade.groups.iter_mut().for_each(|group| group.reach_m = f64::INFINITY);
            }
            blade
        };
        let [grouped, plain] = [place(true), place(false)];
        assert_eq!(grouped.groups.len(), 7);
        for i in 0..2000 {
            let t = f64::from(i);
            let point = Vec3::new(0.05 + 0.07 * (1.3 * t).sin(), 0.02 * (0.7 * t).sin(), 0.02 * (2.1 * t).cos());
            let to = point + Vec3::new(0.002 * (0.3 * t).sin(), 0.001, 0.006 * (1.9 * t).cos());
            let feet = [&grouped, &plain]
                .map(|blade| blade.foot(&point, f64::INFINITY).map(|foot| (foot.arc_m, foot.beside_m)));
            assert_eq!(feet[0], feet[1]);
            let passages = [&grouped, &plain].map(|blade| blade.passage(&point, &to).map(|p| (p.share, p.arc_m)));
            assert_eq!(passages[0], passages[1]);
            let foot = grouped.foot(&point, f64::INFINITY).expect("the edge has points");
            assert!(passages[0].is_none() || grouped.may_pass(&foot, (to - point).norm()));
            let within = grouped.foot(&point, 0.004).map(|foot| foot.arc_m);
            assert_eq!(within, (foot.apart_m < 0.004).then_some(foot.arc_m));
        }
    }

    #[test]
    fn a_foot_leads_back_to_its_point() {
        let blade = bent();
        for (arc_m, height_m, beside_m) in [(0.01, 0.02, 1e-3), (0.04, 0.001, -2e-3), (0.06, 0.04, 0.0)] {
            let on_edge = blade.edge_point_m(arc_m);
            let normal = blade.foot(&on_edge, f64::INFINITY).expect("the edge has points").normal;
            let point = on_edge + Vec3::y() * height_m + normal * beside_m;
            let foot = blade.foot(&point, f64::INFINITY).expect("the edge has points");
            let found = [foot.arc_m, foot.height_m, foot.beside_m];
            let apart = found.iter().zip([arc_m, height_m, beside_m]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(apart < 1e-12, "{found:?}");
            let flank = blade.flank_point_m(&point, &foot, 1.0);
            let flank_foot = blade.foot(&flank, f64::INFINITY).expect("the edge has points");
            assert!((flank_foot.beside_m - blade.half_width_m(height_m)).abs() < 1e-12);
        }
    }

    #[test]
    fn a_line_passes_where_it_meets_the_ruled_surface_and_nowhere_else() {
        let blade = bent();
        // Through the second segment, halfway, 15 mm above its edge.
        let through = Vec3::new(0.015, 0.01, 0.01);
        let across = Vec3::new(0.001, 0.002, 0.004);
        let passage = blade.passage(&(through - across), &(through + across * 3.0)).expect("it passes");
        assert!((passage.share - 0.25).abs() < 1e-12);
        assert!((passage.height_m - 0.015).abs() < 1e-12);
        assert!((blade.edge_point_m(passage.arc_m) - Vec3::new(0.015, -0.005, 0.01)).norm() < 1e-12);
        let below = Vec3::y() * -0.02;
        assert!(blade.passage(&(through - across + below), &(through + across + below)).is_none());
        assert!(blade.passage(&(through + across), &(through + across * 2.0)).is_none());
        let beyond = Vec3::x() * 0.1;
        assert!(blade.passage(&(through - across + beyond), &(through + across + beyond)).is_none());
    }

    #[test]
    fn the_edge_widens_to_the_blade() {
        let blade = bent();
        assert_eq!((blade.half_width_m(0.0), blade.half_width_m(2e-3), blade.half_width_m(0.03)), (5e-5, 1e-3, 1e-3));
        assert_eq!(BladeBody { thickness_m: 0.0, ..blade }.half_width_m(0.01), 5e-5);
    }
}
