//! A processor, in a process of its own, with a terminal on a pseudo-terminal of this one.
//!
//! Open the path that it prints with any terminal program. Type `quit` there, or ^C.
//!
//! `cargo run --release -p condor-tty --features linux --example terminal`

use std::process::{Child, Command, ExitCode};
use std::time::{Duration, SystemTime};

use condor_mbox::linux::{Claim, LinuxSystem};
use condor_mbox::{Call, CriticalSection, Messenger, Processor, Region};
use condor_tty::linux::{Pty, TerminalHost, TerminalLog};
use condor_tty::{
    ConsoleError, Policy, Terminal, TerminalReader, TerminalReaderError, TerminalVectors,
};
use embedded_io::{Read, Write};

type AnyError = Box<dyn std::error::Error>;

const HOST: Processor = Processor(0);
const HAND: Processor = Processor(1);

const SECOND: Duration = Duration::from_secs(1);
const LOOK: Duration = Duration::from_millis(10);

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), AnyError> {
    if std::env::args().nth(1).as_deref() == Some("hand") {
        return hand(LinuxSystem::<2>::inherited()?.claim(HAND)?);
    }
    let system = LinuxSystem::<2>::family(64 * 1024)?;
    let mut command = Command::new(std::env::current_exe()?);
    let hand = Hand(system.pass_to(command.arg("hand")).spawn()?);
    host(system.claim(HOST)?, hand)
}

/// The processor: answers lines until one of them is `quit`.
fn hand(mut claim: Claim<2>) -> Result<(), AnyError> {
    let ram = Region::users(claim.windows()[HAND.index()].data.clone())?;
    let mut allocator = claim.places()?;
    let terminal = Terminal::<_, _, 256>::new(ram, &mut allocator, 4096, CriticalSection)?;
    terminal.set_policy(Policy::Block { timeout: SECOND })?;
    let receive = |call: &Call<'_>| terminal.receive(call);
    let mut mailbox = claim.mailbox()?;
    mailbox.set_vector(TerminalVectors::DEFAULT.input, &receive, "terminal input")?;
    mailbox.set_vector(TerminalVectors::DEFAULT.room, &receive, "terminal room")?;
    mailbox.join()?;

    let mut console = terminal.console(&mailbox);
    let mut line = [0; 256];
    write!(console, "the hand is ready\n> ")?;
    loop {
        match console.read(&mut line) {
            Ok(count) => match line.get(..count).unwrap_or_default().trim_ascii() {
                b"quit" => break,
                text => write!(console, "you typed {} bytes\n> ", text.len())?,
            },
            Err(ConsoleError::TimedOut { .. }) => {}
            Err(ConsoleError::Interrupted) => break,
            Err(error) => return Err(error.into()),
        }
    }
    writeln!(console, "bye")?;
    Ok(console.flush()?)
}

/// The host: the terminal on a pty, and with times on standard output, until the hand ends.
fn host(claim: Claim<2>, mut hand: Hand) -> Result<(), AnyError> {
    let ram = Region::users(claim.windows()[HAND.index()].data.clone())?;
    let mut mailbox = claim.mailbox()?;
    mailbox.set_vector(TerminalVectors::DEFAULT.output, &|_| 0, "terminal output")?;
    mailbox.join()?;
    let clock = || SystemTime::UNIX_EPOCH.elapsed().unwrap_or_default();
    let pty = Pty::open()?;
    println!("the terminal is {}", pty.path().display());
    // The hand has put it in order, or does so in a moment.
    while let Err(error) = TerminalReader::attach(ram.clone(), 0, HOST) {
        match error {
            TerminalReaderError::NotReady { .. } => mailbox.serve(LOOK)?,
            error => return Err(error.into()),
        };
    }
    let mut log = TerminalLog::new(pty, std::io::stdout(), clock);
    let mut tty = TerminalHost::attach(ram, 0, HAND, HOST)?;
    while hand.0.try_wait()?.is_none() {
        tty.serve(&mailbox, &mut log)?;
        mailbox.serve(LOOK)?;
    }
    tty.serve(&mailbox, &mut log)?;
    Ok(())
}

/// The other process, which does not outlive this one's interest in it.
struct Hand(Child);

impl Drop for Hand {
    fn drop(&mut self) {
        // Both fail if the process has ended already, as it does unless this process failed first.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
