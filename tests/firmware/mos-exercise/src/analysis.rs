//! The times within which loops end.

use checks::Checks;
use condor_mos::{Analysis, Load, LoopId, Loops, Platform, Rate, ResponseTime, Scheduler};

use crate::LOOPS;

/// A. Burns, A. Wellings, "Real-Time Systems and Programming Languages", on response times: periods
/// of 7, 12 and 20.
const LOADS: [Load; LOOPS] = [
    Load::new(Rate::every_seconds(7), 3),
    Load::new(Rate::every_seconds(12), 3),
    Load::new(Rate::every_seconds(20), 5),
];
const ANALYSIS: Analysis<LOOPS> = Analysis::new(Rate::hz(1), LOADS);
const _: () = assert!(ANALYSIS.is_schedulable());

/// Checks the analysis of loads that are declared.
pub(crate) fn declared(checks: &mut Checks<'_>) {
    let loads = core::hint::black_box(LOADS);
    let responses = |analysis: Analysis<LOOPS>| [0, 1, 2].map(|id| analysis.response(LoopId(id)));
    let within = |ticks| Some(ResponseTime::Within(ticks));
    let analysis = Analysis::new(Rate::hz(1), loads);
    checks.same(responses(analysis), [within(3), within(6), within(20)]);
    checks.same(analysis, ANALYSIS);
    checks.same(analysis.response(LoopId(9)), None);
    let [fast, middle, slow] = loads;
    let blocked = Analysis::new(Rate::hz(1), [fast.blocked(2), middle, slow]);
    checks.same(responses(blocked), [within(5), within(6), within(20)]);
    let switching = Analysis::with_overhead(Rate::hz(1), loads, 1);
    checks.same(
        (switching.first_late(), switching.is_schedulable()),
        (Some(LoopId(1)), false),
    );
    let parts = 3.0 / 7.0 + 3.0 / 12.0 + 5.0 / 20.0;
    let difference = analysis.utilisation() - parts;
    checks.that(difference < 1e-9 && difference > -1e-9);
}

/// Checks the analysis of run times that were measured, of loops that have run.
pub(crate) fn measured<P: Platform + Sync, const E: usize>(
    checks: &mut Checks<'_>,
    scheduler: &Scheduler<P, LOOPS, E>,
) {
    let counts = [0, 1, 2].map(|number| scheduler.statistics(LoopId(number)));
    let [Ok(fastest), Ok(middle), Ok(slowest)] = counts else {
        return checks.that(false);
    };
    let counts = [fastest, middle, slowest];
    let analysis = Analysis::measured(&counts);
    let again = Analysis::new(
        fastest.frequency,
        counts.map(|loops| Load::measured(&loops)),
    );
    checks.same(analysis, again);
    // A busy host may have held it up for longer than its period.
    let period = fastest.frequency.as_hz() / fastest.rate.as_hz();
    let response = if f64::from(fastest.worst_run) <= period {
        ResponseTime::Within(fastest.worst_run.into())
    } else {
        ResponseTime::Late
    };
    checks.same(analysis.response(LoopId(0)), Some(response));
    #[cfg(feature = "values")]
    {
        use core::fmt::Write as _;

        // The console takes everything.
        let _ = writeln!(checks, "{analysis}");
    }
}
