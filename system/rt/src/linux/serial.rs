//! [`SerialPort`]: a serial port of Linux as a 16550 of a process.

use core::cell::RefCell;
use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use condor_dev::sim::{LineFault, Model as _, UartModel};
use condor_dev::{BusAccessError, BusErrorKind, Width};
use condor_mbox::linux::LinuxWindow;
use critical_section::Mutex;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::termios::{ControlModes, OptionalActions, Termios, tcgetattr, tcsetattr};

use super::bell::ProcessBell;
use crate::lines::{BoardLines, LineState, SERIAL, SERIAL_VECTOR};

/// The speed of the line for a divisor of 1, that of a board with a clock of 1.8432 MHz, in baud.
const FASTEST_BAUD: u32 = 115_200;
/// The time between two looks at a line for which the board has no room. An access of the program looks, too.
const NO_ROOM: Duration = Duration::from_millis(5);
/// The longest wait for the line.
const NAP: Duration = Duration::from_millis(100);

/// The lines of a process.
type Lines = BoardLines<LinuxWindow, ProcessBell, Arc<LineState>>;

/// A terminal device of Linux, such as `/dev/ttyUSB0`, behind the registers of a 16550 at [`SERIAL`]. Bytes move at each
/// access of the program, and when the line has some.
#[derive(Debug)]
pub(super) struct SerialPort {
    path: PathBuf,
    tty: OwnedFd,
    lines: Lines,
    /// In critical sections alone: servo loops access it, too, which may run in signals.
    board: Mutex<RefCell<Board>>,
}

#[derive(Debug)]
struct Board {
    model: UartModel,
    /// Whether it asks for its interrupt.
    asks: bool,
    /// Sent by the board, and not yet taken by the line.
    unsent: Option<u8>,
    /// The format and the divisor that the line has.
    set: (u8, u16),
    failed: Option<Errno>,
}

impl SerialPort {
    /// Opens the device for a processor with these lines.
    pub(super) fn open(path: &Path, lines: Lines) -> rustix::io::Result<Self> {
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let tty = rustix::fs::open(path, flags, Mode::empty())?;
        let set = (0b11, 1);
        configure(&tty, set)?;
        let board = Board {
            model: UartModel::default(),
            asks: false,
            unsent: None,
            set,
            failed: None,
        };
        Ok(Self {
            path: path.to_owned(),
            tty,
            lines,
            board: Mutex::new(RefCell::new(board)),
        })
    }

    /// Returns the offset of a register, if the port is at `address`.
    pub(super) const fn register(address: usize) -> Option<usize> {
        match address.checked_sub(SERIAL.base()) {
            Some(offset @ 0..8) => Some(offset),
            _ => None,
        }
    }

    pub(super) fn read(&self, register: usize, width: Width) -> Result<u32, BusAccessError> {
        self.access(register, |model| model.read(register, width))
    }

    pub(super) fn write(
        &self,
        register: usize,
        width: Width,
        value: u32,
    ) -> Result<(), BusAccessError> {
        self.access(register, |model| model.write(register, width, value))
    }

    fn access<R>(
        &self,
        register: usize,
        access: impl FnOnce(&mut UartModel) -> Option<R>,
    ) -> Result<R, BusAccessError> {
        let result = self.with(|board| {
            let result = access(&mut board.model);
            board.follow(&self.tty);
            result
        });
        // The registers have one byte.
        result.ok_or(BusAccessError {
            address: SERIAL.base() + register,
            kind: BusErrorKind::NoAnswer,
        })
    }

    /// Changes the board, moves bytes before and after, and sets its interrupt's line.
    fn with<R>(&self, change: impl FnOnce(&mut Board) -> R) -> R {
        critical_section::with(|section| {
            let mut board = self.board.borrow_ref_mut(section);
            board.receive(&self.tty);
            let result = change(&mut board);
            board.send(&self.tty);
            board.receive(&self.tty);
            let asks = board.model.interrupts();
            if asks != board.asks {
                board.asks = asks;
                self.lines.set_level(SERIAL_VECTOR, asks);
            }
            result
        })
    }

    /// Has the board interrupt again if it still asks, after its interrupt was served.
    pub(super) fn look_again(&self) {
        self.with(|board| {
            if board.asks {
                self.lines.set_level(SERIAL_VECTOR, true);
            }
        });
    }

    /// Moves bytes whenever the line has some, until `ended`.
    pub(super) fn attend(&self, ended: &AtomicBool) {
        let mut was_told = false;
        while !ended.load(Ordering::Relaxed) {
            let (events, patience) = self.with(|board| board.awaits());
            let mut polled = [PollFd::new(&self.tty, events)];
            let patience_is_over = Timespec::try_from(patience).ok();
            let answer = poll(&mut polled, patience_is_over.as_ref());
            let failed = self.with(|board| board.failed);
            if let Some(error) = failed
                && !was_told
            {
                was_told = true;
                eprintln!(
                    "the serial port {} has failed: {error}; restart the program when it is back",
                    self.path.display()
                );
            }
            let [polled] = polled;
            let is_gone = polled.revents().intersects(PollFlags::HUP | PollFlags::ERR);
            if is_gone || answer.is_err() || failed.is_some() {
                // The line says so at once, again and again.
                std::thread::sleep(NAP);
            }
        }
    }
}

impl Board {
    /// Moves bytes from the line to the board.
    fn receive(&mut self, tty: &OwnedFd) {
        while self.failed.is_none() && self.model.has_room() {
            let mut byte = [0];
            match rustix::io::read(tty, &mut byte) {
                Ok(0) => self.failed = Some(Errno::PIPE),
                Ok(_) => {
                    let [byte] = byte;
                    self.model.receive(byte, LineFault::None);
                }
                Err(Errno::AGAIN) => break,
                Err(error) => self.fail(error),
            }
        }
    }

    /// Moves bytes from the board to the line.
    fn send(&mut self, tty: &OwnedFd) {
        while self.failed.is_none() {
            let Some(byte) = self.unsent.or_else(|| self.model.transmit()) else {
                break;
            };
            self.unsent = Some(byte);
            match rustix::io::write(tty, &[byte]) {
                Ok(0) | Err(Errno::AGAIN) => break,
                Ok(_) => self.unsent = None,
                Err(error) => self.fail(error),
            }
        }
    }

    /// Has the line follow a new format or speed of the board.
    fn follow(&mut self, tty: &OwnedFd) {
        let (format, divisor) = (self.model.line_control(), self.model.divisor());
        // While bit 7 is set, the divisor is being written.
        if format >> 7 != 0 || divisor == 0 || self.set == (format, divisor) {
            return;
        }
        self.set = (format, divisor);
        if let Err(error) = configure(tty, self.set) {
            self.fail(error);
        }
    }

    fn fail(&mut self, error: Errno) {
        if error != Errno::INTR {
            self.failed = Some(error);
        }
    }

    /// The events of the line that change something, and how long to wait for one.
    fn awaits(&self) -> (PollFlags, Duration) {
        let mut events = PollFlags::empty();
        events.set(PollFlags::IN, self.model.has_room());
        events.set(PollFlags::OUT, self.unsent.is_some());
        let patience = if self.model.has_room() { NAP } else { NO_ROOM };
        (events, patience)
    }
}

/// Has a terminal device pass all bytes on as they are, with the format and the speed of a 16550.
fn configure(tty: &OwnedFd, (format, divisor): (u8, u16)) -> rustix::io::Result<()> {
    let mut settings: Termios = tcgetattr(tty)?;
    settings.make_raw();
    let modes = &mut settings.control_modes;
    // Registers of the PC16550D (data sheet, section 8.1).
    modes.remove(ControlModes::CSIZE);
    modes.insert(match format & 0b11 {
        0b00 => ControlModes::CS5,
        0b01 => ControlModes::CS6,
        0b10 => ControlModes::CS7,
        _ => ControlModes::CS8,
    });
    modes.set(ControlModes::CSTOPB, format & 0b100 != 0);
    modes.set(ControlModes::PARENB, format & 0b1000 != 0);
    modes.set(ControlModes::PARODD, format & 0b1_0000 == 0);
    modes.insert(ControlModes::CLOCAL | ControlModes::CREAD);
    settings.set_speed(FASTEST_BAUD / u32::from(divisor.max(1)))?;
    tcsetattr(tty, OptionalActions::Now, &settings)
}
