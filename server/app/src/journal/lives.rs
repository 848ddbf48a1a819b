//! Sessions that are killed, lose power, run out of disk and are brought back, by seed: a seed fails the same way each time.

use std::sync::Arc;

use kerf_physics::Scene;
use kerf_scenes::dial::ParetoFronts;
use kerf_session::stepping::{StepMotion, Steps};
use kerf_session::{CheckpointInfo, Registry, Session, SessionId, SessionLimits, SessionOptions};

use super::by_hand::{Journal, seeds};
use super::files::Files;
use super::past;
use super::tests::{BLOCK, place};
use super::virtual_disk::{Faults, VirtualDisk};

/// Seeds that are tried. The variable `LIVES` says another number, `LIVES_SEED` the first of them.
const SEEDS: u64 = 40;
const MS: u64 = 1_000_000;

/// A session after something has happened to it: its state and its checkpoints, as files.
#[derive(Debug, PartialEq)]
struct Image {
    state: Vec<u8>,
    checkpoints: Vec<(String, Vec<u8>)>,
}

impl Image {
    async fn of(session: &Session) -> Self {
        let mut checkpoints = Vec::new();
        for CheckpointInfo { name, .. } in session.checkpoints().await.unwrap() {
            let file = session.checkpoint(&name).await.unwrap().save();
            checkpoints.push((name, file));
        }
        Self { state: session.copy().await.unwrap().save(), checkpoints }
    }
}

/// What happened to the sessions of all seeds.
#[derive(Debug, Default)]
struct Tally {
    lives: usize,
    power_cuts: usize,
    /// Sessions that were lost, as the disk had confirmed nothing of them.
    lost: usize,
    /// Things that happened to a session and that a power cut took, at most.
    taken: usize,
}

async fn something(session: &Session, random: &mut fastrand::Rng) {
    let names = ["a", "b"];
    let name = names[random.usize(0..names.len())];
    let _ = match random.u32(0..16) {
        0 => session.save_checkpoint(name).await.map(drop),
        1 => session.delete_checkpoint(name).await,
        2 => session.restore_checkpoint(name).await.map(drop),
        3 => session.reset().await,
        _ => {
            let input = StepMotion { tool: 0, to: Some(place(random.usize(0..50))) };
            session.step(Steps { count: random.u32(1..4), inputs: vec![vec![input]] }).await.map(drop)
        }
    };
}

/// A session that is begun, and brought back a few times.
async fn lives(seed: u64, registry: &Registry, tally: &mut Tally) {
    let mut random = fastrand::Rng::with_seed(seed);
    let folder = tempfile::tempdir().unwrap();
    let faults = match random.u32(0..4) {
        0 => Faults { full: 0.05, sync: 0.0 },
        1 => Faults { full: 0.0, sync: 0.05 },
        _ => Faults::default(),
    };
    let disk = Arc::new(VirtualDisk::new(random.u64(..), faults));
    let scene = Scene { desc: toml::from_str(BLOCK).unwrap(), meshes: Default::default() }.judge().unwrap();
    let options = SessionOptions { is_journaled: true, start_paused: true, ..SessionOptions::default() };
    let mut session = registry.create(scene, options.clone()).await.unwrap();
    let id: SessionId = session.id();
    let mut images = vec![Image::of(&session).await];
    // Images that no power cut takes.
    let mut confirmed = 0;
    for life in 0..4 {
        tally.lives += 1;
        let mut journal = Journal::begin(folder.path(), &session, &disk, confirmed);
        for _ in 0..random.usize(0..30) {
            something(&session, &mut random).await;
            images.push(Image::of(&session).await);
            journal.now_ns += random.u64(0..40) * MS;
            if random.u32(0..10) < 7 {
                journal.look(images.len());
            }
            journal.sync(random.usize(0..4));
        }
        let written = journal.written;
        confirmed = journal.confirmed;
        disk.kill();
        drop(journal);
        registry.close(&id.to_string()).await.unwrap();
        let is_power_cut = random.bool();
        if is_power_cut {
            disk.cut_power();
            tally.power_cuts += 1;
        }

        Files::remove_parts(folder.path()).unwrap();
        let files = Files::in_folder(folder.path()).unwrap().remove(&id).unwrap_or_default();
        let read = move || past::read(&files);
        session = match registry.bring_back::<anyhow::Error>(id, read, options.clone()).await {
            Ok(session) => session,
            Err(error) => {
                assert!(confirmed == 0, "seed {seed}, life {life}: {confirmed} images are lost: {error:#}");
                tally.lost += 1;
                return;
            }
        };
        let image = Image::of(&session).await;
        let back = images.iter().rposition(|other| *other == image).map_or(0, |index| index + 1);
        assert!(
            back >= confirmed && back > 0,
            "seed {seed}, life {life}, {} {faults:?}: {confirmed} of {} images are confirmed, {back} are back",
            if is_power_cut { "a power cut" } else { "a kill" },
            images.len()
        );
        if is_power_cut {
            tally.taken = tally.taken.max(written.saturating_sub(back));
            confirmed = back;
        }
        images.truncate(back);
    }
    registry.close(&id.to_string()).await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn what_the_disk_has_confirmed_survives_kills_power_cuts_and_faults_of_the_disk() {
    let registry = Registry::new(SessionLimits::default(), ParetoFronts::builtin()).unwrap();
    let mut tally = Tally::default();
    for seed in seeds("LIVES", SEEDS) {
        lives(seed, &registry, &mut tally).await;
    }
    println!("{tally:?}");
}
