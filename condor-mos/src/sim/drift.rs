//! Whether a schedule drifts.

use crate::rate::{Rate, greatest_common_divisor};
use crate::schedule::EventTable;

/// Runs `schedule` from its beginning through `hyperperiods` repetitions of its releases, and returns the largest
/// distance of any release of any loop from its exact instant, in ticks.
///
/// The exact instants are computed as fractions, so the error is that of the schedule alone. A schedule that only
/// rounds is never off by more than one tick; if a schedule drifts, its error grows with `hyperperiods`.
///
/// ```
/// use condor_mos::sim::worst_release_error;
/// use condor_mos::{ClockSpec, EventTable, Rate};
///
/// // 3 Hz is no whole number of ticks.
/// let clock = ClockSpec::of::<u64>(Rate::hz(1000));
/// let mut table = EventTable::<2, 8>::new(&[Rate::hz(3), Rate::hz(2)], clock);
/// assert!(worst_release_error(&mut table, 1000) <= 0.5);
/// ```
pub fn worst_release_error<const L: usize, const E: usize>(
    schedule: &mut EventTable<L, E>,
    hyperperiods: u64,
) -> f64 {
    schedule.restart();
    let frequency = schedule.clock().frequency();
    // Releases since the beginning, and ticks between two of them as a fraction.
    let mut releases = [0_u64; L];
    let period = |rate: &Rate| {
        let product = |a: u32, b: u32| u128::from(a) * u128::from(b);
        (
            product(rate.denominator(), frequency.numerator()),
            product(rate.numerator(), frequency.denominator()),
        )
    };
    let periods: Vec<_> = schedule.rates().iter().map(period).collect();
    let end = hyperperiods * releases_of_first(schedule.rates());
    let (mut now, mut worst) = (0_u64, 0.0_f64);
    while releases[0] <= end {
        // No change of rates takes effect.
        if schedule.is_at_turn() {
            schedule.turn(false);
        }
        let event = schedule.next_event();
        for (rank, &number) in schedule.set().ranks().iter().enumerate() {
            if event.ranks >> rank & 1 == 0 {
                continue;
            }
            let number = usize::from(number);
            let (ticks, parts) = periods[number];
            let exact = u128::from(releases[number]) * ticks;
            let distance = (u128::from(now) * parts).abs_diff(exact);
            // The difference is exact; a few ticks, and their quotient, need no more than 53 bits.
            #[allow(clippy::cast_precision_loss)]
            let distance = distance as f64 / parts as f64;
            worst = worst.max(distance);
            releases[number] += 1;
        }
        now += u64::from(event.gap);
    }
    worst
}

/// Returns the number of times that the first loop is due in a hyperperiod, the inverse of the rates' greatest
/// common divisor.
fn releases_of_first(rates: &[Rate]) -> u64 {
    let (mut numerator, mut denominator) = (0, 1);
    for rate in rates {
        let divisor = greatest_common_divisor(denominator, u64::from(rate.denominator()));
        denominator = denominator / divisor * u64::from(rate.denominator());
        numerator = greatest_common_divisor(numerator, u64::from(rate.numerator()));
    }
    denominator / u64::from(rates[0].denominator()) * u64::from(rates[0].numerator()) / numerator
}
