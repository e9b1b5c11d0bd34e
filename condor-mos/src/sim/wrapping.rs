//! [`WrappingProcessor`]: a simulated processor whose counter wraps.

use super::SimPlatform;
use crate::instant::{CounterReading, Wrapping};
use crate::platform::Platform;
use crate::rate::Rate;
use crate::timer::{Armed, Timer};

/// A [`SimPlatform`] whose timer has a counter of only `BITS` bits, which wraps, as hardware with 16 or 32 bits does.
#[derive(Clone)]
pub struct WrappingProcessor<const BITS: u32>(pub SimPlatform);

impl<const BITS: u32> Timer for WrappingProcessor<BITS> {
    type Instant = Wrapping<BITS>;

    fn frequency(&self) -> Rate {
        Timer::frequency(&self.0)
    }

    fn now(&self) -> Wrapping<BITS> {
        Wrapping::new(Timer::now(&self.0) as u32)
    }

    fn arm(&self, at: Wrapping<BITS>) -> Armed {
        let now = self.0.access();
        let shown = Wrapping::<BITS>::new(now as u32);
        if shown.has_reached(at) {
            self.0.disarm();
            return Armed::Past;
        }
        self.0.arm_for(now + u64::from(at.since(shown)));
        Armed::Ahead
    }

    fn disarm(&self) {
        self.0.disarm();
    }
}

impl<const BITS: u32> Platform for WrappingProcessor<BITS> {
    fn interruptible(&self, rank: u32, body: impl FnOnce()) {
        self.0.interruptible(rank, body);
    }
}
