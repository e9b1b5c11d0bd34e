//! Benchmarks of the Condor crates beside their peers, one sub-command for each crate.
//!
//! `cargo run --release --manifest-path bench/Cargo.toml -- COMMAND [--json] [--rounds N] [--quick]`

mod callgrind;
mod clock;
mod dev;
mod firmware;
mod fs;
mod hand;
mod machine;
mod mbox;
mod measure;
mod mos;
mod mos_instructions;
mod options;
mod process;
mod results;
mod riscv_instructions;
mod rounds;
mod shuffle;
mod swing;
mod system;
mod tty;
mod vars;

use std::error::Error;
use std::process::ExitCode;

use measure::Report;
use options::Options;

/// What every part of the program answers with.
type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// A sub-command: the name to call it by, what it measures, and the function that does.
struct Command {
    name: &'static str,
    about: &'static str,
    run: fn(&Options) -> Result<Report>,
}

const COMMANDS: &[Command] = &[
    Command {
        name: "dev",
        about: "instructions of a device's write by condor-dev, trait objects, vm-device, write(2)",
        run: dev::run,
    },
    Command {
        name: "fs",
        about: "reads and writes of condor-fs beside native ones, a socket protocol and chunks",
        run: fs::run,
    },
    Command {
        name: "hand",
        about: "laws of condor-hand beside k, dynibo, nalgebra's decompositions and Pinocchio",
        run: hand::run,
    },
    Command {
        name: "mbox",
        about: "round trips of condor-mbox beside raw atomics, futexes, queues, sockets and iceoryx2",
        run: mbox::run,
    },
    Command {
        name: "mos-instructions",
        about: "instructions of a release on a Cortex-M3 in QEMU, beside RTIC 2",
        run: mos_instructions::run,
    },
    Command {
        name: "mos",
        about: "servo loops of condor-mos beside FIFO threads, sleeps, tokio and embassy",
        run: mos::run,
    },
    Command {
        name: "system",
        about: "how fast a servo processor of 8 and 16 joints runs, beside an empty loop",
        run: system::run,
    },
    Command {
        name: "riscv-instructions",
        about: "instructions of a release and of a message on a RISC-V hart in QEMU",
        run: riscv_instructions::run,
    },
    Command {
        name: "tty",
        about: "blocks of condor-tty into memory beside memcpy, and into a pty beside write(2)",
        run: tty::run,
    },
    Command {
        name: "vars",
        about: "rows of condor-vars beside memcpy, and instructions of a tick that nobody watches",
        run: vars::run,
    },
];

/// Objects that peers allocate can be placed in shared memory; see [`mbox::arena`].
#[global_allocator]
static ALLOCATOR: mbox::arena::Allocator = mbox::arena::Allocator;

fn print_usage() {
    eprintln!("usage: condor-bench COMMAND {}", options::USAGE);
    for command in COMMANDS {
        eprintln!("  {:18} {}", command.name, command.about);
    }
}

/// Calls one path many times. A command starts the program again under callgrind to do this.
fn go_down_one_path(mut arguments: impl Iterator<Item = String>) -> ExitCode {
    let name = arguments.next();
    let calls = arguments.next().and_then(|text| text.parse().ok());
    let (Some(name), Some(calls)) = (name, calls) else {
        return ExitCode::from(2);
    };
    let gone = mbox::go(&name, calls).or_else(|| vars::go(&name, calls));
    match gone.unwrap_or_else(|| dev::go(&name, calls)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1).peekable();
    if arguments.next_if(|name| name == callgrind::PATH).is_some() {
        return go_down_one_path(arguments);
    }
    let command = arguments
        .next()
        .and_then(|name| COMMANDS.iter().find(|command| command.name == name));
    let options = Options::parse(arguments);
    let (Some(command), Ok(options)) = (command, options) else {
        print_usage();
        return ExitCode::from(2);
    };
    let header = machine::describe();
    if options.json {
        eprintln!("{header}");
    } else {
        println!("{header}");
    }
    match (command.run)(&options) {
        Ok(report) => {
            if options.json {
                println!("{}", report.json());
            } else {
                println!("{report}");
            }
            if options.record
                && let Err(error) = results::record(command.name, command.about, &header, &report)
            {
                eprintln!("{error}");
                return ExitCode::FAILURE;
            }
        }
        Err(error) => {
            eprintln!("{}: {error}", command.name);
            return ExitCode::FAILURE;
        }
    }
    ExitCode::SUCCESS
}
