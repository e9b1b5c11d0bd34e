//! Every shared word may become anything at any moment: no panic, no end that does not come,
//! nothing written outside of the terminal.
#![cfg(feature = "hostile")]

use std::time::Duration;

use condor_mbox::sim::SimWindow;
use condor_mbox::{Allocator, LoadOrder, MemoryWindow, Region, SingleContext, StoreOrder};
use condor_tty::hostile::support::{Board, HOST};
use condor_tty::{Policy, Terminal, TerminalReader};
use embedded_io::{Read, Write};
use proptest::prelude::*;

const OFFSET: u32 = 64;
const CAPACITY: u32 = 32;
const END: u32 = OFFSET + 128 + CAPACITY;
const CANARY: u32 = 0xdead_beef;

#[derive(Clone, Debug)]
enum Step {
    Rewrite(u32, u32),
    Post(usize),
    Write(usize),
    Type(u8),
    Read(usize),
    Attach,
    Fetch(usize, usize),
    Policy(u8),
}

/// Numbers that are near to something.
fn word() -> impl Strategy<Value = u32> {
    prop_oneof![
        any::<u32>(),
        0..80_u32,
        (0..80_u32).prop_map(u32::wrapping_neg),
        (0..80_u32).prop_map(|near| 0x8000_0000_u32.wrapping_sub(near)),
        (0..32_u32).prop_map(|bit| 1 << bit),
    ]
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        4 => (0_u32..40, word()).prop_map(|(at, value)| Step::Rewrite(OFFSET + 4 * at, value)),
        2 => (0_usize..80).prop_map(Step::Post),
        2 => (0_usize..80).prop_map(Step::Write),
        2 => any::<u8>().prop_map(Step::Type),
        1 => (0_usize..20).prop_map(Step::Read),
        1 => Just(Step::Attach),
        3 => (0_usize..80, 0_usize..100).prop_map(|(most, count)| Step::Fetch(most, count)),
        1 => (0_u8..3).prop_map(Step::Policy),
    ]
}

proptest! {
    #[test]
    fn nothing_that_is_written_there_does_harm(steps in prop::collection::vec(step(), 1..80)) {
        let memory = SimWindow::new(END + 64);
        for at in (0..OFFSET).chain(END..END + 64).step_by(4).filter(|at| at % 4 == 0) {
            memory.store(at, CANARY, StoreOrder::Relaxed).unwrap();
        }
        let region = Region::whole(memory.clone());
        let mut allocator = Allocator::new(region.size());
        allocator.bytes(OFFSET as usize).unwrap();
        let context = SingleContext::new();
        let terminal = Terminal::<_, _, 16>::new(region.clone(), &mut allocator, CAPACITY, context).unwrap();
        let board = Board::new();
        let mut reader = None;
        for step in steps {
            match step {
                Step::Rewrite(at, value) => memory.store(at, value, StoreOrder::Relaxed).unwrap(),
                Step::Post(len) => {
                    prop_assert!(terminal.poster(&board).post(&vec![b'a'; len]).unwrap() <= len);
                }
                Step::Write(len) => {
                    let begun = board.now_ns();
                    let _ = terminal.console(&board).write_all(&vec![b'\n'; len]);
                    prop_assert!(board.now_ns() - begun <= 25_000_000);
                }
                Step::Type(character) => drop(terminal.accept(character).unwrap()),
                Step::Read(len) => drop(terminal.console(&board).read(&mut vec![0; len])),
                Step::Attach => reader = TerminalReader::attach(region.clone(), OFFSET, HOST).ok(),
                Step::Fetch(most, count) => {
                    if let Some(reader) = &mut reader {
                        let mut bytes = vec![0; most];
                        if let Ok(fetched) = reader.fetch(&mut bytes) {
                            prop_assert!(fetched.len <= most);
                        }
                        let _ = reader.acknowledge(count);
                        let _ = reader.status();
                    }
                }
                Step::Policy(kind) => {
                    let timeout = Duration::from_millis(25);
                    let policies = [Policy::Block { timeout }, Policy::DropNew, Policy::DropOld];
                    terminal.set_policy(policies[usize::from(kind)]).unwrap();
                }
            }
            prop_assert!(terminal.unread().unwrap() <= CAPACITY);
        }
        for at in (0..OFFSET).chain(END..END + 64).filter(|at| at % 4 == 0) {
            prop_assert_eq!(memory.load(at, LoadOrder::Relaxed).unwrap(), CANARY);
        }
    }
}

proptest! {
    // The scenarios of the fuzz targets, in which words change between any two accesses.
    #[test]
    fn terminals_bear_any_host(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        condor_tty::hostile::processor(&bytes);
    }

    #[test]
    fn readers_bear_any_processor(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        condor_tty::hostile::reader(&bytes);
    }
}

#[test]
fn a_tail_that_cannot_be_is_ignored_and_counted() {
    let memory = SimWindow::new(512);
    let region = Region::whole(memory.clone());
    let terminal = Terminal::<_, _, 16>::new(
        region.clone(),
        &mut Allocator::new(region.size()),
        32,
        SingleContext::new(),
    )
    .unwrap();
    let board = Board::new();
    let _reader = TerminalReader::attach(region, 0, HOST).unwrap();
    terminal.poster(&board).post(&[b'a'; 40]).unwrap();
    for (tail, ignored, unread) in [
        (33, 1, 32),
        (33, 1, 32),
        (8, 1, 24),
        (7, 2, 24),
        (u32::MAX, 3, 24),
        (32, 3, 0),
    ] {
        memory.store(64, tail, StoreOrder::Release).unwrap();
        assert_eq!(terminal.unread().unwrap(), unread, "{tail}");
        assert_eq!(terminal.ignored(), ignored, "{tail}");
    }
}

/// A host that attaches whenever it is looked at, and leaves before the next look.
#[test]
fn a_host_that_comes_and_goes_does_not_hold_a_writer() {
    let memory = SimWindow::new(512);
    let region = Region::whole(memory.clone());
    let terminal = Terminal::<_, _, 16>::new(
        region.clone(),
        &mut Allocator::new(region.size()),
        32,
        SingleContext::new(),
    )
    .unwrap();
    let timeout = Duration::from_millis(25);
    terminal.set_policy(Policy::Block { timeout }).unwrap();
    drop(TerminalReader::attach(region, 0, HOST).unwrap());
    let mut here = true;
    let board = Board::with(move || {
        here = !here;
        memory.store(68, here.into(), StoreOrder::Relaxed).unwrap();
    });
    let _ = terminal.console(&board).write_all(&[b'a'; 40]);
    assert_eq!(terminal.lost(), 8);
    assert!(board.now_ns() <= 25_000_000);
}
