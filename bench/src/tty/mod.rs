//! `tty`: blocks of output of a processor, into memory beside memcpy and into a real pty beside
//! write(2) of the same blocks.

mod memory;
mod pty;
mod station;

use std::fmt::Write;

use crate::Result;
use crate::measure::{Better, Estimate, Goal, Report};
use crate::options::Options;
use crate::process::{CorePair, pin};

/// Bytes of a block; the goals are for the last.
const BLOCKS: [usize; 2] = [4 << 10, 64 << 10];

/// Nanoseconds of a block, one after the other as the names of a part say.
type Figures<const WAYS: usize> = [f64; WAYS];

/// Runs the sub-command.
pub(crate) fn run(options: &Options) -> Result<Report> {
    let rounds = options.rounds.unwrap_or(if options.quick { 9 } else { 31 });
    let cores = CorePair::find()?;
    let mut memory: [Vec<Figures<4>>; BLOCKS.len()] = [const { Vec::new() }; BLOCKS.len()];
    let mut pty: [Vec<Figures<3>>; BLOCKS.len()] = [const { Vec::new() }; BLOCKS.len()];
    pin(cores.first)?;
    for number in 0..rounds {
        for (block, (memory, pty)) in BLOCKS.iter().zip(memory.iter_mut().zip(&mut pty)) {
            memory.push(memory::play(*block, number as u64)?);
            // SAFETY: nothing before this has started a thread.
            pty.push(unsafe { pty::play(*block, number as u64, cores) }?);
        }
    }

    let mut text = format!(
        "{rounds} rounds with fresh terminals; medians over the rounds of one block's time, and of ratios\n\
         of times in the same round, with the interval that holds the true median in 95 of 100 runs.\n\
         Processor and host are both on core {}, who reads the pty on core {}.\n",
        cores.first, cores.second,
    );
    for (block, (memory, pty)) in BLOCKS.iter().zip(memory.iter().zip(&pty)) {
        let kib = block >> 10;
        table(
            &mut text,
            &format!("{kib} KiB into memory"),
            &memory::WAYS,
            memory,
        )?;
        table(&mut text, &format!("{kib} KiB into a pty"), &pty::WAYS, pty)?;
    }
    let [.., memory] = &memory;
    let [.., pty] = &pty;
    Ok(Report {
        text,
        goals: vec![
            goal("memory_vs_memcpy", memory, 0.8),
            goal("pty_vs_write", pty, 0.9),
        ],
        ..Report::default()
    })
}

/// Throughput of the third way, ours, to that of the first, its peer.
fn goal<const WAYS: usize>(name: &'static str, rounds: &[Figures<WAYS>], limit: f64) -> Goal {
    Goal {
        name,
        estimate: Estimate::of(rounds.iter().map(|figures| figures[0] / figures[2])),
        limit,
        better: Better::Higher,
    }
}

fn table<const WAYS: usize>(
    text: &mut String,
    head: &str,
    names: &[&str; WAYS],
    rounds: &[Figures<WAYS>],
) -> Result<()> {
    writeln!(text, "\n{head:52} {:>8}  x first row [95 %]", "ns")?;
    for (way, name) in names.iter().enumerate() {
        let of = |way: usize| rounds.iter().map(move |figures| figures[way]);
        let ratio = Estimate::ratio(of(way), of(0));
        writeln!(
            text,
            "{name:52} {:8.0}  {ratio}",
            Estimate::of(of(way)).value
        )?;
    }
    Ok(())
}
