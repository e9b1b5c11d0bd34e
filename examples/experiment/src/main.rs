//! `condor` with the experiment.

use std::process::ExitCode;

use condor_cli::Programs;
use condor_rt::linux;
use experiment::Experiment;
use qemu_virt_host::HARTS;

fn main() -> ExitCode {
    let programs = Programs::new(&[("motor", |words| linux::run(&Experiment, words))]);
    condor_cli::main(&programs.with(&[HARTS]))
}
