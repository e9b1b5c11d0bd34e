//! Files by the descriptors of `condor-dev`: feature `dev`.
//!
//! A [`FileSwitch`] is a device switch that also has the host's files. Names that begin with `fs/`
//! are files; all others are boards. A descriptor of either is read, written and closed in the same
//! way. The switch implements [`Descriptors`], so a [`DeviceStream`](condor_dev::stream::DeviceStream) of a file and
//! all of [`condor_dev::stdio`], including standard input and output, work with it.

use core::fmt::Debug;
use core::mem::ManuallyDrop;

use condor_dev::stdio::ClaimCell;
use condor_dev::stream::Descriptors;
use condor_dev::{
    Bus, BusError, BusErrorKind, DeviceSet, Fd, FdError, InterruptController, IoError, OpenMode,
    Switch,
};
use condor_mbox::{MemoryWindow, Messenger};

use super::{File, FileError, FileSystem, OpenOptions};
use crate::errno::Errno;
use crate::wire::open as flag;

/// The prefix of the names of files, behind the colon that any name may have.
const PREFIX: &str = "fs/";

/// A device switch that also has the files of the host: boards and files are opened by name, and
/// used by descriptors, in the same way.
///
/// `F` is the number of descriptors for boards, and `FILES` the number of descriptors for files.
/// Boards have the descriptors from 0 on, files those from `F` on.
///
/// A call never waits for another context to finish its use of a file: if it has interrupted such a
/// use, it returns [`IoError::WouldBlock`] and does nothing. But a call for a file waits for the
/// host, as long as the [`FileSystem`] permits. So servo loops do not print to files; they use
/// [`post!`](condor_dev::post!) instead.
pub struct FileSwitch<
    'd,
    'm,
    B,
    C,
    D,
    S: Messenger + ?Sized,
    W: MemoryWindow,
    const F: usize,
    const FILES: usize,
> {
    devices: &'d Switch<B, C, D, F>,
    files: ClaimCell<Files<'m, S, W, FILES>>,
}

struct Files<'m, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> {
    system: FileSystem<'m, S, W, FILES>,
    /// The generation and mode of the descriptor of each block: a block and its descriptor have the same
    /// index.
    places: [Location; FILES],
}

#[derive(Clone, Copy)]
struct Location {
    generation: u16,
    /// `None` if no descriptor is open.
    mode: Option<OpenMode>,
}

/// The reason why [`FileSwitch::open`] did not open a board or file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FileOpenError<'n> {
    /// The device switch refused to open the board, or a file cannot be opened with this board
    /// number or mode.
    #[error("{0}")]
    Device(condor_dev::OpenError<'n>),
    /// The file could not be opened.
    #[error("{name}: {error}")]
    File {
        /// The requested name.
        name: &'n str,
        /// The error of the [`FileSystem`], with its number if it has one.
        error: FileError,
    },
}

impl<'n> From<condor_dev::OpenError<'n>> for FileOpenError<'n> {
    fn from(error: condor_dev::OpenError<'n>) -> Self {
        Self::Device(error)
    }
}

/// The error of a call with a descriptor of a [`FileSwitch`], which belongs to a board or a file.
/// It implements [`BusError`], as the errors of buses in `condor-dev` do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum TransferError<E: Debug> {
    /// The bus of a board returned this error.
    #[error("{0}")]
    Device(E),
    /// The [`FileSystem`] returned this error, with its number if it has one.
    #[error(transparent)]
    File(#[from] FileError),
}

impl<E: BusError> BusError for TransferError<E> {
    /// Of a file, what is next to its error number.
    fn kind(&self) -> BusErrorKind {
        match self {
            Self::Device(error) => error.kind(),
            Self::File(FileError::Errno(Errno::ACCES | Errno::PERM | Errno::ROFS)) => {
                BusErrorKind::ReadOnly
            }
            Self::File(FileError::Errno(Errno::FBIG | Errno::INVAL | Errno::OVERFLOW)) => {
                BusErrorKind::OutOfRange
            }
            Self::File(FileError::TimedOut { .. } | FileError::Mailbox(_)) => {
                BusErrorKind::NoAnswer
            }
            Self::File(_) => BusErrorKind::Lost,
        }
    }
}

impl<'d, 'm, B, C, D, S, W, const F: usize, const FILES: usize>
    FileSwitch<'d, 'm, B, C, D, S, W, F, FILES>
where
    B: Bus,
    C: InterruptController,
    D: DeviceSet,
    S: Messenger + ?Sized,
    W: MemoryWindow,
{
    /// Combines the boards of `devices` and the files of `system` into one switch.
    #[must_use]
    pub const fn new(devices: &'d Switch<B, C, D, F>, system: FileSystem<'m, S, W, FILES>) -> Self {
        const {
            assert!(
                F + FILES <= u16::MAX as usize,
                "a descriptor has 16 bits for its number"
            );
        };
        let free = Location {
            generation: 0,
            mode: None,
        };
        Self {
            devices,
            files: ClaimCell::new(Files {
                system,
                places: [free; FILES],
            }),
        }
    }

    /// Opens a file if `name` is `fs/` and a path; otherwise opens a board as [`Switch::open`]
    /// does. `name` may begin with a colon.
    ///
    /// For a file, `board` must be 0. With [`OpenMode::READ`] alone, the file must exist. With
    /// [`OpenMode::WRITE`] it is made if it does not exist, and text is appended, so that nothing
    /// that was written before is lost; [`open_file`](Self::open_file) has all other ways of
    /// opening. A file cannot be opened with [`OpenMode::EXCLUSIVE`], since the host's own programs
    /// can access it, too.
    ///
    /// # Errors
    /// [`FileOpenError::Device`] if the device switch refuses, or if a file cannot be opened with
    /// this `board` or `mode`; [`FileOpenError::File`] if the file cannot be opened.
    pub fn open<'n>(
        &self,
        name: &'n str,
        board: u8,
        mode: OpenMode,
    ) -> Result<Fd, FileOpenError<'n>> {
        let plain = name.strip_prefix(':').unwrap_or(name);
        let Some(path) = plain.strip_prefix(PREFIX) else {
            return Ok(self.devices.open(name, board, mode)?);
        };
        if board != 0 {
            let boards = 1;
            let none = condor_dev::OpenError::NoSuchBoard {
                name,
                board,
                boards,
            };
            return Err(none.into());
        }
        let mut options = OpenOptions::new();
        if mode.contains(OpenMode::READ) {
            options = options.read();
        }
        if mode.contains(OpenMode::WRITE) {
            options = options.append().create();
        }
        if mode.contains(OpenMode::EXCLUSIVE) || options == OpenOptions::new() {
            return Err(condor_dev::OpenError::Direction { name, mode }.into());
        }
        self.open_file(path, options)
            .map_err(|error| FileOpenError::File { name, error })
    }

    /// Opens the file at `path` as [`FileSystem::open`] does, and returns its descriptor. `path`
    /// does not begin with `fs/`.
    ///
    /// # Errors
    /// The [`FileError`] of [`FileSystem::open`]; [`Errno::BUSY`] if this context interrupts another
    /// use of a file.
    pub fn open_file(&self, path: impl AsRef<[u8]>, options: OpenOptions) -> Result<Fd, FileError> {
        let mut files = self.files.claim().ok_or(Errno::BUSY)?;
        let index = files.system.open_block(path.as_ref(), options)?;
        let place = files.places.get_mut(index).ok_or(Errno::BADF)?;
        let mut mode = OpenMode::empty();
        mode.set(OpenMode::READ, options.flags & flag::READ != 0);
        mode.set(OpenMode::WRITE, options.flags & flag::WRITE != 0);
        place.mode = Some(mode);
        Ok(Fd::new(F.wrapping_add(index) as u16, place.generation))
    }

    /// Calls `calls` with the open file that `fd` stands for, and returns its result. Use it for
    /// the methods that only files have: seek, status, truncate, sync, and reads and writes without
    /// a copy.
    ///
    /// # Errors
    /// [`IoError::Fd`] if `fd` does not stand for an open file; [`IoError::WouldBlock`] if this
    /// context interrupts another use of a file; [`IoError::Bus`] with the error of `calls` if that
    /// fails.
    pub fn with_file<R>(
        &self,
        fd: Fd,
        calls: impl FnOnce(&mut File<'_, 'm, S, W, FILES>) -> Result<R, FileError>,
    ) -> Result<R, IoError<TransferError<B::Error>>> {
        self.with(fd, OpenMode::empty(), calls)
    }

    /// Calls `calls` with the [`FileSystem`], and returns its result. Use it for operations on
    /// names and directories, and for files without a descriptor. Returns `None` without calling
    /// `calls` if this context interrupts another use of a file.
    pub fn with_system<R>(
        &self,
        calls: impl FnOnce(&FileSystem<'m, S, W, FILES>) -> R,
    ) -> Option<R> {
        let files = self.files.claim()?;
        Some(calls(&files.system))
    }

    /// Closes the board or file that `fd` stands for.
    ///
    /// # Errors
    /// [`IoError::Fd`] if `fd` is not an open descriptor; [`IoError::WouldBlock`] if `fd` stands
    /// for a file and this context interrupts another use of a file; [`IoError::Bus`] if the board
    /// or the `FileSystem` fails, though the descriptor is closed all the same.
    pub fn close(&self, fd: Fd) -> Result<(), IoError<TransferError<B::Error>>> {
        if Self::is_device(fd) {
            return self.devices.close(fd).map_err(of_device);
        }
        let mut files = self.files.claim().ok_or(IoError::WouldBlock)?;
        let index = files.index(fd, F, OpenMode::empty())?;
        if let Some(place) = files.places.get_mut(index) {
            place.mode = None;
            place.generation = place.generation.wrapping_add(1);
        }
        files.system.close_block(index).map_err(of_file)
    }

    fn with<R>(
        &self,
        fd: Fd,
        wanted: OpenMode,
        calls: impl FnOnce(&mut File<'_, 'm, S, W, FILES>) -> Result<R, FileError>,
    ) -> Result<R, IoError<TransferError<B::Error>>> {
        let files = self.files.claim().ok_or(IoError::WouldBlock)?;
        let index = files.index(fd, F, wanted)?;
        // Its end is the descriptor's.
        let mut file = ManuallyDrop::new(File::at(&files.system, index));
        calls(&mut file).map_err(of_file)
    }

    fn is_device(fd: Fd) -> bool {
        usize::from(fd.number()) < F
    }

    /// A file is ready if its descriptor is good: its call then waits, and returns something.
    fn ready(&self, fd: Fd, wanted: OpenMode) -> Result<bool, IoError<TransferError<B::Error>>> {
        match self.with(fd, wanted, |_| Ok(true)) {
            Err(IoError::WouldBlock) => Ok(false),
            outcome => outcome,
        }
    }
}

impl<S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> Files<'_, S, W, FILES> {
    /// The index of an open descriptor; `first` is the number of the first one.
    fn index(&self, fd: Fd, first: usize, wanted: OpenMode) -> Result<usize, FdError> {
        let index = usize::from(fd.number()).wrapping_sub(first);
        let place = self.places.get(index);
        let place = place.filter(|place| place.generation == fd.generation());
        match place.and_then(|place| place.mode) {
            None => Err(FdError::Closed { fd }),
            Some(opened) if opened.contains(wanted) => Ok(index),
            Some(opened) => Err(FdError::Direction { fd, wanted, opened }),
        }
    }
}

impl<B, C, D, S, W, const F: usize, const FILES: usize> Descriptors
    for FileSwitch<'_, '_, B, C, D, S, W, F, FILES>
where
    B: Bus,
    C: InterruptController,
    D: DeviceSet,
    S: Messenger + ?Sized,
    W: MemoryWindow,
{
    type Error = TransferError<B::Error>;

    /// At the end of a file, [`IoError::End`].
    fn read(&self, fd: Fd, into: &mut [u8]) -> Result<usize, IoError<Self::Error>> {
        if Self::is_device(fd) {
            return self.devices.read(fd, into).map_err(of_device);
        }
        let empty = into.is_empty();
        match self.with(fd, OpenMode::READ, |file| file.read(into)) {
            Ok(0) if !empty => Err(IoError::End),
            outcome => outcome,
        }
    }

    fn write(&self, fd: Fd, from: &[u8]) -> Result<usize, IoError<Self::Error>> {
        if Self::is_device(fd) {
            return self.devices.write(fd, from).map_err(of_device);
        }
        self.with(fd, OpenMode::WRITE, |file| file.write(from))
    }

    fn read_ready(&self, fd: Fd) -> Result<bool, IoError<Self::Error>> {
        if Self::is_device(fd) {
            return self.devices.read_ready(fd).map_err(of_device);
        }
        self.ready(fd, OpenMode::READ)
    }

    fn write_ready(&self, fd: Fd) -> Result<bool, IoError<Self::Error>> {
        if Self::is_device(fd) {
            return self.devices.write_ready(fd).map_err(of_device);
        }
        self.ready(fd, OpenMode::WRITE)
    }

    /// Bytes that were written to a file are with the host; they are on its disk after a sync.
    fn is_flushed(&self, fd: Fd) -> Result<bool, IoError<Self::Error>> {
        if Self::is_device(fd) {
            return self.devices.is_flushed(fd).map_err(of_device);
        }
        self.ready(fd, OpenMode::WRITE)
    }
}

fn of_file<E: Debug>(error: FileError) -> IoError<TransferError<E>> {
    IoError::Bus(TransferError::File(error))
}

fn of_device<E: Debug>(error: IoError<E>) -> IoError<TransferError<E>> {
    match error {
        IoError::Fd(error) => IoError::Fd(error),
        IoError::WouldBlock => IoError::WouldBlock,
        IoError::End => IoError::End,
        IoError::Length { bytes, unit } => IoError::Length { bytes, unit },
        IoError::Device(bits) => IoError::Device(bits),
        IoError::Bus(error) => IoError::Bus(TransferError::Device(error)),
    }
}
