//! [`Unit`]: one board of a switch, and [`Location`]: where it is.

use core::sync::atomic::{AtomicU8, AtomicU16, Ordering};

use crate::bus::{Bus, Registers};
use crate::driver::Driver;
use crate::interrupt::{Level, Vector};

/// Where a board may be, as the system configuration file of the memo says it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Location {
    base: usize,
    interrupt: Option<(Vector, Level)>,
}

impl Location {
    /// A board at a bus address, which does not interrupt.
    #[must_use]
    pub const fn at(base: usize) -> Self {
        Self {
            base,
            interrupt: None,
        }
    }

    /// A part with this 7-bit address on an [`I2cBus`](crate::I2cBus), which does not interrupt.
    #[must_use]
    pub const fn i2c(address: u8) -> Self {
        Self::at((address as usize) << 8)
    }

    /// The same board, interrupting with `vector` at `level`.
    #[must_use]
    pub const fn interrupting(self, vector: u16, level: u8) -> Self {
        Self {
            interrupt: Some((Vector(vector), Level(level))),
            ..self
        }
    }

    /// The bus address.
    #[must_use]
    pub const fn base(self) -> usize {
        self.base
    }

    /// How it interrupts.
    #[must_use]
    pub const fn interrupt(self) -> Option<(Vector, Level)> {
        self.interrupt
    }
}

/// What start-up found at a place.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum Presence {
    /// It has not looked yet.
    #[default]
    Unknown,
    /// No board.
    Absent,
    /// A board, initialised.
    Present,
    /// A board that could not be initialised.
    Failed,
}

/// A driver's board at its place.
#[derive(Debug)]
pub struct Unit<D> {
    pub(crate) place: Location,
    pub(crate) driver: D,
    presence: AtomicU8,
    /// How many descriptors are open, with [`EXCLUSIVE`] and [`CHANGING`].
    opens: AtomicU16,
}

/// There may be one descriptor only.
const EXCLUSIVE: u16 = 1 << 15;
/// The driver is opening or closing the board.
const CHANGING: u16 = 1 << 14;

impl<D: Driver> Unit<D> {
    /// A board that start-up will look for.
    #[must_use]
    pub const fn new(place: Location) -> Self {
        Self {
            place,
            driver: D::NEW,
            presence: AtomicU8::new(Presence::Unknown as u8),
            opens: AtomicU16::new(0),
        }
    }

    /// Where it is.
    #[must_use]
    pub const fn place(&self) -> Location {
        self.place
    }

    #[inline(always)]
    pub(crate) const fn registers<'b, B: Bus>(&self, bus: &'b B) -> Registers<'b, B> {
        Registers::new(bus, self.place.base())
    }

    /// What start-up found.
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

    /// Ends the change that the first open or the last close began.
    pub(crate) fn settle(&self) {
        critical_section::with(|_| {
            let opens = self.opens.load(Ordering::Relaxed);
            self.opens.store(opens & !CHANGING, Ordering::Relaxed);
        });
    }
}
