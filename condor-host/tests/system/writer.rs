//! The programs of the processors.

use std::time::Duration;

use condor_mbox::{Call, MemoryWindow, Places, Region};
use condor_rt::directory::{Directory, Kind};
use condor_rt::{Machine, Program};
use condor_tty::{ConsoleError, Policy, Settings, Terminal, Vectors};
use embedded_io::{Read, Write};

const CAPACITY: u32 = 4096;
/// Longer than a service needs to be started again.
const PATIENCE: Duration = Duration::from_secs(30);
/// The time between two lines.
const PAUSE: Duration = Duration::from_millis(2);

/// Writes numbered lines to its terminal, and what is typed there.
pub(crate) struct Writer;

impl Program for Writer {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), condor_rt::Error> {
        Self::write(machine).map_err(|error| condor_rt::Error::program(&error))
    }
}

impl Writer {
    fn write<M: Machine>(machine: &M) -> Result<(), Box<dyn std::error::Error>> {
        let mut name = String::from("writer");
        if let Some(word) = machine.argument(0) {
            name = format!("{name} {word}");
        }
        let number = machine.number();
        let windows = machine.windows();
        let own = Region::users(windows[number.index()].data.clone())?;
        let mut places = Places::new(own.size());
        let mut directory = Directory::new(own.clone(), &mut places)?;
        let terminal = Terminal::<_, _, 256>::new(own, &mut places, CAPACITY, machine.exclusion())?;
        directory.enter("console", Kind::Terminal, terminal.offset(), CAPACITY)?;
        // What is typed would come between the words of a line.
        terminal.configure(&Settings {
            echo: false,
            ..Settings::COOKED
        })?;
        terminal.set_policy(Policy::Block { timeout: PATIENCE })?;
        let receive = |call: &Call<'_>| terminal.receive(call);
        let mut mailbox = machine.mailbox()?;
        mailbox.set_vector(Vectors::DEFAULT.input, &receive, "terminal input")?;
        mailbox.set_vector(Vectors::DEFAULT.room, &receive, "terminal room")?;
        mailbox.join()?;
        let mut console = terminal.console(&mailbox).with_read_timeout(PAUSE);
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
