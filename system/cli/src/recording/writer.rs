//! [`Writer`]: a recording that is being made.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use condor_platform::linux::{LOCK_PATIENCE, lock_file};
use condor_ros2::{
    ENCODING, Head, Layout, Level, Log, RosField, RosMessage, SCHEMA_ENCODING, Time, encode, schema,
};
use mcap::Attachment;
use mcap::records::{MessageHeader, Metadata};
use rustix::io::Errno;

use super::message_counts::MessageCounts;
use super::reserved_space::ReservedSpace;
use super::{ABOUT, CHUNK_BYTES, FORMAT, Mcap, NUMBER, NamedFileError, RecordingError, VARIABLE};
use condor_host::messages::{Topics, wall_ns};

/// The time after which a chunk is written.
const FLUSH: Duration = Duration::from_secs(1);
/// Upper bounds for the bytes that MCAP adds: to a message with its index, to a chunk without and for
/// each of its channels, to a record that the summary repeats, to a file.
const OF_MESSAGE: u64 = 9 + 22 + 16;
const OF_CHUNK: u64 = 256;
const OF_CHUNK_CHANNEL: u64 = 32;
const OF_RECORD: u64 = 256;
const OF_FILE: u64 = 4096;

/// The system that is recorded, and how.
pub(crate) struct Origin<'o> {
    /// The name of the system.
    pub(crate) system: &'o str,
    pub(crate) is_simulated: bool,
    /// The time by which the wall clock is ahead of the clock of the system.
    pub(crate) ahead_ns: u64,
    /// The number of ticks from one row to the next.
    pub(crate) every: u32,
    pub(crate) attached: &'o [AttachedFile],
}

/// A file whose content belongs to the recording.
pub(crate) struct AttachedFile {
    pub(crate) name: String,
    pub(crate) content: Vec<u8>,
}

/// A recording that is being made. Messages are collected, and then committed together.
pub(crate) struct Writer {
    mcap: Mcap,
    path: PathBuf,
    /// The number of the recording.
    number: u64,
    taken: MessageCounts,
    room: ReservedSpace,
    ahead_ns: u64,
    channels: BTreeMap<u16, Channel>,
    topics: Topics,
    events: u16,
    collected: Vec<(MessageHeader, Vec<u8>)>,
    /// Bytes that the file has, or will have when it is completed, at most.
    bytes: u64,
    /// Bytes of the open chunk.
    chunk_bytes: u64,
    flushed: Instant,
}

struct Channel {
    topic: String,
    /// The layout of rows; `None` for other messages.
    layout: Option<Layout>,
    written: u64,
    bytes: u64,
}

/// The counts of what was written of a topic.
pub(crate) struct TopicCounts {
    pub(crate) channel: u16,
    pub(crate) topic: String,
    pub(crate) messages: u64,
    /// The bytes of the messages alone.
    pub(crate) bytes: u64,
    /// The number of messages that were taken but not written, for want of room.
    pub(crate) dropped: u64,
}

impl Writer {
    /// Makes the file; there must be none.
    pub(crate) fn create(path: &Path, origin: &Origin<'_>) -> Result<Self, RecordingError> {
        let mut options = File::options();
        let file = options.read(true).write(true).create_new(true).open(path);
        let file = file.map_err(NamedFileError::at("make", path))?;
        lock(&file, path)?;
        let mut random = [0; 8];
        rustix::rand::getrandom(&mut random, rustix::rand::GetRandomFlags::empty())
            .map_err(|error| NamedFileError::at("number", path)(error.into()))?;
        let number = u64::from_le_bytes(random);
        let taken = MessageCounts::begin(path, number)?;
        let own = file.try_clone().map_err(NamedFileError::at("open", path))?;
        let mut room = ReservedSpace::new(own);
        let attached = origin.attached.iter().map(|it| it.content.len() as u64);
        let bytes = attached.map(|bytes| bytes + OF_RECORD).sum::<u64>() + OF_FILE;
        let has_room = room.ensure(bytes);
        has_room.map_err(|error| NamedFileError::at("write", path)(error.into()))?;
        let mcap = super::begin(file).map_err(RecordingError::mcap(path))?;
        let mut writer = Self {
            mcap,
            path: path.to_owned(),
            number,
            taken,
            room,
            ahead_ns: origin.ahead_ns,
            channels: BTreeMap::new(),
            topics: Topics::default(),
            events: 0,
            collected: Vec::new(),
            bytes,
            chunk_bytes: 0,
            flushed: Instant::now(),
        };
        writer.describe(origin)?;
        writer.events = writer.channel_of::<Log>("/events")?;
        Ok(writer)
    }

    fn describe(&mut self, origin: &Origin<'_>) -> Result<(), RecordingError> {
        let clock = if origin.is_simulated {
            "simulated"
        } else {
            "real"
        };
        let values = [
            ("format", FORMAT.to_string()),
            (NUMBER, format!("{:016x}", self.number)),
            ("version", env!("CARGO_PKG_VERSION").to_owned()),
            ("system", origin.system.to_owned()),
            ("clock", clock.to_owned()),
            ("ahead_ns", origin.ahead_ns.to_string()),
            ("every", origin.every.to_string()),
        ];
        let metadata = Metadata {
            name: ABOUT.into(),
            metadata: values
                .map(|(key, value)| (key.to_owned(), value))
                .into_iter()
                .collect(),
        };
        let described = self.mcap.write_metadata(&metadata);
        described.map_err(RecordingError::mcap(&self.path))?;
        let now = wall_ns();
        for attached in origin.attached {
            let attached = self.mcap.attach(&Attachment {
                log_time: now,
                create_time: now,
                name: attached.name.clone(),
                media_type: "text/plain".into(),
                data: attached.content.as_slice().into(),
            });
            attached.map_err(RecordingError::mcap(&self.path))?;
        }
        Ok(())
    }

    /// Adds a channel for the rows of a loop or of a cell, and returns its number.
    pub(crate) fn rows_of(
        &mut self,
        processor: &str,
        owner: &str,
        fields: impl IntoIterator<Item = RosField>,
    ) -> Result<u16, RecordingError> {
        let layout = Layout::new(fields);
        let [topic, of_type] = self.topics.of(processor, owner);
        let mut metadata = BTreeMap::from([
            ("processor".to_owned(), processor.to_owned()),
            ("loop".to_owned(), owner.to_owned()),
        ]);
        for (field, name) in layout.fields() {
            metadata.insert(format!("{VARIABLE}{name}"), field.name.clone());
        }
        let text = layout.schema();
        self.channel(topic, &of_type, &text, &metadata, Some(layout))
    }

    /// Adds a channel for messages of one type, and returns its number.
    pub(crate) fn channel_of<M: RosMessage>(&mut self, topic: &str) -> Result<u16, RecordingError> {
        let text = schema::<M>();
        self.channel(topic.to_owned(), M::NAME, &text, &BTreeMap::new(), None)
    }

    fn channel(
        &mut self,
        topic: String,
        of_type: &str,
        schema: &str,
        metadata: &BTreeMap<String, String>,
        layout: Option<Layout>,
    ) -> Result<u16, RecordingError> {
        let described = metadata
            .iter()
            .map(|(key, value)| key.len() + value.len() + 8);
        let described = described.sum::<usize>() + schema.len() + of_type.len() + 3 * topic.len();
        // In the chunk and in the summary.
        self.take_room(2 * (described as u64 + OF_RECORD))?;
        let failed = RecordingError::mcap(&self.path);
        let mut add = || {
            let schema = self
                .mcap
                .add_schema(of_type, SCHEMA_ENCODING, schema.as_bytes())?;
            self.mcap.add_channel(schema, &topic, ENCODING, metadata)
        };
        let number = add().map_err(failed)?;
        let channel = Channel {
            topic,
            layout,
            written: 0,
            bytes: 0,
        };
        self.channels.insert(number, channel);
        // A message that is dropped later has its topic in the file.
        self.flush()?;
        Ok(number)
    }

    /// Collects a row of a channel. `instant_ns` is the time of the release on the clock of the system;
    /// `words` has the values of the fields.
    pub(crate) fn row(
        &mut self,
        channel: u16,
        instant_ns: u64,
        tick: u64,
        lost: u64,
        words: &[u32],
    ) -> Result<(), RecordingError> {
        let at_ns = self.wall(instant_ns);
        let stamp = Time::from_ns(at_ns);
        let Some(found) = self.channels.get(&channel) else {
            return Ok(());
        };
        let Some(layout) = &found.layout else {
            return Ok(());
        };
        let message = layout.encode(&Head { stamp, tick, lost }, words);
        let message = message.map_err(|source| RecordingError::Schema {
            path: self.path.clone(),
            topic: found.topic.clone(),
            source,
        })?;
        self.collect(channel, at_ns, message);
        Ok(())
    }

    /// Collects an event.
    pub(crate) fn event(&mut self, instant_ns: u64, level: Level, name: &str, text: &str) {
        let stamp = self.stamp(instant_ns);
        let (name, text) = (name.to_owned(), text.to_owned());
        let log = Log {
            stamp,
            level,
            name,
            text,
        };
        self.message(self.events, instant_ns, &log);
    }

    /// Collects a message of a channel.
    pub(crate) fn message(&mut self, channel: u16, instant_ns: u64, message: &impl RosMessage) {
        self.collect(channel, self.wall(instant_ns), encode(message));
    }

    /// Returns the time in messages for an instant on the clock of the system.
    pub(crate) fn stamp(&self, instant_ns: u64) -> Time {
        Time::from_ns(self.wall(instant_ns))
    }

    const fn wall(&self, instant_ns: u64) -> u64 {
        instant_ns.wrapping_add(self.ahead_ns)
    }

    fn collect(&mut self, channel_id: u16, at_ns: u64, message: Vec<u8>) {
        let header = MessageHeader {
            channel_id,
            sequence: 0,
            log_time: at_ns,
            publish_time: at_ns,
        };
        self.collected.push((header, message));
    }

    /// Writes what was collected, and the open chunk if it is due.
    ///
    /// # Errors
    /// Returns [`RecordingError::Full`] if there is no room; [`end`](Self::end) then completes the file,
    /// without the collected messages.
    pub(crate) fn commit(&mut self) -> Result<(), RecordingError> {
        if !self.collected.is_empty() {
            self.write()?;
        }
        if self.chunk_bytes >= CHUNK_BYTES || self.flushed.elapsed() >= FLUSH {
            self.flush()?;
        }
        Ok(())
    }

    /// Writes what was collected.
    fn write(&mut self) -> Result<(), RecordingError> {
        let collected = core::mem::take(&mut self.collected);
        for (header, _) in &collected {
            self.taken.count(header.channel_id);
        }
        self.taken.note()?;
        let messages = collected.iter();
        let bytes = messages.map(|(_, it)| it.len() as u64 + OF_MESSAGE).sum();
        self.take_room(bytes)?;
        self.chunk_bytes += bytes;
        for (mut header, message) in collected {
            if let Some(channel) = self.channels.get_mut(&header.channel_id) {
                channel.written += 1;
                channel.bytes += message.len() as u64;
                header.sequence = channel.written as u32;
            }
            let written = self.mcap.write_to_known_channel(&header, &message);
            written.map_err(RecordingError::mcap(&self.path))?;
        }
        Ok(())
    }

    /// Ends the open chunk, and hands it to the operating system.
    pub(super) fn flush(&mut self) -> Result<(), RecordingError> {
        let flushed = self.mcap.flush();
        flushed.map_err(RecordingError::mcap(&self.path))?;
        self.chunk_bytes = 0;
        self.flushed = Instant::now();
        Ok(())
    }

    /// Makes sure that the file can be completed with so many bytes more, and one chunk more.
    fn take_room(&mut self, more: u64) -> Result<(), RecordingError> {
        let chunk = OF_CHUNK + OF_CHUNK_CHANNEL * self.channels.len() as u64;
        let new = if self.chunk_bytes == 0 { chunk } else { 0 };
        match self.room.ensure(self.bytes + more + new) {
            Ok(()) => {
                self.bytes += more + new;
                Ok(())
            }
            Err(Errno::NOSPC | Errno::DQUOT | Errno::FBIG) => Err(RecordingError::Full {
                path: self.path.clone(),
            }),
            Err(error) => Err(NamedFileError::at("write", &self.path)(error.into()).into()),
        }
    }

    /// Completes the file, and returns what is in it.
    pub(crate) fn end(self) -> Result<Vec<TopicCounts>, RecordingError> {
        let path = &self.path;
        let taken = self.taken.counts();
        let written: Vec<_> = (self.channels.iter())
            .map(|(number, channel)| {
                let taken = taken.get(number).copied().unwrap_or(0);
                TopicCounts {
                    channel: *number,
                    topic: channel.topic.clone(),
                    messages: channel.written,
                    bytes: channel.bytes,
                    dropped: taken.saturating_sub(channel.written),
                }
            })
            .collect();
        let dropped = written.iter();
        let dropped = dropped.map(|it| (it.topic.clone(), it.dropped.to_string()));
        let file = super::end(self.mcap, dropped.collect()).map_err(RecordingError::mcap(path))?;
        ReservedSpace::give_back(&file).map_err(NamedFileError::at("write", path))?;
        MessageCounts::end(path, Some(self.number))?;
        Ok(written)
    }
}

#[cfg(test)]
impl Writer {
    /// Leaves the file as it is when the process is killed: nothing more is written, and the lock ends.
    pub(super) fn abandon(self) {
        rustix::fs::flock(self.room.file(), rustix::fs::FlockOperation::Unlock).unwrap();
        core::mem::forget(self);
    }
}

/// Locks the file of a recording for as long as it is open. Waits a little while somebody else has locked it.
pub(super) fn lock(file: &File, path: &Path) -> Result<(), RecordingError> {
    let locked = lock_file(file, LOCK_PATIENCE);
    if locked.map_err(|error| NamedFileError::at("lock", path)(error.into()))? {
        return Ok(());
    }
    Err(RecordingError::InUse {
        path: path.to_owned(),
    })
}
