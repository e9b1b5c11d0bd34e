//! Releases stay on their exact grid for a million hyperperiods.

use condor_mos::sim::worst_release_error;
use condor_mos::{ClockSpec, EventTable, Rate, Scan, Wrapping};

const MILLION: u64 = 1_000_000;

const CLOCKS: [ClockSpec; 5] = [
    ClockSpec::of::<u64>(Rate::hz(1_000_000_000)),
    ClockSpec::of::<u64>(Rate::fraction(14_318_180, 12)),
    ClockSpec::of::<Wrapping<32>>(Rate::hz(32_768)),
    ClockSpec::of::<Wrapping<24>>(Rate::hz(16_000_000)),
    ClockSpec::of::<Wrapping<16>>(Rate::fraction(1_000_000, 7)),
];

fn check<const L: usize>(rates: [u32; L], hyperperiods: u64) {
    let rates = rates.map(Rate::hz);
    for clock in CLOCKS {
        let mut table = EventTable::<L, 64>::try_new(&rates, clock).unwrap();
        let error = worst_release_error(&mut table, hyperperiods);
        assert!(error <= 1.0, "table of {rates:?} at {clock}: {error}");
        let mut scan = Scan::<L>::try_new(&rates, clock).unwrap();
        let error = worst_release_error(&mut scan, hyperperiods);
        // Each loop has its own grid.
        assert!(error <= 0.5, "scan of {rates:?} at {clock}: {error}");
    }
}

#[test]
fn two_loops_that_divide() {
    check([400, 50], MILLION);
}

#[test]
fn three_loops_that_do_not() {
    check([7, 3, 2], MILLION);
}

#[test]
fn rates_of_400_60_and_50_hz() {
    check([400, 60, 50], MILLION / 10);
}

#[test]
fn video_beside_servo_loops() {
    let rates = [Rate::hz(400), Rate::hz(60), Rate::fraction(60_000, 1001)];
    for clock in CLOCKS {
        let mut scan = Scan::<3>::try_new(&rates, clock).unwrap();
        // A hyperperiod is 50.05 s.
        let error = worst_release_error(&mut scan, 100);
        assert!(error <= 0.5, "{clock}: {error}");
    }
}
