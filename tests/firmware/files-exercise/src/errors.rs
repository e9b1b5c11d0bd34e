//! Errors as people read them: each is printed, which must not panic.

use core::fmt::Display;

use checks::Checks;
use condor_fs::{BufferError, Errno, FileError, Receipt};
use condor_mbox::window::WindowErrorKind;
use condor_mbox::{AccessError, MailboxError as MailError, Vector};
use condor_tty::{ConsoleError, TerminalError, TerminalReaderError};
use embedded_io::{Error as _, ErrorKind};

use crate::memory::{HAND, HOST, Window};
use crate::text::Text;

const ACCESS: AccessError = AccessError {
    offset: 0x40,
    len: 4,
    size: 0x20,
    kind: WindowErrorKind::OutOfBounds,
};
const NOBODY: MailError = MailError::NoHandler {
    to: HAND,
    vector: Vector(40),
};

/// Prints one of each.
#[inline(never)]
pub(crate) fn errors(checks: &mut Checks<'_>) {
    checks.group("errors");
    let (server, cause) = (HOST, Some(NOBODY));
    let receipt = Receipt(7);
    let late = FileError::TimedOut {
        server,
        cause,
        receipt,
    };
    let (error, buffer) = (late, None);
    let kept: BufferError<Window> = BufferError { error, buffer };
    let (offset, incarnation, magic, version) = (0x40, 2, 0xbad, 3);
    let (attached, word, value) = (0x102, 20, 0xff);
    let ends: [(&dyn Display, &str); 13] = [
        (&FileError::from(Errno::NOENT), "(ENOENT)"),
        (&FileError::from(Errno(999)), "error 999"),
        (
            &late,
            "did not answer in time: processor 1 has no handler for vector 40",
        ),
        (
            &FileError::NotBegun {
                server,
                cause: None,
            },
            "has not answered the previous request in time",
        ),
        (&kept, "for vector 40"),
        (&FileError::from(ACCESS), "not wholly inside the window"),
        (
            &TerminalError::Capacity { capacity: 100 },
            "from 8 to 1073741824",
        ),
        (&TerminalError::Offset { offset }, "below 2^30"),
        (
            &TerminalReaderError::NoTerminal {
                offset,
                magic,
                version,
            },
            "found version 3 and magic 0xbad",
        ),
        (
            &TerminalReaderError::Restarted {
                offset,
                incarnation,
            },
            "as incarnation 2: attach to it again",
        ),
        (
            &TerminalReaderError::Displaced { offset, attached },
            "(its word there is 0x102): attach again to take it back",
        ),
        (
            &TerminalReaderError::Broken {
                offset,
                word,
                value,
            },
            "word 20 is 0xff",
        ),
        (&ConsoleError::TimedOut { lost: 7 }, "7 bytes were lost"),
    ];
    for (error, end) in ends {
        let text = Text::<128>::of(error);
        checks.that(text.bytes().ends_with(end.as_bytes()));
    }
    checks.same(late.kind(), ErrorKind::TimedOut);
    checks.same(ConsoleError::Interrupted.kind(), ErrorKind::Interrupted);
    checks.same(late.errno(), None);
    checks.same(Errno::STALE.name(), Some("ESTALE"));
    checks.same(Errno::NOSPC.meaning(), "No space left");
}
