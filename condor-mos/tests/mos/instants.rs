//! Instants of counters that begin anew.

use condor_mos::{CounterReading, Wrapping};

fn half_a_range_is_told_apart<I: CounterReading>(start: I) {
    let half = 1_u64 << (I::BITS - 1);
    for ticks in [0, 1, half / 2, half - 1] {
        let Ok(ticks) = u32::try_from(ticks) else {
            continue;
        };
        let later = start.after(ticks);
        assert!(later.has_reached(start), "{ticks}");
        assert_eq!(start.has_reached(later), ticks == 0, "{ticks}");
        assert_eq!(later.since(start), ticks);
    }
}

#[test]
fn instants_are_compared_within_half_of_the_range() {
    for start in [0, 1, 0x7fff_ffff, 0x8000_0000, u32::MAX] {
        half_a_range_is_told_apart(Wrapping::<32>::new(start));
        half_a_range_is_told_apart(Wrapping::<24>::new(start));
        half_a_range_is_told_apart(Wrapping::<16>::new(start));
        half_a_range_is_told_apart(Wrapping::<2>::new(start));
        half_a_range_is_told_apart(u64::from(start));
    }
}

#[test]
fn a_long_time_is_not_taken_for_a_short_one() {
    assert_eq!((1_u64 << 40).since(1), u32::MAX);
    assert_eq!(1_u64.since(1 << 40), 0);
}
