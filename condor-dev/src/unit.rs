//! [`Unit`]: one board of a switch; and [`Location`]: its address and its interrupt.

use core::fmt;
use core::sync::atomic::{AtomicU8, AtomicU16, Ordering};

use crate::bus::{Bus, Registers};
use crate::driver::Driver;
use crate::interrupt::{InterruptLevel, InterruptVector};

/// The bus address at which a board may be, and the board's interrupt, if it has one. A program
/// lists the locations of its boards in [`device_switch!`](crate::device_switch) (the system
/// configuration file of A. I. Memo 977).
///
/// ```
/// use condor_dev::Location;
///
/// const UART: Location = Location::at(0x1000_0000).interrupting(10, 1);
/// assert_eq!(UART.base(), 0x1000_0000);
/// assert_eq!(Location::i2c(0x40).base(), 0x4000);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Location {
    base: usize,
    /// The 7-bit address of a part on I2C.
    i2c: Option<u8>,
    interrupt: Option<(InterruptVector, InterruptLevel)>,
}

impl Location {
    /// Makes the location of a board at the bus address `base`, without an interrupt;
    /// [`interrupting`](Self::interrupting) adds one.
    #[must_use]
    pub const fn at(base: usize) -> Self {
        Self {
            base,
            i2c: None,
            interrupt: None,
        }
    }

    /// Makes the location of a part with this 7-bit address on an [`I2cBus`](crate::I2cBus),
    /// without an interrupt; [`interrupting`](Self::interrupting) adds one.
    ///
    /// # Panics
    /// If the I2C specification (UM10204, section 3.1.12) reserves the address, as it does for 0x00
    /// to 0x07, the general call among them, and for 0x78 to 0x7f. In a constant, as in
    /// [`device_switch!`](crate::device_switch), that does not compile.
    #[must_use]
    pub const fn i2c(address: u8) -> Self {
        Self::i2c_from(0, address)
    }

    /// Makes the location of a part with this 7-bit address on an I2C bus whose bus addresses begin
    /// at `first`, such as a second one, made by [`I2cBus::from`](crate::I2cBus::from).
    ///
    /// # Panics
    /// If the I2C specification reserves the address; see [`i2c`](Self::i2c).
    #[must_use]
    pub const fn i2c_from(first: usize, address: u8) -> Self {
        assert!(
            address >= 0x08 && address <= 0x77,
            "the I2C specification reserves this address: no part can be there"
        );
        Self {
            i2c: Some(address),
            ..Self::at(first + ((address as usize) << 8))
        }
    }

    /// Adds an interrupt to this location: `vector` is its number in the controller, and `level`
    /// its urgency.
    #[must_use]
    pub const fn interrupting(self, vector: u16, level: u8) -> Self {
        Self {
            interrupt: Some((InterruptVector(vector), InterruptLevel(level))),
            ..self
        }
    }

    /// Returns the bus address at which the board's registers begin.
    #[must_use]
    pub const fn base(self) -> usize {
        self.base
    }

    /// Returns the vector and the level of the board's interrupt; `None` if it has none.
    #[must_use]
    pub const fn interrupt(self) -> Option<(InterruptVector, InterruptLevel)> {
        self.interrupt
    }
}

/// The result of [`Switch::start`](crate::Switch::start) for one board.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum Presence {
    /// Start-up has not looked yet.
    #[default]
    Unknown,
    /// There is no board.
    Absent,
    /// There is a board, and it is initialised.
    Present,
    /// There is a board, but it could not be initialised.
    Failed,
}

impl fmt::Display for Presence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Unknown => "not probed yet",
            Self::Absent => "absent",
            Self::Present => "present",
            Self::Failed => "not initialised",
        })
    }
}

/// A board of a [`DeviceSet`](crate::DeviceSet): its location, its driver, and the result of
/// start-up. [`device_switch!`](crate::device_switch) makes one for each location.
#[derive(Debug)]
pub struct Unit<D> {
    pub(crate) place: Location,
    pub(crate) driver: D,
    presence: AtomicU8,
    /// The number of open descriptors, with [`EXCLUSIVE`] and [`CHANGING`].
    opens: AtomicU16,
}

/// There may be one descriptor only.
const EXCLUSIVE: u16 = 1 << 15;
/// The driver is opening or closing the board.
const CHANGING: u16 = 1 << 14;

impl<D: Driver> Unit<D> {
    /// Makes a board that may be at `place`. Its presence is unknown until
    /// [`Switch::start`](crate::Switch::start) looks for it.
    #[must_use]
    pub const fn new(place: Location) -> Self {
        Self {
            place,
            driver: D::NEW,
            presence: AtomicU8::new(Presence::Unknown as u8),
            opens: AtomicU16::new(0),
        }
    }

    /// Checks that a part of this kind can be at `place`. [`device_switch!`](crate::device_switch)
    /// calls this.
    ///
    /// # Panics
    /// If no part of this kind can have that address on I2C; in a constant it does not compile.
    #[doc(hidden)]
    pub const fn check(place: Location) {
        if let Some(address) = place.i2c {
            assert!(
                D::I2C_ADDRESSES >> address & 1 == 1,
                "no part of this driver can have this I2C address"
            );
        }
    }

    /// Returns the location at which the board may be.
    #[must_use]
    pub const fn place(&self) -> Location {
        self.place
    }

    #[inline(always)]
    pub(crate) const fn registers<'b, B: Bus>(&self, bus: &'b B) -> Registers<'b, B> {
        Registers::new(bus, self.place.base())
    }

    /// Returns whether [`Switch::start`](crate::Switch::start) found and initialised the board.
    #[must_use]
    pub fn presence(&self) -> Presence {
        // Acquire: pairs with the Release store below, after the board was initialised.
        match self.presence.load(Ordering::Acquire) {
            1 => Presence::Absent,
            2 => Presence::Present,
            3 => Presence::Failed,
            _ => Presence::Unknown,
        }
    }

    pub(crate) fn set_presence(&self, presence: Presence) {
        // Release: pairs with the Acquire load above.
        self.presence.store(presence as u8, Ordering::Release);
    }

    /// Counts an open, in a critical section; `None` if it would share what is exclusive or being
    /// opened or closed, else whether it is the first. Then the board is changing until
    /// [`settle`](Self::settle).
    pub(crate) fn count_open(&self, exclusive: bool) -> Option<bool> {
        let opens = self.opens.load(Ordering::Relaxed);
        if opens >= CHANGING || (exclusive && opens != 0) || opens == CHANGING - 1 {
            return None;
        }
        let first = if opens == 0 { CHANGING } else { 0 };
        let alone = if exclusive { EXCLUSIVE } else { 0 };
        self.opens
            .store((opens + 1) | alone | first, Ordering::Relaxed);
        Some(opens == 0)
    }

    /// Takes an open back, in a critical section; says whether it was the last. Then the board is
    /// changing until [`settle`](Self::settle).
    pub(crate) fn count_close(&self) -> bool {
        let opens = self.opens.load(Ordering::Relaxed) & (CHANGING - 1);
        let left = opens.saturating_sub(1);
        let last = if left == 0 { CHANGING } else { 0 };
        self.opens.store(left | last, Ordering::Relaxed);
        left == 0
    }

    /// Takes an open back, and closes the board with the last one.
    pub(crate) fn close<B: Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        if !critical_section::with(|_| self.count_close()) {
            return Ok(());
        }
        let closed = self.driver.close(registers);
        self.settle();
        closed
    }

    /// Ends the change that the first open or the last close began.
    pub(crate) fn settle(&self) {
        critical_section::with(|_| {
            let opens = self.opens.load(Ordering::Relaxed);
            self.opens.store(opens & !CHANGING, Ordering::Relaxed);
        });
    }
}
