//! A log to which several processors append, whoever of them dies wherever.

use condor_mbox::shared_log::{SharedLogEntry, SharedLogError, SharedLogReader};
use condor_mbox::spin_lock::{Incarnations, LockOwner, NativeSwap, SpinLockError};
use condor_mbox::window::CompareExchange;
use condor_mbox::{Instant, Processor, Region, SharedLog, SpinLock};
use proptest::prelude::*;

use crate::memory::{Memory, Mortal};

/// The lock, and behind it a log of four entries.
const LOG: u32 = 64;
const LOG_BYTES: u32 = 64 + 4 * 128;
const WORDS: usize = (LOG + LOG_BYTES) as usize / 4;

/// Everybody lives but these.
struct Except<'a>(&'a [LockOwner]);

impl Incarnations for Except<'_> {
    fn is_current(&self, owner: LockOwner) -> bool {
        !self.0.contains(&owner)
    }
}

const BEGINNING: Instant = Instant::from_ns(0);
const ALL_LIVE: Except<'_> = Except(&[]);

fn owner(number: u8, incarnation: u32) -> LockOwner {
    LockOwner::new(Processor(number), incarnation).unwrap()
}

fn log<W: CompareExchange>(memory: &W) -> SharedLog<&W, NativeSwap<&W>> {
    let entries = Region::whole(memory).part(LOG, LOG_BYTES).unwrap();
    let lock = SpinLock::new(NativeSwap::new(memory, 0).unwrap());
    SharedLog::new(entries, lock).unwrap()
}

fn reader(memory: &Memory) -> SharedLogReader<&Memory> {
    SharedLogReader::new(Region::whole(memory).part(LOG, LOG_BYTES).unwrap()).unwrap()
}

fn all(reader: &mut SharedLogReader<&Memory>) -> Vec<SharedLogEntry> {
    std::iter::from_fn(|| reader.next_entry().unwrap()).collect()
}

#[test]
fn entries_of_all_processors_are_read_in_their_order() {
    let memory = Memory::new(WORDS);
    let (log, mut reader) = (log(&memory), reader(&memory));
    assert_eq!(reader.next_entry(), Ok(None));
    for (number, text) in [(0, "begins"), (5, ""), (0, "ends")] {
        let at = Instant::from_ns(u64::MAX - u64::from(number));
        log.try_append(owner(number, 1), &ALL_LIVE, at, text)
            .unwrap();
    }
    let entries = all(&mut reader);
    let expected = [(0, 0, "begins"), (1, 5, ""), (2, 0, "ends")];
    let read = entries
        .iter()
        .map(|it| (it.number, it.processor().0, it.text()));
    assert!(read.eq(expected), "{entries:?}");
    assert_eq!(entries[1].at(), Instant::from_ns(u64::MAX - 5));
}

#[test]
fn a_long_text_is_cut_before_a_character_that_has_no_room() {
    let memory = Memory::new(WORDS);
    let text = format!("{}äöü", "x".repeat(SharedLog::TEXT_BYTES - 3));
    log(&memory)
        .try_append(owner(1, 1), &ALL_LIVE, BEGINNING, &text)
        .unwrap();
    let entry = reader(&memory).next_entry().unwrap().unwrap();
    assert_eq!(entry.text(), &text[..text.len() - "öü".len()]);
}

#[test]
fn what_is_no_log_is_left_alone() {
    let memory = Memory::filled(WORDS, |word| if word < 16 { 0 } else { 7 });
    let error = SharedLogError::NoLog { found: [7; 2] };
    let appended = log(&memory).try_append(owner(1, 1), &ALL_LIVE, BEGINNING, "");
    assert_eq!(appended, Err(error));
    assert_eq!(reader(&memory).next_entry(), Err(error));
    // The lock is free again.
    let again = log(&memory).try_append(owner(2, 1), &ALL_LIVE, BEGINNING, "");
    assert_eq!(again, Err(error));
    let small = Region::whole(&memory).part(0, 188).unwrap();
    assert!(SharedLogReader::new(small).is_err());
}

#[test]
fn a_living_owner_of_the_lock_keeps_others_out() {
    let memory = Memory::new(WORDS);
    let lock = SpinLock::new(NativeSwap::new(&memory, 0).unwrap());
    let guard = lock.try_lock(owner(3, 1), &ALL_LIVE).unwrap();
    let appended = log(&memory).try_append(owner(1, 1), &ALL_LIVE, BEGINNING, "");
    let held = Some(owner(3, 1));
    assert_eq!(appended, Err(SpinLockError::Busy { owner: held }.into()));
    drop(guard);
    log(&memory)
        .try_append(owner(1, 1), &ALL_LIVE, BEGINNING, "")
        .unwrap();
}

/// A processor dies after any number of accesses: the others lose nothing that they append, and its own entry is there
/// as a whole or not at all.
#[test]
fn an_entry_whose_processor_dies_disturbs_no_other() {
    let (dead, mut accesses) = (owner(1, 1), 0);
    loop {
        let memory = Memory::new(WORDS);
        let mut reader = reader(&memory);
        for text in ["a", "b", "c"] {
            log(&memory)
                .try_append(owner(2, 1), &ALL_LIVE, BEGINNING, text)
                .unwrap();
        }
        let mortal = Mortal::new(&memory, accesses);
        let told = log(&mortal).try_append(dead, &ALL_LIVE, BEGINNING, "its last words");
        for text in ["d", "e"] {
            let appended = log(&memory).try_append(owner(3, 1), &Except(&[dead]), BEGINNING, text);
            assert!(appended.is_ok(), "after {accesses} accesses: {appended:?}");
        }
        let entries = all(&mut reader);
        let texts: Vec<_> = entries.iter().map(SharedLogEntry::text).collect();
        let is_there = texts.contains(&"its last words");
        assert!(is_there || told.is_err(), "after {accesses} accesses");
        let expected = if is_there {
            ["c", "its last words", "d", "e"]
        } else {
            ["b", "c", "d", "e"]
        };
        assert_eq!(texts, expected, "after {accesses} accesses");
        if !mortal.is_dead() {
            assert!(told.is_ok());
            break;
        }
        accesses += 1;
    }
    assert!(accesses > 10, "{accesses}");
}

#[derive(Clone, Debug)]
enum Step {
    Append(u8, String),
    Read(usize),
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        (0..8_u8, "\\PC{0,60}").prop_map(|(processor, text)| Step::Append(processor, text)),
        (0..6_usize).prop_map(Step::Read),
    ]
}

proptest! {
    /// A reader gets the entries in order, and misses those that were overwritten, no others.
    #[test]
    fn a_reader_gets_what_a_list_of_four_keeps(
        steps in prop::collection::vec(step(), 0..60),
        before in 0..20_u32,
    ) {
        let memory = Memory::new(WORDS);
        let (log, mut reader) = (log(&memory), reader(&memory));
        let mut kept = std::collections::VecDeque::new();
        for number in 0..before {
            log.try_append(owner(9, 1), &ALL_LIVE, BEGINNING, "").unwrap();
            kept.push_back((number, 9, String::new()));
        }
        let mut next = before;
        for step in steps {
            match step {
                Step::Append(processor, text) => {
                    let number = log.try_append(owner(processor, 1), &ALL_LIVE, BEGINNING, &text).unwrap();
                    prop_assert_eq!(number, next);
                    let end = (0..=text.len().min(SharedLog::TEXT_BYTES)).rfind(|&it| text.is_char_boundary(it));
                    let end = end.unwrap_or(0);
                    kept.push_back((number, processor, text[..end].to_owned()));
                    next += 1;
                }
                Step::Read(times) => for _ in 0..times {
                    while kept.len() > 4 {
                        kept.pop_front();
                    }
                    let read = reader.next_entry().unwrap();
                    let read = read.map(|it| (it.number, it.processor().0, it.text().to_owned()));
                    prop_assert_eq!(read, kept.pop_front());
                }
            }
        }
    }
}
