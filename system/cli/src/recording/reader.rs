//! [`RecordingReader`]: the variables and events of a complete recording.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Seek};
use std::ops::Range;
use std::path::{Path, PathBuf};

use condor_platform::linux::open_regular;
use condor_ros2::{Layout, Log, RosField, RosMessage, RowMessage, SCHEMA_ENCODING};
use mcap::records::{Metadata, Record, op};
use mcap::sans_io::indexed_reader::ReadOrder;
use mcap::sans_io::{
    IndexedReadEvent, IndexedReader, IndexedReaderOptions, SummaryReadEvent, SummaryReader,
    SummaryReaderOptions,
};
use mcap::{Channel, MAGIC, Summary};

use super::records::{self, Step, Walk, part};
use super::{ABOUT, DROPPED, FORMAT, NamedFileError, RecordedTopic, RecordingError, number};
use condor_host::names::{self, VariableName};

/// A reader of a complete recording: its loops and published cells, their rows, and the events.
#[derive(Debug)]
pub struct RecordingReader {
    path: PathBuf,
    file: File,
    summary: Summary,
    about: BTreeMap<String, String>,
    sources: Vec<RecordedSource>,
    columns: Vec<Column>,
}

/// A loop or a published cell in a recording, whose rows have the values of its variables.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordedSource {
    /// The name of its processor.
    pub processor: String,
    /// The name of the loop or cell.
    pub owner: String,
    /// The topic of its rows.
    pub topic: String,
    /// The variables in a row.
    pub layout: Layout,
    /// The number of its rows in the recording.
    pub rows: u64,
    /// The number of rows that the recorder had taken but that are not in the file; `None` if that is
    /// unknown.
    pub dropped: Option<u64>,
    channel: u16,
}

/// A variable in a recording: the loop or cell in whose rows it is, and its place there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Column {
    /// The index of its source in [`RecordingReader::sources`].
    pub source: usize,
    /// The index of its field in a row.
    pub field: usize,
    /// The name, type and unit of the variable, as a field of its row.
    pub variable: RosField,
    processor: String,
    owner: String,
}

impl VariableName for Column {
    fn parts(&self) -> [&str; 3] {
        [&self.processor, &self.owner, &self.variable.name]
    }
}

impl RecordingReader {
    /// Opens the recording in the file `path`. A recording whose recorder was killed must be
    /// [completed](super::complete) first.
    ///
    /// # Errors
    /// Returns [`RecordingError::Incomplete`] if the recording is not complete; [`RecordingError::NotMcap`] if the file
    /// is not an MCAP file; [`RecordingError::NoIndex`] if it has no index; [`RecordingError::Format`] if its format
    /// has another version; [`RecordingError::File`] if it cannot be opened or read; [`RecordingError::Schema`] if the
    /// schema of a channel cannot be read.
    pub fn open(path: &Path) -> Result<Self, RecordingError> {
        let mut file = open_regular(path).map_err(NamedFileError::at("open", path))?;
        let Some(whole) = whole(path, &mut file)? else {
            let path = path.to_owned();
            // A file of another program may be complete without a summary.
            return Err(if is_ended(&path, &file)? {
                RecordingError::NoIndex { path }
            } else {
                RecordingError::Incomplete { path }
            });
        };
        if !whole.has_index() {
            let path = path.to_owned();
            return Err(RecordingError::NoIndex { path });
        }
        let FileSummary {
            mut summary,
            mut metadata,
        } = whole;
        // Programs that copy a recording may leave it out.
        let about = metadata.remove(ABOUT).unwrap_or_default();
        if let Some(found) = about.get("format").filter(|it| **it != FORMAT.to_string()) {
            return Err(RecordingError::Format {
                path: path.to_owned(),
                found: found.to_owned(),
            });
        }
        // Chunks are unpacked before they are inserted into the reader of `mcap`.
        for index in &mut summary.chunk_indexes {
            index.compression.clear();
            index.compressed_size = index.uncompressed_size;
        }
        let dropped = metadata.remove(DROPPED).unwrap_or_default();
        let mut reader = Self {
            path: path.to_owned(),
            file,
            summary,
            about,
            sources: Vec::new(),
            columns: Vec::new(),
        };
        let channels: BTreeMap<_, _> = reader.summary.channels.clone().into_iter().collect();
        for channel in channels.values() {
            if let Some(source) = reader.source(channel, &dropped)? {
                reader.add(source);
            }
        }
        Ok(reader)
    }

    /// Returns the loop or cell of a channel; `None` if it has other messages.
    fn source(
        &self,
        channel: &Channel<'_>,
        dropped: &BTreeMap<String, String>,
    ) -> Result<Option<RecordedSource>, RecordingError> {
        let of_channel = |key| channel.metadata.get(key).cloned();
        let (Some(processor), Some(owner)) = (of_channel("processor"), of_channel("loop")) else {
            return Ok(None);
        };
        let schema = channel.schema.as_ref();
        let schema = schema.filter(|schema| schema.encoding == SCHEMA_ENCODING);
        let text = schema.map(|schema| String::from_utf8_lossy(&schema.data).into_owned());
        let layout = Layout::of_schema(&text.unwrap_or_default());
        Ok(Some(RecordedSource {
            processor,
            owner,
            topic: channel.topic.clone(),
            layout: layout.map_err(|source| RecordingError::Schema {
                path: self.path.clone(),
                topic: channel.topic.clone(),
                source,
            })?,
            rows: messages(&self.summary, channel.id),
            dropped: dropped.get(&channel.topic).and_then(|it| it.parse().ok()),
            channel: channel.id,
        }))
    }

    fn add(&mut self, source: RecordedSource) {
        for (field, (variable, _)) in source.layout.fields().enumerate() {
            self.columns.push(Column {
                source: self.sources.len(),
                field,
                variable: variable.clone(),
                processor: source.processor.clone(),
                owner: source.owner.clone(),
            });
        }
        self.sources.push(source);
    }

    /// Returns the metadata of the recording, such as the name of the system and the version of the recorder. Its keys
    /// are those of `condor` in [the format](super).
    #[must_use]
    pub const fn about(&self) -> &BTreeMap<String, String> {
        &self.about
    }

    /// Returns the loops and published cells of which the recording has rows.
    #[must_use]
    pub fn sources(&self) -> &[RecordedSource] {
        &self.sources
    }

    /// Returns the time of the first message, and the time just after the last, in nanoseconds since
    /// 1970; an empty range if there is no message.
    #[must_use]
    pub fn span(&self) -> Range<u64> {
        match &self.summary.stats {
            Some(stats) if stats.message_count > 0 => {
                stats.message_start_time..stats.message_end_time.saturating_add(1)
            }
            _ => 0..0,
        }
    }

    /// Returns all variables of all loops and cells.
    #[must_use]
    pub fn all(&self) -> &[Column] {
        &self.columns
    }

    /// Finds the variables that `names` stand for, in the order of `names`; each variable is returned once. A name may
    /// be a pattern, as in `condor vars watch`: `*` stands for any characters, and `?` for one. If `names` is empty,
    /// all variables are returned.
    ///
    /// # Errors
    /// Returns [`RecordingError::Name`] if a name stands for no variable, or for several.
    pub fn columns(&self, names: &[String]) -> Result<Vec<&Column>, RecordingError> {
        if names.is_empty() {
            return Ok(self.columns.iter().collect());
        }
        names::matching(&self.columns, names, "").map_err(|text| RecordingError::Name {
            path: self.path.clone(),
            text,
        })
    }

    /// Returns, for each variable in `columns`, the shortest of its names that no other variable of the recording has.
    #[must_use]
    pub fn labels(&self, columns: &[&Column]) -> Vec<String> {
        names::labels(&self.columns, columns)
    }

    /// Calls `take` for each row of some loops and cells in a span of time, in the order of time. `sources` are indices
    /// into [`sources`](Self::sources), and `span` is in nanoseconds since 1970. `take` gets the index of the source,
    /// the time in nanoseconds since 1970, and the row.
    ///
    /// # Errors
    /// Returns the error of `take` if that fails; [`RecordingError::File`], [`RecordingError::Mcap`],
    /// [`RecordingError::Damaged`], [`RecordingError::Compression`] or [`RecordingError::Message`] if the file
    /// cannot be read.
    pub fn rows<E: From<RecordingError>>(
        &self,
        sources: &[usize],
        span: Range<u64>,
        mut take: impl FnMut(usize, u64, &RowMessage<'_>) -> Result<(), E>,
    ) -> Result<(), E> {
        let chosen = sources.iter().filter_map(|number| {
            let source = self.sources.get(*number)?;
            Some((source.channel, (*number, source)))
        });
        let chosen: BTreeMap<_, _> = chosen.collect();
        let topics = chosen.values().map(|(_, source)| source.topic.as_str());
        self.messages(topics, span, |channel, at_ns, message| {
            let Some((number, source)) = chosen.get(&channel) else {
                return Ok(());
            };
            let row = source.layout.decode(message);
            let row = row.map_err(|source| self.wrong(channel, source))?;
            take(*number, at_ns, &row)
        })
    }

    /// Returns the events in a span of time, in the order of time. `span` and the time of each event are in nanoseconds
    /// since 1970.
    ///
    /// # Errors
    /// Returns [`RecordingError::File`], [`RecordingError::Mcap`], [`RecordingError::Damaged`],
    /// [`RecordingError::Compression`] or [`RecordingError::Message`] if the file cannot be read.
    pub fn events(&self, span: Range<u64>) -> Result<Vec<(u64, Log)>, RecordingError> {
        let channels = self.summary.channels.values();
        let is_log = |it: &&std::sync::Arc<Channel<'_>>| {
            it.schema.as_ref().is_some_and(|it| it.name == Log::NAME)
        };
        let topics: Vec<_> = channels.filter(is_log).map(|it| it.topic.clone()).collect();
        let mut events = Vec::new();
        let topics = topics.iter().map(String::as_str);
        self.messages(topics, span, |channel, at_ns, message| {
            let log = Log::decode(message).map_err(|source| self.wrong(channel, source))?;
            events.push((at_ns, log));
            Ok::<_, RecordingError>(())
        })?;
        Ok(events)
    }

    fn messages<'t, E: From<RecordingError>>(
        &self,
        topics: impl Iterator<Item = &'t str>,
        span: Range<u64>,
        mut take: impl FnMut(u16, u64, &[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        let topics: Vec<_> = topics.collect();
        // No topic would mean all of them.
        if topics.is_empty() || span.is_empty() {
            return Ok(());
        }
        let failed = RecordingError::mcap;
        let options = IndexedReaderOptions::new()
            .with_order(ReadOrder::LogTime)
            .include_topics(topics)
            .starting_at(span.start)
            .ending_before(span.end);
        let reader = IndexedReader::new_with_options(&self.summary, options);
        let mut reader = reader.map_err(failed(&self.path))?;
        while let Some(event) = reader.next_event() {
            match event.map_err(failed(&self.path))? {
                IndexedReadEvent::ReadChunkRequest { offset, .. } => {
                    let chunk = self.chunk(offset)?;
                    let inserted = reader.insert_chunk_record_data(offset, &chunk);
                    inserted.map_err(failed(&self.path))?;
                }
                IndexedReadEvent::Message { header, data } => {
                    take(header.channel_id, header.log_time, data)?;
                }
            }
        }
        Ok(())
    }

    /// Reads the content of the chunk whose content would begin at `offset` if it were not compressed.
    fn chunk(&self, offset: u64) -> Result<Vec<u8>, RecordingError> {
        let at = offset.saturating_sub(records::HEAD + records::OF_CHUNK);
        let damaged = || RecordingError::Damaged {
            path: self.path.clone(),
            at,
        };
        let length = self.file.metadata();
        let length = length
            .map_err(NamedFileError::at("look at", &self.path))?
            .len();
        let step = Walk::new(&self.file, at, length).next();
        match step.map_err(NamedFileError::at("read", &self.path))? {
            Some(Step::Chunk { content }) => Ok(content),
            Some(Step::Unknown { compression }) => Err(RecordingError::Compression {
                path: self.path.clone(),
                compression,
            }),
            _ => Err(damaged()),
        }
    }

    fn wrong(&self, channel: u16, source: condor_ros2::DecodeError) -> RecordingError {
        let found = self.summary.channels.get(&channel);
        RecordingError::Message {
            path: self.path.clone(),
            topic: found.map(|it| it.topic.clone()).unwrap_or_default(),
            source,
        }
    }
}

/// The summary that a complete file has at its end.
pub(super) struct FileSummary {
    pub(super) summary: Summary,
    metadata: BTreeMap<String, BTreeMap<String, String>>,
}

impl FileSummary {
    /// Returns the number of the recording, if it has one.
    pub(super) fn number(&self) -> Option<u64> {
        self.metadata.get(ABOUT).and_then(number)
    }

    /// Returns what it has of each topic.
    pub(super) fn topics(&self) -> Vec<RecordedTopic> {
        let channels: BTreeMap<_, _> = self.summary.channels.iter().collect();
        let topics = channels.into_iter().map(|(id, channel)| RecordedTopic {
            name: channel.topic.clone(),
            messages: messages(&self.summary, *id),
            dropped: self.dropped(&channel.topic),
        });
        topics.collect()
    }

    fn dropped(&self, topic: &str) -> Option<u64> {
        self.metadata.get(DROPPED)?.get(topic)?.parse().ok()
    }

    /// Returns how many messages were taken of each channel; `None` where that is unknown.
    pub(super) fn taken(&self) -> BTreeMap<u16, Option<u64>> {
        let channels = self.summary.channels.iter();
        let taken = channels.map(|(id, channel)| {
            let dropped = self.dropped(&channel.topic);
            let taken = dropped.map(|it| it.saturating_add(messages(&self.summary, *id)));
            (*id, taken)
        });
        taken.collect()
    }

    /// Returns true if all messages are found by the index.
    pub(super) fn has_index(&self) -> bool {
        let chunks = self.summary.chunk_indexes.len();
        self.summary.stats.as_ref().is_some_and(|stats| {
            stats.chunk_count as usize <= chunks && (stats.message_count == 0 || chunks > 0)
        })
    }
}

fn messages(summary: &Summary, channel: u16) -> u64 {
    let counts = summary.stats.as_ref().map(|it| &it.channel_message_counts);
    counts.and_then(|it| it.get(&channel).copied()).unwrap_or(0)
}

/// Reads the summary and the metadata; `None` if the file has no whole ones.
pub(super) fn whole(path: &Path, file: &mut File) -> Result<Option<FileSummary>, RecordingError> {
    let length = file
        .metadata()
        .map_err(NamedFileError::at("look at", path))?
        .len();
    if !is_sound(file, length).map_err(NamedFileError::at("read", path))? {
        return Ok(None);
    }
    let limit = usize::try_from(length).unwrap_or(usize::MAX);
    let options = SummaryReaderOptions::default()
        .with_file_size(length)
        .with_record_length_limit(limit);
    let mut reader = SummaryReader::new_with_options(options);
    while let Some(event) = reader.next_event() {
        match event {
            Ok(SummaryReadEvent::ReadRequest(bytes)) => {
                let read = file.read(reader.insert(bytes));
                reader.notify_read(read.map_err(NamedFileError::at("read", path))?);
            }
            Ok(SummaryReadEvent::SeekRequest(to)) => {
                let at = file.seek(to);
                reader.notify_seeked(at.map_err(NamedFileError::at("read", path))?);
            }
            // The file does not end as a complete one does.
            Err(_) => return Ok(None),
        }
    }
    let summary = reader.finish().filter(|summary| summary.stats.is_some());
    let Some(summary) = summary else {
        return Ok(None);
    };
    // Chunks that are told of many times would be held in memory many times.
    let chunks = summary.chunk_indexes.iter();
    let bytes = chunks.fold(0_u64, |sum, it| sum.saturating_add(it.chunk_length));
    let metadata = metadata(&summary, file, length).map_err(NamedFileError::at("read", path))?;
    let metadata = metadata.filter(|_| bytes <= length);
    Ok(metadata.map(|metadata| FileSummary { summary, metadata }))
}

/// Returns true if all records of the summary are as long as they say, if there is one.
fn is_sound(file: &File, length: u64) -> io::Result<bool> {
    const END: u64 = records::HEAD + 20 + MAGIC.len() as u64;
    let Some(footer) = length.checked_sub(END) else {
        return Ok(false);
    };
    let begin = records::part(file, footer + records::HEAD, 8)?;
    let begin = begin.first_chunk().map_or(0, |it| u64::from_le_bytes(*it));
    if begin == 0 {
        return Ok(true);
    }
    let mut walk = Walk::new(file, begin, length - MAGIC.len() as u64);
    let mut is_ended = false;
    while let Some(step) = walk.next()? {
        match step {
            Step::Record { opcode, .. } => is_ended = opcode == op::FOOTER,
            _ => return Ok(false),
        }
    }
    Ok(is_ended)
}

/// Returns true if the file ends as a complete one without a summary does: with the end of the data, the footer
/// and the magic.
pub(super) fn is_ended(path: &Path, file: &File) -> Result<bool, NamedFileError> {
    const BYTES: u64 = 2 * records::HEAD + 4 + 20 + MAGIC.len() as u64;
    let end = file.metadata().and_then(|metadata| {
        let (length, all) = (metadata.len().min(BYTES), metadata.len());
        part(file, all - length, length)
    });
    let end = end.map_err(NamedFileError::at("read", path))?;
    let mut all = records::records(&end);
    let mut is_next = |opcode, bytes, begin: &[u8]| {
        all.next().is_some_and(|(found, body)| {
            found == opcode && body.len() == bytes && body.starts_with(begin)
        })
    };
    // No summary is where it begins at 0.
    Ok(is_next(op::DATA_END, 4, &[]) && is_next(op::FOOTER, 20, &[0; 8]) && end.ends_with(MAGIC))
}

/// Reads all metadata, by name; `None` if the summary is wrong about it.
fn metadata(
    summary: &Summary,
    file: &File,
    length: u64,
) -> io::Result<Option<BTreeMap<String, BTreeMap<String, String>>>> {
    let mut all = BTreeMap::new();
    for index in &summary.metadata_indexes {
        let end = index.offset.saturating_add(index.length);
        if end > length {
            return Ok(None);
        }
        let Some(Step::Record { opcode, body }) = Walk::new(file, index.offset, end).next()? else {
            return Ok(None);
        };
        let Ok(Record::Metadata(Metadata { name, metadata })) = mcap::parse_record(opcode, &body)
        else {
            return Ok(None);
        };
        all.insert(name, metadata);
    }
    Ok(Some(all))
}
