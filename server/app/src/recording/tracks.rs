//! The channels of a recording, and writing to them.

use std::collections::BTreeMap;
use std::io::{Seek, Write};

use mcap::records::MessageHeader;
use mcap::{Compression, McapResult, WriteOptions};
use prost::Message;

use super::schemas::Schemas;

/// How messages and their schemas are encoded, by MCAP's names.
pub const ENCODING: &str = "protobuf";

/// A channel of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Track {
    Header,
    Step,
    Events,
    Checkpoint,
    Base,
    Confirmed,
    Faults,
    Energy,
    Keyframe,
    Patch,
    State,
    Surface,
    Contact(usize),
    Pose(usize),
}

impl Track {
    /// Those that are read, by their topics: what is for other programs alone is not among them.
    const READ: [Self; 11] = [
        Self::Header,
        Self::Step,
        Self::Events,
        Self::Checkpoint,
        Self::Base,
        Self::Confirmed,
        Self::Faults,
        Self::Energy,
        Self::Keyframe,
        Self::Patch,
        Self::State,
    ];

    /// The track of a topic, among those that are read.
    pub fn of_topic(topic: &str) -> Option<Self> {
        Self::READ.into_iter().find(|track| track.topic() == topic)
    }

    /// Its topic.
    pub fn topic(self) -> String {
        match self {
            Self::Header => "/session/header".into(),
            Self::Step => "/session/step".into(),
            Self::Events => "/session/events".into(),
            Self::Checkpoint => "/session/checkpoint".into(),
            Self::Base => "/session/base".into(),
            Self::Confirmed => "/session/confirmed".into(),
            Self::Faults => "/session/faults".into(),
            Self::Energy => "/energy".into(),
            Self::Keyframe => "/view/keyframe".into(),
            Self::Patch => "/view/patch".into(),
            Self::State => "/view/state".into(),
            Self::Surface => "/surface".into(),
            Self::Contact(tool) => format!("/tool/{tool}/contact"),
            Self::Pose(tool) => format!("/tool/{tool}/pose"),
        }
    }

    /// The name of its messages' schema.
    pub fn schema(self) -> &'static str {
        match self {
            Self::Header => "kerf.v1.RecordingHeader",
            Self::Step => "kerf.v1.RecordedStep",
            Self::Events => "kerf.v1.Event",
            Self::Checkpoint => "kerf.v1.RecordedCheckpoint",
            Self::Base => "kerf.v1.RecordedBase",
            Self::Confirmed => "kerf.v1.RecordedConfirmed",
            Self::Faults => "kerf.v1.Fault",
            Self::Energy => "kerf.v1.EnergyLedger",
            Self::Keyframe => "kerf.v1.Keyframe",
            Self::Patch => "kerf.v1.TopologyPatch",
            Self::State => "kerf.v1.RecordedState",
            Self::Surface => "foxglove.SceneUpdate",
            Self::Contact(_) => "kerf.v1.Contact",
            Self::Pose(_) => "foxglove.PoseInFrame",
        }
    }
}

/// An MCAP file that is written.
pub struct Tracks<W: Write + Seek> {
    file: mcap::Writer<W>,
    channels: BTreeMap<Track, u16>,
    /// Log times never go back.
    newest_ns: u64,
}

impl<W: Write + Seek> Tracks<W> {
    /// Begins a file with these tracks and writes its first messages out; without them it is left as it is.
    pub fn begin(
        sink: W,
        tracks: impl IntoIterator<Item = Track>,
        first: impl FnOnce(&mut Self) -> McapResult<()>,
    ) -> McapResult<Self> {
        let options = WriteOptions::new()
            .library(concat!("kerf-server ", env!("CARGO_PKG_VERSION")))
            .compression(Some(Compression::Zstd))
            .compression_level(1)
            .compression_threads(0)
            // Chunks are put together in memory: a half-written one would be all that a kill leaves of it.
            .disable_seeking(true);
        let mut file = options.create(sink)?;
        let (mut channels, schemas) = (BTreeMap::new(), Schemas::new());
        for track in tracks {
            let schema = file.add_schema(track.schema(), ENCODING, &schemas.of(track.schema()))?;
            channels.insert(track, file.add_channel(schema, &track.topic(), ENCODING, &BTreeMap::new())?);
        }
        let mut begun = Self { file, channels, newest_ns: 0 };
        match first(&mut begun).and_then(|()| begun.flush()) {
            Ok(()) => Ok(begun),
            Err(error) => {
                begun.abandon();
                Err(error)
            }
        }
    }

    /// Writes a message; nothing on a track that the file does not have.
    pub fn write(&mut self, track: Track, time_ns: u64, message: &impl Message) -> McapResult<()> {
        let Some(&channel_id) = self.channels.get(&track) else { return Ok(()) };
        self.newest_ns = self.newest_ns.max(time_ns);
        let (log_time, publish_time) = (self.newest_ns, time_ns);
        let header = MessageHeader { channel_id, sequence: 0, log_time, publish_time };
        self.file.write_to_known_channel(&header, &message.encode_to_vec())
    }

    /// Ends the chunk and writes it out.
    pub fn flush(&mut self) -> McapResult<()> {
        self.file.flush()
    }

    /// Ends the file with its index.
    pub fn finish(mut self) -> McapResult<()> {
        let finished = self.file.finish();
        let mut sink = self.file.into_inner();
        finished?;
        Ok(sink.flush()?)
    }

    /// Leaves the file as it is.
    pub fn abandon(self) {
        drop(self.file.into_inner());
    }
}
