//! Ten thousand random interleavings of a loop, three watchers that also set a parameter, their deaths
//! and restarts of the owner, against a model that knows what each of them must see.

use std::thread;

use condor_mbox::Processor;
use condor_vars::{
    AnyValue, Catalog, Param, RequestError, Tune, Var, VariableTable, VariableTableError, Vars,
    Watch, WatchError, Watcher,
};

use crate::support::{Loop, OWNER, Post, Rig, SLOTS, TIMEOUT, Window, released};

const CASES: u64 = 10_000;
const STEPS: u32 = 50;
const THREADS: u64 = 4;
const WATCHERS: usize = 3;
/// Of the entries below: two words, one by one, then one of 64 bits, then the parameter.
const KINDS: [usize; 4] = [1, 1, 2, 1];

/// Numbers that are the same in every run (xorshift).
struct Chance(u64);

impl Chance {
    fn below(&mut self, end: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) % end
    }
}

/// Tells which case failed.
struct Case(u64);

impl Drop for Case {
    fn drop(&mut self) {
        if thread::panicking() {
            eprintln!("case {}", self.0);
        }
    }
}

struct Shown {
    pair: Vars<u32, 2>,
    long: Var<u64>,
    param: Param<i32>,
}

/// A watcher's program, while it lives.
struct Program {
    mailbox: Post,
    watcher: Option<(Watcher<Window>, Claimed)>,
    table: VariableTable<Window>,
}

/// What a watcher must know of its slot.
#[derive(Clone)]
struct Claimed {
    slot: usize,
    claim: u64,
    /// Which entries, and the number of the next row.
    selected: Option<(Vec<u32>, usize)>,
    lost: u64,
}

/// What the owner must know of a slot.
#[derive(Clone, Default)]
struct Slot {
    /// The watcher, how often its program had been started, and the claim.
    owner: Option<(usize, u32, u64)>,
    asked: Option<(Vec<u32>, u64)>,
    is_selected: bool,
    every: u64,
    wait: u64,
    /// The ticks of all rows of the selection.
    rows: Vec<u64>,
}

struct World<'r> {
    rig: &'r Rig,
    chance: Chance,
    shown: &'static Shown,
    sampler: Loop,
    /// Of every tick the parameter.
    ticks: Vec<i32>,
    incarnation: u32,
    wanted: i32,
    slots: [Slot; SLOTS],
    programs: [Option<Program>; WATCHERS],
    starts: [u32; WATCHERS],
    claims: u64,
}

fn owner(rig: &Rig) -> (&'static Shown, Loop) {
    let shown: &'static Shown = Box::leak(Box::new(Shown {
        pair: Vars::named(&["first", "second"], ""),
        long: Var::new("long", ""),
        param: Param::new("param", "", 0, -100..=100),
    }));
    let watched: [&dyn Watch; 2] = [&shown.pair, &shown.long];
    let params: [&dyn Tune; 1] = [&shown.param];
    let catalog = Catalog::new(Box::leak(Box::new(watched)), Box::leak(Box::new(params)));
    (shown, rig.start(catalog, 4))
}

/// The words of an entry in a tick.
fn words(entry: u32, tick: u64, param: i32) -> Vec<u32> {
    let low = tick as u32;
    match entry {
        0 | 1 => vec![3 * low + entry],
        2 => vec![low, !low],
        _ => vec![param.cast_unsigned()],
    }
}

impl World<'_> {
    fn tick(&mut self) {
        let tick = self.ticks.len() as u64;
        self.sampler.begin().unwrap();
        assert_eq!(self.shown.param.get(), self.wanted);
        self.ticks.push(self.wanted);
        let low = tick as u32;
        self.shown.pair.set_all(&[3 * low, 3 * low + 1]);
        self.shown.long.set(u64::from(!low) << 32 | u64::from(low));
        self.sampler.end(tick, released(tick)).unwrap();
        for slot in &mut self.slots {
            if let Some((entries, every)) = slot.asked.take() {
                slot.is_selected = !entries.is_empty();
                (slot.every, slot.wait) = (every, 0);
                slot.rows.clear();
            }
            if slot.is_selected && slot.wait == 0 {
                slot.rows.push(tick);
                slot.wait = slot.every;
            }
            slot.wait = slot.wait.saturating_sub(1);
        }
    }

    fn restart(&mut self) {
        (self.shown, self.sampler) = owner(self.rig);
        self.incarnation += 1;
        self.wanted = 0;
        self.slots = Default::default();
    }

    fn kill_or_start(&mut self, number: usize) {
        let processor = Processor(number as u8 + 1);
        if let Some(program) = self.programs[number].take() {
            self.rig.system.kill(processor);
            std::mem::forget(program.mailbox);
        } else {
            let mailbox = self.rig.join(processor);
            self.starts[number] += 1;
            let table = self.rig.table();
            self.programs[number] = Some(Program {
                mailbox,
                watcher: None,
                table,
            });
        }
    }

    /// The error of everything that is asked of a former incarnation.
    fn restarted(&self, table: &VariableTable<Window>) -> Option<VariableTableError> {
        let (found, expected) = (self.incarnation, table.incarnation());
        (found != expected).then_some(VariableTableError::Restarted { found, expected })
    }

    fn open_or_claim(&mut self, number: usize) {
        let Some(mut program) = self.programs[number].take() else {
            return;
        };
        program.watcher = None;
        let restarted = self.restarted(&program.table);
        let result = self
            .rig
            .client(&program.mailbox)
            .claim(&program.table, TIMEOUT);
        if let Some(restarted) = restarted {
            assert_eq!(result.err(), Some(restarted.into()));
            program.table = self.rig.table();
            assert_eq!(program.table.incarnation(), self.incarnation);
        } else {
            let lives = |&(watcher, start, _): &(usize, u32, u64)| {
                let is_started = watcher == number || self.programs[watcher].is_some();
                is_started && self.starts[watcher] == start
            };
            let free = self
                .slots
                .iter()
                .position(|slot| !slot.owner.as_ref().is_some_and(lives));
            if let Some(slot) = free {
                self.claims += 1;
                self.slots[slot].owner = Some((number, self.starts[number], self.claims));
                let claimed = Claimed {
                    slot,
                    claim: self.claims,
                    selected: None,
                    lost: 0,
                };
                program.watcher = Some((result.unwrap(), claimed));
            } else {
                let slots = SLOTS as u32;
                assert_eq!(result.err(), Some(RequestError::NoSlot { slots }));
            }
        }
        self.programs[number] = Some(program);
    }

    fn select(&mut self, number: usize) {
        let mask = self.chance.below(16);
        let every = self.chance.below(3) + 1;
        let restarted = self.incarnation;
        let Some(Program {
            mailbox,
            watcher: Some((watcher, claimed)),
            ..
        }) = &mut self.programs[number]
        else {
            return;
        };
        let entries: Vec<u32> = (0..4).filter(|entry| mask >> entry & 1 != 0).collect();
        let mut client = self.rig.client(mailbox);
        let result = client.select(watcher, &entries, every as u32, TIMEOUT);
        claimed.selected = None;
        let slot = &mut self.slots[claimed.slot];
        let expected = watcher.table().incarnation();
        if expected != restarted {
            let found = restarted;
            let error = VariableTableError::Restarted { found, expected };
            assert_eq!(result, Err(error.into()));
        } else if slot.owner.is_none_or(|owner| owner.2 != claimed.claim) {
            let slot = claimed.slot as u32;
            assert_eq!(result, Err(RequestError::Displaced { slot }));
        } else if slot.asked.is_some() {
            let (to, timeout) = (OWNER, TIMEOUT);
            assert_eq!(result, Err(RequestError::Busy { to, timeout }));
        } else {
            assert_eq!(result, Ok(()));
            let words: usize = entries.iter().map(|entry| KINDS[*entry as usize]).sum();
            assert_eq!(watcher.words(), words);
            slot.asked = Some((entries.clone(), every));
            claimed.selected = Some((entries, 0));
        }
    }

    fn read(&mut self, number: usize) {
        let Some(Program {
            watcher: Some((watcher, claimed)),
            ..
        }) = &mut self.programs[number]
        else {
            return;
        };
        let mut values = [0; 8];
        let result = watcher.read(&mut values);
        let Some((entries, next)) = &mut claimed.selected else {
            assert_eq!(result, Err(WatchError::Unselected));
            return;
        };
        let (found, expected) = (self.incarnation, watcher.table().incarnation());
        if found != expected {
            let error = VariableTableError::Restarted { found, expected };
            assert_eq!(result, Err(error.into()));
            return;
        }
        let slot = &self.slots[claimed.slot];
        if slot.owner.is_none_or(|owner| owner.2 != claimed.claim) {
            let slot = claimed.slot as u32;
            assert_eq!(result, Err(WatchError::Displaced { slot }));
            return;
        }
        let row = result.unwrap();
        if slot.asked.is_some() {
            assert_eq!(row, None, "it is not in force yet");
            return;
        }
        let place = (*next).max(slot.rows.len().saturating_sub(watcher.rows() as usize));
        let Some(tick) = slot.rows.get(place).copied() else {
            assert_eq!(row, None, "there is no more");
            return;
        };
        let row = row.unwrap();
        assert_eq!((row.tick, row.released), (tick, released(tick)));
        assert_eq!(row.lost as usize, place - *next);
        claimed.lost += u64::from(row.lost);
        assert_eq!(watcher.lost(), claimed.lost);
        let param = self.ticks[tick as usize];
        let expected: Vec<u32> = entries
            .iter()
            .flat_map(|entry| words(*entry, tick, param))
            .collect();
        assert_eq!(values[..row.words], expected);
        *next = place + 1;
    }

    fn release(&mut self, number: usize) {
        let Some(mut program) = self.programs[number].take() else {
            return;
        };
        if let Some((mut watcher, claimed)) = program.watcher.take() {
            let restarted = self.restarted(watcher.table());
            let result = self
                .rig
                .client(&program.mailbox)
                .release(&mut watcher, TIMEOUT);
            let slot = &mut self.slots[claimed.slot];
            if let Some(restarted) = restarted {
                assert_eq!(result, Err(restarted.into()));
            } else if slot.asked.is_some() {
                assert!(matches!(result, Err(RequestError::Busy { .. })));
                program.watcher = Some((
                    watcher,
                    Claimed {
                        selected: None,
                        ..claimed
                    },
                ));
            } else {
                assert_eq!(result, Ok(()));
                slot.owner = None;
                slot.asked = Some((Vec::new(), 1));
            }
        }
        self.programs[number] = Some(program);
    }

    fn set(&mut self, number: usize) {
        let new = self.chance.below(240) as i32 - 120;
        let is_stale = self.chance.below(4) == 0;
        let Some(program) = &self.programs[number] else {
            return;
        };
        let restarted = self.restarted(&program.table);
        let Ok(entry) = program.table.entry(3) else {
            assert!(restarted.is_some());
            return;
        };
        let expected = if is_stale {
            self.wanted + 1
        } else {
            self.wanted
        };
        let [before, after] = [expected, new].map(|value| AnyValue::Int(value.into()));
        let mut client = self.rig.client(&program.mailbox);
        let result = client.set(&program.table, &entry, before, after, TIMEOUT);
        assert_eq!(restarted, None);
        if new.abs() > 100 {
            let (least, greatest) = (AnyValue::Int(-100), AnyValue::Int(100));
            assert_eq!(result, Err(RequestError::OutOfBounds { least, greatest }));
        } else if is_stale {
            let present = AnyValue::Int(self.wanted.into());
            assert_eq!(result, Err(RequestError::Conflict { present }));
        } else {
            assert_eq!(result, Ok(()));
            self.wanted = new;
        }
        let present = client.get(&program.table, &entry, TIMEOUT);
        assert_eq!(present, Ok(AnyValue::Int(self.wanted.into())));
    }

    fn step(&mut self) {
        let number = self.chance.below(WATCHERS as u64) as usize;
        match self.chance.below(32) {
            8..17 => self.read(number),
            17..21 => self.select(number),
            21..24 => self.open_or_claim(number),
            24..27 => self.set(number),
            27 => self.release(number),
            28..30 => self.kill_or_start(number),
            30 if self.chance.below(4) == 0 => self.restart(),
            _ => self.tick(),
        }
    }
}

#[test]
fn all_see_what_the_model_sees() {
    thread::scope(|threads| {
        for thread in 0..THREADS {
            threads.spawn(move || {
                let rig = Rig::new();
                let mut incarnation = 0;
                for case in (thread..CASES).step_by(THREADS as usize) {
                    let _case = Case(case);
                    let (shown, sampler) = owner(&rig);
                    incarnation += 1;
                    let mut world = World {
                        rig: &rig,
                        chance: Chance((case + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15)),
                        shown,
                        sampler,
                        ticks: Vec::new(),
                        incarnation,
                        wanted: 0,
                        slots: Default::default(),
                        programs: [const { None }; WATCHERS],
                        starts: [0; WATCHERS],
                        claims: 0,
                    };
                    for number in 0..WATCHERS {
                        world.kill_or_start(number);
                        world.open_or_claim(number);
                    }
                    for _ in 0..STEPS {
                        world.step();
                    }
                    incarnation = world.incarnation;
                    for number in 0..WATCHERS {
                        if world.programs[number].is_some() {
                            world.kill_or_start(number);
                        }
                    }
                }
            });
        }
    });
}
