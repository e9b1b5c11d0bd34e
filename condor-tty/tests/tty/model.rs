//! A terminal and its hosts, which read, stop and are killed, against a list of what was written.
#![cfg(feature = "hostile")]

use std::cell::RefCell;
use std::rc::Rc;
use std::time::Duration;

use crate::support::{Board, HOST, Mortal};
use condor_mbox::sim::SimWindow;
use condor_mbox::{Allocator, LoadOrder, MemoryWindow, Messenger, Region, SingleContext};
use condor_tty::{Policy, Terminal, TerminalReader, TerminalSettings, layout};
use embedded_io::{Write, WriteReady};
use proptest::prelude::*;

const OFFSET: u32 = 64;
const CAPACITY: u32 = 32;

type Board1<'h> = Board<'h>;
type Hand = Terminal<SimWindow, SingleContext, 8>;

fn hand(memory: &SimWindow, policy: Policy) -> Hand {
    let region = Region::whole(memory.clone());
    let mut allocator = Allocator::new(region.size());
    allocator.bytes(OFFSET as usize).unwrap();
    let terminal = Terminal::new(region, &mut allocator, CAPACITY, SingleContext::new()).unwrap();
    assert_eq!(terminal.offset(), OFFSET);
    terminal.configure(&TerminalSettings::RAW).unwrap();
    terminal.set_policy(policy).unwrap();
    terminal
}

/// A host that may be killed at any access, and what a person has seen of its output.
struct Watcher {
    memory: SimWindow,
    window: Mortal,
    reader: Option<TerminalReader<Mortal>>,
    /// The last fetch, and how much before it had been overwritten.
    fetched: Vec<u8>,
    skipped: u32,
    /// Where the last acknowledged byte was in all that was written, and what was missing.
    position: u32,
    overwritten: u32,
    kills: u32,
}

impl Watcher {
    fn new(memory: &SimWindow) -> Self {
        Self {
            memory: memory.clone(),
            window: Mortal::new(memory),
            reader: None,
            fetched: Vec::new(),
            skipped: 0,
            position: 0,
            overwritten: 0,
            kills: 0,
        }
    }

    fn lives_for(&mut self, accesses: u32) {
        self.window.lives_for(accesses);
    }

    /// Attaches if there is no host, reads at most `most` bytes, and acknowledges all but `keep`.
    fn run(&mut self, most: usize, keep: usize, written: &[u8]) {
        if self.step(most, keep, written).is_none() {
            self.reader = None;
            self.window = Mortal::new(&self.memory);
            self.kills += 1;
            // It was killed before the store of the tail or after it.
            let at = OFFSET + layout::host::TAIL;
            let tail = self.memory.load(at, LoadOrder::Relaxed).unwrap();
            if tail != self.position {
                self.position = tail;
                self.overwritten += self.skipped;
            }
        }
    }

    fn step(&mut self, most: usize, keep: usize, written: &[u8]) -> Option<()> {
        // What is left to acknowledge of a former step is forgotten, as by a host that is killed.
        self.skipped = 0;
        if self.reader.is_none() {
            let region = Region::whole(self.window.clone());
            self.reader = Some(self.alive(TerminalReader::attach(region, OFFSET, HOST))?);
        }
        let mut reader = self.reader.take()?;
        let status = self.alive(reader.status())?;
        let gone = (written.len() as u32 - self.position).saturating_sub(CAPACITY);
        assert_eq!(status.overwritten, self.overwritten + gone);
        let mut bytes = vec![0; most];
        let fetched = self.alive(reader.fetch(&mut bytes))?;
        assert_eq!(fetched.skipped, gone);
        let begin = (self.position + fetched.skipped) as usize;
        self.fetched = bytes[..fetched.len].to_vec();
        assert_eq!(self.fetched, written[begin..begin + fetched.len]);
        self.skipped = fetched.skipped;
        let count = fetched.len.saturating_sub(keep);
        self.alive(reader.acknowledge(count))?;
        self.position += fetched.skipped + count as u32;
        self.overwritten += fetched.skipped;
        self.skipped = 0;
        self.reader = Some(reader);
        Some(())
    }

    /// Its result, unless it has been killed.
    fn alive<T, E: std::fmt::Debug>(&self, outcome: Result<T, E>) -> Option<T> {
        match outcome {
            Ok(value) => Some(value),
            Err(_) if self.window.is_dead() => None,
            Err(error) => panic!("{error:?}"),
        }
    }
}

#[derive(Clone, Debug)]
enum Step {
    Post(usize),
    Write(usize),
    Run { most: usize, keep: usize },
    KillAfter(u32),
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        3 => (0_usize..80).prop_map(Step::Post),
        2 => (1_usize..80).prop_map(Step::Write),
        3 => (0_usize..50, 0_usize..10).prop_map(|(most, keep)| Step::Run { most, keep }),
        2 => (0_u32..40).prop_map(Step::KillAfter),
    ]
}

fn policy() -> impl Strategy<Value = Policy> {
    let timeout = Duration::from_millis(25);
    prop_oneof![
        Just(Policy::Block { timeout }),
        Just(Policy::DropNew),
        Just(Policy::DropOld),
    ]
}

proptest! {
    #[test]
    fn every_byte_is_delivered_or_counted(policy in policy(), steps in prop::collection::vec(step(), 1..60)) {
        let memory = SimWindow::new(512);
        let terminal = hand(&memory, policy);
        let mut host = Watcher::new(&memory);
        let board = Board1::new();
        let mut written = Vec::new();
        let (mut given, mut next) = (0, 0_u8);
        for step in steps {
            let mut bytes = |len: usize| -> Vec<u8> {
                (0..len).map(|_| { next = next.wrapping_add(1); next }).collect()
            };
            match step {
                Step::Post(len) => {
                    let bytes = bytes(len);
                    let count = terminal.poster(&board).post(&bytes).unwrap();
                    written.extend(&bytes[..count]);
                    given += len as u32;
                }
                Step::Write(len) => {
                    let bytes = bytes(len);
                    let before = terminal.lost();
                    // The host does nothing meanwhile: what is lost is the end.
                    let _ = terminal.console(&board).write_all(&bytes);
                    let lost = (terminal.lost() - before) as usize;
                    written.extend(&bytes[..len - lost]);
                    given += len as u32;
                }
                Step::Run { most, keep } => host.run(most, keep, &written),
                Step::KillAfter(accesses) => host.lives_for(accesses),
            }
            prop_assert_eq!(terminal.lost(), given - written.len() as u32);
        }
        host.lives_for(u32::MAX);
        while (host.position as usize) < written.len() {
            host.run(64, 0, &written);
        }
        if policy == Policy::DropOld {
            prop_assert_eq!(terminal.lost(), 0);
        } else {
            prop_assert_eq!(host.overwritten, 0);
        }
        prop_assert_eq!(terminal.ignored(), 0);
        prop_assert_eq!(terminal.unread().unwrap(), 0);
    }
}

/// Thousands of bytes to a host that is killed a thousand times, most of them in mid-work.
#[test]
fn blocking_loses_nothing_to_a_thousand_kills() {
    let timeout = Duration::from_secs(1);
    let (kills, _, overwritten) = killed_a_thousand_times(Policy::Block { timeout }, |lost| {
        assert_eq!(lost, 0);
    });
    assert_eq!((kills, overwritten), (1000, 0));
}

#[test]
fn dropping_counts_exactly_through_a_thousand_kills() {
    let (kills, overwritten_or_lost, _) = killed_a_thousand_times(Policy::DropOld, |lost| {
        assert_eq!(lost, 0);
    });
    assert_eq!(kills, 1000);
    assert!(overwritten_or_lost > 0);
    let (kills, lost, overwritten) = killed_a_thousand_times(Policy::DropNew, |_| ());
    assert_eq!((kills, overwritten), (1000, 0));
    assert!(lost > 0);
}

/// Gives the kills, the bytes that were not delivered, and those that were overwritten.
fn killed_a_thousand_times(policy: Policy, check: impl Fn(u32)) -> (u32, u32, u32) {
    let memory = SimWindow::new(512);
    let terminal = hand(&memory, policy);
    let host = Rc::new(RefCell::new(Watcher::new(&memory)));
    let written = Rc::new(RefCell::new(Vec::new()));
    // A small generator of the lengths of incarnations: x ← 5 x + 3 modulo 2^16 has all its period.
    let mut random = 1_u16;
    let (watcher, text) = (Rc::clone(&host), Rc::clone(&written));
    let live = move || {
        random = random.wrapping_mul(5).wrapping_add(3);
        let mut watcher = watcher.borrow_mut();
        if watcher.kills < 1000 {
            watcher.lives_for(u32::from(random >> 8) % 50);
        }
        watcher.run(
            usize::from(random % 40),
            usize::from(random % 3),
            &text.borrow(),
        );
    };
    // The first one lives until it has attached: before, nobody is waited for.
    host.borrow_mut().run(0, 0, &[]);
    let board = Board1::with(live);
    let (mut given, mut next) = (0_u32, 0_u8);
    while host.borrow().kills < 1000 {
        let len = 1 + usize::from(next) % 7;
        let bytes: Vec<u8> = (0..len as u8)
            .map(|index| next.wrapping_add(index))
            .collect();
        next = next.wrapping_add(len as u8);
        given += len as u32;
        // As it is written piece by piece: the host looks at what there is so far.
        for byte in bytes {
            let before = terminal.lost();
            written.borrow_mut().push(byte);
            // Not in the list while the host runs in the wait for room.
            if matches!(policy, Policy::Block { .. }) && terminal.unread().unwrap() == CAPACITY {
                written.borrow_mut().pop();
                let mut console = terminal.console(&board);
                while !console.write_ready().unwrap() {
                    board.serve(Duration::from_millis(1)).unwrap();
                }
                written.borrow_mut().push(byte);
            }
            assert_eq!(terminal.console(&board).write(&[byte]).unwrap(), 1);
            if terminal.lost() != before {
                written.borrow_mut().pop();
            }
        }
        if !matches!(policy, Policy::Block { .. }) && given % 3 == 0 {
            board.serve(Duration::from_millis(1)).unwrap();
        }
    }
    check(terminal.lost());
    let mut host = host.borrow_mut();
    host.lives_for(u32::MAX);
    let written = written.borrow();
    while (host.position as usize) < written.len() {
        host.run(64, 0, &written);
    }
    assert_eq!(written.len() as u32 + terminal.lost(), given);
    (
        host.kills,
        terminal.lost() + host.overwritten,
        host.overwritten,
    )
}

#[test]
fn nobody_waits_before_a_host_has_attached_nor_after_it_has_left() {
    let memory = SimWindow::new(512);
    let timeout = Duration::from_millis(25);
    let terminal = hand(&memory, Policy::Block { timeout });
    let board = Board1::new();
    let mut console = terminal.console(&board);
    console.write_all(&[0; 40]).unwrap();
    assert_eq!(
        (terminal.lost(), board.pauses.get(), board.rings.get()),
        (8, 0, 0)
    );

    let reader = TerminalReader::attach(Region::whole(memory), OFFSET, HOST).unwrap();
    let refused = console.write_all(&[0; 5]);
    assert!(
        matches!(refused, Err(condor_tty::ConsoleError::TimedOut { lost: 5 })),
        "{refused:?}"
    );
    assert_eq!((terminal.lost(), board.now_ns()), (13, 25_000_000));
    // `write` gives the bytes back.
    assert!(console.write(&[0; 5]).is_err());
    assert_eq!((terminal.lost(), board.now_ns()), (13, 50_000_000));

    reader.detach().unwrap();
    console.write_all(&[0; 5]).unwrap();
    console.flush().unwrap();
    assert_eq!((terminal.lost(), board.now_ns()), (18, 50_000_000));
}

/// A loop that posts every 2.5 ms to a terminal that is full, whose host is dead.
#[test]
fn a_servo_loop_is_never_held_up() {
    let timeout = Duration::from_secs(1);
    for policy in [Policy::Block { timeout }, Policy::DropNew, Policy::DropOld] {
        let memory = SimWindow::new(512);
        let terminal = hand(&memory, policy);
        let reader = TerminalReader::attach(Region::whole(memory), OFFSET, HOST).unwrap();
        drop(reader);
        let board = Board1::new();
        let poster = terminal.poster(&board);
        let mut written = 0;
        for tick in 0..4000_u32 {
            written += poster.post(&tick.to_le_bytes()).unwrap();
        }
        assert_eq!((board.pauses.get(), board.now_ns()), (0, 0), "{policy:?}");
        assert_eq!(written as u32 + terminal.lost(), 16_000);
        assert_eq!(
            terminal.lost(),
            if policy == Policy::DropOld {
                0
            } else {
                16_000 - CAPACITY
            }
        );
    }
}

#[test]
fn a_new_incarnation_of_the_terminal_is_noticed_and_counted_from_its_beginning() {
    let memory = SimWindow::new(512);
    let board = Board1::new();
    let before = hand(&memory, Policy::DropOld);
    let mut reader = TerminalReader::attach(Region::whole(memory.clone()), OFFSET, HOST).unwrap();
    let former = reader.incarnation();
    before.poster(&board).post(&[1; 50]).unwrap();
    let after = hand(&memory, Policy::DropNew);
    let noticed = reader.fetch(&mut [0; 8]);
    assert!(
        matches!(
            noticed,
            Err(condor_tty::TerminalReaderError::Restarted { incarnation, .. }) if incarnation == former + 1
        ),
        "{noticed:?}"
    );
    assert!(reader.acknowledge(1).is_err());
    assert_eq!(after.attached().unwrap(), None);
    after.poster(&board).post(&[2; 3]).unwrap();
    let mut reader = TerminalReader::attach(Region::whole(memory.clone()), OFFSET, HOST).unwrap();
    let mut bytes = [0; 8];
    assert_eq!(reader.fetch(&mut bytes).unwrap().len, 3);
    assert_eq!(
        (bytes[..3].to_vec(), reader.status().unwrap().overwritten),
        (vec![2; 3], 0)
    );
    // Nor is an incarnation at another place one that there was here.
    let mut allocator = Allocator::new(512);
    let own = Region::whole(memory.clone());
    let other = Terminal::<_, _, 8>::new(own, &mut allocator, 16, SingleContext::new()).unwrap();
    assert_ne!(other.offset(), OFFSET);
    let incarnation = TerminalReader::attach(Region::whole(memory), other.offset(), HOST)
        .unwrap()
        .incarnation();
    assert!(
        ![former, former + 1].contains(&incarnation),
        "{incarnation}"
    );
}

#[test]
fn who_attaches_last_reads_on() {
    let memory = SimWindow::new(512);
    let board = Board1::new();
    let terminal = hand(&memory, Policy::DropNew);
    terminal.poster(&board).post(b"one two").unwrap();
    let region = Region::whole(memory);
    let mut first = TerminalReader::attach(region.clone(), OFFSET, HOST).unwrap();
    let mut bytes = [0; 4];
    first.fetch(&mut bytes).unwrap();
    first.acknowledge(4).unwrap();
    first.fetch(&mut bytes).unwrap();
    let mut second = TerminalReader::attach(region, OFFSET, HOST).unwrap();
    assert!(first.acknowledge(3).is_err());
    assert_eq!(second.fetch(&mut bytes).unwrap().len, 3);
    assert_eq!(&bytes[..3], b"two");
}
