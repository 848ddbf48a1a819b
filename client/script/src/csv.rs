//! Scripts from CSV files.
//!
//! A file has the header `time_s,tool,x_m,y_m,z_m,qx,qy,qz,qw` and a row per pose; tools go by name or index. A row
//! with `lift` for `x_m` and nothing after takes the tool out of the scene until its next row. A file whose tools have
//! jaws has one more column, `opening`: the fraction of their full opening that they take, 0 (closed) to 1. Lines that
//! begin with `#` are remarks.

use std::io::Read;

use csv::{Position, ReaderBuilder, StringRecord, Trim};
use nalgebra::UnitQuaternion;

use crate::pose::{POSE_COLUMNS, Pose, number};
use crate::track::{Key, Placement, Track};

/// Columns before those of a pose.
const FIRST_COLUMNS: [&str; 2] = ["time_s", "tool"];
const OPENING: &str = "opening";
/// Columns that a file has at least.
const COLUMNS: usize = FIRST_COLUMNS.len() + POSE_COLUMNS.len();
/// Departure of a quaternion's length from 1 that counts as rounding: that of files with three decimals.
const QUATERNION_ROUNDING: f64 = 0.01;
/// Most rows: a quarter of an hour at 1 kHz takes 900,000, and about 100 MB as poses.
const MAX_ROWS: usize = 1_000_000;

/// A script that is none.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum ScriptError {
    /// A row is not as it should be.
    #[error("row {row}: {message}")]
    Row {
        /// Of the file; the header is row 1.
        row: u64,
        /// Column and what is wrong there.
        message: String,
    },
    /// There is nothing in it.
    #[error("the script has no rows")]
    Empty,
}

/// Reads a script for tools of these names: a track for each of them that has rows, by index.
///
/// # Errors
/// Row, column and what is wrong there.
pub fn read(source: impl Read, tools: &[String]) -> Result<Vec<Track>, ScriptError> {
    let mut reader = ReaderBuilder::new().trim(Trim::All).comment(Some(b'#')).from_reader(source);
    let failed = |row: u64, message: String| ScriptError::Row { row, message };
    let header = reader.headers().map_err(|e| failed(1, e.to_string()))?;
    let is_known = header.iter().eq(columns().take(COLUMNS)) || header.iter().eq(columns());
    if !is_known {
        let wanted: Vec<_> = columns().take(COLUMNS).collect();
        return Err(failed(1, format!("the header is not `{}`, with or without `,opening`", wanted.join(","))));
    }
    let mut tracks: Vec<Track> = (0..tools.len() as u32).map(|tool_id| Track { tool_id, keys: Vec::new() }).collect();
    for (index, record) in reader.records().enumerate() {
        let record = record.map_err(|e| failed(e.position().map_or(0, Position::line), e.to_string()))?;
        let row = record.position().map_or(0, Position::line);
        if index == MAX_ROWS {
            return Err(failed(row, format!("more than {MAX_ROWS} rows")));
        }
        let (tool, key) = key(&record, tools).map_err(|message| failed(row, message))?;
        let keys = &mut tracks[tool].keys;
        if let Some(earlier) = keys.last().filter(|earlier| earlier.time_s >= key.time_s) {
            return Err(failed(row, format!("column time_s: {} is not after {}", key.time_s, earlier.time_s)));
        }
        keys.push(key);
    }
    tracks.retain(|track| !track.keys.is_empty());
    if tracks.is_empty() { Err(ScriptError::Empty) } else { Ok(tracks) }
}

fn columns() -> impl Iterator<Item = &'static str> {
    FIRST_COLUMNS.into_iter().chain(POSE_COLUMNS).chain([OPENING])
}

/// Index of the tool that a word means: its name, or the index itself.
#[must_use]
pub fn tool_index(word: &str, tools: &[String]) -> Option<usize> {
    let by_index = || word.parse().ok().filter(|index| *index < tools.len());
    tools.iter().position(|name| name == word).or_else(by_index)
}

fn key(record: &StringRecord, tools: &[String]) -> Result<(usize, Key), String> {
    let time_s = number(FIRST_COLUMNS[0], &record[0])?;
    if time_s < 0.0 {
        return Err(format!("column time_s: {time_s} is negative"));
    }
    let tool = tool_index(&record[1], tools)
        .ok_or_else(|| format!("column tool: `{}` is not one of: {}", &record[1], tools.join(", ")))?;
    let first = FIRST_COLUMNS.len();
    if &record[first] == "lift" {
        return match columns().zip(record).skip(first + 1).find(|(_, cell)| !cell.is_empty()) {
            Some((column, _)) => Err(format!("column {column}: a tool that is lifted has no pose")),
            None => Ok((tool, Key { time_s, placement: None })),
        };
    }
    let Pose { position_m, orientation } = Pose::of_cells(record, first, QUATERNION_ROUNDING)?;
    let pose = Pose { position_m, orientation: UnitQuaternion::new_normalize(orientation.into_inner()) };
    let placement = match record.get(COLUMNS) {
        Some(cell) => Placement { pose, opening: number(OPENING, cell)? },
        None => pose.into(),
    };
    if !(0.0..=1.0).contains(&placement.opening) {
        return Err(format!("column opening: {} is not between 0 and 1", placement.opening));
    }
    Ok((tool, Key { time_s, placement: Some(placement) }))
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROWS: &str = "time_s,tool,x_m,y_m,z_m,qx,qy,qz,qw\n\
                        0.1,knife,0,1,0,0,0,0,1\n\
                        0.3,knife,0,0,2,0,0.70710678,0,0.70710678\n\
                        0.4,knife,lift,,,,,,\n\
                        0.6,1,5,5,5,0,0,0,1\n\
                        # the other one\n\
                        0.6,saw,0,0,0,0,0,0,1\n";

    fn script(text: &str) -> Result<Vec<Track>, ScriptError> {
        read(text.as_bytes(), &["saw".to_owned(), "knife".to_owned()])
    }

    #[test]
    fn tools_go_by_name_or_index_and_lifts_are_obeyed() {
        let tracks = script(ROWS).unwrap();
        assert_eq!(tracks.iter().map(|track| (track.tool_id, track.keys.len())).collect::<Vec<_>>(), [(0, 1), (1, 4)]);
        let y_m = |time_s| tracks[1].at(time_s).map(|placement| placement.pose.position_m.y);
        assert_eq!([y_m(0.05), y_m(0.1), y_m(0.45), y_m(9.0)], [None, Some(1.0), None, Some(5.0)]);
        assert!((y_m(0.2).unwrap() - 0.5).abs() < 1e-12);
        let turned = tracks[1].at(0.2).unwrap().pose.orientation;
        assert!((turned.angle() - std::f64::consts::FRAC_PI_4).abs() < 1e-6);
    }

    #[test]
    fn jaws_are_open_unless_a_column_says_otherwise() {
        let rows = "time_s,tool,x_m,y_m,z_m,qx,qy,qz,qw,opening\n0,0,0,0,0,0,0,0,1,1\n1,0,0,0,0,0,0,0,1,0\n";
        let opening = |rows: &str| script(rows).map(|tracks| tracks[0].at(0.5).unwrap().opening);
        assert_eq!(opening(rows), Ok(0.5));
        assert_eq!(opening(&rows.replace(",opening", "").replace(",1,1\n", ",1\n").replace(",1,0\n", ",1\n")), Ok(1.0));
        let refused = opening(&rows.replace("1,0\n", "1,-1\n")).unwrap_err().to_string();
        assert_eq!(refused, "row 3: column opening: -1 is not between 0 and 1");
    }

    #[test]
    fn errors_name_row_and_column() {
        let refused = |from: &str, to: &str| script(&ROWS.replacen(from, to, 1)).unwrap_err().to_string();
        assert_eq!(refused("0,0,2,0", "0,abc,2,0"), "row 3: column y_m: `abc` is not a finite number");
        assert_eq!(refused("0.1,knife", "0.1,axe"), "row 2: column tool: `axe` is not one of: saw, knife");
        assert_eq!(refused("0.4,", "0.2,"), "row 4: column time_s: 0.2 is not after 0.3");
        assert_eq!(refused("lift,,", "lift,1,"), "row 4: column y_m: a tool that is lifted has no pose");
        assert!(refused("5,5,5,0", "5,5,5,1").starts_with("row 5: columns qx to qw: "));
        assert!(refused("qx", "qa").starts_with("row 1: the header is not"));
        assert!(refused("5,5,5,0,", "5,5,5,").starts_with("row 5: "), "{}", refused("5,5,5,0,", "5,5,5,"));
        assert_eq!(script(ROWS.lines().next().unwrap()), Err(ScriptError::Empty));
    }

    #[test]
    fn a_pose_reads_back_to_the_same_bits() {
        let orientation = UnitQuaternion::from_euler_angles(0.1, 0.2, 1.0 / 3.0);
        let pose = Pose { position_m: [0.1, -1e-300, 1.0 / 3.0].into(), orientation };
        assert_eq!(Pose::of_cells(&StringRecord::from(pose.cells().to_vec()), 0, 1e-9), Ok(pose));
    }
}
