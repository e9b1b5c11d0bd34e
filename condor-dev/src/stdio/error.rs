//! [`StdioError`]: the error of shared inputs and outputs.

use embedded_io::ErrorKind;

/// The reason why a call of a [`StandardInput`](super::StandardInput) or
/// [`StandardOutput`](super::StandardOutput) failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StdioError {
    /// The program has set no standard input or output, or its input or output has no reader or
    /// writer yet.
    #[error(
        "standard input or output is not open: set it by `set_input` or `set_output`, or give it a reader or writer"
    )]
    NotOpen,
    /// The interrupted context, or another thread, is reading or writing; it will also write the
    /// bytes in an output's ring.
    #[error(
        "standard input or output is in use by another thread, or by the interrupted context; try again later"
    )]
    InUse,
    /// The reader or writer failed; the bytes in an output's ring stay there.
    #[error("standard input or output failed: {0}")]
    Failed(ErrorKind),
}

impl embedded_io::Error for StdioError {
    fn kind(&self) -> ErrorKind {
        match self {
            Self::NotOpen => ErrorKind::NotConnected,
            Self::InUse => ErrorKind::Other,
            Self::Failed(kind) => *kind,
        }
    }
}
