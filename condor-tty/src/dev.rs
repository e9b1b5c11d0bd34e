//! Terminals as boards of a `condor-dev` device switch.
//!
//! [`Tty`] is the driver. A terminal has no address that could be probed, so the program says by
//! [`TerminalTable`] which terminal is at which place; until it does, the start of the switch finds
//! none. From then on `open(":tty", board, mode)` returns a descriptor, like that of any device,
//! and `condor-dev`'s [`DeviceStream`](condor_dev::stream::DeviceStream) and buffered standard output and input work
//! over it.
//!
//! ```
//! use std::sync::OnceLock;
//! use std::time::Duration;
//!
//! use condor_dev::sim::SimBus;
//! use condor_dev::stdio::{self, Buffering, BufferedOutput};
//! use condor_dev::stream::DeviceStream;
//! use condor_dev::{OpenMode, NoInterrupts, Location, Switch, device_switch};
//! use condor_mbox::sim::{SimMailbox, SimWindow, SimSystem};
//! use condor_mbox::{Call, CriticalSection, MemoryWindow, Messenger, Allocator, Processor, Region};
//! use condor_tty::dev::{AnyTerminal, TerminalTable, TerminalBoard, Tty};
//! use condor_tty::{TerminalReader, Terminal, TerminalVectors};
//!
//! # const HOST: Processor = Processor(0);
//! const HAND: Processor = Processor(1);
//!
//! static TERMINAL: OnceLock<Terminal<SimWindow, CriticalSection, 128>> = OnceLock::new();
//! static MAILBOX: OnceLock<SimMailbox<'static, 2>> = OnceLock::new();
//! type Board = TerminalBoard<'static, SimWindow, CriticalSection, SimMailbox<'static, 2>, 128>;
//! static BOARD: OnceLock<Board> = OnceLock::new();
//!
//! /// One terminal, at a place that is nobody's address.
//! struct Panel;
//!
//! impl TerminalTable for Panel {
//!     fn terminal(base: usize) -> Option<&'static dyn AnyTerminal> {
//!         (base == 0).then(|| BOARD.get().map(|board| board as _)).flatten()
//!     }
//! }
//!
//! device_switch! {
//!     struct Devices { tty: Tty<Panel> = [Location::at(0)] }
//! }
//! type Hand = Switch<SimBus, NoInterrupts, Devices, 4>;
//!
//! /// What the program does while it waits for a terminal: a second at most.
//! fn serve(looks: u32) -> bool {
//!     let served = MAILBOX.get().map(|mailbox| mailbox.serve(Duration::from_millis(10)));
//!     served.is_some_and(|served| served.is_ok()) && looks < 100
//! }
//!
//! static SWITCH: OnceLock<Hand> = OnceLock::new();
//! static OUTPUT: BufferedOutput<DeviceStream<'static, Hand, fn(u32) -> bool>, 256> = BufferedOutput::new(Buffering::Line);
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let system = SimSystem::<2>::in_virtual_time(4096);
//! # let [_, windows] = system.windows(HAND);
//! # let bus = SimBus::new();
//! let ram = Region::users(windows.data)?;
//! let mut allocator = Allocator::new(ram.size());
//! let terminal = Terminal::new(ram.clone(), &mut allocator, 1024, CriticalSection)?;
//! let terminal = TERMINAL.get_or_init(|| terminal);
//! let mut mailbox = system.mailbox(HAND)?;
//! let receive: &(dyn Fn(&Call<'_>) -> u32 + Sync) =
//!     &|call| TERMINAL.get().map_or(0, |terminal| terminal.receive(call));
//! mailbox.set_vector(TerminalVectors::DEFAULT.input, receive, "terminal input")?;
//! mailbox.set_vector(TerminalVectors::DEFAULT.room, receive, "terminal room")?;
//! mailbox.join()?;
//! let mailbox = MAILBOX.get_or_init(|| mailbox);
//! BOARD.get_or_init(|| TerminalBoard::new(terminal, mailbox));
//!
//! let devices = SWITCH.get_or_init(|| Switch::new(bus, NoInterrupts, Devices::new()));
//! devices.start();
//! let fd = devices.open(":tty", 0, OpenMode::READ | OpenMode::WRITE)?;
//! OUTPUT.open(DeviceStream::new(devices, fd, serve as fn(u32) -> bool)).ok();
//! stdio::set_output(&OUTPUT)?;
//! condor_dev::println!("joint {} is at {:.3} rad", 3, 0.25);
//! # let mut reader = TerminalReader::attach(ram, 0, HOST)?;
//! # let mut shown = [0; 64];
//! # let count = reader.fetch(&mut shown)?.len;
//! # assert_eq!(&shown[..count], b"joint 3 is at 0.250 rad\r\n");
//! # Ok(())
//! # }
//! ```
//!
//! Without std, use cells that are filled once at start-up in place of `OnceLock`, for example
//! those of the crate `static_cell`.
//!
//! # The calls on a descriptor
//!
//! | call | effect |
//! |---|---|
//! | `write` | follows the terminal's [`Policy`](crate::Policy), but never waits, as no driver does. Under `Block`, with a host attached, it returns [`WouldBlock`](DeviceError::WouldBlock), and nothing is lost. The stream decides how long to wait, and what to do meanwhile. |
//! | `read` | returns at least one byte, and in cooked mode at most a line |
//! | `is_flushed` | returns whether the host has acknowledged everything; true if a write would not wait for a host |
//!
//! Errors of the terminal are [`DeviceError::Device`] with these bits: [`END_OF_FILE`],
//! [`INTERRUPTED`], [`UNREACHABLE`].

use core::marker::PhantomData;
use core::time::Duration;

use condor_dev::{Bus, DeviceError, Driver, Registers};
use condor_mbox::{AccessError, Exclusion, MemoryWindow, Messenger};

use crate::console::{ring, room_for};
use crate::sync::Word;
use crate::terminal::Terminal;

/// The number in [`DeviceError::Device`] that a read returns after the character for the end of the
/// file was typed. It is reported once. (A read of 0 bytes cannot report it here: to a stream that
/// means that there is no input yet.)
pub const END_OF_FILE: u8 = 1;
/// The number in [`DeviceError::Device`] that a read returns after the character that interrupts
/// was typed. It is reported once.
pub const INTERRUPTED: u8 = 2;
/// The number in [`DeviceError::Device`] that a call returns if the terminal's memory cannot be
/// accessed.
pub const UNREACHABLE: u8 = 4;

/// The list of a program's terminals, from which the driver [`Tty`] gets them. The program
/// implements this trait.
pub trait TerminalTable: Sync + 'static {
    /// Returns the terminal for the location `base` of the device switch; `None` as long as there
    /// is none.
    ///
    /// The locations are those that the program wrote in `device_switch!`. For a terminal they are
    /// any numbers, but not the bus address of a board in the same switch.
    fn terminal(base: usize) -> Option<&'static dyn AnyTerminal>;
}

/// A [`TerminalBoard`] without its type parameters, as a [`TerminalTable`] returns it.
pub trait AnyTerminal: Sync + sealed::Transfers {}

/// A terminal as a board of a `device_switch!`, together with the mailbox that tells the host of
/// output.
#[derive(Debug)]
pub struct TerminalBoard<'t, W, X, M: ?Sized, const IN: usize> {
    terminal: &'t Terminal<W, X, IN>,
    messenger: &'t M,
    /// Whether the host has been asked for a message when there is room.
    asked: Word,
}

impl<'t, W, X, M, const IN: usize> TerminalBoard<'t, W, X, M, IN>
where
    W: MemoryWindow,
    X: Exclusion,
    M: Messenger + ?Sized,
{
    /// Makes a board of `terminal`. `messenger` is the mailbox of this processor.
    pub fn new(terminal: &'t Terminal<W, X, IN>, messenger: &'t M) -> Self {
        Self {
            terminal,
            messenger,
            asked: Word::new(0),
        }
    }

    /// Writes as many bytes as there is room for, or drops them if the policy demands it.
    fn put(&self, from: &[u8]) -> Result<Option<usize>, AccessError> {
        let written = self.terminal.put_text(from)?;
        if written > 0 {
            ring(self.terminal, self.messenger)?;
            return Ok(Some(written));
        }
        if self.terminal.waits()?.is_some() {
            return Ok(None);
        }
        self.terminal.output().count_lost(from.len())?;
        Ok(Some(from.len()))
    }

    /// Returns true if the host has dealt with everything, or is not waited for.
    fn is_read(&self) -> Result<bool, AccessError> {
        Ok(self.terminal.unread()? == 0 || self.terminal.waits()?.is_none())
    }

    /// Asks the host for a message when there is room, or no longer.
    fn ask(&self, for_room: bool) -> Result<(), AccessError> {
        let changed = self.terminal.exclusive(|| {
            let changed = (self.asked.get() != 0) != for_room;
            self.asked.set(for_room.into());
            changed
        });
        if changed {
            self.terminal.output().set_waiting(for_room)?;
        }
        Ok(())
    }
}

mod sealed {
    use super::{AccessError, DeviceError};

    /// The operations of the driver [`Tty`](super::Tty) on a terminal, which do not depend on the
    /// type of the switch's bus.
    pub trait Transfers {
        fn read(&self, into: &mut [u8]) -> Result<usize, DeviceError<AccessError>>;
        fn write(&self, from: &[u8]) -> Result<usize, DeviceError<AccessError>>;
        fn close(&self) -> Result<(), AccessError>;
        fn is_flushed(&self) -> Result<bool, AccessError>;
        fn read_ready(&self) -> bool;
        fn write_ready(&self) -> Result<bool, AccessError>;
    }
}

impl<W, X, M, const IN: usize> AnyTerminal for TerminalBoard<'_, W, X, M, IN>
where
    W: MemoryWindow + Sync,
    X: Exclusion + Sync,
    M: Messenger + Sync + ?Sized,
{
}

impl<W, X, M, const IN: usize> sealed::Transfers for TerminalBoard<'_, W, X, M, IN>
where
    W: MemoryWindow,
    X: Exclusion,
    M: Messenger + ?Sized,
{
    fn read(&self, into: &mut [u8]) -> Result<usize, DeviceError<AccessError>> {
        if self.terminal.take_interrupt() {
            return Err(DeviceError::Device(INTERRUPTED));
        }
        let post = |to, vector, data| {
            // If it cannot be sent, the host looks by itself a little later.
            let _ = self.messenger.send(to, vector, data, Duration::ZERO);
        };
        match self.terminal.take(into, post)? {
            None => Err(DeviceError::WouldBlock),
            Some(0) => Err(DeviceError::Device(END_OF_FILE)),
            Some(count) => Ok(count),
        }
    }

    fn write(&self, from: &[u8]) -> Result<usize, DeviceError<AccessError>> {
        if let Some(written) = self.put(from)? {
            self.ask(false)?;
            return Ok(written);
        }
        self.ask(true)?;
        // The host may have made room before it was asked.
        if let Some(written) = self.put(from)? {
            self.ask(false)?;
            return Ok(written);
        }
        Err(DeviceError::WouldBlock)
    }

    fn close(&self) -> Result<(), AccessError> {
        self.ask(false)
    }

    fn is_flushed(&self) -> Result<bool, AccessError> {
        if !self.is_read()? {
            self.ask(true)?;
            // The host may have read it before it was asked.
            if !self.is_read()? {
                return Ok(false);
            }
        }
        self.ask(false)?;
        Ok(true)
    }

    fn read_ready(&self) -> bool {
        self.terminal.has_input()
    }

    fn write_ready(&self) -> Result<bool, AccessError> {
        let room = self.terminal.output().room()?;
        Ok(room >= room_for(b"\n") || self.terminal.waits()?.is_none())
    }
}

/// The driver that makes terminals devices of a `device_switch!`. `T` is the program's
/// [`TerminalTable`]; the [module](self) has an example.
pub struct Tty<T>(PhantomData<fn() -> T>);

impl<T> core::fmt::Debug for Tty<T> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("Tty")
    }
}

impl<T: TerminalTable> Driver for Tty<T> {
    const NEW: Self = Self(PhantomData);
    const READS: bool = true;
    const WRITES: bool = true;

    fn probe<B: Bus>(registers: Registers<'_, B>) -> bool {
        T::terminal(registers.base()).is_some()
    }

    fn init<B: Bus>(&self, _: Registers<'_, B>) -> Result<(), B::Error> {
        Ok(())
    }

    fn close<B: Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        if let Some(terminal) = T::terminal(registers.base()) {
            // Memory that is gone asks nobody for anything.
            let _ = terminal.close();
        }
        Ok(())
    }

    fn read<B: Bus>(
        &self,
        registers: Registers<'_, B>,
        into: &mut [u8],
    ) -> Result<usize, DeviceError<B::Error>> {
        let terminal = T::terminal(registers.base()).ok_or(DeviceError::Device(UNREACHABLE))?;
        terminal.read(into).map_err(without_bus)
    }

    fn write<B: Bus>(
        &self,
        registers: Registers<'_, B>,
        from: &[u8],
    ) -> Result<usize, DeviceError<B::Error>> {
        let terminal = T::terminal(registers.base()).ok_or(DeviceError::Device(UNREACHABLE))?;
        terminal.write(from).map_err(without_bus)
    }

    fn is_flushed<B: Bus>(&self, registers: Registers<'_, B>) -> Result<bool, B::Error> {
        // If there is nothing to wait for, no program waits; the next write returns the reason.
        let terminal = T::terminal(registers.base());
        Ok(terminal.is_none_or(|terminal| terminal.is_flushed().unwrap_or(true)))
    }

    fn read_ready<B: Bus>(&self, registers: Registers<'_, B>) -> Result<bool, B::Error> {
        let terminal = T::terminal(registers.base());
        Ok(terminal.is_some_and(sealed::Transfers::read_ready))
    }

    fn write_ready<B: Bus>(&self, registers: Registers<'_, B>) -> Result<bool, B::Error> {
        let terminal = T::terminal(registers.base());
        Ok(terminal.is_some_and(|terminal| terminal.write_ready().unwrap_or(true)))
    }
}

/// The same error for a switch of any bus: the terminal's memory is not behind it.
fn without_bus<E>(error: DeviceError<AccessError>) -> DeviceError<E> {
    match error {
        DeviceError::WouldBlock => DeviceError::WouldBlock,
        DeviceError::Length { bytes, unit } => DeviceError::Length { bytes, unit },
        DeviceError::Device(bits) => DeviceError::Device(bits),
        DeviceError::Bus(_) => DeviceError::Device(UNREACHABLE),
    }
}
