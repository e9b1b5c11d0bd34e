//! The programs of the processors.

use std::time::Duration;

use condor_rt::{Background, Machine, Program, Setup};
use condor_tty::{ConsoleError, Policy, TerminalSettings};
use embedded_io::{Read, Write};

type Failed = Box<dyn std::error::Error>;

/// Longer than a service needs to be started again.
const PATIENCE: Duration = Duration::from_secs(30);
/// The time between two lines.
const PAUSE: Duration = Duration::from_millis(2);

/// Writes numbered lines to its terminal, and what is typed there.
pub(crate) struct Writer;

impl Program for Writer {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), condor_rt::ProgramError> {
        let mut setup = Setup::new(machine)?;
        setup.console()?.background(|background| {
            Self::write(background).map_err(|error| condor_rt::ProgramError::program(&error))
        })
    }
}

impl Writer {
    fn write<M: Machine>(background: &Background<'_, M>) -> Result<(), Failed> {
        let (machine, terminal) = (background.machine(), background.console()?);
        let mut name = String::from("writer");
        if let Some(word) = machine.argument(0) {
            name = format!("{name} {word}");
        }
        // What is typed would come between the words of a line.
        terminal.configure(&TerminalSettings {
            echo: false,
            ..TerminalSettings::COOKED
        })?;
        terminal.set_policy(Policy::Block { timeout: PATIENCE })?;
        let mut console = terminal
            .console(background.mailbox())
            .with_read_timeout(PAUSE);
        let mut line = [0; 64];
        let mut count = 0;
        while !machine.is_stopping() {
            match console.read(&mut line) {
                Ok(len) => match line[..len].trim_ascii() {
                    b"stall" => loop {
                        std::thread::park();
                    },
                    text => writeln!(console, "typed {}", String::from_utf8_lossy(text))?,
                },
                Err(ConsoleError::TimedOut { .. }) => {
                    writeln!(console, "{name} {count}")?;
                    count += 1;
                }
                Err(error) => return Err(error.into()),
            }
        }
        Ok(())
    }
}
