//! Loom on one slot or cell: whoever reads it gets one entry whole, and of the epoch it asked for.
//!
//! Each model explores every execution; the bound is none. Together they take 7 s.

use std::sync::Arc;

use super::{Entry, EntryAt, Mail};
use crate::id::Processor;
use crate::sim::SimWindow;

const OWNER: Processor = Processor(0);
const AT: EntryAt<1> = EntryAt(0);

fn mail(window: &SimWindow) -> Mail<'_, SimWindow, 1> {
    Mail::new(window, &OWNER)
}

/// One thread puts `entries`, each with its sequence, after the first; others `get` the sequence `wanted`.
/// Passes every outcome to `check`.
fn race(entries: &'static [(u32, Entry)], wanted: u32, check: fn(Option<Entry>)) {
    let executions = Arc::new(std::sync::atomic::AtomicUsize::new(0));
    let counted = Arc::clone(&executions);
    loom::model::Builder::new().check(move || {
        counted.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        let window = SimWindow::new(16);
        let (sequence, first) = entries[0];
        mail(&window).put(AT, sequence, first);
        let writer = window.clone();
        let thread = loom::thread::spawn(move || {
            for &(sequence, entry) in &entries[1..] {
                mail(&writer).put(AT, sequence, entry);
            }
        });
        check(mail(&window).get(AT, wanted));
        thread.join().unwrap();
    });
    println!("loom has run the model {executions:?} times");
}

const OLD: Entry = Entry {
    value: 1,
    epoch: 7,
    kind: 1001,
};
const NEW: Entry = Entry {
    value: 2,
    epoch: 8,
    kind: 1002,
};
const NEXT: Entry = Entry {
    value: 3,
    epoch: 7,
    kind: 1003,
};

/// The slot is taken again by the request a ringful later, as for a listener that lags.
#[test]
fn an_entry_that_is_overwritten_is_whole_or_absent() {
    race(&[(1, OLD), (3, NEXT)], 1, |found| {
        assert!(found.is_none_or(|found| found == OLD), "{found:?}");
    });
    race(&[(1, OLD), (3, NEXT)], 3, |found| {
        assert!(found.is_none_or(|found| found == NEXT), "{found:?}");
    });
}

/// A new epoch begins the sequence anew: the same one before and after proves nothing.
#[test]
fn the_same_sequence_of_another_epoch_is_told_apart() {
    race(&[(1, OLD), (1, NEW)], 1, |found| {
        assert!(
            found.is_none_or(|found| found == OLD || found == NEW),
            "{found:?}"
        );
    });
    race(&[(1, OLD), (3, NEXT), (1, NEW)], 1, |found| {
        assert!(
            found.is_none_or(|found| found == OLD || found == NEW),
            "{found:?}"
        );
    });
}
