//! Loom on the latest value: a writer and a reader on two threads.

use condor_mos::{Latest, LatestReader};

/// Two words, so that a mixture shows; loom's cells tell if both ends reach one buffer.
type Value = [u32; 2];

fn value(number: u32) -> Value {
    [number, 100 + number]
}

/// A whole value, and none older than `since`; gives its number.
fn read(reader: &mut LatestReader<'_, Value>, since: u32) -> u32 {
    let [number, check] = *reader.read();
    assert_eq!(check, 100 + number, "a mixture");
    assert!(number >= since, "{number} after {since}");
    number
}

/// The writer publishes up to `last` while the reader reads `reads` times.
fn polled(last: u32, reads: u32) {
    loom::model(move || {
        // Loom's threads are not scoped; each execution is forgotten as a whole.
        let cell: &'static Latest<Value> = Box::leak(Box::new(Latest::new(value(0))));
        let (mut writer, mut reader) = cell.split().expect("the first");
        assert!(cell.split().is_none());
        let publishing = loom::thread::spawn(move || {
            for number in 1..=last {
                writer.write(value(number));
            }
        });
        let mut since = 0;
        for _ in 0..reads {
            since = read(&mut reader, since);
        }
        publishing.join().expect("no panic");
        assert_eq!(read(&mut reader, since), last);
        assert!(!reader.is_fresh());
    });
}

/// Unbounded. Fails if either exchange is not both Acquire and Release.
#[test]
fn a_reader_of_four_values() {
    polled(4, 4);
}

/// Unbounded.
#[test]
fn a_reader_that_is_slower() {
    polled(6, 2);
}

/// Unbounded: both ends are asked for at once, and given once.
#[test]
fn the_ends_are_given_away_once() {
    loom::model(|| {
        let cell: &'static Latest<u32> = Box::leak(Box::new(Latest::new(0)));
        let other = loom::thread::spawn(move || cell.split().is_some());
        let mine = cell.split().is_some();
        assert!(mine != other.join().expect("no panic"));
    });
}
