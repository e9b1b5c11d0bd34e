//! The calls that this program does not make, which the search for paths that panic must see all the same.

use core::fmt::Display as _;

use condor_mos::{
    Analysis, ClockSpec, EventTable, Latest, Load, LoopError, LoopLockError, Loops as _, Platform,
    Rate, RateError, Scan, StartError, Statistics,
};
use firmware::keep;

use crate::{Core, LOOPS, Loops, PLATFORM};

/// The context of a loop that has none.
type Nothing = [u8; 0];

pub(crate) fn kept() {
    scheduler::<24>();
    scheduler::<0>();
    if Core::VECTORS {
        // Nothing is started, so they find nothing to run.
        PLATFORM.pend(0b111);
    }
    keep! {
        Rate: new, as_hz, is_faster_than, fmt;
        ClockSpec: longest_gap, fmt;
        EventTable<LOOPS, 24>: try_new, phased, or_scan, events, clock, rates;
        Scan<LOOPS>: try_new, phased;
        Statistics: mean_run, utilisation, microseconds;
        Load: new, blocked, within, measured;
        Analysis<LOOPS>: new, with_overhead, measured, is_schedulable, first_late, response,
            utilisation;
        Latest<[u32; 16]>: with_buffers, split;
        RateError: fmt;
        LoopError: fmt;
        StartError: fmt;
        LoopLockError: fmt;
    }
}

fn scheduler<const E: usize>() {
    keep! {
        Loops<E>: with_rates, assign::<Nothing>, is_changing, start, start_at, stop, enable, disable,
            set_rate, statistics, histograms, reset_statistics;
    }
}
