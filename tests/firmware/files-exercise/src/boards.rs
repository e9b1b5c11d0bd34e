//! Terminals as boards of a device switch.

use core::cell::Cell;

use checks::Checks;
use condor_dev::{
    Fd, FdError, IoError, Location, NoInterrupts, OpenError, OpenMode, Presence, Switch,
    device_switch,
};
use condor_mbox::{Allocator, CriticalSection};
use condor_tty::dev::{
    AnyTerminal, END_OF_FILE, INTERRUPTED, TerminalBoard, TerminalTable, UNREACHABLE,
};
use condor_tty::{Policy, TerminalReader};
use critical_section::Mutex;
use static_cell::StaticCell;

use crate::bell::PATIENCE;
use crate::memory::{HOST, Window};
use crate::nothing::Nothing;
use crate::pair::{AHEAD, Pair, RING, Tty};
use crate::post::Post;
use crate::trouble::Trouble;

type Board = TerminalBoard<'static, Window, CriticalSection, Post, AHEAD>;

static TERMINAL: StaticCell<Tty> = StaticCell::new();
static POST: Post = Post;
static BOARD: StaticCell<Board> = StaticCell::new();
static PANEL: Mutex<Cell<Option<&'static dyn AnyTerminal>>> = Mutex::new(Cell::new(None));

/// Returns the error of a value that the program has made before, although it may make it only once.
fn twice() -> Trouble {
    Trouble::new("made twice")
}

/// A place where a terminal comes and goes, and one where none ever is.
pub(crate) struct Panel;

impl TerminalTable for Panel {
    fn terminal(place: usize) -> Option<&'static dyn AnyTerminal> {
        critical_section::with(|token| PANEL.borrow(token).get()).filter(|_| place == 0)
    }
}

device_switch! {
    pub(crate) struct Boards {
        tty: condor_tty::dev::Tty<Panel> = [Location::at(0), Location::at(1)],
    }
}

pub(crate) type Devices = Switch<Nothing, NoInterrupts, Boards, 2>;

pub(crate) const BOTH: OpenMode = OpenMode::READ.union(OpenMode::WRITE);

fn put(board: Option<&'static dyn AnyTerminal>) {
    critical_section::with(|token| PANEL.borrow(token).set(board));
}

/// Opens, writes, reads and closes a terminal; returns the switch.
#[inline(never)]
pub(crate) fn boards(
    checks: &mut Checks<'_>,
    pair: &Pair<'_>,
    allocator: &mut Allocator,
) -> Result<Devices, Trouble> {
    checks.group("a terminal by its name");
    let devices = Devices::new(Nothing, NoInterrupts, Boards::new());
    devices.start();
    let absent = |board| OpenError::NotPresent {
        name: ":tty",
        board,
        presence: Presence::Absent,
    };
    checks.same(devices.open(":tty", 0, BOTH), Err(absent(0)));
    let terminal = Tty::new(pair.own, allocator, RING, CriticalSection)?;
    let terminal: &Tty = TERMINAL.try_init(terminal).ok_or_else(twice)?;
    let board = BOARD.try_init(TerminalBoard::new(terminal, &POST));
    let board: &Board = board.ok_or_else(twice)?;
    put(Some(board));
    devices.start();
    checks.same(devices.open(":tty", 1, BOTH), Err(absent(1)));
    let fd = devices.open(":tty", 0, BOTH)?;
    writing(checks, pair, &devices, (terminal, fd))?;
    reading(checks, &devices, (terminal, fd))?;

    put(None);
    let unreachable = Err(IoError::Device(UNREACHABLE));
    checks.same(devices.write(fd, b"x"), unreachable);
    checks.same(devices.read(fd, &mut [0; 4]), unreachable);
    let ready = (
        devices.read_ready(fd),
        devices.write_ready(fd),
        devices.is_flushed(fd),
    );
    checks.same(ready, (Ok(false), Ok(false), Ok(true)));
    put(Some(board));
    checks.same(devices.close(fd), Ok(()));
    checks.same(devices.write(fd, b"x"), Err(FdError::Closed { fd }.into()));
    Ok(devices)
}

/// Checks writes as long as there is room, and when there is none.
fn writing(
    checks: &mut Checks<'_>,
    pair: &Pair<'_>,
    devices: &Devices,
    (terminal, fd): (&Tty, Fd),
) -> Result<(), Trouble> {
    checks.same(devices.write(fd, b"hello\n"), Ok(6));
    checks.same(devices.is_flushed(fd), Ok(true));
    let mut reader = TerminalReader::attach(pair.own, terminal.offset(), HOST)?;
    let mut bytes = [0; 8];
    checks.same(reader.fetch(&mut bytes)?.len, 7);
    checks.same(bytes.get(..7), Some(&b"hello\r\n"[..]));
    reader.acknowledge(7)?;
    // The first incarnation at its place.
    checks.same((reader.position(), reader.incarnation() % 256), (7, 1));
    terminal.set_policy(Policy::Block { timeout: PATIENCE })?;
    checks.same(devices.write_ready(fd), Ok(true));
    checks.same(devices.write(fd, &[b'-'; 100]), Ok(64));
    checks.same(devices.write(fd, b"more"), Err(IoError::WouldBlock));
    checks.same(devices.is_flushed(fd), Ok(false));
    let mut bytes = [0; RING as usize];
    let len = reader.fetch(&mut bytes)?.len;
    checks.same((len, reader.acknowledge(len)), (64, Ok(true)));
    terminal.set_policy(Policy::DropNew)?;
    Ok(())
}

fn reading(
    checks: &mut Checks<'_>,
    devices: &Devices,
    (terminal, fd): (&Tty, Fd),
) -> Result<(), Trouble> {
    let mut bytes = [0; 8];
    let mut read = || devices.read(fd, &mut bytes);
    checks.same(devices.read_ready(fd), Ok(false));
    for character in *b"go\n\x04" {
        terminal.accept(character)?;
    }
    checks.same(devices.read_ready(fd), Ok(true));
    checks.same(read(), Ok(3));
    checks.same(read(), Err(IoError::Device(END_OF_FILE)));
    terminal.accept(3)?;
    checks.same(read(), Err(IoError::Device(INTERRUPTED)));
    checks.same(read(), Err(IoError::WouldBlock));
    checks.same(bytes.get(..3), Some(&b"go\n"[..]));
    Ok(())
}
