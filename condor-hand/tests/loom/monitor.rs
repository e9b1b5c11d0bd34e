//! Loom on the ring of a monitor: a reader copies rows while its writer overwrites them.

use std::sync::Arc;

use condor_hand::monitor::{Kind, MonitorReader, Ring, Selection, Variable, ring_bytes};
use condor_mbox::window::{WindowError, WindowErrorKind, check_access};
use condor_mbox::{LoadOrder, MemoryWindow, Region, StoreOrder};
use loom::sync::atomic::{AtomicU32, Ordering};

/// Two rows of one value; what only the beginning writes is ordinary memory.
const BYTES: u32 = ring_bytes(1, 1, 2);

#[derive(Clone)]
struct Memory(Arc<Vec<Word>>);

enum Word {
    Seen(AtomicU32),
    Plain(std::sync::atomic::AtomicU32),
}

#[derive(Debug)]
struct MemoryError(WindowErrorKind);

impl WindowError for MemoryError {
    fn kind(&self) -> WindowErrorKind {
        self.0
    }
}

impl Memory {
    fn new() -> Self {
        // The newest sequence, and the rows but for the seven words of their selections that stay 0.
        let rows = ring_bytes(1, 1, 0);
        let row_bytes = ring_bytes(1, 1, 1) - rows;
        let is_seen = |offset: u32| {
            let of_row = offset.checked_sub(rows).map(|within| within % row_bytes);
            offset == 64 || of_row.is_some_and(|at| !(16..44).contains(&at))
        };
        let word = |offset| {
            if is_seen(offset) {
                Word::Seen(AtomicU32::new(0))
            } else {
                Word::Plain(0.into())
            }
        };
        Self(Arc::new((0..BYTES).step_by(4).map(word).collect()))
    }
}

impl MemoryWindow for Memory {
    type Error = MemoryError;

    fn size(&self) -> u32 {
        BYTES
    }

    fn load(&self, offset: u32, order: LoadOrder) -> Result<u32, MemoryError> {
        self.check(offset, 4)?;
        Ok(match &self.0[offset as usize / 4] {
            Word::Seen(word) => word.load(order.into()),
            Word::Plain(word) => word.load(Ordering::Relaxed),
        })
    }

    fn store(&self, offset: u32, value: u32, order: StoreOrder) -> Result<(), MemoryError> {
        self.check(offset, 4)?;
        match &self.0[offset as usize / 4] {
            Word::Seen(word) => word.store(value, order.into()),
            Word::Plain(word) => word.store(value, Ordering::Relaxed),
        }
        Ok(())
    }

    fn check(&self, offset: u32, len: usize) -> Result<(), MemoryError> {
        check_access(BYTES, offset, len).map_err(MemoryError)
    }
}

/// The writer writes `last` rows while the reader looks `looks` times; at most `preemptions` if given.
fn watched(last: u32, looks: u32, preemptions: Option<usize>) {
    let mut model = loom::model::Builder::new();
    model.preemption_bound = preemptions;
    model.check(move || {
        let memory = Memory::new();
        let variable = Variable::new(format_args!("v"), "", Kind::Bits);
        let variables = core::iter::once(variable);
        let mut ring = Ring::new(Region::whole(memory.clone()), 400, variables, 1).unwrap();
        let mut reader = MonitorReader::open(Region::whole(memory)).unwrap();
        let selection = Selection::new([0], 1).unwrap();
        let writing = loom::thread::spawn(move || {
            for tick in 0..last {
                let value = core::iter::once(100 + tick);
                ring.write(tick, &selection, value).unwrap();
            }
        });
        let (mut next, mut count) = (0, 0);
        let mut take = |reader: &mut MonitorReader<Memory>| {
            let row = reader.read().unwrap();
            if let Some(row) = &row {
                assert_eq!(row.word(0), Some(100 + row.tick), "a mixture");
                assert_eq!(row.tick, next + row.lost);
                next = row.tick + 1;
                count += 1;
            }
            row.is_some()
        };
        for _ in 0..looks {
            take(&mut reader);
        }
        writing.join().unwrap();
        while take(&mut reader) {}
        assert_eq!(count + reader.lost(), u64::from(last));
    });
}

/// Unbounded. Fails if either side's accesses to the words of a row are Relaxed.
#[test]
fn a_row_is_overwritten_while_it_is_copied() {
    watched(3, 1, None);
}

/// At most three preemptions.
#[test]
fn two_looks_at_more_rows() {
    watched(4, 2, Some(3));
}
