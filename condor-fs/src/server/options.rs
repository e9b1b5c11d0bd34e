//! [`Options`] of a server.

use condor_mbox::{Processor, Waiting};

/// What a server allows, and how it waits.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Nothing in the tree can be changed: `EROFS`.
    pub read_only: bool,
    /// The same for some processors only. This protects from programs that err. A hostile processor is
    /// bound by it only if it cannot write the `data` of those that have more rights.
    pub read_only_for: Processors,
    /// Processors that are not served at all: `EACCES`. The same holds for them.
    pub refused: Processors,
    /// The most bytes that a file may be written or truncated to: `EFBIG` beyond.
    pub max_file_bytes: Option<u64>,
    /// The most bytes that all files of the tree together may have, by their sizes, with 1024 for
    /// each name of a file or directory: `EDQUOT` for what would add more. Files of the host's own
    /// programs count, too.
    pub quota_bytes: Option<u64>,
    /// Permissions of new files, of which the process's umask is taken away. The server must be
    /// able to open them again for reading and writing.
    pub file_mode: u32,
    /// Permissions of new directories, likewise.
    pub directory_mode: u32,
    /// How many lives of the server work on one request. When so many have died of it in a row,
    /// or at it, the next one gives it up: `ECANCELED`, or success if it had happened all the same. Where
    /// servers are killed every few milliseconds, as in tests, more of them are needed.
    pub lives: u32,
    /// How the server waits for requests.
    pub waiting: Waiting,
}

impl Default for Options {
    /// Everything is allowed; files have mode 0666 and directories 0777, less the umask; a request is worked
    /// on by two lives, the one that takes it and the next.
    fn default() -> Self {
        Self {
            read_only: false,
            read_only_for: Processors::NONE,
            refused: Processors::NONE,
            max_file_bytes: None,
            quota_bytes: None,
            file_mode: 0o666,
            directory_mode: 0o777,
            lives: 2,
            waiting: Waiting::default(),
        }
    }
}

/// A set of processors.
///
/// ```
/// # #[cfg(target_os = "linux")] {
/// use condor_fs::server::Processors;
/// use condor_mbox::Processor;
///
/// const GUESTS: Processors = Processors::NONE.with(Processor(3)).with(Processor(200));
/// assert!(GUESTS.contains(Processor(200)) && !GUESTS.contains(Processor(2)));
/// # }
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Processors([u64; 4]);

impl Processors {
    /// No processor.
    pub const NONE: Self = Self([0; 4]);

    /// The same and one more.
    #[must_use]
    pub const fn with(mut self, processor: Processor) -> Self {
        self.0[(processor.0 / 64) as usize] |= 1 << (processor.0 % 64);
        self
    }

    /// Whether it has `processor`.
    #[must_use]
    pub const fn contains(self, processor: Processor) -> bool {
        self.0[(processor.0 / 64) as usize] >> (processor.0 % 64) & 1 != 0
    }
}
