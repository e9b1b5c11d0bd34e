//! `mbox`: what a round trip between two processes costs, by condor-mbox and by others.
//!
//! Every round has a fresh mapping, a fresh client and a fresh server. In a round all
//! contestants take short turns in an order that changes, on places of the same mapping; every
//! figure of a row is a ratio to the baseline of the same round. The baseline takes part twice:
//! its ratio to itself (the control) shows what is chance.

pub(crate) mod arena;
mod contestant;
mod files;
mod iceoryx;
mod instructions;
mod interruption;
mod kernel;
mod mapping;
mod ours;
mod queues;
mod raw;
mod round;
mod samples;

use std::fmt::Write;
use std::io::IsTerminal;

pub(crate) use instructions::go;

use contestant::{Cores, Entry};
use files::Files;
use instructions::{MESSAGE_2, MESSAGE_16};
use round::{Figures, Plan};

use crate::Result;
use crate::callgrind;
use crate::measure::{Better, Estimate, Goal, Report};
use crate::options::Options;
use crate::process::CorePair;

const RAW: &str = "raw ping-pong";
const OURS_SPINNING: &str = "condor-mbox, spinning";
const OURS_OF_16: &str = "condor-mbox, spinning, 16 processors";
const OURS_BOUNDED: &str = "condor-mbox, bounded spin";
const OURS_NESTED: [&str; 3] = [
    "condor-mbox, nested once",
    "condor-mbox, nested twice",
    "condor-mbox, nested three times",
];
const ICEORYX_REQUEST: &str = "iceoryx2 request-response";
const FUTEX: &str = "raw futex ping-pong";
const OURS_BLOCKING: &str = "condor-mbox, blocking";

/// Every contestant; the first on one core and on two is the baseline of its kind, and the
/// second the control.
fn entries() -> Vec<Entry> {
    let entry = |name, cores, open| Entry {
        name,
        cores,
        open,
        interrupted: name == OURS_BOUNDED,
    };
    let two = |name, open| entry(name, Cores::Two, open);
    let one = |name, open| entry(name, Cores::One, open);
    vec![
        two(RAW, raw::open_spinning),
        two("  the same once more (control)", raw::open_spinning),
        two(OURS_SPINNING, ours::open_spinning),
        two(OURS_OF_16, ours::open_spinning_of_16),
        two(
            "condor-mbox, spinning, shared by threads",
            ours::open_shared,
        ),
        two(OURS_BOUNDED, ours::open_bounded),
        two(OURS_NESTED[0], ours::open_nested::<1>),
        two(OURS_NESTED[1], ours::open_nested::<2>),
        two(OURS_NESTED[2], ours::open_nested::<3>),
        two("rtrb, a ring a direction", queues::open_rtrb),
        two("heapless spsc, a queue a direction", queues::open_heapless),
        two(
            "crossbeam ArrayQueue, one a direction",
            queues::open_crossbeam,
        ),
        two("unix socket", kernel::open_unix_socket),
        two(
            "iceoryx2 publish-subscribe x 2",
            iceoryx::open_publish_subscribe,
        ),
        two(ICEORYX_REQUEST, iceoryx::open_request_response),
        one(FUTEX, raw::open_futex),
        one("  the same once more (control)", raw::open_futex),
        one(OURS_BLOCKING, ours::open_blocking),
        one("eventfd", kernel::open_eventfd),
        one("unix socket", kernel::open_unix_socket),
        one("iceoryx2 request-response and events", iceoryx::open_events),
    ]
}

/// A figure of a contestant.
type Figure = fn(&Figures) -> f64;

const MEDIAN: Figure = |figures| figures.median;
const P99: Figure = |figures| figures.p99;
const INTERRUPTED: Figure = |figures| figures.interrupted;

/// A ratio of two contestants' figures that has a goal.
struct Target {
    name: &'static str,
    of: (&'static str, Figure),
    to: (&'static str, Figure),
    limit: f64,
    better: Better,
}

/// The goals; those whose contestants do not take part are left out.
fn targets() -> Vec<Target> {
    let lower = |name, of, to, limit| Target {
        name,
        of,
        to,
        limit,
        better: Better::Lower,
    };
    let raw = (RAW, MEDIAN);
    let flat = (OURS_SPINNING, MEDIAN);
    let nested = |index: usize| (OURS_NESTED[index], MEDIAN);
    vec![
        lower("spin_vs_raw", flat, raw, 1.15),
        lower("spin16_vs_raw", (OURS_OF_16, MEDIAN), raw, 1.35),
        lower("spin_p99_vs_raw_p99", (OURS_SPINNING, P99), (RAW, P99), 1.3),
        Target {
            name: "iceoryx2_reqresp_vs_spin",
            of: (ICEORYX_REQUEST, MEDIAN),
            to: flat,
            limit: 10.0,
            better: Better::Higher,
        },
        lower(
            "blocking_vs_futex",
            (OURS_BLOCKING, MEDIAN),
            (FUTEX, MEDIAN),
            1.1,
        ),
        lower("bounded_spin_vs_raw", (OURS_BOUNDED, MEDIAN), raw, 1.15),
        lower(
            "bounded_spin_interrupted_vs_raw",
            (OURS_BOUNDED, INTERRUPTED),
            raw,
            1.15,
        ),
        lower("nested1_vs_flat", nested(0), flat, 2.2),
        lower("nested2_vs_flat", nested(1), flat, 3.3),
        lower("nested3_vs_flat", nested(2), flat, 4.4),
    ]
}

/// Runs the sub-command.
pub(crate) fn run(options: &Options) -> Result<Report> {
    let cores = CorePair::find()?;
    let (rounds, slices) = if options.quick { (9, 8) } else { (31, 12) };
    let rounds = options.rounds.unwrap_or(rounds);
    let plan = Plan {
        slices,
        half_ns: 2.5e6,
        cores,
    };
    let entries = entries();
    let files = Files::new()?;
    let progress = std::io::stderr().is_terminal();
    let mut played = Vec::new();
    for number in 0..rounds {
        if progress {
            eprint!("\rround {} of {rounds} ", number + 1);
        }
        // SAFETY: nothing before this has started a thread.
        let figures =
            unsafe { round::play(&entries, &plan, number, files.directory(), files.prefix()) }?;
        played.push(figures);
    }
    if progress {
        eprint!("\r{:24}\r", "");
    }
    let mut text = text(&entries, &plan, &played)?;
    let mut goals = goals(&entries, &played);
    writeln!(
        text,
        "\n{:42} {:>12}",
        "a call with reply, both ends", "instructions"
    )?;
    for (name, path, about, limit) in [
        ("instructions", MESSAGE_2, "2 processors", 480.0),
        ("instructions_of_16", MESSAGE_16, "16 processors", 620.0),
    ] {
        let count = callgrind::instructions(path)?;
        writeln!(text, "{about:42} {count:12.0}")?;
        goals.push(Goal {
            name,
            estimate: Estimate::of([count]),
            limit,
            better: Better::Lower,
        });
    }
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

fn goals(entries: &[Entry], played: &[Vec<Figures>]) -> Vec<Goal> {
    let find = |(name, figure): (&str, Figure)| {
        let index = entries.iter().position(|entry| entry.name == name)?;
        Some(column(played, index, figure))
    };
    let goal = |target: Target| {
        let Target {
            name,
            of,
            to,
            limit,
            better,
        } = target;
        Some(Goal {
            name,
            estimate: Estimate::ratio(find(of)?, find(to)?),
            limit,
            better,
        })
    };
    targets().into_iter().filter_map(goal).collect()
}

fn text(entries: &[Entry], plan: &Plan, played: &[Vec<Figures>]) -> Result<String> {
    let mut text = String::new();
    let (first, second) = (plan.cores.first, plan.cores.second);
    writeln!(
        text,
        "{} rounds, a fresh mapping and two fresh processes in each; medians over the rounds of\n\
         per-round ratios, with the interval that holds the true median in 95 of 100 runs.\n\
         Medians are of timed batches, 99th percentiles of round trips timed one by one.",
        played.len()
    )?;
    for cores in [Cores::Two, Cores::One] {
        let mut indices = (0..entries.len()).filter(|index| entries[*index].cores == cores);
        let Some(baseline) = indices.clone().next() else {
            continue;
        };
        let place = match cores {
            Cores::Two => format!("client on core {first}, server on core {second}"),
            Cores::One => format!("client and server on core {first}"),
        };
        writeln!(
            text,
            "\n{place:42} {:>9}  {:22} {:>9}  x baseline's p99 [95 %]",
            "ns", "x baseline [95 %]", "p99 ns"
        )?;
        indices.try_for_each(|index| {
            let line = |name: &str, median: Figure| {
                let ratio = |figure, to| {
                    Estimate::ratio(column(played, index, figure), column(played, baseline, to))
                };
                let ns = Estimate::of(column(played, index, median)).value;
                (
                    format!("{name:42} {ns:9.0}  {:22}", ratio(median, MEDIAN)),
                    ratio(P99, P99),
                )
            };
            let p99_ns = Estimate::of(column(played, index, P99)).value;
            let (start, p99) = line(entries[index].name, MEDIAN);
            writeln!(text, "{start} {p99_ns:9.0}  {p99}")?;
            if entries[index].interrupted {
                let (start, _) = line("  after a stop of the server", INTERRUPTED);
                writeln!(text, "{}", start.trim_end())?;
            }
            Ok::<_, std::fmt::Error>(())
        })?;
    }
    Ok(text)
}
