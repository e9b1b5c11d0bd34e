//! The program of the processors: writes down what it does, and at which instant.

use std::time::Duration;

use condor_mbox::{Messenger, Processor, Vector};
use condor_rt::{Background, Machine, OpenOptions, Program, ProgramError, Setup};
use condor_tty::{Policy, TerminalSettings};
use embedded_io::{Read, Write};

const ADD: Vector = Vector(5);
/// How long the other processor may take for an answer.
const ANSWER: Duration = Duration::from_millis(5);
/// How long an operation on a file may take.
pub(crate) const FILE: Duration = Duration::from_millis(250);
/// The time between two lines.
const PAUSE: Duration = Duration::from_millis(20);

/// Writes a line whenever somebody has typed one, or after a pause: to its terminal, and before that
/// to a file of its own. For each line it asks the processor of its argument for a sum.
pub(crate) struct Diary;

impl Program for Diary {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        Setup::new(machine)?
            .console()?
            .files()?
            .on(ADD, "add", &|call| call.data().wrapping_add(1))
            .background(|background| {
                Self::keep(background).map_err(|error| ProgramError::program(&error))
            })
    }
}

impl Diary {
    fn keep<M: Machine>(background: &Background<'_, M>) -> Result<(), Box<dyn std::error::Error>> {
        let (machine, mailbox) = (background.machine(), background.mailbox());
        let peer = machine.argument(0).unwrap_or_default().parse()?;
        let terminal = background.console()?;
        terminal.configure(&TerminalSettings {
            echo: false,
            ..TerminalSettings::COOKED
        })?;
        terminal.set_policy(Policy::Block {
            timeout: Duration::from_secs(30),
        })?;
        let mut console = terminal.console(mailbox).with_read_timeout(PAUSE);
        let files = background.files()?;
        files.set_timeout(FILE);
        let name = format!("diary-{}", machine.number().0);
        let options = OpenOptions::new().write().create().append();
        let mut file = files.open(&name, options)?;
        let (mut line, mut count) = ([0; 64], 0);
        while !machine.is_stopping() {
            let typed = console.read(&mut line).ok();
            let typed = typed.map(|len| String::from_utf8_lossy(&line[..len]).trim().to_owned());
            let began = mailbox.now().as_ns();
            let sum = mailbox.send_with_reply(Processor(peer), ADD, count, ANSWER);
            count = sum.unwrap_or(count);
            let entry = format!("{count} {}", typed.unwrap_or_default());
            let wrote = file.write(format!("{began} {entry}\n").as_bytes());
            let wrote = wrote.map_err(|error| error.to_string());
            let ended = mailbox.now().as_ns();
            writeln!(console, "{began} {ended} {entry} {wrote:?}")?;
        }
        Ok(())
    }
}
