//! The three loops as loops of condor-mos, in an event table, with a vector of the NVIC each.
#![no_std]
#![no_main]

mod counter;

use board::body::body;
use board::{Interrupt, LOOPS, NVIC_PRIO_BITS, RATES, report, switch_off};
use condor_mos::cortex_m::Vectors;
use condor_mos::{EventTable, LoopId, Overrun, Rate, Scheduler};
use cortex_m::peripheral::NVIC;
use counter::{CLOCK, Counter};

/// Events of a hyperperiod of 20 ms.
const EVENTS: usize = (RATES[0] / RATES[LOOPS - 1]) as usize;

/// What a loop has that has nothing.
type Nothing = [u8; 0];

static SCHEDULER: Scheduler<Vectors<Counter, LOOPS>, EventTable<LOOPS, EVENTS>, LOOPS> =
    Scheduler::new(
        Vectors::new(
            Counter,
            [
                Interrupt::SPARE0 as u16,
                Interrupt::SPARE1 as u16,
                Interrupt::SPARE2 as u16,
            ],
            NVIC_PRIO_BITS,
        ),
        EventTable::new(
            [Rate::hz(RATES[0]), Rate::hz(RATES[1]), Rate::hz(RATES[2])],
            CLOCK,
        ),
    );

#[cortex_m_rt::entry]
fn main() -> ! {
    let Some(mut core) = cortex_m::Peripherals::take() else {
        switch_off(false);
    };
    Counter::prepare();
    // SAFETY: no lock of this firmware relies on priorities or on disabled interrupts.
    unsafe {
        SCHEDULER.platform().enable(&mut core.NVIC);
        NVIC::unmask(Interrupt::TIMER0);
    }
    let assigned =
        assign(0, |_| body::<0>()) && assign(1, |_| body::<1>()) && assign(2, |_| body::<2>());
    if !assigned || SCHEDULER.start().is_err() {
        switch_off(false);
    }
    report::loops()
}

/// Gives a loop its body, which keeps nothing from one run to the next.
fn assign(number: u8, body: fn(&mut Nothing)) -> bool {
    SCHEDULER
        .assign(LoopId(number), Overrun::Skip, body, &mut [])
        .is_ok()
}

/// The interrupt of the alarm.
// SAFETY: the name is that of the interrupt in the vector table, and only the hardware calls it.
#[unsafe(no_mangle)]
extern "C" fn TIMER0() {
    board::timer::acknowledge();
    SCHEDULER.on_timer();
}

/// The vector of the fastest loop.
// SAFETY: as above.
#[unsafe(no_mangle)]
extern "C" fn SPARE0() {
    SCHEDULER.on_vector(0);
}

/// The vector of the second loop.
// SAFETY: as above.
#[unsafe(no_mangle)]
extern "C" fn SPARE1() {
    SCHEDULER.on_vector(1);
}

/// The vector of the slowest loop.
// SAFETY: as above.
#[unsafe(no_mangle)]
extern "C" fn SPARE2() {
    SCHEDULER.on_vector(2);
}
