//! Rates are fractions in lowest terms, in their exact order.

use condor_mos::Rate;

#[test]
fn a_rate_is_kept_in_lowest_terms() {
    assert_eq!(Rate::fraction(1200, 60), Rate::hz(20));
    assert_eq!(Rate::new(3, 0), None);
    assert_eq!(Rate::new(0, 3), None);
    assert_eq!(
        Rate::fraction(u32::MAX, u32::MAX),
        Rate::fraction(7, 7),
        "the largest numbers do not overflow"
    );
}

#[test]
fn rates_are_ordered_exactly() {
    let video = Rate::fraction(60_000, 1001);
    assert!(video < Rate::hz(60) && video > Rate::fraction(5994, 101));
    assert!(Rate::hz(60).is_faster_than(video) && !video.is_faster_than(video));
    assert!(Rate::every_seconds(10) < Rate::every_seconds(5));
    assert!(Rate::fraction(u32::MAX, u32::MAX - 1) < Rate::fraction(u32::MAX - 1, u32::MAX - 2));
}
