//! Event tables against the numbers of their sources.

use condor_mos::{ClockSpec, EventTable, Rate, RateError, Scan, ScheduleEvent, entries};

const MICROSECONDS: ClockSpec = ClockSpec::of::<u64>(Rate::hz(1_000_000));

/// Computed by the compiler; one entry less would not compile.
const FITS: EventTable<3, 44> =
    EventTable::new(&[Rate::hz(400), Rate::hz(60), Rate::hz(50)], MICROSECONDS);

fn event(ranks: u32, gap: u32) -> ScheduleEvent {
    ScheduleEvent { ranks, gap }
}

#[test]
fn loops_of_ten_and_five_seconds_have_two_entries_as_in_the_memo() {
    let rates = [Rate::every_seconds(10), Rate::every_seconds(5)];
    let table = EventTable::<2, 8>::new(&rates, MICROSECONDS);
    // Rank 0 is the faster loop, which is due at both; the slower one at the first only.
    assert_eq!(
        table.events(),
        [event(0b11, 5_000_000), event(0b01, 5_000_000)]
    );
    let printed = format!("```text\n{table}\n```");
    assert!(
        include_str!("../../README.md").contains(&printed),
        "{printed}"
    );
}

#[test]
fn rates_of_400_60_and_50_hz_have_44_entries() {
    let rates = [Rate::hz(400), Rate::hz(60), Rate::hz(50)];
    for frequency in [
        Rate::hz(1_000_000),
        Rate::hz(32_768),
        Rate::fraction(14_318_180, 12),
    ] {
        let clock = ClockSpec::of::<u64>(frequency);
        let table = EventTable::<3, 64>::try_new(&rates, clock).unwrap();
        assert_eq!(table.events().len(), 44);
        // The hyperperiod is 100 ms; the last gap may lack a tick that is carried.
        let ticks: u32 = table.events().iter().map(|event| event.gap).sum();
        let exact = frequency.as_hz() / 10.0;
        assert!((f64::from(ticks) - exact).abs() <= 1.0, "{ticks} {exact}");
    }
    assert_eq!(FITS.events().len(), 44);
}

#[test]
fn a_table_that_does_not_fit_is_refused_with_the_entries_that_it_takes() {
    let rates = [Rate::hz(400), Rate::hz(60), Rate::fraction(60_000, 1001)];
    let error = EventTable::<3, 64>::try_new(&rates, MICROSECONDS).unwrap_err();
    let needed = entries(&rates, MICROSECONDS);
    let capacity = 64;
    assert_eq!(error, RateError::TooManyEvents { needed, capacity });
    assert_eq!(
        error.to_string(),
        "the rates of the loops need 25000 entries of the event table, which has 64: use a larger table, or \
         the schedule `Scan`, which needs none"
    );
    assert!(EventTable::<3, 25_000>::try_new(&rates, MICROSECONDS).is_ok());
    assert!(Scan::<3>::try_new(&rates, MICROSECONDS).is_ok());
}

#[test]
fn rates_that_come_as_values_fill_a_table_or_are_scanned() {
    let two = &[Rate::hz(400), Rate::hz(50)][..];
    let table = EventTable::<8, 8>::or_scan(two, &[], MICROSECONDS).unwrap();
    assert!(!table.is_scan());
    assert_eq!(table.events().len(), 8);
    assert_eq!(table.rates(), two);
    let three = [Rate::hz(400), Rate::hz(60), Rate::hz(50)];
    let scan = EventTable::<8, 43>::or_scan(&three, &[], MICROSECONDS).unwrap();
    assert!(scan.is_scan() && scan.events().is_empty());
    let none = EventTable::<8, 8>::try_new(&[], MICROSECONDS).unwrap_err();
    let (loops, capacity) = (0, 8);
    assert_eq!(none, RateError::Loops { loops, capacity });
}

#[test]
fn sets_that_nobody_can_count_take_too_many_entries() {
    let rates = [4_294_967_291, 4_294_967_279, 4_294_967_231].map(Rate::every_seconds);
    assert_eq!(entries(&rates, MICROSECONDS), usize::MAX);
    assert!(EventTable::<3, 8>::try_new(&rates, MICROSECONDS).is_err());
}

#[test]
fn phases_move_releases_within_the_hyperperiod() {
    let rates = [Rate::hz(100), Rate::hz(100), Rate::hz(50)];
    let table = EventTable::<3, 8>::phased(&rates, &[1_000, 6_000], MICROSECONDS).unwrap();
    let events = [
        event(0b100, 1_000),
        event(0b001, 5_000),
        event(0b010, 5_000),
        event(0b001, 5_000),
        event(0b010, 4_000),
    ];
    assert_eq!(table.events(), events);
    let (rate, phase) = (rates[0], 10_000);
    let error = EventTable::<3, 8>::phased(&rates, &[phase], MICROSECONDS).unwrap_err();
    assert_eq!(error, RateError::Phase { rate, phase });
}
