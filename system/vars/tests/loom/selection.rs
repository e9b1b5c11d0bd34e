//! A handler hands selections to a loop that goes on.

use std::sync::atomic::{AtomicU32, Ordering};

use condor_mbox::Instant;
use condor_vars::{Catalog, Var, Watch, WatchError, Watcher};
use loom::thread;

use crate::memory::{Memory, ask, open, select};

/// Of three selections of other variables each, none is taken over in halves, and a reader takes no row
/// for one of another selection. At most three preemptions.
#[test]
fn a_selection_is_taken_over_whole() {
    let mut model = loom::model::Builder::new();
    model.preemption_bound = Some(3);
    model.check(|| {
        let variables: &'static [Var<u32>; 2] =
            Box::leak(Box::new([Var::new("a", ""), Var::new("b", "")]));
        let [a, b] = variables;
        let shown: &'static [&'static dyn Watch] = Box::leak(Box::new([a as _, b as _]));
        a.set(10);
        b.set(20);
        // The header of the only slot and the values of its first row.
        let is_seen = |offset| (196..208).contains(&offset) || (336..344).contains(&offset);
        let memory = Memory::new(is_seen);
        let (server, mut sampler, mut watcher) = open(Catalog::new(shown, &[]), &memory, &|_| 1);
        let ticking = thread::spawn(move || {
            for tick in 0..2 {
                sampler.begin().unwrap();
                sampler.end(tick, Instant::from_ns(0)).unwrap();
            }
            sampler
        });
        let mut accepted = 0;
        for (entries, values) in [(&[1][..], &[20][..]), (&[0, 1], &[10, 20]), (&[0], &[10])] {
            let Some((selection, words)) = select(&server, &mut watcher, entries) else {
                continue;
            };
            accepted += 1;
            watcher.follow(selection, words);
            let mut found = [0; 2];
            if let Some(row) = watcher.read(&mut found).unwrap() {
                assert_eq!(&found[..row.words], values);
            }
        }
        assert!(accepted >= 1, "nothing had been asked before the first");
        let mut sampler = ticking.join().unwrap();
        sampler.begin().unwrap();
        let (selection, words) = select(&server, &mut watcher, &[0, 1]).unwrap();
        watcher.follow(selection, words);
        sampler.begin().unwrap();
        sampler.end(9, Instant::from_ns(0)).unwrap();
        let mut found = [0; 2];
        assert_eq!(
            watcher.read(&mut found).unwrap().map(|row| row.tick),
            Some(9)
        );
        assert_eq!(found, [10, 20]);
    });
}

/// The loop writes a row of each selection that it takes over, while the handler goes on to the next ones,
/// of other variables. Unbounded. Fails if the handler does not look whether the loop has taken the last one
/// over.
#[test]
fn a_plan_is_not_overwritten_while_it_is_read() {
    loom::model(|| {
        let variables: &'static [Var<u32>; 2] =
            Box::leak(Box::new([Var::new("a", ""), Var::new("b", "")]));
        let [a, b] = variables;
        let shown: &'static [&'static dyn Watch] = Box::leak(Box::new([a as _, b as _]));
        a.set(10);
        b.set(20);
        let (server, mut sampler, mut watcher) =
            open(Catalog::new(shown, &[]), &Memory::new(|_| false), &|_| 1);
        let (first, words) = select(&server, &mut watcher, &[0]).unwrap();
        let mut accepted = vec![(first, words, 10)];
        sampler.begin().unwrap();
        let ticking = thread::spawn(move || {
            sampler.end(0, Instant::from_ns(0)).unwrap();
            sampler.begin().unwrap();
            sampler.end(1, Instant::from_ns(0)).unwrap();
        });
        for (entry, value) in [(1, 20), (1, 20)] {
            let selected = select(&server, &mut watcher, &[entry]);
            accepted.extend(selected.map(|(number, words)| (number, words, value)));
        }
        ticking.join().unwrap();
        let mut rows = 0;
        for (number, words, value) in accepted {
            watcher.follow(number, words);
            let mut found = [0];
            while watcher.read(&mut found).unwrap().is_some() {
                assert_eq!(found, [value], "selection {number}");
                rows += 1;
            }
        }
        assert!(rows > 0);
    });
}

/// A watcher that was taken for dead reads on while the loop takes over the selection of the next one.
/// At most three preemptions. Fails if the fence between two selections is left out.
#[test]
fn a_displaced_watcher_gets_no_row_of_the_next() {
    let mut model = loom::model::Builder::new();
    model.preemption_bound = Some(3);
    model.check(|| {
        let variables: &'static [Var<u32>; 2] =
            Box::leak(Box::new([Var::new("a", ""), Var::new("b", "")]));
        let [a, b] = variables;
        let shown: &'static [&'static dyn Watch] = Box::leak(Box::new([a as _, b as _]));
        a.set(10);
        b.set(20);
        let is_seen = |offset| (192..208).contains(&offset) || offset == 336;
        let memory = Memory::new(is_seen);
        let incarnation: &'static AtomicU32 = Box::leak(Box::new(AtomicU32::new(1)));
        let incarnation_of = Box::leak(Box::new(|_| incarnation.load(Ordering::Relaxed)));
        let (server, mut sampler, mut former) =
            open(Catalog::new(shown, &[]), &memory, incarnation_of);
        let (selection, words) = select(&server, &mut former, &[0]).unwrap();
        former.follow(selection, words);
        sampler.begin().unwrap();
        sampler.end(0, Instant::from_ns(0)).unwrap();

        let table = former.table().clone();
        let reading = thread::spawn(move || {
            for _ in 0..2 {
                let mut values = [0];
                match former.read(&mut values) {
                    Ok(Some(_)) => assert_eq!(values, [10]),
                    Ok(None) | Err(WatchError::Displaced { .. }) => {}
                    Err(error) => panic!("{error}"),
                }
            }
            assert_eq!(former.lost(), 0);
        });
        incarnation.store(2, Ordering::Relaxed);
        let [code, slot, claim, ..] = ask(&server, [1, 0, table.incarnation(), 0, 0, 0, 0, 0]);
        assert_eq!(code, 0);
        let mut next = Watcher::new(table, slot, claim).unwrap();
        select(&server, &mut next, &[1]).unwrap();
        sampler.begin().unwrap();
        sampler.end(1, Instant::from_ns(0)).unwrap();
        reading.join().unwrap();
    });
}
