//! A file and a terminal by the names and descriptors of one device switch.

use condor_dev::stdio::{BufReader, ReadLine as _};
use condor_dev::stream::{Descriptors as _, DeviceStream, looks};
use condor_dev::{FdError, IoError, Location, Mmio, NoInterrupts, OpenMode, Switch, device_switch};
use condor_fs::dev::FileSwitch;
use condor_mbox::CriticalSection;
use condor_tty::dev::{AnyTerminal, TerminalBoard, TerminalTable};
use firmware::Checks;

use crate::ends::{Ends, FILES, Once};
use crate::files::System;
use crate::{Mail, Told, Window};

/// The places of terminals: one is at 0.
pub(crate) struct Panel;

static BOARD: Once<TerminalBoard<'static, Window, CriticalSection, Mail, 16>> = Once::new();

impl TerminalTable for Panel {
    fn terminal(place: usize) -> Option<&'static dyn AnyTerminal> {
        let board = BOARD.get().filter(|_| place == 0)?;
        Some(board)
    }
}

device_switch! {
    pub(crate) struct Boards {
        tty: condor_tty::dev::Tty<Panel> = [Location::at(0), Location::at(1)],
    }
}

/// Descriptors of boards.
const BOARDS: usize = 2;

pub(crate) type Devices = Switch<Mmio, NoInterrupts, Boards, BOARDS>;
pub(crate) type Files<'d> =
    FileSwitch<'d, 'static, Mmio, NoInterrupts, Boards, Mail, Window, BOARDS, FILES>;

/// Opens a file and a terminal, and uses both in the same way.
#[inline(never)]
pub(crate) fn switch(checks: &mut Checks, ends: &'static Ends, system: System) -> Result<(), Told> {
    checks.group("descriptors");
    BOARD.fill(TerminalBoard::new(&ends.terminal, &ends.hand));
    // SAFETY: no address is in the bus: terminals are behind none.
    let nothing = unsafe { Mmio::new(0, 0) };
    let devices = Devices::new(nothing, NoInterrupts, Boards::new());
    devices.start();
    let switch = Files::new(&devices, system);
    checks.that(switch.open(":tty", 1, OpenMode::READ).is_err());
    let both = OpenMode::READ | OpenMode::WRITE;
    let log = switch.open(":fs/log", 0, both)?;
    let terminal = switch.open(":tty", 0, both)?;
    checks.same(usize::from(log.number()), BOARDS);
    for fd in [log, terminal] {
        checks.same(switch.write(fd, b"slack\n"), Ok(6));
    }
    checks.same(switch.read(terminal, &mut [0; 4]), Err(IoError::WouldBlock));
    checks.same(switch.close(terminal), Ok(()));
    checks.same(switch.close(log), Ok(()));
    let closed = FdError::Closed { fd: log };
    checks.same(switch.write(log, b"x"), Err(closed.into()));
    let fd = switch.open(":fs/log", 0, OpenMode::READ)?;
    let mut lines = BufReader::<_, 16>::new(DeviceStream::new(&switch, fd, looks(0)));
    let mut line = [0; 32];
    checks.same(lines.read_line(&mut line).ok(), Some("tendon 3 is slack\n"));
    checks.same(switch.close(fd), Ok(()));
    Ok(())
}
