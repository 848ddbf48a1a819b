//! Reading a recording, chunk by chunk; one that a kill or a full disk left without an end too.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use std::ops::Range;
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
pub(crate) const RECORD_HEAD_BYTES: usize = 9;
/// Length of what precedes the packed messages of a chunk: with the name of a compression, of which no one has more than
/// 11 bytes.
const CHUNK_HEAD_BYTES: usize = 64;
/// What is looked through at a time for a chunk, bytes.
const SCAN_BYTES: usize = 1 << 20;

/// A message of a recording.
#[derive(Clone, Debug)]
pub struct Entry {
    /// Where it stands.
    pub(crate) track: Track,
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
    /// In the middle of its last record: its writer was killed, or the disk was full. All chunks before are whole.
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

/// Why a file is not whole from an offset on.
struct Damage {
    offset: u64,
    error: anyhow::Error,
}

/// A recording that is read.
pub struct Recording {
    file: BufReader<File>,
    header: v1::RecordingHeader,
    channels: BTreeMap<u16, Track>,
    chunks: Vec<Chunk>,
    ending: Ending,
    /// At its end, not whole.
    torn_bytes: u64,
}

impl Recording {
    /// Looks through a file for its chunks, and reads the header.
    ///
    /// # Errors
    /// The file cannot be read, is no recording, or is damaged: only the last record of a file may not be whole.
    pub fn open(path: &Path) -> Result<Self> {
        Self::open_as(path, Self::read)
    }

    fn open_as(path: &Path, read: fn(File) -> Result<Self>) -> Result<Self> {
        let file = File::open(path).map_err(|error| anyhow!(in_plain_words(&error)));
        file.and_then(read).with_context(|| path.display().to_string())
    }

    fn read(file: File) -> Result<Self> {
        let (mut recording, ending) = Self::survey(file)?;
        recording.ending = ending.map_err(|damage| damage.error)?;
        recording.read_header()?;
        Ok(recording)
    }

    /// Opens a file of a journal, which a power cut may have damaged wherever the disk had not confirmed it yet: what is
    /// whole before that is read.
    ///
    /// # Errors
    /// Those of [`Recording::open`], for what is damaged where the disk had confirmed it.
    pub fn open_journal(path: &Path) -> Result<Self> {
        Self::open_as(path, Self::read_journal)
    }

    fn read_journal(file: File) -> Result<Self> {
        let (mut recording, ending) = Self::survey(file)?;
        let damaged_chunk = (0..recording.chunks.len()).find_map(|index| Some((index, recording.chunk(index).err()?)));
        let damage = match damaged_chunk {
            Some((index, error)) => {
                let offset = recording.chunks[index].offset - RECORD_HEAD_BYTES as u64;
                recording.chunks.truncate(index);
                Some(Damage { offset, error })
            }
            None => ending.map(|ending| recording.ending = ending).err(),
        };
        recording.read_header()?;
        if let Some(Damage { offset, error }) = damage {
            recording.torn_bytes = recording.file.get_ref().metadata()?.len() - offset;
            let confirmed = recording.confirmed_behind(offset)?;
            ensure!(confirmed <= offset, "{error:#}; the disk had confirmed the first {confirmed} bytes");
        }
        Ok(recording)
    }

    /// How much of the file the disk had confirmed, as the whole chunks behind a place have it; 0 without any.
    fn confirmed_behind(&mut self, place: u64) -> Result<u64> {
        let length = self.file.get_ref().metadata()?.len();
        let (mut from, mut confirmed) = (place, 0);
        while let Some(next) = next_chunk(&mut self.file, from..length, length)? {
            from = next + 1;
            let Some(Chunk { offset, bytes, .. }) = chunk(&mut self.file, next, length)? else { continue };
            let Ok(entries) = self.entries(offset, bytes) else { continue };
            for entry in entries.iter().filter(|entry| entry.track == Track::Confirmed) {
                confirmed = confirmed.max(entry.read::<v1::RecordedConfirmed>()?.bytes);
            }
            from = offset + bytes;
        }
        Ok(confirmed)
    }

    /// A file whose chunks were looked through, and how it ends or where it is damaged.
    fn survey(file: File) -> Result<(Self, Result<Ending, Damage>)> {
        let (length, mut file) = (file.metadata()?.len(), BufReader::new(file));
        let mut magic = [0; MAGIC.len()];
        let is_mcap = file.read_exact(&mut magic).is_ok() && magic == MAGIC;
        ensure!(is_mcap, "this is no MCAP file");
        let (mut chunks, mut offset) = (Vec::new(), MAGIC.len() as u64);
        let ending = find_chunks(&mut file, length, &mut chunks, &mut offset);
        let torn_bytes = if matches!(ending, Ok(Ending::CutOff)) { length - offset } else { 0 };
        let ending = ending.map_err(|error| Damage { offset, error });
        let header = v1::RecordingHeader::default();
        Ok((Self { file, header, channels: BTreeMap::new(), chunks, ending: Ending::CutOff, torn_bytes }, ending))
    }

    fn read_header(&mut self) -> Result<()> {
        ensure!(!self.chunks.is_empty(), "the file ends before its first chunk is whole");
        let first = self.chunk(0)?;
        let header = first.iter().find(|entry| entry.track == Track::Header);
        self.header = header.context("this MCAP file has no /session/header: it is no recording of Kerf's")?.read()?;
        let version = self.header.version;
        ensure!(version == VERSION, "the recording has version {version}; this program reads {VERSION}");
        Ok(())
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

    /// Bytes at its end that are not whole.
    #[must_use]
    pub fn torn_bytes(&self) -> u64 {
        self.torn_bytes
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

/// Finds the whole chunks of a file, record by record, and how it ends. Records before the offset are whole.
fn find_chunks(file: &mut BufReader<File>, length: u64, chunks: &mut Vec<Chunk>, offset: &mut u64) -> Result<Ending> {
    let is_complete = ends_with_magic(file, length)?;
    while let Some((kind, bytes)) = record_head(file, *offset, length)? {
        let begin = *offset;
        let damaged = || format!("the record at byte {begin} is damaged");
        let content = begin + RECORD_HEAD_BYTES as u64;
        match kind {
            op::CHUNK => chunks.push(chunk(file, begin, length)?.with_context(damaged)?),
            op::FOOTER => {
                let is_last = is_complete && content + bytes + MAGIC.len() as u64 == length;
                ensure!(is_last, "{}: it ends the file before its end", damaged());
                return Ok(Ending::Whole);
            }
            op::DATA_END => {
                let saved = data_checksum(&record(file, content, bytes)?).with_context(damaged)?;
                ensure!(saved == 0 || saved == checksum(file, begin)?, "the file is damaged: its checksum differs");
            }
            _ => {
                // Of some kinds a reader takes any content that is long enough.
                ensure!(
                    chunk(file, begin, length)?.is_none(),
                    "{}: a chunk by its lengths, it says kind {kind}",
                    damaged()
                );
                let whole = record(file, content, bytes)?;
                let is_known = !matches!(parse_record(kind, &whole).with_context(damaged)?, Record::Unknown { .. });
                ensure!(is_known, "{}: it is of no known kind", damaged());
                let swallowed = next_chunk(file, content..content + bytes, length)?;
                ensure!(swallowed.is_none(), "{}: a chunk begins within it", damaged());
            }
        }
        *offset = content + bytes;
    }
    // A writer that stopped leaves one record that is not whole, at the very end.
    let torn = *offset;
    ensure!(!is_complete, "the record at byte {torn} is damaged: it goes on beyond the end of a complete file");
    if let Some(after) = next_chunk(file, torn + 1..length, length)? {
        bail!(
            "the record at byte {torn} is damaged: it goes on beyond the end, and a whole chunk follows at byte {after}"
        );
    }
    Ok(Ending::CutOff)
}

fn ends_with_magic(file: &mut BufReader<File>, length: u64) -> Result<bool> {
    let mut end = [0; MAGIC.len()];
    file.seek(SeekFrom::Start(length - MAGIC.len() as u64))?;
    file.read_exact(&mut end)?;
    Ok(length > MAGIC.len() as u64 && end == MAGIC)
}

/// Kind and length of the record at an offset; `None` where it is not whole.
fn record_head(file: &mut BufReader<File>, offset: u64, length: u64) -> Result<Option<(u8, u64)>> {
    let mut head = [0; RECORD_HEAD_BYTES];
    let content = offset + RECORD_HEAD_BYTES as u64;
    if content > length {
        return Ok(None);
    }
    file.seek(SeekFrom::Start(offset))?;
    file.read_exact(&mut head)?;
    let [kind, bytes @ ..] = head;
    let bytes = u64::from_le_bytes(bytes);
    Ok((bytes <= length - content).then_some((kind, bytes)))
}

/// The content of a record that is none of the large ones.
fn record(file: &mut BufReader<File>, content: u64, bytes: u64) -> Result<Vec<u8>> {
    ensure!(bytes <= MAX_CHUNK_BYTES, "the record at byte {content} has {bytes} bytes, at most {MAX_CHUNK_BYTES}");
    let mut record = vec![0; bytes as usize];
    file.seek(SeekFrom::Start(content))?;
    file.read_exact(&mut record)?;
    Ok(record)
}

fn data_checksum(content: &[u8]) -> Result<u32> {
    match parse_record(op::DATA_END, content)? {
        Record::DataEnd(end) => Ok(end.data_section_crc),
        _ => bail!("it is of another kind"),
    }
}

/// The checksum of the first so many bytes of a file.
fn checksum(file: &mut BufReader<File>, bytes: u64) -> Result<u32> {
    let mut sum = crc32fast::Hasher::new();
    file.seek(SeekFrom::Start(0))?;
    let mut rest = bytes;
    while rest > 0 {
        let some = file.fill_buf()?;
        let some = &some[..some.len().min(rest as usize)];
        ensure!(!some.is_empty(), "the file became shorter while it was read");
        sum.update(some);
        let taken = some.len();
        file.consume(taken);
        rest -= taken as u64;
    }
    Ok(sum.finalize())
}

/// The chunk that the record at an offset is, whatever kind it says; `None` where its lengths do not agree.
fn chunk(file: &mut BufReader<File>, offset: u64, length: u64) -> Result<Option<Chunk>> {
    let mut head = vec![0; CHUNK_HEAD_BYTES.min((length - offset) as usize)];
    file.seek(SeekFrom::Start(offset))?;
    file.read_exact(&mut head)?;
    Ok(whole_chunk(&head, offset, length))
}

/// The chunk that the record which begins with these bytes is, whatever kind it says, if it is whole: it has the length of
/// its record twice, once by the length of what is packed.
fn whole_chunk(head: &[u8], offset: u64, length: u64) -> Option<Chunk> {
    let number = |at: usize| Some(u64::from_le_bytes(*head.get(at..)?.first_chunk()?));
    let bytes = number(1)?;
    let offset = offset + RECORD_HEAD_BYTES as u64;
    let name_bytes = u32::from_le_bytes(*head.get(37..)?.first_chunk()?);
    let packed = 41 + name_bytes as usize;
    let is_whole = bytes <= (length.checked_sub(offset)?).min(MAX_CHUNK_BYTES)
        && bytes == number(packed)?.checked_add((packed + 8 - RECORD_HEAD_BYTES) as u64)?;
    is_whole.then_some(Chunk { offset, bytes, start_ns: number(9)?, end_ns: number(17)? })
}

/// Where the first whole chunk begins in a part of the file.
fn next_chunk(file: &mut BufReader<File>, part: Range<u64>, length: u64) -> Result<Option<u64>> {
    let mut block = Vec::new();
    for begin in part.clone().step_by(SCAN_BYTES) {
        block.clear();
        file.seek(SeekFrom::Start(begin))?;
        file.take((SCAN_BYTES + CHUNK_HEAD_BYTES) as u64).read_to_end(&mut block)?;
        let looked_at = block.len().min(SCAN_BYTES).min((part.end - begin) as usize);
        let is_chunk = |at: &usize| whole_chunk(&block[*at..], begin + *at as u64, length).is_some();
        if let Some(at) = memchr::memchr_iter(op::CHUNK, &block[..looked_at]).find(is_chunk) {
            return Ok(Some(begin + at as u64));
        }
    }
    Ok(None)
}

/// What the system says, without its number.
fn in_plain_words(error: &std::io::Error) -> String {
    error.to_string().split(" (os error").next().unwrap_or_default().to_lowercase()
}
