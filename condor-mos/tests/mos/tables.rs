//! Event tables against the numbers of their sources.

use condor_mos::{Clock, Event, EventTable, Rate, RateError, Scan};

const MICROSECONDS: Clock = Clock::of::<u64>(Rate::hz(1_000_000));

/// Computed by the compiler; one entry less would not compile.
const FITS: EventTable<3, 44> =
    EventTable::new([Rate::hz(400), Rate::hz(60), Rate::hz(50)], MICROSECONDS);

fn event(ranks: u32, gap: u32) -> Event {
    Event { ranks, gap }
}

#[test]
fn loops_of_ten_and_five_seconds_have_two_entries_as_in_the_memo() {
    let rates = [Rate::every_seconds(10), Rate::every_seconds(5)];
    let table = EventTable::<2, 8>::new(rates, MICROSECONDS);
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
        let clock = Clock::of::<u64>(frequency);
        let table = EventTable::<3, 64>::try_new(rates, clock).unwrap();
        assert_eq!(table.events().len(), 44);
        // The hyperperiod is 100 ms; the last gap may lack a tick that is carried.
        let ticks: u32 = table.events().iter().map(|event| event.gap).sum();
        let exact = frequency.as_hz() / 10.0;
        assert!((f64::from(ticks) - exact).abs() <= 1.0, "{ticks} {exact}");
    }
    assert_eq!(FITS.events().len(), 44);
}

#[test]
fn a_table_that_does_not_fit_is_refused_and_the_rate_named() {
    let video = Rate::fraction(60_000, 1001);
    let rates = [Rate::hz(400), Rate::hz(60), video];
    let error = EventTable::<3, 64>::try_new(rates, MICROSECONDS).unwrap_err();
    let expected = RateError::TooManyEvents {
        rate: video,
        fastest: Rate::hz(400),
        capacity: 64,
    };
    assert_eq!(error, expected);
    assert_eq!(
        error.to_string(),
        "with 60000/1001 Hz beside 400 Hz, the event table has more than its 64 entries: \
         use a larger one, or a scan"
    );
    assert!(Scan::try_new(rates, MICROSECONDS).is_ok());
}
