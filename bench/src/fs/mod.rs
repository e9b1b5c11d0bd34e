//! `fs`: reads and writes of one file, by condor-fs and by others.
//!
//! Every round has a fresh file, a fresh client and a fresh server. All ways to read or write so
//! many bytes take short turns beside each other, in an order that changes; every ratio is of two
//! figures of the same round. Native calls take part twice: their ratio to themselves (the control)
//! shows what is chance.

mod chunks;
mod place;
mod round;
mod serving;
mod socket;
mod turns;
mod ways;

use std::fmt::Write;
use std::io::IsTerminal;

use place::Place;
use round::Plan;
use turns::Figures;
use ways::{Operation, Way};

use crate::Result;
use crate::measure::{Better, Estimate, Goal, Report};
use crate::options::Options;
use crate::process::CorePair;

/// What is moved by one call, in bytes.
const SIZES: [usize; 4] = [64, 4 << 10, 64 << 10, 1 << 20];

/// Throughput of at least 0.95 of the native one is at most so many times the native time.
const MOST_TIME: f64 = 1.0 / 0.95;

/// Runs the sub-command.
pub(crate) fn run(options: &Options) -> Result<Report> {
    let (rounds, turns) = if options.quick { (9, 2) } else { (31, 3) };
    let rounds = options.rounds.unwrap_or(rounds);
    let plan = Plan {
        turns,
        turn_ns: 1e6,
        cores: CorePair::find()?,
    };
    let progress = std::io::stderr().is_terminal();
    let mut played = Vec::new();
    let place = Place::new()?;
    for number in 0..rounds {
        if progress {
            eprint!("\rround {} of {rounds} ", number + 1);
        }
        // SAFETY: nothing before this has started a thread.
        played.push(unsafe { round::play(&plan, place.directory(), number as u64) }?);
    }
    if progress {
        eprint!("\r{:24}\r", "");
    }
    Ok(Report {
        text: text(&plan, &place, &played)?,
        goals: goals(&played),
        ..Report::default()
    })
}

/// One figure of every round.
fn column(
    played: &[Figures],
    way: Way,
    operation: Operation,
    size: usize,
) -> impl Iterator<Item = f64> + Clone {
    played
        .iter()
        .map(move |figures| figures.of(way, operation, size))
}

fn goals(played: &[Figures]) -> Vec<Goal> {
    let [_, small, middle, large] = SIZES;
    let lower = |name, estimate, limit| Goal {
        name,
        estimate,
        limit,
        better: Better::Lower,
    };
    let read_4k = |figures: &Figures| {
        let of = |way| figures.of(way, Operation::Read, small);
        (of(Way::Ours) - of(Way::Native)) / of(Way::RoundTrip)
    };
    let to_native = |operation| {
        let of = |way| column(played, way, operation, large);
        Estimate::ratio(of(Way::Ours), of(Way::Native))
    };
    // A read and a write together.
    let both = |way| {
        let of = move |operation| column(played, way, operation, middle);
        of(Operation::Read)
            .zip(of(Operation::Write))
            .map(|(read, write)| read + write)
    };
    let to_ours = |name, way, limit| Goal {
        name,
        estimate: Estimate::ratio(both(way), both(Way::Ours)),
        limit,
        better: Better::Higher,
    };
    vec![
        lower(
            "read_4k_over_native_in_rtt",
            Estimate::of(played.iter().map(read_4k)),
            1.3,
        ),
        lower("read_1m_vs_native", to_native(Operation::Read), MOST_TIME),
        lower("write_1m_vs_native", to_native(Operation::Write), MOST_TIME),
        to_ours("socket_64k_vs_ours", Way::Socket, 4.0),
        to_ours("chunked_64k_vs_ours", Way::Chunked, 10.0),
    ]
}

fn text(plan: &Plan, place: &Place, played: &[Figures]) -> Result<String> {
    let mut text = String::new();
    writeln!(
        text,
        "{} rounds, a fresh file and two fresh processes in each; client on core {}, server on core {}.\n\
         The file is in the page cache of {}. Times of one call: medians of batches; ratios are\n\
         of times in the same round, with the interval that holds the true median in 95 of 100 runs.",
        played.len(),
        plan.cores.first,
        plan.cores.second,
        place.file_system(),
    )?;
    for (operation, size) in turns::cells() {
        let of = |way| column(played, way, operation, size);
        let head = format!("{operation} of {}", bytes(size));
        writeln!(text, "\n{head:46} {:>10}  x native [95 %]", "ns")?;
        for way in Way::ALL {
            let ns = Estimate::of(of(way)).value;
            let ratio = Estimate::ratio(of(way), of(Way::Native));
            writeln!(text, "{:46} {ns:10.0}  {ratio}", way.name())?;
        }
    }
    Ok(text)
}

fn bytes(size: usize) -> String {
    match size {
        0..1024 => format!("{size} B"),
        1024..0x10_0000 => format!("{} KiB", size >> 10),
        _ => format!("{} MiB", size >> 20),
    }
}
