//! [`ServerOptions`] of a server.

use condor_mbox::{Processor, Waiting};

/// The limits of a server, and the way in which it waits.
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
    /// Whether nothing in the tree can be changed; attempts get `EROFS`.
    pub read_only: bool,
    /// Processors for which nothing in the tree can be changed; attempts get `EROFS`. This protects
    /// from programs that have errors. It stops a hostile processor only if that cannot write the
    /// `data` of processors with more rights.
    pub read_only_for: ProcessorSet,
    /// Processors that are not served at all: they get `EACCES`. The limit for hostile processors
    /// is that of [`read_only_for`](Self::read_only_for).
    pub refused: ProcessorSet,
    /// The greatest size to which a file may be written or truncated, in bytes; attempts beyond it get
    /// `EFBIG`. `None` sets no limit.
    pub max_file_bytes: Option<u64>,
    /// The greatest sum of the sizes of all files of the tree, in bytes, plus 1024 for each name of a file
    /// or directory; operations that would add more get `EDQUOT`. Files of the host's own programs count,
    /// too. `None` sets no limit.
    pub quota_bytes: Option<u64>,
    /// The permissions of new files for which a client asks for none, less the process's umask. With
    /// them the server must be able to
    /// open the files again for reading and writing.
    pub file_mode: u32,
    /// The permissions of new directories for which a client asks for none, less the process's umask.
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

/// A set of processors.
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
    /// The empty set.
    pub const NONE: Self = Self([0; 4]);

    /// Returns this set with one more processor.
    #[must_use]
    pub const fn with(mut self, processor: Processor) -> Self {
        self.0[(processor.0 / 64) as usize] |= 1 << (processor.0 % 64);
        self
    }

    /// Returns true if the set has `processor`.
    #[must_use]
    pub const fn contains(self, processor: Processor) -> bool {
        self.0[(processor.0 / 64) as usize] >> (processor.0 % 64) & 1 != 0
    }
}
