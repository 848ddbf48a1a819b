//! Files that the server writes and reads again: states, recordings, journals.

use std::io::{Cursor, Write};
use std::net::SocketAddr;
use std::path::Path;
use std::sync::LazyLock;

use kerf_physics::step_io::ToolMotion;
use kerf_physics::world::{LoadError, Snapshot};
use kerf_physics::{NoClock, OPEN, Pose, Quat, StepInputs, ToolInput, Vec3, Workers, World};
use kerf_proto::v1;
use kerf_proto::v1::create_session_request;
use kerf_proto::v1::session_service_client::SessionServiceClient;
use kerf_server::config::ServerConfig;
use kerf_server::journal::past;
use kerf_server::recording::reader::Recording;
use kerf_server::serve::Server;
use mcap::{MessageStream, WriteOptions};
use tempfile::NamedTempFile;

use super::messages::motions;
use super::{BLOCK, Reader, block, runtime};

/// Where the checksum of a state's file stands.
const CHECKSUM: std::ops::Range<usize> = 12..20;

/// A state at rest, one with a cut, and what reads them.
static STATES: LazyLock<([Vec<u8>; 2], Snapshot)> = LazyLock::new(|| {
    let mut world = World::new(&block()).expect("a world");
    let at_rest = world.snapshot().save();
    for step in 0..60 {
        let position_m = Vec3::new(0.0, 0.012 - 2e-4 * f64::from(step), 4e-4);
        let pose = Pose { position_m, orientation: Quat::identity() };
        let inputs = [ToolInput { tool: 0, motion: ToolMotion::MoveTo { pose, opening: OPEN } }];
        world.step(&Workers::serial(), &NoClock, &StepInputs::of(&inputs));
    }
    let snapshot = world.snapshot();
    ([at_rest, snapshot.save()], snapshot)
});

/// A world's state.
pub const STATE: Reader = Reader {
    name: "state",
    seeds: || STATES.0.to_vec(),
    read: |bytes| {
        let (_, snapshot) = &*STATES;
        let mut bytes = bytes.to_vec();
        // As who writes files with intent would.
        if let Err(LoadError::Checksum { found, .. }) = snapshot.load(&bytes) {
            bytes[CHECKSUM].copy_from_slice(&found.to_le_bytes());
        }
        if let Err(refused) = snapshot.load(&bytes) {
            assert!(!refused.to_string().is_empty());
        }
    },
};

/// What a session was like, to be seen again.
pub const RECORDING: Reader = Reader {
    name: "recording",
    seeds: || {
        let file = written(|config, folder| config.record_dir = Some(folder.into()));
        vec![bare(&file), file]
    },
    read: |bytes| {
        let Ok(mut recording) = Recording::open(place(bytes).path()) else { return };
        for index in 0..recording.chunks() {
            for entry in recording.chunk(index).unwrap_or_default() {
                let _ = (entry.read::<v1::RecordedStep>(), entry.read::<v1::Keyframe>());
            }
        }
    },
};

/// What brings a session back.
pub const JOURNAL: Reader = Reader {
    name: "journal",
    seeds: || {
        let file = written(|config, folder| config.journal_dir = Some(folder.into()));
        vec![bare(&file), file]
    },
    read: |bytes| drop(past::read(&[place(bytes).path().to_owned()])),
};

/// The file that a server has of a session that was cut: its recording, or its journal.
fn written(configure: impl FnOnce(&mut ServerConfig, &Path)) -> Vec<u8> {
    let folder = tempfile::tempdir().expect("a folder");
    let mut config = ServerConfig { listen: SocketAddr::from(([127, 0, 0, 1], 0)), ..ServerConfig::default() };
    configure(&mut config, folder.path());
    let runtime = runtime();
    runtime.block_on(async {
        let server = Server::start(config).await.expect("the server starts");
        let address = format!("http://{}", server.address());
        let mut sessions = SessionServiceClient::connect(address).await.expect("a connection");
        let scene = Some(create_session_request::Scene::SceneToml(BLOCK.into()));
        let request = v1::CreateSessionRequest { scene, ..Default::default() };
        let created = sessions.create_session(request).await.expect("a session").into_inner();
        let session_id = created.session.expect("a description").session_id;
        let request = v1::PauseSessionRequest { session_id: session_id.clone() };
        sessions.pause_session(request).await.expect("a pause");
        let inputs = motions();
        let request = v1::StepSessionRequest { session_id, steps: inputs.len() as u32, inputs };
        sessions.step_session(request).await.expect("steps");
        server.stop().await;
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
fn place(bytes: &[u8]) -> NamedTempFile {
    let mut place = NamedTempFile::new().expect("a place for inputs");
    place.write_all(bytes).expect("a place for inputs");
    place
}
