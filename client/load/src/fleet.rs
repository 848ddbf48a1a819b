//! The sessions of a run: what of them the server takes, and those that are only watched.

use std::collections::BTreeMap;
use std::time::Instant;

use anyhow::bail;
use kerf_access::Wire;
use kerf_proto::v1;
use tokio::sync::watch;
use tonic::Code;

use crate::args::Args;
use crate::session::{self, Refused, Session, Wishes};
use crate::viewer::{self, SharedTotals, ViewTotals};

/// The sessions that a run was given, and in what words others were refused.
pub struct Fleet {
    /// At least one; the first ones are driven.
    pub sessions: Vec<Session>,
    /// How often the server gave each reason.
    pub refusals: BTreeMap<String, u64>,
}

impl Fleet {
    /// Creates sessions of a scene, or joins one. A server that is full with fewer is one of the things that a run finds.
    ///
    /// # Errors
    /// What the server answers to the first one, or to another one beside that it is full.
    pub async fn open(args: &Args, channel: &Wire, wishes: Wishes) -> anyhow::Result<Self> {
        let mut fleet = Self { sessions: Vec::new(), refusals: BTreeMap::new() };
        for _ in 0..args.sessions {
            let opened = session::open(channel.clone(), args.scene.as_deref(), wishes, args.session.as_deref()).await;
            match opened {
                Ok(session) => fleet.sessions.push(session),
                Err(error) => match words(&error).filter(|_| !fleet.sessions.is_empty()) {
                    Some(words) => *fleet.refusals.entry(words).or_default() += 1,
                    None => {
                        let _ = fleet.close(channel).await;
                        return Err(error);
                    }
                },
            }
        }
        Ok(fleet)
    }

    /// The sessions that are driven, and those that are only watched.
    #[must_use]
    pub fn split(&self, stations: Option<u32>) -> (&[Session], &[Session]) {
        let driven = stations.map_or(self.sessions.len(), |stations| self.sessions.len().min(stations as usize));
        self.sessions.split_at(driven)
    }

    /// Ends the sessions that were created.
    ///
    /// # Errors
    /// What the server answers.
    pub async fn close(&self, channel: &Wire) -> anyhow::Result<()> {
        for session in self.sessions.iter().filter(|session| session.created) {
            session::close(channel.clone(), &session.description.session_id).await?;
        }
        Ok(())
    }
}

/// What a full server says.
fn words(error: &anyhow::Error) -> Option<String> {
    let refused = error.downcast_ref::<Refused>()?;
    (refused.status.code() == Code::ResourceExhausted).then(|| refused.status.message().to_owned())
}

/// What the viewers of sessions got that nobody drives.
#[derive(Default)]
pub struct Watched {
    /// All of them together.
    pub view: ViewTotals,
    /// How long, s.
    pub watched_s: f64,
}

/// Watches sessions that nobody drives until `over` turns true.
///
/// # Errors
/// A stream cannot be opened, breaks, or does not fit together too often.
pub async fn watch_resting(args: &Args, resting: &[Session], over: watch::Receiver<bool>) -> anyhow::Result<Watched> {
    let began = Instant::now();
    let mut watching = Vec::new();
    for session in resting {
        let totals = SharedTotals::default();
        let access = (args.server.clone(), args.access.clone());
        let request = view_request(args, session);
        watching.push((viewer::spawn(access, request, args.viewers, totals.clone(), over.clone())?, totals));
    }
    let mut watched = Watched::default();
    for (viewers, totals) in watching {
        join(viewers).await?;
        watched.view.add(&viewer::snapshot(&totals));
    }
    watched.watched_s = began.elapsed().as_secs_f64();
    Ok(watched)
}

/// What viewers ask for.
#[must_use]
pub fn view_request(args: &Args, session: &Session) -> v1::ViewRequest {
    v1::ViewRequest {
        protocol_version: kerf_proto::PROTOCOL_VERSION,
        session_id: session.description.session_id.clone(),
        rate_hz: args.view_rate,
        wants_energy: true,
        ..v1::ViewRequest::default()
    }
}

/// Waits for a thread without keeping others from the runtime.
///
/// # Errors
/// Its own, or that it died.
pub async fn join<T: Send + 'static>(thread: std::thread::JoinHandle<anyhow::Result<T>>) -> anyhow::Result<T> {
    match tokio::task::spawn_blocking(move || thread.join()).await? {
        Ok(outcome) => outcome,
        Err(_) => bail!("the viewers' thread died"),
    }
}
