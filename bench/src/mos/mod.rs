//! `mos`: how late and how dear the servo loops of condor-mos are on Linux, beside others.
//!
//! In a round every contestant runs the same loops once, each in a fresh process, all on one
//! core, in an order that changes. The baseline takes part twice: its ratio to itself (the
//! control) shows what is chance.

mod background;
mod condor;
mod executors;
mod round;
mod signals;
mod system;
mod threads;
mod turn;

use std::fmt::Write;
use std::io::IsTerminal;
use std::time::Duration;

use round::{Entry, Plan, Policy};
use system::Rank;
use turn::{Figures, LoopSet};

use crate::Result;
use crate::measure::{Better, Estimate, Goal, Report};
use crate::options::Options;
use crate::process::CorePair;
use crate::shuffle::Shuffle;

const SETS: &[LoopSet] = &[
    LoopSet {
        name: "400 Hz",
        rates_hz: &[400],
    },
    LoopSet {
        name: "400, 100 and 50 Hz",
        rates_hz: &[400, 100, 50],
    },
];

/// Long enough for a 99th percentile, short enough to be near in time to the baseline's turn.
const TURN: Duration = Duration::from_millis(200);

/// The set that the goals are about.
const GOAL_SET: usize = 1;

const BASELINE: usize = 0;
const OURS_THREADS: &str = "condor-mos, threads";
const OURS_SIGNALS: &str = "condor-mos, signals";

/// Every contestant; the first is the baseline and the second the control.
fn entries() -> Vec<Entry> {
    let entry = |policy| move |name, run| Entry { name, policy, run };
    let (fifo, other) = (entry(Policy::Fifo), entry(Policy::Other));
    vec![
        fifo("FIFO threads, absolute nanosleep", threads::run_fifo),
        fifo("  the same once more (control)", threads::run_fifo),
        fifo(OURS_THREADS, condor::run_threads),
        fifo(OURS_SIGNALS, condor::run_signals),
        fifo("raw signals, one timer", signals::run_one_timer),
        fifo("raw signals, arming first", signals::run_arming_first),
        fifo("raw signals, two timers", signals::run_two_timers),
        fifo("raw signals, two timers, masking", signals::run_masking),
        fifo("embassy", executors::run_embassy::<true>),
        fifo(
            "tokio, one thread",
            executors::run_tokio_current_thread::<true>,
        ),
        other(OURS_SIGNALS, condor::run_signals),
        other("raw signals, two timers", signals::run_two_timers),
        other("thread::sleep for a period", threads::run_sleep),
        other("embassy", executors::run_embassy::<false>),
        other(
            "tokio, one thread",
            executors::run_tokio_current_thread::<false>,
        ),
        other("tokio, threads", executors::run_tokio_multi_thread),
    ]
}

/// A figure of a contestant.
type Figure = fn(&Figures) -> f64;

const LATENESS_P50: Figure = |figures| figures.lateness_p50;
const LATENESS_P99: Figure = |figures| figures.lateness_p99;
const STOLEN: Figure = |figures| figures.stolen;
const DRIFT: Figure = |figures| figures.drift;

/// Runs the sub-command.
pub(crate) fn run(options: &Options) -> Result<Report> {
    let (rounds, turns) = if options.quick { (7, 1) } else { (15, 5) };
    let rounds = options.rounds.unwrap_or(rounds);
    let plan = Plan {
        turns,
        length: TURN,
        core: CorePair::find()?.second,
    };
    let entries = entries();
    let progress = std::io::stderr().is_terminal();
    let mut played: Vec<Vec<Vec<Figures>>> = SETS.iter().map(|_| Vec::new()).collect();
    let mut order = Shuffle(0);
    for number in 0..rounds {
        if progress {
            eprint!("\rround {} of {rounds} ", number + 1);
        }
        for (set, played) in SETS.iter().zip(&mut played) {
            // SAFETY: nothing before this has started a thread.
            played.push(unsafe { round::play(&entries, *set, &plan, &mut order) }?);
        }
    }
    if progress {
        eprint!("\r{:24}\r", "");
    }
    let mut text = format!(
        "{rounds} rounds on core {}; medians over the rounds of per-round ratios to the baseline, with\n\
         the interval that holds the true median in 95 of 100 runs. Lateness of the 400 Hz loop;\n\
         CPU that a release takes from the background; how far the loop falls behind in a second.\n",
        plan.core
    );
    if let Err(error) = system::be_fifo(Rank::Background).and_then(|()| system::be_other()) {
        writeln!(
            text,
            "SCHED_FIFO is not permitted, all are SCHED_OTHER: {error}"
        )?;
    }
    for (set, played) in SETS.iter().zip(&played) {
        write_table(&mut text, &entries, *set, played)?;
    }
    let drift = condor::drift_ticks()?;
    writeln!(
        text,
        "\nLargest error of a release in 10^6 hyperperiods of virtual time: {drift:.3} ticks"
    )?;
    let mut goals = goals(&entries, &played[GOAL_SET]);
    goals.push(Goal {
        name: "drift_ticks",
        estimate: Estimate::of([drift]),
        limit: 1.0,
        better: Better::Lower,
    });
    Ok(Report {
        text,
        goals,
        ..Report::default()
    })
}

/// The figures of one contestant in every round.
fn column(
    played: &[Vec<Figures>],
    index: usize,
    figure: Figure,
) -> impl Iterator<Item = f64> + Clone {
    played.iter().map(move |round| figure(&round[index]))
}

/// A figure of a contestant, relative to the baseline's of the same round.
fn ratio(played: &[Vec<Figures>], index: usize, figure: Figure) -> Estimate {
    Estimate::ratio(
        column(played, index, figure),
        column(played, BASELINE, figure),
    )
}

/// The goals that are ratios to the baseline.
fn goals(entries: &[Entry], played: &[Vec<Figures>]) -> Vec<Goal> {
    let goal = |name, ours, figure, limit| {
        let index = entries.iter().position(|entry| entry.name == ours)?;
        Some(Goal {
            name,
            estimate: ratio(played, index, figure),
            limit,
            better: Better::Lower,
        })
    };
    let goals = [
        goal("lateness_p50_vs_fifo", OURS_THREADS, LATENESS_P50, 1.05),
        goal("stolen_cpu_vs_fifo", OURS_SIGNALS, STOLEN, 0.85),
    ];
    goals.into_iter().flatten().collect()
}

fn write_table(
    text: &mut String,
    entries: &[Entry],
    set: LoopSet,
    played: &[Vec<Figures>],
) -> Result<()> {
    for policy in [Policy::Fifo, Policy::Other] {
        let title = match policy {
            Policy::Fifo => format!("{}, SCHED_FIFO", set.name),
            Policy::Other => format!("{}, SCHED_OTHER", set.name),
        };
        writeln!(
            text,
            "\n{title:34} {:>9}  {:21} {:>9}  {:21} {:>8}  {:18} {:>9}",
            "p50 ns", "x baseline [95 %]", "p99 ns", "x", "CPU ns", "x", "drift us/s"
        )?;
        for (index, entry) in entries.iter().enumerate() {
            if entry.policy != policy {
                continue;
            }
            let value = |figure| Estimate::of(column(played, index, figure)).value;
            writeln!(
                text,
                "{:34} {:9.0}  {:21} {:9.0}  {:21} {:8.0}  {:18} {:9.1}",
                entry.name,
                value(LATENESS_P50),
                ratio(played, index, LATENESS_P50),
                value(LATENESS_P99),
                ratio(played, index, LATENESS_P99),
                value(STOLEN),
                ratio(played, index, STOLEN),
                value(DRIFT),
            )?;
        }
    }
    Ok(())
}
