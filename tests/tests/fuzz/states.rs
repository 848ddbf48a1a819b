//! Files that the server writes and reads again: states, recordings, journals.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use kerf_physics::step_io::ToolMotion;
use kerf_physics::world::LoadError;
use kerf_physics::{NoClock, OPEN, Pose, Quat, Scene, StepInputs, ToolInput, Vec3, Workers, World};
use kerf_server::journal::past;
use kerf_server::recording::reader::Recording;
use mcap::{MessageStream, WriteOptions};

use super::messages::motions;
use super::{fuzz, kept};
use crate::grpc::harness::{BLOCK, Harness};
use kerf_proto::v1;

/// Where the checksum of a state's file stands.
const CHECKSUM: std::ops::Range<usize> = 12..20;

#[test]
fn state() {
    let scene = Scene { desc: toml::from_str(BLOCK).expect("a scene"), meshes: Default::default() };
    let scene = scene.judge().expect("a sound scene");
    let mut world = World::new(&scene).expect("a world");
    let mut files = vec![world.snapshot().save()];
    for step in 0..60 {
        let position_m = Vec3::new(0.0, 0.012 - 2e-4 * f64::from(step), 4e-4);
        let pose = Pose { position_m, orientation: Quat::identity() };
        let inputs = [ToolInput { tool: 0, motion: ToolMotion::MoveTo { pose, opening: OPEN } }];
        world.step(&Workers::serial(), &NoClock, &StepInputs::of(&inputs));
    }
    files.push(world.snapshot().save());
    let snapshot = world.snapshot();
    fuzz("state", &files, |bytes| {
        let mut bytes = bytes.to_vec();
        // As who writes files with intent would.
        if let Err(LoadError::Checksum { found, .. }) = snapshot.load(&bytes) {
            bytes[CHECKSUM].copy_from_slice(&found.to_le_bytes());
        }
        if let Err(refused) = snapshot.load(&bytes) {
            assert!(!refused.to_string().is_empty());
        }
    });
}

/// The files that a server has of a session that was cut: its recording, or its journal.
fn written(configure: impl FnOnce(&mut kerf_server::config::ServerConfig, &Path)) -> Vec<u8> {
    let folder = tempfile::tempdir().expect("a folder");
    let runtime =
        tokio::runtime::Builder::new_multi_thread().enable_all().worker_threads(1).build().expect("a runtime");
    runtime.block_on(async {
        let mut harness = Harness::with(|config| configure(config, folder.path())).await;
        let session_id = harness.create().await.expect("a session");
        harness.pause(&session_id).await;
        let inputs = motions();
        let request = v1::StepSessionRequest { session_id, steps: inputs.len() as u32, inputs };
        harness.sessions.step_session(request).await.expect("steps");
        harness.server.stop().await;
    });
    let found = std::fs::read_dir(folder.path()).expect("a folder").map(|entry| entry.expect("an entry").path());
    let path = found.filter(|path| path.extension().is_some_and(|extension| extension == "mcap")).max();
    std::fs::read(path.expect("a file")).expect("readable")
}

/// The same messages without compression and checksums, so that changes reach what is in them.
fn bare(file: &[u8]) -> Vec<u8> {
    let mut options = WriteOptions::new().compression(None).calculate_chunk_crcs(false);
    options = options.calculate_data_section_crc(false).calculate_summary_section_crc(false);
    let mut bare = options.create(Cursor::new(Vec::new())).expect("a writer");
    let messages = MessageStream::new_with_options(file, mcap::read::Options::IgnoreEndMagic.into()).expect("messages");
    // A journal has no end.
    for message in messages.map_while(Result::ok) {
        bare.write(&message).expect("written");
    }
    bare.finish().expect("written");
    bare.into_inner().into_inner()
}

/// A place for a file that is read.
fn place(target: &str, bytes: &[u8]) -> PathBuf {
    let path = kept(target).with_extension("mcap");
    std::fs::write(&path, bytes).expect("a place for inputs");
    path
}

#[test]
fn recording() {
    let file = written(|config, folder| config.record_dir = Some(folder.into()));
    fuzz("recording", &[bare(&file), file], |bytes| {
        let Ok(mut recording) = Recording::open(&place("recording", bytes)) else { return };
        for index in 0..recording.chunks() {
            for entry in recording.chunk(index).unwrap_or_default() {
                let _ = (entry.read::<v1::RecordedStep>(), entry.read::<v1::Keyframe>());
            }
        }
    });
}

#[test]
fn journal() {
    let file = written(|config, folder| config.journal_dir = Some(folder.into()));
    fuzz("journal", &[bare(&file), file], |bytes| drop(past::read(&[place("journal", bytes)])));
}
