//! [`complete`]: makes a complete file of a recording whose recorder was killed, or that is damaged.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{ErrorKind, Read, Seek, SeekFrom};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use condor_platform::linux::{open_regular, sync_name};
use mcap::records::{Record, op};
use mcap::{Attachment, MAGIC, McapError};
use rustix::fs::{CWD, RenameFlags, renameat_with};
use rustix::io::Errno;

use super::message_counts::MessageCounts;
use super::records::{self, Step, Walk};
use super::writer::lock;
use super::{
    ABOUT, CHUNK_BYTES, DROPPED, Mcap, NamedFileError, RecordedTopic, RecordingError, beside,
    number, reader,
};

/// The result of [`complete`]: the state in which the recording was, and what it contains now.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordingCompletion {
    /// Whether the recording was complete, and without damage, before.
    pub was_complete: bool,
    /// The topics, in the order of their channels; none if the file of another program is complete
    /// without a summary.
    pub topics: Vec<RecordedTopic>,
    /// The damage that is left out.
    pub damage: Damage,
    /// The path at which the damaged file is kept unchanged; `None` if nothing was damaged.
    pub kept: Option<PathBuf>,
}

/// The amount of damage in the file of a recording: bytes that are not records, or not as they were written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Damage {
    /// The number of places.
    pub places: u64,
    /// The number of bytes in all these places together.
    pub bytes: u64,
}

impl Damage {
    const fn add(&mut self, bytes: u64) {
        self.places += 1;
        self.bytes += bytes;
    }
}

/// Completes the recording in the file `path`, whose recorder was killed, or that is damaged. All whole chunks stay,
/// and the numbers of messages that were dropped are added. A recording that is complete and sound stays as it is.
///
/// The new file is written beside the old one as `FILE.new`, and then takes its place: there must be room for both. An
/// old file with damage is kept under a numbered name, since another program may be able to read more of it.
///
/// # Errors
/// Returns [`RecordingError::NotMcap`] if the file is not a recording; [`RecordingError::InUse`] if it is being
/// recorded; [`RecordingError::Compression`] if a chunk cannot be unpacked; [`RecordingError::File`] if the
/// file cannot be read or written. The file then stays as it is.
pub fn complete(path: &Path) -> Result<RecordingCompletion, RecordingError> {
    completed(path, locked(path)?, true).map(|(_, completed)| completed)
}

/// Completes a recording, whose locked file this is, and returns the locked file of what there is then, too. One
/// that was complete is searched for damage if it `is_checked`.
fn completed(
    path: &Path,
    mut file: File,
    is_checked: bool,
) -> Result<(File, RecordingCompletion), RecordingError> {
    let whole = reader::whole(path, &mut file)?;
    let has_index = whole.as_ref().is_some_and(reader::FileSummary::has_index);
    let is_complete = has_index || reader::is_ended(path, &file)?;
    if is_complete && (!is_checked || is_sound(path, &file)?) {
        // The recorder may have been killed just before it removed them.
        MessageCounts::end(path, whole.as_ref().and_then(reader::FileSummary::number))?;
        let completed = RecordingCompletion {
            was_complete: true,
            topics: whole.map(|it| it.topics()).unwrap_or_default(),
            damage: Damage::default(),
            kept: None,
        };
        return Ok((file, completed));
    }
    check_magic(path, &mut file)?;
    let new = beside(path, ".new");
    let out = fresh(&new)?;
    let copied = copied(path, &file, whole.as_ref(), &new, out);
    let renamed = copied.and_then(|(number, out, topics, damage)| {
        let kept = (damage.places > 0).then(|| aside(path)).transpose()?;
        out.sync_all().map_err(NamedFileError::at("write", &new))?;
        std::fs::rename(&new, path).map_err(NamedFileError::at("rename", &new))?;
        sync_name(path).map_err(NamedFileError::at("rename", &new))?;
        Ok((number, out, topics, damage, kept))
    });
    let (number, out, topics, damage, kept) = match renamed {
        Ok(copied) => copied,
        Err(error) => {
            // A new file that stays takes room, and nothing more: the first error counts.
            let _ = std::fs::remove_file(&new);
            return Err(error);
        }
    };
    MessageCounts::end(path, number)?;
    let completed = RecordingCompletion {
        was_complete: false,
        topics,
        damage,
        kept,
    };
    Ok((out, completed))
}

/// Links a file under a second name that is free, and returns that name.
fn aside(path: &Path) -> Result<PathBuf, NamedFileError> {
    let mut number = 1;
    loop {
        let kept = numbered(path, number);
        match std::fs::hard_link(path, &kept) {
            Ok(()) => return Ok(kept),
            Err(error) if error.kind() == ErrorKind::AlreadyExists => number += 1,
            Err(error) => return Err(NamedFileError::at("keep the damaged file as", &kept)(error)),
        }
    }
}

/// Returns `FILE` with a number before its ending.
fn numbered(path: &Path, number: u64) -> PathBuf {
    let mut name = path.file_stem().unwrap_or_default().to_owned();
    name.push(format!(".{number}"));
    if let Some(ending) = path.extension() {
        name.push(".");
        name.push(ending);
    }
    path.with_file_name(name)
}

/// Copies all that is whole, and completes the copy; returns the number of the recording, the copy, its topics,
/// and what is not in it. `summary` is that of the file, if it has one.
fn copied(
    path: &Path,
    file: &File,
    summary: Option<&reader::FileSummary>,
    new: &Path,
    out: File,
) -> Result<(Option<u64>, File, Vec<RecordedTopic>, Damage), RecordingError> {
    let mut copy = Copy {
        mcap: super::begin(out).map_err(RecordingError::mcap(new))?,
        number: None,
        channels: BTreeMap::new(),
        open_bytes: 0,
        damage: Damage::default(),
    };
    if let Some(whole) = summary {
        copy.describe(whole).map_err(RecordingError::mcap(new))?;
    }
    copy.all(path, file, new)?;
    // The messages of a complete file were taken, too.
    let taken = match summary {
        Some(whole) => Some(whole.taken()),
        None => (copy
            .number
            .and_then(|number| MessageCounts::read(path, number)))
        .map(|all| {
            all.into_iter()
                .map(|(id, count)| (id, Some(count)))
                .collect()
        }),
    };
    let topics: Vec<_> = copy
        .channels
        .iter()
        .map(|(number, (topic, messages))| {
            let of_channel =
                |taken: &BTreeMap<_, Option<u64>>| taken.get(number).copied().unwrap_or(Some(0));
            let taken = taken.as_ref().and_then(of_channel);
            RecordedTopic {
                name: topic.clone(),
                messages: *messages,
                dropped: taken.map(|taken| taken.saturating_sub(*messages)),
            }
        })
        .collect();
    let text = |count: Option<u64>| count.map_or("unknown".into(), |count| count.to_string());
    let dropped = topics.iter().map(|it| (it.name.clone(), text(it.dropped)));
    let out = super::end(copy.mcap, dropped.collect()).map_err(RecordingError::mcap(new))?;
    Ok((copy.number, out, topics, copy.damage))
}

/// Makes the file `new`, and locks it. What an earlier completion left there is removed.
fn fresh(new: &Path) -> Result<File, RecordingError> {
    loop {
        let mut options = File::options();
        match options.read(true).write(true).create_new(true).open(new) {
            Ok(file) => {
                lock(&file, new)?;
                return Ok(file);
            }
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {
                let mut former = locked(new)?;
                check_magic(new, &mut former)?;
                std::fs::remove_file(new).map_err(NamedFileError::at("remove", new))?;
            }
            Err(error) => return Err(NamedFileError::at("make", new)(error).into()),
        }
    }
}

/// A recording that was there before. It is locked.
pub(crate) struct Former {
    _file: File,
    path: PathBuf,
    /// The reason why it could not be completed.
    pub(crate) trouble: Option<RecordingError>,
}

impl Former {
    /// Completes the recording at `path`, if there is one and it can be completed.
    ///
    /// # Errors
    /// Returns [`RecordingError::NotMcap`] if the file is not a recording; [`RecordingError::InUse`] if it is
    /// being recorded; [`RecordingError::File`] if it cannot be opened.
    pub(crate) fn complete(path: &Path) -> Result<Option<Self>, RecordingError> {
        if !path.exists() {
            return Ok(None);
        }
        let mut file = locked(path)?;
        check_magic(path, &mut file)?;
        let own = file.try_clone().map_err(NamedFileError::at("open", path))?;
        let (file, trouble) = match completed(path, own, false) {
            Ok((file, _)) => (file, None),
            // The file is in nobody's way under another name.
            Err(error) => (file, Some(error)),
        };
        Ok(Some(Self {
            _file: file,
            path: path.to_owned(),
            trouble,
        }))
    }

    /// Renames the recording, so that the next one can have its name. Returns the new name: `FILE` becomes
    /// `FILE.1` before its ending, or the next number.
    pub(crate) fn keep(self) -> Result<PathBuf, RecordingError> {
        let path = &self.path;
        let mut number = 1_u64;
        loop {
            let kept = numbered(path, number);
            match renameat_with(CWD, path, CWD, &kept, RenameFlags::NOREPLACE) {
                Ok(()) => {
                    // A recording that could not be completed may be so later.
                    MessageCounts::keep(path, &kept)?;
                    return Ok(kept);
                }
                Err(Errno::EXIST) => number += 1,
                Err(error) => return Err(NamedFileError::at("rename", path)(error.into()).into()),
            }
        }
    }
}

/// Opens a recording and locks it.
fn locked(path: &Path) -> Result<File, RecordingError> {
    loop {
        let file = open_regular(path).map_err(NamedFileError::at("open", path))?;
        lock(&file, path)?;
        // Somebody may have completed it before it was locked.
        let inode = |metadata: std::fs::Metadata| (metadata.dev(), metadata.ino());
        let own = file
            .metadata()
            .map_err(NamedFileError::at("look at", path))?;
        let present = std::fs::metadata(path).map_err(NamedFileError::at("look at", path))?;
        if inode(own) == inode(present) {
            return Ok(file);
        }
    }
}

/// Refuses a file that is not a recording. An empty or zeroed one passes: its recorder may have been killed
/// before it wrote anything.
fn check_magic(path: &Path, file: &mut File) -> Result<(), RecordingError> {
    let mut start = Vec::new();
    rewind(path, file)?;
    let read = file.take(MAGIC.len() as u64).read_to_end(&mut start);
    read.map_err(NamedFileError::at("read", path))?;
    // After a power loss, what was not on the disk yet is 0.
    if MAGIC.starts_with(&start) || start == [0; MAGIC.len()] {
        return Ok(());
    }
    Err(RecordingError::NotMcap {
        path: path.to_owned(),
    })
}

fn rewind(path: &Path, file: &mut File) -> Result<(), NamedFileError> {
    let at = file.seek(SeekFrom::Start(0));
    at.map(|_| ()).map_err(NamedFileError::at("read", path))
}

/// A file to which all is copied that is whole.
struct Copy {
    mcap: Mcap,
    /// The number of the recording, if it has one.
    number: Option<u64>,
    /// The topic of each channel, and the number of messages that were copied.
    channels: BTreeMap<u16, (String, u64)>,
    /// The bytes since the last chunk ended.
    open_bytes: u64,
    damage: Damage,
}

impl Copy {
    /// Adds the types and channels of a summary: the chunk with them may be damaged.
    fn describe(&mut self, whole: &reader::FileSummary) -> Result<(), McapError> {
        let schemas: BTreeMap<_, _> = whole.summary.schemas.iter().collect();
        for (id, it) in schemas {
            self.mcap
                .add_schema_with_id(*id, &it.name, &it.encoding, &it.data)?;
        }
        let channels: BTreeMap<_, _> = whole.summary.channels.iter().collect();
        for (id, it) in channels {
            let schema = it.schema.as_ref().map_or(0, |schema| schema.id);
            let (topic, encoding) = (&it.topic, &it.message_encoding);
            self.mcap
                .add_channel_with_id(*id, schema, topic, encoding, &it.metadata)?;
            self.channels.insert(*id, (topic.clone(), 0));
        }
        Ok(())
    }

    fn all(&mut self, path: &Path, file: &File, new: &Path) -> Result<(), RecordingError> {
        let mut walk = walk(path, file)?;
        let (mut is_first, mut has_chunks) = (true, false);
        while let Some(step) = walk.next().map_err(NamedFileError::at("read", path))? {
            has_chunks |= matches!(step, Step::Chunk { .. });
            let copied = match step {
                Step::Record { opcode, .. } if opcode == op::DATA_END => return Ok(()),
                // A file begins with its header, and has either all messages in chunks or none: this is another
                // record, whose opcode is damaged.
                Step::Record { opcode, body }
                    if opcode == op::MESSAGE && (is_first || has_chunks) =>
                {
                    self.damage.add(records::HEAD + body.len() as u64);
                    Ok(())
                }
                Step::Record { opcode, body } => self.records([(opcode, body.as_slice())]),
                Step::Chunk { content } => self.records(records::records(&content)),
                Step::Damaged { bytes } => {
                    self.damage.add(bytes);
                    Ok(())
                }
                Step::Unknown { compression } => {
                    let path = path.to_owned();
                    return Err(RecordingError::Compression { path, compression });
                }
            };
            copied.map_err(|error| NamedFileError::at("write", new)(error))?;
            is_first = false;
        }
        Ok(())
    }

    /// Copies records. Those that contradict others, or what they are part of, are damage.
    fn records<'r>(
        &mut self,
        all: impl IntoIterator<Item = (u8, &'r [u8])>,
    ) -> std::io::Result<()> {
        let mut lost = 0;
        for (opcode, body) in all {
            let bytes = body.len() as u64 + records::HEAD;
            if opcode >= records::OF_APPLICATIONS {
                // Nothing is known here of such a record, and it is not copied.
                lost += bytes;
                continue;
            }
            match self.record(opcode, body) {
                Ok(()) => {}
                Err(McapError::Io(error)) => return Err(error),
                Err(_) => lost += bytes,
            }
        }
        if lost > 0 {
            self.damage.add(lost);
        }
        Ok(())
    }

    /// Copies a record.
    fn record(&mut self, opcode: u8, body: &[u8]) -> Result<(), McapError> {
        self.open_bytes += body.len() as u64;
        match mcap::parse_record(opcode, body)? {
            Record::Schema { header, data } => {
                let (id, name, encoding) = (header.id, &header.name, &header.encoding);
                self.mcap.add_schema_with_id(id, name, encoding, &data)?;
            }
            Record::Channel(it) => {
                let (topic, encoding) = (&it.topic, &it.message_encoding);
                self.mcap.add_channel_with_id(
                    it.id,
                    it.schema_id,
                    topic,
                    encoding,
                    &it.metadata,
                )?;
                self.channels.entry(it.id).or_insert((it.topic, 0));
            }
            Record::Message { header, data } => {
                self.mcap.write_to_known_channel(&header, &data)?;
                if let Some((_, messages)) = self.channels.get_mut(&header.channel_id) {
                    *messages += 1;
                }
            }
            Record::Attachment { header, data, .. } => self.mcap.attach(&Attachment {
                log_time: header.log_time,
                create_time: header.create_time,
                name: header.name,
                media_type: header.media_type,
                data,
            })?,
            Record::Metadata(metadata) if metadata.name != DROPPED => {
                if metadata.name == ABOUT {
                    self.number = number(&metadata.metadata);
                }
                self.mcap.write_metadata(&metadata)?;
            }
            _ => {}
        }
        if self.open_bytes >= CHUNK_BYTES {
            self.mcap.flush()?;
            self.open_bytes = 0;
        }
        Ok(())
    }
}

/// Returns a walk through all records of a file.
fn walk<'f>(path: &Path, file: &'f File) -> Result<Walk<'f>, NamedFileError> {
    let metadata = file
        .metadata()
        .map_err(NamedFileError::at("look at", path))?;
    Ok(Walk::new(file, MAGIC.len() as u64, metadata.len()))
}

/// Returns true if all data of a complete file is as it was written, as far as there are checksums.
fn is_sound(path: &Path, file: &File) -> Result<bool, NamedFileError> {
    let mut walk = walk(path, file)?;
    while let Some(step) = walk.next().map_err(NamedFileError::at("read", path))? {
        match step {
            Step::Record { opcode, .. } if opcode == op::DATA_END => return Ok(true),
            Step::Damaged { .. } => return Ok(false),
            _ => {}
        }
    }
    Ok(false)
}
