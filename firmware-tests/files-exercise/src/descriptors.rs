//! Files by the names and descriptors of a device switch.

use core::fmt::Write as _;

use checks::Checks;
use condor_dev::stdio::{BufReader, ReadLine as _};
use condor_dev::{
    BusError as _, BusErrorKind, Descriptors as _, Fd, FdError, IoError, Looks, Mode, NoInterrupts,
    Stream,
};
use condor_fs::dev::{FileSwitch, OpenError, TransferError};
use condor_fs::{Errno, Error, OpenOptions};
use embedded_io::SeekFrom;

use crate::boards::{BOTH, Boards, Devices};
use crate::files::System;
use crate::nothing::Nothing;
use crate::pair::{FILES, Mail, PATIENCE, Pair, SHORT, Window};
use crate::text::Text;
use crate::trouble::Trouble;

/// Descriptors of boards.
const BOARDS: usize = 2;

type Files<'d, 'p> =
    FileSwitch<'d, 'p, Nothing, NoInterrupts, Boards, Mail<'p>, Window, BOARDS, FILES>;
type Outcome<T> = Result<T, IoError<TransferError<BusErrorKind>>>;

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
    names(checks, &switch);
    let log = switch.open(":fs/log", 0, Mode::WRITE)?;
    let terminal = switch.open(":tty", 0, BOTH)?;
    checks.same(
        "files have the numbers behind those of boards",
        (
            usize::from(terminal.number()) < BOARDS,
            usize::from(log.number()),
        ),
        (true, BOARDS),
    );
    for fd in [log, terminal] {
        checks.same("it can be written", switch.write_ready(fd), Ok(true));
        checks.same("it is", switch.write(fd, b"slack\n"), Ok(6));
        checks.same("nothing is held back", switch.is_flushed(fd), Ok(true));
    }
    let nothing = switch.read(terminal, &mut [0; 4]);
    checks.same("nobody types", nothing, Err(IoError::WouldBlock));
    checks.same("nor will soon", switch.read_ready(terminal), Ok(false));
    checks.same("the terminal is closed", switch.close(terminal), Ok(()));
    misuse(checks, &switch, log)?;
    reading(checks, &switch)?;
    errors(checks, pair, &switch)?;
    let unlinked = switch.with_system(|system| system.unlink("log"));
    checks.same("names are the system's", unlinked, Some(Ok(())));
    Ok(())
}

/// What is not opened.
fn names(checks: &mut Checks<'_>, switch: &Files<'_, '_>) {
    let refused = |name, board, mode| match switch.open(name, board, mode) {
        Ok(_) => Text::<80>::new(),
        Err(error) => Text::of(&error),
    };
    let exclusive = Mode::READ | Mode::EXCLUSIVE;
    for (name, board, mode, text) in [
        (
            "toaster",
            0,
            Mode::READ,
            "there is no device toaster; there are: tty",
        ),
        (
            ":fs/none",
            0,
            Mode::READ,
            ":fs/none: No such file or directory (ENOENT)",
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
            exclusive,
            "fs/run cannot be opened for Mode(READ | EXCLUSIVE)",
        ),
        (
            "fs/run",
            0,
            Mode::empty(),
            "fs/run cannot be opened for Mode(0x0)",
        ),
    ] {
        checks.same(text, refused(name, board, mode).bytes(), text.as_bytes());
    }
    let error = switch.open("fs/log/log", 0, Mode::READ).err();
    let (name, expected) = ("fs/log/log", Error::Errno(Errno::NOENT));
    checks.same(
        "a file's error has its number",
        error,
        Some(OpenError::File {
            name,
            error: expected,
        }),
    );
}

/// Of a file that is open for writing, and of one that is not open.
fn misuse(checks: &mut Checks<'_>, switch: &Files<'_, '_>, fd: Fd) -> Result<(), Trouble> {
    let (wanted, opened) = (Mode::READ, Mode::WRITE);
    let direction = FdError::Direction { fd, wanted, opened };
    checks.same(
        "it is not read",
        switch.read(fd, &mut [0; 4]),
        Err(direction.into()),
    );
    let inside = switch.with_system(|_| {
        (
            switch.write(fd, b"x"),
            switch.write_ready(fd),
            switch.close(fd),
            switch.open_file("log", OpenOptions::new().read()),
            switch.with_system(|_| ()),
        )
    });
    let busy = (
        Err(IoError::WouldBlock),
        Ok(false),
        Err(IoError::WouldBlock),
        Err(Errno::BUSY.into()),
        None,
    );
    checks.same("nobody waits in another one's use", inside, Some(busy));
    checks.same("it is closed", switch.close(fd), Ok(()));
    let closed = FdError::Closed { fd };
    checks.same(
        "and not written any more",
        switch.write(fd, b"x"),
        Err(closed.into()),
    );
    let again = switch.open("fs/log", 0, Mode::READ)?;
    checks.same("its number is used again", again.number(), fd.number());
    let stale = FdError::Stale { fd };
    checks.same("not its descriptor", switch.close(fd), Err(stale.into()));
    checks.same("only the latest", switch.close(again), Ok(()));
    let count = BOARDS + FILES;
    let fd = Fd::new(count as u16, 0);
    let none = FdError::NoSuchFd { fd, count };
    checks.same("nor others", switch.close(fd), Err(none.into()));
    Ok(())
}

/// Reads what was written, and changes it.
fn reading(checks: &mut Checks<'_>, switch: &Files<'_, '_>) -> Result<(), Trouble> {
    let both = OpenOptions::new().read().write();
    let fd = switch.open_file("log", both)?;
    checks.same("it can be read", switch.read_ready(fd), Ok(true));
    let mut bytes = [0; 8];
    checks.same("it is", switch.read(fd, &mut bytes), Ok(6));
    checks.same("to its end", switch.read(fd, &mut bytes), Err(IoError::End));
    checks.same(
        "which is no error for nobody",
        switch.read(fd, &mut []),
        Ok(0),
    );
    let at = switch.with_file(fd, |file| file.seek(SeekFrom::Start(0)));
    checks.same("files alone seek", at, Ok(0));
    switch.write(fd, b"S")?;
    switch.with_file(fd, |file| file.seek(SeekFrom::Start(0)))?;
    let mut lines = BufReader::<_, 16>::new(Stream::new(switch, fd, Looks(0)));
    let mut line = [0; 16];
    checks.same(
        "a line is read",
        lines.read_line(&mut line).ok(),
        Some("Slack\n"),
    );
    checks.same("and no more", lines.read_line(&mut line).ok(), Some(""));
    switch.close(fd)?;
    Ok(())
}

fn errors(checks: &mut Checks<'_>, pair: &Pair<'_>, switch: &Files<'_, '_>) -> Result<(), Trouble> {
    let fd = switch.open("fs/log", 0, Mode::WRITE)?;
    let written = |expected: &mut Option<Error>| -> Option<BusErrorKind> {
        let outcome: Outcome<usize> = switch.write(fd, b"x");
        let Err(IoError::Bus(error)) = outcome else {
            return None;
        };
        if let TransferError::File(error) = error {
            *expected = Some(error);
        }
        Some(error.kind())
    };
    let mut error = None;
    for (errno, kind) in [
        (Errno::ROFS, BusErrorKind::ReadOnly),
        (Errno::FBIG, BusErrorKind::OutOfRange),
        (Errno::IO, BusErrorKind::Lost),
    ] {
        pair.server.fail(errno);
        checks.same("an error has its kind", written(&mut error), Some(kind));
        checks.same("and its number", error, Some(errno.into()));
    }
    switch.with_system(|system| system.set_timeout(SHORT));
    pair.attentive.set(false);
    let late = written(&mut error);
    checks.same(
        "a late host does not answer",
        late,
        Some(BusErrorKind::NoAnswer),
    );
    pair.attentive.set(true);
    switch.with_system(|system| system.set_timeout(PATIENCE));
    let size = switch.with_file(fd, |file| Ok(file.status()?.size));
    checks.same("it has written once", size, Ok(7));
    let refused = switch.with_file(fd, |_| -> Result<(), Error> { Err(Errno::PERM.into()) });
    let refusal = TransferError::<BusErrorKind>::File(Errno::PERM.into());
    checks.same("so has any other call", refused, Err(IoError::Bus(refusal)));
    let mut text = Text::<80>::new();
    // It takes everything.
    let _ = write!(
        text,
        "{refusal}; {}",
        TransferError::Device(BusErrorKind::NoAnswer)
    );
    checks.same(
        "for people",
        text.bytes(),
        b"Operation not permitted (EPERM); nothing answers",
    );
    let kind = TransferError::Device(BusErrorKind::NoAnswer).kind();
    checks.same("a board's has its own", kind, BusErrorKind::NoAnswer);
    switch.close(fd)?;
    Ok(())
}
