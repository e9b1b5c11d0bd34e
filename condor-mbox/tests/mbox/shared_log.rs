//! A log to which several processors append, whoever of them dies wherever.

use std::sync::atomic::{AtomicU32, Ordering};

use condor_mbox::shared_log::{SharedLogEntry, SharedLogError, SharedLogReader};
use condor_mbox::spin_lock::{Incarnations, LockOwner, NativeSwap, SpinLockError};
use condor_mbox::window::CompareExchange;
use condor_mbox::{
    Clock, Instant, LoadOrder, MemoryWindow as _, Processor, Region, SharedLog, SpinLock,
    StoreOrder,
};
use proptest::prelude::*;

use crate::memory::{Memory, Mortal};

/// A log of four entries, and behind it the lock.
const LOG_BYTES: u32 = 64 + 4 * 128;
const WORDS: usize = LOG_BYTES as usize / 4 + 1;
const COUNT: u32 = 12;

/// Everybody lives but these.
struct Except<'a>(&'a [LockOwner]);

impl Incarnations for Except<'_> {
    fn is_current(&self, owner: LockOwner) -> bool {
        !self.0.contains(&owner)
    }
}

const ALL_LIVE: Except<'_> = Except(&[]);

/// A clock that stands.
struct At(u64);

impl Clock for At {
    fn now(&self) -> Instant {
        Instant::from_ns(self.0)
    }
}

fn owner(number: u8, incarnation: u32) -> LockOwner {
    LockOwner::new(Processor(number), incarnation).unwrap()
}

fn log<W: CompareExchange>(memory: &W) -> SharedLog<&W, NativeSwap<&W>> {
    let entries = Region::whole(memory).part(0, LOG_BYTES).unwrap();
    let lock = SpinLock::new(NativeSwap::new(memory, LOG_BYTES).unwrap());
    SharedLog::new(entries, lock).unwrap()
}

fn reader(memory: &Memory) -> SharedLogReader<&Memory> {
    SharedLogReader::new(Region::whole(memory).part(0, LOG_BYTES).unwrap()).unwrap()
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
        let clock = At(u64::MAX - u64::from(number));
        log.try_append(owner(number, 1), &ALL_LIVE, &clock, text)
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
        .try_append(owner(1, 1), &ALL_LIVE, &At(0), &text)
        .unwrap();
    let entry = reader(&memory).next_entry().unwrap().unwrap();
    assert_eq!(entry.text(), &text[..text.len() - "öü".len()]);
}

#[test]
fn what_is_no_log_is_left_alone() {
    let memory = Memory::filled(WORDS, |_| 7);
    let error = SharedLogError::NoLog { found: [7; 3] };
    let appended = log(&memory).try_append(owner(1, 1), &ALL_LIVE, &At(0), "");
    assert_eq!(appended, Err(error));
    assert_eq!(reader(&memory).next_entry(), Err(error));
    let mut words = (0..memory.size()).step_by(4);
    assert!(words.all(|offset| memory.load(offset, LoadOrder::Relaxed) == Ok(7)));
    let small = Region::whole(&memory).part(0, 188).unwrap();
    assert!(SharedLogReader::new(small).is_err());
}

#[test]
fn a_living_owner_of_the_lock_keeps_others_out() {
    let memory = Memory::new(WORDS);
    let lock = SpinLock::new(NativeSwap::new(&memory, LOG_BYTES).unwrap());
    let guard = lock.try_lock(owner(3, 1), &ALL_LIVE).unwrap();
    let appended = log(&memory).try_append(owner(1, 1), &ALL_LIVE, &At(0), "");
    let held = Some(owner(3, 1));
    assert_eq!(appended, Err(SpinLockError::Busy { owner: held }.into()));
    drop(guard);
    log(&memory)
        .try_append(owner(1, 1), &ALL_LIVE, &At(0), "")
        .unwrap();
}

/// A processor dies after any number of accesses, as the first that appends or later: the others lose nothing that they
/// append, and its own entry is there as a whole or not at all.
#[test]
fn an_entry_whose_processor_dies_disturbs_no_other() {
    for before in [&[][..], &["a", "b", "c"]] {
        let mut accesses = 0;
        while dies(before, accesses) {
            accesses += 1;
        }
        assert!(accesses > 10, "{accesses}");
    }
}

/// Returns false if the processor did not need so many accesses.
fn dies(before: &[&str], accesses: u32) -> bool {
    const LAST: &str = "its last words";
    let (memory, dead) = (Memory::new(WORDS), owner(1, 1));
    let mut reader = reader(&memory);
    for text in before {
        let appended = log(&memory).try_append(owner(2, 1), &ALL_LIVE, &At(0), text);
        assert!(appended.is_ok());
    }
    let mortal = Mortal::new(&memory, accesses);
    let told = log(&mortal).try_append(dead, &ALL_LIVE, &At(0), LAST);
    for text in ["d", "e"] {
        let appended = log(&memory).try_append(owner(3, 1), &Except(&[dead]), &At(0), text);
        assert!(appended.is_ok(), "after {accesses} accesses: {appended:?}");
    }
    let entries = all(&mut reader);
    let texts: Vec<_> = entries.iter().map(SharedLogEntry::text).collect();
    let is_there = texts.contains(&LAST);
    assert!(is_there || told.is_err(), "after {accesses} accesses");
    let appended = [before, if is_there { &[LAST] } else { &[] }, &["d", "e"]].concat();
    let kept = &appended[appended.len().saturating_sub(4)..];
    assert_eq!(texts, kept, "after {accesses} accesses");
    assert!(mortal.is_dead() || told.is_ok());
    mortal.is_dead()
}

/// Threads append as fast as they can, while another one reads.
#[test]
fn threads_append_in_turn() {
    const EACH: u32 = if cfg!(miri) { 10 } else { 2000 };
    let memory = Memory::new(WORDS);
    let left = AtomicU32::new(4);
    std::thread::scope(|threads| {
        for number in 0..4 {
            let (log, left) = (log(&memory), &left);
            threads.spawn(move || {
                for line in 0..EACH {
                    let text = format!("{line} {}", "x".repeat(line as usize % 100));
                    let me = owner(number, 1);
                    while log
                        .try_append(me, &ALL_LIVE, &At(line.into()), &text)
                        .is_err()
                    {
                        std::thread::yield_now();
                    }
                }
                left.fetch_sub(1, Ordering::Release);
            });
        }
        let (mut reader, mut next, mut last) = (reader(&memory), [0; 4], None);
        loop {
            let is_over = left.load(Ordering::Acquire) == 0;
            let Some(entry) = reader.next_entry().unwrap() else {
                if is_over {
                    break;
                }
                std::thread::yield_now();
                continue;
            };
            assert!(last.replace(entry.number) < Some(entry.number));
            let line = u32::try_from(entry.at().as_ns()).unwrap();
            let text = format!("{line} {}", "x".repeat(line as usize % 100));
            assert_eq!(entry.text(), text);
            let next = &mut next[entry.processor().index()];
            assert!(line >= *next, "{entry:?} after {next}");
            *next = line + 1;
        }
        assert_eq!(last, Some(4 * EACH - 1));
    });
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
    /// A reader gets the entries in order, and misses those that were overwritten, no others; also where the count wraps.
    #[test]
    fn a_reader_gets_what_a_list_of_four_keeps(
        steps in prop::collection::vec(step(), 0..60),
        before in prop_oneof![0..20_u32, u32::MAX - 20..=u32::MAX],
    ) {
        let memory = Memory::new(WORDS);
        let (log, mut reader) = (log(&memory), reader(&memory));
        let mut kept = std::collections::VecDeque::new();
        log.try_append(owner(9, 1), &ALL_LIVE, &At(0), "").unwrap();
        memory.store(COUNT, before, StoreOrder::Relaxed).unwrap();
        // Entries before that number are not there.
        all(&mut reader);
        let mut next = before;
        for step in steps {
            match step {
                Step::Append(processor, text) => {
                    let number = log.try_append(owner(processor, 1), &ALL_LIVE, &At(0), &text).unwrap();
                    prop_assert_eq!(number, next);
                    let end = (0..=text.len().min(SharedLog::TEXT_BYTES)).rfind(|&it| text.is_char_boundary(it));
                    let end = end.unwrap_or(0);
                    kept.push_back((number, processor, text[..end].to_owned()));
                    next = next.wrapping_add(1);
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
