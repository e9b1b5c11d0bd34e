//! The lock that is a processor's number.
//!
//! It belongs to the open file description (`F_OFD_SETLK`), not to the process, as classic locks
//! do: those vanish when *any* descriptor of the file is closed, and never conflict inside one
//! process.

use std::io;
use std::os::fd::{AsFd, AsRawFd};

use rustix::io::Errno;

/// Tries to take the number that belongs to `mail`; false if somebody has it.
///
/// `mail` must be open for writing. The lock is held until the last descriptor of this open file
/// description is closed, and its last mapping gone.
pub(super) fn take(mail: impl AsFd) -> io::Result<bool> {
    match control(mail, libc::F_OFD_SETLK) {
        Ok(_) => Ok(true),
        Err(Errno::AGAIN | Errno::ACCESS) => Ok(false),
        Err(errno) => Err(errno.into()),
    }
}

/// Returns true if a process holds the number that belongs to `mail`, by another open file description
/// than this one; it may be open for reading only.
pub(super) fn is_held(mail: impl AsFd) -> io::Result<bool> {
    let lock = control(mail, libc::F_OFD_GETLK)?;
    Ok(i32::from(lock.l_type) != libc::F_UNLCK)
}

/// A call about a write lock on the first byte.
fn control(mail: impl AsFd, command: libc::c_int) -> Result<libc::flock, Errno> {
    let mut lock = core::mem::MaybeUninit::<libc::flock>::zeroed();
    // SAFETY: `flock` is integers alone; zero is a valid value of each. The process id must be
    // zero for locks of open file descriptions.
    let lock = unsafe { lock.assume_init_mut() };
    lock.l_type = libc::F_WRLCK as libc::c_short;
    lock.l_whence = libc::SEEK_SET as libc::c_short;
    lock.l_len = 1;
    let descriptor = mail.as_fd().as_raw_fd();
    // SAFETY: the descriptor is open, since it is borrowed; both commands take a `flock`, which
    // the kernel does not keep.
    if unsafe { libc::fcntl(descriptor, command, &raw mut *lock) } == -1 {
        let code = io::Error::last_os_error().raw_os_error();
        return Err(Errno::from_raw_os_error(code.unwrap_or(libc::EINVAL)));
    }
    Ok(*lock)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::File;

    #[test]
    fn a_lock_is_seen_by_descriptors_for_reading_of_other_descriptions() {
        let file = tempfile::NamedTempFile::new().expect("a temporary file");
        let watcher = File::open(file.path()).expect("it can be read");
        assert!(!is_held(&watcher).expect("it can be asked"));
        assert!(take(&file).expect("it can be locked"));
        assert!(take(&file).expect("a second time changes nothing"));
        assert!(is_held(&watcher).expect("it can be asked"));
        assert!(!is_held(&file).expect("the holder sees no other"));
        let other = File::options()
            .write(true)
            .open(file.path())
            .expect("it can be written");
        assert!(!take(&other).expect("it can be asked"));
        // Classic locks would vanish with any descriptor of the file.
        drop(other);
        assert!(is_held(&watcher).expect("it can be asked"));
        assert!(
            take(&watcher).is_err(),
            "a lock to write needs a file to write"
        );
    }
}
