//! What others find in a window may be anything; looking at it gives errors at most.

use condor_mbox::{Allocator, MemoryWindow, Published, Region, StaticMemory};
use condor_mos::{Histogram, Rate, Statistics};
use condor_rt::ShortText;
use condor_rt::loops::{self, LoopReport, LoopTimes};
use condor_rt::objects::{self, NAME_BYTES, ObjectError, ObjectKind, ObjectTable, SharedObject};
use proptest::prelude::*;

const WORDS: usize = 512;

fn counts(released: u64) -> Statistics {
    Statistics {
        rate: Rate::new(5994, 100).unwrap(),
        frequency: Rate::hz(1_000_000_000),
        enabled: true,
        faulted: false,
        computed: true,
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

fn times(longest: u32) -> LoopTimes {
    let mut classes = [7; 64];
    classes[63] = longest;
    let (lateness, runs) = (Histogram::new([1; 64]), Histogram::new(classes));
    LoopTimes { lateness, runs }
}

#[test]
fn what_is_entered_is_found() {
    let memory = StaticMemory::<WORDS>::new();
    let own = Region::users(memory.window()).unwrap();
    assert_eq!(objects::all(&own).unwrap().count(), 0);
    let mut allocator = Allocator::new(own.size());
    let mut table = ObjectTable::new(own, &mut allocator).unwrap();
    let longest = "é".repeat(NAME_BYTES / 2);
    assert_eq!(
        objects::find(&own, &longest, ObjectKind::Loop).unwrap(),
        None
    );
    let mut servo = LoopReport::new(&own, &mut allocator, &mut table, &longest).unwrap();
    let found = objects::find(&own, &longest, ObjectKind::Loop)
        .unwrap()
        .unwrap();
    assert_eq!(loops::read(&own, &found).unwrap(), None, "unpublished");
    for released in [10, 11] {
        let all = (counts(released), times(released as u32));
        servo.publish(&all.0, &all.1).unwrap();
        assert_eq!(loops::read(&own, &found).unwrap(), Some(all));
    }
    let mut enter = |name: &str, number: u32| {
        table.enter(&mut allocator, name, ObjectKind::Other, number, 2 * number)
    };
    for number in 1..4 {
        let name = format!("é {number}");
        enter(&name, number).unwrap();
        let found = objects::find(&own, &name, ObjectKind::Other)
            .unwrap()
            .unwrap();
        assert_eq!((found.offset, found.len), (number, 2 * number));
    }
    let taken = enter("é 2", 9).unwrap_err();
    assert_eq!(
        taken.to_string(),
        "there are two objects `é 2`: each needs a name of its own"
    );
    let long = enter(&format!("{longest}!"), 9).unwrap_err();
    assert!(matches!(long, ObjectError::Name { len: 65, .. }), "{long}");
    // As many as there is room for.
    let mut number = 4;
    let full = loop {
        match enter(&format!("{number}"), number) {
            Ok(()) => number += 1,
            Err(error) => break error,
        }
    };
    assert!(matches!(full, ObjectError::Access(_)), "{full}");
    assert_eq!(objects::all(&own).unwrap().count(), number as usize);
    // A new incarnation of the program begins with an empty table.
    let mut allocator = Allocator::new(own.size());
    ObjectTable::new(own, &mut allocator).unwrap();
    assert_eq!(objects::all(&own).unwrap().count(), 0);
}

#[test]
fn there_may_be_thousands_of_names() {
    let memory = StaticMemory::<65536>::new();
    let own = Region::users(memory.window()).unwrap();
    let mut allocator = Allocator::new(own.size());
    let mut table = ObjectTable::new(own, &mut allocator).unwrap();
    for number in 0..2000 {
        let name = format!("finger.{number}.tension");
        table
            .enter(&mut allocator, &name, ObjectKind::Other, number, 4)
            .unwrap();
    }
    let found = objects::find(&own, "finger.1999.tension", ObjectKind::Other);
    assert_eq!(found.unwrap().unwrap().offset, 1999);
}

#[test]
fn a_table_must_be_the_first_and_have_room() {
    let memory = StaticMemory::<WORDS>::new();
    let own = Region::users(memory.window()).unwrap();
    let mut allocator = Allocator::new(own.size());
    allocator.bytes(64).unwrap();
    let error = ObjectTable::new(own, &mut allocator).unwrap_err();
    assert_eq!(error, ObjectError::NotFirst { offset: 64 });
    let error = ObjectTable::new(own, &mut Allocator::new(8)).unwrap_err();
    assert!(matches!(error, ObjectError::Access(_)), "{error}");
}

fn object(offset: u32, len: u32) -> SharedObject {
    SharedObject {
        name: ShortText::of("loop"),
        kind: ObjectKind::Loop,
        offset,
        len,
    }
}

#[test]
fn counts_that_no_scheduler_wrote_are_none_or_can_be_printed() {
    let memory = StaticMemory::<WORDS>::new();
    let own = Region::users(memory.window()).unwrap();
    let mut row = Published::<[u32; 150]>::at(0).publisher(own).unwrap();
    for (word, is_some) in [(0, false), (1, true), (u32::MAX, true)] {
        row.publish(&[word; 150]).unwrap();
        let read = loops::read(&own, &object(0, 400)).unwrap();
        assert_eq!(read.is_some(), is_some, "{word}");
        look(&own, &object(0, 400));
    }
}

/// Words that mean something, and any others.
fn word() -> impl Strategy<Value = u32> {
    prop_oneof![
        Just(u32::from_le_bytes(*b"COBJ")),
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
        is_table in any::<bool>(),
    ) {
        let memory = StaticMemory::<WORDS>::new();
        let own = Region::users(memory.window()).unwrap();
        for (at, word) in (0..).zip(&words) {
            own.set_word(4 * at, *word).unwrap();
        }
        if is_table {
            own.set_word(0, u32::from_le_bytes(*b"COBJ")).unwrap();
            own.set_word(4, 1).unwrap();
        }
        let mut found = 0;
        for object in objects::all(&own).unwrap() {
            found += 1;
            let Ok(object) = object else { continue };
            prop_assert!(object.name.as_str().len() <= NAME_BYTES);
            look(&own, &object);
        }
        prop_assert!(found <= WORDS);
        let _ = objects::find(&own, "loop", ObjectKind::Loop);
    }

    /// So does reading at any offset of a window of any size.
    #[test]
    fn any_object_can_be_followed(offset in word(), len in word(), fill in word()) {
        let memory = StaticMemory::<64>::new();
        let whole = Region::whole(memory.window());
        for at in 0..64 {
            whole.set_word(4 * at, fill).unwrap();
        }
        for size in [0, 4, 128, 256] {
            let part = whole.part(0, size);
            if let Ok(part) = part {
                look(&part, &object(offset, len));
                let _ = objects::all(&part).map(Iterator::count);
            }
        }
    }
}

fn look<W: condor_mbox::MemoryWindow + Clone>(region: &Region<W>, object: &SharedObject) {
    if let Ok(Some((counts, times))) = loops::read(region, object) {
        let median = times.runs.percentile(50.0);
        let _ = format!("{} {counts:#} {counts} {median}", object.name);
    }
}
