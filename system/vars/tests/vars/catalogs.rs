//! What a program may declare, in memory that plain stores reach.

use core::fmt;
use core::sync::atomic::AtomicU32;

use condor_mbox::{
    Allocator, CriticalSection, Instant, MemoryWindow, Processor, Region, StaticMemory,
    StaticWindow,
};
use condor_vars::layout::NAME_BYTES;
use condor_vars::{
    Catalog, CatalogError, Param, Respond, Selections, Tune, ValueKind, Var, VarDescription,
    VariableSettings, VariableTable, Vars, Watch,
};

const LONG: &str = "a name of more than ninety-six bytes, which is longer than any that a table of variables can ever hold";

fn refusal(watched: &[&dyn Watch], params: &[&dyn Tune]) -> CatalogError {
    Catalog::new(watched, params).bytes(1, 2).unwrap_err()
}

#[test]
fn what_a_table_cannot_hold_is_refused() {
    let short = Var::<u32>::new("short", "");
    let long = Var::<u32>::new(LONG, "");
    let expected = CatalogError::TooLong {
        entry: 1,
        what: "the name",
        most: NAME_BYTES,
    };
    assert_eq!(refusal(&[&short, &long], &[]), expected);
    let unit = Var::<u32>::new("", LONG);
    assert!(matches!(
        refusal(&[&unit], &[]),
        CatalogError::TooLong { most: 32, .. }
    ));
    let many = Box::new(Vars::<u32, 70_000>::numbered("v", ""));
    assert!(matches!(
        refusal(&[&*many], &[]),
        CatalogError::TooMany { .. }
    ));
    let param = Param::new("p", "", 7, 0..=5);
    let expected = CatalogError::Initial { parameter: 0 };
    assert_eq!(refusal(&[], &[&param]), expected);
}

/// Variables of two types, whose names are known when the program runs.
struct Finger {
    name: String,
    words: [AtomicU32; 3],
    /// How many variables it says it has.
    count: usize,
}

impl Watch for Finger {
    fn words(&self) -> &[AtomicU32] {
        &self.words
    }

    fn describe(&self, index: usize) -> Option<VarDescription<'_>> {
        let kind = if index == 0 {
            ValueKind::F32
        } else {
            ValueKind::F64
        };
        (index < self.count).then_some(VarDescription {
            kind,
            unit: "rad",
            about: "",
            labels: &[],
            bounds: [[0; 2]; 2],
        })
    }

    fn name(&self, index: usize, to: &mut dyn fmt::Write) -> fmt::Result {
        write!(to, "{}.{}", self.name, ["position", "sum"][index])
    }
}

#[test]
fn blocks_may_have_several_types() {
    let finger = |count| Finger {
        name: "index".into(),
        words: [1, 2, 3].map(AtomicU32::new),
        count,
    };
    let block = CatalogError::Block { block: 0, words: 3 };
    assert_eq!(refusal(&[&finger(1)], &[]), block);
    let three = Finger {
        count: 3,
        ..finger(2)
    };
    assert_eq!(refusal(&[&three], &[]), block);

    let (single, finger) = (Var::<u32>::new("single", ""), finger(2));
    single.set(7);
    let rows = sample(&[&single, &finger], &[2, 1, 0]);
    assert_eq!(rows, [7, 1, 2, 3]);
    assert_eq!(sample(&[&single, &finger], &[0, 2]), [7, 2, 3]);
}

/// Of many single variables, of blocks of every length and of parts, a row has the right words.
#[test]
fn every_selection_is_copied() {
    let singles: Vec<Var<u32>> = (0..13).map(|_| Var::new("single", "")).collect();
    let wide: Vec<Var<u64>> = (0..7).map(|_| Var::new("wide", "")).collect();
    let (few, many) = (
        Vars::<u32, 9>::numbered("few", ""),
        Vars::<u32, 75>::numbered("many", ""),
    );
    let mut watched: Vec<&dyn Watch> = Vec::new();
    watched.extend(singles.iter().map(|it| it as &dyn Watch));
    watched.push(&few);
    watched.extend(wide.iter().map(|it| it as &dyn Watch));
    watched.push(&many);
    for (value, single) in (100..).zip(&singles) {
        single.set(value);
    }
    (0..9).for_each(|index| few.set_at(index, 200 + index as u32));
    for (value, wide) in (300..).zip(&wide) {
        wide.set(value << 32 | value);
    }
    (0..75).for_each(|index| many.set_at(index, 400 + index as u32));
    let words = |entry: u32| match entry {
        0..13 => vec![100 + entry],
        13..22 => vec![187 + entry],
        22..29 => vec![278 + entry; 2],
        _ => vec![371 + entry],
    };
    for (first, last, step) in [
        (0, 104, 1),
        (0, 104, 3),
        (3, 60, 1),
        (40, 90, 1),
        (12, 104, 1),
    ] {
        let entries: Vec<u32> = (first..last).step_by(step).collect();
        let expected: Vec<u32> = entries.iter().copied().flat_map(words).collect();
        assert_eq!(sample(&watched, &entries), expected, "{first}..{last}");
    }
}

#[test]
fn what_is_over_the_capacity_is_refused_with_its_number() {
    let memory: Box<StaticMemory<8192>> = Box::default();
    let region: Region<StaticWindow<'_>> = Region::whole(memory.window());
    let one = Var::<u32>::new("one", "");
    let open = |shown: &[&dyn Watch], watchers| {
        let settings = VariableSettings {
            rate: (400, 1),
            rows: 2,
            watchers,
        };
        let mut allocator = Allocator::new(region.size());
        let catalog = Catalog::new(shown, &[]);
        let mut memory = Selections::<1>::new();
        let opened = memory.open(
            catalog,
            &region,
            &mut allocator,
            &settings,
            CriticalSection,
            &|_| 1,
        );
        opened.map(drop).map_err(|error| error.to_string())
    };
    assert_eq!(open(&[&one, &one, &one], 4), Ok(()));
    let many = "there are 4 blocks of variables, but at most 3 are possible".to_owned();
    assert_eq!(open(&[&one, &one, &one, &one], 4), Err(many));
    let watchers = "there are 5 watchers, but at most 4 are possible".to_owned();
    assert_eq!(open(&[&one], 5), Err(watchers));
}

/// The words of a row of these entries.
fn sample(shown: &[&dyn Watch], entries: &[u32]) -> Vec<u32> {
    let memory: Box<StaticMemory<8192>> = Box::default();
    let region: Region<StaticWindow<'_>> = Region::whole(memory.window());
    let mut selections = Selections::<40>::new();
    let settings = VariableSettings {
        rate: (400, 1),
        rows: 2,
        watchers: 1,
    };
    let mut allocator = Allocator::new(region.size());
    let (server, mut sampler) = selections
        .open(
            Catalog::new(shown, &[]),
            &region,
            &mut allocator,
            &settings,
            CriticalSection,
            &|_| 1,
        )
        .unwrap();
    let table = VariableTable::open(&region, server.offset()).unwrap();
    let mut watcher = server.watch(&table, Processor(0), entries, 1).unwrap();
    sampler.begin().unwrap();
    sampler.end(0, Instant::from_ns(0)).unwrap();
    let mut values = vec![0; watcher.words()];
    watcher.read(&mut values).unwrap().unwrap();
    values
}
