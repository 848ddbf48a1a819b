//! Whether a recording leads to the states that it says, step by step.

use std::collections::{BTreeSet, HashMap};
use std::sync::Arc;

use anyhow::{Context, Result, anyhow, ensure};
use kerf_physics::Workers;
use kerf_proto::v1;
use kerf_session::{Resimulation, SceneEvent};

use super::convert;
use super::reader::{Ending, Recording};
use super::tracks::Track;

/// A recording that holds what it says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Verified {
    /// Steps that were simulated once more.
    pub steps: u64,
    /// Times that the scene was put back to rest.
    pub resets: u64,
    /// Times that it went back to a checkpoint.
    pub restores: u64,
    /// Hash of the last state.
    pub state_hash: u64,
    /// How the file ends: one that is cut off was compared up to there.
    pub ending: Ending,
}

/// Simulates a recording once more, and compares the hash of the state after every step. `progress` hears of each step,
/// and how many there are.
///
/// # Errors
/// What cannot be read, the first step that differs, or that there is none.
pub fn verify(recording: &mut Recording, workers: &Workers<'_>, mut progress: impl FnMut(u64)) -> Result<Verified> {
    let scene = convert::scene(recording.header()).context("the recorded scene")?;
    let scene = scene.judge().context("the recorded scene")?;
    let Survey { steps, needed } = Survey::of(recording)?;
    let mut again = Resimulation::new(&scene)?;
    let (mut verified, mut saved) = (Verified::of(recording.ending()), 0);
    for index in 0..recording.chunks() {
        for entry in recording.chunk(index)? {
            match entry.track {
                Track::Step => {
                    let step: v1::RecordedStep = entry.read()?;
                    let inputs = convert::inputs(&step)?;
                    let compared = again.step(workers, step.step, &inputs, step.state_hash);
                    compared.map_err(|difference| verified.place(&difference))?;
                    verified.steps += 1;
                    verified.state_hash = step.state_hash.unwrap_or(verified.state_hash);
                    progress(steps);
                }
                Track::Events => {
                    let Some(happened) = convert::event(&entry.read()?) else { continue };
                    match &happened.event {
                        SceneEvent::Reset => verified.resets += 1,
                        SceneEvent::CheckpointRestored(_) => verified.restores += 1,
                        SceneEvent::CheckpointSaved(_) => {
                            saved += 1;
                            if !needed.contains(&saved) {
                                continue;
                            }
                        }
                        _ => {}
                    }
                    again.event(&happened.event).map_err(|difference| verified.place(&difference))?;
                }
                Track::Base => {
                    let v1::RecordedBase { data, .. } = entry.read()?;
                    again.go_on_from(&data).context("the state that the recording begins with")?;
                }
                Track::Checkpoint => {
                    saved += 1;
                    if needed.contains(&saved) {
                        let v1::RecordedCheckpoint { name, data } = entry.read()?;
                        let taken = again.take_checkpoint(&name, &data);
                        taken.with_context(|| format!("checkpoint {name:?}, which came as a file"))?;
                    }
                }
                _ => {}
            }
        }
    }
    ensure!(verified.steps > 0, "the recording has no steps: there is nothing to be verified");
    Ok(verified)
}

impl Verified {
    fn of(ending: Ending) -> Self {
        Self { steps: 0, resets: 0, restores: 0, state_hash: 0, ending }
    }

    /// A difference, and where in the session it is: steps count from a reset on, and again from a checkpoint.
    fn place(&self, difference: &kerf_session::Difference) -> anyhow::Error {
        let Self { steps, resets, restores, .. } = self;
        anyhow!("{difference}; {steps} steps before it agree, with {resets} resets and {restores} ways back among them")
    }
}

/// What a recording holds.
struct Survey {
    steps: u64,
    /// Which of the saved checkpoints, and of those that came as files, are gone back to: the others take memory for nothing.
    needed: BTreeSet<u64>,
}

impl Survey {
    fn of(recording: &mut Recording) -> Result<Self> {
        let mut survey = Self { steps: 0, needed: BTreeSet::new() };
        let (mut newest, mut saved) = (HashMap::<Arc<str>, u64>::new(), 0);
        for index in 0..recording.chunks() {
            for entry in recording.chunk(index)? {
                survey.steps += u64::from(entry.track == Track::Step);
                let happened = match entry.track {
                    Track::Events => convert::event(&entry.read()?).map(|happened| happened.event),
                    // Counts as saved: it is found among the checkpoints by its place, too.
                    Track::Checkpoint => {
                        let v1::RecordedCheckpoint { name, .. } = entry.read()?;
                        Some(SceneEvent::CheckpointSaved(name.into()))
                    }
                    _ => None,
                };
                match happened {
                    Some(SceneEvent::CheckpointSaved(name)) => {
                        saved += 1;
                        newest.insert(name, saved);
                    }
                    Some(SceneEvent::CheckpointRestored(name)) => survey.needed.extend(newest.get(&name)),
                    _ => {}
                }
            }
        }
        Ok(survey)
    }
}
