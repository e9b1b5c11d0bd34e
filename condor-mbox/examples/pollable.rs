//! Mailboxes in event loops: one in tokio's, and one, in another process, in a loop around epoll.
//!
//! The order is the same in both: drain the bell, look at the mailbox, and only then wait for the
//! bell. Nobody rings for a peer that is killed, so a loop that expects something looks at its
//! peers from a timer, too.
//!
//! `cargo run --release -p condor-mbox --features linux --example pollable`

use std::cell::Cell;
use std::os::fd::AsFd;
use std::process::{Command, Stdio};
use std::time::Duration;

use condor_mbox::linux::{Claim, Mailbox, System};
use condor_mbox::{Call, CriticalSection, Error, PeerState, Processor, Ticket, Vector};
use rustix::event::epoll;
use rustix::io::Errno;
use tokio::net::unix::pipe;

type AnyError = Box<dyn std::error::Error>;

/// The process around epoll, and the one in tokio.
const EPOLL: Processor = Processor(0);
const TOKIO: Processor = Processor(1);

const SCALE: Vector = Vector(1);
const FACTOR: Vector = Vector(2);

const REQUESTS: u32 = 10_000;
/// How long a handler's own requests may take.
const SECOND: Duration = Duration::from_secs(1);
/// The time between two looks at a peer that says nothing.
const TICK: Duration = Duration::from_millis(10);

fn main() -> Result<(), AnyError> {
    if std::env::args().nth(1).as_deref() == Some("epoll") {
        return with_epoll(&System::<2>::inherited()?.claim(EPOLL)?);
    }
    let system = System::<2>::family(4096)?;
    let mut command = Command::new(std::env::current_exe()?);
    command.arg("epoll").stdin(Stdio::piped());
    let mut child = system.pass_to(&mut command).spawn()?;
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    let outcome = runtime.block_on(with_tokio(&system.claim(TOKIO)?));
    // The other loop ends when its standard input does.
    drop(child.stdin.take());
    child.wait()?;
    outcome
}

/// Asks the other process, and answers what that asks back before it replies.
async fn with_tokio(claim: &Claim<2>) -> Result<(), AnyError> {
    let ticks = std::rc::Rc::new(Cell::new(0_u32));
    let mut mailbox = open(claim)?;
    mailbox.set_vector(FACTOR, &|_| 42, "factor")?;
    mailbox.join()?;
    // From here on every message rings, also while nobody waits inside of the mailbox.
    mailbox.ring_always(true)?;
    let bell = claim.doorbell().pollable();
    let bell = pipe::Receiver::from_owned_fd(bell.as_fd().try_clone_to_owned()?)?;

    let tasks = tokio::task::LocalSet::new();
    let counted = ticks.clone();
    tasks.spawn_local(async move {
        loop {
            tokio::time::sleep(Duration::from_millis(1)).await;
            counted.set(counted.get() + 1);
        }
    });
    let asked = async {
        for number in 0..REQUESTS {
            let scaled = ask(&mailbox, &bell, number).await?;
            if scaled != number * 42 {
                return Err(format!("{number} * 42 is not {scaled}").into());
            }
        }
        Ok::<_, AnyError>(())
    };
    tasks.run_until(asked).await?;
    println!("{REQUESTS} requests, each asked back for the factor 42, all replies right");
    println!("the loop went on meanwhile: {} other events", ticks.get());
    Ok(())
}

/// Sends a request as soon as the peer is there, and waits for its reply without holding up the
/// loop.
async fn ask(
    mailbox: &Mailbox<'_, 2>,
    bell: &pipe::Receiver,
    number: u32,
) -> Result<u32, AnyError> {
    let mut ticket: Option<Ticket<'_, _>> = None;
    loop {
        while mailbox.service(SECOND)? > 0 {}
        match &mut ticket {
            Some(ticket) => {
                if let Some(reply) = ticket.poll()? {
                    return Ok(reply);
                }
            }
            // A peer that has just been sent to is looked at again before the bell is waited for.
            None => match mailbox.begin(EPOLL, SCALE, number) {
                Ok(begun) => {
                    ticket = Some(begun);
                    continue;
                }
                // The peer rings when it joins, and when it has taken something.
                Err(Error::NotConnected { .. } | Error::NoSlot { .. }) => {}
                Err(error) => return Err(error.into()),
            },
        }
        if let Ok(ready) = tokio::time::timeout(TICK, bell.readable()).await {
            ready?;
            // tokio believes the bell silent once a read found nothing. As long as it finds
            // something, the bell stays ready, and the other tasks go on in between.
            let _ = bell.try_read(&mut [0; 4096]);
        } else if let PeerState::Dead { .. } = mailbox.peer_state(EPOLL)? {
            return Err("the other process died".into());
        }
    }
}

/// Serves until standard input ends.
fn with_epoll(claim: &Claim<2>) -> Result<(), AnyError> {
    // Waits inside of the handler, where the mailbox serves; the loop around epoll does not run.
    let scale = |call: &Call<'_>| {
        let factor = call.send_with_reply(call.sender(), FACTOR, 0, SECOND);
        factor.map_or(u32::MAX, |factor| call.data() * factor)
    };
    let mut mailbox = open(claim)?;
    mailbox.set_vector(SCALE, &scale, "scale")?;
    mailbox.join()?;
    mailbox.ring_always(true)?;
    let bell = claim.doorbell().pollable();

    let (rung, ended) = (epoll::EventData::new_u64(0), epoll::EventData::new_u64(1));
    let poller = epoll::create(epoll::CreateFlags::CLOEXEC)?;
    epoll::add(&poller, bell.as_fd(), rung, epoll::EventFlags::IN)?;
    epoll::add(
        &poller,
        rustix::stdio::stdin(),
        ended,
        epoll::EventFlags::IN,
    )?;
    let mut events = Vec::with_capacity(2);
    loop {
        bell.drain();
        while mailbox.service(SECOND)? > 0 {}
        let buffer = rustix::buffer::spare_capacity(&mut events);
        // A signal interrupts it, also the one that continues a stopped process.
        match epoll::wait(&poller, buffer, None) {
            Ok(_) | Err(Errno::INTR) => {}
            Err(error) => return Err(error.into()),
        }
        if events
            .drain(..)
            .any(|event| event.data.u64() == ended.u64())
        {
            return Ok(());
        }
    }
}

fn open<'v>(claim: &Claim<2>) -> Result<Mailbox<'v, 2>, Error> {
    let (windows, doorbell) = claim.clone().into_parts();
    Mailbox::new(claim.number(), windows, doorbell, CriticalSection)
}
