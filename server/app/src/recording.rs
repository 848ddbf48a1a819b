//! Recordings: the inputs of a session in a file, from which `simulate --replay` gets the same bits.
//!
//! CSV with a row per input. `step` is the number of steps taken before it, `tool` an index into the
//! scene's tools, `input` one of `enter`, `move` and `lift`, or `tolerance` where the governor set the solver's;
//! a tool that enters or moves has a pose and an `opening`. Numbers are written so that they read back to the
//! same bits. The last row is `end`, with the number of all steps and the hash of the state that they led to,
//! absent where the session went on after its log was full.
//!
//! A session that went back to a named checkpoint is recorded as the way to the checkpoint and on from there: what came
//! after the checkpoint had no part in the state that the recording leads to.

use std::fs::File;
use std::io;
use std::path::Path;
use std::time::SystemTime;

use anyhow::{Context, Error, Result, anyhow, bail, ensure};
use kerf_physics::step_io::{ToolInput, ToolMotion};
use kerf_physics::tool::Pose;
use kerf_proto::v1;
use kerf_session::{InputLog, LoggedInputs, Session};

use crate::config::ServerConfig;
use crate::convert::{pose_from_script, script_pose};

const HEADER: [&str; 13] = [
    "step",
    "tool",
    "input",
    "x_m",
    "y_m",
    "z_m",
    "qx",
    "qy",
    "qz",
    "qw",
    "opening",
    "relative_tolerance",
    "state_hash",
];
const POSE: usize = 3;
const OPENING: usize = 10;
const TOLERANCE: usize = 11;
const STATE_HASH: usize = 12;
/// Departure of a quaternion's length from 1 that is rounding; sessions record unit quaternions.
const QUATERNION_ROUNDING: f64 = 1e-9;
/// Most steps of a recording: three hours at 1 kHz.
const MAX_STEPS: u64 = 10_000_000;

/// The inputs of a session since its scene was at rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// The inputs.
    pub log: InputLog,
    /// Hash of the state after the log's last step, where it is known.
    pub state_hash: Option<u64>,
}

/// Writes what a session has recorded to a new file in the server's folder and, beside it, the scene as the dial left
/// it; says what became of that. `None` where the server has no folder. What goes wrong stops neither a session's end
/// nor its reset. What a session does after its last reset is lost with the process that is killed.
pub async fn save(config: &ServerConfig, session: &Session) -> Option<v1::Recording> {
    let folder = config.record_dir.as_deref()?;
    Some(match try_save(folder, config.max_record_mib, session).await {
        Ok(saved) => {
            tracing::info!(session = %session.id(), file = saved.file, is_cut_off = saved.is_cut_off, "session recorded");
            saved
        }
        Err(error) => {
            tracing::error!(session = %session.id(), "session not recorded: {error:#}");
            v1::Recording { error: format!("{error:#}"), ..v1::Recording::default() }
        }
    })
}

async fn try_save(folder: &Path, max_mib: f64, session: &Session) -> Result<v1::Recording> {
    let recorded = session.query(|inspection| {
        let state_hash = (!inspection.log.is_full()).then(|| inspection.world.state_hash());
        Recording { log: inspection.log.clone(), state_hash }
    });
    let recording = recorded.await?;
    // A session that is reset leaves several recordings.
    let saved_ms = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH)?.as_millis();
    let file = format!("{}-{saved_ms}.csv", session.id());
    let (folder, path) = (folder.to_owned(), folder.join(&file));
    let scene = toml::to_string(&session.scene().desc)?;
    let write = move || {
        let kept_mib = folder_bytes(&folder)? as f64 / f64::from(1 << 20);
        ensure!(kept_mib < max_mib, "record_dir holds {kept_mib:.0} MiB, at most {max_mib} (max_record_mib)");
        let scene_path = path.with_extension("toml");
        let written = std::fs::write(&scene_path, scene).with_context(|| scene_path.display().to_string());
        let written = written.and_then(|()| recording.write(&path));
        if written.is_err() {
            // Half a recording is none.
            let _ = (std::fs::remove_file(&path), std::fs::remove_file(&scene_path));
        }
        let (steps, is_cut_off) = (recording.log.steps(), recording.log.is_full());
        written.map(|()| v1::Recording { file, steps, is_cut_off, error: String::new() })
    };
    tokio::task::spawn_blocking(write).await?
}

fn folder_bytes(folder: &Path) -> Result<u64> {
    let entries = std::fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    Ok(entries.filter_map(|entry| entry.ok()?.metadata().ok()).map(|metadata| metadata.len()).sum())
}

impl Recording {
    /// Writes a new file.
    ///
    /// # Errors
    /// The file is there already or cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let file = File::create_new(path).with_context(|| path.display().to_string())?;
        self.to_csv(io::BufWriter::new(&file)).with_context(|| path.display().to_string())?;
        // A full disk may only be told of when the file is written out.
        file.sync_all().with_context(|| path.display().to_string())
    }

    /// Reads a file, for a scene with `tools` tools.
    ///
    /// # Errors
    /// Row (the header is row 1), column and what is wrong there.
    pub fn read(path: &Path, tools: usize) -> Result<Self> {
        let file = File::open(path).with_context(|| path.display().to_string())?;
        Self::from_csv(io::BufReader::new(file), tools).with_context(|| path.display().to_string())
    }

    fn to_csv(&self, sink: impl io::Write) -> Result<()> {
        let mut writer = csv::Writer::from_writer(sink);
        writer.write_record(HEADER)?;
        for (step, inputs) in self.log.inputs().enumerate() {
            if let Some(tolerance) = inputs.relative_tolerance {
                let mut row = [const { String::new() }; HEADER.len()];
                (row[0], row[2], row[TOLERANCE]) = (step.to_string(), "tolerance".into(), tolerance.to_string());
                writer.write_record(row)?;
            }
            for input in &inputs.tools {
                writer.write_record(motion_row(step, input))?;
            }
        }
        let hash = self.state_hash.map_or(String::new(), |hash| format!("{hash:016x}"));
        let mut end = [const { String::new() }; HEADER.len()];
        (end[0], end[2], end[STATE_HASH]) = (self.log.steps().to_string(), "end".into(), hash);
        writer.write_record(end)?;
        Ok(writer.flush()?)
    }

    fn from_csv(source: impl io::Read, tools: usize) -> Result<Self> {
        let mut reader = csv::Reader::from_reader(source);
        let header = reader.headers().context("row 1")?;
        ensure!(*header == HEADER[..], "row 1: the header is not `{}`", HEADER.join(","));
        let mut log = InputLog::new(usize::MAX);
        let mut inputs = LoggedInputs::default();
        for record in reader.records() {
            let record = record?;
            let row = record.position().map_or(0, csv::Position::line);
            let context = || format!("row {row}");
            let step = integer(&record, 0).with_context(context)?;
            ensure!(step >= log.steps(), "row {row}: column step: {step} is below that of the row before");
            ensure!(step <= MAX_STEPS, "row {row}: column step: {step} is more than {MAX_STEPS}");
            while log.steps() < step {
                log.record(&inputs.as_inputs());
                inputs = LoggedInputs::default();
            }
            if &record[2] == "end" {
                ensure!(inputs == LoggedInputs::default(), "row {row}: column step: {step} leaves out the last step");
                let state_hash = state_hash(&record[STATE_HASH]).with_context(context)?;
                return Ok(Self { log, state_hash });
            }
            match &record[2] {
                "tolerance" => inputs.relative_tolerance = Some(tolerance(&record).with_context(context)?),
                _ => {
                    let input = motion(&record, tools).with_context(context)?;
                    let is_second = inputs.tools.iter().any(|first| first.tool == input.tool);
                    ensure!(!is_second, "row {row}: column tool: {} has an input in this step already", input.tool);
                    inputs.tools.push(input);
                }
            }
        }
        bail!("the recording has no end")
    }
}

fn motion_row(step: usize, input: &ToolInput) -> [String; HEADER.len()] {
    let mut row = [const { String::new() }; HEADER.len()];
    let (motion, place) = match input.motion {
        ToolMotion::EnterAt { pose, opening } => ("enter", Some((pose, opening))),
        ToolMotion::MoveTo { pose, opening } => ("move", Some((pose, opening))),
        ToolMotion::Lift => ("lift", None),
    };
    (row[0], row[1], row[2]) = (step.to_string(), input.tool.to_string(), motion.into());
    if let Some((pose, opening)) = place {
        row[POSE..OPENING].clone_from_slice(&script_pose(&pose).cells());
        row[OPENING] = opening.to_string();
    }
    row
}

fn tolerance(record: &csv::StringRecord) -> Result<f64> {
    let value = number(record, TOLERANCE)?;
    ensure!(value > 0.0 && value <= 0.5, "column relative_tolerance: {value} is not between 0 and 0.5");
    Ok(value)
}

fn opening(record: &csv::StringRecord) -> Result<f64> {
    let value = number(record, OPENING)?;
    ensure!((0.0..=1.0).contains(&value), "column opening: {value} is not between 0 and 1");
    Ok(value)
}

fn state_hash(text: &str) -> Result<Option<u64>> {
    let parse = |text| u64::from_str_radix(text, 16).map_err(|_| anyhow!("column state_hash: `{text}` is no hash"));
    Some(text).filter(|text| !text.is_empty()).map(parse).transpose()
}

fn motion(record: &csv::StringRecord, tools: usize) -> Result<ToolInput> {
    let tool = integer(record, 1)? as usize;
    ensure!(tool < tools, "column tool: {tool}, but the scene has {tools}");
    let motion = match &record[2] {
        "enter" => ToolMotion::EnterAt { pose: pose(record)?, opening: opening(record)? },
        "move" => ToolMotion::MoveTo { pose: pose(record)?, opening: opening(record)? },
        "lift" => ToolMotion::Lift,
        other => bail!("column input: `{other}` is none of enter, move, lift, tolerance, end"),
    };
    Ok(ToolInput { tool, motion })
}

fn pose(record: &csv::StringRecord) -> Result<Pose> {
    // Not normalised once more: that could change the last bit.
    let pose = kerf_script::Pose::of_cells(record, POSE, QUATERNION_ROUNDING).map_err(Error::msg)?;
    Ok(pose_from_script(&pose))
}

fn integer(record: &csv::StringRecord, column: usize) -> Result<u64> {
    let text = &record[column];
    text.parse().map_err(|_| anyhow!("column {}: `{text}` is not a whole number", HEADER[column]))
}

fn number(record: &csv::StringRecord, column: usize) -> Result<f64> {
    let text = &record[column];
    let value = text.parse::<f64>().ok().filter(|value| value.is_finite());
    value.ok_or_else(|| anyhow!("column {}: `{text}` is not a finite number", HEADER[column]))
}

#[cfg(test)]
mod tests {
    use kerf_physics::{Quat, Vec3};

    use super::*;

    fn recording() -> Recording {
        let orientation = Quat::from_euler_angles(0.1, 0.2, 1.0 / 3.0);
        let pose = Pose { position_m: Vec3::new(0.1, -1e-300, 1.0 / 3.0), orientation };
        let input = |tool, motion| ToolInput { tool, motion };
        let step = |tools: &[ToolInput], relative_tolerance| LoggedInputs { tools: tools.into(), relative_tolerance };
        let steps = [
            step(&[], None),
            step(&[input(1, ToolMotion::enter_at(pose)), input(0, ToolMotion::enter_at(Pose::default()))], None),
            step(&[input(1, ToolMotion::move_to(pose))], Some(0.01 / 3.0)),
            step(&[input(1, ToolMotion::MoveTo { pose, opening: 0.1 / 3.0 })], Some(0.1)),
            step(&[input(1, ToolMotion::Lift)], None),
            step(&[], None),
        ];
        let mut log = InputLog::new(usize::MAX);
        steps.iter().for_each(|inputs| log.record(&inputs.as_inputs()));
        Recording { log, state_hash: Some(0x0123_4567_89ab_cdef) }
    }

    fn text(recording: &Recording) -> String {
        let mut bytes = Vec::new();
        recording.to_csv(&mut bytes).unwrap();
        String::from_utf8(bytes).unwrap()
    }

    #[test]
    fn a_recording_reads_back_to_the_same_bits() {
        let recording = recording();
        assert_eq!(Recording::from_csv(text(&recording).as_bytes(), 2).unwrap(), recording);
        let of_unknown_end = Recording { state_hash: None, ..recording };
        assert_eq!(Recording::from_csv(text(&of_unknown_end).as_bytes(), 2).unwrap(), of_unknown_end);
    }

    #[test]
    fn errors_name_row_and_column() {
        let text = text(&recording());
        let refused = |from: &str, to: &str| {
            assert!(text.contains(from), "{text}");
            format!("{:#}", Recording::from_csv(text.replacen(from, to, 1).as_bytes(), 2).unwrap_err())
        };
        assert_eq!(refused("2,1,move", "0,1,move"), "row 5: column step: 0 is below that of the row before");
        assert_eq!(refused("2,1,move", "2,7,move"), "row 5: column tool: 7, but the scene has 2");
        assert_eq!(refused("2,1,move,0.1", "2,1,move,up"), "row 5: column x_m: `up` is not a finite number");
        assert_eq!(refused("lift", "hop"), "row 8: column input: `hop` is none of enter, move, lift, tolerance, end");
        assert_eq!(refused("6,,end", "4,,end"), "row 9: column step: 4 leaves out the last step");
        assert_eq!(refused("6,,end", "99999999,,end"), "row 9: column step: 99999999 is more than 10000000");
        assert_eq!(refused("0.1,\n", "0.7,\n"), "row 6: column relative_tolerance: 0.7 is not between 0 and 0.5");
        assert!(refused("0,0,0,0,0,0,1", "0,0,0,0,0,0,2").starts_with("row 3: columns qx to qw"));
        assert_eq!(refused("1,0,enter", "1,1,enter"), "row 3: column tool: 1 has an input in this step already");
        assert_eq!(refused(text.lines().last().unwrap(), ""), "the recording has no end");
    }
}
