//! The way in which a timer's interrupt keeps up with events, and never loses the next one.

use crate::instant::CounterReading;
use crate::timer::{Armed, Timer};

/// Events that one interrupt catches up with before the background gets a chance.
const MOST_EVENTS: u32 = 1024;

/// Passes events, the first of which is due, and arms the timer for the first that is ahead. `pass_event`
/// returns the instant of the event after the one that it passes. Returns an instant that is not earlier than
/// any event that was passed: an earlier reading would be.
#[cold]
pub(crate) fn catch_up<T: Timer>(
    timer: &T,
    mut pass_event: impl FnMut() -> T::Instant,
) -> T::Instant {
    for _ in 0..MOST_EVENTS {
        if timer.arm(pass_event()) == Armed::Ahead {
            return timer.now();
        }
    }
    // Events come faster than they can be counted: come back to them after a while.
    let longest = 1 << (T::Instant::BITS.min(32) - 2);
    let mut ticks = 1;
    while timer.arm(timer.now().after(ticks)) == Armed::Past && ticks < longest {
        ticks <<= 1;
    }
    timer.now()
}
