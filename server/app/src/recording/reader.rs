//! Reading a recording, chunk by chunk; one that a kill or a full disk left without an end too.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use anyhow::{Context, Result, anyhow, bail, ensure};
use kerf_proto::v1;
use mcap::MAGIC;
use mcap::read::parse_record;
use mcap::records::{Record, SchemaHeader, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use prost::Message;

use super::convert::VERSION;
use super::tracks::{ENCODING, Track};

/// Largest chunk that is read, bytes: a thousand times those that are written, for a keyframe of a huge scene.
const MAX_CHUNK_BYTES: u64 = 1 << 30;
/// Length of what precedes each record: its kind and its length.
const RECORD_HEAD_BYTES: usize = 9;

/// A message of a recording.
#[derive(Clone, Debug)]
pub struct Entry {
    /// Where it stands.
    pub(super) track: Track,
    /// Log time, ns since 1970.
    pub time_ns: u64,
    data: Vec<u8>,
}

impl Entry {
    /// The message.
    ///
    /// # Errors
    /// It is none of that kind.
    pub fn read<M: Message + Default>(&self) -> Result<M> {
        M::decode(self.data.as_slice()).with_context(|| format!("a message on {}", self.track.topic()))
    }
}

/// How a file ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// As it was closed.
    Whole,
    /// In the middle: its writer was killed, or the disk was full. All chunks before are whole.
    CutOff,
}

#[derive(Clone, Copy, Debug)]
struct Chunk {
    /// Where its content begins in the file.
    offset: u64,
    bytes: u64,
    start_ns: u64,
    end_ns: u64,
}

/// A recording that is read.
pub struct Recording {
    file: BufReader<File>,
    header: v1::RecordingHeader,
    channels: BTreeMap<u16, Track>,
    chunks: Vec<Chunk>,
    ending: Ending,
}

impl Recording {
    /// Looks through a file for its chunks, and reads the header.
    ///
    /// # Errors
    /// The file cannot be read, or is no recording.
    pub fn open(path: &Path) -> Result<Self> {
        let context = || path.display().to_string();
        let file = File::open(path).map_err(|error| anyhow!(in_plain_words(&error))).with_context(context)?;
        Self::read(file).with_context(context)
    }

    fn read(file: File) -> Result<Self> {
        let (length, mut file) = (file.metadata()?.len(), BufReader::new(file));
        let mut magic = [0; MAGIC.len()];
        let is_mcap = file.read_exact(&mut magic).is_ok() && magic == MAGIC;
        ensure!(is_mcap, "this is no MCAP file");
        let (mut chunks, ending) = chunks(&mut file, length)?;
        // A header and its schemas, and no message: a file that was closed at once.
        chunks.retain(|chunk| chunk.bytes > 0);
        let header = v1::RecordingHeader::default();
        let mut recording = Self { file, header, channels: BTreeMap::new(), chunks, ending };
        ensure!(!recording.chunks.is_empty(), "the file ends before its first chunk is whole");
        let first = recording.chunk(0)?;
        let header = first.iter().find(|entry| entry.track == Track::Header);
        recording.header =
            header.context("this MCAP file has no /session/header: it is no recording of Kerf's")?.read()?;
        let version = recording.header.version;
        ensure!(version == VERSION, "the recording has version {version}; this program reads {VERSION}");
        Ok(recording)
    }

    /// What it begins with.
    #[must_use]
    pub fn header(&self) -> &v1::RecordingHeader {
        &self.header
    }

    /// How it ends.
    #[must_use]
    pub fn ending(&self) -> Ending {
        self.ending
    }

    /// Chunks that it has.
    #[must_use]
    pub fn chunks(&self) -> usize {
        self.chunks.len()
    }

    /// Log times of its first and last message, ns.
    #[must_use]
    pub fn span_ns(&self) -> (u64, u64) {
        let start = self.chunks.iter().map(|chunk| chunk.start_ns).min();
        let end = self.chunks.iter().map(|chunk| chunk.end_ns).max();
        (start.unwrap_or_default(), end.unwrap_or_default())
    }

    /// How many chunks have begun until a time.
    pub(super) fn chunks_until(&self, time_ns: u64) -> usize {
        self.chunks.partition_point(|chunk| chunk.start_ns <= time_ns)
    }

    /// The messages of a chunk, in order.
    ///
    /// # Errors
    /// It cannot be read, is damaged, or has other messages than a recording.
    pub fn chunk(&mut self, index: usize) -> Result<Vec<Entry>> {
        let Chunk { offset, bytes, .. } = self.chunks[index];
        let read = self.entries(offset, bytes);
        read.with_context(|| format!("chunk {} of {}, at byte {offset}", index + 1, self.chunks.len()))
    }

    fn entries(&mut self, offset: u64, bytes: u64) -> Result<Vec<Entry>> {
        let mut chunk = vec![0; RECORD_HEAD_BYTES + bytes as usize];
        self.file.seek(SeekFrom::Start(offset - RECORD_HEAD_BYTES as u64))?;
        self.file.read_exact(&mut chunk)?;
        // The checksum is looked at before anything that the chunk holds: what is damaged may name any length.
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(MAX_CHUNK_BYTES as usize);
        let (mut reader, mut rest) = (LinearReader::new_with_options(options), &chunk[..]);
        let mut schemas = BTreeMap::new();
        let mut entries = Vec::new();
        while let Some(event) = reader.next_event() {
            match event? {
                LinearReadEvent::ReadRequest(wanted) => {
                    let (next, after) = rest.split_at(wanted.min(rest.len()));
                    reader.insert(next.len()).copy_from_slice(next);
                    reader.notify_read(next.len());
                    rest = after;
                }
                LinearReadEvent::Record { data, opcode } => {
                    entries.extend(self.entry(&mut schemas, parse_record(opcode, data)?)?);
                }
            }
        }
        Ok(entries)
    }

    /// The entry that a record of a chunk is, if it is one; takes in `schemas` and channels.
    fn entry(&mut self, schemas: &mut BTreeMap<u16, SchemaHeader>, record: Record<'_>) -> Result<Option<Entry>> {
        match record {
            Record::Schema { header, .. } => drop(schemas.insert(header.id, header)),
            Record::Channel(channel) => {
                let Some(track) = Track::of_topic(&channel.topic) else { return Ok(None) };
                let schema = schemas.get(&channel.schema_id);
                let is_ours = channel.message_encoding == ENCODING
                    && schema.is_some_and(|schema| schema.encoding == ENCODING && schema.name == track.schema());
                let name = schema.map_or("none", |schema| schema.name.as_str());
                ensure!(is_ours, "{} has schema {name}, not {}", channel.topic, track.schema());
                self.channels.insert(channel.id, track);
            }
            Record::Message { header, data } => {
                let entry = |track: &Track| Entry { track: *track, time_ns: header.log_time, data: data.into_owned() };
                return Ok(self.channels.get(&header.channel_id).map(entry));
            }
            _ => {}
        }
        Ok(None)
    }
}

/// Where the whole chunks of a file are, and how it ends.
fn chunks(file: &mut BufReader<File>, length: u64) -> Result<(Vec<Chunk>, Ending)> {
    let mut chunks = Vec::new();
    let mut offset = MAGIC.len() as u64;
    loop {
        let mut head = [0; RECORD_HEAD_BYTES];
        if offset + RECORD_HEAD_BYTES as u64 > length {
            return Ok((chunks, Ending::CutOff));
        }
        file.seek(SeekFrom::Start(offset))?;
        file.read_exact(&mut head)?;
        let [kind, bytes @ ..] = head;
        let bytes = u64::from_le_bytes(bytes);
        offset += RECORD_HEAD_BYTES as u64;
        if bytes > length - offset {
            return Ok((chunks, Ending::CutOff));
        }
        match kind {
            op::CHUNK => {
                ensure!(bytes <= MAX_CHUNK_BYTES, "the chunk at byte {offset} has {bytes} bytes");
                // What it begins with is of fixed length, up to the name of the compression.
                let mut start = vec![0; bytes.min(64) as usize];
                file.read_exact(&mut start)?;
                let (start_ns, end_ns) = chunk_times(&start).with_context(|| format!("the chunk at byte {offset}"))?;
                chunks.push(Chunk { offset, bytes, start_ns, end_ns });
            }
            op::FOOTER => return Ok((chunks, Ending::Whole)),
            _ => {}
        }
        offset += bytes;
    }
}

fn chunk_times(start: &[u8]) -> Result<(u64, u64)> {
    let (times, _) = start.as_chunks::<8>();
    match times {
        [first, last, ..] => Ok((u64::from_le_bytes(*first), u64::from_le_bytes(*last))),
        _ => bail!("it is too short"),
    }
}

/// What the system says, without its number.
fn in_plain_words(error: &std::io::Error) -> String {
    error.to_string().split(" (os error").next().unwrap_or_default().to_lowercase()
}
