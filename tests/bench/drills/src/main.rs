//! Drills: `condor` with programs that put mailbox and servo loops to the proof.
//!
//! `drills` brings up the stress of `stress.toml`, on processes of this machine; `drills exact` plays a
//! stress of harts alone, in which time counts instructions.

mod exact;
mod summary;

use std::path::PathBuf;
use std::process::ExitCode;

use condor_cli::{AnyError, Application, Programs};
use condor_host::description::SystemDescription;
use condor_host::extension::Extension;
use condor_host::system::SystemDirectory;
use condor_rt::linux;
use drills::{Echo, Order, Stress, Table};
use qemu_virt_host::HARTS;

struct Drills;

const PROGRAMS: Programs<'static> = Programs::new(&[
    ("echo", |arguments| linux::run(&Echo, arguments)),
    ("order", |arguments| linux::run(&Order, arguments)),
    ("stress", |arguments| {
        // SAFETY: its loops send and compute. They neither allocate nor print, and take no lock.
        unsafe { linux::run_allowing_signals(&Stress(|| 0), arguments) }
    }),
    ("table", |arguments| linux::run(&Table, arguments)),
]);

impl Application for Drills {
    fn programs(&self) -> Vec<&'static str> {
        PROGRAMS.programs()
    }

    fn run_program(&self, program: &str, arguments: Vec<String>) -> ExitCode {
        PROGRAMS.run_program(program, arguments)
    }

    fn extensions(&self) -> &[&'static dyn Extension] {
        &[HARTS]
    }

    fn description(&self) -> Option<PathBuf> {
        Some(concat!(env!("CARGO_MANIFEST_DIR"), "/stress.toml").into())
    }

    fn summarize(
        &self,
        description: &SystemDescription,
        directory: &SystemDirectory,
    ) -> Result<(), AnyError> {
        summary::of(description, directory)
    }
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let outcome = match arguments.split_first() {
        Some((word, rest)) if word == "exact" => exact::run(rest),
        _ => return condor_cli::main(&Drills),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("drills: {error}");
            ExitCode::FAILURE
        }
    }
}
