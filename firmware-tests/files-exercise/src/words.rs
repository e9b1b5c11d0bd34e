//! Words of the two layouts, and errors as people read them.

use core::fmt::Write as _;

use checks::Checks;
use condor_fs::wire::{self, Evidence, Operation, Request, Span, slot};
use condor_fs::{Errno, Error, Kept, Status};
use condor_mbox::window::WindowErrorKind;
use condor_mbox::{AccessError, Error as MailError, Vector};
use condor_tty::layout::{self, MAX_CAPACITY, MIN_CAPACITY};
use condor_tty::{ConsoleError, Policy, PolicyKind, ReaderError, TerminalError, Vectors};
use embedded_io::{Error as _, ErrorKind};

use crate::memory::{HAND, HOST};
use crate::pair::{PATIENCE, Window};
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

/// What needs neither a window nor a mailbox.
#[inline(never)]
pub(crate) fn words(checks: &mut Checks<'_>) {
    checks.group("words");
    of_files(checks);
    of_terminals(checks);
    checks.group("errors");
    errors_of_files(checks);
    errors_of_terminals(checks);
}

fn of_files(checks: &mut Checks<'_>) {
    let request = Request {
        session: wire::whole(1, 2),
        sequence: wire::whole(3, 12),
        operation: Operation::Rename as u32,
        flags: wire::rename::NO_REPLACE,
        handle: wire::whole(4, 13),
        file: 5,
        path: Span { offset: 6, len: 7 },
        second_path: Span { offset: 8, len: 9 },
        position: u64::MAX - 1,
        buffer: Span {
            offset: 10,
            len: 11,
        },
    };
    let mut words = request.to_words();
    checks.same(
        "a request comes back",
        Request::from_words(&words),
        Some(request),
    );
    if let Some(magic) = words.first_mut() {
        *magic = !slot::MAGIC;
    }
    checks.same("not without its magic", Request::from_words(&words), None);
    let known = Operation::ALL
        .into_iter()
        .all(|operation| Operation::from_word(operation as u32) == Some(operation));
    checks.that("operations have numbers", known);
    checks.same("no others", Operation::from_word(16), None);
    let words = [1, 2, 3, 4, 5, 6, 7, 0];
    checks.same(
        "evidence comes back",
        Evidence::from_words(&words).to_words(),
        words,
    );
    let status = Status::from_words(&words);
    checks.same("and status", status.to_words(), words);
    checks.that(
        "which may be of neither",
        !status.is_file() && !status.is_directory(),
    );
}

fn of_terminals(checks: &mut Checks<'_>) {
    let policies = [
        (Policy::Block { timeout: PATIENCE }, PolicyKind::Block),
        (Policy::DropNew, PolicyKind::DropNew),
        (Policy::DropOld, PolicyKind::DropOld),
    ];
    let come_back = policies.into_iter().all(|(policy, kind)| {
        policy.kind() == kind && PolicyKind::from_word(kind.word()) == Some(kind)
    });
    checks.that("policies come back", come_back);
    checks.same("no others", PolicyKind::from_word(3), None);
    checks.same(
        "a character is packed",
        layout::input_data(0x1040, b'q'),
        0x4171,
    );
    let offsets = [0, 64, 65, 1 << 30].map(layout::is_offset);
    checks.same("offsets are told", offsets, [true, true, false, false]);
    let sizes = [MIN_CAPACITY, MIN_CAPACITY / 2, 100, MAX_CAPACITY].map(layout::is_capacity);
    checks.same("so are capacities", sizes, [true, false, false, true]);
    checks.same(
        "vectors have defaults",
        Vectors::default(),
        Vectors::DEFAULT,
    );
}

fn errors_of_files(checks: &mut Checks<'_>) {
    let mut reads = |error: Error, text: &str, kind: ErrorKind| {
        let kept: Kept<Window> = Kept {
            error,
            buffer: None,
        };
        let same = Text::<96>::of(&error).bytes() == text.as_bytes()
            && Text::of(&kept) == Text::<96>::of(&error);
        checks.that(text, same && error.kind() == kind);
    };
    let late = |cause| Error::TimedOut {
        server: HOST,
        cause,
    };
    reads(
        Errno::NOENT.into(),
        "No such file or directory (ENOENT)",
        ErrorKind::NotFound,
    );
    reads(
        Errno::ROFS.into(),
        "Read-only (EROFS)",
        ErrorKind::PermissionDenied,
    );
    reads(
        Errno::EXIST.into(),
        "File exists (EEXIST)",
        ErrorKind::AlreadyExists,
    );
    reads(
        Errno::BADF.into(),
        "Not open, or not for this (EBADF)",
        ErrorKind::InvalidInput,
    );
    reads(
        Errno::MFILE.into(),
        "Too many open files (EMFILE)",
        ErrorKind::OutOfMemory,
    );
    reads(
        Errno::INTR.into(),
        "Interrupted (EINTR)",
        ErrorKind::Interrupted,
    );
    reads(Errno(999).into(), "error 999", ErrorKind::Other);
    let text = "the file server, processor 0, did not answer in time";
    reads(late(None), text, ErrorKind::TimedOut);
    let text = "the file server, processor 0, did not answer in time: processor 1 has no handler for vector 40";
    reads(late(Some(NOBODY)), text, ErrorKind::TimedOut);
    let before = Error::NotBegun {
        server: HOST,
        cause: None,
    };
    let text = "the file server, processor 0, has not answered what was asked before in time";
    reads(before, text, ErrorKind::TimedOut);
    reads(
        NOBODY.into(),
        "processor 1 has no handler for vector 40",
        ErrorKind::NotConnected,
    );
    reads(
        ACCESS.into(),
        "4 bytes at offset 0x40 of 0x20: OutOfBounds",
        ErrorKind::Other,
    );
    checks.same("what is late has no number", late(None).errno(), None);
    checks.same("numbers have names", Errno::STALE.name(), Some("ESTALE"));
    checks.same("not all of them", Errno(999).name(), None);
    checks.same("and meanings", Errno::NOSPC.meaning(), "No space left");
    let mut text = Text::<32>::new();
    // It takes everything.
    let _ = write!(text, "{:?} {:?}", Errno::PERM, Errno(0));
    checks.same("both for programmers", text.bytes(), b"EPERM Errno(0)");
}

fn errors_of_terminals(checks: &mut Checks<'_>) {
    let mut reads = |error: &dyn core::fmt::Display, text: &str| {
        checks.that(text, Text::<96>::of(error).bytes() == text.as_bytes());
    };
    let (offset, life, magic, version) = (0x40, 2, 0xbad, 3);
    reads(
        &TerminalError::from(ACCESS),
        "4 bytes at offset 0x40 of 0x20: OutOfBounds",
    );
    reads(
        &TerminalError::Capacity { capacity: 100 },
        "100 bytes are no power of two from 8 to 1073741824",
    );
    reads(
        &TerminalError::Offset { offset },
        "offset 0x40 is no multiple of 64 below 2^30",
    );
    reads(
        &ReaderError::from(ACCESS),
        "4 bytes at offset 0x40 of 0x20: OutOfBounds",
    );
    reads(
        &ReaderError::NoTerminal {
            offset,
            magic,
            version,
        },
        "no terminal of version 1 and magic 0x59545443 at offset 0x40: found version 3 and magic 0xbad",
    );
    reads(
        &ReaderError::NotReady { offset },
        "the terminal at offset 0x40 is not ready",
    );
    reads(
        &ReaderError::Restarted { offset, life },
        "the terminal at offset 0x40 has a new life, 2",
    );
    let attached = 0x102;
    reads(
        &ReaderError::Displaced { offset, attached },
        "another host is attached to the terminal at offset 0x40: 0x102",
    );
    let (word, value) = (20, 0xff);
    reads(
        &ReaderError::Broken {
            offset,
            word,
            value,
        },
        "the terminal at offset 0x40 is broken: word 20 is 0xff",
    );
    for (error, text, kind) in [
        (
            ConsoleError::TimedOut { lost: 7 },
            "timed out, and 7 bytes were given up",
            ErrorKind::TimedOut,
        ),
        (
            ConsoleError::Interrupted,
            "interrupted from the keyboard",
            ErrorKind::Interrupted,
        ),
        (
            ACCESS.into(),
            "4 bytes at offset 0x40 of 0x20: OutOfBounds",
            ErrorKind::Other,
        ),
        (
            NOBODY.into(),
            "processor 1 has no handler for vector 40",
            ErrorKind::Other,
        ),
    ] {
        let same = Text::<96>::of(&error).bytes() == text.as_bytes();
        checks.that(text, same && error.kind() == kind);
    }
}
