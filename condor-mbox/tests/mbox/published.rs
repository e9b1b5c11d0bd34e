//! Readers of a published value get the last complete one, whatever became of the writer.

use std::sync::atomic::{AtomicBool, Ordering};

use condor_mbox::published::PublishedReadError;
use condor_mbox::window::WindowErrorKind;
use condor_mbox::{AccessError, Allocator, MemoryWindow, Published, Region};
use proptest::prelude::*;

use crate::memory::{Memory, Mortal};

/// Large enough for torn values to show, and not a whole number of words.
type Value = [u8; 23];

const CELL: Published<Value> = Published::at(4);
const WORDS: usize = 1 + Published::<Value>::BYTES as usize / 4;

/// Accesses of one publication: two of the sequence, six of the value and one to keep the
/// rest of its last word.
const PUBLICATION: u32 = 9;

#[test]
fn nothing_is_published_at_first() {
    let memory = Memory::new(WORDS);
    let subscriber = CELL.subscriber(&memory).unwrap();
    assert_eq!(subscriber.read(), Err(PublishedReadError::Unpublished));
    // A first publication that was begun is still none.
    for accesses in 2..2 + PUBLICATION {
        let mut publisher = CELL.publisher(Mortal::new(&memory, accesses)).unwrap();
        assert!(publisher.publish(&[1; 23]).is_err());
        assert_eq!(subscriber.read(), Err(PublishedReadError::Unpublished));
    }
}

#[test]
fn the_latest_value_is_read_with_its_sequence() {
    let memory = Memory::new(WORDS);
    let mut publisher = CELL.publisher(&memory).unwrap();
    let subscriber = CELL.subscriber(&memory).unwrap();
    for count in 1..=10_u8 {
        assert_eq!(publisher.publish(&[count; 23]), Ok(u32::from(count)));
        for _ in 0..2 {
            let latest = subscriber.read().unwrap();
            assert_eq!(latest.value, [count; 23]);
            assert_eq!(latest.sequence, u32::from(count));
        }
    }
}

#[test]
fn a_writer_that_stops_anywhere_leaves_the_last_complete_value() {
    // Opening takes two loads; every stop within the first three publications.
    for accesses in 2..=2 + 3 * PUBLICATION {
        let memory = Memory::new(WORDS);
        CELL.publisher(&memory)
            .unwrap()
            .publish(&[100; 23])
            .unwrap();
        let mut complete = 100;
        let mut dying = CELL.publisher(Mortal::new(&memory, accesses)).unwrap();
        for value in 101..=103 {
            if dying.publish(&[value; 23]).is_ok() {
                complete = value;
            }
        }
        assert_eq!(
            u32::from(complete) - 100,
            (accesses - 2) / PUBLICATION,
            "stopped after {accesses} accesses"
        );
        let subscriber = CELL.subscriber(&memory).unwrap().with_attempts(1);
        let last = subscriber.read().unwrap();
        assert_eq!(
            last.value, [complete; 23],
            "stopped after {accesses} accesses"
        );

        // The next writer continues: a new value has a new sequence.
        let mut next = CELL.publisher(&memory).unwrap();
        next.publish(&[200; 23]).unwrap();
        let newer = subscriber.read().unwrap();
        assert_eq!(newer.value, [200; 23]);
        assert_eq!(newer.sequence, last.sequence + 1);
    }
}

#[test]
fn a_writer_that_failed_can_publish_again() {
    let memory = Memory::new(WORDS);
    for accesses in 2..2 + PUBLICATION {
        let dying = Mortal::new(&memory, accesses);
        let mut publisher = CELL.publisher(&dying).unwrap();
        publisher.publish(&[1; 23]).unwrap_err();
    }
    assert_eq!(CELL.publisher(&memory).unwrap().publish(&[2; 23]), Ok(1));
}

#[test]
fn a_cell_outside_its_window_is_refused() {
    let memory = Memory::new(WORDS);
    for (offset, kind) in [
        (8, WindowErrorKind::OutOfBounds),
        (u32::MAX - 3, WindowErrorKind::OutOfBounds),
        (2, WindowErrorKind::Misaligned),
    ] {
        let expected = AccessError {
            offset,
            len: Published::<Value>::BYTES as usize,
            size: u32::try_from(WORDS * 4).unwrap(),
            kind,
        };
        let cell = Published::<Value>::at(offset);
        assert_eq!(cell.publisher(&memory).unwrap_err(), expected);
        assert_eq!(cell.subscriber(&memory).unwrap_err(), expected);
    }
}

#[test]
fn cells_lie_side_by_side() {
    let memory = Memory::new(256);
    let ram = Region::users(&memory).unwrap();
    let mut allocator = Allocator::new(ram.size());
    let first: Published<u64> = allocator.published().unwrap();
    let second: Published<[u32; 40]> = allocator.published().unwrap();
    let mut one = first.publisher(&ram).unwrap();
    let mut two = second.publisher(&ram).unwrap();
    for round in 0..4 {
        one.publish(&round).unwrap();
        two.publish(&[u32::MAX; 40]).unwrap();
        assert_eq!(first.subscriber(&ram).unwrap().read().unwrap().value, round);
    }
    assert_eq!(
        second.subscriber(&ram).unwrap().read().unwrap().value,
        [u32::MAX; 40]
    );
}

#[test]
fn threads_that_poll_never_see_a_mixture() {
    const LAST: u32 = 20_000;
    let memory = Memory::new(Published::<[u32; 9]>::BYTES as usize / 4);
    let cell = Published::<[u32; 9]>::at(0);
    let stop = AtomicBool::new(false);
    std::thread::scope(|threads| {
        for _ in 0..2 {
            threads.spawn(|| {
                let subscriber = cell.subscriber(&memory).unwrap();
                let mut last = 0;
                while last < LAST && !stop.load(Ordering::Relaxed) {
                    match subscriber.read() {
                        Ok(latest) => {
                            assert_eq!(latest.value, [latest.sequence; 9]);
                            assert!(latest.sequence >= last, "time runs forwards");
                            last = latest.sequence;
                        }
                        Err(PublishedReadError::Unpublished) => assert_eq!(last, 0),
                        Err(PublishedReadError::Contended { attempts }) => assert_eq!(attempts, 4),
                        Err(other) => panic!("{other}"),
                    }
                }
            });
        }
        let mut publisher = cell.publisher(&memory).unwrap();
        for count in 1..=LAST {
            if publisher.publish(&[count; 9]) != Ok(count) {
                stop.store(true, Ordering::Relaxed);
                panic!("publication {count}");
            }
        }
    });
}

proptest! {
    /// Whatever the memory holds, nothing panics, and two publications mend the cell.
    #[test]
    fn garbage_is_survived_and_mended(
        words in prop::collection::vec(
            prop_oneof![any::<u32>(), 0_u32..8, (u32::MAX - 8)..=u32::MAX],
            WORDS,
        ),
    ) {
        let memory = Memory::filled(WORDS, |at| words[at]);
        let subscriber = CELL.subscriber(&memory).unwrap().with_attempts(1);
        let before = subscriber.read();
        let mut publisher = CELL.publisher(&memory).unwrap();
        for value in [1, 2] {
            let sequence = publisher.publish(&[value; 23]).unwrap();
            let latest = subscriber.read().unwrap();
            prop_assert_eq!(latest.value, [value; 23]);
            prop_assert_eq!(latest.sequence, sequence);
            if let Ok(before) = &before {
                prop_assert_ne!(before.sequence, sequence);
            }
        }
    }
}
