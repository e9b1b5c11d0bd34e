//! Benchmarks of the Condor crates beside their peers, one sub-command for each crate.
//!
//! `cargo run --release --manifest-path tests/bench/Cargo.toml -- COMMAND [--rounds N] [--quick]`

mod build;
mod callgrind;
mod clock;
mod dev;
mod fs;
mod hand;
mod machine;
mod mbox;
mod measure;
mod mos;
mod mos_instructions;
mod options;
mod process;
mod race;
mod results;
mod riscv_instructions;
mod rounds;
mod simulated;
mod vars;
mod watchers;

use std::error::Error;
use std::process::ExitCode;

use clap::Parser as _;
use measure::Report;
use options::Options;

/// The result of every part of the program.
type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// A sub-command: the name to call it by, what it measures, and the function that does.
#[derive(Debug)]
struct Command {
    name: &'static str,
    about: &'static str,
    run: fn(&Options) -> Result<Report>,
}

const COMMANDS: &[Command] = &[
    Command {
        name: "dev",
        about: "instructions of a device's write by condor-dev beside the driver called directly",
        run: dev::run,
    },
    Command {
        name: "fs",
        about: "reads and writes of condor-fs beside native ones",
        run: fs::run,
    },
    Command {
        name: "hand",
        about: "laws of condor-hand beside Pinocchio",
        run: hand::run,
    },
    Command {
        name: "mbox",
        about: "round trips of condor-mbox beside raw atomics, futexes and iceoryx2",
        run: mbox::run,
    },
    Command {
        name: "mos-instructions",
        about: "instructions of a release on a Cortex-M3 in QEMU, beside RTIC 2",
        run: mos_instructions::run,
    },
    Command {
        name: "mos",
        about: "servo loops of condor-mos beside FIFO threads",
        run: mos::run,
    },
    Command {
        name: "simulated",
        about: "how fast the processes of the hand go through simulated time",
        run: simulated::run,
    },
    Command {
        name: "riscv-instructions",
        about: "instructions of a release, a message and an interrupt on a RISC-V hart in QEMU",
        run: riscv_instructions::run,
    },
    Command {
        name: "page",
        about: "what the server of the page takes at 30 Hz, and what it costs the loops of the hand",
        run: watchers::page::run,
    },
    Command {
        name: "remote",
        about: "how old rows are at clients over zenoh, and what these cost the loops of the hand",
        run: watchers::remote::run,
    },
    Command {
        name: "vars",
        about: "rows of condor-vars beside memcpy",
        run: vars::run,
    },
];

/// Calls one path many times. A command starts the program again under callgrind to do this.
fn go_down_one_path(mut arguments: impl Iterator<Item = String>) -> Result<()> {
    let (name, calls) = (arguments.next(), arguments.next());
    let (Some(name), Some(calls)) = (name, calls) else {
        return Err("a path and a number of calls are needed".into());
    };
    dev::go(&name, calls.parse()?)
}

fn measure(options: &Options) -> Result<()> {
    let Command { name, about, run } = options.command;
    let header = machine::describe();
    println!("{header}");
    let report = run(options)?;
    println!("{report}");
    if options.record {
        results::record(name, about, &header, &report)?;
    }
    Ok(())
}

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1).peekable();
    let done = match arguments.next_if(|name| name == callgrind::PATH) {
        Some(_) => go_down_one_path(arguments),
        None => measure(&Options::parse()),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}
