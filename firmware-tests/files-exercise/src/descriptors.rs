//! Files and a terminal by the names and descriptors of one device switch.

use checks::Checks;
use condor_dev::stdio::{BufReader, ReadLine as _};
use condor_dev::{
    BusError as _, BusErrorKind, Descriptors as _, Fd, FdError, IoError, Mode, NoInterrupts,
    Stream, looks,
};
use condor_fs::dev::{FileSwitch, OpenError, TransferError};
use condor_fs::{Errno, Error, OpenOptions};
use embedded_io::SeekFrom;

use crate::boards::{BOTH, Boards, Devices};
use crate::calls::System;
use crate::nothing::Nothing;
use crate::pair::{FILES, Mail, Pair, Window};
use crate::text::Text;
use crate::trouble::Trouble;

/// Descriptors of boards.
const BOARDS: usize = 2;

type Files<'d, 'p> =
    FileSwitch<'d, 'p, Nothing, NoInterrupts, Boards, Mail<'p>, Window, BOARDS, FILES>;

/// Opens files and a terminal, and uses both in the same way.
#[inline(never)]
pub(crate) fn descriptors<'p>(
    checks: &mut Checks<'_>,
    pair: &Pair<'p>,
    devices: &Devices,
    system: System<'p>,
) -> Result<(), Trouble> {
    checks.group("files by their names");
    let switch = Files::new(devices, system);
    pair.files.fail(Errno::NOENT);
    let refused = switch.open(":fs/none", 0, Mode::READ).err();
    let error = Error::Errno(Errno::NOENT);
    let name = ":fs/none";
    checks.same(
        "a file's error has its number",
        refused,
        Some(OpenError::File { name, error }),
    );
    for (name, board, mode, text) in [
        (
            "toaster",
            0,
            Mode::READ,
            "there is no device toaster; there are: tty",
        ),
        (
            "fs/run",
            1,
            Mode::READ,
            "there is no fs/run board 1: there may be 1",
        ),
        (
            "fs/run",
            0,
            Mode::empty(),
            "fs/run cannot be opened for Mode(0x0)",
        ),
    ] {
        let error = switch.open(name, board, mode).err();
        let told = error.map(|error| Text::<80>::of(&error));
        checks.that(
            text,
            told.is_some_and(|told| told.bytes() == text.as_bytes()),
        );
    }
    let log = switch.open(":fs/log", 0, Mode::WRITE)?;
    let terminal = switch.open(":tty", 0, BOTH)?;
    checks.same(
        "files have the numbers behind those of boards",
        usize::from(log.number()),
        BOARDS,
    );
    for fd in [log, terminal] {
        checks.same("it can be written", switch.write_ready(fd), Ok(true));
        checks.same("it is", switch.write(fd, b"slack\n"), Ok(6));
        checks.same("nothing is held back", switch.is_flushed(fd), Ok(true));
    }
    let typed = switch.read(terminal, &mut [0; 4]);
    checks.same("nobody types", typed, Err(IoError::WouldBlock));
    checks.same("the terminal is closed", switch.close(terminal), Ok(()));

    refusals(checks, pair, &switch, log);
    let fd = switch.open_file("log", OpenOptions::new().read())?;
    checks.same("it can be read", switch.read_ready(fd), Ok(true));
    let at = switch.with_file(fd, |file| file.seek(SeekFrom::Start(12)));
    checks.same("files alone seek", at, Ok(12));
    let mut lines = BufReader::<_, 16>::new(Stream::new(&switch, fd, looks(0)));
    let mut line = [0; 16];
    checks.same(
        "a line is read",
        lines.read_line(&mut line).ok(),
        Some("slack\n"),
    );
    checks.same("and no more", lines.read_line(&mut line).ok(), Some(""));
    let stale = FdError::Closed { fd: log };
    checks.same(
        "a number is used again",
        switch.close(log),
        Err(stale.into()),
    );
    switch.close(fd)?;
    Ok(())
}

/// What cannot be done with a file that is open for writing; closes it.
fn refusals(checks: &mut Checks<'_>, pair: &Pair<'_>, switch: &Files<'_, '_>, log: Fd) {
    let (wanted, opened) = (Mode::READ, Mode::WRITE);
    let direction = FdError::Direction {
        fd: log,
        wanted,
        opened,
    };
    let read = switch.read(log, &mut [0; 4]);
    checks.same("it is not read", read, Err(direction.into()));
    let inside = switch.with_system(|_| switch.write(log, b"x"));
    checks.same(
        "nobody waits in another one's use",
        inside,
        Some(Err(IoError::WouldBlock)),
    );
    pair.files.fail(Errno::ROFS);
    let Err(IoError::Bus(error)) = switch.write(log, b"x") else {
        checks.that("a failure is told", false);
        return;
    };
    checks.same(
        "an error has its kind",
        error.kind(),
        BusErrorKind::ReadOnly,
    );
    let told = Text::<40>::of(&error);
    checks.same("for people", told.bytes(), b"Read-only (EROFS)");
    let device = TransferError::Device(BusErrorKind::NoAnswer);
    checks.same(
        "a board's, too",
        Text::<40>::of(&device).bytes(),
        b"nothing answers",
    );
    checks.same("it is closed", switch.close(log), Ok(()));
    let closed = FdError::Closed { fd: log };
    checks.same(
        "and not written any more",
        switch.write(log, b"x"),
        Err(closed.into()),
    );
}
