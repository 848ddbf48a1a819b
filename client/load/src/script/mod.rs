//! What tools do over time.

pub mod strokes;

use std::io::Read;

use kerf_script::{Pose, Track};

/// Longest script: an hour of a load test, with room for an overnight one.
pub const MAX_DURATION_S: f64 = 24.0 * 3600.0;

/// A script cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum ScriptError {
    /// A CSV file is not valid.
    #[error(transparent)]
    Csv(#[from] kerf_script::ScriptError),
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

impl Script {
    /// Reads a script from CSV, see [`kerf_script::read`]; tools are lifted at the end of their tracks. Depths are
    /// counted from `surface_height_m`.
    ///
    /// # Errors
    /// The row and the column that is not valid, or a script that is too long.
    pub fn from_csv(input: impl Read, tool_names: &[String], surface_height_m: f64) -> Result<Self, ScriptError> {
        let tracks = kerf_script::read(input, tool_names)?.into_iter().map(Track::lifted_at_end).collect();
        Self { tracks, datums: vec![Datum { from_s: 0.0, height_m: surface_height_m }] }.checked()
    }

    /// The script, if it is not too long.
    fn checked(self) -> Result<Self, ScriptError> {
        match self.duration_s() > MAX_DURATION_S {
            true => Err(ScriptError::Parameter(format!("the script would take longer than {MAX_DURATION_S} s"))),
            false => Ok(self),
        }
    }

    /// Time of the last key, s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.tracks.iter().map(Track::end_s).fold(0.0, f64::max)
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
    let index = kerf_script::tool_index(tool, names)
        .ok_or_else(|| ScriptError::Parameter(format!("tool {tool:?} is not one of {names:?}")))?;
    Ok(index as u32)
}

#[cfg(test)]
mod tests {
    use nalgebra::{UnitQuaternion, Vector3};

    use super::*;

    #[test]
    fn depth_is_measured_from_the_datum_in_force() {
        let datums = vec![Datum { from_s: 0.0, height_m: 0.05 }, Datum { from_s: 2.0, height_m: 0.03 }];
        let script = Script { tracks: vec![], datums };
        let pose = Pose { position_m: Vector3::new(0.0, 0.02, 0.0), orientation: UnitQuaternion::identity() };
        assert!((script.depth_m(1.0, &pose) - 0.03).abs() < 1e-15);
        assert!((script.depth_m(2.0, &pose) - 0.01).abs() < 1e-15);
    }
}
