//! A reader copies rows while their writer overwrites them.

use condor_mbox::Instant;
use condor_vars::{Catalog, Var, Watch, Watcher};
use loom::thread;

use crate::memory::{Memory, open, select};

/// Where the slot begins in a table of one variable whose name has one letter.
const SLOT: u32 = 128;
const ROWS: u32 = SLOT + 128;
const ROW_BYTES: u32 = 20;

/// Header and rows of the slot, but for the upper words of tick and time.
fn is_seen(offset: u32) -> bool {
    let of_row = offset.checked_sub(ROWS).map(|within| within % ROW_BYTES);
    (SLOT + 4..SLOT + 16).contains(&offset) || of_row.is_some_and(|at| at == 0 || at == 16)
}

/// The writer writes `last` rows while the reader looks `looks` times; at most `preemptions` if given.
fn watched(last: u32, looks: u32, preemptions: Option<usize>) {
    let mut model = loom::model::Builder::new();
    model.preemption_bound = preemptions;
    model.check(move || {
        let variable: &'static Var<u32> = Box::leak(Box::new(Var::new("v", "")));
        let shown: &'static [&'static dyn Watch] = Box::leak(Box::new([variable as _]));
        let (server, mut sampler, mut watcher) =
            open(Catalog::new(shown, &[]), &Memory::new(is_seen), &|_| 1);
        let (selection, words) = select(&server, &mut watcher, &[0]).unwrap();
        watcher.follow(selection, words);
        assert_eq!(watcher.rows(), 2);
        sampler.begin().unwrap();
        let writing = thread::spawn(move || {
            for tick in 0..last {
                variable.set(100 + tick);
                sampler.end(tick.into(), Instant::from_ns(0)).unwrap();
            }
        });
        let (mut next, mut count) = (0, 0);
        let mut take = |watcher: &mut Watcher<Memory>| {
            let mut values = [0];
            let row = watcher.read(&mut values).unwrap();
            if let Some(row) = &row {
                assert_eq!(u64::from(values[0]), 100 + row.tick, "a mixture");
                assert_eq!(row.tick, next + u64::from(row.lost));
                next = row.tick + 1;
                count += 1;
            }
            row.is_some()
        };
        for _ in 0..looks {
            take(&mut watcher);
        }
        writing.join().unwrap();
        while take(&mut watcher) {}
        assert_eq!(count + watcher.lost(), u64::from(last));
    });
}

/// Unbounded. Fails if either of the fences is left out.
#[test]
fn a_row_is_overwritten_while_it_is_copied() {
    watched(3, 1, None);
}

/// At most three preemptions.
#[test]
fn two_looks_at_more_rows() {
    watched(4, 2, Some(3));
}

/// A row is overwritten while it is copied, and then its selection ends, so that the counts that would tell
/// begin anew. Unbounded. Fails if the look whether the selection has ended comes before the last fence.
#[test]
fn a_selection_ends_while_a_row_is_copied() {
    loom::model(|| {
        let variable: &'static Var<u32> = Box::leak(Box::new(Var::new("v", "")));
        let shown: &'static [&'static dyn Watch] = Box::leak(Box::new([variable as _]));
        // Selection, `begun`, and tick and value of the first row.
        let is_seen = |at| [SLOT + 4, SLOT + 8, ROWS, ROWS + 16].contains(&at);
        let (server, mut sampler, mut watcher) =
            open(Catalog::new(shown, &[]), &Memory::new(is_seen), &|_| 1);
        let (selection, words) = select(&server, &mut watcher, &[0]).unwrap();
        sampler.begin().unwrap();
        let mut end = move |tick: u32| {
            variable.set(100 + tick);
            sampler.end(tick.into(), Instant::from_ns(0)).unwrap();
            sampler.begin().unwrap();
        };
        end(0);
        end(1);
        select(&server, &mut watcher, &[0]).unwrap();
        watcher.follow(selection, words);
        let writing = thread::spawn(move || end(2));
        let mut values = [0];
        if let Some(row) = watcher.read(&mut values).unwrap() {
            assert_eq!(u64::from(values[0]), 100 + row.tick, "a mixture");
        }
        writing.join().unwrap();
    });
}
