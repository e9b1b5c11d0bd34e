//! One operation: through the slot, over as many incarnations of the server as it takes.

use core::sync::atomic::{Ordering, fence};
use core::time::Duration;

use condor_mbox::{Instant, MailboxError as MailError, MemoryWindow, Messenger, PendingReply};

use super::{Alone, FileError, FileSystem, Receipt, SessionState};
use crate::errno::Errno;
use crate::wire::{self, RequestSlot, again, block, slot, state};

/// The time to wait before looking again for a server that was not there.
pub(super) const PAUSE: Duration = Duration::from_millis(1);
/// The number of times that a context looks for its turn before it sleeps: most turns are short.
const LOOKS: u32 = 1000;

/// The work of a client when an operation has ended, however late.
#[derive(Clone, Copy)]
pub(super) enum After {
    Nothing,
    /// The same, after what a call had to know first.
    Looked,
    /// The result is the status of a file or directory.
    Status,
    /// The result is the capacity of the filesystem.
    Space,
    /// The block was for a file, or for a directory, to be opened.
    Opened {
        file: usize,
        directory: bool,
    },
    Closed {
        file: usize,
    },
    /// The same of a file that was dropped before.
    Dropped {
        file: usize,
    },
    /// Data were moved at the file's own position.
    Moved {
        file: usize,
    },
    /// The same, into the file's own buffer.
    Read {
        file: usize,
    },
    /// Data were read into the file's own buffer from another position.
    ReadAt {
        file: usize,
    },
    /// The paths of open files begin with another name.
    Renamed {
        from: u32,
        to: u32,
    },
    /// The same, and the other way round.
    Exchanged {
        from: u32,
        to: u32,
    },
}

impl After {
    /// Whether the operation is one that a call was made for: only then is its result that of the call.
    pub(super) const fn is_asked_for(self) -> bool {
        !matches!(self, Self::Looked | Self::Dropped { .. })
    }
}

/// A result.
#[derive(Clone, Copy)]
pub(super) struct Completion {
    pub(super) value: u64,
}

impl<S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> FileSystem<'_, S, W, FILES> {
    /// Begins the turn of this context. While it lasts, no other operation begins.
    #[inline]
    pub(super) fn enter(&self) -> Result<Alone<'_, W, FILES>, Errno> {
        match self.turn.take() {
            Some(alone) => Ok(alone),
            None => self.enter_later(),
        }
    }

    #[cold]
    fn enter_later(&self) -> Result<Alone<'_, W, FILES>, Errno> {
        let deadline = self.station.now().after(self.patience.get());
        loop {
            let left = self.left_until(deadline);
            if left.is_zero() {
                return Err(Errno::BUSY);
            }
            for _ in 0..LOOKS {
                if let Some(alone) = self.turn.take() {
                    return Ok(alone);
                }
                core::hint::spin_loop();
            }
            // A mailbox that cannot serve will not get the other context on either.
            if self
                .station
                .serve_for(self.server, PAUSE.min(left))
                .is_err()
            {
                return Err(Errno::BUSY);
            }
        }
    }

    /// Does `request`, whose paths are in the window, and then `after`.
    pub(super) fn perform_next(
        &self,
        alone: &Alone<'_, W, FILES>,
        request: &RequestSlot,
        after: After,
        deadline: Option<Instant>,
    ) -> Result<Completion, FileError> {
        self.start(alone, request, after)?;
        // The server has it while the clock is read. What cannot be sent now, `finish` sends.
        let _ = self.send(alone, Duration::ZERO);
        self.finish(alone, deadline.unwrap_or_else(|| self.deadline()))
    }

    /// Puts `request` into the slot, for one who has cleared that.
    pub(super) fn start(
        &self,
        alone: &Alone<'_, W, FILES>,
        request: &RequestSlot,
        after: After,
    ) -> Result<(), FileError> {
        let sequence = wire::following(alone.sequence.get());
        let request = RequestSlot {
            session: alone.session.get(),
            sequence,
            ..*request
        };
        self.write(alone, &request)?;
        alone.sequence.set(sequence);
        alone.doubt.set(Some(after));
        Ok(())
    }

    /// Ends the operation that is in doubt, so that another may begin; returns the deadline, if there was
    /// one.
    pub(super) fn clear(&self, alone: &Alone<'_, W, FILES>) -> Result<Option<Instant>, FileError> {
        if alone.doubt.get().is_none() {
            return Ok(None);
        }
        let deadline = self.deadline();
        self.finish_former(alone, deadline)
            .map_err(|error| self.not_begun(error))?
            .ok();
        Ok(Some(deadline))
    }

    /// The deadline of a call that begins now.
    fn deadline(&self) -> Instant {
        self.station.now().after(self.timeout.get())
    }

    /// Waits for the end of an operation whose call has ended, and keeps the result for who asks for
    /// it by the receipt.
    pub(super) fn finish_former(
        &self,
        alone: &Alone<'_, W, FILES>,
        deadline: Instant,
    ) -> Result<Result<u64, Errno>, FileError> {
        let after = alone.doubt.get();
        let outcome = match self.finish(alone, deadline) {
            Ok(done) => Ok(done.value),
            Err(FileError::Errno(errno)) => Err(errno),
            Err(error) => return Err(error),
        };
        if let Some(after) = after.filter(|after| after.is_asked_for()) {
            alone.ended.set(Some(self.ended(alone, after, outcome)?));
        }
        Ok(outcome)
    }

    /// The error of a call whose own operation was not reached.
    pub(super) fn not_begun(&self, error: FileError) -> FileError {
        let cause = match error {
            FileError::TimedOut { cause, .. } => cause,
            FileError::Mailbox(error) => Some(error),
            other => return other,
        };
        FileError::NotBegun {
            server: self.server,
            cause,
        }
    }

    /// Puts a request into the slot. A message of a former time may be under way, so the server
    /// finds no magic, or another sequence, while it is not whole.
    fn write(&self, alone: &Alone<'_, W, FILES>, request: &RequestSlot) -> Result<(), FileError> {
        let at = self.area.slot();
        let bits = alone.former.replace(Some(*request)).map_or(0, |former| {
            again::bits(&former, alone.former_value.get(), request)
        });
        alone.bits.set(bits);
        self.own.set_word(at, 0)?;
        self.set_sequence(at.wrapping_add(slot::SEQUENCE), request.sequence)?;
        // Pairs with the fence in the server's `read_request`: who finds a word of this request there
        // finds afterwards that the magic was taken away, or the new sequence.
        fence(Ordering::Release);
        let words = request.to_words().map(u32::to_le_bytes);
        let behind_magic = words.as_flattened().get(4..).unwrap_or_default();
        self.own.write(at.wrapping_add(4), behind_magic)?;
        self.own.set_word(at, slot::MAGIC)?;
        Ok(())
    }

    /// Waits for the end of the operation in the slot, and does the work that follows it.
    pub(super) fn finish(
        &self,
        alone: &Alone<'_, W, FILES>,
        deadline: Instant,
    ) -> Result<Completion, FileError> {
        let outcome = self.await_answer(alone, deadline);
        self.follow_up(alone, outcome)
    }

    /// Checks if the operation in the slot has ended, and does the work that follows it if so; asks the
    /// server if none works on it.
    pub(super) fn poll(
        &self,
        alone: &Alone<'_, W, FILES>,
    ) -> Result<Option<Completion>, FileError> {
        match self.poll_answer(alone) {
            Ok(None) => Ok(None),
            Ok(Some(done)) => self.follow_up(alone, Ok(done)).map(Some),
            Err(error) => self.follow_up(alone, Err(error)).map(Some),
        }
    }

    fn follow_up(
        &self,
        alone: &Alone<'_, W, FILES>,
        outcome: Result<Completion, FileError>,
    ) -> Result<Completion, FileError> {
        match outcome {
            Ok(done) => alone.former_value.set(done.value),
            Err(_) => alone.former.set(None),
        }
        if let Ok(_) | Err(FileError::Errno(_)) = outcome
            && let Some(after) = alone.doubt.take()
        {
            self.follow(alone, after, outcome.ok().as_ref())?;
        }
        outcome
    }

    fn await_answer(
        &self,
        alone: &Alone<'_, W, FILES>,
        deadline: Instant,
    ) -> Result<Completion, FileError> {
        let mut cause = None;
        loop {
            let left = self.left_until(deadline);
            if left.is_zero() {
                return Err(FileError::TimedOut {
                    server: self.server,
                    cause,
                    receipt: Receipt(alone.sequence.get()),
                });
            }
            match self.ask(alone, left, deadline) {
                Ok(reply) => {
                    if let Some(done) = self.answered(alone, reply)? {
                        return Ok(done);
                    }
                }
                Err(error) if passes(&error) => cause = Some(error),
                Err(error) => return Err(error.into()),
            }
            self.station.serve_for(self.server, PAUSE.min(left))?;
        }
    }

    fn poll_answer(&self, alone: &Alone<'_, W, FILES>) -> Result<Option<Completion>, FileError> {
        let reply = match alone.pending.get() {
            None => self.send(alone, Duration::ZERO).map(|_| None),
            Some(pending) => {
                let reply = self.station.poll_pending(&pending);
                if !matches!(reply, Ok(None)) {
                    alone.pending.set(None);
                    self.station.abandon(&pending);
                }
                reply
            }
        };
        match reply {
            Ok(Some(reply)) => self.answered(alone, reply),
            // The next look asks again.
            Ok(None) => Ok(None),
            Err(error) if passes(&error) => Ok(None),
            Err(error) => Err(error.into()),
        }
    }

    /// Reads a reply; returns `None` if the server must be asked again.
    fn answered(
        &self,
        alone: &Alone<'_, W, FILES>,
        reply: u32,
    ) -> Result<Option<Completion>, FileError> {
        if let Some(value) = wire::value_of(reply) {
            let value = value.into();
            return Ok(Some(Completion { value }));
        }
        if reply == wire::DONE {
            return Ok(self.result(alone)?.transpose()?);
        }
        if reply & wire::REFUSED == 0 {
            return Err(Errno::IO.into());
        }
        match Errno((reply & !wire::REFUSED) as u16) {
            Errno::AGAIN => Ok(None),
            errno => Err(errno.into()),
        }
    }

    /// Sends the slot, unless the server still has it, and waits for the reply.
    fn ask(
        &self,
        alone: &Alone<'_, W, FILES>,
        left: Duration,
        deadline: Instant,
    ) -> Result<u32, MailError> {
        let (pending, left) = if let Some(pending) = alone.pending.get() {
            (pending, left)
        } else {
            (self.send(alone, left)?, self.left_until(deadline))
        };
        let outcome = self.station.wait_pending(&pending, left);
        if !matches!(
            outcome,
            Err(MailError::TimedOut { .. } | MailError::Stalled { .. })
        ) {
            alone.pending.set(None);
            self.station.abandon(&pending);
        }
        outcome
    }

    fn send(
        &self,
        alone: &Alone<'_, W, FILES>,
        timeout: Duration,
    ) -> Result<PendingReply, MailError> {
        // Once only: to a server that has done it, the same bits mean the request after it.
        let message = self.area.slot() | alone.bits.take();
        let ticket = (self.station).begin(self.server, wire::FILES, message, timeout)?;
        // Apart from its messenger, so that a `FileSystem` can go to another thread.
        let no_reply = MailError::NotConnected { to: self.server };
        let pending = ticket.detach().ok_or(no_reply)?;
        alone.pending.set(Some(pending));
        Ok(pending)
    }

    fn left_until(&self, deadline: Instant) -> Duration {
        Duration::from_nanos(deadline.ns_since(self.station.now()))
    }

    /// Returns the result that the server wrote; `None` if it is not about this operation.
    fn result(
        &self,
        alone: &Alone<'_, W, FILES>,
    ) -> Result<Option<Result<Completion, Errno>>, FileError> {
        let at = |offset: u32| self.area.slot().wrapping_add(offset);
        // Acquire, as `set_word` of the server is Release: the rest was written before.
        let found = self.own.word(at(slot::STATE))?;
        let words: [u32; 4] = self.words(at(slot::STATE_SESSION))?;
        let [session, session_high, sequence, sequence_high] = words;
        if found != state::DONE
            || wire::whole(session, session_high) != alone.session.get()
            || wire::whole(sequence, sequence_high) != alone.sequence.get()
        {
            return Ok(None);
        }
        let [errno, value, value_high] = self.words(at(slot::ERRNO))?;
        if errno != 0 {
            return Ok(Some(Err(Errno(errno as u16))));
        }
        Ok(Some(Ok(Completion {
            value: wire::whole(value, value_high),
        })))
    }

    /// The words of the last operation that returned a status or the like, for one who has entered.
    pub(super) fn status_words(
        &self,
        _: &Alone<'_, W, FILES>,
    ) -> Result<[u32; slot::STATUS_WORDS], FileError> {
        self.words(self.area.slot().wrapping_add(slot::STATUS))
    }

    fn words<const K: usize>(&self, offset: u32) -> Result<[u32; K], FileError> {
        let mut words = [[0; 4]; K];
        self.own.read(offset, words.as_flattened_mut())?;
        Ok(words.map(u32::from_le_bytes))
    }

    /// The high word first: without the low one it is none.
    fn set_sequence(&self, at: u32, sequence: u64) -> Result<(), FileError> {
        let [low, high] = wire::halves(sequence);
        self.own.set_word(at.wrapping_add(4), high)?;
        self.own.set_word(at, low)?;
        Ok(())
    }

    fn follow(
        &self,
        alone: &Alone<'_, W, FILES>,
        after: After,
        done: Option<&Completion>,
    ) -> Result<(), FileError> {
        match (after, done) {
            (After::Opened { file, .. }, Some(_)) => {
                let at = self.area.block(file);
                let evidence: [u32; 8] =
                    self.words(self.area.slot().wrapping_add(slot::EVIDENCE))?;
                for (word, offset) in
                    (evidence.iter()).zip((at.wrapping_add(block::EVIDENCE)..).step_by(4))
                {
                    self.own.set_word(offset, *word)?;
                }
                let handle = alone.sequence.get();
                self.own.set_word(at.wrapping_add(block::SILLY), 0)?;
                self.set_sequence(at.wrapping_add(block::HANDLE), handle)?;
                // The call that opens the file holds it if the answer comes in time.
                alone.change(file, |open| {
                    open.state = SessionState::Late;
                    open.handle = handle;
                });
            }
            (After::Opened { file, .. }, None) => {
                alone.change(file, |open| open.state = SessionState::Free);
            }
            // A handle that the server does not know is closed all the same.
            (After::Closed { file } | After::Dropped { file }, _) => {
                let at = self.area.block(file);
                self.own.set_word(at.wrapping_add(block::HANDLE), 0)?;
                alone.change(file, |open| open.state = SessionState::Free);
                self.set_left(file, false);
            }
            (After::Moved { file } | After::Read { file }, Some(done)) => {
                alone.change(file, |open| {
                    open.position = open.position.saturating_add(done.value);
                });
            }
            (After::Renamed { from, to }, Some(_)) => {
                self.rewrite_paths(alone, from, to, false)?;
            }
            (After::Exchanged { from, to }, Some(_)) => {
                self.rewrite_paths(alone, from, to, true)?;
            }
            (
                After::Nothing
                | After::Looked
                | After::Status
                | After::Space
                | After::Moved { .. }
                | After::Read { .. }
                | After::ReadAt { .. }
                | After::Renamed { .. }
                | After::Exchanged { .. },
                _,
            ) => {}
        }
        Ok(())
    }
}

/// Whether an error of the mailbox passes when the server is back.
fn passes(error: &MailError) -> bool {
    matches!(
        error,
        MailError::NotConnected { .. }
            | MailError::NoSlot { .. }
            | MailError::TimedOut { .. }
            | MailError::Stalled { .. }
            | MailError::PeerDied { .. }
            | MailError::PeerLeft { .. }
            | MailError::PeerRestarted { .. }
            | MailError::NoHandler { .. }
            | MailError::HandlerFailed { .. }
    )
}

#[cfg(test)]
mod tests {
    use condor_mbox::sim::{SimMailbox, SimSystem};
    use condor_mbox::{Allocator, Call, Processor, Region};
    use std::boxed::Box;
    use std::sync::{Arc, Mutex};
    use std::vec::Vec;

    use super::*;
    use crate::{Area, OpenOptions};

    const HOST: Processor = Processor(0);
    const CLIENT: Processor = Processor(1);
    const TIMEOUT: Duration = Duration::from_millis(10);

    #[test]
    #[cfg_attr(
        miri,
        ignore = "the host's end lives for ever, which Miri calls a leak"
    )]
    fn sequences_and_handles_go_on_beyond_one_word() {
        let system = SimSystem::<2>::in_virtual_time(2048);
        let asked = Arc::new(Mutex::new(Vec::new()));
        let [_, windows] = system.windows(HOST);
        let (theirs, seen) = (Region::users(windows.data).unwrap(), asked.clone());
        let mut host = system.mailbox(HOST).unwrap();
        let answer = move |call: &Call<'_>| {
            let word = |n: u32| theirs.word(call.data() + 4 * n).unwrap();
            let request = RequestSlot::from_words(&core::array::from_fn(|n| word(n as u32)));
            let request = request.unwrap();
            seen.lock()
                .unwrap()
                .push((request.sequence, request.handle));
            let [sequence, sequence_high] = wire::halves(request.sequence);
            let [session, session_high] = wire::halves(request.session);
            for (offset, word) in [
                (slot::STATE_SESSION, session),
                (slot::STATE_SESSION + 4, session_high),
                (slot::STATE_SEQUENCE, sequence),
                (slot::STATE_SEQUENCE + 4, sequence_high),
                (slot::VALUE, 1),
                (slot::STATE, state::DONE),
            ] {
                theirs.set_word(call.data() + offset, word).unwrap();
            }
            wire::DONE
        };
        let answer = Box::leak(Box::new(answer));
        host.set_vector(wire::FILES, answer, "files").unwrap();
        host.join().unwrap();
        system.while_waiting(HOST, move || {
            host.serve(Duration::ZERO).unwrap();
        });

        let [_, windows] = system.windows(CLIENT);
        let own = Region::users(windows.data).unwrap();
        let mut allocator = Allocator::new(own.size());
        let area = Area::<2>::new(&mut allocator, 16, 16).unwrap();
        let mut mailbox: SimMailbox<'_, 2> = system.mailbox(CLIENT).unwrap();
        mailbox.join().unwrap();
        let files = FileSystem::connect(&mailbox, HOST, own.clone(), area, TIMEOUT).unwrap();
        let last = u64::from(u32::MAX);
        files.turn.take().unwrap().sequence.set(last - 1);
        let read = OpenOptions::new().read();
        let (first, second) = (
            files.open("a", read).unwrap(),
            files.open("b", read).unwrap(),
        );
        let _ = (first.status().unwrap(), second.status().unwrap());
        let asked = asked.lock().unwrap();
        assert_eq!(
            asked[1..],
            [
                (last, 0),
                (last + 2, 0),
                (last + 3, last),
                (last + 4, last + 2)
            ],
            "no low word is zero"
        );
        let handle = |file| files.words(area.block(file) + block::HANDLE).unwrap();
        assert_eq!(handle(0), [u32::MAX, 0]);
        assert_eq!(handle(1), [1, 1]);
    }
}
