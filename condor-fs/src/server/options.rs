//! [`Options`] of a server.

use condor_mbox::Waiting;

/// What a server allows, and how it waits.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Nothing in the tree can be changed: `EROFS`.
    pub read_only: bool,
    /// The most bytes that a file may be written or truncated to: `EFBIG` beyond.
    pub max_file_bytes: Option<u64>,
    /// The most bytes that all files of the tree together may have, by their sizes: `EDQUOT` for what
    /// would make a file longer beyond it. Files of the host's own programs count, too.
    pub quota_bytes: Option<u64>,
    /// Permissions of new files, of which the process's umask is taken away.
    pub file_mode: u32,
    /// Permissions of new directories, likewise.
    pub directory_mode: u32,
    /// How the server waits for requests.
    pub waiting: Waiting,
}

impl Default for Options {
    /// Everything is allowed; files have mode 0666 and directories 0777, less the umask.
    fn default() -> Self {
        Self {
            read_only: false,
            max_file_bytes: None,
            quota_bytes: None,
            file_mode: 0o666,
            directory_mode: 0o777,
            waiting: Waiting::default(),
        }
    }
}
