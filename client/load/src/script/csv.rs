//! Scripts from CSV files: `time_s,tool,x_m,y_m,z_m,qx,qy,qz,qw`, one pose a line, and `opening` where
//! tools have jaws: 0 (closed) to 1, by default 1.

use std::io::Read;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use serde::Deserialize;

use super::{Datum, Key, MAX_DURATION_S, Pose, Script, ScriptError, Track, tool_id};

/// Most lines: a quarter of an hour at 1 kHz takes 900,000, and about 100 MB as poses.
const MAX_LINES: u64 = 1_000_000;
/// How far a quaternion's length may be off 1: what files with three decimals are.
const QUATERNION_TOLERANCE: f64 = 0.01;

#[derive(Deserialize)]
struct Row {
    time_s: f64,
    tool: String,
    x_m: f64,
    y_m: f64,
    z_m: f64,
    qx: f64,
    qy: f64,
    qz: f64,
    qw: f64,
    #[serde(default = "open")]
    opening: f64,
}

fn open() -> f64 {
    1.0
}

/// Reads a script. Tools are named, or given by their index; the times of each tool ascend. Depths
/// are counted from `surface_height_m`.
///
/// # Errors
/// The line and the field that is not valid.
pub fn read(input: impl Read, tool_names: &[String], surface_height_m: f64) -> Result<Script, ScriptError> {
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(input);
    let mut tracks: Vec<Track> = Vec::new();
    for row in reader.deserialize() {
        let row: Row = row.map_err(|error| line_error(line_of(&error), &error.to_string()))?;
        let line = tracks.iter().map(|track| track.keys.len() as u64).sum::<u64>() + 2;
        if line > MAX_LINES {
            return Err(line_error(line, &format!("more than {MAX_LINES} lines")));
        }
        let tool_id = tool_id(&row.tool, tool_names).map_err(|error| line_error(line, &error.to_string()))?;
        let key = key(&row).map_err(|message| line_error(line, &message))?;
        match tracks.iter_mut().find(|track| track.tool_id == tool_id) {
            None => tracks.push(Track { tool_id, keys: vec![key] }),
            Some(track) if track.keys.last().is_none_or(|last| last.time_s < key.time_s) => track.keys.push(key),
            Some(_) => return Err(line_error(line, "time_s does not ascend")),
        }
    }
    if tracks.is_empty() {
        return Err(ScriptError::Parameter("the script has no poses".to_owned()));
    }
    Ok(Script { tracks, datums: vec![Datum { from_s: 0.0, height_m: surface_height_m }] })
}

fn line_of(error: &csv::Error) -> u64 {
    error.position().map_or(1, csv::Position::line)
}

fn line_error(line: u64, message: &str) -> ScriptError {
    ScriptError::Line { line, message: message.to_owned() }
}

fn key(row: &Row) -> Result<Key, String> {
    let numbers = [
        ("time_s", row.time_s),
        ("x_m", row.x_m),
        ("y_m", row.y_m),
        ("z_m", row.z_m),
        ("qx", row.qx),
        ("qy", row.qy),
        ("qz", row.qz),
        ("qw", row.qw),
        ("opening", row.opening),
    ];
    if let Some((name, value)) = numbers.iter().find(|(_, value)| !value.is_finite()) {
        return Err(format!("{name} is {value}, it has to be finite"));
    }
    if !(0.0..=MAX_DURATION_S).contains(&row.time_s) {
        return Err(format!("time_s is {}, it has to be within 0 and {MAX_DURATION_S}", row.time_s));
    }
    if !(0.0..=1.0).contains(&row.opening) {
        return Err(format!("opening is {}, it has to be within 0 and 1", row.opening));
    }
    let quaternion = Quaternion::new(row.qw, row.qx, row.qy, row.qz);
    if (quaternion.norm() - 1.0).abs() > QUATERNION_TOLERANCE {
        return Err(format!("qx, qy, qz, qw have length {:.3}, it has to be 1", quaternion.norm()));
    }
    let pose = Pose {
        position_m: Vector3::new(row.x_m, row.y_m, row.z_m),
        orientation: UnitQuaternion::new_normalize(quaternion),
    };
    Ok(Key { time_s: row.time_s, pose, opening: row.opening })
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "time_s,tool,x_m,y_m,z_m,qx,qy,qz,qw\n";

    fn read_lines(lines: &str) -> Result<Script, ScriptError> {
        read(format!("{HEADER}{lines}").as_bytes(), &["scalpel".to_owned(), "knife".to_owned()], 0.1)
    }

    #[test]
    fn tools_are_told_apart_by_name_or_index() {
        let script = read_lines("0,scalpel,0,0.1,0,0,0,0,1\n0,1,1,0,0,0,0,0,1\n2,scalpel,0,0.3,0,0,0,0,1\n")
            .expect("valid script");
        assert_eq!(script.tracks.iter().map(|track| track.tool_id).collect::<Vec<_>>(), [0, 1]);
        let pose = script.tracks[0].pose_at(1.0).expect("within the track");
        assert!((pose.position_m.y - 0.2).abs() < 1e-15);
        assert!((script.depth_m(1.0, &pose) + 0.1).abs() < 1e-15);
        assert!((script.duration_s() - 2.0).abs() < 1e-15);
    }

    #[test]
    fn jaws_are_open_unless_a_column_says_otherwise() {
        let opening = |text: String| {
            let script = read(text.as_bytes(), &["grasper".to_owned()], 0.0)?;
            Ok::<_, ScriptError>(script.tracks[0].key_at(0.5).expect("within the track").opening)
        };
        let lines = |ends: [&str; 2]| format!("0,0,0,0,0,0,0,0,1{}\n1,0,0,0,0,0,0,0,1{}\n", ends[0], ends[1]);
        let with_column = HEADER.replace("qw", "qw,opening");
        assert!((opening(format!("{HEADER}{}", lines(["", ""]))).expect("valid") - 1.0).abs() < 1e-15);
        assert!((opening(format!("{with_column}{}", lines([",1", ",0"]))).expect("valid") - 0.5).abs() < 1e-15);
        let refused = opening(format!("{with_column}{}", lines([",1", ",-1"]))).expect_err("not valid").to_string();
        assert_eq!(refused, "line 3: opening is -1, it has to be within 0 and 1");
    }

    #[test]
    fn errors_name_line_and_field() {
        let message = |lines| read_lines(lines).expect_err("not valid").to_string();
        assert_eq!(
            message("0,scalpel,0,0,0,0,0,0,1\n1,saw,0,0,0,0,0,0,1\n"),
            r#"line 3: tool "saw" is not one of ["scalpel", "knife"]"#
        );
        assert_eq!(message("0,0,0,0,0,0,0,0,1\n0,0,0,0,0,0,0,0,1\n"), "line 3: time_s does not ascend");
        assert_eq!(message("0,0,0,NaN,0,0,0,0,1\n"), "line 2: y_m is NaN, it has to be finite");
        assert_eq!(message("0,0,0,0,0,0,0,0,2\n"), "line 2: qx, qy, qz, qw have length 2.000, it has to be 1");
        assert!(message("0,0,zero,0,0,0,0,0,1\n").starts_with("line 2: "), "{}", message("0,0,zero,0,0,0,0,0,1\n"));
        assert_eq!(message(""), "the script has no poses");
    }
}
