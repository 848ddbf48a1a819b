//! Journals that were cut, and whose bits were flipped.

use std::fs::File;
use std::io::{self, Cursor};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use kerf_physics::{OPEN, Pose, Quat, Scene, SceneDesc, SoundScene, Vec3};
use kerf_scenes::dial::ParetoFronts;
use kerf_session::clock::MonotonicClock;
use kerf_session::stepping::{StepMotion, Steps};
use kerf_session::{Past, PastEntry, PoseSample, Registry, SessionLimits, SessionOptions};

use kerf_proto::v1;

use super::files::Files;
use super::virtual_disk::{Faults, VirtualDisk};
use super::{Journals, past};
use crate::config::ServerConfig;
use crate::recording::Recordings;
use crate::recording::reader::{RECORD_HEAD_BYTES, Recording};
use crate::recording::tracks::{Track, Tracks};
use crate::storage::{PART, Storage, Stored, SystemDisk};

/// What sessions of tests are of.
pub const BLOCK: &str = include_str!("../../../session/tests/block.toml");

/// Where a blade is on its way down into the block.
pub fn place(step: usize) -> PoseSample {
    let position_m = Vec3::new(0.0, 0.012 - 2e-4 * step as f64, 4e-4);
    let pose = Pose { position_m, orientation: Quat::identity() };
    PoseSample { seq: 0, client_ns: 0, pose, opening: OPEN }
}

/// A block of few voxels: so that each byte of its journal can have its turn.
fn coarse_block() -> SoundScene {
    let mut desc: SceneDesc = toml::from_str(BLOCK).unwrap();
    desc.objects[0].resolution = Some(3);
    Scene { desc, meshes: Default::default() }.judge().unwrap()
}

/// Longer than anything here takes on a busy machine.
const PATIENCE: Duration = Duration::from_secs(60);

/// The journal of a session that takes so many steps, and goes on from a state in between.
async fn journal(folder: &Path, steps: usize) -> Vec<u8> {
    let config = ServerConfig { journal_dir: Some(folder.into()), ..ServerConfig::default() };
    let journals = Journals::new(&config).unwrap();
    let registry = Registry::new(SessionLimits::default(), ParetoFronts::builtin()).unwrap();
    let options = SessionOptions { is_journaled: true, start_paused: true, ..SessionOptions::default() };
    let session = registry.create(coarse_block(), options).await.unwrap();
    assert_eq!(journals.begin(&session), None);
    let at = |step: usize| vec![StepMotion { tool: 0, to: Some(place(step)) }];
    for step in 0..steps {
        session.step(Steps { count: 1, inputs: vec![at(step)] }).await.unwrap();
        // Chunks of several steps, and a state to go on from, without a checkpoint that there was.
        if step % 10 == 9 {
            until("the step in the file", async || step_in(folder) > step as u64).await;
        }
        if step == steps / 2 {
            session.save_checkpoint("kept").await.unwrap();
            session.save_checkpoint("left").await.unwrap();
            session.delete_checkpoint("left").await.unwrap();
        }
    }
    journals.stop();
    registry.close_all().await;
    journals.finish_all().await;
    let [file] = <[_; 1]>::try_from(files_in(folder)).unwrap();
    std::fs::read(file).unwrap()
}

/// Waits for something, but not for ever.
async fn until(what: &str, holds: impl AsyncFn() -> bool) {
    let wait = async {
        while !holds().await {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    };
    tokio::time::timeout(PATIENCE, wait).await.unwrap_or_else(|_| panic!("{what}: not within {PATIENCE:?}"));
}

/// The files of the only journal in a folder, once it has begun.
fn files_in(folder: &Path) -> Vec<PathBuf> {
    Files::in_folder(folder).unwrap().into_values().next().unwrap_or_default()
}

/// The step that they lead to now.
fn step_in(folder: &Path) -> u64 {
    past::read(&files_in(folder)).ok().and_then(|(_, past)| past.last_step()).unwrap_or(0)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_disk_that_fails_to_sync_ends_the_journal_without_a_retry_and_the_session_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let config = ServerConfig { journal_dir: Some(folder.path().into()), ..ServerConfig::default() };
    let faults = Faults { sync: 0.2, ..Faults::default() };
    let journals = Journals { storage: Arc::new(VirtualDisk::new(1, faults)), ..Journals::new(&config).unwrap() };
    let registry = Registry::new(SessionLimits::default(), ParetoFronts::builtin()).unwrap();
    let scene = Scene { desc: toml::from_str(BLOCK).unwrap(), meshes: Default::default() }.judge().unwrap();
    let options = SessionOptions { is_journaled: true, ..SessionOptions::default() };
    let session = registry.create(scene, options).await.unwrap();
    assert_eq!(journals.begin(&session), None);
    let error = || journals.so_far(session.id()).unwrap().error;
    until("the error", async || !error().is_empty()).await;
    assert!(error().contains("may not be on the disk") && error().contains("Input/output error"), "{}", error());
    assert_eq!(journals.health().broken_off.get(), 1);
    let (step, bytes) = (session.describe().await.unwrap().step, written(folder.path()));
    until("steps after it", async || session.describe().await.unwrap().step > step + 150).await;
    assert_eq!(written(folder.path()), bytes, "nothing is written to a disk that has lost something");
    registry.close_all().await;
    journals.finish_all().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_journal_that_cannot_be_begun_leaves_no_file() {
    let mut refused = 0;
    for seed in 0..10 {
        let registry = Registry::new(SessionLimits::default(), ParetoFronts::builtin()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let config = ServerConfig { journal_dir: Some(folder.path().into()), ..ServerConfig::default() };
        let storage = Arc::new(VirtualDisk::new(seed, Faults { full: 0.3, ..Faults::default() }));
        let journals = Journals { storage, ..Journals::new(&config).unwrap() };
        let scene = Scene { desc: toml::from_str(BLOCK).unwrap(), meshes: Default::default() }.judge().unwrap();
        let options = SessionOptions { is_journaled: true, start_paused: true, ..SessionOptions::default() };
        let session = registry.create(scene, options).await.unwrap();
        let error = journals.begin(&session);
        let names = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path());
        let parts = names.filter(|path| path.extension().is_some_and(|extension| extension == PART)).count();
        assert_eq!((Files::in_folder(folder.path()).unwrap().len(), parts), (usize::from(error.is_none()), 0));
        if let Some(error) = error {
            assert!(error.contains("no space left"), "{error}");
            refused += 1;
        }
        registry.close_all().await;
        journals.finish_all().await;
    }
    assert!(refused > 2, "{refused} of 10");
}

/// A disk that does nothing while it stalls.
#[derive(Debug, Default)]
struct StallingDisk(Arc<AtomicBool>);

#[derive(Debug)]
struct StallingFile {
    file: Arc<dyn Stored>,
    stalls: Arc<AtomicBool>,
}

impl Storage for StallingDisk {
    fn create(&self, path: &Path) -> io::Result<Arc<dyn Stored>> {
        Ok(Arc::new(StallingFile { file: SystemDisk.create(path)?, stalls: Arc::clone(&self.0) }))
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        SystemDisk.remove(path)
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        SystemDisk.rename(from, to)
    }

    fn sync_names(&self, folder: &Path) -> io::Result<()> {
        SystemDisk.sync_names(folder)
    }
}

impl Stored for StallingFile {
    fn append(&self, bytes: &[u8]) -> io::Result<()> {
        self.wait();
        self.file.append(bytes)
    }

    fn sync(&self) -> io::Result<()> {
        self.wait();
        self.file.sync()
    }
}

impl StallingFile {
    fn wait(&self) {
        while self.stalls.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_disk_that_stalls_holds_no_step_up_and_the_journal_has_them_all_afterwards() {
    let folder = tempfile::tempdir().unwrap();
    let config = ServerConfig { journal_dir: Some(folder.path().into()), ..ServerConfig::default() };
    let stalls = Arc::new(AtomicBool::new(false));
    let storage = Arc::new(StallingDisk(Arc::clone(&stalls)));
    let journals = Journals { storage, ..Journals::new(&config).unwrap() };
    let registry = Registry::new(SessionLimits::default(), ParetoFronts::builtin()).unwrap();
    let options = SessionOptions { is_journaled: true, start_paused: true, ..SessionOptions::default() };
    let session = registry.create(coarse_block(), options).await.unwrap();
    assert_eq!(journals.begin(&session), None);
    stalls.store(true, Ordering::Relaxed);
    let steps = async |count| session.step(Steps { count, inputs: vec![Vec::new(); 1] }).await.unwrap();
    for _ in 0..5 {
        steps(1000).await;
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    let before = session.describe().await.unwrap();
    assert_eq!(before.step, 5000, "no step waits for the disk");
    let lag_s = || journals.health().lag(MonotonicClock::now_ns()).oldest_s;
    assert!(lag_s() > 0.3, "{} s", lag_s());
    stalls.store(false, Ordering::Relaxed);
    journals.stop();
    registry.close_all().await;
    journals.finish_all().await;
    drop(journals);
    let journals = Journals::new(&config).unwrap();
    let registry = Registry::new(SessionLimits::default(), ParetoFronts::builtin()).unwrap();
    journals.bring_back(journals.left().unwrap(), &registry, &Recordings::new(&config)).await;
    let back = registry.get(&session.id().to_string()).unwrap().describe().await.unwrap();
    assert_eq!((back.step, back.state_hash), (before.step, before.state_hash));
    registry.close_all().await;
    journals.finish_all().await;
}

/// Bytes in a folder.
fn written(folder: &Path) -> u64 {
    std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().metadata().unwrap().len()).sum()
}

/// What says a journal: its base, and each step with its hash.
fn says(past: &Past) -> (Option<&Vec<u8>>, Vec<String>) {
    (
        past.base.as_ref(),
        past.entries
            .iter()
            .map(|entry| match entry {
                PastEntry::Step { step, inputs, state_hash } => format!("{step} {inputs:?} {state_hash:?}"),
                PastEntry::Event(event) => format!("{event:?}"),
                PastEntry::Checkpoint(name, file) => format!("{name} {}", file.len()),
            })
            .collect(),
    )
}

/// Whether a file leads as far along the same way, or is refused.
fn is_prefix_or_refused(path: &Path, (base, entries): &(Option<&Vec<u8>>, Vec<String>)) -> Option<usize> {
    let (_, past) = past::read(&[path.to_owned()]).ok()?;
    let (found_base, found) = says(&past);
    assert!(found.is_empty() && found_base.is_none() || found_base == *base, "another state to go on from");
    assert_eq!(found[..], entries[..found.len()], "another way");
    Some(found.len())
}

/// Where the records of a file begin: each with a byte for its kind and eight for its length.
fn record_offsets(file: &[u8]) -> Vec<usize> {
    let (mut offsets, mut offset) = (Vec::new(), mcap::MAGIC.len());
    while let Some(length) = file.get(offset + 1..).and_then(|rest| rest.first_chunk()) {
        offsets.push(offset);
        offset += RECORD_HEAD_BYTES + u64::from_le_bytes(*length) as usize;
    }
    offsets
}

#[tokio::test(flavor = "multi_thread")]
async fn a_journal_that_is_cut_at_any_byte_leads_to_a_prefix_or_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = journal(&folder.path().join("journals"), 40).await;
    let path = folder.path().join("session-00000001-1.000000000001.mcap");
    std::fs::write(&path, &bytes).unwrap();
    let whole = past::read(std::slice::from_ref(&path)).unwrap().1;
    let whole = says(&whole);
    assert!(whole.0.is_some() && whole.1.len() > 15, "{} entries", whole.1.len());
    let (mut refused, mut lengths) = (0, std::collections::BTreeSet::new());
    let file = File::options().write(true).open(&path).unwrap();
    for end in (0..bytes.len()).rev() {
        file.set_len(end as u64).unwrap();
        match is_prefix_or_refused(&path, &whole) {
            Some(length) => drop(lengths.insert(length)),
            None => refused += 1,
        }
    }
    println!("{} bytes: {refused} ends are refused, {} different prefixes", bytes.len(), lengths.len());
    // Without its first chunk, which has the scene and the state, there is nothing to go on from.
    assert!(lengths.len() > 2 && refused < bytes.len());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_journal_with_any_bit_flipped_leads_nowhere_else() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = journal(&folder.path().join("journals"), 40).await;
    let path = folder.path().join("session-00000001-1.000000000001.mcap");
    std::fs::write(&path, &bytes).unwrap();
    let whole = past::read(std::slice::from_ref(&path)).unwrap().1;
    let whole = says(&whole);
    let mut refused = 0;
    // A prime, so that every place of a record and every bit of a byte has its turn; and all that say what a record is.
    let kinds = record_offsets(&bytes).into_iter().flat_map(|offset| 8 * offset..8 * (offset + 1));
    let flips: Vec<usize> = (0..8 * bytes.len()).step_by(29).chain(kinds).collect();
    let file = File::options().write(true).open(&path).unwrap();
    for bit in &flips {
        let byte = bit / 8;
        file.write_at(&[bytes[byte] ^ 1 << (bit % 8)], byte as u64).unwrap();
        match is_prefix_or_refused(&path, &whole) {
            None => refused += 1,
            // The server was stopped: the disk had confirmed all entries.
            Some(entries) => assert_eq!(entries, whole.1.len(), "bit {bit}: entries that were confirmed are missing"),
        }
        file.write_at(&bytes[byte..=byte], byte as u64).unwrap();
    }
    println!("{refused} of {} flips are refused", flips.len());
    assert!(refused > flips.len() / 2);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_journal_of_another_version_or_processor_is_refused_by_both_names() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = journal(&folder.path().join("journals"), 3).await;
    let path = folder.path().join("session-00000001-1.000000000001.mcap");
    std::fs::write(&path, bytes).unwrap();
    let ours = Recording::open_journal(&path).unwrap().header().clone();
    let refused = |header: &v1::RecordingHeader| {
        // Without a state, which would be refused by itself.
        let mut file = Vec::new();
        let tracks =
            Tracks::begin(Cursor::new(&mut file), [Track::Header], |tracks| tracks.write(Track::Header, 0, header));
        tracks.unwrap().finish().unwrap();
        std::fs::write(&path, file).unwrap();
        past::read(std::slice::from_ref(&path)).err().map(|error| format!("{error:#}"))
    };
    assert_eq!(refused(&ours), None);
    let version = refused(&v1::RecordingHeader { server_version: "0.0.9".into(), ..ours.clone() }).unwrap();
    assert!(version.contains("kerf-server 0.0.9") && version.contains(&ours.server_version), "{version}");
    let target = refused(&v1::RecordingHeader { target: "aarch65".into(), ..ours.clone() }).unwrap();
    assert!(target.contains("on aarch65") && target.contains(&ours.target), "{target}");
}
