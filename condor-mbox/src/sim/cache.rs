//! [`Cache`]: what a processor sees of memory that no hardware keeps coherent.

use std::ops::Range;
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::layout::LINE;
use crate::sync::{AtomicU32, Ordering};

/// Words of a line.
const WORDS: usize = LINE as usize / 4;

/// The data cache of one processor: it fetches lines whole, keeps what was written until it is cleaned
/// or evicted, and at random evicts lines, and fetches lines that nobody asked for.
pub(super) struct Cache(Mutex<CacheState>);

struct CacheState {
    /// The lines of each memory, found by its address.
    memories: Vec<(usize, Vec<Line>)>,
    random: u64,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum CachedWord {
    Not,
    Clean,
    Dirty,
}

#[derive(Clone, Copy)]
struct Line {
    words: [u32; WORDS],
    held: CachedWord,
}

impl Cache {
    pub(super) fn new(seed: u64) -> Self {
        Self(Mutex::new(CacheState {
            memories: Vec::new(),
            random: seed | 1,
        }))
    }

    /// Invalidates the line of a word, and then reads the word, or writes it if there is a `new` one;
    /// returns what was there.
    pub(super) fn access(&self, memory: &[AtomicU32], at: usize, new: Option<u32>) -> u32 {
        let mut state = self.lock();
        let chance = state.next();
        let lines = state.lines(memory);
        lines[at / WORDS].held = CachedWord::Not;
        mischief(memory, lines, at / WORDS, chance);
        let line = hold(memory, lines, at / WORDS);
        let found = line.words[at % WORDS];
        if let Some(new) = new {
            line.words[at % WORDS] = new;
            line.held = CachedWord::Dirty;
        }
        found
    }

    pub(super) fn clean(&self, memory: &[AtomicU32], range: Range<usize>) {
        let mut state = self.lock();
        let lines = state.lines(memory);
        for at in range {
            if lines[at].held == CachedWord::Dirty {
                write_back(memory, at, &lines[at]);
                lines[at].held = CachedWord::Clean;
            }
        }
    }

    pub(super) fn invalidate(&self, memory: &[AtomicU32], range: Range<usize>) {
        for line in &mut self.lock().lines(memory)[range] {
            line.held = CachedWord::Not;
        }
    }

    fn lock(&self) -> MutexGuard<'_, CacheState> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl CacheState {
    /// Those of `memory`, held or not.
    fn lines(&mut self, memory: &[AtomicU32]) -> &mut [Line] {
        let address = memory.as_ptr().addr();
        let count = memory.len().div_ceil(WORDS);
        let mut known = self.memories.iter();
        let known = known.position(|(of, lines)| *of == address && lines.len() == count);
        let index = known.unwrap_or_else(|| {
            let nothing = Line {
                words: [0; WORDS],
                held: CachedWord::Not,
            };
            let lines = vec![nothing; count];
            self.memories.push((address, lines));
            self.memories.len() - 1
        });
        &mut self.memories[index].1
    }

    /// A pseudo-random number: Marsaglia, "Xorshift RNGs", Journal of Statistical Software 8, 2003.
    fn next(&mut self) -> u64 {
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        self.random >> 8
    }
}

/// The line with what it holds, fetched if it held nothing.
fn hold<'l>(memory: &[AtomicU32], lines: &'l mut [Line], at: usize) -> &'l mut Line {
    let line = &mut lines[at];
    if line.held == CachedWord::Not {
        line.held = CachedWord::Clean;
        for (word, from) in line.words.iter_mut().zip(memory.iter().skip(at * WORDS)) {
            *word = from.load(Ordering::Acquire);
        }
    }
    line
}

/// Does something that a cache may do at any time: evicts a line of this memory, or fetches one.
fn mischief(memory: &[AtomicU32], lines: &mut [Line], near: usize, chance: u64) {
    // Mostly the lines around, which are the ones in use.
    let at = if chance & 8 == 0 {
        near
    } else {
        (chance >> 16) as usize % lines.len()
    };
    match chance % 8 {
        0 | 1 => {
            if lines[at].held == CachedWord::Dirty {
                write_back(memory, at, &lines[at]);
            }
            lines[at].held = CachedWord::Not;
        }
        2 | 3 => {
            hold(memory, lines, at);
        }
        _ => {}
    }
}

fn write_back(memory: &[AtomicU32], at: usize, line: &Line) {
    for (word, to) in line.words.iter().zip(memory.iter().skip(at * WORDS)) {
        to.store(*word, Ordering::Release);
    }
}
