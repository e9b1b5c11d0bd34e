//! Mailboxes inside of event loops, which wait for a descriptor and for nothing else.
#![cfg(feature = "linux")]

use std::future::poll_fn;
use std::os::fd::AsFd;
use std::sync::Mutex;
use std::task::Poll;
use std::thread;
use std::time::Duration;

use condor_mbox::linux::{LinuxMailbox, LinuxSystem, PollableBell};
use condor_mbox::{Call, CriticalSection, MailboxError, Messenger, Processor, Vector};
use rustix::event::epoll;
use tokio::net::unix::pipe;

const LOOP: Processor = Processor(0);
const OTHER: Processor = Processor(1);
const DOUBLE: Vector = Vector(1);
const STOP: Vector = Vector(2);
/// Never reached unless something is lost.
const GENEROUS: Duration = Duration::from_secs(100);
const MESSAGES: u32 = 2000;

fn mailbox<'v>(system: &LinuxSystem<2>, number: Processor) -> (LinuxMailbox<'v, 2>, PollableBell) {
    let claim = system.claim(number).unwrap();
    let bell = claim.doorbell().pollable();
    let (windows, doorbell) = claim.into_parts();
    let mailbox = LinuxMailbox::new(number, windows, doorbell, CriticalSection).unwrap();
    (mailbox, bell)
}

fn double(call: &Call<'_>) -> u32 {
    call.data().wrapping_mul(2)
}

/// Sends for as long as it takes until `STOP`, from a thread that sleeps inside of its mailbox.
fn ask(system: &LinuxSystem<2>) {
    let (mut mailbox, _) = mailbox(system, OTHER);
    mailbox.join().unwrap();
    for data in 0..MESSAGES {
        mailbox.send(LOOP, DOUBLE, data, GENEROUS).unwrap();
        let reply = mailbox.send_with_reply(LOOP, DOUBLE, data, GENEROUS);
        assert_eq!(reply, Ok(data * 2));
    }
    assert_eq!(mailbox.send_with_reply(LOOP, STOP, 0, GENEROUS), Ok(0));
}

fn serve_by_epoll(flags: epoll::EventFlags) {
    let system = LinuxSystem::<2>::family(64).unwrap();
    let stopped = Mutex::new(false);
    let stop = |_: &Call<'_>| {
        *stopped.lock().unwrap() = true;
        0
    };
    let (mut mailbox, bell) = mailbox(&system, LOOP);
    mailbox.set_vector(DOUBLE, &double, "double").unwrap();
    mailbox.set_vector(STOP, &stop, "stop").unwrap();
    mailbox.join().unwrap();
    mailbox.ring_always(true).unwrap();
    let poller = epoll::create(epoll::CreateFlags::CLOEXEC).unwrap();
    epoll::add(&poller, &bell, epoll::EventData::new_u64(0), flags).unwrap();
    thread::scope(|threads| {
        threads.spawn(|| ask(&system));
        let mut events = Vec::with_capacity(1);
        let generous = rustix::event::Timespec::try_from(GENEROUS).unwrap();
        while !*stopped.lock().unwrap() {
            while !bell.try_drain() {}
            while mailbox.serve(Duration::ZERO).unwrap() > 0 {}
            if !*stopped.lock().unwrap() {
                let buffer = rustix::buffer::spare_capacity(&mut events);
                let ready = epoll::wait(&poller, buffer, Some(&generous)).unwrap();
                assert_eq!(ready, 1, "a ring was lost");
                events.clear();
            }
        }
    });
    assert_eq!(
        mailbox.vector_statistics(LOOP, DOUBLE).unwrap().handled,
        2 * MESSAGES
    );
}

#[test]
fn a_loop_around_epoll_serves() {
    serve_by_epoll(epoll::EventFlags::IN);
}

#[test]
fn a_loop_around_edge_triggered_epoll_serves() {
    serve_by_epoll(epoll::EventFlags::IN | epoll::EventFlags::ET);
}

/// Waits for the bell once; to be called after a look at the mailbox that found nothing.
async fn rung(bell: &pipe::Receiver) {
    let ready = tokio::time::timeout(GENEROUS, bell.readable()).await;
    ready.expect("a ring was lost").unwrap();
    let _ = bell.try_read(&mut [0; 4096]);
}

/// Asks by tickets, and serves what comes meanwhile.
async fn ask_from_a_loop(system: &LinuxSystem<2>, number: Processor) {
    let (mut mailbox, bell) = mailbox(system, number);
    mailbox.set_vector(DOUBLE, &double, "double").unwrap();
    mailbox.join().unwrap();
    mailbox.ring_always(true).unwrap();
    let bell = pipe::Receiver::from_owned_fd(bell.as_fd().try_clone_to_owned().unwrap()).unwrap();
    let peer = if number == LOOP { OTHER } else { LOOP };
    for data in 0..MESSAGES {
        let mut ticket = loop {
            while mailbox.serve(Duration::ZERO).unwrap() > 0 {}
            match mailbox.begin(peer, DOUBLE, data, Duration::ZERO) {
                Ok(ticket) => break ticket,
                Err(MailboxError::NotConnected { .. }) => rung(&bell).await,
                Err(error) => panic!("{error}"),
            }
        };
        loop {
            while mailbox.serve(Duration::ZERO).unwrap() > 0 {}
            if let Some(reply) = ticket.poll().unwrap() {
                assert_eq!(reply, data * 2);
                break;
            }
            rung(&bell).await;
        }
    }
    // The peer may still ask.
    while mailbox.vector_statistics(number, DOUBLE).unwrap().handled < MESSAGES {
        rung(&bell).await;
        while mailbox.serve(Duration::ZERO).unwrap() > 0 {}
    }
}

#[test]
fn two_tasks_of_one_loop_ask_each_other() {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .unwrap();
    let system = LinuxSystem::<2>::family(64).unwrap();
    let mut tasks = [
        Some(Box::pin(ask_from_a_loop(&system, LOOP))),
        Some(Box::pin(ask_from_a_loop(&system, OTHER))),
    ];
    runtime.block_on(poll_fn(|context| {
        for task in &mut tasks {
            if let Some(running) = task
                && running.as_mut().poll(context).is_ready()
            {
                *task = None;
            }
        }
        if tasks.iter().all(Option::is_none) {
            Poll::Ready(())
        } else {
            Poll::Pending
        }
    }));
}
