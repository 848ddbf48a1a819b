//! Recordings: what is in them, what ends them early, what they lead to once more, and what viewers see of them.

use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use kerf_physics::{Scene, SceneDesc, Workers};
use kerf_proto::v1;
use kerf_scenes::dial::ParetoFronts;
use kerf_server::recording::convert::{object_stats, scene};
use kerf_server::recording::reader::{Ending, Recording};
use kerf_server::recording::verify::{Verified, verify};
use kerf_server::recording::{FileFootage, Pictures, Told, Writer};
use kerf_session::stepping::Steps;
use kerf_session::{
    Footage as _, Frame, Registry, Replay, Seek as SeekTo, Session, SessionLimits, SessionOptions, Structure,
};
use mcap::MessageStream;
use mcap::read::Summary;
use mcap::records::op;
use prost::Message;
use tonic::Code;

use super::cut::{ABOVE_M, FOOT_M, MIDDLE_M, Stroke, Watcher};
use super::harness::{BLOCK, Harness, Station, hello, no_expiry, soon};

async fn recording_harness(folder: &Path) -> Harness {
    Harness::with(|config| {
        no_expiry(config);
        config.record_dir = Some(folder.into());
        config.record_surface = true;
    })
    .await
}

async fn close(harness: &mut Harness, session_id: &str) -> v1::Recording {
    let request = v1::CloseSessionRequest { session_id: session_id.into() };
    harness.sessions.close_session(request).await.unwrap().into_inner().recording.expect("a recording")
}

/// A cut with a checkpoint and the way back to it, a reset and half a cut; the file, and the state in the end.
async fn recorded_cut(folder: &Path) -> (PathBuf, v1::SessionDescription) {
    let mut harness = recording_harness(folder).await;
    let session = harness.create().await.unwrap();
    let mut stroke = Stroke::begin(&harness, &session).await;
    stroke.press(ABOVE_M, MIDDLE_M).await;
    let (session_id, name) = (session.clone(), "half way".to_owned());
    let save = v1::SaveCheckpointRequest { session_id: session_id.clone(), name: name.clone() };
    harness.sessions.save_checkpoint(save).await.unwrap();
    stroke.press(MIDDLE_M, FOOT_M).await;
    harness.sessions.restore_checkpoint(v1::RestoreCheckpointRequest { session_id, name }).await.unwrap();
    stroke.press(MIDDLE_M, 0.0).await;
    let path = folder.join(harness.describe(&session).await.recording.expect("a recording").file);
    until_shown(&path, |frames| keyframes(frames) >= 2).await;
    harness.reset(&session).await;
    stroke.press(ABOVE_M, MIDDLE_M).await;
    harness.pause(&session).await;
    let last = harness.describe(&session).await;
    // No state is recorded sooner after another than the recording's rate.
    let is_near = |frame: &Frame| frame.state.step + 50 >= last.step;
    until_shown(&path, |frames| keyframes(frames) >= 3 && frames.last().is_some_and(is_near)).await;
    drop(stroke);
    let recording = close(&mut harness, &session).await;
    assert!(recording.error.is_empty() && !recording.is_cut_off, "{recording:?}");
    (path, last)
}

/// The frames of a recording, which may still grow.
fn frames(path: &Path) -> Vec<Frame> {
    let mut footage = FileFootage::new(Recording::open(path).unwrap());
    std::iter::from_fn(|| footage.next().unwrap()).collect()
}

fn keyframes(frames: &[Frame]) -> usize {
    frames.iter().flat_map(|frame| &frame.structure).filter(|change| matches!(change, Structure::Keyframe(_))).count()
}

/// Waits until pictures have come to the file: the session waits for none, and on a busy machine they come late.
async fn until_shown(path: &Path, holds: impl Fn(&[Frame]) -> bool) {
    soon("pictures in the file", async {
        while !holds(&frames(path)) {
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    })
    .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_driver_without_models_and_one_with_them_are_recorded_alike() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = recording_harness(folder.path()).await;
    let session = harness.create().await.unwrap();
    for (without_models, foot_m) in [(true, MIDDLE_M), (false, FOOT_M), (true, FOOT_M)] {
        let hello = v1::ClientHello { without_models, ..hello(&session, &[0]) };
        let mut stroke = Stroke::of(Station::open(harness.channel.clone(), hello).await.unwrap());
        stroke.press(ABOVE_M, foot_m).await;
        drop(stroke);
        harness.until(&session, |described| described.leased_tool_ids.is_empty()).await;
    }
    harness.pause(&session).await;
    let last = harness.describe(&session).await;
    let recording = close(&mut harness, &session).await;
    let whole = verified(&folder.path().join(recording.file)).unwrap();
    assert!(last.topology_version > 0, "it cuts");
    assert_eq!((whole.steps, whole.state_hash), (last.step, last.state_hash));
}

fn verified(path: &Path) -> Result<Verified, String> {
    let mut recording = Recording::open(path).map_err(|error| format!("{error:#}"))?;
    verify(&mut recording, &Workers::serial(), |_| ()).map_err(|error| format!("{error:#}"))
}

/// The file once more, with some messages changed; `None` leaves one out.
fn rewritten(path: &Path, to: &Path, mut change: impl FnMut(&str, &[u8]) -> Option<Vec<u8>>) {
    let bytes = std::fs::read(path).unwrap();
    let mut writer = mcap::Writer::new(io::Cursor::new(Vec::new())).unwrap();
    for message in MessageStream::new(&bytes).unwrap() {
        let mut message = message.unwrap();
        let Some(data) = change(&message.channel.topic, &message.data) else { continue };
        message.data = data.into();
        writer.write(&message).unwrap();
    }
    writer.finish().unwrap();
    std::fs::write(to, writer.into_inner().into_inner()).unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_leads_to_every_state_once_more_and_one_that_was_tampered_with_does_not() {
    let folder = tempfile::tempdir().unwrap();
    let (path, last) = recorded_cut(folder.path()).await;
    let whole = verified(&path).unwrap();
    let expected =
        Verified { steps: whole.steps, resets: 1, restores: 1, state_hash: last.state_hash, ending: Ending::Whole };
    assert_eq!(whole, expected);
    assert!(whole.steps > last.step, "the steps before the reset are in it too");

    let tampered = folder.path().join("tampered.mcap");
    let mut steps = 0;
    rewritten(&path, &tampered, |topic, data| {
        let mut data = data.to_vec();
        if topic == "/session/step" {
            let mut step = v1::RecordedStep::decode(&*data).unwrap();
            steps += 1;
            step.state_hash = step.state_hash.map(|hash| hash ^ u64::from(steps == 40));
            data = step.encode_to_vec();
        }
        Some(data)
    });
    let refused = verified(&tampered).unwrap_err();
    assert!(refused.starts_with("step 40: ") && refused.contains("39 steps before it agree"), "{refused}");

    let mut steps = 0;
    rewritten(&path, &tampered, |topic, data| {
        steps += u32::from(topic == "/session/step");
        (topic != "/session/step" || steps != 7).then(|| data.to_vec())
    });
    let refused = verified(&tampered).unwrap_err();
    assert!(refused.starts_with("step 8 is recorded where step 7 should be"), "{refused}");

    rewritten(&path, &tampered, |topic, data| {
        (topic != "/session/step" && topic != "/session/events").then(|| data.to_vec())
    });
    assert_eq!(verified(&tampered).unwrap_err(), "the recording has no steps: there is nothing to be verified");

    rewritten(&path, &tampered, |topic, data| (topic != "/session/events").then(|| data.to_vec()));
    assert!(verified(&tampered).is_err(), "without its reset and its way back it leads elsewhere");
}

#[tokio::test(flavor = "multi_thread")]
async fn other_programs_read_a_recording_by_its_own_schemas() {
    let folder = tempfile::tempdir().unwrap();
    let (path, last) = recorded_cut(folder.path()).await;
    let bytes = std::fs::read(&path).unwrap();
    let summary = Summary::read(&bytes).unwrap().expect("an index");
    let mut topics = std::collections::BTreeMap::<String, u64>::new();
    let mut newest_ns = 0;
    for message in MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        assert!(message.log_time >= newest_ns, "times go back on {}", message.channel.topic);
        newest_ns = message.log_time;
        *topics.entry(message.channel.topic.clone()).or_default() += 1;
        let schema = message.channel.schema.as_ref().expect("a schema");
        assert_eq!((message.channel.message_encoding.as_str(), schema.encoding.as_str()), ("protobuf", "protobuf"));
        // The message is among the files that the schema brings along, with all that they import.
        let files = prost_types::FileDescriptorSet::decode(&*schema.data).unwrap().file;
        let named = files
            .iter()
            .flat_map(|file| file.message_type.iter().map(|message| format!("{}.{}", file.package(), message.name())));
        assert!(named.into_iter().any(|name| name == schema.name), "{}", schema.name);
        let imports = files.iter().flat_map(|file| &file.dependency);
        assert!(imports.clone().all(|name| files.iter().any(|file| file.name() == name)), "{}", schema.name);
    }
    let stats = summary.stats.expect("statistics");
    assert_eq!(stats.message_count, topics.values().sum::<u64>());
    let steps = topics["/session/step"];
    for topic in ["/tool/0/contact", "/tool/0/pose", "/energy", "/view/state", "/session/events", "/surface"] {
        assert!(topics[topic] > 3, "{topic}: {topics:?}");
    }
    assert!(topics["/tool/0/contact"] <= steps && steps > last.step);
    assert_eq!(topics["/view/state"], topics["/energy"]);
    assert!(topics["/view/keyframe"] >= 3, "one in the beginning, one after the way back, one after the reset");
}

/// A recording on a server of its own.
async fn play(path: &Path) -> (Harness, String) {
    let harness = Harness::with(no_expiry).await;
    let recording = Recording::open(path).unwrap();
    let replay = Replay {
        scene: scene(recording.header()).unwrap(),
        objects: object_stats(recording.header()),
        footage: Box::new(FileFootage::new(recording)),
        seek: SeekTo { time_s: Some(0.0), speed: Some(1.0) },
    };
    let session = harness.server.registry().play(replay).unwrap();
    (harness, session.id().to_string())
}

async fn seek(harness: &mut Harness, session: &str, time_s: Option<f64>, speed: Option<f64>) -> v1::SeekReplayResponse {
    let request = v1::SeekReplayRequest { session_id: session.into(), time_s, speed };
    harness.sessions.seek_replay(request).await.unwrap().into_inner()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_is_played_with_the_surfaces_that_were_live() {
    let folder = tempfile::tempdir().unwrap();
    let mut live = recording_harness(folder.path()).await;
    let session = live.create().await.unwrap();
    let mut watcher = Watcher::join(&live, live.channel.clone(), &session).await;
    let mut stroke = Stroke::begin(&live, &session).await;
    watcher.during(stroke.press(ABOVE_M, FOOT_M)).await;
    live.pause(&session).await;
    let version = live.describe(&session).await.topology_version;
    watcher.until(|replica| replica.topology_version() == Some(version) && replica.moment().is_some()).await;
    let path = folder.path().join(live.describe(&session).await.recording.expect("a recording").file);
    until_shown(&path, |frames| frames.last().is_some_and(|frame| frame.state.topology_version == version)).await;
    drop(stroke);
    close(&mut live, &session).await;

    let (mut harness, session) = play(&path).await;
    let mut replayed = Watcher::join(&harness, harness.channel.clone(), &session).await;
    replayed.until(|replica| replica.topology_version() == Some(version) && replica.moment().is_some()).await;
    // The replica has checked the hash of every structure on the way, and those in common are the live ones.
    let common = replayed.hashes().into_iter().filter(|(version, hash)| watcher.hashes().get(version) == Some(hash));
    assert!(common.count() > 3 && replayed.hashes()[&version] == watcher.hashes()[&version]);

    let described = harness.describe(&session).await;
    let scene = described.scene.expect("the recorded scene");
    assert!(scene.name == "block" && scene.objects[0].voxels == 6 * 6 * 6, "{scene:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_recording_is_paused_stepped_sought_and_not_changed() {
    let folder = tempfile::tempdir().unwrap();
    let (path, last) = recorded_cut(folder.path()).await;
    let frames = frames(&path);
    let (mut harness, session) = play(&path).await;
    let listed = harness.sessions.list_sessions(v1::ListSessionsRequest {}).await.unwrap().into_inner();
    assert!(listed.sessions.iter().any(|listed| listed.session_id == session && listed.is_replay));

    let paused = harness.pause(&session).await;
    let step = v1::StepSessionRequest { session_id: session.clone(), steps: 2, inputs: Vec::new() };
    harness.sessions.step_session(step).await.unwrap();
    harness.until(&session, |described| described.step > paused).await;
    assert_eq!(harness.describe(&session).await.state(), v1::SessionState::Paused);

    let at = seek(&mut harness, &session, None, None).await;
    assert!(at.length_s > 0.5 && at.speed == 1.0, "{at:?}");
    let mut watcher = Watcher::join(&harness, harness.channel.clone(), &session).await;
    // There and back: the structure of each time, from a keyframe or through patches.
    let end = seek(&mut harness, &session, Some(1e6), Some(20.0)).await;
    assert!(end.step + 50 >= last.step && end.speed == 20.0, "{end:?} of {}", last.step);
    watcher.until(|replica| replica.moment().is_some_and(|moment| moment.step == end.step)).await;
    let start = seek(&mut harness, &session, Some(0.0), None).await;
    watcher.until(|replica| replica.moment().is_some_and(|moment| moment.step == start.step)).await;
    assert_eq!((watcher.replica.topology_version(), start.speed), (Some(0), 20.0));
    for share in [0.9, 0.2, 0.6, 0.4] {
        let sought_s = share * end.length_s;
        let at = seek(&mut harness, &session, Some(sought_s), None).await;
        // However far apart a busy machine recorded them.
        let newest = frames.iter().rfind(|frame| frame.time_ns as f64 * 1e-9 <= sought_s).unwrap();
        assert_eq!((at.time_s, at.step), (newest.time_ns as f64 * 1e-9, newest.state.step), "sought {sought_s}");
        watcher.until(|replica| replica.moment().is_some_and(|moment| moment.step == at.step)).await;
    }
    // At its speed to the end, where it stands.
    let resume = v1::ResumeSessionRequest { session_id: session.clone() };
    harness.sessions.resume_session(resume).await.unwrap();
    harness
        .until(&session, |described| described.state() == v1::SessionState::Paused && described.step == end.step)
        .await;

    assert_eq!(harness.drive(&session, &[0]).await.err().map(|status| status.code()), Some(Code::FailedPrecondition));
    let reset = v1::ResetSessionRequest { session_id: session.clone() };
    let refused = harness.sessions.reset_session(reset).await.unwrap_err();
    assert!(refused.code() == Code::FailedPrecondition && refused.message().contains("recording that is played"));
    let refused =
        harness.sessions.seek_replay(v1::SeekReplayRequest { session_id: session, speed: Some(0.0), time_s: None });
    assert_eq!(refused.await.unwrap_err().code(), Code::InvalidArgument);
    let simulated = harness.create().await.unwrap();
    let request = v1::SeekReplayRequest { session_id: simulated, ..Default::default() };
    assert_eq!(harness.sessions.seek_replay(request).await.unwrap_err().code(), Code::FailedPrecondition);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_full_folder_ends_recordings_and_their_clients_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let mut harness = Harness::with(|config| {
        config.record_dir = Some(folder.path().into());
        // The header fits, and a chunk or two.
        config.max_record_mib = 0.02;
    })
    .await;
    let session = harness.create().await.unwrap();
    harness
        .until(&session, |described| described.recording.as_ref().is_some_and(|recording| recording.is_cut_off))
        .await;
    let described = harness.describe(&session).await;
    let told = described.recording.unwrap();
    assert!(told.error.contains("max_record_mib") && told.steps > 0, "{told:?}");
    harness.until(&session, |now| now.step > described.step + 50).await;
    assert_eq!(close(&mut harness, &session).await, told);
    // It is closed properly, and holds what it says.
    let verified = verified(&folder.path().join(&told.file)).unwrap();
    assert_eq!((verified.steps, verified.ending), (told.steps, Ending::Whole));

    let create = |scene: String| v1::CreateSessionRequest {
        scene: Some(v1::create_session_request::Scene::SceneToml(scene)),
        ..Default::default()
    };
    let created = harness.sessions.create_session(create(BLOCK.into())).await.unwrap().into_inner();
    assert!(created.warnings.iter().any(|warning| warning.contains("max_record_mib")), "{:?}", created.warnings);
    let refused = close(&mut harness, &created.session.unwrap().session_id).await;
    assert!(refused.file.is_empty() && refused.error.contains("max_record_mib"), "{refused:?}");
}

/// A disk that is full after so many bytes, or stalls while it is told to.
struct Disk {
    room: usize,
    stalls: Arc<AtomicBool>,
    written: Arc<Mutex<Vec<u8>>>,
}

impl Write for Disk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        while self.stalls.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(5));
        }
        let mut written = self.written.lock().unwrap();
        if written.len() + bytes.len() > self.room {
            return Err(io::Error::from_raw_os_error(28));
        }
        written.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for Disk {
    fn seek(&mut self, _: SeekFrom) -> io::Result<u64> {
        Ok(self.written.lock().unwrap().len() as u64)
    }
}

/// A session that is recorded to such a disk, and what is told of that.
async fn recorded_to(disk: Disk) -> (Registry, Arc<Session>, Arc<Told>) {
    let registry = Registry::new(SessionLimits::default(), ParetoFronts::default()).unwrap();
    let desc = toml::from_str::<SceneDesc>(BLOCK).unwrap();
    let options = SessionOptions { is_recorded: true, ..SessionOptions::default() };
    let session = registry.create(Scene { desc, meshes: Default::default() }.judge().unwrap(), options).await.unwrap();
    let header = v1::RecordingHeader { version: 2, scene_toml: BLOCK.into(), ..Default::default() };
    let (told, pictures) = (Arc::new(Told::default()), Pictures { rate_hz: 30.0, with_surface: false });
    let reel = session.take_reel().unwrap();
    let writer = Writer::begin(disk, &header, reel, pictures, Arc::clone(&told), || Ok(())).unwrap();
    std::thread::spawn(move || writer.run());
    (registry, session, told)
}

async fn ended(told: &Told) -> v1::Recording {
    soon("the end of the recording", async {
        while told.so_far().error.is_empty() {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
        told.so_far()
    })
    .await
}

#[tokio::test(flavor = "multi_thread")]
async fn a_full_disk_ends_the_recording_and_not_the_session() {
    let disk = Disk { room: 60_000, stalls: Arc::default(), written: Arc::default() };
    let (_registry, session, told) = recorded_to(disk).await;
    let recording = ended(&told).await;
    assert!(recording.is_cut_off && recording.error.contains("no space left on device"), "{recording:?}");
    let step = session.describe().await.unwrap().step;
    soon("20 steps more", async {
        while session.describe().await.unwrap().step <= step + 20 {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    })
    .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_disk_that_stalls_holds_no_step_up_and_what_waits_is_bounded() {
    let stalls = Arc::new(AtomicBool::new(false));
    let disk = Disk { room: usize::MAX, stalls: Arc::clone(&stalls), written: Arc::default() };
    let written = Arc::clone(&disk.written);
    let (_registry, session, told) = recorded_to(disk).await;
    stalls.store(true, Ordering::Relaxed);
    // Long enough for a chunk to be due.
    tokio::time::sleep(Duration::from_millis(700)).await;
    let before = session.pause().await.unwrap();
    for _ in 0..18 {
        let stepped = session.step(Steps { count: 1000, inputs: Vec::new() }).await.unwrap();
        assert_eq!(stepped.outcomes.len(), 1000);
    }
    assert_eq!(session.describe().await.unwrap().step, before + 18_000, "no step waits for the disk");
    stalls.store(false, Ordering::Relaxed);
    let recording = ended(&told).await;
    assert!(recording.is_cut_off && recording.error.contains("16384 steps and events waited"), "{recording:?}");
    // What was taken in before there was no more room is whole.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stalled.mcap");
    std::fs::write(&path, &*written.lock().unwrap()).unwrap();
    let verified = verified(&path).unwrap();
    assert!(verified.steps == recording.steps && verified.steps >= 16_000, "{verified:?}, {recording:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn files_that_are_no_recordings_are_refused_in_words() {
    let folder = tempfile::tempdir().unwrap();
    let (path, _) = recorded_cut(folder.path()).await;
    let bytes = std::fs::read(&path).unwrap();
    let other = folder.path().join("other.mcap");
    let refused = |bytes: &[u8]| {
        std::fs::write(&other, bytes).unwrap();
        verified(&other).unwrap_err()
    };
    assert!(verified(&folder.path().join("none.mcap")).unwrap_err().contains("no such file"));
    assert!(refused(b"step,tool,input").ends_with("this is no MCAP file"));
    assert!(refused(&[]).ends_with("this is no MCAP file"));
    assert!(refused(&bytes[..60]).contains("ends before its first chunk is whole"));
    // Wherever it is cut, what is whole before is read.
    for share in [3, 5, 8] {
        std::fs::write(&other, &bytes[..bytes.len() * share / 10]).unwrap();
        assert_eq!(Recording::open(&other).unwrap().ending(), Ending::CutOff);
    }
    let second = Summary::read(&bytes).unwrap().expect("an index").chunk_indexes[1].chunk_start_offset as usize;
    // Also where it names lengths.
    let (_, end) = *records(&bytes).iter().find(|(kind, _)| *kind == op::DATA_END).expect("an end of the data");
    for offset in (100..400).step_by(25) {
        let mut damaged = bytes.clone();
        damaged[second + offset] ^= 0xff;
        let said = refused(&damaged);
        assert!(said.ends_with("the file is damaged: its checksum differs"), "{offset}: {said}");
        let said = refused(&damaged[..end]);
        assert!(said.contains("chunk "), "{offset}: {said}");
    }
    rewritten(&path, &other, |topic, data| (topic != "/session/header").then(|| data.to_vec()));
    assert!(verified(&other).unwrap_err().contains("no /session/header"));
    rewritten(&path, &other, |topic, data| {
        let later = || v1::RecordingHeader { version: 9, ..Default::default() }.encode_to_vec();
        Some(if topic == "/session/header" { later() } else { data.to_vec() })
    });
    assert!(verified(&other).unwrap_err().contains("the recording has version 9; this program reads 2"));

    let mut foreign = mcap::Writer::new(io::Cursor::new(Vec::new())).unwrap();
    let schema = foreign.add_schema("std_msgs.String", "protobuf", b"").unwrap();
    let channel_id = foreign.add_channel(schema, "/session/header", "protobuf", &Default::default()).unwrap();
    let header = mcap::records::MessageHeader { channel_id, sequence: 0, log_time: 0, publish_time: 0 };
    foreign.write_to_known_channel(&header, b"").unwrap();
    foreign.finish().unwrap();
    let said = refused(&foreign.into_inner().into_inner());
    assert!(said.contains("/session/header has schema std_msgs.String, not kerf.v1.RecordingHeader"), "{said}");
}

/// Kind and place of each record of a whole file.
fn records(bytes: &[u8]) -> Vec<(u8, usize)> {
    let (mut records, mut offset) = (Vec::new(), mcap::MAGIC.len());
    while offset + mcap::MAGIC.len() < bytes.len() {
        records.push((bytes[offset], offset));
        offset += 9 + u64::from_le_bytes(*bytes[offset + 1..].first_chunk().unwrap()) as usize;
    }
    records
}

#[tokio::test(flavor = "multi_thread")]
async fn only_the_last_record_of_a_file_may_be_torn() {
    let folder = tempfile::tempdir().unwrap();
    let (path, _) = recorded_cut(folder.path()).await;
    let whole = std::fs::read(&path).unwrap();
    let records = records(&whole);
    let end = records.iter().find(|(kind, _)| *kind == op::DATA_END).expect("an end of the data").1;
    let killed = &whole[..end];
    let (_, last_chunk) = *records.iter().rfind(|(kind, offset)| *kind == op::CHUNK && *offset < end).unwrap();
    let other = folder.path().join("other.mcap");
    let open = |bytes: &[u8]| {
        std::fs::write(&other, bytes).unwrap();
        Recording::open(&other)
    };

    let chunks = open(killed).unwrap().chunks();
    assert!(chunks > 1);
    for torn in (last_chunk + 1..end).step_by(101).chain([end]) {
        let recording = open(&whole[..torn]).unwrap();
        assert!(recording.ending() == Ending::CutOff && recording.chunks() >= chunks - 1, "{torn}");
    }
    // A length or a kind that flipped is no torn end, wherever it points to.
    for (file, until) in [(&whole[..], whole.len()), (killed, last_chunk)] {
        for &(kind, offset) in records.iter().filter(|(_, offset)| *offset < until) {
            for bit in (8..72).step_by(7).chain((kind == op::CHUNK).then_some(2)) {
                let mut damaged = file.to_vec();
                damaged[offset + bit / 8] ^= 1 << (bit % 8);
                let refused = open(&damaged).map(|recording| recording.ending());
                assert!(refused.is_err(), "kind {kind} at {offset} of {}, bit {bit}: {refused:?}", file.len());
            }
        }
    }
}
