//! The latest value between two threads, and between a loop and the background.

use std::thread;

use condor_mos::Latest;

const VALUES: u32 = if cfg!(miri) { 300 } else { 100_000 };

#[test]
fn a_reader_gets_whole_values_in_order() {
    // Not `Copy`, and dropped where it is overwritten.
    let value = |number: u32| vec![number; 16];
    let cell = Latest::with_buffers(value(0), value(0), value(0));
    let (mut writer, mut reader) = cell.split().unwrap();
    thread::scope(|scope| {
        scope.spawn(move || (1..=VALUES).for_each(|number| writer.write(value(number))));
        let mut since = 0;
        while since < VALUES {
            let latest = reader.read();
            assert!(latest.iter().all(|&word| word == latest[0]), "a mixture");
            assert!(latest[0] >= since);
            since = latest[0];
            thread::yield_now();
        }
    });
}

#[test]
fn the_ends_are_given_away_once() {
    static CELL: Latest<u8> = Latest::new(5);
    let (mut writer, mut reader) = CELL.split().unwrap();
    assert!(CELL.split().is_none());
    assert!(!reader.is_fresh());
    assert_eq!(*reader.read(), 5);
    *writer.buffer() = 6;
    assert_eq!(*reader.read(), 5);
    writer.publish();
    assert_eq!(*reader.read(), 6);
}

#[test]
fn what_was_latest_stays_so_when_a_cell_is_split_again() {
    let mut cell = Latest::new(0);
    for number in 1..10 {
        let (mut writer, mut reader) = cell.split_mut();
        assert_eq!(*reader.read(), number - 1);
        writer.write(100);
        writer.write(number);
        // Taken in this round or in the next.
        if number % 2 == 0 {
            assert_eq!(*reader.read(), number);
        }
    }
}
