//! `dev`: what a write to a device costs beside the driver's own instructions.
//!
//! Sixteen bits go to the same register of the same driver on the same bus, which is plain memory,
//! by each way: the driver called directly, the descriptor, a switch of trait objects that checks
//! descriptors in the same way, rust-vmm's device manager. Instructions are counted by callgrind,
//! from the first of the function that goes that way to its return; they are the same every time,
//! so there are no rounds and their intervals have no width. Time is that of the descriptor's way
//! beside write(2) of the same two bytes to `/dev/null`.

mod boards;
mod paths;
mod peers;
mod time;

use std::fmt::Write as _;

use crate::Result;
use crate::callgrind;
use crate::measure::{Better, Estimate, Goal, Report};
use crate::options::Options;

pub(crate) use paths::go;

const PATHS: &[(&str, &str)] = &[
    ("direct", "driver, called directly"),
    ("fd", "switch, by descriptor"),
    ("dyn", "switch of trait objects"),
    ("vm_device", "rust-vmm vm-device"),
    ("direct16", "16-bit call, directly"),
    ("typed", "16-bit call of the typed device"),
    ("putc", "BufWriter, a byte"),
    ("std_buf_writer", "std's BufWriter, a byte"),
    ("output", "shared Output, 16 bytes"),
];

/// Counts and times all paths.
///
/// # Errors
/// valgrind is missing or fails.
pub(crate) fn run(options: &Options) -> Result<Report> {
    let mut text = String::new();
    writeln!(text, "{:32} {:>12}", "one call", "instructions")?;
    let mut counts = Vec::new();
    for &(name, about) in PATHS {
        let count = callgrind::instructions(name)?;
        writeln!(text, "{about:32} {count:12.1}")?;
        counts.push((name, count));
    }
    let rounds = time::rounds(options)?;
    let median = |ns: fn(&time::Round) -> f64| Estimate::of(rounds.iter().map(ns));
    writeln!(text, "\n{:32} {:>12}", "one call", "ns")?;
    let fd_ns = median(|round| round.fd_ns);
    let write2_ns = median(|round| round.write2_ns);
    writeln!(text, "{:32} {fd_ns:12.2}", "switch, by descriptor")?;
    writeln!(text, "{:32} {write2_ns:12.2}", "write(2) to /dev/null")?;
    let count = |wanted| {
        let found = counts.iter().find(|(name, _)| *name == wanted);
        found.map_or(f64::NAN, |(_, count)| *count)
    };
    let lower = |name, value, limit| Goal {
        name,
        estimate: Estimate::of([value]),
        limit,
        better: Better::Lower,
    };
    let goals = vec![
        lower("fd_over_direct", count("fd") - count("direct"), 25.0),
        lower("fd_vs_dyn", count("fd") / count("dyn"), 0.9),
        lower("typed_over_direct", count("typed") - count("direct16"), 0.0),
        lower("putc", count("putc"), 20.0),
        Goal {
            name: "write2_vs_fd",
            estimate: Estimate::ratio(
                rounds.iter().map(|round| round.write2_ns),
                rounds.iter().map(|round| round.fd_ns),
            ),
            limit: 10.0,
            better: Better::Higher,
        },
    ];
    Ok(Report {
        text,
        goals,
        ..Report::default()
    })
}
