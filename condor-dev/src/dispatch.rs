//! Interrupts: one entry for all vectors (memo, section 3.1.1).

use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use crate::bus::{Bus, Registers};
use crate::driver::{Attention, Driver};
use crate::interrupt::{InterruptController, Vector};
use crate::set::{DeviceSet, Link, Visitor};
use crate::switch::Switch;
use crate::unit::{Presence, Unit};

/// How often in a row a vector may interrupt without any of its boards having asked for it.
const PATIENCE: u32 = 16;
/// How many interrupts one entry serves of a vector that never stops asking.
const ENDLESS: u32 = 100_000;
/// How many different vectors without a driver are told apart.
const STRANGERS: usize = 8;

/// What became of the interrupts so far. Counts wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InterruptCounts {
    /// A board had asked and was served.
    pub served: u32,
    /// There was none: the controller had nothing to claim.
    pub spurious: u32,
    /// There was one of a known vector, but none of its boards had asked.
    pub unclaimed: u32,
    /// It was of a vector that no board has.
    pub unhandled: u32,
    /// Vectors that were disabled because they would not end.
    pub stuck: u32,
}

/// The counts, as the entry writes them.
pub(crate) struct Interrupts {
    served: AtomicU32,
    spurious: AtomicU32,
    unclaimed: AtomicU32,
    stuck: AtomicU32,
    /// The latest vector that nobody claimed, and how often in a row.
    unclaimed_vector: AtomicU32,
    unclaimed_in_a_row: AtomicU32,
    /// Vector + 1 and count of each stranger; the last also counts those for whom there is no place.
    strangers: [(AtomicU32, AtomicU32); STRANGERS],
}

fn count(word: &AtomicU32) {
    word.store(word.load(Relaxed).wrapping_add(1), Relaxed);
}

impl Interrupts {
    pub(crate) const fn new() -> Self {
        Self {
            served: AtomicU32::new(0),
            spurious: AtomicU32::new(0),
            unclaimed: AtomicU32::new(0),
            stuck: AtomicU32::new(0),
            unclaimed_vector: AtomicU32::new(0),
            unclaimed_in_a_row: AtomicU32::new(0),
            strangers: [const { (AtomicU32::new(0), AtomicU32::new(0)) }; STRANGERS],
        }
    }

    /// Counts one more interrupt that nobody claimed, and gives how many of its vector came in a row.
    fn unclaimed_again(&self, vector: Vector) -> u32 {
        let same = self.unclaimed_vector.load(Relaxed) == u32::from(vector.0);
        let before = if same {
            self.unclaimed_in_a_row.load(Relaxed)
        } else {
            0
        };
        self.unclaimed_vector.store(u32::from(vector.0), Relaxed);
        self.unclaimed_in_a_row.store(before + 1, Relaxed);
        before + 1
    }

    fn count_stranger(&self, vector: Vector) {
        let name = u32::from(vector.0) + 1;
        for (known, counted) in &self.strangers {
            if known.load(Relaxed) == 0 {
                known.store(name, Relaxed);
            }
            if known.load(Relaxed) == name {
                return count(counted);
            }
        }
        if let Some((_, counted)) = self.strangers.last() {
            count(counted);
        }
    }
}

impl<B: Bus, C: InterruptController, S: DeviceSet, const F: usize> Switch<B, C, S, F> {
    /// The entry of all interrupts: serves what the controller has, until it has nothing more.
    ///
    /// The boards that share a vector are polled along their chain, each time beginning with another
    /// one. A vector that interrupts again and again with none of its boards asking, or that never
    /// ends, is disabled and counted as [stuck](InterruptCounts::stuck): it does not hang the processor.
    pub fn on_interrupt(&self) {
        let Some(mut vector) = self.controller.claim() else {
            count(&self.interrupts.spurious);
            return;
        };
        let mut in_a_row = 0;
        loop {
            let endless = in_a_row >= ENDLESS;
            if endless || !self.serve(vector) {
                self.give_up(vector, endless);
            }
            self.controller.complete(vector);
            let Some(next) = self.controller.claim() else {
                return;
            };
            in_a_row = if next == vector { in_a_row + 1 } else { 0 };
            vector = next;
        }
    }

    /// What became of the interrupts so far.
    pub fn interrupt_counts(&self) -> InterruptCounts {
        let counts = &self.interrupts;
        let unhandled = counts
            .strangers
            .iter()
            .map(|(_, count)| count.load(Relaxed));
        InterruptCounts {
            served: counts.served.load(Relaxed),
            spurious: counts.spurious.load(Relaxed),
            unclaimed: counts.unclaimed.load(Relaxed),
            unhandled: unhandled.fold(0, u32::wrapping_add),
            stuck: counts.stuck.load(Relaxed),
        }
    }

    /// The vectors that interrupted though no board has them, and how often; after the first eight
    /// different ones, the others count as the last.
    pub fn unhandled(&self) -> impl Iterator<Item = (Vector, u32)> + '_ {
        let strangers = self.interrupts.strangers.iter();
        strangers.filter_map(|(known, counted)| {
            let vector = known.load(Relaxed).checked_sub(1)?;
            Some((Vector(vector as u16), counted.load(Relaxed)))
        })
    }

    /// Polls the boards of a vector; says whether one had asked.
    fn serve(&self, vector: Vector) -> bool {
        let first = S::CHAIN.partition_point(|link| link.vector < vector);
        let chain = S::CHAIN.get(first..).unwrap_or_default();
        let length = chain
            .iter()
            .take_while(|link| link.vector == vector)
            .count();
        let (chain, _) = chain.split_at_checked(length).unwrap_or_default();
        let Some(turn) = self.devices.turns().get(first).filter(|_| length > 0) else {
            self.interrupts.count_stranger(vector);
            return false;
        };
        let begin = usize::from(turn.load(Relaxed)) % length;
        turn.store(((begin + 1) % length) as u8, Relaxed);
        let mut served = false;
        for link in chain.iter().cycle().skip(begin).take(length) {
            served |= self.poll(*link);
        }
        count(if served {
            &self.interrupts.served
        } else {
            &self.interrupts.unclaimed
        });
        served
    }

    fn poll(&self, link: Link) -> bool {
        let poll = Poll(&self.bus);
        self.devices.visit(link.kind, link.board, poll) == Some(true)
    }

    /// Disables a vector that has used up its patience.
    #[cold]
    fn give_up(&self, vector: Vector, endless: bool) {
        if endless || self.interrupts.unclaimed_again(vector) >= PATIENCE {
            self.controller.disable(vector);
            self.interrupts.unclaimed_in_a_row.store(0, Relaxed);
            count(&self.interrupts.stuck);
        }
    }
}

struct Poll<'s, B>(&'s B);

impl<B: Bus> Visitor for Poll<'_, B> {
    type Output = bool;

    fn board<D: Driver>(self, unit: &Unit<D>) -> bool {
        unit.presence() == Presence::Present
            && unit
                .driver
                .interrupt(Registers::new(self.0, unit.place.base()))
                .is_ok_and(|attention| attention == Attention::Mine)
    }
}
