//! [`Host`]: a file service that answers from a script.
//!
//! It keeps no files. It takes a request out of the client's slot, asks for the client's table as a service
//! does, and answers as it was told to. If it was told nothing, a read gets the [`CONTENT`] from the
//! request's position on, and a write takes all bytes. Other tests, in which a real service runs, show what
//! that does.

use core::cell::Cell;
use core::time::Duration;

use condor_fs::wire::{
    DONE, FILES, NONE, OPEN_FILES, Operation, REFUSED, RequestSlot, again, halves, slot, state,
};
use condor_fs::{Errno, FileStatus};
use condor_mbox::{AccessError, Call, MemoryWindow as _, Messenger as _, Region, StaticWindow};
use critical_section::Mutex;

/// The content of all files.
pub(crate) const CONTENT: &[u8] = b"tendon 3 is slack\n";
/// Two files, `a` and `monday`, as an answer lays them out: cookie, kind, length, name.
const ENTRIES: [[u32; 6]; 2] = [
    [1, 0, 8, 1, u32::from_le_bytes(*b"a\0\0\0"), 0],
    [
        2,
        0,
        8,
        6,
        u32::from_le_bytes(*b"mond"),
        u32::from_le_bytes(*b"ay\0\0"),
    ],
];
/// Bytes of an entry before its name.
const HEAD: u32 = 16;
/// The time within which a client answers.
const PATIENCE: Duration = Duration::from_secs(1);

/// The answer to the next request.
#[derive(Clone, Copy)]
enum Answer {
    /// The request is carried out, as if all were well.
    Done,
    /// The request fails with an error.
    Failed(Errno),
    /// The request itself is refused.
    Refused(Errno),
}

/// The state of the service, which may be shared with the handler of a mailbox.
pub(crate) struct Host<'s> {
    /// The users' part of the client's `data`.
    theirs: Region<StaticWindow<'s>>,
    next: Mutex<Cell<Answer>>,
}

impl<'s> Host<'s> {
    pub(crate) const fn new(theirs: Region<StaticWindow<'s>>) -> Self {
        Self {
            theirs,
            next: Mutex::new(Cell::new(Answer::Done)),
        }
    }

    fn set(&self, answer: Answer) {
        critical_section::with(|token| self.next.borrow(token).set(answer));
    }

    /// Refuses the next request.
    pub(crate) fn refuse(&self, errno: Errno) {
        self.set(Answer::Refused(errno));
    }

    /// Lets the next request fail.
    pub(crate) fn fail(&self, errno: Errno) {
        self.set(Answer::Failed(errno));
    }

    /// Serves [`FILES`], as the handler of a mailbox.
    pub(crate) fn serve(&self, call: &Call<'_>) -> u32 {
        let next = critical_section::with(|token| self.next.borrow(token).replace(Answer::Done));
        let fault = REFUSED | u32::from(Errno::FAULT.0);
        match next {
            _ if call.vector() != FILES => fault,
            Answer::Refused(errno) => REFUSED | u32::from(errno.0),
            // A window that is gone answers nobody.
            next => self.answer(call, next).unwrap_or(fault),
        }
    }

    fn answer(&self, call: &Call<'_>, next: Answer) -> Result<u32, AccessError> {
        // This service reads the slot, also for a message that says what has changed in it.
        let at = |offset: u32| (call.data() & !again::BITS).wrapping_add(offset);
        let mut words = [0; slot::REQUEST_WORDS];
        for (word, offset) in words.iter_mut().zip((0..).step_by(4)) {
            *word = self.theirs.word(at(offset))?;
        }
        let Some(request) = RequestSlot::from_words(&words) else {
            return Ok(REFUSED | u32::from(Errno::INVAL.0));
        };
        // The handler of the client answers while the client waits.
        let table = call.send_with_reply(call.sender(), OPEN_FILES, 0, PATIENCE);
        if table.unwrap_or(NONE) == NONE {
            return Ok(REFUSED | u32::from(Errno::AGAIN.0));
        }
        let (errno, value) = match next {
            Answer::Failed(errno) => (errno.0, 0),
            _ => (0, self.carry_out(&request)?),
        };
        let is_directory = request.flags & condor_fs::wire::open::DIRECTORY != 0;
        let status = FileStatus {
            size: CONTENT.len() as u64,
            mode: if is_directory { 0o040_755 } else { 0o100_644 },
            links: 1,
            ..FileStatus::default()
        };
        self.theirs.set_word(at(slot::ERRNO), errno.into())?;
        self.put(at(slot::VALUE), &halves(value))?;
        self.put(at(slot::STATUS), &status.to_words())?;
        let [session, sequence] = [request.session, request.sequence].map(halves);
        self.put(at(slot::STATE_SESSION), &session)?;
        self.put(at(slot::STATE_SEQUENCE), &sequence)?;
        self.theirs.set_word(at(slot::STATE), state::DONE)?;
        Ok(DONE)
    }

    /// Carries out a request; returns the result that it has if all is well.
    fn carry_out(&self, request: &RequestSlot) -> Result<u64, AccessError> {
        let (buffer, position) = (request.buffer, request.position);
        Ok(match Operation::from_word(request.operation) {
            Some(Operation::Session) => 1,
            Some(Operation::Write | Operation::Append) => buffer.len.into(),
            Some(Operation::Read) => {
                let from = usize::try_from(position).unwrap_or(usize::MAX);
                let rest = CONTENT.get(from..).unwrap_or_default();
                let bytes = rest.get(..buffer.len as usize).unwrap_or(rest);
                self.theirs.write(buffer.offset, bytes)?;
                bytes.len() as u64
            }
            Some(Operation::ReadDirectory) => {
                let entry = usize::try_from(position)
                    .ok()
                    .and_then(|it| ENTRIES.get(it));
                let Some(entry) = entry else { return Ok(0) };
                self.put(buffer.offset, entry)?;
                let [_, _, _, len, ..] = entry;
                (HEAD + len.next_multiple_of(4)).into()
            }
            _ => 0,
        })
    }

    fn put(&self, at: u32, words: &[u32]) -> Result<(), AccessError> {
        for (word, at) in words.iter().zip((at..).step_by(4)) {
            self.theirs.set_word(at, *word)?;
        }
        Ok(())
    }
}
