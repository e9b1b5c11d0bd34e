//! A table in a window of which loom sees the words that matter, with an owner that is asked directly.

use std::sync::Arc;

use condor_mbox::window::{WindowError, WindowErrorKind, check_access};
use condor_mbox::{Allocator, Exclusion, LoadOrder, MemoryWindow, Processor, Region, StoreOrder};
use condor_vars::{
    Catalog, Respond, Sampler, Selections, VariableServer, VariableSettings, VariableTable, Watcher,
};
use loom::sync::Mutex;
use loom::sync::atomic::{AtomicU32, Ordering};

const BYTES: u32 = 512;

/// Words that loom sees, and words that only the beginning writes, or that are always 0.
#[derive(Clone)]
pub(crate) struct Memory(Arc<Vec<Word>>);

enum Word {
    Seen(AtomicU32),
    Plain(std::sync::atomic::AtomicU32),
}

#[derive(Debug)]
pub(crate) struct MemoryError(WindowErrorKind);

impl WindowError for MemoryError {
    fn kind(&self) -> WindowErrorKind {
        self.0
    }
}

impl Memory {
    pub(crate) fn new(is_seen: impl Fn(u32) -> bool) -> Self {
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

pub(crate) struct Section(Mutex<()>);

impl Exclusion for Section {
    fn with<R>(&self, body: impl FnOnce() -> R) -> R {
        let _alone = self.0.lock().unwrap();
        body()
    }
}

pub(crate) type Loop = Sampler<'static, Memory, 2>;
pub(crate) type Handler = VariableServer<'static, Memory, Section, 2>;

/// Opens a table of 2 rows of everything for one watcher, who has claimed its slot.
pub(crate) fn open(
    catalog: Catalog<'static>,
    memory: &Memory,
    incarnation: &'static (dyn Fn(Processor) -> u32 + Sync),
) -> (Handler, Loop, Watcher<Memory>) {
    let region = Region::whole(memory.clone());
    let mut allocator = Allocator::new(BYTES);
    let selections = Box::leak(Box::new(Selections::new()));
    let rate = (400, 1);
    let settings = VariableSettings {
        rate,
        rows: 2,
        watchers: 1,
    };
    let section = Section(Mutex::new(()));
    let (server, sampler) = selections
        .open(
            catalog,
            &region,
            &mut allocator,
            &settings,
            section,
            incarnation,
        )
        .unwrap();
    let table = VariableTable::open(&region, 0).unwrap();
    let [code, slot, claim, ..] = ask(&server, [1, 0, table.incarnation(), 0, 0, 0, 0, 0]);
    assert_eq!(code, 0);
    (server, sampler, Watcher::new(table, slot, claim).unwrap())
}

pub(crate) fn ask(server: &impl Respond, request: [u32; 8]) -> [u32; 8] {
    server.respond(Processor(1), &request)
}

/// Asks for a selection; its number and words, unless the loop has not taken the last one over.
pub(crate) fn select(
    server: &impl Respond,
    watcher: &mut Watcher<Memory>,
    entries: &[u32],
) -> Option<(u32, u32)> {
    let words = watcher.choose(entries).unwrap();
    let (slot, claim) = (watcher.slot(), watcher.claim());
    let incarnation = watcher.table().incarnation();
    match ask(server, [2, 0, incarnation, slot, claim, 1, 0, 0]) {
        [0, selection, found, ..] => {
            assert_eq!(found, words);
            Some((selection, words))
        }
        [1, ..] => None,
        other => panic!("{other:?}"),
    }
}
