//! [`complete`]: makes a complete file of a recording whose recorder was killed.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{ErrorKind, Read, Seek, SeekFrom};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use mcap::records::{Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{Attachment, MAGIC, McapError};
use rustix::fs::{CWD, RenameFlags, renameat_with};
use rustix::io::Errno;

use super::taken::Taken;
use super::writer::lock;
use super::{
    ABOUT, CHUNK_BYTES, DROPPED, FileError, Mcap, RecordingError, Topic, beside, number, reader,
};

/// The result of completing a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Completed {
    /// Whether it was complete before.
    pub was_complete: bool,
    /// The topics, in the order of their channels; none if the file of another program is complete
    /// without a summary.
    pub topics: Vec<Topic>,
}

/// Completes a recording whose recorder was killed: all whole chunks stay, and the number of messages
/// that were dropped is added. A complete one stays as it is.
///
/// The new file is written beside the old one as `FILE.new`, and then takes its place: there must be
/// room for both.
///
/// # Errors
/// [`RecordingError::NotMcap`] if it is no recording, [`RecordingError::InUse`] if it is being
/// recorded, [`RecordingError::Mcap`] if it is damaged or compressed, [`RecordingError::File`] if it
/// cannot be read or written. The file then stays as it is.
pub fn complete(path: &Path) -> Result<Completed, RecordingError> {
    let (_, completed) = completed(path)?;
    Ok(completed)
}

/// Completes a recording, and returns its locked file, too.
fn completed(path: &Path) -> Result<(File, Completed), RecordingError> {
    let mut file = locked(path)?;
    if let Some((number, topics)) = reader::topics(path, &mut file)? {
        // The recorder may have been killed just before it removed them.
        Taken::end(path, number)?;
        let was_complete = true;
        return Ok((
            file,
            Completed {
                was_complete,
                topics,
            },
        ));
    }
    check_magic(path, &mut file)?;
    let new = beside(path, ".new");
    let out = fresh(&new)?;
    let copied = copied(path, &mut file, &new, out);
    let renamed = copied.and_then(|copied| {
        std::fs::rename(&new, path).map_err(FileError::at("rename", &new))?;
        Ok(copied)
    });
    let (number, out, topics) = match renamed {
        Ok(copied) => copied,
        Err(error) => {
            // What is left of it takes room, and nothing more: the first error counts.
            let _ = std::fs::remove_file(&new);
            return Err(error);
        }
    };
    Taken::end(path, number)?;
    let was_complete = false;
    Ok((
        out,
        Completed {
            was_complete,
            topics,
        },
    ))
}

/// Copies all that is whole, and completes the copy; returns the number of the recording, the copy, and
/// its topics.
fn copied(
    path: &Path,
    file: &mut File,
    new: &Path,
    out: File,
) -> Result<(Option<u64>, File, Vec<Topic>), RecordingError> {
    let mut copy = Copy {
        mcap: super::begin(out).map_err(RecordingError::mcap(new))?,
        number: None,
        channels: BTreeMap::new(),
        open_bytes: 0,
    };
    copy.all(path, file, new)?;
    let taken = copy.number.and_then(|number| Taken::read(path, number));
    let topics: Vec<_> = copy
        .channels
        .iter()
        .map(|(number, (topic, messages))| {
            let of_channel = |taken: &BTreeMap<_, _>| taken.get(number).copied().unwrap_or(0);
            let taken = taken.as_ref().map(of_channel);
            Topic {
                name: topic.clone(),
                messages: *messages,
                dropped: taken.map(|taken| taken.saturating_sub(*messages)),
            }
        })
        .collect();
    let text = |count: Option<u64>| count.map_or("unknown".into(), |count| count.to_string());
    let dropped = topics.iter().map(|it| (it.name.clone(), text(it.dropped)));
    let out = super::end(copy.mcap, dropped.collect()).map_err(RecordingError::mcap(new))?;
    Ok((copy.number, out, topics))
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
                std::fs::remove_file(new).map_err(FileError::at("remove", new))?;
            }
            Err(error) => return Err(FileError::at("make", new)(error).into()),
        }
    }
}

/// A recording that was there before, and is complete. It is locked.
pub(crate) struct Former {
    _file: File,
    path: PathBuf,
}

impl Former {
    /// Completes the recording at `path`, if there is one.
    pub(crate) fn complete(path: &Path) -> Result<Option<Self>, RecordingError> {
        if !path.exists() {
            return Ok(None);
        }
        let (file, _) = completed(path)?;
        Ok(Some(Self {
            _file: file,
            path: path.to_owned(),
        }))
    }

    /// Gives it another name, so that the next one can have its own. Returns that name: `FILE` becomes
    /// `FILE.1` before its ending, or the next number.
    pub(crate) fn keep(self) -> Result<PathBuf, RecordingError> {
        let path = &self.path;
        let mut number = 1_u64;
        loop {
            let mut name = path.file_stem().unwrap_or_default().to_owned();
            name.push(format!(".{number}"));
            if let Some(ending) = path.extension() {
                name.push(".");
                name.push(ending);
            }
            let kept = path.with_file_name(name);
            match renameat_with(CWD, path, CWD, &kept, RenameFlags::NOREPLACE) {
                Ok(()) => return Ok(kept),
                Err(Errno::EXIST) => number += 1,
                Err(error) => return Err(FileError::at("rename", path)(error.into()).into()),
            }
        }
    }
}

/// Opens a recording and locks it.
fn locked(path: &Path) -> Result<File, RecordingError> {
    loop {
        let file = File::open(path).map_err(FileError::at("open", path))?;
        lock(&file, path)?;
        // Somebody may have completed it before it was locked.
        let inode = |metadata: std::fs::Metadata| (metadata.dev(), metadata.ino());
        let own = file.metadata().map_err(FileError::at("look at", path))?;
        let present = std::fs::metadata(path).map_err(FileError::at("look at", path))?;
        if inode(own) == inode(present) {
            return Ok(file);
        }
    }
}

/// Refuses what is no recording. Its recorder may have been killed before it wrote anything.
fn check_magic(path: &Path, file: &mut File) -> Result<(), RecordingError> {
    let mut start = Vec::new();
    rewind(path, file)?;
    let read = file.take(MAGIC.len() as u64).read_to_end(&mut start);
    read.map_err(FileError::at("read", path))?;
    if MAGIC.starts_with(&start) {
        return Ok(());
    }
    Err(RecordingError::NotMcap {
        path: path.to_owned(),
    })
}

fn rewind(path: &Path, file: &mut File) -> Result<(), FileError> {
    let at = file.seek(SeekFrom::Start(0));
    at.map(|_| ()).map_err(FileError::at("read", path))
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
}

impl Copy {
    fn all(&mut self, path: &Path, file: &mut File, new: &Path) -> Result<(), RecordingError> {
        rewind(path, file)?;
        let length = file
            .metadata()
            .map_err(FileError::at("look at", path))?
            .len();
        let mut reader = LinearReader::new_with_options(
            LinearReaderOptions::default()
                .with_skip_end_magic(true)
                // A chunk is copied as a whole, or not at all.
                .with_prevalidate_chunk_crcs(true)
                .with_record_length_limit(usize::try_from(length).unwrap_or(usize::MAX)),
        );
        while let Some(event) = reader.next_event() {
            let event = match event {
                // The last record is not whole; it may be longer than all of the file.
                Err(
                    McapError::UnexpectedEof
                    | McapError::RecordTooLarge { .. }
                    | McapError::ChunkTooLarge(_),
                ) => break,
                event => event.map_err(RecordingError::mcap(path))?,
            };
            match event {
                LinearReadEvent::ReadRequest(bytes) => {
                    let read = file.read(reader.insert(bytes));
                    reader.notify_read(read.map_err(FileError::at("read", path))?);
                }
                LinearReadEvent::Record { data, opcode } => match self.record(opcode, data) {
                    Ok(true) => {}
                    Err(McapError::Io(error)) => {
                        return Err(FileError::at("write", new)(error).into());
                    }
                    Ok(false) => break,
                    Err(error) => return Err(RecordingError::mcap(path)(error)),
                },
            }
        }
        Ok(())
    }

    /// Copies a record; returns whether more of them come.
    fn record(&mut self, opcode: u8, data: &[u8]) -> Result<bool, McapError> {
        self.open_bytes += data.len() as u64;
        let padded;
        let data = match opcode {
            op::ATTACHMENT => {
                // One that ends too early would be read beyond its end.
                padded = [data, &[0; 4]].concat();
                &padded
            }
            _ => data,
        };
        match mcap::parse_record(opcode, data)? {
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
            Record::DataEnd(_) => return Ok(false),
            _ => {}
        }
        if self.open_bytes >= CHUNK_BYTES {
            self.mcap.flush()?;
            self.open_bytes = 0;
        }
        Ok(true)
    }
}
