//! `mbox`: what a round trip between two processes costs, by condor-mbox and by others.
//!
//! Every round has a fresh mapping, a fresh client and a fresh server. In a round all
//! contestants take short turns in an order that changes, on places of the same mapping; every
//! figure of a row is a ratio to the baseline of the same round. The baseline takes part twice:
//! its ratio to itself (the control) shows what is chance.

mod contestant;
mod files;
mod iceoryx;
mod mapping;
mod ours;
mod raw;
mod round;
mod samples;

pub(crate) use mapping::Mapping;
pub(crate) use raw::spinning;

use contestant::{Cores, Entry};
use files::Files;
use round::Plan;

use crate::Result;
use crate::measure::{Goal, Report};
use crate::options::Options;
use crate::process::CorePair;
use crate::rounds::{self, Column, Tables};

const RAW: &str = "raw ping-pong";
const OURS_SPINNING: &str = "condor-mbox, spinning";
const OURS_OF_16: &str = "condor-mbox, spinning, 16 processors";
const ICEORYX_REQUEST: &str = "iceoryx2 request-response";
const FUTEX: &str = "raw futex ping-pong";
const OURS_BLOCKING: &str = "condor-mbox, blocking";

/// Returns every contestant; the first on one core and on two is the baseline of its kind, and the second
/// the control.
fn entries() -> Vec<Entry> {
    let on = |cores| move |name, open| Entry { name, cores, open };
    let (two, one) = (on(Cores::Two), on(Cores::One));
    vec![
        two(RAW, raw::open_spinning),
        two(CONTROL, raw::open_spinning),
        two(OURS_SPINNING, ours::open_spinning),
        two(OURS_OF_16, ours::open_spinning_of_16),
        two(ICEORYX_REQUEST, iceoryx::open_request_response),
        one(FUTEX, raw::open_futex),
        one(CONTROL, raw::open_futex),
        one(OURS_BLOCKING, ours::open_blocking),
    ]
}

const CONTROL: &str = "  the same once more (control)";

/// The figures of a contestant.
const COLUMNS: &[Column] = &[
    Column {
        head: "ns",
        digits: 0,
    },
    Column {
        head: "p99 ns",
        digits: 0,
    },
];
const MEDIAN: usize = 0;
const P99: usize = 1;

/// Runs the sub-command.
pub(crate) fn run(options: &Options) -> Result<Report> {
    let cores = CorePair::find()?;
    let rounds = options.rounds(31, 9);
    let plan = Plan {
        slices: if options.quick { 8 } else { 12 },
        half_ns: 2.5e6,
        cores,
    };
    let entries = entries();
    let (first, second) = (cores.first, cores.second);
    let two = format!("client on core {first}, server on core {second}");
    let one = format!("client and server on core {first}");
    let mut tables = Tables::new(COLUMNS);
    for entry in &entries {
        let table = match entry.cores {
            Cores::Two => &two,
            Cores::One => &one,
        };
        tables.row(table, entry.name);
    }
    let files = Files::new()?;
    tables.fill(rounds::play(rounds, |number| {
        // SAFETY: nothing before this has started a thread.
        unsafe { round::play(&entries, &plan, number, files.directory(), files.prefix()) }
    })?);
    let text = format!(
        "{rounds} rounds, a fresh mapping and two fresh processes in each; medians over the rounds of\n\
         per-round ratios, with the interval that holds the true median in 95 of 100 runs.\n\
         Medians are of timed batches, 99th percentiles of round trips timed one by one.\n{tables}",
    );
    let ratio = |of, to, column| tables.ratio(&[(&two, of, column)], &[(&two, to, column)]);
    let to_raw = |of| ratio(of, RAW, MEDIAN);
    let iceoryx = ratio(ICEORYX_REQUEST, OURS_SPINNING, MEDIAN)?;
    let to_futex = tables.ratio(&[(&one, OURS_BLOCKING, MEDIAN)], &[(&one, FUTEX, MEDIAN)])?;
    let goals = vec![
        Goal::most("spin_vs_raw", to_raw(OURS_SPINNING)?, 1.15),
        Goal::most("spin16_vs_raw", to_raw(OURS_OF_16)?, 1.35),
        Goal::most("spin_p99_vs_raw_p99", ratio(OURS_SPINNING, RAW, P99)?, 1.3),
        Goal::least("iceoryx2_reqresp_vs_spin", iceoryx, 10.0),
        Goal::most("blocking_vs_futex", to_futex, 1.1),
    ];
    Ok(Report { text, goals })
}
