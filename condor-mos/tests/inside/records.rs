//! Histograms, and counts beyond 32 bits.

use crate::record::{Counts, Histogram, Record};

#[test]
fn every_time_is_in_the_first_class_that_ends_at_it_or_later() {
    for exponent in 0..32 {
        let ticks = 1_u32 << exponent;
        for ticks in [ticks - 1, ticks, ticks + ticks / 2, ticks + (ticks - 1)] {
            let class = Histogram::class(ticks);
            assert!(ticks <= Histogram::longest(class), "{ticks}");
            assert!(
                class == 0 || Histogram::longest(class - 1) < ticks,
                "{ticks}"
            );
        }
    }
    assert_eq!(Histogram::longest(63), u32::MAX);
}

#[test]
fn percentiles_are_the_ends_of_classes() {
    let mut times = Histogram::NEW;
    assert_eq!(times.percentile(50.0), 0);
    for ticks in 1..=1000 {
        times.count(ticks);
    }
    assert_eq!(times.total(), 1000);
    assert_eq!(times.percentile(0.0), 1);
    assert_eq!(times.percentile(50.0), 511);
    assert_eq!(times.percentile(99.0), 1023);
}

#[test]
fn the_mean_is_right_beyond_32_bits() {
    let mut counts = Counts {
        run: u32::MAX,
        total: u32::MAX - 4,
        total_high: 4,
        ..Counts::NEW
    };
    counts.finish(5);
    assert_eq!((counts.run(), counts.total_run()), (1 << 32, 5 << 32));
}
