//! [`Descriptor`], and the errors of a [`Stdio`](crate::Stdio).

use condor_dev::stdio::LineError;
use condor_dev::stream::DeviceStreamError;
use condor_dev::{Fd, FdError, OpenError};
use condor_fs::FileError;
use condor_tty::ConsoleError;
use embedded_io::ErrorKind;

use crate::text::ShortText;

/// The number of descriptors that a [`Stdio`](crate::Stdio) can have open at a time, the three of the terminal
/// included.
pub const DESCRIPTORS: usize = 8;

/// A descriptor of a [`Stdio`](crate::Stdio): a small number, as on Unix. A descriptor that was closed is not taken for
/// a newer one that has its number: it also has a generation, which wraps after 65 536 uses of the number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Descriptor(pub(crate) Fd);

/// The input of the program's terminal.
pub const STDIN: Descriptor = Descriptor(Fd::new(0, 0));
/// The output of the program's terminal. It is passed on at the end of each line, and before [`STDIN`] is read.
pub const STDOUT: Descriptor = Descriptor(Fd::new(1, 0));
/// The output of the program's terminal, passed on at once.
pub const STDERR: Descriptor = Descriptor(Fd::new(2, 0));

/// The reason why a call of a [`Stdio`](crate::Stdio) or a [`Stream`](crate::Stream) failed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum StdioError {
    /// The descriptor is not open, or not open in this direction.
    #[error(
        "{0}; `open_file` and `open_board` of `Stdio` open descriptors, and 0, 1 and 2 need `console` of `Setup`"
    )]
    Descriptor(#[from] FdError),
    /// All descriptors are open.
    #[error("`{name}` cannot be opened: all {DESCRIPTORS} descriptors are open; `close` one first")]
    Full {
        /// The name of the file or board.
        name: ShortText<32>,
    },
    /// The table has no client of the file service.
    #[error("the file `{name}` cannot be opened: call `with_files` of `Stdio` first")]
    NoFiles {
        /// The path of the file.
        name: ShortText<32>,
    },
    /// The file could not be opened.
    #[error("`{name}`: {error}")]
    File {
        /// The path of the file.
        name: ShortText<32>,
        /// The error of the file service or its client.
        error: FileError,
    },
    /// The board could not be opened.
    #[error(transparent)]
    Board(#[from] OpenError<'static>),
    /// A read, write or close failed. A write that failed has taken none of its bytes.
    #[error("`{name}`: {cause}")]
    Failed {
        /// The name of the file or board, or `console`.
        name: ShortText<32>,
        /// The reason.
        cause: StdioCause,
    },
    /// Bytes could not be passed on. The descriptor stays open and keeps them. The next write, `flush` or `close` tries
    /// again; to lose the bytes, call `discard`.
    #[error(
        "{bytes} bytes for `{name}` are not written yet: {cause}; `flush` again, or `discard` them"
    )]
    Unwritten {
        /// The name of the file or board, or `console`.
        name: ShortText<32>,
        /// The number of bytes that the descriptor keeps.
        bytes: usize,
        /// The reason.
        cause: StdioCause,
    },
    /// A line is too long, or not UTF-8, and is skipped.
    #[error("`{name}`: {error}")]
    Line {
        /// The name of the file or board, or `console`.
        name: ShortText<32>,
        /// The reason; it is never [`LineError::Reader`].
        error: LineError<StdioCause>,
    },
}

/// The error of the terminal, file or board behind a descriptor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StdioCause {
    /// Nothing came, or there was no room, in time.
    #[error("nothing came, or there was no room, in time; try again")]
    TimedOut,
    /// The processor's own memory cannot be accessed.
    #[error("the processor's own memory cannot be accessed")]
    Memory,
    /// The terminal returned this error.
    #[error(transparent)]
    Terminal(#[from] ConsoleError),
    /// The file service or its client returned this error.
    #[error(transparent)]
    File(#[from] FileError),
    /// The board or its bus returned this error.
    #[error(transparent)]
    Board(DeviceStreamError),
}

impl From<DeviceStreamError> for StdioCause {
    fn from(error: DeviceStreamError) -> Self {
        match error {
            DeviceStreamError::TimedOut => Self::TimedOut,
            error @ DeviceStreamError::Io(_) => Self::Board(error),
        }
    }
}

impl embedded_io::Error for StdioCause {
    fn kind(&self) -> ErrorKind {
        match self {
            Self::TimedOut => ErrorKind::TimedOut,
            Self::Memory => ErrorKind::Other,
            Self::Terminal(error) => error.kind(),
            Self::File(error) => error.kind(),
            Self::Board(error) => error.kind(),
        }
    }
}

impl embedded_io::Error for StdioError {
    fn kind(&self) -> ErrorKind {
        match self {
            Self::Descriptor(FdError::Direction { .. }) => ErrorKind::PermissionDenied,
            Self::Descriptor(_) | Self::NoFiles { .. } | Self::Board(_) => ErrorKind::NotConnected,
            Self::Full { .. } => ErrorKind::OutOfMemory,
            Self::File { error, .. } => error.kind(),
            Self::Failed { cause, .. } | Self::Unwritten { cause, .. } => cause.kind(),
            Self::Line { .. } => ErrorKind::InvalidData,
        }
    }
}
