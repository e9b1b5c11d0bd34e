//! `condor` with the programs of both processors: without arguments it brings them up.

use std::path::PathBuf;
use std::process::ExitCode;

use condor_host::cli::{self, Programs};
use condor_rt::linux;
use two_processors::{Master, Servo};

struct TwoProcessors;

impl Programs for TwoProcessors {
    fn names(&self) -> &[&'static str] {
        &["master", "servo"]
    }

    fn run(&self, name: &str, arguments: Vec<String>) -> ExitCode {
        match name {
            "master" => linux::run(&Master, arguments),
            _ => linux::run(&Servo, arguments),
        }
    }

    fn description(&self) -> Option<PathBuf> {
        Some(concat!(env!("CARGO_MANIFEST_DIR"), "/system.toml").into())
    }
}

fn main() -> ExitCode {
    cli::main(&TwoProcessors)
}
