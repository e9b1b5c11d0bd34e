//! A mailbox in a program of tasks: requests are awaited, and other tasks go on meanwhile.
//!
//! The doorbell of the mailbox is a descriptor for tokio. Whenever it is rung, one task serves; that
//! wakes the tasks that await replies.
//!
//! `cargo run --release -p condor-mbox --features linux,async --example await_tokio`

use std::cell::Cell;
use std::os::fd::AsFd;
use std::process::{Command, ExitCode};
use std::rc::Rc;
use std::time::Duration;

use condor_mbox::linux::{LinuxMailbox, LinuxSystem};
use condor_mbox::{Call, Messenger, Processor, Vector};
use tokio::net::unix::pipe;

type AnyError = Box<dyn std::error::Error>;

/// The process that serves, and the one of tasks.
const SERVER: Processor = Processor(0);
const TASKS: Processor = Processor(1);

const SCALE: Vector = Vector(1);
const FACTOR: Vector = Vector(2);
const STOP: Vector = Vector(3);

const REQUESTS: u32 = 10_000;
const SECOND: Duration = Duration::from_secs(1);
/// Nobody rings for a peer that is killed.
const TICK: Duration = Duration::from_millis(10);

fn main() -> ExitCode {
    match demonstrate() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn demonstrate() -> Result<(), AnyError> {
    if std::env::args().nth(1).as_deref() == Some("server") {
        return serve();
    }
    let system = LinuxSystem::<2>::family(4096)?;
    let mut command = Command::new(std::env::current_exe()?);
    let mut child = system.pass_to(command.arg("server")).spawn()?;
    let mut mailbox = system.claim(TASKS)?.mailbox()?;
    mailbox.set_vector(FACTOR, &|_| 42, "factor")?;
    mailbox.join()?;
    mailbox.wait_for_peer(SERVER, None, SECOND)?;
    // From here on every message rings, also while nobody waits inside of the mailbox.
    mailbox.ring_always(true)?;
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    runtime.block_on(run(&mailbox))?;
    mailbox.send(SERVER, STOP, 0, SECOND)?;
    child.wait()?;
    Ok(())
}

async fn run(mailbox: &LinuxMailbox<'_, 2>) -> Result<(), AnyError> {
    let ticks = Rc::new(Cell::new(0_u32));
    let counted = Rc::clone(&ticks);
    let tasks = tokio::task::LocalSet::new();
    tasks.spawn_local(async move {
        loop {
            tokio::time::sleep(Duration::from_millis(1)).await;
            counted.set(counted.get() + 1);
        }
    });
    let all = async {
        tokio::select! {
            asked = ask(mailbox) => asked,
            served = serve_when_rung(mailbox) => served,
        }
    };
    tasks.run_until(all).await?;
    println!("{REQUESTS} requests, each asked back for the factor 42, all replies right");
    println!("other tasks went on meanwhile: {} ticks", ticks.get());
    Ok(())
}

/// Requests and awaits, two at a time.
async fn ask(mailbox: &LinuxMailbox<'_, 2>) -> Result<(), AnyError> {
    for number in (0..REQUESTS).step_by(2) {
        let one = mailbox.begin(SERVER, SCALE, number, SECOND)?;
        let other = mailbox.begin(SERVER, SCALE, number + 1, SECOND)?;
        let (one, other) = tokio::try_join!(one, other)?;
        if (one, other) != (number * 42, (number + 1) * 42) {
            return Err(format!("{number} * 42 is not {one}, or {other}").into());
        }
    }
    Ok(())
}

/// Serves what comes, and so wakes those that await replies.
async fn serve_when_rung(mailbox: &LinuxMailbox<'_, 2>) -> Result<(), AnyError> {
    let bell = mailbox.doorbell().pollable();
    let bell = pipe::Receiver::from_owned_fd(bell.as_fd().try_clone_to_owned()?)?;
    loop {
        while mailbox.serve(Duration::ZERO)? > 0 {}
        if let Ok(ready) = tokio::time::timeout(TICK, bell.readable()).await {
            ready?;
            // tokio takes the descriptor for not readable once a read found nothing.
            let _ = bell.try_read(&mut [0; 4096]);
        }
    }
}

/// The other process: a loop around the mailbox, which sleeps in it.
fn serve() -> Result<(), AnyError> {
    let stopped = std::sync::atomic::AtomicBool::new(false);
    let scale = |call: &Call<'_>| match call.send_with_reply(call.sender(), FACTOR, 0, SECOND) {
        Ok(factor) => call.data() * factor,
        Err(_) => call.refuse(1),
    };
    let stop = |_: &Call<'_>| {
        stopped.store(true, std::sync::atomic::Ordering::Relaxed);
        0
    };
    let mut mailbox = LinuxSystem::<2>::inherited()?.claim(SERVER)?.mailbox()?;
    mailbox.set_vector(SCALE, &scale, "scale")?;
    mailbox.set_vector(STOP, &stop, "stop")?;
    mailbox.join()?;
    while !stopped.load(std::sync::atomic::Ordering::Relaxed) {
        mailbox.serve(SECOND)?;
    }
    Ok(())
}
