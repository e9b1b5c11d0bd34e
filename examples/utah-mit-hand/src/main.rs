//! The hand: `condor` with the programs of its processors.
//!
//! Without arguments it brings up the system of `system.toml`.

use std::path::PathBuf;
use std::process::ExitCode;

use condor_host::cli::{self, Programs};
use condor_host::linux;
use utah_mit_hand::plant::Plant;
use utah_mit_hand::servo::Servo;
use utah_mit_hand::table::Table;

/// The programs that a processor may run.
struct Hand;

impl Programs for Hand {
    fn names(&self) -> &[&'static str] {
        &["plant", "servo", "table"]
    }

    fn run(&self, name: &str, arguments: Vec<String>) -> ExitCode {
        // SAFETY: the loops of these programs neither allocate nor print. They take no lock of the
        // host's: what they share with their backgrounds is in sections of the processor, which keep
        // the signals out.
        unsafe {
            match name {
                "plant" => linux::run(&Plant, arguments),
                "servo" => linux::run(&Servo, arguments),
                "table" => linux::run(&Table, arguments),
                _ => {
                    eprintln!("utah-mit-hand: there is no program `{name}`");
                    ExitCode::from(2)
                }
            }
        }
    }

    fn description(&self) -> Option<PathBuf> {
        Some(concat!(env!("CARGO_MANIFEST_DIR"), "/system.toml").into())
    }
}

fn main() -> ExitCode {
    cli::main(&Hand)
}
