//! [`Switch`]: opens boards by name, and passes calls on descriptors to their drivers.

use core::fmt;

use crate::bus::{Bus, BusError};
use crate::device::Device;
use crate::driver::Driver;
use crate::error::{IoError, OpenError};
use crate::fd::{Entry, Fd, FdError, FdTable, OpenMode};
use crate::interrupt::InterruptController;
use crate::record::Interrupts;
use crate::set::{DeviceSet, DriverSlot, Visitor, slot};
use crate::unit::{Presence, Unit};

/// The device switch of one processor (A. I. Memo 977, section 3.1): it finds the boards for which
/// a program is built, opens them by name, and passes reads and writes to their drivers.
///
/// `S` is the set of devices, declared by [`device_switch!`](crate::device_switch). `B` is the bus
/// that reaches their registers, and `C` the controller of their interrupts. Up to `F` descriptors
/// can be open at a time.
///
/// It allocates nothing, and calls every driver directly. A switch is usually a `static`.
///
/// ```
/// use condor_dev::drivers::As5600;
/// use condor_dev::sim::{As5600Model, I2c, SimBus};
/// use condor_dev::{I2cBus, Location, NoInterrupts, OpenMode, Switch, device_switch};
///
/// device_switch! { struct Boards { angle: As5600 = [Location::i2c(As5600::ADDRESS)] } }
///
/// let bus = SimBus::new();
/// bus.insert(0x3600, As5600Model::default());
/// let devices = Switch::<_, _, _, 2>::new(I2cBus::new(I2c(bus)), NoInterrupts, Boards::new());
/// devices.start(); // looks for the boards
/// let (fd, mut angle) = (devices.open(":angle", 0, OpenMode::READ)?, [0; 2]);
/// assert_eq!(devices.read(fd, &mut angle)?, 2);
/// # Ok::<_, Box<dyn std::error::Error>>(())
/// ```
pub struct Switch<B, C, S, const F: usize> {
    pub(crate) bus: B,
    pub(crate) controller: C,
    pub(crate) devices: S,
    pub(crate) fds: FdTable<F>,
    pub(crate) interrupts: Interrupts,
}

impl<B: Bus, C: InterruptController, S: DeviceSet, const F: usize> Switch<B, C, S, F> {
    /// Makes a switch. No board can be opened before [`start`](Self::start) has found it.
    #[must_use]
    pub const fn new(bus: B, controller: C, devices: S) -> Self {
        Self {
            bus,
            controller,
            devices,
            fds: FdTable::new(),
            interrupts: Interrupts::new(),
        }
    }

    /// Looks for every board of the set, initialises those that are there, and then enables the
    /// interrupt vectors of those that were initialised. [`inventory`](Self::inventory) prints the
    /// result.
    ///
    /// Boards that are present already are not changed; their vectors that were
    /// [disabled](Self::stuck) are enabled again.
    pub fn start(&self) {
        for (_, kind, board) in Self::boards() {
            self.devices.visit(slot(kind, board), Start(&self.bus));
        }
        // Until its last board is initialised, a shared vector may interrupt with none asking.
        for (_, kind, board) in Self::boards() {
            self.devices
                .visit(slot(kind, board), Enable(&self.controller));
        }
    }

    /// Opens board number `board`, counted from 0, of the device `name` and returns its descriptor.
    /// `name` is the name of a field of the device set; a colon before it is ignored.
    ///
    /// Interrupts are not masked while the driver accesses the board. While one context opens or
    /// closes a board, another one that opens it gets [`OpenError::Busy`].
    ///
    /// # Errors
    /// [`OpenError::NoSuchDevice`] or [`OpenError::NoSuchBoard`] if the set has no such device or
    /// board; [`OpenError::NotPresent`] if start-up did not find or not initialise the board;
    /// [`OpenError::Direction`] if it cannot be opened in this mode; [`OpenError::Busy`] if it is
    /// open already and not shared; [`OpenError::TooMany`] if all descriptors are open;
    /// [`OpenError::Bus`] if the bus fails.
    pub fn open<'n>(&self, name: &'n str, board: u8, mode: OpenMode) -> Result<Fd, OpenError<'n>> {
        let plain = name.strip_prefix(':').unwrap_or(name);
        let mut kinds = (0_u8..).zip(S::KINDS);
        let found = kinds.find(|(_, (known, _))| *known == plain);
        let devices = S::KINDS;
        let (kind, _) = found.ok_or(OpenError::NoSuchDevice { name, devices })?;
        self.open_kind(kind, name, board, mode)
    }

    /// Opens board number `board` of the device `kind`, and returns it together with its driver, so
    /// that a program can call the driver's own methods. For the field `adc` of the set `Boards`,
    /// call `open_typed(Boards::adc, 0, mode)`.
    ///
    /// # Errors
    /// [`OpenError::NoSuchBoard`] if the set has no such board; [`OpenError::NotPresent`] if
    /// start-up did not find or not initialise it; [`OpenError::Direction`] if it cannot be opened
    /// in this mode; [`OpenError::Busy`] if it is open already and not shared;
    /// [`OpenError::TooMany`] if all descriptors are open; [`OpenError::Bus`] if the bus fails.
    pub fn open_typed<D: Driver>(
        &self,
        kind: DriverSlot<S, D>,
        board: u8,
        mode: OpenMode,
    ) -> Result<Device<'_, B, D, F>, OpenError<'static>> {
        let number = kind.number() as u8;
        let (name, _) = S::KINDS
            .get(usize::from(number))
            .copied()
            .unwrap_or_default();
        let fd = self.open_kind(number, name, board, mode)?;
        // Only another context that guessed the descriptor could have closed it.
        self.device(kind, fd)
            .map_err(|_| OpenError::Busy { name, board })
    }

    fn open_kind<'n>(
        &self,
        kind: u8,
        name: &'n str,
        board: u8,
        mode: OpenMode,
    ) -> Result<Fd, OpenError<'n>> {
        let boards = S::KINDS
            .get(usize::from(kind))
            .map_or(0, |&(_, boards)| boards);
        if board >= boards {
            return Err(OpenError::NoSuchBoard {
                name,
                board,
                boards,
            });
        }
        let slot = slot(kind, board);
        let open = Open {
            switch: self,
            name,
            board,
            slot,
            mode,
        };
        // Every kind has its boards.
        let nobody = Err(OpenError::Busy { name, board });
        self.devices.visit(slot, open).unwrap_or(nobody)
    }

    /// Reads at least one byte from the board of `fd` into `into`, without waiting, and returns the
    /// number of bytes. Returns 0 if `into` is empty.
    ///
    /// # Errors
    /// [`IoError::Fd`] if the descriptor is not open for reading; [`IoError::WouldBlock`] if there
    /// is nothing to read at this moment; [`IoError::Length`] if the device does not move this
    /// number of bytes; [`IoError::Device`] or [`IoError::Bus`] if the device or the bus reports an
    /// error.
    #[inline]
    pub fn read(&self, fd: Fd, into: &mut [u8]) -> Result<usize, IoError<B::Error>> {
        let entry = self.fds.get(fd, OpenMode::READ)?;
        if into.is_empty() {
            return Ok(0);
        }
        self.visit(fd, entry, Read(&self.bus, into))?
    }

    /// Writes at least one byte of `from` to the board of `fd`, without waiting, and returns the
    /// number of bytes. Returns 0 if `from` is empty.
    ///
    /// # Errors
    /// [`IoError::Fd`] if the descriptor is not open for writing; [`IoError::WouldBlock`] if there
    /// is no room at this moment; [`IoError::Length`] if the device does not move this number of
    /// bytes; [`IoError::Device`] or [`IoError::Bus`] if the device or the bus reports an error.
    #[inline]
    pub fn write(&self, fd: Fd, from: &[u8]) -> Result<usize, IoError<B::Error>> {
        let entry = self.fds.get(fd, OpenMode::WRITE)?;
        if from.is_empty() {
            return Ok(0);
        }
        self.visit(fd, entry, Write(&self.bus, from))?
    }

    /// Returns true if [`read`](Self::read) would read at least one byte now.
    ///
    /// # Errors
    /// [`IoError::Fd`] if the descriptor is not open for reading, [`IoError::Bus`] if the bus
    /// fails.
    pub fn read_ready(&self, fd: Fd) -> Result<bool, IoError<B::Error>> {
        self.ask(fd, OpenMode::READ, Question::Read)
    }

    /// Returns true if [`write`](Self::write) would write at least one byte now.
    ///
    /// # Errors
    /// [`IoError::Fd`] if the descriptor is not open for writing, [`IoError::Bus`] if the bus
    /// fails.
    pub fn write_ready(&self, fd: Fd) -> Result<bool, IoError<B::Error>> {
        self.ask(fd, OpenMode::WRITE, Question::Write)
    }

    /// Returns true if all bytes that were written through descriptors of the board have left the
    /// board.
    ///
    /// # Errors
    /// [`IoError::Fd`] if the descriptor is not open for writing, [`IoError::Bus`] if the bus
    /// fails.
    pub fn is_flushed(&self, fd: Fd) -> Result<bool, IoError<B::Error>> {
        self.ask(fd, OpenMode::WRITE, Question::Flushed)
    }

    fn ask(&self, fd: Fd, mode: OpenMode, question: Question) -> Result<bool, IoError<B::Error>> {
        let entry = self.fds.get(fd, mode)?;
        self.visit(fd, entry, Ready(&self.bus, question))?
            .map_err(IoError::Bus)
    }

    /// Closes a descriptor. The driver also closes the board if no other descriptor of it is open.
    ///
    /// # Errors
    /// [`IoError::Fd`] if the descriptor is not open, or a [`Device`] of it is held;
    /// [`IoError::Bus`] if the bus fails while the driver closes the board; the descriptor is
    /// closed all the same.
    pub fn close(&self, fd: Fd) -> Result<(), IoError<B::Error>> {
        let entry = critical_section::with(|_| self.fds.remove(fd))?;
        self.visit(fd, entry, Close(&self.bus))?
            .map_err(IoError::Bus)
    }

    /// Returns the board of the open descriptor `fd` together with its driver, so that a program
    /// can call the driver's own methods. `kind` is the device, such as `Boards::adc`. The
    /// descriptor is checked only here, not at each call.
    ///
    /// While the device is held, the descriptor cannot be closed by others.
    ///
    /// # Errors
    /// [`FdError`] if the descriptor is not open, or belongs to another device.
    pub fn device<D: Driver>(
        &self,
        kind: DriverSlot<S, D>,
        fd: Fd,
    ) -> Result<Device<'_, B, D, F>, FdError> {
        critical_section::with(|_| {
            let entry = self.fds.get(fd, OpenMode::empty())?;
            let unit = kind.unit(&self.devices, entry.slot()).ok_or_else(|| {
                let named = S::KINDS.get(usize::from(kind.number()));
                let wanted = named.copied().unwrap_or_default().0;
                FdError::WrongType { fd, wanted }
            })?;
            self.fds.hold(fd, 1);
            Ok(Device::new(unit, &self.bus, &self.fds, fd))
        })
    }

    /// Returns a table to print, with a line for each board of the set: its device and number, its
    /// address, its interrupt, and the result of start-up.
    pub fn inventory(&self) -> impl fmt::Display + '_ {
        Inventory(self)
    }

    fn boards() -> impl Iterator<Item = (&'static str, u8, u8)> {
        let kinds = (0_u8..).zip(S::KINDS);
        kinds.flat_map(|(kind, &(name, boards))| (0..boards).map(move |board| (name, kind, board)))
    }

    #[inline(always)]
    fn visit<V: Visitor>(&self, fd: Fd, entry: Entry, visitor: V) -> Result<V::Output, FdError> {
        // Every entry was made from a board that there is.
        self.devices
            .visit(entry.slot(), visitor)
            .ok_or(FdError::Closed { fd })
    }
}

struct Start<'s, B>(&'s B);

impl<B: Bus> Visitor for Start<'_, B> {
    type Output = ();

    fn board<D: Driver>(self, unit: &Unit<D>) {
        if unit.presence() == Presence::Present {
            return;
        }
        let registers = unit.registers(self.0);
        unit.set_presence(if !D::probe(registers) {
            Presence::Absent
        } else if unit.driver.init(registers).is_ok() {
            Presence::Present
        } else {
            Presence::Failed
        });
    }
}

struct Enable<'s, C>(&'s C);

impl<C: InterruptController> Visitor for Enable<'_, C> {
    type Output = ();

    fn board<D: Driver>(self, unit: &Unit<D>) {
        if let (Presence::Present, Some((vector, level))) =
            (unit.presence(), unit.place.interrupt())
        {
            self.0.enable(vector, level);
        }
    }
}

struct Open<'s, 'n, B, C, S, const F: usize> {
    switch: &'s Switch<B, C, S, F>,
    name: &'n str,
    board: u8,
    slot: u16,
    mode: OpenMode,
}

impl<'n, B: Bus, C, S, const F: usize> Visitor for Open<'_, 'n, B, C, S, F> {
    type Output = Result<Fd, OpenError<'n>>;

    fn board<D: Driver>(self, unit: &Unit<D>) -> Self::Output {
        let Self {
            name, board, mode, ..
        } = self;
        let presence = unit.presence();
        if presence != Presence::Present {
            return Err(OpenError::NotPresent {
                name,
                board,
                presence,
            });
        }
        let direction = mode & (OpenMode::READ | OpenMode::WRITE);
        let wrong = (mode.contains(OpenMode::READ) && !D::READS)
            || (mode.contains(OpenMode::WRITE) && !D::WRITES);
        if direction.is_empty() || wrong {
            return Err(OpenError::Direction { name, mode });
        }
        let fds = &self.switch.fds;
        let (fd, first) = critical_section::with(|_| {
            let exclusive = mode.contains(OpenMode::EXCLUSIVE);
            let busy = OpenError::Busy { name, board };
            let first = unit.count_open(exclusive).ok_or(busy)?;
            if let Some(fd) = fds.insert(self.slot, mode) {
                return Ok((fd, first));
            }
            unit.count_close();
            if first {
                unit.settle();
            }
            Err(OpenError::TooMany { count: F })
        })?;
        if !first {
            return Ok(fd);
        }
        let opened = unit.driver.open(unit.registers(&self.switch.bus));
        if opened.is_err() {
            critical_section::with(|_| {
                unit.count_close();
                // Nobody knows the descriptor yet.
                let _ = fds.remove(fd);
            });
        }
        unit.settle();
        opened.map(|()| fd).map_err(|error| OpenError::Bus {
            name,
            board,
            kind: error.kind(),
        })
    }
}

struct Read<'s, B>(&'s B, &'s mut [u8]);

impl<B: Bus> Visitor for Read<'_, B> {
    type Output = Result<usize, IoError<B::Error>>;

    #[inline(always)]
    fn board<D: Driver>(self, unit: &Unit<D>) -> Self::Output {
        Ok(unit.driver.read(unit.registers(self.0), self.1)?)
    }
}

struct Write<'s, B>(&'s B, &'s [u8]);

impl<B: Bus> Visitor for Write<'_, B> {
    type Output = Result<usize, IoError<B::Error>>;

    #[inline(always)]
    fn board<D: Driver>(self, unit: &Unit<D>) -> Self::Output {
        Ok(unit.driver.write(unit.registers(self.0), self.1)?)
    }
}

struct Ready<'s, B>(&'s B, Question);

enum Question {
    Read,
    Write,
    Flushed,
}

impl<B: Bus> Visitor for Ready<'_, B> {
    type Output = Result<bool, B::Error>;

    fn board<D: Driver>(self, unit: &Unit<D>) -> Self::Output {
        let registers = unit.registers(self.0);
        match self.1 {
            Question::Read => unit.driver.read_ready(registers),
            Question::Write => unit.driver.write_ready(registers),
            Question::Flushed => unit.driver.is_flushed(registers),
        }
    }
}

struct Close<'s, B>(&'s B);

impl<B: Bus> Visitor for Close<'_, B> {
    type Output = Result<(), B::Error>;

    fn board<D: Driver>(self, unit: &Unit<D>) -> Self::Output {
        unit.close(unit.registers(self.0))
    }
}

struct Inventory<'s, B, C, S, const F: usize>(&'s Switch<B, C, S, F>);

impl<B: Bus, C: InterruptController, S: DeviceSet, const F: usize> fmt::Display
    for Inventory<'_, B, C, S, F>
{
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:8} {:>5} {:>12} {:>6} {:>5}  found",
            "device", "board", "address", "vector", "level"
        )?;
        for (name, kind, board) in Switch::<B, C, S, F>::boards() {
            let row = Row { f, name, board };
            self.0.devices.visit(slot(kind, board), row).transpose()?;
        }
        Ok(())
    }
}

struct Row<'r, 'f> {
    f: &'r mut fmt::Formatter<'f>,
    name: &'static str,
    board: u8,
}

impl Visitor for Row<'_, '_> {
    type Output = fmt::Result;

    fn board<D: Driver>(self, unit: &Unit<D>) -> fmt::Result {
        let Self { f, name, board } = self;
        write!(f, "{name:8} {board:>5} {:>#12x} ", unit.place.base())?;
        match unit.place.interrupt() {
            Some((vector, level)) => write!(f, "{:>6} {:>5}", vector.0, level.0)?,
            None => write!(f, "{:>6} {:>5}", "-", "-")?,
        }
        writeln!(f, "  {}", unit.presence())
    }
}
