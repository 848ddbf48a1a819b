//! A server with one session in virtual time, its journal on a disk that forgets, and what kills it.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use anyhow::Context;
use fastrand::Rng;
use futures_util::StreamExt;
use kerf_physics::Scene;
use kerf_scenes::dial::ParetoFronts;
use kerf_session::clock::MonotonicClock;
use kerf_session::{Reel, Registry, SceneEvent, Session, SessionOptions, TapeEntry};
use tokio::runtime::Handle;
use tokio::task::JoinHandle;
use tokio::time::sleep;
use tokio_stream::wrappers::UnboundedReceiverStream;

use super::network::Network;
use crate::config::ServerConfig;
use crate::grpc::viewing::Viewing;
use crate::journal::Journals;
use crate::journal::by_hand::Journal;
use crate::journal::files::Files;
use crate::journal::past;
use crate::journal::tests::BLOCK;
use crate::journal::virtual_disk::VirtualDisk;
use crate::metrics::refusals::Refusals;
use crate::recording::Recordings;
use crate::security::Security;
use crate::serve::{builder, routes};

/// How often the journal's thread looks at what there is, and the recorder's.
const LOOK: Duration = Duration::from_millis(5);

/// A step and the hash of the state after it.
pub type Footprint = (u64, u64);

/// What has happened to a session, over all its servers.
#[derive(Default)]
pub struct Track {
    /// The states that it had, in order, and when each was reached, ns.
    pub footprints: Vec<(Footprint, u64)>,
    /// Checkpoints: how long the track was, their name and their state.
    saved: Vec<(usize, Arc<str>, Footprint)>,
}

impl Track {
    /// Takes in what was found on the tape at `now_ns`.
    fn follow(&mut self, entry: &TapeEntry, now_ns: u64) {
        match entry {
            TapeEntry::Step(step) => {
                let hash = step.state_hash.expect("a recorded step has one");
                self.footprints.push(((step.report.step, hash), step.report.ended_ns));
            }
            TapeEntry::Event(happened) => match &happened.event {
                SceneEvent::CheckpointSaved(name) => {
                    let (now, _) = *self.footprints.last().expect("the scene at rest");
                    self.saved.push((self.footprints.len(), Arc::clone(name), now));
                }
                SceneEvent::CheckpointRestored(name) => {
                    let saved = self.saved.iter().rev().find(|(_, other, _)| other == name);
                    self.footprints.push((saved.expect("it was saved").2, now_ns));
                }
                SceneEvent::Reset => self.footprints.push((self.footprints[0].0, now_ns)),
                _ => {}
            },
            TapeEntry::Checkpoint(..) | TapeEntry::Base(_) => {}
        }
    }

    /// Goes back to where a kill at `killed_ns` has left the session; how many states the kill has taken, and how long
    /// before it the first of them was reached, ns.
    pub fn go_back(&mut self, to: &Footprint, killed_ns: u64) -> Option<(usize, u64)> {
        let back = self.footprints.iter().rposition(|(footprint, _)| footprint == to)? + 1;
        let first_ns = self.footprints.get(back).map_or(killed_ns, |(_, reached_ns)| *reached_ns);
        let taken = (self.footprints.len() - back, killed_ns.saturating_sub(first_ns));
        self.footprints.truncate(back);
        self.saved.retain(|(length, ..)| *length <= back);
        Some(taken)
    }
}

/// A server that runs.
pub struct Server {
    pub session: Arc<Session>,
    /// What it began with.
    pub began: Footprint,
    registry: Arc<Registry>,
    journal: Arc<Mutex<Journal>>,
    tasks: Vec<JoinHandle<()>>,
}

impl Server {
    /// Starts one that creates the session, or brings it back where the disk has confirmed so many footprints of it.
    ///
    /// # Errors
    /// The session does not come back.
    pub async fn start(
        network: &Network,
        (folder, disk): (&Path, &Arc<VirtualDisk>),
        track: &Arc<Mutex<Track>>,
        confirmed: Option<usize>,
        random: Rng,
    ) -> anyhow::Result<Self> {
        let config = Arc::new(ServerConfig::default());
        let registry = Arc::new(Registry::new(config.session.clone(), ParetoFronts::builtin())?);
        let options = SessionOptions { is_journaled: true, is_recorded: true, ..SessionOptions::default() };
        Files::remove_parts(folder)?;
        let session = if confirmed.is_some() {
            let (id, files) = Files::in_folder(folder)?.pop_first().context("there is no journal")?;
            registry.bring_back::<anyhow::Error>(id, move || past::read(&files), options).await?
        } else {
            let scene = Scene { desc: toml::from_str(BLOCK)?, meshes: Default::default() }.judge()?;
            registry.create(scene, options).await?
        };
        let status = session.describe().await?;
        let began = (status.step, status.state_hash);
        if confirmed.is_none() {
            track.lock().unwrap_or_else(PoisonError::into_inner).footprints.push((began, MonotonicClock::now_ns()));
        }
        let journal = Arc::new(Mutex::new(Journal::begin(folder, &session, disk, confirmed.unwrap_or_default())));
        let tasks = vec![
            tokio::spawn(serve(Arc::clone(&registry), config, network.listen())),
            tokio::spawn(follow(Arc::clone(&session), Arc::clone(track), Arc::clone(&journal), random)),
        ];
        Ok(Self { session, began, registry, journal, tasks })
    }

    /// Ends it as a kill does: nothing is said to anybody and nothing is written any more. How many footprints the disk
    /// had confirmed.
    pub async fn kill(self, network: &Network, disk: &VirtualDisk) -> usize {
        disk.kill();
        network.fall();
        self.tasks.iter().for_each(JoinHandle::abort);
        for task in self.tasks {
            let _ = task.await;
        }
        let confirmed = self.journal.lock().unwrap_or_else(PoisonError::into_inner).confirmed;
        drop(self.journal);
        drop(self.session);
        self.registry.close_all().await;
        confirmed
    }
}

/// Serves what the network brings.
async fn serve(
    registry: Arc<Registry>,
    config: Arc<ServerConfig>,
    accepted: tokio::sync::mpsc::UnboundedReceiver<tokio::io::DuplexStream>,
) {
    let security = Arc::new(Security::begin(&config, config.listen).expect("no files"));
    let kept = (Arc::new(Recordings::new(&config)), Arc::new(Journals::new(&config).expect("no folder")));
    let doors = (Arc::clone(&security), security.door(config.listen), Arc::<Refusals>::default());
    let viewing = Viewing::on(Handle::current());
    let (_health, routes) = routes(&registry, &config, (&kept.0, &kept.1), doors, viewing).await.expect("services");
    let accepted = UnboundedReceiverStream::new(accepted).map(Ok::<_, std::io::Error>);
    let ended = builder(&config.transport).add_routes(routes).serve_with_incoming(accepted).await;
    ended.expect("connections that break are no fault of the transport");
}

/// Writes the session's journal and its track, and lets the disk do its work as fast as the seed says.
async fn follow(session: Arc<Session>, track: Arc<Mutex<Track>>, journal: Arc<Mutex<Journal>>, mut random: Rng) {
    let reel = session.take_reel().expect("it is recorded");
    loop {
        look(&reel, &track, &journal, random.usize(0..4));
        sleep(LOOK).await;
    }
}

fn look(reel: &Reel, track: &Mutex<Track>, journal: &Mutex<Journal>, jobs: usize) {
    let (entries, _) = reel.tape.take();
    let mut track = track.lock().unwrap_or_else(PoisonError::into_inner);
    let now_ns = MonotonicClock::now_ns();
    entries.iter().for_each(|entry| track.follow(entry, now_ns));
    let mut journal = journal.lock().unwrap_or_else(PoisonError::into_inner);
    journal.now_ns = now_ns;
    journal.look(track.footprints.len());
    journal.sync(jobs);
}
