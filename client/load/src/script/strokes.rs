//! The built-in script: strokes side by side, each pressed straight down into virgin tissue.
//!
//! The edge lies along the object's shorter horizontal side and the strokes stand in a row along the
//! longer one, so that each cuts across the object, away from the others. The surface is looked up
//! in the replica, so depth means depth in tissue wherever the object's top is.

use kerf_script::{Key, Pose, Track};
use nalgebra::{UnitQuaternion, Vector3};

use super::{Datum, Script, ScriptError};

/// Fraction of the object's longer side that the strokes are spread over; its ends are thin.
const ROW_SHARE: f64 = 0.7;
/// Where across the object tissue is looked for, in fractions of its shorter side from the middle.
const ACROSS_SHARES: [f64; 7] = [0.0, -0.1, 0.1, -0.2, 0.2, -0.3, 0.3];
/// Fraction of the local thickness that is cut when no depth is given: deep, and off the support.
const DEFAULT_DEPTH_SHARE: f64 = 0.5;
/// Greatest angle of a stroke to the row at full jitter.
const MAX_YAW_JITTER_RAD: f64 = 0.15;
/// Fastest turn of the blade between strokes.
const MAX_TURN_RAD_PER_S: f64 = 1.0;
/// Shorter ways are left out: rounding makes them of poses that are meant to be equal, and times that
/// far apart would be the same number.
const MIN_SEGMENT_S: f64 = 1e-6;
/// Most strokes: they would be less than a voxel apart.
pub const MAX_STROKES: u32 = 1000;

/// What strokes are made from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrokeParams {
    /// Seed of the jitter: the same one gives the same script.
    pub seed: u64,
    /// Number of strokes.
    pub strokes: u32,
    /// Depth of each below the undeformed surface, m; `None`: half the local thickness.
    pub depth_m: Option<f64>,
    /// Speed down into the tissue and out of it, m/s.
    pub cut_speed_m_per_s: f64,
    /// Speed between strokes, m/s.
    pub travel_speed_m_per_s: f64,
    /// Height above the surface at which a stroke begins and ends, m.
    pub clearance_m: f64,
    /// How long the blade rests at the bottom of a stroke, s.
    pub hold_s: f64,
    /// Random fraction of the places and angles, 0 to 1.
    pub jitter: f64,
}

/// The object that is cut, at rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Target {
    /// Lower corner of its bounding box, m, scene frame.
    pub min_m: Vector3<f64>,
    /// Upper corner, m, scene frame.
    pub max_m: Vector3<f64>,
    /// Vertices of its surface's triangles, m, scene frame.
    pub triangles_m: Vec<[Vector3<f64>; 3]>,
}

/// Where one stroke goes.
struct Place {
    /// On the undeformed surface, m.
    surface_m: Vector3<f64>,
    /// Of the blade.
    orientation: UnitQuaternion<f64>,
    depth_m: f64,
}

/// Makes the script of one tool.
///
/// # Errors
/// A parameter outside its limits, or a stroke that would meet no tissue.
pub fn strokes(tool_id: u32, target: &Target, params: &StrokeParams) -> Result<Script, ScriptError> {
    check(params)?;
    let mut random = SplitMix64(params.seed);
    let places = (0..params.strokes)
        .map(|stroke| place(stroke, target, params, &mut random))
        .collect::<Result<Vec<Place>, ScriptError>>()?;
    let travel_height_m = target.max_m.y + params.clearance_m;
    let mut path = Path { keys: Vec::new(), last: None, params };
    let mut datums = Vec::new();
    for place in &places {
        let at = |height_m: f64| Pose {
            position_m: Vector3::new(place.surface_m.x, height_m, place.surface_m.z),
            orientation: place.orientation,
        };
        let surface_height_m = place.surface_m.y;
        path.travel_to(at(travel_height_m));
        datums.push(Datum { from_s: path.time_s(), height_m: surface_height_m });
        path.travel_to(at(surface_height_m + params.clearance_m));
        path.cut_to(at(surface_height_m - place.depth_m));
        path.hold();
        path.cut_to(at(surface_height_m + params.clearance_m));
        path.travel_to(at(travel_height_m));
    }
    let track = Track { tool_id, keys: path.keys }.lifted_at_end();
    Script { tracks: vec![track], datums }.checked()
}

fn check(params: &StrokeParams) -> Result<(), ScriptError> {
    let positive = [
        ("speed", params.cut_speed_m_per_s),
        ("travel speed", params.travel_speed_m_per_s),
        ("depth", params.depth_m.unwrap_or(1.0)),
        ("clearance", params.clearance_m),
    ];
    for (name, value) in positive {
        if !(value.is_finite() && value > 0.0) {
            return Err(ScriptError::Parameter(format!("{name} is {value}, it has to be above 0")));
        }
    }
    if !(1..=MAX_STROKES).contains(&params.strokes) {
        let message = format!("strokes is {}, it has to be within 1 and {MAX_STROKES}", params.strokes);
        return Err(ScriptError::Parameter(message));
    }
    if !(params.hold_s.is_finite() && params.hold_s >= 0.0) {
        return Err(ScriptError::Parameter(format!("hold is {}, it has to be at least 0", params.hold_s)));
    }
    if !(0.0..=1.0).contains(&params.jitter) {
        return Err(ScriptError::Parameter(format!("jitter is {}, it has to be within 0 and 1", params.jitter)));
    }
    Ok(())
}

fn place(stroke: u32, target: &Target, params: &StrokeParams, random: &mut SplitMix64) -> Result<Place, ScriptError> {
    let size_m = target.max_m - target.min_m;
    let middle_m = (target.max_m + target.min_m) / 2.0;
    let (along, across, row_yaw_rad) =
        if size_m.x >= size_m.z { (0, 2, std::f64::consts::FRAC_PI_2) } else { (2, 0, 0.0) };
    let spacing_m = ROW_SHARE * size_m[along] / f64::from(params.strokes);
    // Half a spacing at most, so that neighbours stay apart.
    let in_row = f64::from(stroke) + 0.5 - f64::from(params.strokes) / 2.0 + 0.5 * params.jitter * random.symmetric();
    let yaw_rad = row_yaw_rad + MAX_YAW_JITTER_RAD * params.jitter * random.symmetric();
    let mut foot_m = middle_m;
    foot_m[along] += spacing_m * in_row;
    let thickest = ACROSS_SHARES
        .iter()
        .filter_map(|share| {
            let mut foot_m = foot_m;
            foot_m[across] += share * size_m[across];
            column(&target.triangles_m, foot_m.x, foot_m.z).map(|(low_m, high_m)| (foot_m, low_m, high_m))
        })
        .reduce(|best, other| if other.2 - other.1 > best.2 - best.1 { other } else { best });
    let (foot_m, low_m, high_m) =
        thickest.ok_or(ScriptError::NoTissue { stroke: stroke + 1, x_m: foot_m.x, z_m: foot_m.z })?;
    Ok(Place {
        surface_m: Vector3::new(foot_m.x, high_m, foot_m.z),
        orientation: UnitQuaternion::from_axis_angle(&Vector3::y_axis(), yaw_rad),
        depth_m: params.depth_m.unwrap_or(DEFAULT_DEPTH_SHARE * (high_m - low_m)),
    })
}

/// Lowest and highest point of a surface above and below (x, z), m; `None` where it has none.
fn column(triangles_m: &[[Vector3<f64>; 3]], x_m: f64, z_m: f64) -> Option<(f64, f64)> {
    triangles_m.iter().filter_map(|corners| height_of(corners, x_m, z_m)).fold(None, |range, height_m| match range {
        None => Some((height_m, height_m)),
        Some((low_m, high_m)) => Some((f64::min(low_m, height_m), f64::max(high_m, height_m))),
    })
}

/// Height of a triangle at (x, z), m; `None` beside it, or where it stands upright.
fn height_of([a, b, c]: &[Vector3<f64>; 3], x_m: f64, z_m: f64) -> Option<f64> {
    let cross = |p: &Vector3<f64>, q: &Vector3<f64>| (p.x - x_m) * (q.z - z_m) - (p.z - z_m) * (q.x - x_m);
    let weights = [cross(b, c), cross(c, a), cross(a, b)];
    let inside = weights.iter().all(|w| *w >= 0.0) || weights.iter().all(|w| *w <= 0.0);
    let sum: f64 = weights.iter().sum();
    (inside && sum != 0.0).then(|| (weights[0] * a.y + weights[1] * b.y + weights[2] * c.y) / sum)
}

/// Keys of a track that grows at its end.
struct Path<'a> {
    keys: Vec<Key>,
    /// Time and pose of the last key.
    last: Option<(f64, Pose)>,
    params: &'a StrokeParams,
}

impl Path<'_> {
    fn time_s(&self) -> f64 {
        self.last.map_or(0.0, |(time_s, _)| time_s)
    }

    fn travel_to(&mut self, pose: Pose) {
        self.move_to(pose, self.params.travel_speed_m_per_s);
    }

    fn cut_to(&mut self, pose: Pose) {
        self.move_to(pose, self.params.cut_speed_m_per_s);
    }

    fn move_to(&mut self, pose: Pose, speed_m_per_s: f64) {
        let Some((time_s, from)) = self.last else { return self.push(0.0, pose) };
        let distance_m = (pose.position_m - from.position_m).norm();
        let angle_rad = from.orientation.angle_to(&pose.orientation);
        let duration_s = f64::max(distance_m / speed_m_per_s, angle_rad / MAX_TURN_RAD_PER_S);
        if duration_s > MIN_SEGMENT_S {
            self.push(time_s + duration_s, pose);
        }
    }

    fn hold(&mut self) {
        if let Some((time_s, pose)) = self.last
            && self.params.hold_s > 0.0
        {
            self.push(time_s + self.params.hold_s, pose);
        }
    }

    fn push(&mut self, time_s: f64, pose: Pose) {
        self.keys.push(Key { time_s, placement: Some(pose.into()) });
        self.last = Some((time_s, pose));
    }
}

/// Steele, Lea, Flood, "Fast splittable pseudorandom number generators" (2014): the same numbers
/// on every machine and with every version of every library.
struct SplitMix64(u64);

impl SplitMix64 {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    /// Uniform in -1..1.
    fn symmetric(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PARAMS: StrokeParams = StrokeParams {
        seed: 7,
        strokes: 3,
        depth_m: Some(0.02),
        cut_speed_m_per_s: 0.03,
        travel_speed_m_per_s: 0.1,
        clearance_m: 0.005,
        hold_s: 0.2,
        jitter: 0.5,
    };

    /// A flat box of 0.2 x 0.05 x 0.1 m, top and bottom only: what a vertical ray sees of it.
    fn slab() -> Target {
        let (min_m, max_m) = (Vector3::new(-0.1, 0.0, -0.05), Vector3::new(0.1, 0.05, 0.05));
        let corner = |x: usize, y: f64, z: usize| Vector3::new([min_m.x, max_m.x][x], y, [min_m.z, max_m.z][z]);
        let triangles_m = [min_m.y, max_m.y]
            .iter()
            .flat_map(|&y| {
                let [a, b, c, d] = [corner(0, y, 0), corner(1, y, 0), corner(1, y, 1), corner(0, y, 1)];
                [[a, b, c], [a, c, d]]
            })
            .collect();
        Target { min_m, max_m, triangles_m }
    }

    /// Of the keys.
    fn positions_m(script: &Script) -> Vec<Vector3<f64>> {
        let placements = script.tracks[0].keys.iter().filter_map(|key| key.placement);
        placements.map(|placement| placement.pose.position_m).collect()
    }

    #[test]
    fn same_seed_gives_the_same_script_and_another_one_does_not() {
        let script = strokes(0, &slab(), &PARAMS).expect("valid");
        assert_eq!(script, strokes(0, &slab(), &PARAMS).expect("valid"));
        assert_ne!(script, strokes(0, &slab(), &StrokeParams { seed: 8, ..PARAMS }).expect("valid"));
    }

    #[test]
    fn motion_is_continuous_and_keeps_the_speed_limits() {
        let script = strokes(0, &slab(), &PARAMS).expect("valid");
        assert!(script.max_speed_m_per_s() <= PARAMS.travel_speed_m_per_s * (1.0 + 1e-9));
        let track = &script.tracks[0];
        let dt_s = 1e-3;
        for step in 1..(script.duration_s() / dt_s) as u32 {
            let time_s = f64::from(step) * dt_s;
            let [before, now] = [time_s - dt_s, time_s].map(|time_s| track.at(time_s).expect("within the track").pose);
            let speed_m_per_s = (now.position_m - before.position_m).norm() / dt_s;
            let below = script.depth_m(time_s, &now) > 0.0;
            let limit = if below { PARAMS.cut_speed_m_per_s } else { PARAMS.travel_speed_m_per_s };
            assert!(speed_m_per_s <= limit * (1.0 + 1e-6), "{speed_m_per_s} m/s at {time_s} s");
            assert!(before.orientation.angle_to(&now.orientation) <= MAX_TURN_RAD_PER_S * dt_s * (1.0 + 1e-6));
        }
    }

    #[test]
    fn strokes_reach_their_depth_in_tissue_that_no_other_stroke_has_touched() {
        let script = strokes(0, &slab(), &PARAMS).expect("valid");
        let at_m = positions_m(&script);
        let bottoms: Vec<_> = at_m.iter().filter(|at_m| (at_m.y - 0.03).abs() < 1e-12).collect();
        assert_eq!(bottoms.len(), 6, "each stroke arrives and leaves");
        let xs_m: Vec<f64> = bottoms.iter().step_by(2).map(|at_m| at_m.x).collect();
        let spacing_m = ROW_SHARE * 0.2 / 3.0;
        assert!(xs_m.windows(2).all(|pair| pair[1] - pair[0] >= 0.5 * spacing_m), "{xs_m:?}");
    }

    #[test]
    fn blade_lies_across_the_longer_side() {
        let script = strokes(0, &slab(), &StrokeParams { jitter: 0.0, ..PARAMS }).expect("valid");
        let edge = script.tracks[0].at(0.0).expect("its first key").pose.orientation * Vector3::x();
        assert!(edge.z.abs() > 1.0 - 1e-12);
    }

    #[test]
    fn depth_defaults_to_half_the_thickness() {
        let script = strokes(0, &slab(), &StrokeParams { depth_m: None, ..PARAMS }).expect("valid");
        let lowest_m = positions_m(&script).iter().map(|at_m| at_m.y).fold(1.0, f64::min);
        assert!((lowest_m - 0.025).abs() < 1e-12);
    }

    #[test]
    fn stroke_beside_the_tissue_is_refused() {
        let mut target = slab();
        target.triangles_m.clear();
        let error = strokes(0, &target, &StrokeParams { jitter: 0.0, strokes: 1, ..PARAMS }).expect_err("empty");
        assert_eq!(error.to_string(), "no tissue below stroke 1 at x = 0.0000 m, z = 0.0000 m");
    }

    #[test]
    fn parameters_outside_their_limits_are_refused() {
        let message = |params: StrokeParams| strokes(0, &slab(), &params).expect_err("not valid").to_string();
        assert_eq!(message(StrokeParams { strokes: 0, ..PARAMS }), "strokes is 0, it has to be within 1 and 1000");
        assert_eq!(message(StrokeParams { cut_speed_m_per_s: 0.0, ..PARAMS }), "speed is 0, it has to be above 0");
        assert_eq!(message(StrokeParams { jitter: 1.5, ..PARAMS }), "jitter is 1.5, it has to be within 0 and 1");
    }
}
