//! The processor's side: the client.

mod area;
mod buffer;
mod buffered;
#[cfg(feature = "dev")]
pub mod dev;
mod directory;
mod error;
mod file;
mod names;
mod operation;
mod whole;

pub use area::Area;
pub use buffer::{Buffer, Kept, Lent};
pub use buffered::{FileReader, FileWriter, Unwritten};
pub use directory::{Directory, Entry};
pub use error::Error;
pub use file::{File, OpenOptions};

use core::cell::Cell;
use core::time::Duration;

use condor_mbox::{MemoryWindow, Messenger, Pending, Processor, Region};

use crate::errno::Errno;
use crate::wire::{self, Operation, Request, block, slot, state, table};
use operation::After;

/// The host's files, for the background of one processor.
///
/// `S` is the processor's mailbox, `W` its own window, and `FILES` the greatest number of files and
/// directories that can be open at a time. The whole state of open files is here and in the window:
/// the server may be killed and restarted at any moment, and a call in progress then only takes
/// longer.
///
/// One operation is in progress at a time. If a handler begins one while its background waits in
/// another, it gets [`Errno::BUSY`].
///
/// A processor has one file system at a time: [`connect`](Self::connect) ends all former ones.
pub struct FileSystem<'m, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> {
    station: &'m S,
    server: Processor,
    own: Region<W>,
    area: Area<FILES>,
    timeout: Cell<Duration>,
    session: Cell<u64>,
    sequence: Cell<u64>,
    /// What is to follow the end of the operation in the slot, if that has not been seen.
    doubt: Cell<Option<After>>,
    /// The message about it, if its receiver has not died.
    pending: Cell<Option<Pending>>,
    /// The last request, unless it has failed, and the value of its answer.
    former: Cell<Option<Request>>,
    former_value: Cell<u64>,
    /// What is added to the slot's offset in the first message about the operation in the slot.
    bits: Cell<u32>,
    busy: Cell<bool>,
    files: [Cell<Open>; FILES],
    /// The buffer of an operation that was in doubt.
    kept: Cell<Option<Buffer<W>>>,
}

/// What is known of a block.
#[derive(Clone, Copy, Default)]
struct Open {
    state: SessionState,
    handle: u64,
    flags: u32,
    position: u64,
    path_len: u32,
}

#[derive(Clone, Copy, Default, PartialEq, Eq)]
enum SessionState {
    #[default]
    Free,
    /// Somebody has it.
    Held,
    /// Nobody has it, and the server does not know.
    Left,
}

impl<'m, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> FileSystem<'m, S, W, FILES> {
    /// Begins a session with the processor `server`. `own` is the users' region of this processor's
    /// own `data`, in which `area` lies. The mailbox `station` must have joined, with the area's
    /// [handler](Area::handler) for the vector [`OPEN_FILES`](wire::OPEN_FILES).
    ///
    /// `timeout` is the longest time of an operation, including restarts of the server.
    ///
    /// # Errors
    /// [`Error::TimedOut`] if the server does not answer in time; [`Error::Mailbox`] if the mailbox
    /// cannot send; [`Error::Access`] if the area is not in `own`.
    pub fn connect(
        station: &'m S,
        server: Processor,
        own: Region<W>,
        area: Area<FILES>,
        timeout: Duration,
    ) -> Result<Self, Error> {
        // A former client's first operation had the session and sequence of this one's.
        own.set_word(area.slot(), 0)?;
        own.set_word(area.slot().wrapping_add(slot::STATE), state::NONE)?;
        own.set_word(area.table(), table::MAGIC)?;
        own.set_word(area.table().wrapping_add(4), FILES as u32)?;
        own.set_word(area.table().wrapping_add(8), area.blocks())?;
        own.set_word(area.table().wrapping_add(12), block::BYTES)?;
        for file in 0..FILES {
            own.write(area.block(file), &[0; block::BYTES as usize])?;
        }
        let system = Self {
            station,
            server,
            own,
            area,
            timeout: Cell::new(timeout),
            session: Cell::new(wire::NO_SESSION),
            sequence: Cell::new(0),
            doubt: Cell::new(None),
            pending: Cell::new(None),
            former: Cell::new(None),
            former_value: Cell::new(0),
            bits: Cell::new(0),
            busy: Cell::new(false),
            files: [const { Cell::new(Open::NONE) }; FILES],
            kept: Cell::new(None),
        };
        let session = system.perform(&request(Operation::Session), After::Nothing)?;
        system.session.set(session.value);
        Ok(system)
    }

    /// Sets the longest time of an operation from now on.
    pub fn set_timeout(&self, timeout: Duration) {
        self.timeout.set(timeout);
    }

    /// Waits for at most `timeout` for the end of the operation that is in doubt, which is that of
    /// the last call that ended with [`Error::TimedOut`]. Returns its result as a number: the
    /// result that the call would have returned, or the number of bytes of entries for a directory.
    ///
    /// Returns `None` if nothing is in doubt, or if the operation was only a part of a call:
    /// [`open`](Self::open) also closes files that were dropped, [`File::seek`] from the end asks
    /// for the size, and readers and writers fetch and flush, and keep account of that themselves.
    /// Repeat such a call.
    ///
    /// Every other operation also waits first, but does not return that result.
    ///
    /// # Errors
    /// [`Error::TimedOut`] if the server does not answer in time: the operation remains in doubt.
    /// [`Error::Mailbox`] or [`Error::Access`] if the processor's own mailbox or window fails.
    pub fn settle(&self, timeout: Duration) -> Result<Option<Result<u64, Errno>>, Error> {
        let _alone = self.enter()?;
        let Some(after) = self.doubt.get() else {
            return Ok(None);
        };
        let result = match self.finish(self.station.now().after(timeout)) {
            Ok(done) => Ok(done.value),
            Err(Error::Errno(errno)) => Err(errno),
            Err(error) => return Err(error),
        };
        Ok(after.is_asked_for().then_some(result))
    }

    /// Returns whether the end of the last operation is unknown.
    pub fn in_doubt(&self) -> bool {
        self.doubt.get().is_some()
    }

    /// Returns the buffer that was lent to an operation that timed out, once that operation has
    /// ended; otherwise `None`.
    pub fn take_buffer(&self) -> Option<Buffer<W>> {
        if self.in_doubt() {
            None
        } else {
            self.kept.take()
        }
    }

    fn file(&self, file: usize) -> Result<&Cell<Open>, Errno> {
        self.files.get(file).ok_or(Errno::BADF)
    }

    fn change(&self, file: usize, change: impl FnOnce(&mut Open)) {
        if let Some(cell) = self.files.get(file) {
            let mut open = cell.get();
            change(&mut open);
            cell.set(open);
        }
    }
}

impl<S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> Drop
    for FileSystem<'_, S, W, FILES>
{
    fn drop(&mut self) {
        if let Some(pending) = self.pending.take() {
            self.station.abandon(&pending);
        }
    }
}

impl Open {
    const NONE: Self = Self {
        state: SessionState::Free,
        handle: 0,
        flags: 0,
        position: 0,
        path_len: 0,
    };
}

/// A request without arguments.
fn request(operation: Operation) -> Request {
    Request {
        operation: operation as u32,
        ..Request::default()
    }
}
