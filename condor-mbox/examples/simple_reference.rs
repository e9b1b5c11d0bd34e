//! The memo's example (section 3.3.1) between two processes: read a memory location of another
//! processor by message, with and without reply, and then by a nested call.
//!
//! `cargo run --release -p condor-mbox --features linux --example simple_reference`

use std::process::{Child, Command, ExitCode};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use condor_mbox::linux::{Claim, LinuxMailbox, LinuxSystem};
use condor_mbox::{Call, MailboxError, Messenger, Processor, Vector, Waiting};

type AnyError = Box<dyn std::error::Error>;

/// The processor whose memory is read, and the one that asks.
const SERVER: Processor = Processor(0);
const CLIENT: Processor = Processor(1);

const SIMPLE_REFERENCE: Vector = Vector(12);
const NOTE: Vector = Vector(13);
const ASK_BACK: Vector = Vector(14);
const STOP: Vector = Vector(15);

const SECOND: Duration = Duration::from_secs(1);
const ROUND_TRIPS: usize = 20_000;

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
    if std::env::args().nth(1).as_deref() == Some("server") {
        return serve(LinuxSystem::<2>::inherited()?.claim(SERVER)?);
    }
    let system = LinuxSystem::<2>::family(4096)?;
    let mut command = Command::new(std::env::current_exe()?);
    let mut server = Server(system.pass_to(command.arg("server")).spawn()?);
    ask(system.claim(CLIENT)?)?;
    Ok(server.0.wait().map(drop)?)
}

/// Processor 0: answers for its own memory until it is told to stop.
fn serve(claim: Claim<2>) -> Result<(), AnyError> {
    let memory = claim.region(SERVER)?;
    memory.set_word(100, 1988)?;
    let noted = AtomicU32::new(0);
    let stop = AtomicU32::new(0);

    // The memo's handler: the value of the location whose address is the message.
    let simple_reference =
        |call: &Call<'_>| memory.word(call.data()).unwrap_or_else(|_| call.refuse(1));
    let note = |call: &Call<'_>| {
        noted.store(call.data(), Ordering::Relaxed);
        0
    };
    // Asks the sender for one of its locations before it replies.
    let ask_back = |call: &Call<'_>| {
        let answer = call.send_with_reply(call.sender(), SIMPLE_REFERENCE, call.data(), SECOND);
        answer.map_or(0, |value| value + noted.load(Ordering::Relaxed))
    };
    let stopped = |_: &Call<'_>| {
        stop.store(1, Ordering::Relaxed);
        0
    };

    let mut mailbox = open(claim)?;
    mailbox.set_vector(SIMPLE_REFERENCE, &simple_reference, "simple reference")?;
    mailbox.set_vector(NOTE, &note, "note a value")?;
    mailbox.set_vector(ASK_BACK, &ask_back, "ask the sender back")?;
    mailbox.set_vector(STOP, &stopped, "stop")?;
    mailbox.join()?;
    while stop.load(Ordering::Relaxed) == 0 {
        mailbox.serve(SECOND)?;
    }
    Ok(())
}

/// Processor 1: asks.
fn ask(claim: Claim<2>) -> Result<(), AnyError> {
    let memory = claim.region(CLIENT)?;
    memory.set_word(200, 900)?;
    let simple_reference = |call: &Call<'_>| memory.word(call.data()).unwrap_or(0);

    let mut mailbox = open(claim)?;
    mailbox.set_vector(SIMPLE_REFERENCE, &simple_reference, "simple reference")?;
    mailbox.join()?;

    let value = mailbox.send_with_reply(SERVER, SIMPLE_REFERENCE, 100, SECOND)?;
    println!("with reply:    location 100 of processor 0 holds {value}");
    mailbox.send(SERVER, NOTE, 77, SECOND)?;
    println!("without reply: 77 was sent, to be noted");
    let value = mailbox.send_with_reply(SERVER, ASK_BACK, 200, SECOND)?;
    println!("nested:        our location 200, read by processor 0, plus the note is {value}");

    println!("median round trip: {:?}", median_round_trip(&mailbox)?);
    let statistics = mailbox.vector_statistics(SERVER, SIMPLE_REFERENCE)?;
    println!(
        "{SERVER}, {SIMPLE_REFERENCE} ({}): handled {}, worst {} ns",
        statistics.name(),
        statistics.handled,
        statistics.worst_ns
    );
    mailbox.send(SERVER, STOP, 0, SECOND)?;
    Ok(())
}

fn open<'v>(claim: Claim<2>) -> Result<LinuxMailbox<'v, 2>, MailboxError> {
    let mut mailbox = claim.mailbox()?;
    mailbox.set_waiting(Waiting::SpinThenSleep {
        spin: Duration::from_millis(1),
    });
    Ok(mailbox)
}

fn median_round_trip(mailbox: &LinuxMailbox<'_, 2>) -> Result<Duration, MailboxError> {
    let mut taken = Vec::with_capacity(ROUND_TRIPS);
    for _ in 0..ROUND_TRIPS {
        let begun = Instant::now();
        mailbox.send_with_reply(SERVER, SIMPLE_REFERENCE, 100, SECOND)?;
        taken.push(begun.elapsed());
    }
    taken.sort_unstable();
    Ok(taken[ROUND_TRIPS / 2])
}

/// The other process, which does not outlive this one's interest in it.
struct Server(Child);

impl Drop for Server {
    fn drop(&mut self) {
        // Both fail if the server has ended already, as it does unless this process failed first.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
