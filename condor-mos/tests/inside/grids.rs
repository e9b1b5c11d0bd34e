//! Grids are exact.

use crate::rate::Rate;
use crate::schedule::Grid;
use proptest::prelude::*;

fn rate() -> impl Strategy<Value = Rate> {
    (1..2000_u32, 1..2000_u32).prop_map(|(n, d)| Rate::fraction(n, d))
}

proptest! {
    #[test]
    fn every_instant_is_the_nearest_tick(rate in rate(), mega in 1..200_u32, steps in 1..500_u64) {
        let frequency = Rate::fraction(mega * 1_000_000, 7);
        let mut grid = Grid::new(rate, frequency).expect("a slow rate");
        let mut at = 0;
        for step in 1..=steps {
            at += grid.step();
            let parts = u64::from(rate.numerator()) * u64::from(frequency.denominator());
            let ticks = step * u64::from(rate.denominator()) * u64::from(frequency.numerator());
            prop_assert_eq!(at, (2 * ticks + parts) / (2 * parts));
        }
    }
}

#[test]
fn what_cannot_be_counted_is_refused() {
    assert_eq!(Grid::new(Rate::hz(11), Rate::hz(10)), None);
    assert!(Grid::new(Rate::hz(10), Rate::hz(10)).is_some());
    // Two primes, so that nothing cancels.
    let (rate, frequency) = (4_294_967_291, 4_294_967_279);
    let rate = Rate::fraction(rate, rate - 2);
    let frequency = Rate::fraction(frequency, frequency - 3);
    assert_eq!(Grid::new(rate, frequency), None);
}
