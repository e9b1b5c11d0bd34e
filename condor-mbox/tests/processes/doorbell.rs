//! Rings that are slept for, and rings that are polled for.
#![cfg(feature = "linux")]

use std::thread;
use std::time::Duration;

use crate::linux_child::{Actor, part, say, wait_for_parent};
use condor_mbox::layout::BELL_BYTES;
use condor_mbox::linux::{Claim, LinuxDoorbell, LinuxSystem, PollableBell};
use condor_mbox::{Clock, Doorbell, Instant, LoadOrder, MemoryWindow, Processor, StoreOrder};
use rustix::event::{Timespec, epoll};
use tempfile::TempDir;

const FIRST: Processor = Processor(0);
const SECOND: Processor = Processor(1);
/// Never reached unless something is lost.
const GENEROUS: Duration = Duration::from_secs(100);

fn places() -> Vec<(Option<TempDir>, LinuxSystem<2>)> {
    let directory = tempfile::tempdir().expect("a temporary directory");
    let named = LinuxSystem::at(directory.path().join("system"), 64).expect("it is created");
    vec![
        (Some(directory), named),
        (None, LinuxSystem::family(64).expect("it is created")),
    ]
}

fn word(claim: &Claim<2>, owner: usize) -> u32 {
    let data = &claim.windows()[owner].data;
    data.load(BELL_BYTES, LoadOrder::Acquire)
        .expect("it is inside")
}

/// Sleeps until `owner`'s word is `value`, as a mailbox would for a message.
fn wait_for(claim: &Claim<2>, owner: usize, value: u32) {
    let bell = claim.doorbell();
    let until = bell.now().after(GENEROUS);
    loop {
        let seen = bell.prepare();
        if word(claim, owner) == value {
            return;
        }
        assert!(bell.now() < until, "the ring for {value} was lost");
        bell.wait(seen, until, None);
    }
}

fn put(claim: &Claim<2>, owner: usize, value: u32) {
    let data = &claim.windows()[owner].data;
    data.store(BELL_BYTES, value, StoreOrder::Release)
        .expect("it is inside");
    claim.doorbell().ring(Processor(owner as u8));
}

#[test]
fn no_ring_is_lost_between_two_threads() {
    const ROUNDS: u32 = 100_000;
    for (_kept, system) in places() {
        let first = system.claim(FIRST).expect("it is free");
        let second = system.claim(SECOND).expect("it is free");
        thread::scope(|scope| {
            scope.spawn(|| {
                for round in 1..=ROUNDS {
                    wait_for(&second, 1, round);
                    put(&second, 0, round);
                }
            });
            for round in 1..=ROUNDS {
                put(&first, 1, round);
                wait_for(&first, 0, round);
            }
        });
    }
}

#[test]
fn all_sleepers_of_a_number_are_woken() {
    let system = LinuxSystem::<2>::family(64).expect("it is created");
    let first = system.claim(FIRST).expect("it is free");
    let second = system.claim(SECOND).expect("it is free");
    for round in 1..200 {
        thread::scope(|scope| {
            for _ in 0..3 {
                scope.spawn(|| wait_for(&second, 1, round));
            }
            put(&first, 1, round);
        });
    }
}

#[test]
fn a_ring_after_prepare_ends_the_wait() {
    let system = LinuxSystem::<2>::family(64).expect("it is created");
    let first = system.claim(FIRST).expect("it is free");
    let bell = first.doorbell();
    let seen = bell.prepare();
    bell.ring(FIRST);
    bell.wait(seen, Instant::FOREVER, None);
    assert_ne!(bell.prepare(), seen);
}

#[test]
fn a_wait_ends_at_its_deadline() {
    let system = LinuxSystem::<2>::family(64).expect("it is created");
    let first = system.claim(FIRST).expect("it is free");
    let bell = first.doorbell();
    let until = bell.now().after(Duration::from_millis(2));
    while bell.now() < until {
        bell.wait(bell.prepare(), until, None);
    }
    bell.wait(bell.prepare(), Instant::from_ns(0), None);
    bell.ring(Processor(2));
    bell.ring(Processor(255));
}

/// An edge-triggered poller, as asynchronous runtimes have.
struct Poller {
    epoll: std::os::fd::OwnedFd,
    bell: PollableBell,
}

impl Poller {
    fn new(bell: PollableBell) -> Self {
        let epoll = epoll::create(epoll::CreateFlags::CLOEXEC).expect("an epoll");
        let (data, flags) = (epoll::EventData::new_u64(0), epoll::EventFlags::IN);
        epoll::add(&epoll, &bell, data, flags | epoll::EventFlags::ET).expect("it can be polled");
        Self { epoll, bell }
    }

    fn is_ready(&self, within: Duration) -> bool {
        let mut events = Vec::with_capacity(4);
        let within = Timespec::try_from(within).expect("it is short");
        let buffer = rustix::buffer::spare_capacity(&mut events);
        epoll::wait(&self.epoll, buffer, Some(&within)).expect("it is an epoll") > 0
    }

    fn is_quiet(&self) -> bool {
        !self.is_ready(Duration::ZERO)
    }
}

#[test]
fn rings_make_the_descriptor_readable() {
    for (_kept, system) in places() {
        let first = system.claim(FIRST).expect("it is free");
        let second = system.claim(SECOND).expect("it is free");
        first.doorbell().ring(SECOND);
        let poller = Poller::new(second.doorbell().pollable());
        assert!(poller.is_quiet(), "nobody asked before");
        for _ in 0..3 {
            first.doorbell().ring(SECOND);
            assert!(poller.is_ready(GENEROUS));
            assert!(poller.bell.try_drain());
            assert!(poller.is_quiet());
        }
        assert!(poller.bell.try_drain(), "draining nothing does not block");
    }
}

#[test]
fn a_full_pipe_neither_blocks_nor_hides_rings() {
    for (_kept, system) in places() {
        let first = system.claim(FIRST).expect("it is free");
        let second = system.claim(SECOND).expect("it is free");
        let poller = Poller::new(second.doorbell().pollable());
        for _ in 0..20_000 {
            first.doorbell().ring(SECOND);
        }
        assert!(poller.is_ready(GENEROUS));
        assert!(poller.bell.try_drain());
        assert!(poller.is_quiet());
        first.doorbell().ring(SECOND);
        assert!(poller.is_ready(GENEROUS));
    }
}

#[test]
fn another_process_rings() {
    for (_kept, system) in places() {
        let first = system.claim(FIRST).expect("it is free");
        let poller = Poller::new(first.doorbell().pollable());
        let mut child = Actor::start("doorbell::the_parts", "ringer", |command| {
            system.pass_to(command);
        });
        assert_eq!(child.hear().as_deref(), Some("ready"));
        assert!(poller.is_quiet());
        child.release();
        wait_for(&first, 0, 77);
        assert!(poller.is_ready(GENEROUS));
    }
}

#[test]
fn what_a_killed_poller_left_is_undone() {
    for (_kept, system) in places() {
        let first = system.claim(FIRST).expect("it is free");
        let armed = || {
            first.windows()[1]
                .data
                .load(4, LoadOrder::Acquire)
                .expect("it is inside")
        };
        let mut child = Actor::start("doorbell::the_parts", "poller", |command| {
            system.pass_to(command);
        });
        assert_eq!(child.hear().as_deref(), Some("polling"));
        assert_eq!(armed(), 1);
        first.doorbell().ring(SECOND);
        child.kill();
        first.doorbell().ring(SECOND);
        let second = system.claim(SECOND).expect("it is free");
        assert_eq!(armed(), 0);
        let poller = Poller::new(second.doorbell().pollable());
        assert!(poller.is_quiet(), "the rings were for somebody else");
    }
}

#[test]
fn scribbles_and_truncation_hurt_nobody() {
    let directory = tempfile::tempdir().expect("a temporary directory");
    let path = directory.path().join("system");
    let system = LinuxSystem::<2>::at(&path, 64).expect("it is created");
    let first = system.claim(FIRST).expect("it is free");
    let second = system.claim(SECOND).expect("it is free");
    let bell: LinuxDoorbell<2> = second.doorbell().clone();
    for offset in (0..BELL_BYTES).step_by(4) {
        let data = &first.windows()[1].data;
        data.store(offset, u32::MAX, StoreOrder::Relaxed)
            .expect("it is inside");
    }
    first.doorbell().ring(SECOND);
    bell.wait(u32::MAX, bell.now().after(GENEROUS), None);
    let file = std::fs::File::options()
        .write(true)
        .open(path.join("1.data"))
        .expect("it is there");
    file.set_len(0).expect("a participant may truncate it");
    first.doorbell().ring(SECOND);
    let until = bell.now().after(Duration::from_millis(2));
    while bell.now() < until {
        bell.wait(bell.prepare(), until, None);
    }
    let _ = bell.pollable();
    assert!(
        second.windows()[1]
            .data
            .load(0, LoadOrder::Relaxed)
            .is_err()
    );
}

/// What the children do; nothing in the parent.
#[test]
fn the_parts() {
    let claimed = || {
        let system = LinuxSystem::<2>::inherited().expect("it was passed");
        system.claim(SECOND).expect("it is free")
    };
    match part().as_deref() {
        Some("ringer") => {
            let claim = claimed();
            say("ready");
            wait_for_parent();
            put(&claim, 0, 77);
        }
        Some("poller") => {
            let claim = claimed();
            let _bell = claim.doorbell().pollable();
            say("polling");
            wait_for_parent();
        }
        Some(other) => panic!("nobody plays {other}"),
        None => {}
    }
}
