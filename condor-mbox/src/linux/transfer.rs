//! Data between a file and a [`LinuxWindow`], moved by the kernel without a copy in between.

use std::ffi::c_void;
use std::io;
use std::os::fd::{AsFd, AsRawFd};

use super::window::LinuxWindow;
use crate::window::MemoryWindow;

impl LinuxWindow {
    /// Reads up to `len` bytes of `file`, from `position` on, into the window at `offset`. Both are
    /// in bytes from the beginning of the file or window.
    ///
    /// Returns the number of bytes read, which is less than `len` at the end of the file, or if the
    /// kernel reads less.
    ///
    /// # Errors
    /// `EFAULT`, with nothing read, if `offset` and `len` are not inside the window, `offset` is
    /// not a multiple of four, or the window is read-only; `EFAULT` if the memory is gone, when
    /// part of it may have been written; otherwise the error of the system call `pread`.
    pub fn read_file(
        &self,
        file: impl AsFd,
        position: u64,
        offset: u32,
        len: usize,
    ) -> io::Result<usize> {
        self.check_store(offset, len).map_err(|_| bad_address())?;
        let (memory, position) = (self.range(offset, len)?, offset_of(position)?);
        let descriptor = file.as_fd().as_raw_fd();
        // SAFETY: `range` found the bytes inside the mapping, which `self` keeps and which can be
        // written, as `check_store` found. To the atomics of this process the kernel is one more
        // peer. Memory that is gone is an error of the call.
        self.outcome(unsafe { libc::pread64(descriptor, memory, len, position) })
    }

    /// Writes up to `len` bytes of the window at `offset` to `file`, from `position` on. Both are
    /// in bytes from the beginning of the window or file.
    ///
    /// Returns the number of bytes written, which is less than `len` if the kernel writes less.
    ///
    /// # Errors
    /// `EFAULT`, with nothing written, if `offset` and `len` are not inside the window or `offset`
    /// is not a multiple of four; `EFAULT` if the memory is gone; otherwise the error of the system
    /// call `pwrite`.
    pub fn write_file(
        &self,
        file: impl AsFd,
        position: u64,
        offset: u32,
        len: usize,
    ) -> io::Result<usize> {
        let (memory, position) = (self.range(offset, len)?, offset_of(position)?);
        let descriptor = file.as_fd().as_raw_fd();
        // SAFETY: as in `read_file`; the kernel only reads.
        self.outcome(unsafe { libc::pwrite64(descriptor, memory, len, position) })
    }

    /// The address of `len` bytes at `offset`, for the kernel alone.
    fn range(&self, offset: u32, len: usize) -> io::Result<*mut c_void> {
        self.check(offset, len).map_err(|_| bad_address())?;
        if self.is_lost() {
            return Err(bad_address());
        }
        Ok(self.address(offset).cast())
    }

    fn outcome(&self, count: isize) -> io::Result<usize> {
        let Ok(count) = usize::try_from(count) else {
            return Err(io::Error::last_os_error());
        };
        // Zeros were mapped over memory that another thread found gone.
        if self.is_lost() {
            return Err(bad_address());
        }
        Ok(count)
    }
}

fn offset_of(position: u64) -> io::Result<libc::off64_t> {
    position
        .try_into()
        .map_err(|_| io::Error::from_raw_os_error(libc::EINVAL))
}

fn bad_address() -> io::Error {
    io::Error::from_raw_os_error(libc::EFAULT)
}
