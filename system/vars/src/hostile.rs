//! A scenario of a table's owner and a watcher in a hostile window: any word may be overwritten, and any load
//! may return another word. The events come from bytes, so that a fuzzer can choose them.

use std::cell::Cell;

use crate::{
    Catalog, Param, Respond, Sampler, Selections, Tune, Var, VariableServer, VariableSettings,
    VariableTable, Vars, Watch, Watcher,
};
use condor_mbox::sim::SimWindow;
use condor_mbox::{
    AccessError, Allocator, CriticalSection, Instant, LoadOrder, MemoryWindow, Processor, Region,
    StoreOrder,
};

/// The offset of the table in the window. All words outside of the table must keep the value `CANARY`.
const OFFSET: u32 = 64;
const CANARY: u32 = 0xdead_beef;
const BYTES: u32 = 1024;

/// A window whose loads return another word now and then.
#[derive(Clone)]
struct Haunted<'m> {
    window: SimWindow,
    script: &'m Script<'m>,
}

/// The events that have not happened yet.
struct Script<'s> {
    bytes: Cell<&'s [u8]>,
    /// The number of loads since the last step.
    looks: Cell<u32>,
}

impl Script<'_> {
    fn byte(&self) -> u8 {
        match self.bytes.get() {
            [first, rest @ ..] => {
                self.bytes.set(rest);
                *first
            }
            [] => 0,
        }
    }

    /// Returns a word that is close to a limit, or any word.
    fn word(&self) -> u32 {
        let near = u32::from(self.byte());
        match self.byte() % 8 {
            0 => near,
            1 => near.wrapping_neg(),
            2 => 0x8000_0000_u32.wrapping_sub(near),
            3 => 1 << (near % 32),
            4 => near * 64,
            5 => near << 8 | u32::from(self.byte()),
            _ => u32::from_le_bytes([near as u8, self.byte(), self.byte(), self.byte()]),
        }
    }
}

impl MemoryWindow for Haunted<'_> {
    type Error = AccessError;

    fn size(&self) -> u32 {
        self.window.size()
    }

    fn load(&self, offset: u32, order: LoadOrder) -> Result<u32, AccessError> {
        let word = self.window.load(offset, order)?;
        let script = self.script;
        script.looks.set(script.looks.get() + 1);
        if !script.bytes.get().is_empty() && script.byte().is_multiple_of(16) {
            return Ok(script.word());
        }
        Ok(word)
    }

    fn store(&self, offset: u32, value: u32, order: StoreOrder) -> Result<(), AccessError> {
        self.window.store(offset, value, order)
    }

    fn check(&self, offset: u32, len: usize) -> Result<(), AccessError> {
        self.window.check(offset, len)
    }
}

type Handler<'e> = VariableServer<'e, SimWindow, CriticalSection, 2>;
type Loop<'e> = Sampler<'e, SimWindow, 2>;

/// Runs a scenario of a loop and of programs that watch it and set its parameters. Each step of the
/// scenario is taken from `bytes`, the input of a fuzz target.
///
/// # Panics
/// Panics if the owner of the table or a watching program breaks a guarantee of this crate.
pub fn run(bytes: &[u8]) {
    let script = Script {
        bytes: Cell::new(bytes),
        looks: Cell::new(0),
    };
    let window = SimWindow::new(BYTES);
    for at in (0..BYTES).step_by(4) {
        window.store(at, CANARY, StoreOrder::Relaxed).unwrap();
    }
    let pair = Vars::<u32, 2>::numbered("pair", "N");
    let long = Var::<f64>::new("long", "m").about("Of two words.");
    let param = Param::<i8>::new("param", "", 0, -5..=5);
    let (watched, params): ([&dyn Watch; 2], [&dyn Tune; 1]) = ([&pair, &long], [&param]);
    let catalog = Catalog::new(&watched, &params);
    let mut selections = Selections::<2>::new();
    let own = Region::whole(window.clone());
    let table_bytes = catalog.bytes(2, 2).unwrap();
    for at in (OFFSET..OFFSET + table_bytes).step_by(4) {
        own.store(at, 0, StoreOrder::Relaxed).unwrap();
    }
    let mut allocator = Allocator::new(own.size());
    allocator.bytes(OFFSET as usize).unwrap();
    let settings = VariableSettings {
        rate: (400, 1),
        rows: 2,
        watchers: 2,
    };
    let (server, sampler): (Handler<'_>, Loop<'_>) = selections
        .open(
            catalog,
            &own,
            &mut allocator,
            &settings,
            CriticalSection,
            &|_| 1,
        )
        .unwrap();
    // The watcher's window shows the table alone.
    let haunted = Haunted {
        window: window.clone(),
        script: &script,
    };
    let users = Region::whole(haunted).part(OFFSET, table_bytes).unwrap();
    play(&script, &own, table_bytes, &server, sampler, &users);
    assert!((-5..=5).contains(&param.get()));
    let around = (0..OFFSET).chain(OFFSET + table_bytes..BYTES);
    for at in around.filter(|at| at % 4 == 0) {
        assert_eq!(window.load(at, LoadOrder::Relaxed).unwrap(), CANARY);
    }
}

fn play(
    script: &Script<'_>,
    own: &Region<SimWindow>,
    table_bytes: u32,
    server: &Handler<'_>,
    mut sampler: Loop<'_>,
    users: &Region<Haunted<'_>>,
) {
    let mut table = VariableTable::open(users, 0).ok();
    let mut watcher = None;
    let mut tick = 0;
    while !script.bytes.get().is_empty() {
        script.looks.set(0);
        match script.byte() % 8 {
            0 | 1 => {
                let at = u32::from(script.byte()) * 4 % table_bytes;
                own.store(OFFSET + at, script.word(), StoreOrder::Relaxed)
                    .unwrap();
            }
            2 => {
                sampler.begin().unwrap();
                sampler.end(tick, Instant::from_ns(tick)).unwrap();
                tick += 1;
            }
            3 | 4 => {
                let operation = u32::from(script.byte() % 6);
                let number = u32::from(script.byte() % 5);
                let rest = [0; 4].map(|_: u32| script.word());
                let [a, b, c, d] = rest.map(|word| if word > 1 << 30 { word } else { word % 4 });
                let request = [operation, OFFSET, 1, number, a, b, c, d];
                let response = server.respond(Processor(1), &request);
                assert!(response[0] <= 12);
            }
            5 => table = VariableTable::open(users, 0).ok().or(table),
            6 => {
                if let Some(table) = &table {
                    look(script, table);
                }
            }
            _ => {
                if let Some(table) = &table {
                    let slot = u32::from(script.byte() % 3);
                    watcher =
                        Watcher::new(table.clone(), slot, u32::from(script.byte() % 4)).or(watcher);
                }
                if let Some(watcher) = &mut watcher {
                    watch(script, watcher);
                }
            }
        }
        // The longest call reads all entries of a table with all their texts.
        assert!(script.looks.get() < 100_000, "a call does not end");
    }
}

fn look<W: MemoryWindow>(script: &Script<'_>, table: &VariableTable<W>) {
    let number = script.word() % (table.len() + 1);
    if let Ok(entry) = table.entry(number) {
        assert!(
            entry.name.len() <= crate::layout::NAME_BYTES
                && entry.unit.len() <= 32
                && entry.about.len() <= 128
        );
        let _ = table.label(&entry, script.word());
    }
    let _ = table.find("param");
}

fn watch<W: MemoryWindow>(script: &Script<'_>, watcher: &mut Watcher<W>) {
    if script.byte().is_multiple_of(2) {
        let entries = [script.word() % 8, script.word() % 8, script.word()];
        let chosen = watcher.choose(&entries[..usize::from(script.byte() % 4)]);
        let words = chosen.unwrap_or_else(|_| script.word());
        watcher.follow(script.word(), words);
    }
    let mut values = [0; 16];
    for _ in 0..3 {
        let lost = watcher.lost();
        if let Ok(Some(row)) = watcher.read(&mut values) {
            assert!(row.words <= values.len());
            assert!(watcher.lost() - lost <= u32::MAX.into());
        }
    }
}
