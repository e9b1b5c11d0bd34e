//! The processor's side: the client.

mod answer;
mod area;
mod buffer;
mod directory;
mod error;
mod file;
mod names;
mod opening;
mod operation;
mod ranges;
mod ticket;
mod turn;
mod whole;

pub use answer::OperationResult;
pub use area::Area;
pub use buffer::{Buffer, BufferError, BufferResult};
pub use directory::{Directory, DirectoryEntry};
pub use error::{FileError, Receipt};
pub use file::File;
pub use opening::OpenOptions;
pub use ranges::AllocationMode;
pub use ticket::FileTicket;

use core::cell::Cell;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use core::time::Duration;

use condor_mbox::{MemoryWindow, Messenger, PendingReply, Processor, Region};

use crate::errno::Errno;
use crate::wire::{self, Operation, RequestSlot, block, slot, state, table};
use operation::After;
use turn::Turn;

/// The host's files, for all contexts of one processor: its background, its handlers of messages
/// and its threads. All paths are relative to the top of the server's directory tree.
///
/// `S` is the processor's mailbox, `W` its own window, and `FILES` the greatest number of files and
/// directories that can be open at a time. The whole state of open files is in this value and in
/// the window: the server may be killed and restarted at any moment, and a call in progress then
/// only takes longer.
///
/// All contexts may share the `FileSystem` and its files, as they share the mailbox: all calls take
/// `&self`, and it is `Sync` if the mailbox is. One operation is in progress at a time. Meanwhile a
/// call of another context returns [`Errno::BUSY`] and does nothing, or waits for its turn if
/// [`wait_for_turn`](Self::wait_for_turn) was called.
///
/// A processor has one `FileSystem` at a time: [`connect`](Self::connect) ends all former ones.
pub struct FileSystem<'m, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> {
    station: &'m S,
    server: Processor,
    own: Region<W>,
    area: Area<FILES>,
    timeout: SharedDuration,
    /// The time for which a call waits for its turn.
    patience: SharedDuration,
    /// Files that were dropped, and that nobody has closed.
    left: [AtomicBool; FILES],
    turn: Turn<State<W, FILES>>,
}

/// The state that belongs to the context whose turn it is.
struct State<W: MemoryWindow, const FILES: usize> {
    session: Cell<u64>,
    sequence: Cell<u64>,
    /// The work that follows the end of the operation in the slot, if that end has not been seen.
    doubt: Cell<Option<After>>,
    /// The message about it, if its receiver has not died.
    pending: Cell<Option<PendingReply>>,
    /// The last request, unless it has failed, and the value of its answer.
    former: Cell<Option<RequestSlot>>,
    former_value: Cell<u64>,
    /// The bits to add to the slot's offset in the first message about the operation in the slot.
    bits: Cell<u32>,
    files: [Cell<BlockState>; FILES],
    /// The buffer of an operation that was in doubt.
    kept: Cell<Option<Buffer<W>>>,
    /// The last operation that ended after its call had.
    ended: Cell<Option<UnreadResult>>,
}

/// The turn of a context.
type Alone<'t, W, const FILES: usize> = turn::Alone<'t, State<W, FILES>>;

/// A result that no call has returned.
#[derive(Clone, Copy)]
struct UnreadResult {
    sequence: u64,
    after: After,
    outcome: Result<u64, Errno>,
    /// Those of a status or the like.
    words: [u32; slot::STATUS_WORDS],
}

/// The client's knowledge of a block.
#[derive(Clone, Copy, Default)]
struct BlockState {
    state: SessionState,
    handle: u64,
    flags: u32,
    position: u64,
    path_len: u32,
}

/// A time that all contexts may read and set. Who reads it while another context sets it may get the
/// seconds of one time and the nanoseconds of the other.
struct SharedDuration {
    s: AtomicU32,
    ns: AtomicU32,
}

#[derive(Clone, Copy, Default, PartialEq, Eq)]
enum SessionState {
    #[default]
    Free,
    /// Somebody has it, or had it: see `left`.
    Held,
    /// Nobody has been told of it, as the call that opened it had ended before.
    Late,
}

impl<'m, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> FileSystem<'m, S, W, FILES> {
    /// Connects to the file server on the processor `server`, and begins a new session there.
    ///
    /// * `station`: this processor's mailbox. It must have joined, with the area's
    ///   [handler](Area::handler) for the vector [`OPEN_FILES`](wire::OPEN_FILES).
    /// * `own`: the part of this processor's shared memory that is for programs, which is
    ///   [`Region::users`] of its own `data`. The `area` lies in it.
    /// * `timeout`: the longest time that an operation may take, including restarts of the server.
    ///
    /// # Errors
    /// [`FileError::TimedOut`] if the server does not answer in time; [`FileError::Mailbox`] if the mailbox
    /// cannot send; [`FileError::Access`] if the area is not in `own`.
    pub fn connect(
        station: &'m S,
        server: Processor,
        own: Region<W>,
        area: Area<FILES>,
        timeout: Duration,
    ) -> Result<Self, FileError> {
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
        // A mode that a former client left there does not belong to this one.
        own.set_word(area.slot().wrapping_add(slot::MODE), 0)?;
        let system = Self {
            station,
            server,
            own,
            area,
            timeout: SharedDuration::new(timeout),
            patience: SharedDuration::new(Duration::ZERO),
            left: [const { AtomicBool::new(false) }; FILES],
            turn: Turn::new(State {
                session: Cell::new(wire::NO_SESSION),
                sequence: Cell::new(0),
                doubt: Cell::new(None),
                pending: Cell::new(None),
                former: Cell::new(None),
                former_value: Cell::new(0),
                bits: Cell::new(0),
                files: [const { Cell::new(BlockState::NONE) }; FILES],
                kept: Cell::new(None),
                ended: Cell::new(None),
            }),
        };
        let alone = system.enter()?;
        let deadline = system.clear(&alone)?;
        let request = request(Operation::Session);
        let session = system.perform_next(&alone, &request, After::Nothing, deadline)?;
        alone.session.set(session.value);
        drop(alone);
        Ok(system)
    }

    /// Sets the longest time that each later operation may take, including restarts of the server.
    pub fn set_timeout(&self, timeout: Duration) {
        self.timeout.set(timeout);
    }

    /// Sets the longest time for which a call waits while an operation of another context is in
    /// progress. After that time the call returns [`Errno::BUSY`]. While it waits, it serves
    /// messages. Without this function, the time is zero, and calls do not wait.
    ///
    /// Use it for threads of a hosted processor. Where contexts interrupt each other, leave the
    /// time at zero: a call that waits there prevents the very operation that it waits for from
    /// ending.
    pub fn wait_for_turn(&self, longest: Duration) {
        self.patience.set(longest);
    }

    /// Waits for at most `timeout` until the operation that is in doubt has ended, and returns its
    /// result. An operation is in doubt if its call ended with [`FileError::TimedOut`].
    ///
    /// The result is the number that the call would have returned (for a directory, the number of
    /// bytes of entries; 0 for an operation without a result), or the error number with which the
    /// operation failed.
    ///
    /// Returns `None` if nothing is in doubt, or if the operation was only a part of a call:
    /// [`open`](Self::open) also closes files that were dropped, and [`File::seek`] from the end asks
    /// for the size. Repeat such a call.
    ///
    /// Every other call also waits first, but does not return that result.
    ///
    /// # Errors
    /// [`FileError::TimedOut`] if the server does not answer in time: the operation remains in doubt.
    /// [`FileError::Mailbox`] or [`FileError::Access`] if the processor's own mailbox or window fails.
    pub fn settle(&self, timeout: Duration) -> Result<Option<Result<u64, Errno>>, FileError> {
        let alone = self.enter()?;
        let Some(after) = alone.doubt.get() else {
            return Ok(None);
        };
        let result = self.finish_former(&alone, self.station.now().after(timeout))?;
        Ok(after.is_asked_for().then_some(result))
    }

    /// Returns true if it is not known whether the last operation was done. It is also true while a
    /// call of another context is in progress.
    pub fn in_doubt(&self) -> bool {
        self.turn
            .take()
            .is_none_or(|alone| alone.doubt.get().is_some())
    }

    /// Returns the [`Buffer`] of a read or write without a copy that timed out, once that operation
    /// has ended. Returns `None` before that, if there is no such buffer, or while a call of
    /// another context is in progress.
    pub fn take_buffer(&self) -> Option<Buffer<W>> {
        let alone = self.turn.take()?;
        if alone.doubt.get().is_some() {
            return None;
        }
        alone.kept.take()
    }
}

impl<W: MemoryWindow, const FILES: usize> State<W, FILES> {
    fn file(&self, file: usize) -> Result<&Cell<BlockState>, Errno> {
        self.files.get(file).ok_or(Errno::BADF)
    }

    fn change(&self, file: usize, change: impl FnOnce(&mut BlockState)) {
        if let Some(cell) = self.files.get(file) {
            let mut open = cell.get();
            change(&mut open);
            cell.set(open);
        }
    }
}

impl SharedDuration {
    fn new(duration: Duration) -> Self {
        let new = Self {
            s: AtomicU32::new(0),
            ns: AtomicU32::new(0),
        };
        new.set(duration);
        new
    }

    /// Up to 136 years.
    fn set(&self, duration: Duration) {
        let s = u32::try_from(duration.as_secs()).unwrap_or(u32::MAX);
        // Relaxed: nothing else is told by it.
        self.s.store(s, Ordering::Relaxed);
        self.ns.store(duration.subsec_nanos(), Ordering::Relaxed);
    }

    fn get(&self) -> Duration {
        let s = self.s.load(Ordering::Relaxed).into();
        let ns = u64::from(self.ns.load(Ordering::Relaxed));
        Duration::from_secs(s).saturating_add(Duration::from_nanos(ns))
    }
}

impl<S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> Drop
    for FileSystem<'_, S, W, FILES>
{
    fn drop(&mut self) {
        if let Some(pending) = self.turn.get_mut().pending.take() {
            self.station.abandon(&pending);
        }
    }
}

impl BlockState {
    const NONE: Self = Self {
        state: SessionState::Free,
        handle: 0,
        flags: 0,
        position: 0,
        path_len: 0,
    };
}

/// A request without arguments.
fn request(operation: Operation) -> RequestSlot {
    RequestSlot {
        operation: operation as u32,
        ..RequestSlot::default()
    }
}
