//! `fs`: reads and writes of one file, by condor-fs and by the kernel alone.
//!
//! Every round has a fresh file, a fresh client and a fresh server. All ways to read or write so
//! many bytes take short turns beside each other, in an order that changes; every ratio is of two
//! figures of the same round. Native calls take part twice: their ratio to themselves (the control)
//! shows what is chance.

mod place;
mod round;
mod serving;

use place::Place;

use crate::Result;
use crate::measure::{Estimate, Goal, Report};
use crate::options::Options;
use crate::process::CorePair;
use crate::rounds::{self, NS, Tables};

/// The operation of a call.
#[derive(Clone, Copy, Debug)]
enum Operation {
    /// Reads the file's beginning.
    Read,
    /// Writes over the file's beginning.
    Write,
}

/// pread and pwrite, by the client itself.
const NATIVE: &str = "pread, pwrite";
/// A word to the other core and one back, and nothing else.
const RAW: &str = "raw exchange of two cache lines";
/// Nothing else than a message.
const ROUND_TRIP: &str = "a message with a reply, without any file";
/// The calls of condor-fs that do not copy.
const OURS: &str = "condor-fs, no copy";

/// The names of all ways in the tables.
const WAYS: [&str; 5] = [
    NATIVE,
    "  the same once more (control)",
    RAW,
    ROUND_TRIP,
    OURS,
];

/// The bytes that one call moves, and their name.
const SIZES: [(usize, &str); 2] = [(4 << 10, "4 KiB"), (1 << 20, "1 MiB")];

/// A transfer of 1 MiB takes at most so many times the native time.
const MOST_TIME: f64 = 1.03;

/// A read of 4 KiB takes at most so many raw exchanges more than a native one.
const MOST_RAW: f64 = 3.0;

/// Returns each operation with each size, in the order of the tables.
fn cells() -> impl Iterator<Item = (Operation, usize, String)> {
    let operations = [(Operation::Read, "read"), (Operation::Write, "write")];
    let sizes = |(operation, verb)| {
        SIZES.map(move |(size, name)| (operation, size, format!("{verb} of {name}")))
    };
    operations.into_iter().flat_map(sizes)
}

/// Runs the sub-command.
pub(crate) fn run(options: &Options) -> Result<Report> {
    let rounds = options.rounds(31, 9);
    let cores = CorePair::find()?;
    let place = Place::new()?;
    let mut tables = Tables::new(NS);
    for (_, _, head) in cells() {
        tables.rows(&head, &WAYS);
    }
    tables.fill(rounds::play(rounds, |number| {
        // SAFETY: nothing before this has started a thread.
        unsafe { round::play(cores, place.directory(), number as u64) }
    })?);
    let text = format!(
        "{rounds} rounds, a fresh file and two fresh processes in each; client on core {}, server on core {}.\n\
         The file is in the page cache of {}. Times of one call: medians of batches; ratios are\n\
         of times in the same round, with the interval that holds the true median in 95 of 100 runs.\n\
         {tables}",
        cores.first,
        cores.second,
        place.file_system(),
    );
    Ok(Report {
        text,
        goals: goals(&tables)?,
    })
}

fn goals(tables: &Tables) -> Result<Vec<Goal>> {
    let read_4k = |way| tables.values(&[("read of 4 KiB", way, 0)]);
    // The ratio of the time that a read takes beyond a native one, to that of another way.
    let beyond_native = |unit| -> Result<Estimate> {
        let beyond = read_4k(OURS)?.into_iter().zip(read_4k(NATIVE)?);
        let beyond = beyond.map(|(ours, native)| ours - native);
        Ok(Estimate::ratio(beyond, read_4k(unit)?))
    };
    let to_native = |head| tables.ratio(&[(head, OURS, 0)], &[(head, NATIVE, 0)]);
    Ok(vec![
        Goal::most("read_4k_over_native_in_raw", beyond_native(RAW)?, MOST_RAW),
        Goal::most(
            "read_4k_over_native_in_rtt",
            beyond_native(ROUND_TRIP)?,
            1.3,
        ),
        Goal::most("read_1m_vs_native", to_native("read of 1 MiB")?, MOST_TIME),
        Goal::most(
            "write_1m_vs_native",
            to_native("write of 1 MiB")?,
            MOST_TIME,
        ),
    ])
}
