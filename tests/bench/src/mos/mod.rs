//! `mos`: how late and how dear the servo loops of condor-mos are on Linux, beside others.
//!
//! In a round every contestant runs the same loops once, each in a fresh process, all on one
//! core, in an order that changes. The baseline takes part twice: its ratio to itself (the
//! control) shows what is chance.

mod background;
mod condor;
mod round;
mod system;
mod threads;
mod turn;

use std::time::Duration;

use fastrand::Rng;
use round::{Entry, Plan};
use system::Rank;

use crate::Result;
use crate::measure::{Goal, Report};
use crate::options::Options;
use crate::process::CorePair;
use crate::rounds::{self, Column, Tables};

const HEAD: &str = "400, 100 and 50 Hz";

/// Long enough for a 99th percentile, short enough to be near in time to the baseline's turn.
const TURN: Duration = Duration::from_millis(200);

const BASELINE: &str = "FIFO threads, absolute nanosleep";
const OURS_THREADS: &str = "condor-mos, threads";
const OURS_SIGNALS: &str = "condor-mos, signals";

/// The figures of a turn.
const COLUMNS: &[Column] = &[column("p50 ns"), column("p99 ns"), column("CPU ns")];
const LATENESS_P50: usize = 0;
const STOLEN: usize = 2;

const fn column(head: &'static str) -> Column {
    Column { head, digits: 0 }
}

/// Returns every contestant; the first is the baseline and the second the control.
fn entries() -> Vec<Entry> {
    let entry = |name, run| Entry { name, run };
    vec![
        entry(BASELINE, threads::run),
        entry("  the same once more (control)", threads::run),
        entry(OURS_THREADS, condor::run_threads),
        entry(OURS_SIGNALS, condor::run_signals),
    ]
}

/// Runs the sub-command.
pub(crate) fn run(options: &Options) -> Result<Report> {
    let rounds = options.rounds(15, 7);
    let plan = Plan {
        turns: if options.quick { 1 } else { 5 },
        length: TURN,
        core: CorePair::find()?.second,
    };
    let entries = entries();
    let mut tables = Tables::new(COLUMNS);
    for entry in &entries {
        tables.row(HEAD, entry.name);
    }
    let mut order = Rng::with_seed(0);
    tables.fill(rounds::play(rounds, |_| {
        // SAFETY: nothing before this has started a thread.
        unsafe { round::play(&entries, &plan, &mut order) }
    })?);
    let refused = match system::be_fifo(Rank::Background) {
        Ok(()) => String::new(),
        Err(error) => format!("SCHED_FIFO is not permitted, all are SCHED_OTHER: {error}\n"),
    };
    let text = format!(
        "{rounds} rounds on core {}; medians over the rounds of per-round ratios to the baseline, with\n\
         the interval that holds the true median in 95 of 100 runs. Lateness of the 400 Hz loop;\n\
         CPU that a release takes from the background.\n\
         {refused}{tables}",
        plan.core
    );
    let to_fifo = |ours, column| {
        let lane = |name| (HEAD, name, column);
        tables.ratio(&[lane(ours)], &[lane(BASELINE)])
    };
    let goals = vec![
        Goal::most(
            "lateness_p50_vs_fifo",
            to_fifo(OURS_THREADS, LATENESS_P50)?,
            1.05,
        ),
        Goal::most("stolen_cpu_vs_fifo", to_fifo(OURS_SIGNALS, STOLEN)?, 0.85),
    ];
    Ok(Report { text, goals })
}
