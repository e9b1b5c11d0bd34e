//! `condor` with the programs of both processors.

use std::process::ExitCode;

use condor_cli::Programs;
use condor_rt::linux;
use qemu_virt_host::HARTS;
use two_processors::{Master, Servo};

fn main() -> ExitCode {
    let programs = Programs::new(&[
        ("master", |arguments| linux::run(&Master, arguments)),
        ("servo", |arguments| linux::run(&Servo, arguments)),
    ]);
    condor_cli::main(&programs.with(&[HARTS]))
}
