//! What tools do over time: tracks of poses, interpolated.

pub mod csv;
pub mod strokes;

use nalgebra::{UnitQuaternion, Vector3};

/// Longest script: an hour of a load test, with room for an overnight one.
pub const MAX_DURATION_S: f64 = 24.0 * 3600.0;

/// A script cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum ScriptError {
    /// A line of a CSV file is not valid.
    #[error("line {line}: {message}")]
    Line {
        /// Line of the file, the header being line 1.
        line: u64,
        /// The field, the value and what is wrong with it.
        message: String,
    },
    /// A parameter is outside its limits.
    #[error("{0}")]
    Parameter(String),
    /// A stroke would meet no tissue.
    #[error("no tissue below stroke {stroke} at x = {x_m:.4} m, z = {z_m:.4} m")]
    NoTissue {
        /// Stroke, from 1.
        stroke: u32,
        /// Where it was to begin, m.
        x_m: f64,
        /// Where it was to begin, m.
        z_m: f64,
    },
}

/// Pose of a tool in the scene frame; `kerf/v1/types.proto` defines the tool frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Reference point, m.
    pub position_m: Vector3<f64>,
    /// Rotation from the tool frame to the scene frame.
    pub orientation: UnitQuaternion<f64>,
}

/// A pose at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Key {
    /// Time since the script's start, s.
    pub time_s: f64,
    /// The pose then.
    pub pose: Pose,
    /// Share of their full opening that the tool's jaws take then, 0 (closed) to 1.
    pub opening: f64,
}

/// What one tool does.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// The tool, an index into the scene's.
    pub tool_id: u32,
    /// At least one, times ascending.
    pub keys: Vec<Key>,
}

/// Height of the undeformed surface below the tools from a time on, the datum of depths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Datum {
    /// Time since the script's start, s.
    pub from_s: f64,
    /// Height, m, scene frame.
    pub height_m: f64,
}

/// What the tools do.
#[derive(Clone, Debug, PartialEq)]
pub struct Script {
    /// One per tool, at least one.
    pub tracks: Vec<Track>,
    /// At least one, times ascending.
    pub datums: Vec<Datum>,
}

impl Track {
    /// The pose at a time, linear and by slerp between keys; `None` before the first key and after
    /// the last one, when the tool is lifted.
    #[must_use]
    pub fn pose_at(&self, time_s: f64) -> Option<Pose> {
        self.key_at(time_s).map(|key| key.pose)
    }

    /// The pose and the opening at a time, as in [`Self::pose_at`]; the opening is linear between keys.
    #[must_use]
    pub fn key_at(&self, time_s: f64) -> Option<Key> {
        let after = self.keys.partition_point(|key| key.time_s <= time_s);
        let from = self.keys.get(after.checked_sub(1)?)?;
        match self.keys.get(after) {
            Some(to) => Some(interpolate(from, to, time_s)),
            None => (from.time_s == time_s).then_some(*from),
        }
    }

    /// Greatest speed of the reference point, m/s.
    #[must_use]
    pub fn max_speed_m_per_s(&self) -> f64 {
        self.keys.windows(2).fold(0.0, |max, pair| {
            let distance_m = (pair[1].pose.position_m - pair[0].pose.position_m).norm();
            f64::max(max, distance_m / (pair[1].time_s - pair[0].time_s))
        })
    }
}

impl Script {
    /// Time of the last key, s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.tracks.iter().filter_map(|track| track.keys.last()).fold(0.0, |max, key| f64::max(max, key.time_s))
    }

    /// Greatest speed of any tool's reference point, m/s.
    #[must_use]
    pub fn max_speed_m_per_s(&self) -> f64 {
        self.tracks.iter().map(Track::max_speed_m_per_s).fold(0.0, f64::max)
    }

    /// The track of a tool.
    #[must_use]
    pub fn track(&self, tool_id: u32) -> Option<&Track> {
        self.tracks.iter().find(|track| track.tool_id == tool_id)
    }

    /// How far a pose's reference point is below the undeformed surface, m.
    #[must_use]
    pub fn depth_m(&self, time_s: f64, pose: &Pose) -> f64 {
        let after = self.datums.partition_point(|datum| datum.from_s <= time_s);
        self.datums[after.saturating_sub(1)].height_m - pose.position_m.y
    }
}

/// Index of a tool that is given by its name or its index.
///
/// # Errors
/// There is no such tool; the ones there are are named.
pub fn tool_id(tool: &str, names: &[String]) -> Result<u32, ScriptError> {
    let by_name = names.iter().position(|name| name == tool);
    let by_index = || tool.parse().ok().filter(|&index: &usize| index < names.len());
    let index = by_name.or_else(by_index);
    let index = index.ok_or_else(|| ScriptError::Parameter(format!("tool {tool:?} is not one of {names:?}")))?;
    Ok(index as u32)
}

fn interpolate(from: &Key, to: &Key, time_s: f64) -> Key {
    let share = (time_s - from.time_s) / (to.time_s - from.time_s);
    let (a, b) = (&from.pose, &to.pose);
    // Half a turn has no shortest way; the tool then turns at once, at the key.
    let orientation = a.orientation.try_slerp(&b.orientation, share, 1e-9).unwrap_or(a.orientation);
    let pose = Pose { position_m: a.position_m.lerp(&b.position_m, share), orientation };
    Key { time_s, pose, opening: from.opening + share * (to.opening - from.opening) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(time_s: f64, x_m: f64, angle_rad: f64) -> Key {
        let orientation = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), angle_rad);
        Key { time_s, pose: Pose { position_m: Vector3::new(x_m, 0.0, 0.0), orientation }, opening: 1.0 }
    }

    #[test]
    fn poses_between_keys_are_linear_and_slerped() {
        let track = Track { tool_id: 0, keys: vec![key(1.0, 0.0, 0.0), key(3.0, 0.4, 1.0)] };
        let pose = track.pose_at(1.5).expect("within the track");
        assert!((pose.position_m.x - 0.1).abs() < 1e-15);
        assert!((pose.orientation.angle() - 0.25).abs() < 1e-12);
        assert!((track.max_speed_m_per_s() - 0.2).abs() < 1e-15);
    }

    #[test]
    fn tool_is_lifted_outside_its_track() {
        let track = Track { tool_id: 0, keys: vec![key(1.0, 0.0, 0.0), key(3.0, 0.4, 1.0)] };
        assert_eq!(track.pose_at(0.999), None);
        assert!(track.pose_at(1.0).is_some());
        assert!(track.pose_at(3.0).is_some());
        assert_eq!(track.pose_at(3.001), None);
    }

    #[test]
    fn depth_is_measured_from_the_datum_in_force() {
        let datums = vec![Datum { from_s: 0.0, height_m: 0.05 }, Datum { from_s: 2.0, height_m: 0.03 }];
        let script = Script { tracks: vec![], datums };
        let pose = Pose { position_m: Vector3::new(0.0, 0.02, 0.0), orientation: UnitQuaternion::identity() };
        assert!((script.depth_m(1.0, &pose) - 0.03).abs() < 1e-15);
        assert!((script.depth_m(2.0, &pose) - 0.01).abs() < 1e-15);
    }
}
