//! The variables that loops show and the parameters that others can set: the tables of condor-vars in a
//! program that [`Setup`](crate::Setup) makes.

use core::fmt;
use core::num::NonZeroU64;
use core::ops::RangeInclusive;
use core::sync::atomic::AtomicU32;

use condor_mbox::{Doorbell, Evidence, LoadOrder, MemoryWindow as _, Processor, Windows, layout};
use condor_mos::Rate;
use condor_vars::{
    CatalogError, Param, ParamRefusal, Sampler, Selections, Tune, VarDescription, VariableServer,
    Watch,
};

use crate::error::ProgramError;
use crate::machine::Machine;
use crate::text::ShortText;

/// The greatest number of variables that a program can show, and also the greatest number of its
/// parameters. A block counts as one.
pub const VARIABLES: usize = 32;
/// The capacity of a loop: all of them, and pieces that a selection may be in.
const CAPACITY: usize = 24;
const _: () = assert!(
    3 * CAPACITY > 2 * VARIABLES,
    "a loop may show them all, and its rate"
);
/// For what part of a second a ring keeps rows of all variables.
const KEPT: u32 = 8;
/// The most rows that a ring keeps of a loop that has nothing but its rate.
const BARE_ROWS: u32 = 32;

pub(crate) type LoopDesk = Selections<CAPACITY>;
pub(crate) type LoopServer<'d, M> =
    VariableServer<'d, <M as Machine>::Window, <M as Machine>::Exclusion, CAPACITY>;
pub(crate) type LoopSampler<'d, M> = Sampler<'d, <M as Machine>::Window, CAPACITY>;

/// Returns the number of rows of all variables for which a ring has room. A loop is `bare` if it has no variables and
/// no parameters of its program.
pub(crate) fn rows(rate: Rate, bare: bool) -> u32 {
    let hz = rate.numerator().checked_div(rate.denominator());
    let rows = hz.unwrap_or(0) / KEPT;
    if bare { rows.min(BARE_ROWS) } else { rows }
}

/// The rates that others may set for a loop.
pub(crate) enum RateBounds {
    /// From 0 to the loop's own rate: loops that were in time with this one still are if it is slower.
    Slower,
    /// In Hz.
    Within(RangeInclusive<f64>),
    /// The loop keeps its rate.
    Fixed,
}

/// The parameter `LOOP.hz`, by which others set the rate of a loop.
pub(crate) struct RateParam<'e> {
    of: &'e str,
    /// The rate with which the loop begins.
    first: Rate,
    hz: Param<f64>,
}

impl<'e> RateParam<'e> {
    /// Returns the parameter of the loop `of`, unless nobody may set its rate.
    pub(crate) fn new(of: &'e str, rate: Rate, bounds: &RateBounds) -> Option<Self> {
        let hz = rate.as_hz();
        let bounds = match bounds {
            RateBounds::Slower => 0.0..=hz,
            RateBounds::Within(bounds) => bounds.clone(),
            RateBounds::Fixed => return None,
        };
        let hz = Param::new("", "Hz", hz, bounds);
        let hz = hz.about("The rate of the loop; at 0, if that is allowed, it rests.");
        Some(Self {
            of,
            first: rate,
            hz,
        })
    }

    /// Returns the rate of so many hertz: exactly the one with which the loop begins, or another in whole thousandths of a
    /// hertz; `None` if the loop is to rest.
    pub(crate) fn rate_of(&self, hz: f64) -> Option<Rate> {
        let is_first = hz.to_bits() == self.first.as_hz().to_bits();
        if is_first {
            Some(self.first)
        } else {
            rate_of(hz)
        }
    }

    /// Returns the rate that was set last, in Hz.
    pub(crate) fn wanted(&self) -> f64 {
        let [low, high] = self.hz.wanted(0);
        f64::from_bits(u64::from(high) << 32 | u64::from(low))
    }
}

/// Returns the rate of so many hertz, in whole thousandths of them; `None` if the loop is to rest.
pub(crate) fn rate_of(hz: f64) -> Option<Rate> {
    // A number below 0, which no bounds allow, becomes 0.
    #[allow(clippy::cast_sign_loss)]
    Rate::new((hz * 1000.0 + 0.5) as u32, 1000)
}

impl Watch for RateParam<'_> {
    fn words(&self) -> &[AtomicU32] {
        self.hz.words()
    }

    fn describe(&self, index: usize) -> Option<VarDescription<'_>> {
        self.hz.describe(index)
    }

    fn name(&self, _: usize, to: &mut dyn fmt::Write) -> fmt::Result {
        write!(to, "{}.hz", self.of)
    }
}

impl Tune for RateParam<'_> {
    fn compare_and_set_words(
        &self,
        index: usize,
        expected: [u32; 2],
        new: [u32; 2],
    ) -> Result<(), ParamRefusal> {
        self.hz.compare_and_set_words(index, expected, new)
    }

    fn wanted(&self, index: usize) -> [u32; 2] {
        self.hz.wanted(index)
    }

    fn initial(&self, index: usize) -> [u32; 2] {
        self.hz.initial(index)
    }

    fn latch(&self) {
        self.hz.latch();
    }

    fn is_sound(&self) -> bool {
        self.hz.is_sound()
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_rate_comes_back_exactly() {
        let first = Rate::new(400, 3).unwrap();
        let hz = RateParam::new("servo", first, &RateBounds::Slower).unwrap();
        assert_eq!(hz.rate_of(hz.wanted()), Some(first));
        assert_eq!(hz.rate_of(133.25), Rate::new(133_250, 1000));
        assert_eq!(hz.rate_of(0.0), None);
    }
}
