//! The measurements of a firmware, printed as lines of `name value`, all whole numbers.

use cortex_m_semihosting::hprintln;

use crate::background::until;
use crate::body::{self, TRACES};
use crate::{LOOPS, PERIODS, RATES, switch_off, timer};

/// Hyperperiods of 20 ms before anything is measured: what is done only once is then over.
const WARM_UP: u32 = 3;

/// Hyperperiods that are measured, in one second.
const MEASURED: u32 = 50;

/// Releases of the fastest loop whose way to the body is looked at: another second.
const WATCHED: u32 = 400;

const FASTEST: usize = 0;
const SLOWEST: usize = LOOPS - 1;

/// Prints one figure.
pub fn line(name: &str, value: u32) {
    hprintln!("{} {}", name, value);
}

/// Starts the time, measures the loops, prints what is found and ends QEMU. To be called as the
/// background.
pub fn loops() -> ! {
    timer::start();
    let slowest = &TRACES[SLOWEST];
    until(slowest, WARM_UP);
    let before = releases();
    let passed = until(slowest, WARM_UP + MEASURED);
    let measured = releases() - before;
    line("hertz", timer::HERTZ);
    line("ticks", passed.ticks);
    line("background_instructions", passed.own_instructions);
    line("releases", measured);
    line("releases_per_second", RATES.iter().sum());
    line("body_instructions", body::INSTRUCTIONS);
    lateness();
    switch_off(true)
}

/// Returns true if a slower loop is due with this release of the fastest one, the first release being 0.
#[must_use]
pub fn is_shared(release: u32) -> bool {
    release.is_multiple_of(PERIODS[FASTEST + 1] / PERIODS[FASTEST])
}

fn releases() -> u32 {
    TRACES.iter().map(body::Trace::runs).sum()
}

/// Prints the ticks from the instant of its release to the body of the fastest loop, summed over the
/// releases at which no other loop is due.
fn lateness() {
    let (mut sum, mut count) = (0, 0);
    let fastest = &TRACES[FASTEST];
    // Printing has taken time, but a run that has begun is the last one and not half over.
    for runs in fastest.runs() + 1..=fastest.runs() + WATCHED {
        until(fastest, runs);
        let release = runs - 1;
        let instant = release.wrapping_mul(PERIODS[FASTEST]);
        let late = fastest.began().wrapping_sub(instant);
        if !is_shared(release) {
            (sum, count) = (sum + late, count + 1);
        }
    }
    line("alone", count);
    line("late_ticks_sum", sum);
}
