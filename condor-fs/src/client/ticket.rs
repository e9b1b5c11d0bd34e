//! [`FileTicket`]: an operation that is awaited, or waited for again after a timeout.

use core::pin::Pin;
use core::task::{Context, Poll};
use core::time::Duration;

use condor_mbox::{Instant, MemoryWindow, Messenger};

use super::error::Receipt;
use super::operation::After;
use super::{Alone, FileError, FileSystem, SessionState, UnreadResult, request};
use crate::errno::Errno;
use crate::wire::{FileStatus, Operation, RequestSlot, Space, rename, slot};

/// A file operation in progress: `.await` it, or block on it with [`wait`](Self::wait).
///
/// The methods whose names begin with `begin_` return tickets. The request is sent when the ticket
/// is first polled and no other operation is under way. From then on the ticket occupies the
/// [`FileSystem`] until it completes or is dropped. Meanwhile any other call returns
/// [`Errno::BUSY`], or waits if [`FileSystem::wait_for_turn`] permits, and other tickets wait for
/// their turn.
///
/// Tasks are woken when the mailbox is served: by its interrupt, or by a task that calls `serve`
/// periodically. This needs the feature `async` of `condor-mbox`; see
/// [`condor_mbox::MessageTicket`].
///
/// An awaited ticket has no timeout: it waits as long as there is no server. Drop it to end the
/// wait: the operation stays in doubt, as after a timeout.
///
/// ```
/// # use condor_fs::{FileError, FileSystem, OpenOptions};
/// # use condor_mbox::{MemoryWindow, Messenger};
/// async fn read_tension<S: Messenger, W: MemoryWindow, const FILES: usize>(
///     files: &FileSystem<'_, S, W, FILES>,
/// ) -> Result<[u8; 4], FileError> {
///     let file = files.begin_open("tension", OpenOptions::new().read()).await?;
///     let mut bytes = [0; 4];
///     file.begin_read_at(&mut bytes, 0).await?;
///     file.begin_close().await?;
///     Ok(bytes)
/// }
/// ```
#[must_use = "nothing is asked before a ticket is polled or waited for"]
pub struct FileTicket<'t, 'f, 'm, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize, T> {
    system: &'f FileSystem<'m, S, W, FILES>,
    ask: Ask<'t>,
    /// The place to which a read copies its bytes.
    into: &'t mut [u8],
    result: fn(TicketResult<'f, 'm, S, W, FILES>) -> T,
    /// While it is this one's turn.
    alone: Option<Alone<'f, W, FILES>>,
}

/// The request of a ticket.
pub(super) enum Ask<'t> {
    Plain(Operation, After),
    Path(RequestSlot, &'t [u8], After),
    Rename {
        flags: u32,
        from: &'t [u8],
        to: &'t [u8],
    },
    Open {
        path: &'t [u8],
        flags: u32,
        mode: u32,
    },
    /// About an open file, whose handle is put in.
    File(RequestSlot, usize, After),
    Close(usize),
    /// Into the file's buffer, from its own position or from another one.
    Read(usize, Option<u64>),
    Write(usize, Option<u64>, &'t [u8]),
    /// The operation with this sequence number has been begun.
    Begun(u64),
}

/// The result of an operation that succeeded.
pub(super) struct TicketResult<'f, 'm, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> {
    pub(super) system: &'f FileSystem<'m, S, W, FILES>,
    pub(super) after: After,
    pub(super) value: u64,
    words: [u32; slot::STATUS_WORDS],
}

impl<'t, 'f, 'm, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize, T>
    FileTicket<'t, 'f, 'm, S, W, FILES, T>
{
    pub(super) const fn new(
        system: &'f FileSystem<'m, S, W, FILES>,
        ask: Ask<'t>,
        into: &'t mut [u8],
        result: fn(TicketResult<'f, 'm, S, W, FILES>) -> T,
    ) -> Self {
        Self {
            system,
            ask,
            into,
            result,
            alone: None,
        }
    }

    /// Waits for the result for at most `timeout`, and serves messages meanwhile. After a timeout,
    /// call `wait` again to go on waiting for the same operation: no second one is begun.
    ///
    /// # Errors
    /// Returns the errors of the operation if that fails: a ticket of
    /// [`File::begin_read`](super::File::begin_read), for example, has those of
    /// [`File::read`](super::File::read). Returns [`Errno::INVAL`] if the result was returned
    /// before, or was replaced by the result of another operation that timed out.
    pub fn wait(&mut self, timeout: Duration) -> Result<T, FileError> {
        let until = self.system.station.now().after(timeout);
        match self.advance(Some(until)) {
            Poll::Ready(outcome) => outcome,
            // A wait that has an end does not go on.
            Poll::Pending => Err(Errno::BUSY.into()),
        }
    }

    /// Returns the receipt by which [`FileSystem::ticket`] can ask for the result; `None` if the
    /// operation has not begun yet.
    #[must_use]
    pub const fn receipt(&self) -> Option<Receipt> {
        match self.ask {
            Ask::Begun(sequence) => Some(Receipt(sequence)),
            _ => None,
        }
    }

    /// The call that makes a ticket and waits for it.
    pub(super) fn done(mut self) -> Result<T, FileError> {
        self.wait(self.system.timeout.get())
    }

    /// Goes on as far as it can, or until then.
    fn advance(&mut self, until: Option<Instant>) -> Poll<Result<T, FileError>> {
        let alone = match (self.alone.take(), until) {
            (Some(alone), _) => alone,
            (None, Some(_)) => self.system.enter()?,
            (None, None) => match self.system.turn.take() {
                Some(alone) => alone,
                None => return Poll::Pending,
            },
        };
        let outcome = self.advance_alone(&alone, until);
        if outcome.is_pending() {
            self.alone = Some(alone);
        }
        outcome
    }

    fn advance_alone(
        &mut self,
        alone: &Alone<'f, W, FILES>,
        until: Option<Instant>,
    ) -> Poll<Result<T, FileError>> {
        let system = self.system;
        loop {
            // Ended in a call that needed the slot: before that is needed once more.
            if let Ask::Begun(sequence) = self.ask
                && let Some(ended) = alone.ended.get()
                && ended.sequence == sequence
            {
                return Poll::Ready(self.take(alone, &ended));
            }
            let Some(after) = alone.doubt.get() else {
                match self.ask {
                    Ask::Begun(_) => return Poll::Ready(Err(Errno::INVAL.into())),
                    Ask::Open { .. } if system.begin_closing_dropped(alone)? => {}
                    _ => self.start(alone)?,
                }
                continue;
            };
            let sequence = alone.sequence.get();
            let own = matches!(self.ask, Ask::Begun(own) if own == sequence);
            let found = match until {
                Some(until) => system.finish(alone, until).map(Some),
                None => system.poll(alone),
            };
            let outcome = match found {
                Ok(Some(done)) => Ok(done.value),
                Ok(None) => return Poll::Pending,
                Err(FileError::Errno(errno)) => Err(errno),
                Err(error) if own => return Poll::Ready(Err(error)),
                Err(error) => return Poll::Ready(Err(system.not_begun(error))),
            };
            if own {
                let ended = system.ended(alone, after, outcome)?;
                return Poll::Ready(self.take(alone, &ended));
            }
            if after.is_asked_for() {
                alone.ended.set(Some(system.ended(alone, after, outcome)?));
            }
        }
    }

    /// Puts the operation into the slot, which is free.
    fn start(&mut self, alone: &Alone<'f, W, FILES>) -> Result<(), FileError> {
        let system = self.system;
        let (request, after) = match self.ask {
            Ask::Plain(operation, after) => (request(operation), after),
            Ask::Path(request, path, after) => {
                let path = system.put_path(FILES, path)?;
                (RequestSlot { path, ..request }, after)
            }
            Ask::Rename { flags, from, to } => {
                let after = match (without_slashes(from), without_slashes(to)) {
                    (from, to) if flags == rename::EXCHANGE => After::Exchanged { from, to },
                    (from, to) => After::Renamed { from, to },
                };
                let request = RequestSlot {
                    path: system.put_path(FILES, from)?,
                    second_path: system.put_path(FILES.wrapping_add(1), to)?,
                    flags,
                    ..request(Operation::Rename)
                };
                (request, after)
            }
            Ask::Open { path, flags, mode } => system.prepare_open(alone, path, flags, mode)?,
            Ask::File(request, file, after) => {
                let handle = alone.file(file)?.get().handle;
                let request = RequestSlot {
                    handle,
                    file: file as u32,
                    ..request
                };
                (request, after)
            }
            Ask::Close(file) => {
                // Should this fail, a later open closes it.
                system.set_left(file, true);
                let request = alone.about(Operation::Close, file)?;
                (request, After::Closed { file })
            }
            Ask::Read(file, at) => {
                let buffer = system.own_buffer(file, self.into.len());
                alone.prepare_transfer(Operation::Read, file, buffer, at)?
            }
            Ask::Write(file, at, from) => {
                let buffer = system.own_buffer(file, from.len());
                let operation = alone.writing(file, at)?;
                system.fill_buffer(alone, file, buffer, from)?;
                alone.prepare_transfer(operation, file, buffer, at)?
            }
            // The request is in the slot.
            Ask::Begun(_) => return Ok(()),
        };
        system.start(alone, &request, after)?;
        self.ask = Ask::Begun(alone.sequence.get());
        Ok(())
    }

    /// The result, once.
    fn take(&mut self, alone: &Alone<'f, W, FILES>, ended: &UnreadResult) -> Result<T, FileError> {
        let system = self.system;
        let mut value = ended.outcome;
        match (ended.after, &mut value) {
            (After::Read { file } | After::ReadAt { file }, Ok(value)) => {
                // The server may claim more bytes than there are.
                *value = (*value).min(system.area.buffer_bytes().into());
                let into = usize::try_from(*value).ok();
                let into = into.and_then(|len| self.into.get_mut(..len));
                let Some(into) = into else {
                    // The result can be asked for again, with more room.
                    alone.ended.set(Some(*ended));
                    return Err(Errno::INVAL.into());
                };
                system.own.read(system.area.buffer(file), into)?;
            }
            (After::Opened { file, .. }, Ok(_)) => {
                alone.change(file, |open| open.state = SessionState::Held);
            }
            _ => {}
        }
        if alone
            .ended
            .get()
            .is_some_and(|kept| kept.sequence == ended.sequence)
        {
            alone.ended.set(None);
        }
        Ok((self.result)(TicketResult {
            system,
            after: ended.after,
            value: value?,
            words: ended.words,
        }))
    }
}

impl<S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize, T> Future
    for FileTicket<'_, '_, '_, S, W, FILES, T>
{
    type Output = Result<T, FileError>;

    fn poll(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Self::Output> {
        // Before the look: a reply that comes after it is served after it.
        self.system.station.wake_after_serve(context.waker());
        let outcome = self.advance(None);
        if outcome.is_pending() && self.alone.is_none() {
            // The turn of another context ends without a message.
            context.waker().wake_by_ref();
        }
        outcome
    }
}

impl<S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize, T> Drop
    for FileTicket<'_, '_, '_, S, W, FILES, T>
{
    fn drop(&mut self) {
        if let Ask::Close(file) = self.ask {
            self.system.set_left(file, true);
        }
    }
}

impl<S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> TicketResult<'_, '_, S, W, FILES> {
    pub(super) fn status(self) -> FileStatus {
        FileStatus::from_words(&self.words)
    }

    pub(super) fn space(self) -> Space {
        Space::from_words(&self.words)
    }
}

impl<S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> FileSystem<'_, S, W, FILES> {
    /// The result of the last operation.
    pub(super) fn ended(
        &self,
        alone: &Alone<'_, W, FILES>,
        after: After,
        outcome: Result<u64, Errno>,
    ) -> Result<UnreadResult, FileError> {
        let words = match after {
            After::Looked | After::Status | After::Space => self.status_words(alone)?,
            _ => [0; slot::STATUS_WORDS],
        };
        Ok(UnreadResult {
            sequence: alone.sequence.get(),
            after,
            outcome,
            words,
        })
    }

    /// Begins to close a file that nobody has any more; returns true if there was one.
    fn begin_closing_dropped(&self, alone: &Alone<'_, W, FILES>) -> Result<bool, FileError> {
        let late = alone.ended.get().and_then(|ended| match ended.after {
            After::Opened { file, .. } => Some(file),
            _ => None,
        });
        let state = |file: &usize| alone.file(*file).map(|open| open.get().state);
        let full = !(0..FILES).any(|file| state(&file) == Ok(SessionState::Free));
        let dropped = (0..FILES).find(|file| match state(file) {
            Ok(SessionState::Held) => self.is_left(*file),
            // Somebody may yet ask for it.
            Ok(SessionState::Late) => full || late != Some(*file),
            _ => false,
        });
        let Some(file) = dropped else {
            return Ok(false);
        };
        if late == Some(file) {
            alone.ended.set(None);
        }
        let request = alone.about(Operation::Close, file)?;
        self.start(alone, &request, After::Dropped { file })?;
        Ok(true)
    }
}

/// The length of a path without the slashes that it may end with.
fn without_slashes(path: &[u8]) -> u32 {
    let last = path.iter().rposition(|byte| *byte != b'/');
    last.map_or(0, |last| last as u32).saturating_add(1)
}
