//! Loom on the latest value: readers that poll while its writer publishes, stops or is replaced.

use std::cell::Cell;

use crate::model::{LoomWindow, explore};
use condor_mbox::published::{PublishedReadError, Subscriber};
use condor_mbox::window::{WindowError, WindowErrorKind};
use condor_mbox::{LoadOrder, MemoryWindow, Published, StoreOrder};

/// Two words, so that a mixture shows.
type Value = [u32; 2];

const CELL: Published<Value> = Published::at(0);

/// Accesses of one publication: two of the sequence, two of the value.
const PUBLICATION: u32 = 4;

/// A view of the memory that stops for ever after some stores.
struct Mortal {
    memory: LoomWindow,
    left: Cell<u32>,
}

#[derive(Debug)]
struct MortalError(WindowErrorKind);

impl WindowError for MortalError {
    fn kind(&self) -> WindowErrorKind {
        self.0
    }
}

impl MemoryWindow for Mortal {
    type Error = MortalError;

    fn size(&self) -> u32 {
        self.memory.size()
    }

    fn load(&self, offset: u32, order: LoadOrder) -> Result<u32, MortalError> {
        let loaded = self.memory.load(offset, order);
        loaded.map_err(|error| MortalError(error.kind()))
    }

    fn store(&self, offset: u32, value: u32, order: StoreOrder) -> Result<(), MortalError> {
        let left = self.left.get().checked_sub(1);
        self.left
            .set(left.ok_or(MortalError(WindowErrorKind::Lost))?);
        let stored = self.memory.store(offset, value, order);
        stored.map_err(|error| MortalError(error.kind()))
    }

    fn check(&self, offset: u32, len: usize) -> Result<(), MortalError> {
        let checked = self.memory.check(offset, len);
        checked.map_err(|error| MortalError(error.kind()))
    }
}

/// The value that every model publishes with `sequence`.
fn value(sequence: u32) -> Value {
    [sequence, 100 + sequence]
}

/// Publishes until `last` is complete, or memory stops; gives the last complete sequence.
fn publish<W: MemoryWindow>(window: W, first: u32, last: u32) -> u32 {
    let mut publisher = CELL.publisher(window).unwrap();
    for sequence in first..=last {
        match publisher.publish(&value(sequence)) {
            Ok(number) => assert_eq!(number, sequence),
            Err(_) => return sequence - 1,
        }
    }
    last
}

/// Reads once: a whole value, and none older than `since`; gives its sequence.
fn read(subscriber: &Subscriber<Value, LoomWindow>, since: u32) -> u32 {
    match subscriber.read() {
        Ok(latest) => {
            assert_eq!(latest.value, value(latest.sequence), "a mixture");
            assert!(latest.sequence >= since, "{latest:?} after {since}");
            latest.sequence
        }
        Err(PublishedReadError::Unpublished) => {
            assert_eq!(since, 0, "nothing after {since}");
            0
        }
        Err(PublishedReadError::Contended { .. }) => since,
        Err(error) => panic!("{error}"),
    }
}

/// One writer publishes up to `last` while each of `readers` polls twice; `before` is complete
/// when they begin.
fn polled(name: &str, preemptions: usize, before: u32, last: u32, readers: usize) {
    explore(name, preemptions, move || {
        let memory = LoomWindow::seen(Published::<Value>::BYTES);
        publish(memory.clone(), 1, before);
        let readers: Vec<_> = (0..readers)
            .map(|_| {
                let subscriber = CELL.subscriber(memory.clone()).unwrap().with_attempts(2);
                loom::thread::spawn(move || {
                    let since = read(&subscriber, before);
                    read(&subscriber, since);
                })
            })
            .collect();
        publish(memory.clone(), before + 1, last);
        for reader in readers {
            reader.join().unwrap();
        }
        let subscriber = CELL.subscriber(memory).unwrap().with_attempts(1);
        assert_eq!(read(&subscriber, last), last);
    });
}

/// Bound 2: 32 558 executions, 5 s. Fails if completion is not a Release store, or without the mark
/// of a buffer that is being written.
#[test]
fn two_readers_of_the_first_values() {
    polled("two readers, 1 to 2", 2, 0, 2, 2);
}

/// Bound 3: 22 109 executions, 2 s. Fails without either fence, or without the second look.
#[test]
fn a_reader_of_the_first_values() {
    polled("reader, 1 to 3", 3, 0, 3, 1);
}

/// Bound 1: 76 120 executions, 18 s (bound 2: 1 088 024, 159 s). Fails without either fence: a reader
/// without the writer's goes back from 2 to 1.
#[test]
fn two_readers_of_later_values() {
    polled("two readers, 3 to 4", 1, 2, 4, 2);
}

/// Bound 3: 145 562 executions, 12 s. Fails without either fence, or without the second look.
#[test]
fn a_reader_of_later_values() {
    polled("reader, 3 to 5", 3, 2, 5, 1);
}

/// A writer stops at any store of publication 3 or 4: what was complete before stays readable,
/// and the writer that replaces it continues. Bound 3: at most 1617 executions a stop, 0.3 s in all.
#[test]
fn a_writer_that_stops_is_replaced() {
    for stores in 0..2 * PUBLICATION {
        explore(&format!("stops after {stores} stores"), 3, move || {
            let memory = LoomWindow::seen(Published::<Value>::BYTES);
            publish(memory.clone(), 1, 2);
            let subscriber = CELL.subscriber(memory.clone()).unwrap().with_attempts(1);
            let reader = loom::thread::spawn(move || {
                // One publication that is not finished takes no attempt from a reader.
                let first = subscriber.read();
                assert!(first.is_ok() || stores >= PUBLICATION, "{first:?}");
                let since = first.map_or(2, |latest| latest.sequence);
                read(&subscriber, since);
            });
            let mortal = Mortal {
                memory: memory.clone(),
                left: Cell::new(stores),
            };
            let complete = publish(mortal, 3, 4);
            assert_eq!(complete, 2 + stores / PUBLICATION);
            let subscriber = CELL.subscriber(memory.clone()).unwrap().with_attempts(1);
            assert_eq!(read(&subscriber, complete), complete);
            reader.join().unwrap();
            assert_eq!(read(&subscriber, complete), complete);
            publish(memory, complete + 1, complete + 1);
            assert_eq!(read(&subscriber, complete + 1), complete + 1);
        });
    }
}
