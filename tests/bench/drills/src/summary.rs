//! The summary of a drill's results.

use condor_host::description::SystemDescription;
use condor_host::error::AnyError;
use condor_host::system::SystemDirectory;
use condor_host::view::View;
use condor_mbox::linux::LinuxWindow;
use condor_mbox::{Processor, Region};
use drills::stress::{self, Verdict};
use drills::table::{self, Times};

/// Prints the verdicts and times of the processors of a running system.
///
/// # Errors
/// Returns an error if the memory cannot be read, or if a processor has counted something wrong, or has not
/// come to an end.
pub(crate) fn of(
    description: &SystemDescription,
    directory: &SystemDirectory,
) -> Result<(), AnyError> {
    let view = View::open(directory, description.window_bytes)?;
    let mut regions = Vec::new();
    for processor in &description.processors {
        let number = processor.number;
        regions.push((
            processor.name.as_str(),
            number,
            view.region(Processor(number))?,
        ));
    }
    let names: Vec<_> = regions
        .iter()
        .map(|(name, number, _)| (*name, *number))
        .collect();
    let stressed = description.processors.iter().any(|processor| {
        let mut arguments = processor.arguments.iter();
        arguments.any(|argument| argument == "stress")
    });
    if stressed {
        verdicts(regions.iter().map(|(name, _, region)| (*name, region)))?;
    }
    for (name, _, region) in &regions {
        if let Some(times) = drills::published::<Times, _>(region, table::NAME)? {
            print_times(name, &times, &names);
        }
    }
    Ok(())
}

/// Prints the verdicts of processors.
///
/// # Errors
/// Returns an error if the memory cannot be read, or if a processor has counted something wrong, or has not
/// come to an end.
pub(crate) fn verdicts<'r>(
    regions: impl Iterator<Item = (&'r str, &'r Region<LinuxWindow>)>,
) -> Result<(), AnyError> {
    println!(
        "{:<10} {:>8} {:>8} {:>8} {:>8} {:>6}  {:>16} {:>14} {:>8} {:>16} {:>8}",
        "processor",
        "notes",
        "ticks",
        "calls",
        "nested",
        "wrong",
        "released",
        "skipped",
        "drift",
        "late",
        "stack"
    );
    let pair = |[fast, slow]: [u32; 2]| format!("{fast}+{slow}");
    let mut bad = Vec::new();
    for (name, region) in regions {
        let verdict = drills::published::<Verdict, _>(region, stress::NAME)?;
        let Some(verdict) = verdict.filter(|verdict| verdict.is_complete == 1) else {
            println!("{name:<10} has not come to an end");
            bad.push(name);
            continue;
        };
        println!(
            "{name:<10} {:>8} {:>8} {:>8} {:>8} {:>6}  {:>16} {:>14} {:>8} {:>16} {:>8}",
            verdict.notes,
            verdict.ticks,
            verdict.calls,
            verdict.nested,
            verdict.wrong,
            pair(verdict.released),
            pair(verdict.skipped),
            pair(verdict.drift),
            pair(verdict.lateness),
            verdict.stack,
        );
        if verdict.wrong > 0 || verdict.drift.iter().any(|&drift| drift > 1) {
            bad.push(name);
        }
    }
    if bad.is_empty() {
        return Ok(());
    }
    Err(format!("the stress went wrong on {}", bad.join(", ")).into())
}

fn print_times(name: &str, times: &Times, names: &[(&str, u8)]) {
    let us = |ns: u32| f64::from(ns) * 1e-3;
    for (other, number) in names {
        let of = |row: &[u32]| row.get(usize::from(*number)).copied().unwrap_or(0);
        let (sent, replied) = (of(&times.sent), of(&times.replied));
        if replied > 0 {
            println!(
                "{name:<13} to {other:<13} {:>10.2} us, with reply {:>10.2} us",
                us(sent),
                us(replied)
            );
        }
    }
}
