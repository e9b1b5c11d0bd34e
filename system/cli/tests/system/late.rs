//! A program of two incarnations.

use std::time::Duration;

use condor_rt::objects::ObjectKind;
use condor_rt::{Machine, OpenOptions, Program, ProgramError, Setup};
use condor_tty::TerminalSettings;
use embedded_io::Read;

/// The file for which the first incarnation waits.
pub(crate) const GO: &str = "go";
const NAP: Duration = Duration::from_millis(1);

/// Reads a file in its first incarnation, and what is typed in its second.
pub(crate) struct Late;

impl Program for Late {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        Setup::new(machine)?
            .console_with(&TerminalSettings::OUTPUT)?
            .files()?
            .background(|background| {
                background.print(format_args!("first\n"));
                while background
                    .files()?
                    .open(GO, OpenOptions::new().read())
                    .is_err()
                {
                    background.serve(NAP)?;
                }
                Ok(())
            })?;
        let mut setup = Setup::new(machine)?;
        // So the terminal is at another place than before.
        setup.place("room", ObjectKind::Other, |allocator| allocator.bytes(256))?;
        setup.console()?.background(|background| {
            background.print(format_args!("second\n"));
            let mut console = background.console()?.console(background.mailbox());
            let mut line = [0; 64];
            while !background.is_stopping() {
                if let Ok(len) = console.read(&mut line) {
                    let line = String::from_utf8_lossy(&line[..len]);
                    background.print(format_args!("got {line}"));
                }
            }
            Ok(())
        })
    }
}
