//! [`run`]: a whole process.

use std::path::Path;
use std::process::ExitCode;

use super::environment::Environment;
use super::error::ProcessError;
use super::process::LinuxProcess;
use crate::machine::{Machine as _, Program};

/// Runs `program` on the processor that the [environment](Environment) describes, until the program
/// ends. A `main` has to do nothing else.
///
/// `arguments` are the program's arguments, without its name. If the program fails, the reason is printed to standard
/// error, and the result is the [exit status of the error](crate::ProgramError::exit_status). Each privilege that the
/// kernel refuses, such as the priority, is printed, too.
///
/// If its [`loops`](Environment::loops) are `signals`, the result is a failure, and `program` does not
/// run: only [`run_allowing_signals`] permits loops in signal handlers.
#[must_use]
pub fn run<P: Program>(program: &P, arguments: impl IntoIterator<Item = String>) -> ExitCode {
    run_on(program, |environment| {
        LinuxProcess::new(environment, arguments)
    })
}

/// Runs `program` as [`run`] does, and also permits loops in signal handlers. They run there if the
/// [`loops`](Environment::loops) of its environment are `signals`.
///
/// # Safety
/// If loops run in signal handlers, the loops of `program` must keep the contract of
/// [`SignalPlatform::new`](condor_mos::linux::SignalPlatform::new), as for [`LinuxProcess::allowing_signals`].
#[must_use]
pub unsafe fn run_allowing_signals<P: Program>(
    program: &P,
    arguments: impl IntoIterator<Item = String>,
) -> ExitCode {
    run_on(program, |environment| {
        // SAFETY: as the caller promises; the machine runs this program alone.
        unsafe { LinuxProcess::allowing_signals(environment, arguments) }
    })
}

fn run_on<P: Program>(
    program: &P,
    machine: impl FnOnce(&Environment) -> Result<LinuxProcess, ProcessError>,
) -> ExitCode {
    let machine = match Environment::read().and_then(|environment| machine(&environment)) {
        Ok(machine) => machine,
        Err(error) => {
            eprintln!("{}: {error}", own_name());
            return ExitCode::FAILURE;
        }
    };
    let number = machine.number();
    match program.run(&machine) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{number}: {error}");
            // In simulated time it keeps the turn until its supervisor has seen its end.
            core::mem::forget(machine);
            error.exit_status().into()
        }
    }
}

/// The name by which this program was called.
fn own_name() -> String {
    let called = std::env::args_os().next().unwrap_or_default();
    let name = Path::new(&called).file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}
