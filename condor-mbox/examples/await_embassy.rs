//! A mailbox in a program of embassy's tasks: what is served in the mailbox interrupt wakes the tasks
//! that await replies.
//!
//! Here the interrupt is a thread that waits for the doorbell's descriptor. On a board it is the
//! handler of the interrupt itself, with the same two lines.
//!
//! `cargo run --release -p condor-mbox --features linux,async --example await_embassy`

use std::process::ExitCode;
use std::sync::OnceLock;
use std::time::Duration;

use condor_mbox::linux::{LinuxMailbox, LinuxSystem, PollableBell};
use condor_mbox::{MailboxError, Messenger, Processor, Vector};
use embassy_executor::Executor;
use rustix::event::{PollFd, PollFlags, Timespec, poll};

const SERVER: Processor = Processor(0);
const TASKS: Processor = Processor(1);
const DOUBLE: Vector = Vector(1);

const REQUESTS: u32 = 1000;
const SECOND: Duration = Duration::from_secs(1);
/// Nobody rings for a peer that is killed.
const TICK: Timespec = Timespec {
    tv_sec: 0,
    tv_nsec: 10_000_000,
};

static MAILBOX: OnceLock<LinuxMailbox<'static, 2>> = OnceLock::new();

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), Box<dyn std::error::Error>> {
    let system = LinuxSystem::<2>::family(4096)?;
    let mut server = system.claim(SERVER)?.mailbox()?;
    server.set_vector(DOUBLE, &|call| call.data() * 2, "double")?;
    server.join()?;
    std::thread::spawn(move || -> Result<(), MailboxError> {
        loop {
            server.serve(SECOND)?;
        }
    });

    let mut mailbox = system.claim(TASKS)?.mailbox()?;
    mailbox.join()?;
    mailbox.wait_for_peer(SERVER, None, SECOND)?;
    mailbox.ring_always(true)?;
    let bell = mailbox.doorbell().pollable();
    let mailbox = MAILBOX.get_or_init(|| mailbox);
    std::thread::spawn(move || interrupt(mailbox, &bell));

    let executor: &'static mut Executor = Box::leak(Box::new(Executor::new()));
    executor.run(|spawner| match ask(mailbox) {
        Ok(task) => spawner.spawn(task),
        Err(error) => panic!("there is room for one task: {error:?}"),
    })
}

/// Asks, and awaits the reply, until all have come.
#[embassy_executor::task]
async fn ask(mailbox: &'static LinuxMailbox<'static, 2>) {
    for number in 0..REQUESTS {
        match reply(mailbox, number).await {
            Ok(reply) => assert_eq!(reply, number * 2),
            Err(error) => {
                eprintln!("{number}: {error}");
                std::process::exit(1);
            }
        }
    }
    println!("{REQUESTS} requests were awaited, all replies right");
    std::process::exit(0);
}

async fn reply(mailbox: &LinuxMailbox<'_, 2>, number: u32) -> Result<u32, MailboxError> {
    mailbox.begin(SERVER, DOUBLE, number, Duration::ZERO)?.await
}

/// The mailbox interrupt.
fn interrupt(mailbox: &LinuxMailbox<'_, 2>, bell: &PollableBell) {
    loop {
        let mut descriptors = [PollFd::new(bell, PollFlags::IN)];
        // A signal may end it early.
        let _ = poll(&mut descriptors, Some(&TICK));
        bell.drain();
        if let Err(error) = mailbox.serve(Duration::ZERO) {
            eprintln!("the mailbox interrupt: {error}");
            std::process::exit(1);
        }
    }
}
