//! The variables that loops show and the parameters that others can set: the tables of condor-vars in a
//! program that [`Setup`](crate::Setup) makes.

use core::fmt;
use core::num::NonZeroU64;

use condor_mbox::{Doorbell, Evidence, LoadOrder, MemoryWindow as _, Processor, Windows, layout};
use condor_mos::Rate;
use condor_vars::{CatalogError, Sampler, Selections, VariableServer, Watch};

use crate::error::ProgramError;
use crate::machine::Machine;
use crate::text::ShortText;

/// The greatest number of variables that a program can show, and also the greatest number of its
/// parameters. A block counts as one.
pub const VARIABLES: usize = 32;
/// The capacity of a loop: all of them, and pieces that a selection may be in.
const CAPACITY: usize = 24;
const _: () = assert!(3 * CAPACITY >= 2 * VARIABLES, "a loop may show them all");
/// For what part of a second a ring keeps rows of all variables.
const KEPT: u32 = 8;

pub(crate) type LoopDesk = Selections<CAPACITY>;
pub(crate) type LoopServer<'d, M> =
    VariableServer<'d, <M as Machine>::Window, <M as Machine>::Exclusion, CAPACITY>;
pub(crate) type LoopSampler<'d, M> = Sampler<'d, <M as Machine>::Window, CAPACITY>;

/// Returns the number of rows of all variables for which a ring has room.
pub(crate) fn rows(rate: Rate) -> u32 {
    let hz = rate.numerator().checked_div(rate.denominator());
    hz.unwrap_or(0) / KEPT
}

/// Returns the error that says why the variables of the loop `name` cannot be shown.
pub(crate) fn wrong(name: &str, error: CatalogError) -> ProgramError {
    match error {
        CatalogError::Access(error) => ProgramError::no_room(name, error),
        error => ProgramError::Variables {
            name: ShortText::of(name),
            error,
        },
    }
}

/// Returns the incarnation of a processor's program that runs; 0 if none runs.
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
pub(crate) fn name_of(watched: &dyn Watch) -> ShortText<32> {
    struct First<'w>(&'w dyn Watch);
    impl fmt::Display for First<'_> {
        fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            self.0.name(0, f)
        }
    }
    ShortText::of(&First(watched))
}

/// Instants of a timer, in nanoseconds.
#[derive(Clone, Copy)]
pub(crate) struct Nanoseconds {
    /// Ticks in as many seconds.
    ticks: NonZeroU64,
    seconds: u64,
}

impl Nanoseconds {
    pub(crate) fn of(frequency: Rate) -> Self {
        Self {
            // A rate has none of 0.
            ticks: NonZeroU64::new(frequency.numerator().into()).unwrap_or(NonZeroU64::MIN),
            seconds: frequency.denominator().into(),
        }
    }

    /// Converts `ticks` of the timer to the time of the doorbell's clock, in nanoseconds.
    pub(crate) fn at(self, ticks: u64) -> u64 {
        const SECOND: u64 = 1_000_000_000;
        let whole = (ticks / self.ticks).wrapping_mul(SECOND * self.seconds);
        let rest = (ticks % self.ticks).wrapping_mul(SECOND) / self.ticks;
        whole.wrapping_add(rest.wrapping_mul(self.seconds))
    }
}
