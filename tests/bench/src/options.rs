//! The options of a sub-command on the command line.

use std::path::PathBuf;

use clap::Parser;

use crate::{COMMANDS, Command};

/// Benchmarks of the Condor crates beside their peers
#[derive(Debug, Parser)]
pub(crate) struct Options {
    /// Benchmark to run
    #[arg(value_parser = command)]
    pub(crate) command: &'static Command,
    /// Number of rounds: an interval of a median over fewer than seven says nothing
    #[arg(long, value_parser = clap::value_parser!(u16).range(7..))]
    rounds: Option<u16>,
    /// Write what comes out to `RESULTS.md`, too
    #[arg(long)]
    pub(crate) record: bool,
    /// Take some ten seconds, at the price of wider intervals
    #[arg(long)]
    pub(crate) quick: bool,
    /// The virtual environment with Pinocchio, for `hand`; its own if there is none
    #[arg(long)]
    pub(crate) pinocchio: Option<PathBuf>,
}

fn command(name: &str) -> Result<&'static Command, String> {
    let found = COMMANDS.iter().find(|command| command.name == name);
    found.ok_or_else(|| {
        let lines = COMMANDS.iter();
        let lines = lines.map(|command| format!("\n  {:18} {}", command.name, command.about));
        format!("the commands are{}", lines.collect::<String>())
    })
}

impl Options {
    /// Returns the number of rounds: the one of the command line, or the usual one, or that of a quick run.
    pub(crate) fn rounds(&self, usual: usize, quick: usize) -> usize {
        let own = if self.quick { quick } else { usual };
        self.rounds.map_or(own, usize::from)
    }
}
