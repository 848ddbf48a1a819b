//! Reading a journal: what brings its session back.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use kerf_physics::SoundScene;
use kerf_proto::v1;
use kerf_session::{Past, PastEntry};

use crate::recording::convert;
use crate::recording::reader::Recording;
use crate::recording::tracks::Track;

/// What brings a session back: of its files the newest that has a beginning. An older one is there where the server was
/// killed before the newer one was on the disk, and leads as far as that begins.
pub fn read(files: &[PathBuf]) -> Result<(SoundScene, Past)> {
    let mut why_not = None;
    for path in files.iter().rev() {
        match read_file(path) {
            Ok(read) => return Ok(read),
            Err(error) => {
                tracing::warn!(path = %path.display(), "not a whole file of a journal: {error:#}");
                why_not.get_or_insert(error);
            }
        }
    }
    Err(why_not.context("the journal has no file")?)
}

fn read_file(path: &Path) -> Result<(SoundScene, Past)> {
    let mut recording = Recording::open_journal(path)?;
    is_of_this_program(recording.header()).with_context(|| path.display().to_string())?;
    let past = past(&mut recording).with_context(|| path.display().to_string())?;
    let torn_bytes = recording.torn_bytes();
    if torn_bytes > 0 {
        let last_step = past.last_step();
        tracing::warn!(path = %path.display(), torn_bytes, last_step, "the end of the journal is not whole: what it had is lost");
    }
    let scene = convert::scene(recording.header()).context("the scene")?;
    Ok((scene.judge().context("the scene")?, past))
}

/// Steps taken once more lead to the same bits in the program that took them alone.
fn is_of_this_program(header: &v1::RecordingHeader) -> Result<()> {
    let found = (header.server_version.as_str(), header.target.as_str());
    let own = (crate::VERSION, convert::TARGET);
    ensure!(found == own, "the journal is of kerf-server {} on {}; this is {} on {}", found.0, found.1, own.0, own.1);
    Ok(())
}

fn past(recording: &mut Recording) -> Result<Past> {
    let (is_paused, owner) = (recording.header().is_paused, convert::owner(recording.header()));
    let mut past = Past { is_paused, owner, ..Past::default() };
    for index in 0..recording.chunks() {
        for entry in recording.chunk(index)? {
            match entry.track {
                Track::Base => {
                    let v1::RecordedBase { data, is_paused } = entry.read()?;
                    past = Past { base: Some(data), is_paused, entries: Vec::new(), ..past };
                }
                Track::Step => {
                    let step: v1::RecordedStep = entry.read()?;
                    let inputs = convert::inputs(&step)?;
                    past.entries.push(PastEntry::Step { step: step.step, inputs, state_hash: step.state_hash });
                }
                Track::Events => {
                    let happened = convert::event(&entry.read()?);
                    past.entries.extend(happened.map(|happened| PastEntry::Event(happened.event)));
                }
                Track::Checkpoint => {
                    let v1::RecordedCheckpoint { name, data } = entry.read()?;
                    past.entries.push(PastEntry::Checkpoint(name.into(), data));
                }
                _ => {}
            }
        }
    }
    Ok(past)
}
