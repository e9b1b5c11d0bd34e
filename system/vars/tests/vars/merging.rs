//! Rows of several sources in one order of time.

use std::time::Duration;

use condor_mbox::Instant;
use condor_vars::Merge;
use proptest::prelude::*;

const HORIZON: Duration = Duration::from_nanos(100);

fn pop_all<T>(merge: &mut Merge<T>) -> Vec<(usize, u64)> {
    std::iter::from_fn(|| merge.pop())
        .map(|it| (it.source, it.at.as_ns()))
        .collect()
}

#[test]
fn a_silent_source_holds_nobody_back_past_the_horizon() {
    let mut merge = Merge::new(2, HORIZON);
    for at in [0, 50, 100] {
        merge.push(0, Instant::from_ns(at), ());
    }
    assert!(merge.pop().is_none());
    merge.push(0, Instant::from_ns(151), ());
    assert_eq!(pop_all(&mut merge), [(0, 0), (0, 50)]);
    // It speaks, late and then in time.
    merge.push(1, Instant::from_ns(40), ());
    merge.push(1, Instant::from_ns(120), ());
    assert_eq!(pop_all(&mut merge), [(1, 40), (0, 100), (1, 120)]);
    let left: Vec<_> = merge.finish().map(|it| it.at.as_ns()).collect();
    assert_eq!(left, [151]);
}

proptest! {
    #[test]
    fn all_come_once_and_in_order(
        steps in prop::collection::vec((0_usize..3, 0_u64..60), 0..200),
    ) {
        let mut merge = Merge::new(3, Duration::MAX);
        let (mut clocks, mut expected, mut found) = ([1000_u64; 3], Vec::new(), Vec::new());
        for (number, (source, passed)) in steps.into_iter().enumerate() {
            clocks[source] += passed;
            merge.push(source, Instant::from_ns(clocks[source]), number);
            expected.push((clocks[source], number));
            found.extend(std::iter::from_fn(|| merge.pop()));
        }
        found.extend(merge.finish());
        prop_assert!(found.is_sorted_by_key(|it| it.at));
        let mut found: Vec<_> = found.iter().map(|it| (it.at.as_ns(), it.item)).collect();
        found.sort_unstable();
        expected.sort_unstable();
        prop_assert_eq!(found, expected);
    }
}
