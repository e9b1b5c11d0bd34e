//! What others find in a window may be anything; looking at it gives errors at most.

use condor_mbox::{MemoryWindow, Places, Published, Region, StaticMemory};
use condor_mos::{Rate, Statistics};
use condor_rt::directory::{self, Directory, DirectoryError, ENTRIES, Entry, Kind, Name};
use condor_rt::loops::{self, LoopReports};
use proptest::prelude::*;

const WORDS: usize = 512;

fn counts(released: u64) -> Statistics {
    Statistics {
        rate: Rate::new(5994, 100).unwrap(),
        frequency: Rate::hz(1_000_000_000),
        enabled: true,
        faulted: false,
        released,
        run: released - 3,
        skipped: 1,
        running: 1,
        pending: 1,
        worst_lateness: 5,
        worst_run: 600,
        total_run: u64::from(u32::MAX) * 3,
        released_before: 7 << 40,
        total_before: 9 << 50,
    }
}

#[test]
fn what_is_entered_is_found() {
    let memory = StaticMemory::<WORDS>::new();
    let own = Region::users(memory.window()).unwrap();
    assert_eq!(directory::entries(&own).unwrap().count(), 0);
    let mut places = Places::new(own.size());
    let mut made = Directory::new(own, &mut places).unwrap();
    assert_eq!(directory::find(&own, "loops").unwrap(), None);
    let names = ["servo", "a name of sixteen and more"];
    let mut reports = LoopReports::<_, 2>::new(&own, &mut places, &mut made, names).unwrap();
    let entry = directory::find(&own, "loops").unwrap().unwrap();
    assert_eq!((entry.kind, loops::count(&entry)), (Kind::Loops, 2));
    assert_eq!(loops::read(&own, &entry, 0).unwrap(), None, "unpublished");
    for released in [10, 11] {
        reports.publish(1, &counts(released)).unwrap();
        let (name, read) = loops::read(&own, &entry, 1).unwrap().unwrap();
        assert_eq!(
            (name.as_str(), read),
            ("a name of sixtee", counts(released))
        );
    }
    // A loop that there is not.
    reports.publish(2, &counts(9)).unwrap();
    assert_eq!(loops::read(&own, &entry, 2).unwrap(), None);
    for number in 1..ENTRIES as u32 {
        let name = format!("é {number}");
        made.enter(&name, Kind::Monitor, number, 2 * number)
            .unwrap();
        let entry = directory::find(&own, &name).unwrap().unwrap();
        let expected = (Kind::Monitor, number, 2 * number);
        assert_eq!((entry.kind, entry.offset, entry.len), expected);
    }
    let full = made.enter("one more", Kind::Other, 0, 0);
    assert_eq!(full, Err(DirectoryError::Full));
    assert_eq!(directory::entries(&own).unwrap().count(), ENTRIES);
    // A new life of the program begins with an empty directory.
    let mut places = Places::new(own.size());
    Directory::new(own, &mut places).unwrap();
    assert_eq!(directory::entries(&own).unwrap().count(), 0);
}

#[test]
fn a_directory_must_be_the_first_and_have_room() {
    let memory = StaticMemory::<WORDS>::new();
    let own = Region::users(memory.window()).unwrap();
    let mut places = Places::new(own.size());
    places.bytes(64).unwrap();
    let error = Directory::new(own, &mut places).unwrap_err();
    assert_eq!(error, DirectoryError::NotFirst { offset: 64 });
    let small = StaticMemory::<64>::new();
    let own = Region::users(small.window()).unwrap();
    let error = Directory::new(own, &mut Places::new(own.size())).unwrap_err();
    assert!(matches!(error, DirectoryError::Access(_)), "{error}");
}

#[test]
fn names_are_cut_between_characters() {
    for (name, kept) in [
        ("", ""),
        ("sixteen bytes ok", "sixteen bytes ok"),
        ("fifteen bytes: é", "fifteen bytes: "),
        ("äöüäöüäöü", "äöüäöüäö"),
    ] {
        assert_eq!(Name::new(name).as_str(), kept);
    }
}

#[test]
fn counts_that_no_scheduler_wrote_are_none_or_can_be_printed() {
    let memory = StaticMemory::<128>::new();
    let own = Region::users(memory.window()).unwrap();
    let entry = Entry {
        name: Name::new("loops"),
        kind: Kind::Loops,
        offset: 0,
        len: 400,
    };
    let mut row = Published::<[u32; 16]>::at(16).publisher(own).unwrap();
    for (word, is_some) in [(0, false), (1, true), (u32::MAX, true)] {
        row.publish(&[word; 16]).unwrap();
        let read = loops::read(&own, &entry, 0).unwrap();
        assert_eq!(read.is_some(), is_some, "{word}");
        look(&own, &entry, 0);
    }
}

/// Words that mean something, and any others.
fn word() -> impl Strategy<Value = u32> {
    prop_oneof![
        Just(u32::from_le_bytes(*b"CDIR")),
        Just(0),
        0..64_u32,
        (0..64_u32).prop_map(|words| 4 * words),
        Just(u32::MAX),
        (0..64_u32).prop_map(|less| u32::MAX - less),
        any::<u32>(),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Reading any words ends, and what it gives can be printed.
    #[test]
    fn any_words_can_be_read(
        words in prop::collection::vec(word(), 300),
        is_directory in any::<bool>(),
        numbers in prop::collection::vec(word(), 2),
    ) {
        let memory = StaticMemory::<WORDS>::new();
        let own = Region::users(memory.window()).unwrap();
        for (at, word) in (0..).zip(&words) {
            own.set_word(4 * at, *word).unwrap();
        }
        if is_directory {
            own.set_word(0, u32::from_le_bytes(*b"CDIR")).unwrap();
            own.set_word(4, 1).unwrap();
        }
        let mut found = 0;
        for entry in directory::entries(&own).unwrap() {
            let entry = entry.unwrap();
            found += 1;
            prop_assert!(entry.name.as_str().len() <= 16);
            for &number in &numbers {
                look(&own, &entry, number);
            }
        }
        prop_assert!(found <= ENTRIES);
        if is_directory {
            prop_assert_eq!(found, ENTRIES.min(words[2] as usize));
        }
        let _ = directory::find(&own, "loops").unwrap();
    }

    /// So does reading at any offset of a window of any size.
    #[test]
    fn any_entry_can_be_followed(offset in word(), len in word(), number in word(), fill in word()) {
        let memory = StaticMemory::<64>::new();
        let whole = Region::whole(memory.window());
        for at in 0..64 {
            whole.set_word(4 * at, fill).unwrap();
        }
        let entry = Entry { name: Name::new("loops"), kind: Kind::Loops, offset, len };
        for size in [0, 4, 128, 256] {
            let part = whole.part(0, size);
            if let Ok(part) = part {
                look(&part, &entry, number);
                let _ = directory::entries(&part).map(Iterator::count);
            }
        }
    }
}

fn look<W: condor_mbox::MemoryWindow + Clone>(region: &Region<W>, entry: &Entry, number: u32) {
    let read = loops::read(region, entry, number);
    if number >= loops::count(entry) {
        assert_eq!(read, Ok(None));
    } else if let Ok(Some((name, counts))) = read {
        let _ = format!("{} {counts:#} {counts}", name.as_str());
    }
}
