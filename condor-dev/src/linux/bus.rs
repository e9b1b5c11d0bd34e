//! [`LinuxBus`]: registers behind a mapping.

use core::ffi::c_void;
use core::num::NonZeroUsize;
use core::ptr;
use std::fs::File;
use std::io;
use std::os::fd::AsFd;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;
use std::sync::Arc;

use condor_platform::linux::{MemoryFault, on_bus_error};
use rustix::fs::{FileType, OFlags};
use rustix::mm::{MapFlags, ProtFlags};

use crate::bus::{Bus, BusAccessError, BusErrorKind, Width};
use crate::guarded::{load, resume, store};
use crate::mmio::Mmio;

/// The accesses that a [`LinuxBus`] allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MapAccess {
    /// Reads only; the file need only be open for reading.
    ReadOnly,
    /// Reads and writes; the file must be open for both.
    ReadWrite,
}

/// The reason why a [`LinuxBus`] could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BusMapError {
    /// The bus address or the offset in the file is not a multiple of four, or the length is zero.
    #[error(
        "cannot map {len:#x} bytes at offset {offset:#x} to bus address {base:#x}: the length must not be 0, \
         and the offset and the bus address must be multiples of 4"
    )]
    Misaligned {
        /// The beginning of the range in the file, in bytes.
        offset: u64,
        /// The first bus address of the range.
        base: usize,
        /// The length of the range, in bytes.
        len: usize,
    },
    /// The range exceeds the addresses of this machine.
    #[error("{len:#x} bytes at offset {offset:#x} exceed the addresses of this machine")]
    TooLarge {
        /// The beginning of the range in the file, in bytes.
        offset: u64,
        /// The length of the range, in bytes.
        len: usize,
    },
    /// The file ends before the range does.
    #[error("the file of the registers has {found:#x} bytes, but needs {needed:#x}")]
    TooShort {
        /// The end of the range, in bytes from the beginning of the file.
        needed: u64,
        /// The size of the file, in bytes.
        found: u64,
    },
    /// A call to the operating system failed.
    #[error("cannot {doing}: {source}")]
    System {
        /// The operation.
        doing: &'static str,
        /// The error of the operating system.
        source: io::Error,
    },
}

fn system<E: Into<io::Error>>(doing: &'static str) -> impl FnOnce(E) -> BusMapError {
    move |source| BusMapError::System {
        doing,
        source: source.into(),
    }
}

/// A [`Bus`] of Linux: registers or memory of a device or a file, mapped into this process.
///
/// Clones share one mapping, which is unmapped when the last clone is dropped. Each access is one
/// load or store of its width. If nothing answers, the error is [`Lost`](BusErrorKind::Lost) for
/// files and devices, because they existed when they were mapped, and
/// [`NoAnswer`](BusErrorKind::NoAnswer) for physical addresses. Bytes that were truncated *within*
/// the last page of a file read as zeros, as the kernel provides them.
///
/// ```
/// use condor_dev::Bus;
/// use condor_dev::linux::{MapAccess, LinuxBus};
///
/// let file = tempfile::tempfile()?;
/// file.set_len(0x1000)?;
/// let bus = LinuxBus::map(&file, 0, 0xee00_0000, 0x1000, MapAccess::ReadWrite)?;
/// bus.write16(0xee00_0020, 0xadc0)?;
/// assert_eq!(bus.read16(0xee00_0020)?, 0xadc0);
///
/// file.set_len(0)?;
/// assert!(bus.read16(0xee00_0020).is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct LinuxBus {
    registers: Mmio,
    access: MapAccess,
    /// The kind of error that a bus error means.
    silence: BusErrorKind,
    /// Keeps `registers` mapped.
    _mapping: Arc<Mapping>,
}

/// Whole pages that are mapped until this is dropped.
#[derive(Debug)]
struct Mapping {
    pages: NonZeroUsize,
    len: usize,
}

impl Drop for Mapping {
    fn drop(&mut self) {
        let pages = ptr::with_exposed_provenance_mut::<c_void>(self.pages.get());
        // SAFETY: `LinuxBus::map_pages` mapped exactly these pages, and the last bus that could
        // reach them is being dropped.
        let _ = unsafe { rustix::mm::munmap(pages, self.len) };
    }
}

impl LinuxBus {
    /// Maps `len` bytes of `file`, from byte `offset` on, to the bus addresses from `base` on.
    ///
    /// `file` may be anything that can be mapped: a file or a memfd, also one that other processes
    /// map, or a device. For `/dev/mem` the contract of [`physical`](Self::physical) holds.
    /// `offset` need not be the beginning of a page.
    ///
    /// # Errors
    /// [`BusMapError::Misaligned`] if `offset` or `base` is not a multiple of four, or `len` is 0,
    /// [`BusMapError::TooLarge`] if the range is too large, [`BusMapError::TooShort`] if a regular
    /// file ends before the range does, [`BusMapError::System`] if the operating system refuses.
    pub fn map(
        file: impl AsFd,
        offset: u64,
        base: usize,
        len: usize,
        access: MapAccess,
    ) -> Result<Self, BusMapError> {
        Self::map_pages(file, offset, base, len, access, BusErrorKind::Lost)
    }

    /// Maps `len` bytes of physical addresses from `base` on, through `/dev/mem`. Bus addresses are
    /// equal to physical ones.
    ///
    /// # Safety
    /// As long as the bus or a copy of it is used, the range must not be memory of this process or
    /// of the kernel, and no write in it may make a device change such memory (by DMA, for
    /// example).
    ///
    /// # Errors
    /// [`BusMapError::Misaligned`] if `base` is not a multiple of four or `len` is 0;
    /// [`BusMapError::TooLarge`] if the range exceeds the addresses of this machine;
    /// [`BusMapError::System`] if the operating system refuses. Usually only root may do this, and
    /// the kernel may refuse memory of its own.
    pub unsafe fn physical(
        base: usize,
        len: usize,
        access: MapAccess,
    ) -> Result<Self, BusMapError> {
        // Without O_SYNC, some processors would cache the registers.
        let opened = File::options()
            .read(true)
            .write(access == MapAccess::ReadWrite)
            .custom_flags(OFlags::SYNC.bits().cast_signed())
            .open("/dev/mem");
        let file = opened.map_err(system("open /dev/mem"))?;
        Self::map_pages(file, base as u64, base, len, access, BusErrorKind::NoAnswer)
    }

    /// Maps memory number `map` of the device `/dev/uio{device}`. Bus addresses are equal to the
    /// memory's physical addresses.
    ///
    /// The address and size of the memory, and its offset in its first page, are read from
    /// `/sys/class/uio/uio{device}/maps/map{map}`.
    ///
    /// # Errors
    /// [`BusMapError::System`] if the device or the memory does not exist or may not be opened;
    /// [`BusMapError::Misaligned`] or [`BusMapError::TooLarge`] if the address or size of the
    /// memory is unsuitable.
    pub fn uio(device: u32, map: u32, access: MapAccess) -> Result<Self, BusMapError> {
        let described = format!("/sys/class/uio/uio{device}/maps/map{map}");
        let UioMemory { offset, base, len } = UioMemory::read(Path::new(&described), map)?;
        let opened = File::options()
            .read(true)
            .write(access == MapAccess::ReadWrite)
            .open(format!("/dev/uio{device}"));
        let file = opened.map_err(system("open the UIO device"))?;
        Self::map(file, offset, base, len, access)
    }

    fn map_pages(
        file: impl AsFd,
        offset: u64,
        base: usize,
        len: usize,
        access: MapAccess,
        silence: BusErrorKind,
    ) -> Result<Self, BusMapError> {
        if len == 0 || !offset.is_multiple_of(4) || !base.is_multiple_of(4) {
            return Err(BusMapError::Misaligned { offset, base, len });
        }
        let too_large = || BusMapError::TooLarge { offset, len };
        let page = rustix::param::page_size() as u64;
        let skip = offset % page;
        let end = offset
            .checked_add(len as u64)
            .filter(|&end| i64::try_from(end).is_ok() && base.checked_add(len - 1).is_some())
            .ok_or_else(too_large)?;
        let bytes =
            usize::try_from((skip + len as u64).div_ceil(page) * page).map_err(|_| too_large())?;
        let stat = rustix::fs::fstat(&file).map_err(system("examine the file"))?;
        let found = u64::try_from(stat.st_size).unwrap_or(0);
        if FileType::from_raw_mode(stat.st_mode) == FileType::RegularFile && found < end {
            return Err(BusMapError::TooShort { needed: end, found });
        }
        on_bus_error(go_on).map_err(system("handle SIGBUS"))?;
        let protection = match access {
            MapAccess::ReadOnly => ProtFlags::READ,
            MapAccess::ReadWrite => ProtFlags::READ | ProtFlags::WRITE,
        };
        let (anywhere, first) = (ptr::null_mut(), offset - skip);
        // SAFETY: without FIXED the kernel chooses addresses that nothing else uses, and no reference
        // to them is ever made.
        let pages = unsafe {
            rustix::mm::mmap(anywhere, bytes, protection, MapFlags::SHARED, &file, first)
        }
        .map_err(system("map the file"))?;
        let address = NonZeroUsize::new(pages.expose_provenance()).ok_or_else(too_large)?;
        let mapping = Mapping {
            pages: address,
            len: bytes,
        };
        let memory = pages.cast::<u8>().wrapping_add(skip as usize);
        // SAFETY: the `len` bytes lie in the mapping, which `_mapping` keeps, and are aligned as
        // `offset` and `base` are. They are no memory of Rust's; what a device does on a write, who may
        // open it answers for. All accesses are guarded.
        let registers = unsafe { Mmio::translated(memory, base, len) };
        Ok(Self {
            registers,
            access,
            silence,
            _mapping: Arc::new(mapping),
        })
    }

    #[cold]
    fn silent(&self, address: usize) -> BusAccessError {
        BusAccessError {
            address,
            kind: self.silence,
        }
    }
}

impl Bus for LinuxBus {
    type Error = BusAccessError;

    #[inline]
    fn read(&self, address: usize, width: Width) -> Result<u32, BusAccessError> {
        let register = self.registers.register(address, width)?;
        // SAFETY: it is aligned and in the mapping, which may be read; `go_on` is
        // installed.
        unsafe { load(register, width) }.ok_or_else(|| self.silent(address))
    }

    #[inline]
    fn write(&self, address: usize, width: Width, value: u32) -> Result<(), BusAccessError> {
        let register = self.registers.register(address, width)?;
        if self.access == MapAccess::ReadOnly {
            let kind = BusErrorKind::ReadOnly;
            return Err(BusAccessError { address, kind });
        }
        // SAFETY: it is aligned and in the mapping, which may be written; `go_on` is
        // installed.
        unsafe { store(register, width, value) }.ok_or_else(|| self.silent(address))
    }
}

/// Lets a bus error of a [guarded](crate::guarded) access be an error of that access: it touches nothing
/// but the interrupted context, and is async-signal-safe.
fn go_on(error: &mut MemoryFault<'_>) -> bool {
    // SAFETY: where `resume` says, the function of the access returns with an error.
    resume(error.instruction()).is_some_and(|end| unsafe { error.resume_at(end) })
}

/// A memory of a UIO device.
#[derive(Debug, PartialEq, Eq)]
struct UioMemory {
    /// For `mmap`: the number of the memory in pages, and where it begins within one.
    offset: u64,
    base: usize,
    len: usize,
}

impl UioMemory {
    /// Reads its directory in sysfs.
    fn read(described: &Path, map: u32) -> Result<Self, BusMapError> {
        let number = |name: &str| -> Result<u64, BusMapError> {
            let fail = system("read the description of the UIO device");
            let text = match std::fs::read_to_string(described.join(name)) {
                Ok(text) => text,
                Err(error) => return Err(fail(error)),
            };
            u64::from_str_radix(text.trim().trim_start_matches("0x"), 16)
                .map_err(|bad| fail(io::Error::new(io::ErrorKind::InvalidData, bad)))
        };
        let (address, size, within) = (number("addr")?, number("size")?, number("offset")?);
        let page = rustix::param::page_size() as u64;
        let offset = u64::from(map) * page + within % page;
        // The address that `addr` names is the page-aligned beginning in newer kernels, the memory itself in
        // older ones; the offset within a page is the same either way.
        let base = address - address % page + within % page;
        match (usize::try_from(base), usize::try_from(size)) {
            (Ok(base), Ok(len)) => Ok(Self { offset, base, len }),
            _ => Err(BusMapError::TooLarge {
                offset,
                len: usize::MAX,
            }),
        }
    }
}

#[cfg(test)]
#[path = "../../tests/inside/uio.rs"]
mod tests;
