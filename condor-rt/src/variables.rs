//! What loops show and let set: the tables of condor-vars in a program that
//! [`Setup`](crate::Setup) makes.

use core::fmt;

use condor_mbox::{Doorbell, Evidence, LoadOrder, MemoryWindow as _, Processor, Windows, layout};
use condor_mos::Rate;
use condor_vars::{CatalogError, Desk, Sampler, Server, Watch};

use crate::error::{Error, Text};
use crate::machine::Machine;

/// The most variables of a program, or blocks of them, and the most parameters.
pub const VARIABLES: usize = 32;
/// How many programs can watch a loop at a time.
const WATCHERS: usize = 4;
/// Pieces that a selection may be in.
const PIECES: usize = 24;
/// For what part of a second a ring keeps rows of all variables.
const KEPT: u32 = 8;

pub(crate) type LoopDesk = Desk<PIECES, WATCHERS>;
pub(crate) type LoopServer<'d, M> =
    Server<'d, <M as Machine>::Window, <M as Machine>::Exclusion, PIECES, WATCHERS>;
pub(crate) type LoopSampler<'d, M> =
    Sampler<'d, <M as Machine>::Window, { 2 * VARIABLES }, PIECES, WATCHERS>;

/// How many rows of all variables a ring has room for.
pub(crate) const fn rows(rate: Rate) -> u32 {
    match rate.numerator().checked_div(rate.denominator()) {
        Some(hz) => hz / KEPT,
        None => 0,
    }
}

/// Why the variables of the loop `name` cannot be shown.
pub(crate) fn wrong(name: &str, error: CatalogError) -> Error {
    match error {
        CatalogError::Access(error) => Error::no_room(name, error),
        error => Error::Variables {
            name: Text::of(name),
            error,
        },
    }
}

/// Which incarnation of a processor's program lives; 0 if none does.
pub(crate) fn incarnation<M: Machine, const N: usize>(
    windows: &[Windows<M::Window>; N],
    doorbell: &M::Doorbell,
    processor: Processor,
) -> u32 {
    let Some(Windows { mail, .. }) = windows.get(processor.index()) else {
        return 0;
    };
    if doorbell.evidence(processor) == Evidence::Dead {
        return 0;
    }
    let incarnation = mail.load(layout::header::INCARNATION, LoadOrder::Acquire);
    incarnation.unwrap_or(0)
}

/// The name of what is watched; of a block the first.
pub(crate) fn name_of(watched: &dyn Watch) -> Text<32> {
    struct First<'w>(&'w dyn Watch);
    impl fmt::Display for First<'_> {
        fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            self.0.name(0, f)
        }
    }
    Text::of(&First(watched))
}

/// Instants of a timer, in nanoseconds.
#[derive(Clone, Copy)]
pub(crate) struct Nanoseconds(Rate);

impl Nanoseconds {
    pub(crate) const fn of(frequency: Rate) -> Self {
        Self(frequency)
    }

    /// As the clock of the processor's doorbell tells them.
    pub(crate) fn at(self, ticks: u64) -> u64 {
        const SECOND: u64 = 1_000_000_000;
        let (ticks_in, seconds) = (
            u64::from(self.0.numerator()),
            u64::from(self.0.denominator()),
        );
        // A rate is above 0.
        let parts = |ticks: u64| ticks.checked_div(ticks_in).unwrap_or(0);
        let whole = parts(ticks);
        let rest = ticks.wrapping_sub(whole.wrapping_mul(ticks_in));
        let whole = whole.wrapping_mul(SECOND * seconds);
        let rest = parts(rest.wrapping_mul(SECOND));
        whole.wrapping_add(rest.wrapping_mul(seconds))
    }
}
