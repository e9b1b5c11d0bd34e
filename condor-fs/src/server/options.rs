//! [`ServerOptions`] of a server.

use condor_mbox::{Processor, Waiting};

/// The options of a [`FileServer`](super::FileServer): what clients may do, how much they may
/// store, and how the server waits.
///
/// ```
/// # #[cfg(target_os = "linux")] {
/// use condor_fs::server::ServerOptions;
///
/// let options = ServerOptions { quota_bytes: Some(1_000_000), ..ServerOptions::default() };
/// assert!(!options.read_only);
/// # }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct ServerOptions {
    /// True if no client can change anything in the tree; attempts return `EROFS`.
    pub read_only: bool,
    /// The processors that cannot change anything in the tree; their attempts return `EROFS`. This
    /// protects the tree from programs with errors. It stops a hostile program only if that program
    /// cannot write the `data` of processors with more rights.
    pub read_only_for: ProcessorSet,
    /// The processors that are not served at all: their requests return `EACCES`. It stops a
    /// hostile program only under the condition that [`read_only_for`](Self::read_only_for) states.
    pub refused: ProcessorSet,
    /// The greatest size to which a file may be written or truncated, in bytes; attempts beyond it
    /// return `EFBIG`. `None` sets no limit.
    pub max_file_bytes: Option<u64>,
    /// The greatest sum of the sizes of all files of the tree, in bytes, where each name of a file
    /// or directory counts as 1024 bytes more. Operations that would exceed it return `EDQUOT`.
    /// Files of the host's own programs count, too. `None` sets no limit.
    pub quota_bytes: Option<u64>,
    /// The permissions of a new file if the client asks for none, less the umask of the server's
    /// process. The server itself must be able to open such a file again for reading and writing.
    pub file_mode: u32,
    /// The permissions of a new directory if the client asks for none, less the umask of the
    /// server's process.
    pub directory_mode: u32,
    /// The number of runs of the server that may work on one request. If so many in a row were
    /// killed during it, the next run does not work on it: it answers `ECANCELED`, or success if
    /// the request had taken effect. If servers are killed every few milliseconds, as in tests, a
    /// greater number is needed.
    pub incarnations: u32,
    /// The way in which the server waits for requests.
    pub waiting: Waiting,
}

impl Default for ServerOptions {
    /// Everything is allowed; files have mode 0666 and directories 0777, less the umask; a request is worked
    /// on by two incarnations, the one that takes it and the next.
    fn default() -> Self {
        Self {
            read_only: false,
            read_only_for: ProcessorSet::NONE,
            refused: ProcessorSet::NONE,
            max_file_bytes: None,
            quota_bytes: None,
            file_mode: 0o666,
            directory_mode: 0o777,
            incarnations: 2,
            waiting: Waiting::default(),
        }
    }
}

/// A set of processors, for options that concern only some of them.
///
/// ```
/// # #[cfg(target_os = "linux")] {
/// use condor_fs::server::ProcessorSet;
/// use condor_mbox::Processor;
///
/// const GUESTS: ProcessorSet = ProcessorSet::NONE.with(Processor(3)).with(Processor(200));
/// assert!(GUESTS.contains(Processor(200)) && !GUESTS.contains(Processor(2)));
/// # }
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ProcessorSet([u64; 4]);

impl ProcessorSet {
    /// The set without any processor.
    pub const NONE: Self = Self([0; 4]);

    /// Returns this set with `processor` added.
    #[must_use]
    pub const fn with(mut self, processor: Processor) -> Self {
        self.0[(processor.0 / 64) as usize] |= 1 << (processor.0 % 64);
        self
    }

    /// Returns true if `processor` is in the set.
    #[must_use]
    pub const fn contains(self, processor: Processor) -> bool {
        self.0[(processor.0 / 64) as usize] >> (processor.0 % 64) & 1 != 0
    }
}
