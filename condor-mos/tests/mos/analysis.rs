//! Response times by analysis against those of simulations from the instant at which all loops are due.

use condor_mos::sim::SimPlatform;
use condor_mos::{
    Analysis, ClockSpec, Load, LoopError, LoopId, Loops, Overrun, Rate, ResponseTime, Scan,
    Scheduler, Timer,
};
use proptest::prelude::*;

const L: usize = 4;

/// A set for the simulation by steps: times are in parts of a tick.
#[derive(Debug)]
struct Set {
    /// Parts of a tick.
    parts: u32,
    periods: [u32; L],
    /// In ticks.
    runs: [u32; L],
    blocking: [u32; L],
    overhead: u32,
}

fn set() -> impl Strategy<Value = Set> {
    let times = |range: std::ops::Range<u32>| prop::array::uniform4(range);
    let few = prop_oneof![3 => Just(0), 1 => 1..3_u32];
    (1..6_u32, times(10..200), times(0..12), times(0..8), few).prop_map(
        |(parts, periods, runs, blocking, overhead)| Set {
            parts,
            periods: periods.map(|period| period.max(2 * parts)),
            runs: runs.map(|run| run + 1),
            blocking,
            overhead,
        },
    )
}

/// The response of the loop `number`, whose release comes with all others, by small steps.
fn step_by_step(set: &Set, number: usize) -> ResponseTime {
    let is_before = |other: usize| (set.periods[other], other) < (set.periods[number], number);
    // What comes before the loop, in whatever order, and its own.
    let mut before = set.blocking[number] * set.parts;
    let mut own = set.runs[number] * set.parts;
    for time in 0..=set.periods[number] {
        if before + own == 0 {
            assert_eq!(time % set.parts, 0);
            return ResponseTime::Within(u64::from(time / set.parts));
        }
        for other in 0..L {
            if time % set.periods[other] == 0 && time < set.periods[number] {
                before += set.overhead * set.parts;
                if is_before(other) {
                    before += set.runs[other] * set.parts;
                }
            }
        }
        if before > 0 {
            before -= 1;
        } else {
            own -= 1;
        }
    }
    ResponseTime::Late
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn the_equation_agrees_with_a_simulation_by_steps(set in set()) {
        let loads: [Load; L] = std::array::from_fn(|number| {
            let rate = Rate::fraction(set.parts, set.periods[number]);
            Load::new(rate, set.runs[number]).blocked(set.blocking[number])
        });
        let analysis = Analysis::with_overhead(Rate::hz(1), loads, set.overhead);
        let expected: [ResponseTime; L] = std::array::from_fn(|number| step_by_step(&set, number));
        for (number, expected) in expected.into_iter().enumerate() {
            prop_assert_eq!(analysis.response(LoopId(number as u8)), Some(expected), "{}", number);
        }
        let late = (0..L).filter(|&number| expected[number] == ResponseTime::Late);
        let first = late.min_by_key(|&number| (set.periods[number], number));
        prop_assert_eq!(analysis.first_late(), first.map(|number| LoopId(number as u8)));
        prop_assert_eq!(analysis.is_schedulable(), first.is_none());
    }
}

/// The first and the worst response of each loop, as the scheduler runs them until `end`.
fn scheduled(frequency: Rate, rates: [Rate; L], runs: [u32; L], end: u64) -> [(u64, u64); L] {
    let processor = SimPlatform::new(frequency);
    let scan = Scan::<L>::new(&rates, ClockSpec::of::<u64>(frequency));
    let scheduler = Scheduler::new(processor.clone(), scan);
    let mut responses: [Vec<u64>; L] = Default::default();
    {
        let (processor, scheduler) = (&processor, &scheduler);
        let mut number = 0;
        let mut bodies = responses.each_mut().map(|responses| {
            let (rate, run) = (rates[number], runs[number]);
            number += 1;
            let period = (
                u64::from(rate.denominator()) * u64::from(frequency.numerator()),
                u64::from(rate.numerator()) * u64::from(frequency.denominator()),
            );
            move |_| {
                processor.work(run.into());
                // The nearest tick to the instant of the release.
                let release = responses.len() as u64;
                let due = (2 * release * period.0 + period.1) / (2 * period.1);
                responses.push(processor.now() - due);
                if processor.now() > end {
                    scheduler.stop();
                }
            }
        });
        scheduler
            .scope(|scope| {
                for (number, body) in bodies.iter_mut().enumerate() {
                    scope.assign(LoopId(number as u8), Overrun::CatchUp(u8::MAX), body)?;
                }
                processor.with_handler(
                    || scheduler.on_timer(),
                    || {
                        scheduler.start().expect("the clock is the same");
                        processor.run_until(end + 1);
                    },
                );
                Ok::<_, LoopError>(())
            })
            .expect("there are four loops");
    }
    responses.map(|all| {
        let first = all.first().copied().unwrap_or(u64::MAX);
        (first, all.into_iter().max().unwrap_or(u64::MAX))
    })
}

fn analysed(frequency: Rate, rates: [Rate; L], runs: [u32; L]) -> Analysis<L> {
    let loads = std::array::from_fn(|number| Load::new(rates[number], runs[number]));
    Analysis::new(frequency, loads)
}

proptest! {
    #[test]
    fn the_scheduler_responds_as_analysed(
        rates in prop::array::uniform4(prop::sample::select(vec![
            600, 500, 400, 375, 300, 250, 240, 200, 150, 120, 100, 75, 60, 50_u32,
        ])),
        runs in prop::array::uniform4(1..15_u32),
    ) {
        // All periods are whole ticks, and all rates repeat within a second.
        let (frequency, rates) = (Rate::hz(6000), rates.map(Rate::hz));
        let analysis = analysed(frequency, rates, runs);
        let seen = scheduled(frequency, rates, runs, 6000);
        for (number, (first, worst)) in seen.into_iter().enumerate() {
            match analysis.response(LoopId(number as u8)) {
                Some(ResponseTime::Within(ticks)) => prop_assert_eq!((first, worst), (ticks, ticks)),
                Some(ResponseTime::Late) => prop_assert!(first > 6000 / u64::from(rates[number].numerator())),
                other => prop_assert!(false, "{other:?}"),
            }
        }
    }

    #[test]
    fn instants_that_are_rounded_are_never_later_than_analysed(
        rates in prop::array::uniform4((1..200_u32, 1..8_u32)),
        runs in prop::array::uniform4(1..15_u32),
    ) {
        let (frequency, rates) = (Rate::hz(1000), rates.map(|(n, d)| Rate::fraction(n, d)));
        let analysis = analysed(frequency, rates, runs);
        let seen = scheduled(frequency, rates, runs, 20_000);
        for (number, (_, worst)) in seen.into_iter().enumerate() {
            if let Some(ResponseTime::Within(ticks)) = analysis.response(LoopId(number as u8)) {
                prop_assert!(worst <= ticks, "{worst} {ticks}");
            }
        }
    }
}

#[test]
fn an_analysis_made_by_the_compiler_is_printed_as_a_table() {
    const LOADS: [Load; 3] = [
        Load::new(Rate::hz(50), 6_000).blocked(100),
        Load::new(Rate::hz(400), 500),
        Load::new(Rate::hz(60), 12_000),
    ];
    // Computed by the compiler.
    const SET: Analysis<3> = Analysis::new(Rate::hz(1_000_000), LOADS);
    assert_eq!(SET.first_late(), Some(LoopId(0)));
    assert_eq!(
        SET.to_string(),
        "          rate  loop       run µs   blocked µs  response µs    period µs
        400 Hz     1        500.0          0.0        500.0       2500.0
         60 Hz     2      12000.0          0.0      15000.0      16666.7
         50 Hz     0       6000.0        100.0         late      20000.0
not schedulable, from loop 0 on; utilisation 122.0 %"
    );
}

fn responses<const L: usize>(periods_and_runs: [(u32, u32); L]) -> [Option<ResponseTime>; L] {
    let loads = periods_and_runs.map(|(period, run)| Load::new(Rate::every_seconds(period), run));
    let analysis = Analysis::new(Rate::hz(1), loads);
    core::array::from_fn(|number| analysis.response(LoopId(number as u8)))
}

/// A. Burns, A. Wellings, "Real-Time Systems and Programming Languages", on response times.
#[test]
fn the_examples_of_a_textbook_are_met() {
    let within = |ticks| Some(ResponseTime::Within(ticks));
    assert_eq!(
        responses([(7, 3), (12, 3), (20, 5)]),
        [within(3), within(6), within(20)]
    );
    assert_eq!(
        responses([(80, 40), (40, 10), (20, 5)]),
        [within(80), within(15), within(5)],
        "a full processor"
    );
    assert_eq!(
        responses([(50, 12), (40, 10), (30, 10)]),
        [Some(ResponseTime::Late), within(20), within(10)],
    );
}

#[test]
fn a_deadline_can_be_shorter_than_the_period() {
    let loads = |deadline| {
        let slow = Load::new(Rate::every_seconds(12), 3).within(deadline);
        [Load::new(Rate::every_seconds(7), 3), slow]
    };
    let analysis = |deadline| Analysis::new(Rate::hz(1), loads(deadline));
    assert!(analysis(6).is_schedulable());
    assert_eq!(analysis(5).first_late(), Some(LoopId(1)));
    assert!(analysis(100).is_schedulable());
}

#[test]
fn the_largest_numbers_end() {
    let fast = Load::new(Rate::hz(u32::MAX), u32::MAX).blocked(u32::MAX);
    let slow = Load::new(Rate::every_seconds(u32::MAX), u32::MAX);
    let frequencies = [
        Rate::hz(1),
        Rate::hz(u32::MAX),
        Rate::every_seconds(u32::MAX),
    ];
    for frequency in frequencies {
        let analysis = Analysis::with_overhead(frequency, [slow, fast], u32::MAX);
        assert_eq!(analysis.first_late(), Some(LoopId(1)));
        assert_eq!(analysis.response(LoopId(0)), Some(ResponseTime::Late));
    }
    // A loop that leaves nothing to the next one, which has ages to wait for it.
    let full = Load::new(Rate::hz(u32::MAX), 1);
    let analysis = Analysis::new(Rate::hz(u32::MAX), [full, slow]);
    assert_eq!(analysis.response(LoopId(0)), Some(ResponseTime::Within(1)));
    assert_eq!(analysis.response(LoopId(1)), Some(ResponseTime::Undecided));
    assert!(!analysis.is_schedulable());
}
