//! [`Cache`]: what a processor sees of memory that no hardware keeps coherent.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::layout::LINE;
use crate::sync::{AtomicU32, Ordering};

/// Words of a line.
const WORDS: usize = LINE as usize / 4;

/// The data cache of one processor: it fetches lines whole, keeps what was written until it is cleaned
/// or evicted, and at random evicts lines, and fetches lines that nobody asked for.
pub(super) struct Cache(Mutex<State>);

struct State {
    lines: BTreeMap<(usize, usize), Line>,
    random: u64,
}

#[derive(Clone, Copy)]
struct Line {
    words: [u32; WORDS],
    dirty: bool,
}

impl Cache {
    pub(super) fn new(seed: u64) -> Self {
        Self(Mutex::new(State {
            lines: BTreeMap::new(),
            random: seed | 1,
        }))
    }

    /// Reads a word, or writes one if there is a `new` one; returns what was there.
    pub(super) fn access(&self, memory: &[AtomicU32], at: usize, new: Option<u32>) -> u32 {
        let mut state = self.lock();
        state.mischief(memory, at / WORDS);
        let line = state.line(memory, at / WORDS);
        let found = line.words[at % WORDS];
        if let Some(new) = new {
            line.words[at % WORDS] = new;
            line.dirty = true;
        }
        found
    }

    pub(super) fn clean(&self, memory: &[AtomicU32], lines: Range<usize>) {
        let mut state = self.lock();
        for at in lines {
            if let Some(line) = state.lines.get_mut(&(key(memory), at))
                && core::mem::take(&mut line.dirty)
            {
                write_back(memory, at, line);
            }
        }
    }

    pub(super) fn invalidate(&self, memory: &[AtomicU32], lines: Range<usize>) {
        let mut state = self.lock();
        for at in lines {
            state.lines.remove(&(key(memory), at));
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn line(&mut self, memory: &[AtomicU32], at: usize) -> &mut Line {
        let entry = self.lines.entry((key(memory), at));
        entry.or_insert_with(|| fetch(memory, at))
    }

    /// What a cache may do at any time: evict a line of this memory, or fetch one.
    fn mischief(&mut self, memory: &[AtomicU32], near: usize) {
        let chance = self.next();
        let others = memory.len().div_ceil(WORDS);
        // Mostly the lines around, which are the ones in use.
        let at = if chance & 8 == 0 {
            near
        } else {
            (chance >> 16) as usize % others
        };
        match chance % 8 {
            0 | 1 => {
                if let Some(line) = self.lines.remove(&(key(memory), at))
                    && line.dirty
                {
                    write_back(memory, at, &line);
                }
            }
            2 | 3 => {
                self.line(memory, at);
            }
            _ => {}
        }
    }

    /// A pseudo-random number: Marsaglia, "Xorshift RNGs", Journal of Statistical Software 8, 2003.
    fn next(&mut self) -> u64 {
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        self.random >> 8
    }
}

/// Which memory a line is of.
fn key(memory: &[AtomicU32]) -> usize {
    memory.as_ptr().addr()
}

fn fetch(memory: &[AtomicU32], at: usize) -> Line {
    let mut words = [0; WORDS];
    for (word, from) in words.iter_mut().zip(memory.iter().skip(at * WORDS)) {
        *word = from.load(Ordering::Acquire);
    }
    Line {
        words,
        dirty: false,
    }
}

fn write_back(memory: &[AtomicU32], at: usize, line: &Line) {
    for (word, to) in line.words.iter().zip(memory.iter().skip(at * WORDS)) {
        to.store(*word, Ordering::Release);
    }
}
