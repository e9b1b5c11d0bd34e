//! [`ServoLoop`], and how a machine runs loops.

use core::num::NonZeroU64;
use core::time::Duration;

use condor_mos::{
    ClockSpec, EventTable, Histograms, LoopId, Loops, Overrun, Platform, Rate, RateError, Scheduler,
};
use heapless::Vec;

use crate::error::ProgramError;
use crate::list::fitting;

/// The greatest number of servo loops that a program can have.
pub const LOOPS: usize = 8;
/// Entries of the event table that a program's loops have, enough for 500 Hz beside 1 Hz; rates that take more are
/// computed. The table has 16 bytes for each.
const ENTRIES: usize = 512;

/// A servo loop that a program passes to [`Machine::with_loops`](crate::Machine::with_loops).
/// Programs that use [`Setup`](crate::Setup) do not need this type.
pub struct ServoLoop<'b> {
    /// The rate at which the loop is released.
    pub rate: Rate,
    /// The policy for an overrun: the loop is due again before its last run has finished.
    pub overrun: Overrun,
    /// The function that runs at each release. Its argument is the instant at which the release was
    /// due, in ticks of the machine's timer.
    pub body: &'b mut (dyn FnMut(u64) + Send),
}

/// Runs `background` and returns its result. Meanwhile `loops` interrupt it, on the same stack,
/// whenever they are due by the timer of `platform`, `ahead` of the instants in the middle of periods. Most machines implement
/// [`with_loops`](crate::Machine::with_loops) by this.
///
/// # Errors
/// [`ProgramError::Rate`] if the rates cannot be scheduled, [`ProgramError::Loop`] or [`ProgramError::Start`] if the
/// loops cannot start; `background` has not run then.
pub fn on_one_stack<P, R>(
    platform: P,
    loops: &mut [ServoLoop<'_>],
    ahead: Duration,
    background: impl FnOnce(&dyn Loops<Instant = u64>) -> R,
) -> Result<R, ProgramError>
where
    P: Platform<Instant = u64> + Sync,
{
    let rates = rates(loops)?;
    let start = first_release(platform.now(), platform.frequency(), &rates, ahead);
    let clock = ClockSpec::of::<u64>(platform.frequency());
    let table = EventTable::or_scan(&rates, &[], clock)?;
    let scheduler = Scheduler::<_, LOOPS, ENTRIES, Histograms>::keeping(platform, table);
    run(&scheduler, loops, start, || background(&scheduler))
}

/// When loops begin: `ahead` of the next instant in the middle of a period of the fastest of them, counted
/// from the beginning of the machine's time.
///
/// So loops of the same rate are released at the same instants on all processors that share a
/// clock. Loops of twice, four times, … that rate are released between these instants.
pub(crate) fn first_release(now: u64, frequency: Rate, rates: &[Rate], ahead: Duration) -> u64 {
    let next = || {
        let per_ns = u64::from(frequency.denominator()).checked_mul(1_000_000_000)?;
        let ahead = u64::try_from(ahead.as_nanos()).ok()?;
        let ahead = ahead
            .checked_mul(frequency.numerator().into())?
            .checked_div(per_ns)?;
        let now = now.checked_add(ahead)?;
        let fastest = rates.iter().max()?;
        let product = |a: u32, b: u32| NonZeroU64::new(u64::from(a) * u64::from(b));
        // A period is `ticks / of` ticks of the timer; `ticks` of the timer are a whole number of them.
        let ticks = product(frequency.numerator(), fastest.denominator())?;
        let of = product(frequency.denominator(), fastest.numerator())?;
        let half = of.checked_mul(const { NonZeroU64::new(2).unwrap() })?;
        let whole = ceiling((now % ticks).checked_mul(half.get())?, ticks) / 2;
        let middle = ceiling((2 * whole + 1).checked_mul(ticks.get())?, half);
        (now - now % ticks).checked_add(middle)?.checked_sub(ahead)
    };
    // With numbers that no processor has, they begin now.
    next().unwrap_or(now)
}

fn ceiling(dividend: u64, divisor: NonZeroU64) -> u64 {
    dividend / divisor + u64::from(dividend % divisor != 0)
}

/// The rates of loops, in their order.
pub(crate) fn rates(loops: &[ServoLoop<'_>]) -> Result<Vec<Rate, LOOPS>, RateError> {
    let too_many = RateError::Loops {
        loops: loops.len(),
        capacity: LOOPS,
    };
    let rates = loops.iter().map(|one| one.rate);
    (loops.len() <= LOOPS)
        .then(|| fitting(rates))
        .ok_or(too_many)
}

/// Runs loops by whatever runs them, with a background.
pub(crate) fn run<R>(
    by: &impl Loops<Instant = u64>,
    loops: &mut [ServoLoop<'_>],
    start: u64,
    background: impl FnOnce() -> R,
) -> Result<R, ProgramError> {
    by.scope(|scope| {
        for (id, one) in (0..).map(LoopId).zip(loops) {
            scope.assign(id, one.overrun, &mut one.body)?;
        }
        Ok(by.run_from(start, background)?)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loops_begin_in_the_middle_of_a_period() {
        let ns = Rate::hz(1_000_000_000);
        let at = |now, frequency, rate| {
            first_release(now, frequency, &[rate, Rate::hz(1)], Duration::ZERO)
        };
        for now in [0, 1, 1_250_000] {
            assert_eq!(at(now, ns, Rate::hz(400)), 1_250_000);
        }
        for now in [1_250_001, 2_500_000, 3_750_000] {
            assert_eq!(at(now, ns, Rate::hz(400)), 3_750_000);
        }
        // The instants of 50 Hz are between those of 400 Hz.
        let slow = at(86_400_000_000_001, ns, Rate::hz(50));
        assert_eq!((slow % 20_000_000, slow % 2_500_000), (10_000_000, 0));
        // A period of 10 000 000 / 3 ns: the beginning of the third is 6 666 667.
        assert_eq!(at(5_000_001, ns, Rate::hz(300)), 8_333_334);
        // 2.5 Hz by a timer of 32 768 Hz: a period of 13 107.2 ticks.
        let rate = Rate::new(5, 2).unwrap();
        assert_eq!(at(0, Rate::hz(32_768), rate), 6_554);
        assert_eq!(at(6_555, Rate::hz(32_768), rate), 19_661);
        assert_eq!(first_release(7, ns, &[], Duration::ZERO), 7);
        let ahead = |now| first_release(now, ns, &[Rate::hz(2000)], Duration::from_micros(50));
        assert_eq!(
            [0, 200_000, 200_001].map(ahead),
            [200_000, 200_000, 700_000]
        );
        let by_32_khz = |now| {
            first_release(
                now,
                Rate::hz(32_768),
                &[Rate::hz(4)],
                Duration::from_secs(1),
            )
        };
        assert_eq!([0, 4096, 4097].map(by_32_khz), [4096, 4096, 12_288]);
        assert_eq!(at(u64::MAX, ns, Rate::hz(400)), u64::MAX);
    }
}
