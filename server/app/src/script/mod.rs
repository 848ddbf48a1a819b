//! Scripted tools as a world takes them, step by step: from a CSV file ([`kerf_script::read`]), or a stroke made
//! for the scene.

pub mod stroke;
pub(crate) mod sweep;
pub(crate) mod warnings;

use kerf_physics::Vec3;
use kerf_physics::step_io::{ToolInput, ToolMotion};
use kerf_script::{Key, Placement, Track};

use crate::convert::pose_from_script;

/// The tools' motion over time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Script {
    /// Of the tools that it moves.
    tracks: Vec<Track>,
    /// Whether the tool of each track is in the scene, for [`Self::advance`].
    entered: Vec<bool>,
}

impl From<Vec<Track>> for Script {
    fn from(tracks: Vec<Track>) -> Self {
        Self { entered: vec![false; tracks.len()], tracks }
    }
}

impl Script {
    /// A script for the first tool: `(time, position)`, orientation identity, lifted at the end.
    #[must_use]
    pub fn of_positions(positions: &[(f64, Vec3)]) -> Self {
        let key = |(time_s, position_m): &(f64, Vec3)| {
            let pose = kerf_script::Pose { position_m: *position_m, orientation: Default::default() };
            Key { time_s: *time_s, placement: Some(pose.into()) }
        };
        vec![Track { tool_id: 0, keys: positions.iter().map(key).collect() }.lifted_at_end()].into()
    }

    /// Time of the last key, s.
    #[must_use]
    pub fn end_s(&self) -> f64 {
        self.tracks.iter().map(Track::end_s).fold(0.0, f64::max)
    }

    /// Tools that it moves, with the greatest speed of their reference points, m/s.
    pub fn speeds_m_per_s(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.tracks.iter().map(|track| (track.tool_id as usize, track.max_speed_m_per_s()))
    }

    /// What each tool does in the step that ends at `time_s`. A tool enters where its first key has it and moves from
    /// the step after on: were it put down where it is at the step's end, it might have jumped the tissue's surface.
    pub fn advance(&mut self, time_s: f64) -> Vec<ToolInput> {
        let mut inputs = Vec::new();
        for (track, entered) in self.tracks.iter().zip(&mut self.entered) {
            let placement = if *entered { track.at(time_s) } else { track.entered_at(time_s) };
            let now = placement.map(|Placement { pose, opening }| (pose_from_script(&pose), opening));
            let motion = match (now, *entered) {
                (Some((pose, opening)), true) => ToolMotion::MoveTo { pose, opening },
                (Some((pose, opening)), false) => ToolMotion::EnterAt { pose, opening },
                (None, true) => ToolMotion::Lift,
                (None, false) => continue,
            };
            *entered = now.is_some();
            inputs.push(ToolInput { tool: track.tool_id as usize, motion });
        }
        inputs
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The second of two tools at heights, with its jaws' opening; lifted where there is none.
    fn script(keys: &[(f64, Option<(f64, f64)>)]) -> Script {
        let key = |&(time_s, held): &(f64, Option<(f64, f64)>)| {
            let placement = held.map(|(y_m, opening)| {
                let position_m = Vec3::new(0.0, y_m, 0.0);
                Placement { pose: kerf_script::Pose { position_m, orientation: Default::default() }, opening }
            });
            Key { time_s, placement }
        };
        vec![Track { tool_id: 1, keys: keys.iter().map(key).collect() }].into()
    }

    fn motion(script: &mut Script, time_s: f64) -> Option<ToolMotion> {
        let inputs = script.advance(time_s);
        assert!(inputs.iter().all(|input| input.tool == 1));
        inputs.first().map(|input| input.motion)
    }

    #[test]
    fn tools_enter_move_and_are_lifted() {
        let mut script =
            script(&[(0.1, Some((1.0, 1.0))), (0.3, Some((2.0, 1.0))), (0.4, None), (0.6, Some((5.0, 1.0)))]);
        assert_eq!(script.end_s(), 0.6);
        assert_eq!(motion(&mut script, 0.05), None);
        assert!(matches!(motion(&mut script, 0.1), Some(ToolMotion::EnterAt { pose, .. }) if pose.position_m.y == 1.0));
        assert!(matches!(motion(&mut script, 0.35), Some(ToolMotion::MoveTo { pose, .. }) if pose.position_m.y == 2.0));
        assert_eq!(motion(&mut script, 0.45), Some(ToolMotion::Lift));
        assert_eq!(motion(&mut script, 0.5), None);
        assert!(matches!(motion(&mut script, 0.7), Some(ToolMotion::EnterAt { .. })));
        assert!(matches!(motion(&mut script, 9.0), Some(ToolMotion::MoveTo { pose, .. }) if pose.position_m.y == 5.0));
    }

    #[test]
    fn a_motion_states_the_opening_of_the_jaws() {
        let keys = [(0.0, Some((0.0, 1.0))), (0.2, Some((0.0, 1.0))), (0.4, Some((0.0, 0.0))), (0.6, None)];
        let mut script = script(&[&keys[..], &[(0.8, Some((0.0, 0.0)))]].concat());
        let mut opening = |time_s| match script.advance(time_s)[..] {
            [ToolInput { motion: ToolMotion::MoveTo { opening, .. } | ToolMotion::EnterAt { opening, .. }, .. }] => {
                Some(opening)
            }
            _ => None,
        };
        assert_eq!([opening(0.0), opening(0.1), opening(0.4)], [Some(1.0), Some(1.0), Some(0.0)]);
        assert_eq!([opening(0.7), opening(0.9)], [None, Some(0.0)]);
    }
}
