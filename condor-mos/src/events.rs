//! How a timer's interrupt keeps up with events, and never loses the next one.

use crate::instant::Instant;
use crate::timer::{Armed, Timer};

/// Events that one interrupt catches up with before the background gets a chance.
const MOST_EVENTS: u32 = 1024;

/// Passes the events up to now, the next of which is `due`, and arms the timer for the one that
/// follows. `pass_event` gives the instant of the one after.
///
/// If `due` has not come, the interrupt was early, and only arms.
#[inline]
pub(crate) fn keep_up<T: Timer>(
    timer: &T,
    due: T::Instant,
    mut pass_event: impl FnMut() -> T::Instant,
) {
    if !timer.now().has_reached(due) && timer.arm(due) == Armed::Ahead {
        return;
    }
    for _ in 0..MOST_EVENTS {
        if timer.arm(pass_event()) == Armed::Ahead {
            return;
        }
    }
    pause(timer);
}

/// Events come faster than they can be counted: comes back to them after a while.
#[cold]
fn pause<T: Timer>(timer: &T) {
    let longest = 1 << (T::Instant::BITS.min(32) - 2);
    let mut ticks = 1;
    while timer.arm(timer.now().after(ticks)) == Armed::Past && ticks < longest {
        ticks <<= 1;
    }
}
