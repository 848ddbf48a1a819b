//! Scripted tools: poses over time from a CSV file, or a stroke made for the scene.
//!
//! A file has the header `time_s,tool,x_m,y_m,z_m,qx,qy,qz,qw` and a row per pose. Between two rows
//! of a tool its position is interpolated linearly and its orientation along the shortest arc. A tool
//! enters the scene at its first row and stays at its last; a row with `lift` for `x_m` and nothing
//! after takes it out until its next row. A file whose tools have jaws has one more column, `opening`: the
//! share of their full opening that they take, 0 (closed) to 1, linear between two rows.

use std::io::Read;

use anyhow::{Context, Result, anyhow, bail, ensure};
use kerf_physics::step_io::{ToolInput, ToolMotion};
use kerf_physics::tool::Pose;
use kerf_physics::{Quat, Vec3};

const HEADER: [&str; 10] = ["time_s", "tool", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw", "opening"];
/// Columns that a file has at least.
const COLUMNS: usize = 9;
/// Opening that tools enter with; see [`ToolMotion::SetOpening`].
const OPEN: f64 = 1.0;
/// Departure of a quaternion's length from 1 that counts as rounding in the file.
const QUATERNION_ROUNDING: f64 = 1e-3;

/// Where a tool is at a time; `None`: lifted.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Key {
    time_s: f64,
    pose: Option<Pose>,
    /// Share of their full opening that its jaws take.
    opening: f64,
}

/// The tools' motion over time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Script {
    /// Keys of each tool of the scene, times ascending.
    keys: Vec<Vec<Key>>,
    /// The opening of each tool that is in the scene, for [`Self::advance`].
    openings: Vec<Option<f64>>,
}

impl Script {
    /// Reads a script for tools of these names.
    ///
    /// # Errors
    /// Row (the header is row 1), column and what is wrong there.
    pub fn from_csv(source: impl Read, tools: &[&str]) -> Result<Self> {
        let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).comment(Some(b'#')).from_reader(source);
        let header = reader.headers().context("row 1")?;
        let known = *header == HEADER[..] || *header == HEADER[..COLUMNS];
        ensure!(known, "row 1: the header is not `{}`, with or without `,opening`", HEADER[..COLUMNS].join(","));
        let mut keys = vec![Vec::new(); tools.len()];
        for record in reader.records() {
            let record = record?;
            let row = record.position().map_or(0, csv::Position::line);
            let (tool, key) = parse_row(&record, tools).with_context(|| format!("row {row}"))?;
            let earlier: Option<&Key> = keys[tool].last();
            if let Some(earlier) = earlier.filter(|earlier| earlier.time_s >= key.time_s) {
                bail!("row {row}: column time_s: {} is not after {}", key.time_s, earlier.time_s);
            }
            keys[tool].push(key);
        }
        ensure!(keys.iter().any(|keys| !keys.is_empty()), "the script has no rows");
        Ok(Self { openings: vec![None; keys.len()], keys })
    }

    /// A script that moves no tool.
    #[must_use]
    pub fn empty(tools: usize) -> Self {
        Self { keys: vec![Vec::new(); tools], openings: vec![None; tools] }
    }

    /// A script for the first of `tools`: `(time, position)`, orientation identity, lifted at the end.
    #[must_use]
    pub fn of_positions(tools: usize, positions: &[(f64, Vec3)]) -> Self {
        let mut script = Self::empty(tools);
        let key = |(time_s, position_m): &(f64, Vec3)| Key {
            time_s: *time_s,
            pose: Some(Pose { position_m: *position_m, orientation: Quat::identity() }),
            opening: OPEN,
        };
        script.keys[0] = positions.iter().map(key).collect();
        if let Some((time_s, _)) = positions.last() {
            script.keys[0].push(Key { time_s: time_s + 1e-9, pose: None, opening: OPEN });
        }
        script
    }

    /// Time of the last key, s.
    #[must_use]
    pub fn end_s(&self) -> f64 {
        self.keys.iter().flatten().map(|key| key.time_s).fold(0.0, f64::max)
    }

    /// What each tool does in the step that ends at `time_s`.
    pub fn advance(&mut self, time_s: f64) -> Vec<ToolInput> {
        let mut inputs = Vec::new();
        for (tool, keys) in self.keys.iter().enumerate() {
            let now = state_at(keys, time_s);
            let motion = match (now, self.openings[tool]) {
                (Some((pose, _)), Some(_)) => ToolMotion::MoveTo(pose),
                (Some((pose, _)), None) => ToolMotion::EnterAt(pose),
                (None, Some(_)) => ToolMotion::Lift,
                (None, None) => continue,
            };
            inputs.push(ToolInput { tool, motion });
            let opening = now.map(|(_, opening)| opening);
            if let Some(opening) = opening.filter(|opening| *opening != self.openings[tool].unwrap_or(OPEN)) {
                inputs.push(ToolInput { tool, motion: ToolMotion::SetOpening(opening) });
            }
            self.openings[tool] = opening;
        }
        inputs
    }
}

/// Pose and opening at a time.
fn state_at(keys: &[Key], time_s: f64) -> Option<(Pose, f64)> {
    let next = keys.partition_point(|key| key.time_s <= time_s);
    let key = keys[..next].last()?;
    let from = key.pose?;
    let Some(Key { time_s: end_s, pose: Some(to), opening }) = keys.get(next) else { return Some((from, key.opening)) };
    let share = (time_s - key.time_s) / (end_s - key.time_s);
    let pose = Pose {
        position_m: from.position_m.lerp(&to.position_m, share),
        // Half a turn has no shortest arc: keep the orientation until the next key.
        orientation: from.orientation.try_slerp(&to.orientation, share, 1e-9).unwrap_or(from.orientation),
    };
    Some((pose, key.opening + share * (opening - key.opening)))
}

fn parse_row(record: &csv::StringRecord, tools: &[&str]) -> Result<(usize, Key)> {
    let number = |column: usize| -> Result<f64> {
        let text = &record[column];
        let value = text.parse::<f64>().ok().filter(|value| value.is_finite());
        value.ok_or_else(|| anyhow!("column {}: `{text}` is not a finite number", HEADER[column]))
    };
    let time_s = number(0)?;
    ensure!(time_s >= 0.0, "column time_s: {time_s} is negative");
    let known = || tools.join(", ");
    let tool = tools.iter().position(|name| *name == &record[1]);
    let tool = tool.ok_or_else(|| anyhow!("column tool: `{}` is not one of: {}", &record[1], known()))?;
    if &record[2] == "lift" {
        let filled = (3..record.len()).find(|column| !record[*column].is_empty());
        ensure!(filled.is_none(), "column {}: a tool that is lifted has no pose", HEADER[filled.unwrap_or(2)]);
        return Ok((tool, Key { time_s, pose: None, opening: OPEN }));
    }
    let position_m = Vec3::new(number(2)?, number(3)?, number(4)?);
    let quaternion = nalgebra::Quaternion::new(number(8)?, number(5)?, number(6)?, number(7)?);
    ensure!(
        (quaternion.norm() - 1.0).abs() <= QUATERNION_ROUNDING,
        "columns qx to qw: the quaternion's length is {}, not 1",
        quaternion.norm()
    );
    let opening = if record.len() > COLUMNS { number(COLUMNS)? } else { OPEN };
    ensure!((0.0..=1.0).contains(&opening), "column opening: {opening} is not between 0 and 1");
    let pose = Pose { position_m, orientation: Quat::new_normalize(quaternion) };
    Ok((tool, Key { time_s, pose: Some(pose), opening }))
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROWS: &str = "time_s,tool,x_m,y_m,z_m,qx,qy,qz,qw\n\
                        0.1,knife,0,1,0,0,0,0,1\n\
                        0.3,knife,0,0,2,0,0.70710678,0,0.70710678\n\
                        0.4,knife,lift,,,,,,\n\
                        0.6,knife,5,5,5,0,0,0,1\n";

    fn script(text: &str) -> Result<Script> {
        Script::from_csv(text.as_bytes(), &["saw", "knife"])
    }

    fn motion(script: &mut Script, time_s: f64) -> Option<ToolMotion> {
        let inputs = script.advance(time_s);
        assert!(inputs.iter().all(|input| input.tool == 1));
        inputs.first().map(|input| input.motion)
    }

    #[test]
    fn poses_are_interpolated_and_lifts_obeyed() {
        let mut script = script(ROWS).unwrap();
        assert_eq!(script.end_s(), 0.6);
        assert_eq!(motion(&mut script, 0.05), None);
        assert!(matches!(motion(&mut script, 0.1), Some(ToolMotion::EnterAt(pose)) if pose.position_m.y == 1.0));
        let Some(ToolMotion::MoveTo(middle)) = motion(&mut script, 0.2) else { panic!("not moving") };
        assert!((middle.position_m - Vec3::new(0.0, 0.5, 1.0)).norm() < 1e-12);
        assert!((middle.orientation.angle() - std::f64::consts::FRAC_PI_4).abs() < 1e-6);
        assert!(matches!(motion(&mut script, 0.35), Some(ToolMotion::MoveTo(pose)) if pose.position_m.z == 2.0));
        assert_eq!(motion(&mut script, 0.45), Some(ToolMotion::Lift));
        assert_eq!(motion(&mut script, 0.5), None);
        assert!(matches!(motion(&mut script, 0.7), Some(ToolMotion::EnterAt(_))));
        assert!(matches!(motion(&mut script, 9.0), Some(ToolMotion::MoveTo(pose)) if pose.position_m.x == 5.0));
    }

    #[test]
    fn jaws_move_linearly_and_are_told_of_when_they_do() {
        let rows = "time_s,tool,x_m,y_m,z_m,qx,qy,qz,qw,opening\n\
                    0,knife,0,0,0,0,0,0,1,1\n0.2,knife,0,0,0,0,0,0,1,1\n0.4,knife,0,0,0,0,0,0,1,0\n\
                    0.6,knife,lift,,,,,,,\n0.8,knife,0,0,0,0,0,0,1,0\n";
        let mut script = script(rows).unwrap();
        let mut opening = |time_s| match script.advance(time_s)[..] {
            [_, ToolInput { motion: ToolMotion::SetOpening(opening), .. }] => Some(opening),
            _ => None,
        };
        assert_eq!([opening(0.0), opening(0.1), opening(0.4), opening(0.5)], [None, None, Some(0.0), None]);
        assert_eq!([opening(0.7), opening(0.9), opening(1.0)], [None, Some(0.0), None]);
        let refused = Script::from_csv(rows.replacen("1,1\n", "1,2\n", 1).as_bytes(), &["knife"]).unwrap_err();
        assert_eq!(format!("{refused:#}"), "row 2: column opening: 2 is not between 0 and 1");
    }

    #[test]
    fn errors_name_row_and_column() {
        let refused = |from: &str, to: &str| format!("{:#}", script(&ROWS.replacen(from, to, 1)).unwrap_err());
        assert_eq!(refused("0,0,2,0", "0,abc,2,0"), "row 3: column y_m: `abc` is not a finite number");
        assert_eq!(refused("0.1,knife", "0.1,axe"), "row 2: column tool: `axe` is not one of: saw, knife");
        assert_eq!(refused("0.4,", "0.2,"), "row 4: column time_s: 0.2 is not after 0.3");
        assert_eq!(refused("lift,,", "lift,1,"), "row 4: column y_m: a tool that is lifted has no pose");
        assert!(refused("5,5,5,0", "5,5,5,1").starts_with("row 5: columns qx to qw: "));
        assert!(refused("qx", "qa").starts_with("row 1: the header is not"));
        assert!(refused("5,5,5,0,", "5,5,5,").contains("line: 5"), "{}", refused("5,5,5,0,", "5,5,5,"));
    }
}
