//! Interrupts: one entry for all vectors (memo, section 3.1.1).

#[cfg(condor_loom)]
use core::sync::atomic::AtomicU32;

use crate::bus::Bus;
use crate::driver::{Attention, Driver};
use crate::interrupt::{InterruptController, Vector};
use crate::set::{DeviceSet, Link, Visitor};
use crate::switch::Switch;
#[cfg(not(condor_loom))]
use crate::sync::AtomicU32;
use crate::sync::{Ordering::Relaxed, masked};
use crate::unit::{Presence, Unit};

/// How often in a row a vector may interrupt without any of its boards having asked for it.
const PATIENCE: u32 = 16;
/// How many interrupts one entry serves before it looks who does not stop asking.
const CALM: u32 = 1000;
/// How many interrupts of one vector are served from then on, and how many boards are polled for
/// one interrupt.
const ENDLESS: u32 = 10_000;
/// How many different vectors without a driver are told apart.
const STRANGERS: usize = 8;

/// Counts of interrupts by outcome. They wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InterruptCounts {
    /// Interrupts of a board that had asked for one and was served.
    pub served: u32,
    /// Interrupts after which the controller had nothing to claim.
    pub spurious: u32,
    /// Interrupts of a known vector, none of whose boards had asked.
    pub unclaimed: u32,
    /// Interrupts of a vector that belongs to no board.
    pub unhandled: u32,
    /// Vectors that were disabled because their interrupts did not end; [`Switch::stuck`] names
    /// them.
    pub stuck: u32,
}

/// The record of one vector in the entry of interrupts.
///
/// Only the context that has claimed the vector writes it, until the vector is completed.
#[derive(Debug)]
pub struct Line {
    /// Who of its boards is polled first the next time.
    turn: AtomicU32,
    served: AtomicU32,
    unclaimed: AtomicU32,
    /// How often in a row none of its boards had asked.
    unclaimed_in_a_row: AtomicU32,
    /// How often it came since its entry has lost its calm.
    storm: AtomicU32,
    stuck: AtomicU32,
}

impl Line {
    /// Makes the record of a vector that has not interrupted.
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
}

/// What the entry notes of everything else. Any context may write: in critical sections.
pub(crate) struct Interrupts {
    spurious: AtomicU32,
    /// Vector + 1 and count of each vector that no board has.
    strangers: [(AtomicU32, AtomicU32); STRANGERS],
    /// How often others came for whom there was no place.
    others: AtomicU32,
    /// How often a stranger was disabled.
    stuck: AtomicU32,
}

/// Adds one and gives the sum.
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

    /// Counts an interrupt that no board has; says whether its vector is to be disabled.
    #[cold]
    fn is_stuck(&self, vector: Vector) -> bool {
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
}

impl<B: Bus, C: InterruptController, S: DeviceSet, const F: usize> Switch<B, C, S, F> {
    /// Serves all pending interrupts: the entry of all vectors, which the processor's handler
    /// calls.
    ///
    /// The boards that share a vector are polled one after the other, each time beginning with
    /// another one, until none of them asks for service: their line may be edge-triggered. A vector
    /// that interrupts 16 times in a row although none of its boards asks, or that never ends, is
    /// disabled and counted as [stuck](InterruptCounts::stuck), so that it does not hang the
    /// processor.
    ///
    /// An interrupt of a higher level may come while one of a lower level is being served.
    pub fn on_interrupt(&self) {
        let Some(mut vector) = self.controller.claim() else {
            masked(|| count(&self.interrupts.spurious));
            return;
        };
        let mut claims = 0_u32;
        loop {
            claims = claims.saturating_add(1);
            if claims == CALM {
                for line in self.devices.lines() {
                    line.storm.store(0, Relaxed);
                }
            }
            let stuck = self.serve(vector, claims >= CALM);
            self.controller.complete(vector);
            // Not before it is completed: some controllers ignore that of a disabled vector.
            if stuck {
                self.controller.disable(vector);
            }
            match self.controller.claim() {
                Some(next) => vector = next,
                None => return,
            }
        }
    }

    /// Returns the counts of interrupts so far.
    pub fn interrupt_counts(&self) -> InterruptCounts {
        let interrupts = &self.interrupts;
        let sum = |words: &mut dyn Iterator<Item = &AtomicU32>| {
            words.fold(0, |sum: u32, word| sum.wrapping_add(word.load(Relaxed)))
        };
        let lines = || self.devices.lines().iter();
        let strangers = interrupts.strangers.iter().map(|(_, counted)| counted);
        InterruptCounts {
            served: sum(&mut lines().map(|line| &line.served)),
            spurious: interrupts.spurious.load(Relaxed),
            unclaimed: sum(&mut lines().map(|line| &line.unclaimed)),
            unhandled: sum(&mut strangers.chain([&interrupts.others])),
            stuck: sum(&mut lines().map(|line| &line.stuck).chain([&interrupts.stuck])),
        }
    }

    /// Iterates over the first eight vectors that interrupted and belong to no board, with the
    /// counts of their interrupts.
    pub fn unhandled(&self) -> impl Iterator<Item = (Vector, u32)> + '_ {
        let strangers = self.interrupts.strangers.iter();
        strangers.filter_map(|(known, counted)| {
            let vector = known.load(Relaxed).checked_sub(1)?;
            Some((Vector(vector as u16), counted.load(Relaxed)))
        })
    }

    /// Iterates over the vectors of boards that were disabled because their interrupts did not end,
    /// with the counts of that.
    ///
    /// When the cause is gone, [`start`](Self::start) enables them again.
    pub fn stuck(&self) -> impl Iterator<Item = (Vector, u32)> + '_ {
        let lines = S::CHAIN.iter().zip(self.devices.lines());
        lines.filter_map(|(link, line)| {
            let stuck = line.stuck.load(Relaxed);
            (stuck > 0).then_some((link.vector, stuck))
        })
    }

    /// Polls the boards of a vector; says whether it is to be disabled.
    fn serve(&self, vector: Vector, storm: bool) -> bool {
        let first = S::CHAIN.partition_point(|link| link.vector < vector);
        let chain = S::CHAIN.get(first..).unwrap_or_default();
        let length = chain
            .iter()
            .take_while(|link| link.vector == vector)
            .count();
        let chain = chain.get(..length).unwrap_or_default();
        let line = self.devices.lines().get(first);
        let (Some(line), Ok(boards @ 1..)) = (line, u32::try_from(length)) else {
            return self.interrupts.is_stuck(vector);
        };
        let begin = line.turn.load(Relaxed) % boards;
        line.turn.store(begin + 1, Relaxed);
        let answer = self.poll_until_quiet(chain, begin as usize);
        let mut stuck = answer == Answer::Endless;
        if answer == Answer::Nobody {
            count(&line.unclaimed);
            stuck |= count(&line.unclaimed_in_a_row) >= PATIENCE;
        } else {
            count(&line.served);
            line.unclaimed_in_a_row.store(0, Relaxed);
        }
        stuck |= storm && count(&line.storm) >= ENDLESS;
        if stuck {
            line.unclaimed_in_a_row.store(0, Relaxed);
            line.storm.store(0, Relaxed);
            count(&line.stuck);
        }
        stuck
    }

    /// Polls the boards in turn until each, since the latest that asked, has said that it does not.
    ///
    /// Between the poll of one board and that of the next, the former may ask again: a shared line
    /// that is edge-triggered tells of it only if all of them had been quiet at once.
    fn poll_until_quiet(&self, chain: &[Link], begin: usize) -> Answer {
        let mut answer = Answer::Nobody;
        let mut quiet = 0;
        for (link, polled) in chain.iter().cycle().skip(begin).zip(1..) {
            if self.devices.visit(link.slot, Poll(&self.bus)) == Some(true) {
                answer = Answer::Somebody;
                quiet = 0;
                // Of a line of its own, the board has seen to all it had to ask.
                if chain.len() == 1 {
                    break;
                }
            } else {
                quiet += 1;
            }
            if quiet >= chain.len() {
                break;
            }
            if polled >= ENDLESS {
                return Answer::Endless;
            }
        }
        answer
    }
}

/// Who of a vector's boards had asked.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Answer {
    Nobody,
    Somebody,
    /// Somebody, again and again.
    Endless,
}

struct Poll<'s, B>(&'s B);

impl<B: Bus> Visitor for Poll<'_, B> {
    type Output = bool;

    fn board<D: Driver>(self, unit: &Unit<D>) -> bool {
        unit.presence() == Presence::Present
            && matches!(
                unit.driver.interrupt(unit.registers(self.0)),
                Ok(Attention::Mine)
            )
    }
}
