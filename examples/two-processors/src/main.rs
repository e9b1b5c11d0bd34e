//! `condor` with the programs of both processors.

use std::process::ExitCode;

use condor_host::cli::{self, Programs};
use condor_rt::linux;
use two_processors::{Master, Servo};

fn main() -> ExitCode {
    cli::main(&Programs(&[
        ("master", |arguments| linux::run(&Master, arguments)),
        ("servo", |arguments| linux::run(&Servo, arguments)),
    ]))
}
