//! `tty`: blocks of output of a processor, into memory beside memcpy and into a real pty beside
//! write(2) of the same blocks.

mod memory;
mod pty;
mod station;

use crate::Result;
use crate::measure::{Goal, Report};
use crate::options::Options;
use crate::process::{CorePair, pin};
use crate::rounds::{self, NS, Tables};

/// Bytes of a block; the goals are for the last.
const BLOCKS: [usize; 2] = [4 << 10, 64 << 10];

/// Runs the sub-command.
pub(crate) fn run(options: &Options) -> Result<Report> {
    let rounds = options.rounds(31, 9);
    let cores = CorePair::find()?;
    pin(cores.first)?;
    let mut tables = Tables::new(NS);
    let heads = BLOCKS.map(|block| {
        let kib = block >> 10;
        [
            format!("{kib} KiB into memory"),
            format!("{kib} KiB into a pty"),
        ]
    });
    for [memory, pty] in &heads {
        tables.rows(memory, &memory::WAYS);
        tables.rows(pty, &pty::WAYS);
    }
    tables.fill(rounds::play(rounds, |number| {
        let mut figures = Vec::new();
        for block in BLOCKS {
            figures.extend(memory::play(block, number as u64)?);
            // SAFETY: nothing before this has started a thread.
            figures.extend(unsafe { pty::play(block, number as u64, cores) }?);
        }
        Ok(figures)
    })?);
    let text = format!(
        "{rounds} rounds with fresh terminals; medians over the rounds of one block's time, and of ratios\n\
         of times in the same round, with the interval that holds the true median in 95 of 100 runs.\n\
         Processor and host are both on core {}, who reads the pty on core {}.\n{tables}",
        cores.first, cores.second,
    );
    // The throughput of the third way, ours, to that of the first, its peer.
    let goal = |name, head: &str, ways: &[&str], limit| {
        let ratio = tables.ratio(&[(head, ways[0], 0)], &[(head, ways[2], 0)])?;
        Ok::<_, Box<dyn std::error::Error>>(Goal::least(name, ratio, limit))
    };
    let [.., [memory, pty]] = &heads;
    let goals = vec![
        goal("memory_vs_memcpy", memory, &memory::WAYS, 0.8)?,
        goal("pty_vs_write", pty, &pty::WAYS, 0.9)?,
    ];
    Ok(Report { text, goals })
}
