//! A program of two lives.

use std::time::Duration;

use condor_rt::objects::Kind;
use condor_rt::{Error, Machine, OpenOptions, Program, Setup};
use condor_tty::Settings;
use embedded_io::Read;

/// The file for which the first life waits.
pub(crate) const GO: &str = "go";
const NAP: Duration = Duration::from_millis(1);

/// Reads a file in its first life, and what is typed in its second.
pub(crate) struct Late;

impl Program for Late {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), Error> {
        Setup::new(machine)?
            .console_with(&Settings::OUTPUT)?
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
        setup.place("room", Kind::Other, |places| places.bytes(256))?;
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
