//! Recordings of a running system, as MCAP files.
//!
//! A recording is an MCAP file with the profile `ros2`, so that Foxglove, Lichtblick, PlotJuggler and
//! rosbag2 open it. [`RecordingReader`] reads the variables in it.
//!
//! | topic | type | messages |
//! |---|---|---|
//! | `/PROCESSOR/LOOP` | `condor_rows/msg/…`, see [`Layout`] | one for each row of the loop's variables, or for each value of a published cell |
//! | `/PROCESSOR/messages` | `condor_rows/msg/…` | one for each message to the processor that was heard: its sender, vector and data; the tick is its number among the messages heard and missed, and `lost` counts those that were missed before it |
//! | `/joint_states` | `sensor_msgs/msg/JointState` | one for each row that has positions of joints of the [`Robot`](condor_host::robot::Robot), with these joints |
//! | `/tf` | `tf2_msgs/msg/TFMessage` | one for each of the same rows: the frames that these joints move |
//! | `/tf_static` | `tf2_msgs/msg/TFMessage` | once: the frames that no row moves |
//! | `/robot_description` | `std_msgs/msg/String` | once: the URDF of the robot |
//! | `/events` | `rcl_interfaces/msg/Log` | events of the system |
//!
//! The time of a message is the instant of the event on the clock of the system, plus a constant:
//! the `ahead_ns` of the metadata `condor`. With it, the time is that of the wall clock, in nanoseconds
//! since 1970; in simulated time it is so at the beginning of the recording only. Steps of the wall
//! clock during the recording change nothing.
//!
//! | metadata | keys |
//! |---|---|
//! | `condor` | `format` (of the recording: 1), `number` (of the recording: random, 64 bits in hexadecimal), `version` of the program, `system`, `clock` (`real` or `simulated`), `ahead_ns`, `every` (ticks from one row to the next) |
//! | `condor.dropped` | each topic, with the number of its messages that were taken and are not in the file; `unknown` if the count is lost |
//!
//! The metadata of the channel of a loop or cell has its `processor` and `loop`, and under
//! `variable.FIELD` the name of the variable that the field shows. The attachments are the description
//! of the system and the configuration of the robot.
//!
//! # When the recorder is killed
//!
//! Messages are written in chunks, one each second, or each mebibyte if there is more. After the
//! recorder was killed at any moment, [`complete`] makes a complete file of all whole chunks. Beside an
//! incomplete `FILE` lies `FILE.taken`: the number of the recording, and the number of messages of each channel
//! that were taken. It is written before these messages are, so the difference is the exact number of messages
//! that were dropped. If the machine loses power, the file is complete up to the data that the operating system
//! had written, which it does within about half a minute, and the count of dropped messages may be too small.
//!
//! [`complete`] also leaves out chunks whose checksums are wrong. It ends at bytes that are not a record, such as one
//! with a wrong length, since nothing says where the next one begins; the file is kept, and `mcap recover` may find
//! more in it. [`RecordingReader`] refuses a damaged chunk, and reads chunks that other programs have compressed by lz4
//! or zstd. Neither holds more than 256 MiB of a chunk in memory.

mod completion;
mod message_counts;
mod reader;
mod records;
mod reserved_space;
mod writer;

#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, IntoInnerError};
use std::path::{Path, PathBuf};

use mcap::McapError;
use mcap::records::Metadata;
use mcap::write::NoSeek;

pub use completion::{Damage, RecordingCompletion, complete};
pub use condor_host::error::NamedFileError;
pub use condor_ros2::{DecodeError, Layout, LayoutError};
pub use reader::{Column, RecordedSource, RecordingReader};

pub(crate) use completion::Former;
pub(crate) use writer::{AttachedFile, Origin, TopicCounts, Writer};

/// The version of the parts of a recording that the MCAP format does not define: its metadata and its topics.
/// [`RecordingReader`] refuses other versions.
pub const FORMAT: u32 = 1;

const ABOUT: &str = "condor";
const NUMBER: &str = "number";
const DROPPED: &str = "condor.dropped";
const VARIABLE: &str = "variable.";
/// The bytes of an open chunk at which it is written.
const CHUNK_BYTES: u64 = 1 << 20;

/// The numbers of messages of one topic that a recording contains, and that were dropped.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordedTopic {
    /// The name of the topic, such as `/servo_a/servo`.
    pub name: String,
    /// The number of its messages in the file.
    pub messages: u64,
    /// The number of messages that were taken but are not in the file; `None` if that is unknown.
    pub dropped: Option<u64>,
}

/// The reason why a recording cannot be written or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordingError {
    /// The operating system refused an operation on a file.
    #[error(transparent)]
    File(#[from] NamedFileError),
    /// MCAP cannot be written, or the file is damaged.
    #[error("{}: {source}", path.display())]
    Mcap {
        /// The file.
        path: PathBuf,
        /// The reason.
        source: McapError,
    },
    /// The file is not an MCAP file.
    #[error("{} is not a recording: it does not begin as MCAP does; name another file", path.display())]
    NotMcap {
        /// The file.
        path: PathBuf,
    },
    /// A program writes the file at this moment.
    #[error("{} is being recorded; end its recorder, or name another file", path.display())]
    InUse {
        /// The file.
        path: PathBuf,
    },
    /// The recording was ended too early.
    #[error("{} is not complete; `record --finish {}` completes it", path.display(), path.display())]
    Incomplete {
        /// The file.
        path: PathBuf,
    },
    /// A chunk is not as it was written.
    #[error(
        "{}: the chunk at byte {at} is damaged; `record --finish {}` keeps all others", path.display(), path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The place of the chunk in the file.
        at: u64,
    },
    /// The file is complete but has no index, as other programs write it.
    #[error(
        "{} has no index; `mcap recover {} -o COPY.mcap` writes a copy that has one",
        path.display(), path.display()
    )]
    NoIndex {
        /// The file.
        path: PathBuf,
    },
    /// A chunk is compressed by a method that this program does not know.
    #[error(
        "{} is compressed by `{compression}`, and only lz4 and zstd can be read; \
         `mcap compress --compression none {} -o COPY.mcap` writes a copy that is not compressed",
        path.display(), path.display()
    )]
    Compression {
        /// The file.
        path: PathBuf,
        /// The name of the compression.
        compression: String,
    },
    /// The format of the recording's own parts, beside MCAP, has another version.
    #[error("{} has format {found}, and this program reads {FORMAT}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// The format of the file.
        found: String,
    },
    /// A channel has another schema than a recorder writes.
    #[error("{}: {topic}: {source}", path.display())]
    Schema {
        /// The file.
        path: PathBuf,
        /// The topic of the channel.
        topic: String,
        /// The reason.
        source: LayoutError,
    },
    /// A message does not fit its schema.
    #[error("{}: {topic}: {source}", path.display())]
    Message {
        /// The file.
        path: PathBuf,
        /// The topic of the message.
        topic: String,
        /// The reason.
        source: DecodeError,
    },
    /// There is no such variable, or there are several.
    #[error("{}: {text}", path.display())]
    Name {
        /// The file.
        path: PathBuf,
        /// The reason.
        text: String,
    },
    /// There is no room on the disk.
    #[error(
        "there is no room for more of {} on the disk; it is complete up to here", path.display()
    )]
    Full {
        /// The file.
        path: PathBuf,
    },
}

impl RecordingError {
    fn mcap(path: &Path) -> impl FnOnce(McapError) -> Self {
        |source| {
            let path = path.to_owned();
            match source {
                McapError::Io(source) => NamedFileError::at("write", path)(source).into(),
                source => Self::Mcap { path, source },
            }
        }
    }
}

/// A file to which MCAP is written, from its beginning to its end: if the writer is killed, the file is the
/// beginning of a complete file.
type Mcap = mcap::Writer<NoSeek<BufWriter<File>>>;

/// Begins to write MCAP.
fn begin(file: File) -> Result<Mcap, McapError> {
    let library = concat!(env!("CARGO_PKG_NAME"), " ", env!("CARGO_PKG_VERSION"));
    let options = mcap::WriteOptions::new()
        .profile("ros2")
        .library(library)
        .chunk_size(None)
        .disable_seeking(true);
    options.create(NoSeek::new(BufWriter::new(file)))
}

/// Writes how many messages were dropped, and all that comes at the end of an MCAP file.
fn end(mut mcap: Mcap, dropped: BTreeMap<String, String>) -> Result<File, McapError> {
    mcap.write_metadata(&Metadata {
        name: DROPPED.into(),
        metadata: dropped,
    })?;
    mcap.finish()?;
    let file = mcap.into_inner().into_inner();
    let file = file.into_inner().map_err(IntoInnerError::into_error)?;
    file.sync_all()?;
    Ok(file)
}

/// Returns the number of a recording, from its metadata `condor`.
fn number(about: &BTreeMap<String, String>) -> Option<u64> {
    u64::from_str_radix(about.get(NUMBER)?, 16).ok()
}

/// Returns `FILE.ending`.
fn beside(path: &Path, ending: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(ending);
    name.into()
}
