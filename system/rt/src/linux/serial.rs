//! [`SerialPort`]: a serial port of Linux as a 16550 of a process.

use core::cell::RefCell;
use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;
use std::io;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread;

use condor_dev::sim::{LineFault, Model as _, UartModel};
use condor_dev::{BusAccessError, BusErrorKind, Width};
use condor_mbox::linux::LinuxWindow;
use critical_section::Mutex;
use rustix::event::{EventfdFlags, PollFd, PollFlags, Timespec, eventfd, poll};
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::termios::{
    ControlModes, InputModes, OptionalActions, QueueSelector, tcflush, tcgetattr, tcsetattr,
};

use super::bell::ProcessBell;
use super::error::ProcessError;
use crate::lines::{BoardLines, LineState, SERIAL, SERIAL_VECTOR};

/// The speed of the line for a divisor of 1, that of a board with a clock of 1.8432 MHz, in baud.
const FASTEST_BAUD: u32 = 115_200;
/// The longest wait for the line.
const NAP: Duration = Duration::from_millis(100);
/// The number of bytes that are read at a time: as many as a FIFO has.
const AT_ONCE: usize = 16;
/// The register that clears the FIFOs, and its bit for that of received bytes.
const FIFO_CONTROL: usize = 2;
const CLEAR_RECEIVED: u32 = 1 << 1;

/// The lines of a process.
type Lines = BoardLines<LinuxWindow, ProcessBell, Arc<LineState>>;

/// A terminal device of Linux, such as `/dev/ttyUSB0`, behind the registers of a 16550 at [`SERIAL`]. Bytes move at each
/// access of the program, and when the line has some.
#[derive(Debug)]
pub(super) struct SerialPort {
    tty: Tty,
    lines: Lines,
    /// In critical sections alone: servo loops access it, too, which may run in signals.
    board: Mutex<RefCell<Board>>,
}

/// An open terminal device.
#[derive(Debug)]
pub(super) struct Tty {
    path: PathBuf,
    device: OwnedFd,
    /// Has the thread that waits for the line look at the board again.
    wake: OwnedFd,
}

#[derive(Debug)]
struct Board {
    model: UartModel,
    /// Whether it asks for its interrupt.
    asks: bool,
    /// Sent by the board, and not yet taken by the line.
    unsent: Option<u8>,
    /// The format and the divisor that the line has.
    set: Setting,
    failed: Option<Errno>,
    /// The events of the line for which the thread waits.
    awaited: PollFlags,
}

/// The format of characters, as in the line control register, and the divisor.
type Setting = (u8, u16);

impl Tty {
    /// Opens a device, and sets its line as a board has it at first.
    pub(super) fn open(path: &Path) -> Result<Self, ProcessError> {
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let open = || -> rustix::io::Result<Self> {
            let tty = Self {
                path: path.to_owned(),
                device: rustix::fs::open(path, flags, Mode::empty())?,
                wake: eventfd(0, EventfdFlags::NONBLOCK | EventfdFlags::CLOEXEC)?,
            };
            tty.configure(AT_FIRST)?;
            tty.discard()?;
            Ok(tty)
        };
        open().map_err(|error| ProcessError::Open {
            what: "serial port",
            path: path.to_owned(),
            source: if error == Errno::NOTTY {
                io::Error::other("it is no terminal device; name one, such as /dev/ttyUSB0")
            } else {
                error.into()
            },
        })
    }

    /// Drops what has been received and not read.
    fn discard(&self) -> rustix::io::Result<()> {
        tcflush(&self.device, QueueSelector::IFlush)
    }

    /// Has the device pass all bytes on as they are, with the format and the speed of a 16550.
    fn configure(&self, (format, divisor): Setting) -> rustix::io::Result<()> {
        let mut settings = tcgetattr(&self.device)?;
        settings.make_raw();
        // A former user may have left these set.
        let flow_and_parity =
            InputModes::IXOFF | InputModes::IXANY | InputModes::INPCK | InputModes::IGNPAR;
        settings.input_modes.remove(flow_and_parity);
        let modes = &mut settings.control_modes;
        modes.remove(ControlModes::CSIZE | ControlModes::CRTSCTS);
        modes.insert(ControlModes::CLOCAL | ControlModes::CREAD);
        // The line control register of the PC16550D (data sheet, section 8.1).
        modes.insert(match format & 0b11 {
            0b00 => ControlModes::CS5,
            0b01 => ControlModes::CS6,
            0b10 => ControlModes::CS7,
            _ => ControlModes::CS8,
        });
        modes.set(ControlModes::CSTOPB, format & 1 << 2 != 0);
        modes.set(ControlModes::PARENB, format & 1 << 3 != 0);
        modes.set(ControlModes::PARODD, format & 1 << 4 == 0);
        modes.set(ControlModes::CMSPAR, format & 1 << 5 != 0);
        settings.set_speed(FASTEST_BAUD / u32::from(divisor.max(1)))?;
        tcsetattr(&self.device, OptionalActions::Now, &settings)
    }
}

/// Eight bits, no parity, one stop bit, 115 200 baud.
const AT_FIRST: Setting = (0b11, 1);
/// The bits of the line control register that are the format.
const FORMAT: u8 = 0b11_1111;

impl SerialPort {
    /// Makes the port of a processor with these lines.
    pub(super) fn new(tty: Tty, lines: Lines) -> Self {
        let board = Board {
            model: UartModel::default(),
            asks: false,
            unsent: None,
            set: AT_FIRST,
            failed: None,
            awaited: PollFlags::empty(),
        };
        Self {
            tty,
            lines,
            board: Mutex::new(RefCell::new(board)),
        }
    }

    /// Returns the offset of a register, if the port is at `address`.
    pub(super) const fn register(address: usize) -> Option<usize> {
        match address.checked_sub(SERIAL.base()) {
            Some(offset @ 0..8) => Some(offset),
            _ => None,
        }
    }

    pub(super) fn read(&self, register: usize, width: Width) -> Result<u32, BusAccessError> {
        self.access(register, |board| board.model.read(register, width))
    }

    pub(super) fn write(
        &self,
        register: usize,
        width: Width,
        value: u32,
    ) -> Result<(), BusAccessError> {
        if register == FIFO_CONTROL && value & CLEAR_RECEIVED != 0 {
            // A line that has failed says so below.
            let _ = self.tty.discard();
        }
        let wanted = self.access(register, |board| {
            board.model.write(register, width, value)?;
            Some(board.wanted())
        })?;
        wanted.map_or(Ok(()), |wanted| self.follow(register, wanted))
    }

    fn access<R>(
        &self,
        register: usize,
        access: impl FnOnce(&mut Board) -> Option<R>,
    ) -> Result<R, BusAccessError> {
        let (result, failed) = self.with(|board| (access(board), board.failed));
        if failed.is_some() {
            return Err(error(register, BusErrorKind::Lost));
        }
        // The registers have one byte.
        result.ok_or(error(register, BusErrorKind::NoAnswer))
    }

    /// Has the line follow a new format or speed of the board. That takes long on some devices: it is in no critical
    /// section.
    fn follow(&self, register: usize, wanted: Setting) -> Result<(), BusAccessError> {
        let configured = self.tty.configure(wanted);
        configured.map_err(|_| error(register, BusErrorKind::NoAnswer))?;
        self.with(|board| board.set = wanted);
        Ok(())
    }

    /// Moves bytes, and looks at the board or changes it; then sets its interrupt's line.
    fn with<R>(&self, change: impl FnOnce(&mut Board) -> R) -> R {
        critical_section::with(|section| {
            let mut board = self.board.borrow_ref_mut(section);
            board.receive(&self.tty.device);
            let result = change(&mut board);
            board.send(&self.tty.device);
            let asks = board.model.interrupts() && board.failed.is_none();
            if asks != board.asks {
                board.asks = asks;
                self.lines.set_level(SERIAL_VECTOR, asks);
            }
            let awaited = board.awaits();
            if awaited != board.awaited {
                board.awaited = awaited;
                // If it is full, the thread is awake.
                let _ = rustix::io::write(&self.tty.wake, &1_u64.to_ne_bytes());
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
        let patience = Timespec::try_from(NAP).ok();
        let mut was_told = false;
        while !ended.load(Ordering::Relaxed) {
            let (events, failed) = self.with(|board| (board.awaits(), board.failed));
            if let Some(error) = failed {
                if !was_told {
                    was_told = true;
                    let path = self.tty.path.display();
                    eprintln!(
                        "the serial port {path} has failed: {error}; restart the program when it is back"
                    );
                }
                thread::sleep(NAP);
                continue;
            }
            let mut polled = [
                PollFd::new(&self.tty.device, events),
                PollFd::new(&self.tty.wake, PollFlags::IN),
            ];
            let _ = poll(&mut polled, patience.as_ref());
            let [line, _] = polled;
            let is_gone = line.revents().intersects(PollFlags::HUP | PollFlags::ERR);
            if is_gone && !self.with(|board| board.model.has_room()) {
                // A line that is gone says so at once, and is not read while there is no room.
                thread::sleep(NAP);
            }
            let _ = rustix::io::read(&self.tty.wake, &mut [0; 8]);
        }
    }
}

fn error(register: usize, kind: BusErrorKind) -> BusAccessError {
    BusAccessError {
        address: SERIAL.base() + register,
        kind,
    }
}

impl Board {
    /// Moves bytes from the line to the board.
    fn receive(&mut self, tty: &OwnedFd) {
        let mut bytes = [0; AT_ONCE];
        let room = bytes.split_at_mut(self.model.room().min(AT_ONCE)).0;
        if room.is_empty() || self.failed.is_some() {
            return;
        }
        match rustix::io::read(tty, &mut *room) {
            Ok(0) => self.failed = Some(Errno::NODEV),
            Ok(count) => {
                for byte in room.iter().take(count) {
                    self.model.receive(*byte, LineFault::None);
                }
            }
            Err(error) => self.fail(error),
        }
    }

    /// Moves bytes from the board to the line.
    fn send(&mut self, tty: &OwnedFd) {
        while self.failed.is_none() {
            let Some(byte) = self.unsent.take().or_else(|| self.model.transmit()) else {
                break;
            };
            match rustix::io::write(tty, &[byte]) {
                Ok(1) => {}
                Ok(_) => self.unsent = Some(byte),
                Err(error) => {
                    self.unsent = Some(byte);
                    self.fail(error);
                }
            }
            if self.unsent.is_some() {
                break;
            }
        }
    }

    /// The setting that the board has and the line has not. While the divisor is being written, that is none.
    fn wanted(&self) -> Option<Setting> {
        let (control, divisor) = (self.model.line_control(), self.model.divisor());
        let wanted = (control & FORMAT, divisor);
        (control >> 7 == 0 && divisor != 0 && wanted != self.set).then_some(wanted)
    }

    /// Notes an error after which nothing more comes.
    fn fail(&mut self, error: Errno) {
        if error != Errno::INTR && error != Errno::AGAIN {
            self.failed = Some(error);
        }
    }

    /// The events of the line that change something.
    fn awaits(&self) -> PollFlags {
        let mut events = PollFlags::empty();
        events.set(PollFlags::IN, self.model.has_room());
        events.set(PollFlags::OUT, self.unsent.is_some());
        events
    }
}
