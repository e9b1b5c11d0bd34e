//! [`Ticks`]: periods of `SysTick`.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use ::cortex_m::peripheral::{SCB, SYST, syst::SystClkSource};

use crate::clock::ClockSpec;
use crate::instant::{CounterReading, Wrapping};
use crate::rate::Rate;
use crate::timer::{Alarm, Armed, Timer};

/// Whether the counter has reloaded since CSR was read.
const COUNTFLAG: u32 = 1 << 16;

/// A [`Timer`] made of `SysTick`, which every Cortex-M has. Its ticks are the periods of `SysTick`.
///
/// The counter reloads itself, so nothing is lost if its handler runs late by up to a whole period.
/// Loops are released at ticks, so releases are exact if the tick rate is a multiple of the rates
/// of all loops. Each tick is an interrupt, which takes a few instructions if no loop is due.
///
/// Ticks go on while the fastest loop runs. So that loop and the scheduler's handler do not run in
/// the handler of `SysTick` but in that of `PendSV`, one priority below.
pub struct Ticks {
    frequency: Rate,
    cycles: u32,
    /// Written by the handler of `SysTick` alone. One core: all of its contexts see what was stored.
    count: AtomicU32,
    /// When, if at all, the handler is to say so.
    at: AtomicU32,
    /// Set by who arms, and taken back by the handler.
    armed: AtomicBool,
}

impl Ticks {
    /// Makes a timer with a tick every `cycles` core cycles, on a core with `core_hz` cycles per
    /// second.
    ///
    /// # Panics
    /// If `cycles` is not 2 to 2^24, or `core_hz` is 0; in a constant, that is an error of
    /// compilation.
    #[must_use]
    pub const fn new(core_hz: u32, cycles: u32) -> Self {
        assert!(
            cycles >= 2 && cycles <= 1 << 24,
            "SysTick counts 2 to 2^24 cycles"
        );
        Self {
            frequency: Rate::fraction(core_hz, cycles),
            cycles,
            count: AtomicU32::new(0),
            at: AtomicU32::new(0),
            armed: AtomicBool::new(false),
        }
    }

    /// Returns the clock of a timer that was made by [`new`](Self::new) with the same arguments. An
    /// [`EventTable`](crate::EventTable) for this timer needs it.
    ///
    /// # Panics
    /// If `core_hz` or `cycles` is 0; in a constant, that is an error of compilation.
    #[must_use]
    pub const fn clock(core_hz: u32, cycles: u32) -> ClockSpec {
        ClockSpec::of::<Wrapping<32>>(Rate::fraction(core_hz, cycles))
    }

    /// Starts `SysTick`, and enables its interrupt. Call it before
    /// [`Loops::start`](crate::Loops::start).
    pub fn begin(&self, mut timer: SYST) {
        timer.set_clock_source(SystClkSource::Core);
        timer.set_reload(self.cycles - 1);
        timer.clear_current();
        timer.enable_counter();
        timer.enable_interrupt();
    }

    /// Counts a tick, and pends `PendSV` if a loop is due. Call this from the handler of `SysTick`,
    /// and [`Scheduler::on_timer`](crate::Scheduler::on_timer) from the handler of `PendSV`.
    #[inline]
    pub fn on_tick(&self) {
        // SAFETY: the register is the core's; the read clears COUNTFLAG, which is this timer's.
        let csr = unsafe { (*SYST::PTR).csr.read() };
        if csr & COUNTFLAG != 0 {
            let count = self.count.load(Ordering::Relaxed).wrapping_add(1);
            self.count.store(count, Ordering::Relaxed);
        }
        let at = Wrapping::<32>::new(self.at.load(Ordering::Relaxed));
        if self.armed.load(Ordering::Relaxed) && self.now().has_reached(at) {
            // One interrupt for one instant. What is armed meanwhile is armed after this.
            self.armed.store(false, Ordering::Relaxed);
            SCB::set_pendsv();
        }
    }
}

impl Alarm for Ticks {
    const LEVELS: u8 = 2;

    #[inline]
    fn pend(&self) {
        SCB::set_pendsv();
    }
}

impl Timer for Ticks {
    type Instant = Wrapping<32>;

    #[inline]
    fn frequency(&self) -> Rate {
        self.frequency
    }

    #[inline]
    fn now(&self) -> Wrapping<32> {
        Wrapping::new(self.count.load(Ordering::Relaxed))
    }

    #[inline]
    fn arm(&self, at: Wrapping<32>) -> Armed {
        // Every tick asks whether the instant has come, so none is lost; a tick between the two
        // stores asks once too often, or for one that is not armed.
        self.at.store(at.count(), Ordering::Relaxed);
        self.armed.store(true, Ordering::Relaxed);
        if self.now().has_reached(at) {
            Armed::Past
        } else {
            Armed::Ahead
        }
    }

    #[inline]
    fn disarm(&self) {
        self.armed.store(false, Ordering::Relaxed);
    }
}
