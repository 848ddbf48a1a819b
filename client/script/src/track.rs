//! What one tool does: keys, and what lies between them.

use crate::pose::Pose;

/// How a tool that is in the scene is held.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Where it is.
    pub pose: Pose,
    /// Fraction of their full opening that its jaws take, 0 (closed) to 1.
    pub opening: f64,
}

impl From<Pose> for Placement {
    /// With open jaws.
    fn from(pose: Pose) -> Self {
        Self { pose, opening: 1.0 }
    }
}

/// A tool at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Key {
    /// Time since the script's start, s.
    pub time_s: f64,
    /// `None`: it is lifted then, until the next key.
    pub placement: Option<Placement>,
}

/// What one tool does.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// The tool, an index into the scene's.
    pub tool_id: u32,
    /// Times ascending.
    pub keys: Vec<Key>,
}

/// From the last key to the lift of a track that [`Track::lifted_at_end`] made, s: no step falls between them.
const LIFT_DELAY_S: f64 = 1e-9;

impl Track {
    /// The same with the tool lifted right after its last key.
    #[must_use]
    pub fn lifted_at_end(mut self) -> Self {
        if let Some(last) = self.keys.last().filter(|last| last.placement.is_some()) {
            self.keys.push(Key { time_s: last.time_s + LIFT_DELAY_S, placement: None });
        }
        self
    }

    /// The tool at a time: its position is linear between two keys, its orientation goes by the shortest arc. It
    /// enters the scene at its first key and stays at its last.
    #[must_use]
    pub fn at(&self, time_s: f64) -> Option<Placement> {
        let next = self.keys.partition_point(|key| key.time_s <= time_s);
        let key = self.keys[..next].last()?;
        let from = key.placement?;
        let Some(Key { time_s: end_s, placement: Some(to) }) = self.keys.get(next) else { return Some(from) };
        let share = (time_s - key.time_s) / (end_s - key.time_s);
        let (a, b) = (from.pose, to.pose);
        // Half a turn has no shortest arc: the tool turns at once, at the next key.
        let orientation = a.orientation.try_slerp(&b.orientation, share, 1e-9).unwrap_or(a.orientation);
        let pose = Pose { position_m: a.position_m.lerp(&b.position_m, share), orientation };
        Some(Placement { pose, opening: from.opening + share * (to.opening - from.opening) })
    }

    /// Where it entered the scene, if it is in it at a time: at its first key since it was last out.
    #[must_use]
    pub fn entered_at(&self, time_s: f64) -> Option<Placement> {
        let past = self.keys.partition_point(|key| key.time_s <= time_s);
        self.keys[..past].iter().rev().map_while(|key| key.placement).last()
    }

    /// Time of the last key, s.
    #[must_use]
    pub fn end_s(&self) -> f64 {
        self.keys.last().map_or(0.0, |key| key.time_s)
    }

    /// Greatest speed of the reference point, m/s.
    #[must_use]
    pub fn max_speed_m_per_s(&self) -> f64 {
        self.keys.windows(2).fold(0.0, |max, pair| {
            let [Some(from), Some(to)] = [pair[0].placement, pair[1].placement] else { return max };
            let distance_m = (to.pose.position_m - from.pose.position_m).norm();
            f64::max(max, distance_m / (pair[1].time_s - pair[0].time_s))
        })
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{UnitQuaternion, Vector3};

    use super::*;

    fn key(time_s: f64, x_m: f64, angle_rad: f64) -> Key {
        let orientation = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), angle_rad);
        Key { time_s, placement: Some(Pose { position_m: Vector3::new(x_m, 0.0, 0.0), orientation }.into()) }
    }

    fn track() -> Track {
        Track { tool_id: 0, keys: vec![key(1.0, 0.0, 0.0), key(3.0, 0.4, 1.0)] }
    }

    #[test]
    fn poses_between_keys_are_linear_and_slerped() {
        let pose = track().at(1.5).expect("within the track").pose;
        assert!((pose.position_m.x - 0.1).abs() < 1e-15);
        assert!((pose.orientation.angle() - 0.25).abs() < 1e-12);
        assert!((track().max_speed_m_per_s() - 0.2).abs() < 1e-15);
    }

    #[test]
    fn a_tool_is_out_of_the_scene_before_its_track_and_after_it_where_it_is_lifted() {
        assert_eq!(track().at(0.999), None);
        assert!(track().at(3.0).is_some() && track().at(9.0).is_some());
        let lifted = track().lifted_at_end();
        assert!(lifted.at(3.0).is_some() && lifted.at(3.001).is_none());
        assert_eq!(lifted.clone().lifted_at_end(), lifted);
    }

    #[test]
    fn a_tool_enters_at_its_first_key_however_late_that_is_asked() {
        let entered = |track: &Track, time_s| track.entered_at(time_s).map(|placement| placement.pose.position_m.x);
        assert_eq!(entered(&track(), 0.9), None);
        assert_eq!(entered(&track(), 2.9), Some(0.0));
        let mut twice = track().lifted_at_end();
        twice.keys.push(key(5.0, 0.7, 0.0));
        assert_eq!(entered(&twice, 4.0), None);
        assert_eq!(entered(&twice, 6.0), Some(0.7));
    }
}
