//! [`LinuxWindow`]: a mapped file, memfd or device.

use core::ffi::c_void;
use core::num::NonZeroUsize;
use core::ptr::{self, NonNull};
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering, fence};
use std::fs::File;
use std::os::fd::{AsFd, OwnedFd};
use std::sync::Arc;

use rustix::fs::FileType;
use rustix::io::Errno;
use rustix::mm::{MapFlags, ProtFlags};

use super::copy;
use super::fault::{self, GuardError, Guarded};
use crate::window::{
    AccessError, CompareExchange, LoadOrder, MemoryWindow, StoreOrder, WindowErrorKind,
    WindowWords, check_access, check_words,
};

/// The accesses that a [`LinuxWindow`] allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WindowAccess {
    /// Loads only; the file need only be open for reading.
    ReadOnly,
    /// Loads and stores; the file must be open for both.
    ReadWrite,
}

/// The reason why [`LinuxWindow::map`] or [`LinuxWindow::uio`] could not map a window.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WindowMapError {
    /// Offset or length is not a multiple of four, or the length is zero.
    #[error(
        "a window needs a size above 0 and an offset that are multiples of 4, not {len:#x} bytes at offset \
             {offset:#x}"
    )]
    NotWords {
        /// Offset in the file, in bytes.
        offset: u64,
        /// Length of the window, in bytes.
        len: u64,
    },
    /// The window exceeds the addresses of this machine, or the 32 bits of an offset.
    #[error("a window of {len:#x} bytes at offset {offset:#x} is too large for this machine")]
    TooLarge {
        /// Offset in the file, in bytes.
        offset: u64,
        /// Length of the window, in bytes.
        len: u64,
    },
    /// The file ends before the window does.
    #[error("the file of the window has {found:#x} bytes, but needs {needed:#x}")]
    TooShort {
        /// The end of the window, in bytes from the beginning of the file.
        needed: u64,
        /// The size of the file, in bytes.
        found: u64,
    },
    /// The process has the greatest possible number of windows already.
    #[error("this process already has {slots} windows, the most that it may have")]
    TooMany {
        /// The greatest number of mappings at a time.
        slots: usize,
    },
    /// A call to the system failed.
    #[error("cannot {doing}: {source}")]
    System {
        /// The operation that failed, such as `map`.
        doing: &'static str,
        /// The error of the operating system.
        source: std::io::Error,
    },
}

impl WindowMapError {
    pub(super) fn system(doing: &'static str) -> impl FnOnce(Errno) -> Self {
        move |errno| Self::System {
            doing,
            source: errno.into(),
        }
    }
}

/// A range of a file, a memfd or a device that is mapped into this process and shared.
///
/// All clones are the same mapping; it is unmapped with the last of them. Every access is one
/// atomic 32-bit load, store or compare-and-swap, also to a device.
///
/// If the memory behind it vanishes, all later accesses return [`Lost`](WindowErrorKind::Lost),
/// even for parts of the file that are still there, and even if the memory comes back: map it again
/// to use it. However, bytes that were truncated *within* the last page of a file read as zeros, as
/// the kernel provides them.
///
/// # Devices
///
/// [`CompareExchange`] is indivisible for processors that are coherent with this one. For the
/// memory of a device it is so only if the bus has an indivisible operation; otherwise do not use
/// it. (If the hardware answers with a bus error, the window becomes `Lost`.)
///
/// # Example
///
/// ```
/// use std::io::Write;
/// use condor_mbox::{LoadOrder, MemoryWindow};
/// use condor_mbox::linux::{WindowAccess, LinuxWindow};
///
/// let mut file = tempfile::tempfile()?;
/// file.write_all(&[1, 0, 0, 0, 2, 0, 0, 0])?;
/// let window = LinuxWindow::map(&file, 0, 8, WindowAccess::ReadOnly)?;
/// assert_eq!(window.load(4, LoadOrder::Acquire)?, 2);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct LinuxWindow {
    base: NonNull<u8>,
    size: u32,
    access: WindowAccess,
    lost: &'static AtomicBool,
    /// Keeps `base` and `lost` valid.
    _mapping: Arc<Mapping>,
}

// SAFETY: the memory is reached through atomics only, and `_mapping`, which keeps it mapped, can
// be shared and dropped by any thread; nothing of it belongs to a thread.
unsafe impl Send for LinuxWindow {}
// SAFETY: as for `Send`; every method that takes `&self` makes atomic accesses only.
unsafe impl Sync for LinuxWindow {}

/// Whole pages that are mapped until this is dropped.
#[derive(Debug)]
struct Mapping {
    guard: Option<Guarded>,
    pages: NonZeroUsize,
    len: usize,
    /// A file that stays open as long as this is mapped, with the locks that belong to it.
    _file: Option<OwnedFd>,
}

impl Drop for Mapping {
    fn drop(&mut self) {
        // First the handler forgets the pages, then others may get their addresses.
        drop(self.guard.take());
        let pages = ptr::with_exposed_provenance_mut::<c_void>(self.pages.get());
        // SAFETY: `LinuxWindow::map_pages` mapped exactly these pages, and the last window that
        // could reach them is being dropped.
        let _ = unsafe { rustix::mm::munmap(pages, self.len) };
    }
}

impl LinuxWindow {
    /// Maps `len` bytes of `file`, from `offset` on, in bytes from the beginning of the file. The
    /// offset need not be at the beginning of a page.
    ///
    /// Everything that can be mapped is allowed: a file, a memfd, a UIO device, or `/dev/mem`
    /// (opened with `O_SYNC`, since it may be cached otherwise).
    ///
    /// # Errors
    /// [`WindowMapError::NotWords`] if `offset` or `len` is not a multiple of four, or `len` is
    /// zero; [`WindowMapError::TooLarge`] if they are too large; [`WindowMapError::TooShort`] if a
    /// regular file ends before the window does; [`WindowMapError::TooMany`] if the process has too
    /// many windows; [`WindowMapError::System`] if the operating system refuses.
    pub fn map(
        file: impl AsFd,
        offset: u64,
        len: u32,
        access: WindowAccess,
    ) -> Result<Self, WindowMapError> {
        Self::map_pages(file.as_fd(), offset, len, access, None)
    }

    /// As [`map`](Self::map); `kept` stays open as long as it is mapped.
    pub(super) fn map_and_keep(
        file: impl AsFd,
        offset: u64,
        len: u32,
        access: WindowAccess,
        kept: OwnedFd,
    ) -> Result<Self, WindowMapError> {
        Self::map_pages(file, offset, len, access, Some(kept))
    }

    /// Maps the memory number `map` of the device `/dev/uio{device}`.
    ///
    /// The size and place of the memory are read from `/sys/class/uio/uio{device}/maps/map{map}`.
    ///
    /// # Errors
    /// [`WindowMapError::System`] if the device or the memory does not exist or may not be opened;
    /// otherwise an error of [`map`](Self::map).
    pub fn uio(device: u32, map: u32, access: WindowAccess) -> Result<Self, WindowMapError> {
        let described =
            std::path::PathBuf::from(format!("/sys/class/uio/uio{device}/maps/map{map}"));
        let (offset, len) = uio_range(&described, map)?;
        let opened = File::options()
            .read(true)
            .write(access == WindowAccess::ReadWrite)
            .open(format!("/dev/uio{device}"));
        let file = opened.map_err(|source| WindowMapError::System {
            doing: "open the UIO device",
            source,
        })?;
        Self::map(file, offset, len, access)
    }

    fn map_pages(
        file: impl AsFd,
        offset: u64,
        size: u32,
        access: WindowAccess,
        keep: Option<OwnedFd>,
    ) -> Result<Self, WindowMapError> {
        let len = u64::from(size);
        if size == 0 || !size.is_multiple_of(4) || !offset.is_multiple_of(4) {
            return Err(WindowMapError::NotWords { offset, len });
        }
        let page = rustix::param::page_size() as u64;
        let skip = offset % page;
        let too_large = WindowMapError::TooLarge { offset, len };
        let Some(end) = offset
            .checked_add(len)
            .filter(|&end| i64::try_from(end).is_ok())
        else {
            return Err(too_large);
        };
        let Ok(bytes) = usize::try_from((skip + len).div_ceil(page) * page) else {
            return Err(too_large);
        };
        let stat = rustix::fs::fstat(&file).map_err(WindowMapError::system("examine the file"))?;
        let found = u64::try_from(stat.st_size).unwrap_or(0);
        if FileType::from_raw_mode(stat.st_mode) == FileType::RegularFile && found < end {
            return Err(WindowMapError::TooShort { needed: end, found });
        }
        let protection = match access {
            WindowAccess::ReadOnly => ProtFlags::READ,
            WindowAccess::ReadWrite => ProtFlags::READ | ProtFlags::WRITE,
        };
        // SAFETY: without FIXED the kernel chooses addresses that nothing else uses. That others
        // change the memory is harmless: no reference to it lives longer than one atomic access.
        let pages = unsafe {
            rustix::mm::mmap(
                ptr::null_mut(),
                bytes,
                protection,
                MapFlags::SHARED,
                &file,
                offset - skip,
            )
        }
        .map_err(WindowMapError::system("map the file"))?;
        let address = NonZeroUsize::new(pages.expose_provenance()).ok_or(too_large)?;
        // From here on the mapping is undone when `mapping` is dropped.
        let mut mapping = Mapping {
            guard: None,
            pages: address,
            len: bytes,
            _file: keep,
        };
        let guard = Guarded::new(address.get(), bytes).map_err(|error| match error {
            GuardError::Full => WindowMapError::TooMany {
                slots: fault::SLOTS,
            },
            GuardError::Install(source) => WindowMapError::System {
                doing: "handle SIGBUS",
                source,
            },
        })?;
        let lost = guard.lost();
        mapping.guard = Some(guard);
        let base =
            NonNull::new(pages.cast::<u8>()).ok_or(WindowMapError::TooLarge { offset, len })?;
        // SAFETY: `skip` is less than a page, and there is at least one.
        let base = unsafe { base.add(skip as usize) };
        Ok(Self {
            base,
            size,
            access,
            lost,
            _mapping: Arc::new(mapping),
        })
    }

    /// Returns the accesses that the mapping allows.
    #[must_use]
    pub fn access(&self) -> WindowAccess {
        self.access
    }

    /// Returns true if an access to the window has found that the memory behind it is gone.
    #[must_use]
    #[inline(always)]
    pub fn is_lost(&self) -> bool {
        // Set by the handler of `fault`; nothing else is read on the strength of it.
        self.lost.load(Ordering::Relaxed)
    }

    /// The word at `offset`, for one access, or for the kernel's use of it as a futex.
    ///
    /// Words hold little-endian values. A window that is mapped read-only returns words that must not be stored
    /// to: the caller has asked `check_store`.
    #[inline(always)]
    pub(super) fn word(&self, offset: u32) -> Result<&AtomicU32, AccessError> {
        if let Err(kind) = check_words(self.size, offset, 1) {
            return Err(self.refused(kind, offset, 4));
        }
        // SAFETY: the word is inside the mapping and aligned, as `check_words` found and as pages
        // are; `_mapping` keeps it mapped as long as `self`. All accesses of this process go through
        // such words; peers and the handler of `fault` may change them at any time, as atomics
        // may be changed. An atomic load with at most Acquire order of a word of four bytes is
        // sound in read-only memory.
        Ok(unsafe {
            self.base
                .byte_add(offset as usize)
                .cast::<AtomicU32>()
                .as_ref()
        })
    }

    /// So many words from `offset` on; as [`word`](Self::word).
    fn run(&self, offset: u32, count: usize) -> Result<&[AtomicU32], AccessError> {
        self.check(offset, 4 * count)?;
        // SAFETY: inside the mapping and aligned, as `check` found; else as in `word`.
        Ok(unsafe {
            let first = self.base.byte_add(offset as usize).cast::<AtomicU32>();
            core::slice::from_raw_parts(first.as_ptr(), count)
        })
    }

    #[cold]
    fn refused(&self, kind: WindowErrorKind, offset: u32, len: usize) -> AccessError {
        AccessError::new(offset, len, self.size, kind)
    }

    /// The address of the byte at `offset`, which is inside the window.
    pub(super) fn address(&self, offset: u32) -> *mut u8 {
        self.base.as_ptr().wrapping_byte_add(offset as usize)
    }

    #[inline(always)]
    pub(super) fn check_store(&self, offset: u32, len: usize) -> Result<(), AccessError> {
        match self.access {
            WindowAccess::ReadWrite => Ok(()),
            WindowAccess::ReadOnly => Err(self.refused(WindowErrorKind::ReadOnly, offset, len)),
        }
    }

    /// To be called after an access of Acquire or `SeqCst` order, or after such a fence: then the
    /// flag is read after the memory, also by a thread that did not run the handler itself.
    #[inline(always)]
    fn check_lost(&self, offset: u32, len: usize) -> Result<(), AccessError> {
        core::sync::atomic::compiler_fence(Ordering::SeqCst);
        if self.is_lost() {
            return Err(self.refused(WindowErrorKind::Lost, offset, len));
        }
        Ok(())
    }
}

impl MemoryWindow for LinuxWindow {
    type Error = AccessError;

    #[inline]
    fn size(&self) -> u32 {
        self.size
    }

    #[inline(always)]
    fn load(&self, offset: u32, _order: LoadOrder) -> Result<u32, AccessError> {
        // Acquire, also where Relaxed was asked for: `check_lost` must come after it. What else
        // it pairs with is the caller's matter.
        let value = self.word(offset)?.load(Ordering::Acquire);
        self.check_lost(offset, 4)?;
        Ok(u32::from_le(value))
    }

    #[inline(always)]
    fn store(&self, offset: u32, value: u32, order: StoreOrder) -> Result<(), AccessError> {
        let word = self.word(offset)?;
        self.check_store(offset, 4)?;
        // The order is the caller's; a store that another thread's fault swallowed may be
        // reported by the next access only.
        word.store(value.to_le(), order.into());
        self.check_lost(offset, 4)
    }

    /// If memory has gone, zeros are mapped there.
    #[inline(always)]
    fn words(&self) -> Option<WindowWords<'_>> {
        // SAFETY: the words are inside the mapping and aligned, as pages are; else as in `word`. They
        // are all of the window, which never changes.
        cfg!(target_endian = "little").then(|| unsafe {
            let first = self.base.cast::<AtomicU32>().as_ptr();
            WindowWords::new(core::slice::from_raw_parts(first, (self.size / 4) as usize))
        })
    }

    #[inline]
    fn check(&self, offset: u32, len: usize) -> Result<(), AccessError> {
        check_access(self.size, offset, len).map_err(|kind| self.refused(kind, offset, len))
    }

    fn read(&self, offset: u32, into: &mut [u8]) -> Result<(), AccessError> {
        let len = into.len();
        self.check(offset, len)?;
        if len == 0 {
            return Ok(());
        }
        let (whole, rest) = into.split_at_mut(len / 4 * 4);
        copy::read(self.run(offset, whole.len() / 4)?, whole);
        if !rest.is_empty() {
            let last = self.word(offset.wrapping_add(whole.len() as u32))?;
            let value = u32::from_le(last.load(Ordering::Relaxed)).to_le_bytes();
            rest.copy_from_slice(&value[..rest.len()]);
        }
        // Orders the loads above before the flag.
        fence(Ordering::Acquire);
        self.check_lost(offset, len)
    }

    fn write_words(
        &self,
        offset: u32,
        len: usize,
        from: &[&[AtomicU32]],
    ) -> Result<(), AccessError> {
        self.check(offset, len)?;
        if len == 0 {
            return Ok(());
        }
        self.check_store(offset, len)?;
        copy::gather(self.run(offset, len / 4)?, from);
        self.check_lost(offset, len)
    }

    fn write(&self, offset: u32, from: &[u8]) -> Result<(), AccessError> {
        let len = from.len();
        self.check(offset, len)?;
        if len == 0 {
            return Ok(());
        }
        self.check_store(offset, len)?;
        let (whole, rest) = from.split_at(len / 4 * 4);
        copy::write(self.run(offset, whole.len() / 4)?, whole);
        if !rest.is_empty() {
            let last = self.word(offset.wrapping_add(whole.len() as u32))?;
            let mut value = u32::from_le(last.load(Ordering::Relaxed)).to_le_bytes();
            value[..rest.len()].copy_from_slice(rest);
            last.store(u32::from_le_bytes(value).to_le(), Ordering::Relaxed);
        }
        self.check_lost(offset, len)
    }
}

impl CompareExchange for LinuxWindow {
    #[inline]
    fn compare_exchange(&self, offset: u32, current: u32, new: u32) -> Result<u32, AccessError> {
        let word = self.word(offset)?;
        self.check_store(offset, 4)?;
        // AcqRel pairs with itself: who finds a word that was exchanged sees what came before.
        let (Ok(found) | Err(found)) = word.compare_exchange(
            current.to_le(),
            new.to_le(),
            Ordering::AcqRel,
            Ordering::Acquire,
        );
        self.check_lost(offset, 4)?;
        Ok(u32::from_le(found))
    }
}

/// Offset for `mmap` and size in bytes of a memory, from its directory in sysfs.
fn uio_range(described: &std::path::Path, map: u32) -> Result<(u64, u32), WindowMapError> {
    let number = |name: &str| -> Result<u64, WindowMapError> {
        let fail = |source| WindowMapError::System {
            doing: "read the description of the UIO device",
            source,
        };
        let text = std::fs::read_to_string(described.join(name)).map_err(fail)?;
        let digits = text.trim().trim_start_matches("0x");
        u64::from_str_radix(digits, 16)
            .map_err(|bad| fail(std::io::Error::new(std::io::ErrorKind::InvalidData, bad)))
    };
    let (size, within) = (number("size")?, number("offset")?);
    let page = rustix::param::page_size() as u64;
    let offset = u64::from(map) * page + within % page;
    match u32::try_from(size) {
        Ok(len) => Ok((offset, len)),
        Err(_) => Err(WindowMapError::TooLarge { offset, len: size }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_description_of_a_uio_device_gives_the_range() {
        let page = rustix::param::page_size() as u64;
        let directory = tempfile::tempdir().expect("a temporary directory");
        let describe = |size: &str, offset: &str| {
            std::fs::write(directory.path().join("size"), size).expect("it is written");
            std::fs::write(directory.path().join("offset"), offset).expect("it is written");
            uio_range(directory.path(), 2)
        };
        let range = describe("0x0000000000001000\n", "0x10\n").expect("it is well-formed");
        assert_eq!(range, (2 * page + 0x10, 0x1000));
        let error = describe("0x100000000\n", "0x0\n").expect_err("it has more than 32 bits");
        assert!(
            matches!(
                error,
                WindowMapError::TooLarge {
                    len: 0x1_0000_0000,
                    ..
                }
            ),
            "{error}"
        );
        let error = describe("none\n", "0x0\n").expect_err("it is no number");
        assert!(matches!(error, WindowMapError::System { .. }), "{error}");
    }
}
