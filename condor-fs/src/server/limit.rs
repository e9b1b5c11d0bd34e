//! `RLIMIT_FSIZE`: how long a file of this process may become.

use rustix::io::Errno as Linux;
use rustix::process::{Resource, getrlimit};

/// Whether a file may be written up to `end`. Beyond the limit the kernel sends SIGXFSZ, of which most
/// programs die.
pub(super) fn check_file_limit(end: u64) -> Result<(), Linux> {
    // Asked each time: the limit of a running process can be changed.
    match getrlimit(Resource::Fsize).current {
        Some(most) if end > most => Err(Linux::FBIG),
        _ => Ok(()),
    }
}
