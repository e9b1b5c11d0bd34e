//! Files and a terminal by the names and descriptors of one device switch.

use checks::Checks;
use condor_dev::stdio::{BufReader, ReadLine as _};
use condor_dev::stream::Descriptors as _;
use condor_dev::stream::{DeviceStream, looks};
use condor_dev::{BusError as _, BusErrorKind, Fd, FdError, IoError, NoInterrupts, OpenMode};
use condor_fs::dev::{FileOpenError, FileSwitch, TransferError};
use condor_fs::{Errno, FileError, OpenOptions};
use embedded_io::SeekFrom;

use crate::bell::Mail;
use crate::boards::{BOTH, Boards, Devices};
use crate::calls::System;
use crate::memory::Window;
use crate::nothing::Nothing;
use crate::pair::{FILES, Pair};
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
    let refused = switch.open(":fs/none", 0, OpenMode::READ).err();
    let error = FileError::Errno(Errno::NOENT);
    let name = ":fs/none";
    checks.same(refused, Some(FileOpenError::File { name, error }));
    for (name, board, mode, text) in [
        (
            "toaster",
            0,
            OpenMode::READ,
            "there is no device toaster; the devices are: tty",
        ),
        (
            "fs/run",
            1,
            OpenMode::READ,
            "there is no fs/run board 1: the program has 1, numbered from 0",
        ),
        (
            "fs/run",
            0,
            OpenMode::empty(),
            "fs/run cannot be opened for nothing; ask for reading or writing, as it allows",
        ),
    ] {
        let error = switch.open(name, board, mode).err();
        let told = error.map(|error| Text::<80>::of(&error));
        checks.that(told.is_some_and(|told| told.bytes() == text.as_bytes()));
    }
    let log = switch.open(":fs/log", 0, OpenMode::WRITE)?;
    let terminal = switch.open(":tty", 0, BOTH)?;
    checks.same(usize::from(log.number()), BOARDS);
    for fd in [log, terminal] {
        checks.same(switch.write_ready(fd), Ok(true));
        checks.same(switch.write(fd, b"slack\n"), Ok(6));
        checks.same(switch.is_flushed(fd), Ok(true));
    }
    checks.same(switch.read(terminal, &mut [0; 4]), Err(IoError::WouldBlock));
    checks.same(switch.close(terminal), Ok(()));

    refusals(checks, pair, &switch, log);
    let fd = switch.open_file("log", OpenOptions::new().read())?;
    checks.same(switch.read_ready(fd), Ok(true));
    let at = switch.with_file(fd, |file| file.seek(SeekFrom::Start(12)));
    checks.same(at, Ok(12));
    let mut lines = BufReader::<_, 16>::new(DeviceStream::new(&switch, fd, looks(0)));
    let mut line = [0; 16];
    checks.same(lines.read_line(&mut line).ok(), Some("slack\n"));
    checks.same(lines.read_line(&mut line).ok(), Some(""));
    let stale = FdError::Closed { fd: log };
    checks.same(switch.close(log), Err(stale.into()));
    switch.close(fd)?;
    Ok(())
}

/// Checks calls that a file refuses which is open for writing; closes it.
fn refusals(checks: &mut Checks<'_>, pair: &Pair<'_>, switch: &Files<'_, '_>, log: Fd) {
    let (wanted, opened) = (OpenMode::READ, OpenMode::WRITE);
    let direction = FdError::Direction {
        fd: log,
        wanted,
        opened,
    };
    checks.same(switch.read(log, &mut [0; 4]), Err(direction.into()));
    let inside = switch.with_system(|_| switch.write(log, b"x"));
    checks.same(inside, Some(Err(IoError::WouldBlock)));
    pair.files.fail(Errno::ROFS);
    let Err(IoError::Bus(error)) = switch.write(log, b"x") else {
        checks.that(false);
        return;
    };
    checks.same(error.kind(), BusErrorKind::ReadOnly);
    let told = Text::<40>::of(&error);
    checks.same(told.bytes(), b"Read-only (EROFS)");
    let device = TransferError::Device(BusErrorKind::NoAnswer);
    checks.same(Text::<40>::of(&device).bytes(), b"no device answers");
    checks.same(switch.close(log), Ok(()));
    let closed = FdError::Closed { fd: log };
    checks.same(switch.write(log, b"x"), Err(closed.into()));
}
