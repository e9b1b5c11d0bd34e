//! The notes of the entry of interrupts: a [`VectorRecord`] for each vector of boards, and [`Interrupts`].

use core::num::NonZeroU32;
#[cfg(condor_loom)]
use core::sync::atomic::AtomicU32;

use crate::interrupt::InterruptVector;
#[cfg(not(condor_loom))]
use crate::sync::AtomicU32;
use crate::sync::{Ordering::Relaxed, masked};

/// The number of times in a row that a vector may interrupt without any of its boards having asked for it.
const PATIENCE: u32 = 16;
/// The number of interrupts of one vector that are served in a storm, and of boards that are polled for one
/// interrupt.
pub(crate) const ENDLESS: u32 = 10_000;
/// The number of different vectors without a driver that are told apart.
const STRANGERS: usize = 8;

/// Counts of interrupts by outcome, from [`Switch::interrupt_counts`](crate::Switch::interrupt_counts). The counts
/// wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InterruptCounts {
    /// Interrupts of a board that had asked for one and was served.
    pub served: u32,
    /// Interrupts for which the controller had nothing to claim.
    pub spurious: u32,
    /// Interrupts of a vector that belongs to boards, none of which had asked.
    pub unclaimed: u32,
    /// Interrupts of a vector that belongs to no board.
    pub unhandled: u32,
    /// Vectors that were disabled because their interrupts did not end; [`Switch::stuck`](crate::Switch::stuck) names
    /// them.
    pub stuck: u32,
}

/// The counts of one interrupt vector, and which of its boards is polled first.
///
/// Only the context that has claimed the vector writes the record, until it completes the vector.
#[derive(Debug)]
pub struct VectorRecord {
    /// The number of the board that is polled first the next time.
    turn: AtomicU32,
    served: AtomicU32,
    unclaimed: AtomicU32,
    /// The number of times in a row that none of its boards had asked.
    unclaimed_in_a_row: AtomicU32,
    /// The number of times it came since its entry has lost its calm.
    storm: AtomicU32,
    stuck: AtomicU32,
}

impl VectorRecord {
    /// Makes the record of a vector that has not interrupted yet: all counts are 0.
    #[must_use]
    #[allow(
        clippy::new_without_default,
        reason = "only `device_switch!` makes them"
    )]
    pub const fn new() -> Self {
        Self {
            turn: AtomicU32::new(0),
            served: AtomicU32::new(0),
            unclaimed: AtomicU32::new(0),
            unclaimed_in_a_row: AtomicU32::new(0),
            storm: AtomicU32::new(0),
            stuck: AtomicU32::new(0),
        }
    }

    /// Returns the board that is polled first, and takes the one behind it the next time.
    #[inline]
    pub(crate) fn next(&self, boards: NonZeroU32) -> usize {
        let turn = self.turn.load(Relaxed) % boards;
        self.turn.store(turn + 1, Relaxed);
        turn as usize
    }

    /// Begins to count the interrupts of a storm.
    #[inline]
    pub(crate) fn calm(&self) {
        self.storm.store(0, Relaxed);
    }

    /// Counts an interrupt; says whether the vector is to be disabled.
    #[inline]
    pub(crate) fn is_stuck(&self, answer: Answer, storm: bool) -> bool {
        let mut stuck = answer == Answer::Endless;
        if answer == Answer::Nobody {
            count(&self.unclaimed);
            stuck |= count(&self.unclaimed_in_a_row) >= PATIENCE;
        } else {
            count(&self.served);
            self.unclaimed_in_a_row.store(0, Relaxed);
        }
        stuck |= storm && count(&self.storm) >= ENDLESS;
        if stuck {
            self.unclaimed_in_a_row.store(0, Relaxed);
            self.storm.store(0, Relaxed);
            count(&self.stuck);
        }
        stuck
    }

    /// The number of times the vector was disabled.
    pub(crate) fn stuck(&self) -> u32 {
        self.stuck.load(Relaxed)
    }
}

/// The entry's notes of everything else. Any context may write: in critical sections.
pub(crate) struct Interrupts {
    spurious: AtomicU32,
    /// Vector + 1 and count of each vector that no board has.
    strangers: [(AtomicU32, AtomicU32); STRANGERS],
    /// The number of interrupts by vectors for which there was no place.
    others: AtomicU32,
    /// The number of times a stranger was disabled.
    stuck: AtomicU32,
}

/// Adds one and returns the sum.
fn count(word: &AtomicU32) -> u32 {
    let sum = word.load(Relaxed).wrapping_add(1);
    word.store(sum, Relaxed);
    sum
}

impl Interrupts {
    pub(crate) const fn new() -> Self {
        Self {
            spurious: AtomicU32::new(0),
            strangers: [const { (AtomicU32::new(0), AtomicU32::new(0)) }; STRANGERS],
            others: AtomicU32::new(0),
            stuck: AtomicU32::new(0),
        }
    }

    #[inline]
    pub(crate) fn count_spurious(&self) {
        masked(|| count(&self.spurious));
    }

    /// Counts an interrupt that no board has; says whether its vector is to be disabled.
    #[cold]
    pub(crate) fn is_stuck(&self, vector: InterruptVector) -> bool {
        let name = u32::from(vector.0) + 1;
        masked(|| {
            let known = self.strangers.iter().find(|(known, _)| {
                let found = known.load(Relaxed);
                found == name || found == 0
            });
            let stuck = if let Some((known, counted)) = known {
                known.store(name, Relaxed);
                count(counted).is_multiple_of(PATIENCE)
            } else {
                // Nobody can tell how often this one came.
                count(&self.others);
                true
            };
            if stuck {
                count(&self.stuck);
            }
            stuck
        })
    }

    /// The vectors that no board has, as far as they are told apart, and how often each came.
    pub(crate) fn strangers(&self) -> impl Iterator<Item = (InterruptVector, u32)> + '_ {
        self.strangers.iter().filter_map(|(known, counted)| {
            let vector = known.load(Relaxed).checked_sub(1)?;
            Some((InterruptVector(vector as u16), counted.load(Relaxed)))
        })
    }
}

impl InterruptCounts {
    pub(crate) fn of(lines: &[VectorRecord], interrupts: &Interrupts) -> Self {
        let sum = |words: &mut dyn Iterator<Item = &AtomicU32>| {
            words.fold(0, |sum: u32, word| sum.wrapping_add(word.load(Relaxed)))
        };
        let lines = || lines.iter();
        let strangers = interrupts.strangers.iter().map(|(_, counted)| counted);
        Self {
            served: sum(&mut lines().map(|line| &line.served)),
            spurious: interrupts.spurious.load(Relaxed),
            unclaimed: sum(&mut lines().map(|line| &line.unclaimed)),
            unhandled: sum(&mut strangers.chain([&interrupts.others])),
            stuck: sum(&mut lines().map(|line| &line.stuck).chain([&interrupts.stuck])),
        }
    }
}

/// The boards of a vector that had asked.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Answer {
    Nobody,
    Somebody,
    /// At least one board, again and again.
    Endless,
}
