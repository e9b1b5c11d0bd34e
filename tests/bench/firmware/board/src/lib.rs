//! The board and the bench that all firmwares of the instruction counts share: QEMU's machine
//! `mps2-an385`, a Cortex-M3 at 25 MHz.
//!
//! # How instructions are counted
//!
//! QEMU runs with `-icount shift=7`: every instruction takes 2⁷ ns of virtual time, whatever it
//! does, and an exception none. The free-running [counter](timer::now) counts in 40 ns, that is
//! 3.2 ticks an instruction. A difference of two counts is off by less than one tick, hence the
//! number of instructions between them is known exactly. These are instructions, not cycles:
//! what a core takes to stack registers and to fill its pipeline is not in them.
//!
//! * **Per release**: [`background::until`] is a loop of four instructions that counts its turns
//!   until the slowest loop has run a number of times. The instructions that have passed, less
//!   those of the turns, were taken by interrupts: all of them, from the timer's to the return to
//!   the background. The interval starts and ends when a first release of a hyperperiod has been
//!   dealt with, so it holds whole hyperperiods.
//! * **To the body**: the first thing that the [body](body::body) of a loop does is to read the
//!   counter. The alarm goes off a constant number of ticks after the instant for which it was
//!   [armed](timer::arm), so what the body read, less that instant and that constant, is what
//!   passed between the interrupt and the body. `calibration` measures the constant with a
//!   handler that starts with the body.
//!
//! `calibration` also counts sequences of known length in both ways; the host refuses to go on
//! when it does not find them.
//!
//! # What a firmware has to do
//!
//! 1. [`timer::stop_at_zero`], then make [`LOOPS`] loops of [`PERIODS`] whose releases are at
//!    `k * period` for `k` = 0, 1, …; those at 0 may run at once. Loop `N` calls
//!    [`body::<N>`](body::body) and does nothing else.
//! 2. Take the time from [`timer::now`], and one-shot alarms from [`timer::arm`] and
//!    [`timer::acknowledge`] alone. The alarm is [`Interrupt::TIMER0`] at the highest priority;
//!    [`Interrupt::SPARE0`] and the others have no source and can be pended.
//! 3. Call [`report::loops`] as the background. It starts the counter and ends QEMU.
#![no_std]

pub mod background;
pub mod body;
mod interrupts;
mod panicking;
pub mod report;
pub mod timer;

pub use interrupts::{Interrupt, NVIC_PRIO_BITS, hardware_priority};

/// RTIC looks for the interrupts by this name, too.
pub use interrupts::Interrupt as interrupt;

/// The number of loops.
pub const LOOPS: usize = 3;

/// The rates of the loops in hertz, the fastest first.
pub const RATES: [u32; LOOPS] = [400, 100, 50];

/// The periods of the loops in ticks; none leaves a remainder.
pub const PERIODS: [u32; LOOPS] = [
    timer::HERTZ / RATES[0],
    timer::HERTZ / RATES[1],
    timer::HERTZ / RATES[2],
];

/// Ends QEMU, with success or not.
pub fn switch_off(success: bool) -> ! {
    use cortex_m_semihosting::debug;

    loop {
        debug::exit(if success {
            debug::EXIT_SUCCESS
        } else {
            debug::EXIT_FAILURE
        });
    }
}
