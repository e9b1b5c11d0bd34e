//! A tickless monotonic: the free-running counter of 32 bits and a one-shot alarm.
//!
//! Ticks of 32 bits are the cheapest that RTIC knows. A counter that wraps, extended to 64 bits,
//! would cost more at every look at the time.

use board::{Interrupt, hardware_priority, timer};
use cortex_m::peripheral::NVIC;
use rtic_time::timer_queue::{TimerQueue, TimerQueueBackend};

static QUEUE: TimerQueue<Counter> = TimerQueue::new();

/// The counter and the alarm of the board.
pub(crate) struct Counter;

impl Counter {
    /// Sets the counter to 0, and has the alarm served at the highest priority, as the monotonics
    /// of `rtic-monotonics` do.
    pub(crate) fn prepare(nvic: &mut NVIC) {
        timer::stop_at_zero();
        QUEUE.initialize(Self);
        // SAFETY: no lock of this firmware relies on the priority of the alarm.
        unsafe {
            nvic.set_priority(
                Interrupt::TIMER0,
                hardware_priority(1 << board::NVIC_PRIO_BITS),
            );
            NVIC::unmask(Interrupt::TIMER0);
        }
    }
}

impl TimerQueueBackend for Counter {
    type Ticks = u32;

    fn now() -> u32 {
        timer::now()
    }

    fn set_compare(instant: u32) {
        timer::arm(instant);
    }

    fn clear_compare_flag() {
        timer::acknowledge();
    }

    fn pend_interrupt() {
        NVIC::pend(Interrupt::TIMER0);
    }

    fn timer_queue() -> &'static TimerQueue<Self> {
        &QUEUE
    }
}

/// Handles the interrupt of the alarm.
// SAFETY: the name is that of the interrupt in the vector table, and only the hardware calls it.
#[unsafe(no_mangle)]
extern "C" fn TIMER0() {
    // SAFETY: this is the interrupt of the monotonic's timer.
    unsafe { QUEUE.on_monotonic_interrupt() };
}
