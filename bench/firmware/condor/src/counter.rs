//! The free-running counter of 32 bits and the one-shot alarm, as a timer.

use board::timer;
use condor_mos::{Armed, Clock, Rate, Timer, Wrapping};

const FREQUENCY: Rate = Rate::hz(timer::HERTZ);

/// What the event table is made for.
pub(crate) const CLOCK: Clock = Clock::of::<Wrapping<32>>(FREQUENCY);

/// The counter and the alarm of the board.
pub(crate) struct Counter;

impl Counter {
    /// Sets the counter to 0. The alarm has the highest priority after a reset.
    pub(crate) fn prepare() {
        timer::stop_at_zero();
    }
}

impl Timer for Counter {
    type Instant = Wrapping<32>;

    #[inline]
    fn frequency(&self) -> Rate {
        FREQUENCY
    }

    #[inline]
    fn now(&self) -> Wrapping<32> {
        Wrapping::new(timer::now())
    }

    /// The alarm counts down what is left, at least one tick, so the interrupt always comes.
    #[inline]
    fn arm(&self, at: Wrapping<32>) -> Armed {
        timer::arm(at.count());
        Armed::Ahead
    }

    fn disarm(&self) {
        timer::stop_alarm();
    }
}
