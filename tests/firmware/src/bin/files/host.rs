//! The host: a file service that answers from a script, and somebody who types.
//!
//! The service keeps no files. It takes a request out of the client's slot, asks for the client's table as a
//! service does, and answers. A read gets the [`CONTENT`] from the request's position on, and a write takes all
//! bytes.

use core::cell::Cell;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use core::time::Duration;

use condor_fs::wire::{
    DONE, NONE, OPEN_FILES, Operation, REFUSED, RequestSlot, again, halves, slot, state,
};
use condor_fs::{Errno, FileStatus};
use condor_mbox::{AccessError, Call, MemoryWindow as _, Messenger as _, Region};
use condor_tty::TerminalVectors;
use condor_tty::layout::{input_data, reply};
use critical_section::Mutex;

use crate::{HAND, Mail, PATIENCE, Tty, Window};

/// The content of all files.
pub(crate) const CONTENT: &[u8] = b"tendon 3 is slack\n";

/// The error with which the next request fails; 0 if it must not.
static NEXT: AtomicU32 = AtomicU32::new(0);
/// The bytes that are yet to be typed.
static TYPING: Mutex<Cell<&[u8]>> = Mutex::new(Cell::new(b""));

/// Lets the next request fail.
pub(crate) fn fail(errno: Errno) {
    NEXT.store(errno.0.into(), Relaxed);
}

/// Lets somebody type.
pub(crate) fn types(text: &'static [u8]) {
    critical_section::with(|token| TYPING.borrow(token).set(text));
}

/// Types the next character.
pub(crate) fn type_one(host: &Mail, terminal: &Tty) {
    let typing = critical_section::with(|token| TYPING.borrow(token).get());
    if let Some((character, rest)) = typing.split_first() {
        let input = input_data(terminal.offset(), *character);
        let vector = TerminalVectors::DEFAULT.input;
        let taken = host.send_with_reply(HAND, vector, input, PATIENCE);
        if taken == Ok(reply::ACCEPTED) {
            types(rest);
        }
    }
}

/// Serves requests for files; `theirs` is the users' part of the client's `data`.
pub(crate) fn serve(call: &Call<'_>, theirs: &Region<Window>) -> u32 {
    // A window that is gone answers nobody.
    answer(call, theirs).unwrap_or(REFUSED | u32::from(Errno::FAULT.0))
}

fn answer(call: &Call<'_>, theirs: &Region<Window>) -> Result<u32, AccessError> {
    // This service reads the slot, also for a message that says what has changed in it.
    let at = |offset: u32| (call.data() & !again::BITS).wrapping_add(offset);
    let mut words = [0; slot::REQUEST_WORDS];
    for (word, offset) in words.iter_mut().zip((0..).step_by(4)) {
        *word = theirs.word(at(offset))?;
    }
    let Some(request) = RequestSlot::from_words(&words) else {
        return Ok(REFUSED | u32::from(Errno::INVAL.0));
    };
    // The handler of the client answers while the client waits.
    let table = call.send_with_reply(call.sender(), OPEN_FILES, 0, Duration::from_secs(1));
    if table.unwrap_or(NONE) == NONE {
        return Ok(REFUSED | u32::from(Errno::AGAIN.0));
    }
    let errno = NEXT.load(Relaxed);
    NEXT.store(0, Relaxed);
    let value = if errno == 0 {
        carry_out(theirs, &request)?
    } else {
        0
    };
    let status = FileStatus {
        size: CONTENT.len() as u64,
        mode: 0o100_644,
        links: 1,
        ..FileStatus::default()
    };
    theirs.set_word(at(slot::ERRNO), errno)?;
    put(theirs, at(slot::VALUE), &halves(value))?;
    put(theirs, at(slot::STATUS), &status.to_words())?;
    let [session, sequence] = [request.session, request.sequence].map(halves);
    put(theirs, at(slot::STATE_SESSION), &session)?;
    put(theirs, at(slot::STATE_SEQUENCE), &sequence)?;
    theirs.set_word(at(slot::STATE), state::DONE)?;
    Ok(DONE)
}

/// Carries out a request; returns the result that it has if all is well.
fn carry_out(theirs: &Region<Window>, request: &RequestSlot) -> Result<u64, AccessError> {
    let buffer = request.buffer;
    Ok(match Operation::from_word(request.operation) {
        Some(Operation::Session) => 1,
        Some(Operation::Write | Operation::Append) => buffer.len.into(),
        Some(Operation::Read) => {
            let from = usize::try_from(request.position).unwrap_or(usize::MAX);
            let rest = CONTENT.get(from..).unwrap_or_default();
            let bytes = rest.get(..buffer.len as usize).unwrap_or(rest);
            theirs.write(buffer.offset, bytes)?;
            bytes.len() as u64
        }
        _ => 0,
    })
}

fn put(theirs: &Region<Window>, at: u32, words: &[u32]) -> Result<(), AccessError> {
    for (word, at) in words.iter().zip((at..).step_by(4)) {
        theirs.set_word(at, *word)?;
    }
    Ok(())
}
