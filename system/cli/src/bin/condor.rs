//! Brings up a robot, and looks after it. It has no programs of its own; a package that has some
//! calls [`condor_cli::main`] with them.

use std::process::ExitCode;

fn main() -> ExitCode {
    condor_cli::main(&condor_cli::Programs::new(&[]))
}
