//! How many sessions a run had, what the server said to others, and what became of those that nobody drove.

use std::collections::BTreeMap;
use std::fmt;

use serde::Serialize;

use super::{Steps, bytes, per};
use crate::args::Args;
use crate::fleet::Watched;

/// The sessions of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Sessions {
    /// Sessions that were asked for.
    pub asked: u32,
    /// Sessions that were driven; what the report says beside this is of them.
    pub driven: u32,
    /// Sessions that were only watched; absent where there are none.
    pub resting: Option<Resting>,
    /// What the server said where it was full.
    pub refusals: Vec<Refusal>,
}

/// Sessions that nobody drives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Resting {
    /// How many.
    pub sessions: u32,
    /// Their steps, all together.
    pub steps: Steps,
    /// Bytes a second and viewer.
    pub bytes_per_s: f64,
}

/// What the server said where it was full.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Refusal {
    /// How often.
    pub count: u64,
    /// Its words.
    pub words: String,
}

impl Sessions {
    /// Of so many sessions that were driven, and others that rested.
    #[must_use]
    pub fn of(
        args: &Args,
        (driven, resting): (u32, u32),
        refusals: &BTreeMap<String, u64>,
        Watched { view, watched_s }: &Watched,
    ) -> Self {
        let resting = (resting > 0).then(|| Resting {
            sessions: resting,
            steps: Steps::of(view),
            bytes_per_s: per(view.bytes, watched_s * f64::from(resting * args.viewers)),
        });
        let refusals = refusals.iter().map(|(words, &count)| Refusal { count, words: words.clone() }).collect();
        Self { asked: args.sessions, driven, resting, refusals }
    }
}

impl fmt::Display for Sessions {
    /// Lines of a report; none for a session alone.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { asked, driven, resting, refusals } = self;
        if *asked > 1 {
            writeln!(f, "sessions     {asked} asked for, {driven} driven")?;
        }
        if let Some(Resting { sessions, steps, bytes_per_s }) = resting {
            let late = 100.0 * steps.late_step_share;
            let (mean_ms, bytes) = (steps.step_mean_ms, bytes(*bytes_per_s));
            writeln!(f, "             {sessions} at rest: {late:.1} % late, mean {mean_ms:.3} ms, {bytes}/s a viewer")?;
        }
        refusals.iter().try_for_each(|Refusal { count, words }| writeln!(f, "             {count} refused: {words}"))
    }
}
