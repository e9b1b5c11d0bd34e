//! The three loops, and their interrupts.

use board::body::body;
use board::{LOOPS, RATES, report, switch_off, timer};
use condor_mos::{ClockSpec, EventTable, LoopId, Loops, Overrun, Rate, Scheduler, Wrapping};
use cortex_m::singleton;

use crate::Kept;
use crate::platform::Board;

const CLOCK: ClockSpec = ClockSpec::of::<Wrapping<32>>(Rate::hz(timer::HERTZ));
const HERTZ: [Rate; LOOPS] = [Rate::hz(RATES[0]), Rate::hz(RATES[1]), Rate::hz(RATES[2])];

/// Eight events of the fastest loop in a hyperperiod; the others are due with some of them.
const EVENTS: usize = 8;

static SCHEDULER: Scheduler<Board, LOOPS, EVENTS, Kept> =
    Scheduler::keeping(Board, EventTable::new(&HERTZ, CLOCK));

#[cortex_m_rt::entry]
fn main() -> ! {
    let started = cortex_m::Peripherals::take().is_some_and(|mut core| {
        Board::prepare(&mut core.NVIC);
        start().is_some()
    });
    if !started {
        switch_off(false);
    }
    report::loops()
}

fn start() -> Option<()> {
    let assign = |id, body: fn(&mut (), Wrapping<32>), context: &'static mut ()| {
        SCHEDULER
            .assign(LoopId(id), Overrun::Skip, body, context)
            .ok()
    };
    assign(0, |(), _| body::<0>(), singleton!(: () = ())?)?;
    assign(1, |(), _| body::<1>(), singleton!(: () = ())?)?;
    assign(2, |(), _| body::<2>(), singleton!(: () = ())?)?;
    SCHEDULER.start().ok()
}

/// Handles the alarm, and is the vector of rank 0.
// SAFETY: the name is that of the interrupt in the vector table, and only the hardware calls it.
#[unsafe(no_mangle)]
extern "C" fn TIMER0() {
    timer::acknowledge();
    SCHEDULER.on_timer();
}

/// Is the vector of rank 1.
// SAFETY: as above.
#[unsafe(no_mangle)]
extern "C" fn SPARE1() {
    SCHEDULER.on_vector(1);
}

/// Is the vector of rank 2.
// SAFETY: as above.
#[unsafe(no_mangle)]
extern "C" fn SPARE2() {
    SCHEDULER.on_vector(2);
}
