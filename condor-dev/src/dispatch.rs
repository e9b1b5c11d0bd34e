//! Interrupts: one entry for all vectors (memo, section 3.1.1).

use core::num::NonZeroU32;

use crate::bus::Bus;
use crate::driver::{Attention, Driver};
use crate::interrupt::{InterruptController, InterruptVector};
use crate::record::{Answer, ENDLESS, InterruptCounts};
use crate::set::{DeviceSet, Link, Visitor};
use crate::switch::Switch;
use crate::unit::{Presence, Unit};

/// The number of interrupts that one entry serves before it looks for a source that does not stop asking.
const CALM: u32 = 1000;

impl<B: Bus, C: InterruptController, S: DeviceSet, const F: usize> Switch<B, C, S, F> {
    /// Serves all pending interrupts. Call this from the processor's interrupt handler, whatever
    /// the vector is.
    ///
    /// The boards that share a vector are polled in turn until none of them asks for service,
    /// because their line may be edge-triggered. Each interrupt begins with the next board, so that
    /// all are served alike. A vector is disabled if it interrupts 16 times in a row although none
    /// of its boards asks, or if its interrupts do not end. It then counts as
    /// [stuck](InterruptCounts::stuck), so that it does not hang the processor.
    ///
    /// An interrupt of a higher level may come while one of a lower level is being served.
    pub fn on_interrupt(&self) {
        let mut claims = 0_u32;
        while let Some(vector) = self.controller.claim() {
            claims = claims.saturating_add(1);
            if claims == CALM {
                self.lose_calm();
            }
            let stuck = self.serve(vector, claims >= CALM);
            self.controller.complete(vector);
            // Not before it is completed: some controllers ignore that of a disabled vector.
            if stuck {
                self.controller.disable(vector);
            }
        }
        if claims == 0 {
            self.interrupts.count_spurious();
        }
    }

    /// Begins to look for a vector that does not stop.
    #[cold]
    fn lose_calm(&self) {
        for line in self.devices.lines() {
            line.calm();
        }
    }

    /// Returns how many interrupts came since the switch was made, by outcome.
    pub fn interrupt_counts(&self) -> InterruptCounts {
        InterruptCounts::of(self.devices.lines(), &self.interrupts)
    }

    /// Iterates over vectors that interrupted although no board of the set has them, each with its
    /// number of interrupts. Only the first eight such vectors are remembered.
    pub fn unhandled(&self) -> impl Iterator<Item = (InterruptVector, u32)> + '_ {
        self.interrupts.strangers()
    }

    /// Iterates over the vectors of boards that were disabled because their interrupts did not end,
    /// with how often each was disabled.
    ///
    /// When the cause is gone, [`start`](Self::start) enables them again.
    pub fn stuck(&self) -> impl Iterator<Item = (InterruptVector, u32)> + '_ {
        let lines = S::CHAIN.iter().zip(self.devices.lines());
        lines.filter_map(|(link, line)| {
            let stuck = line.stuck();
            (stuck > 0).then_some((link.vector, stuck))
        })
    }

    /// Polls the boards of a vector; says whether it is to be disabled.
    fn serve(&self, vector: InterruptVector, storm: bool) -> bool {
        let first = S::CHAIN.partition_point(|link| link.vector < vector);
        let chain = S::CHAIN.get(first..).unwrap_or_default();
        let length = chain
            .iter()
            .take_while(|link| link.vector == vector)
            .count();
        let chain = chain.get(..length).unwrap_or_default();
        let line = self.devices.lines().get(first);
        let (Some(line), Some(boards)) = (line, NonZeroU32::new(length as u32)) else {
            return self.interrupts.is_stuck(vector);
        };
        let answer = match chain {
            // Of a line of its own, the board has seen to all it had to ask.
            [only] if self.has_asked(*only) => Answer::Somebody,
            [_] => Answer::Nobody,
            _ => self.poll_until_quiet(chain, line.next(boards)),
        };
        line.is_stuck(answer, storm)
    }

    #[inline]
    fn has_asked(&self, board: Link) -> bool {
        self.devices.visit(board.slot, Poll(&self.bus)) == Some(true)
    }

    /// Polls the boards in turn until each, since the latest that asked, has said that it does not.
    ///
    /// Between the poll of one board and that of the next, the former may ask again: a shared line
    /// that is edge-triggered tells of it only if all of them had been quiet at once.
    // Apart from a vector of one board, which is on the shortest way to its driver.
    #[inline(never)]
    fn poll_until_quiet(&self, chain: &[Link], begin: usize) -> Answer {
        let mut answer = Answer::Nobody;
        let mut quiet = 0;
        for (link, polled) in chain.iter().cycle().skip(begin).zip(1..) {
            if self.has_asked(*link) {
                answer = Answer::Somebody;
                quiet = 0;
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

/// The entry of all interrupts of a processor's boards, and what became of them; a
/// [`Switch`](crate::Switch) is one. Machines call it when a board interrupts.
pub trait InterruptEntry: Sync {
    /// Serves all pending interrupts; see [`Switch::on_interrupt`](crate::Switch::on_interrupt).
    fn serve_interrupts(&self);

    /// Returns how many interrupts came since the entry was made, by outcome.
    fn counts(&self) -> InterruptCounts;

    /// Calls `each` with the vectors that interrupted although no board has them, and how often each
    /// came; see [`Switch::unhandled`](crate::Switch::unhandled).
    fn each_unhandled(&self, each: &mut dyn FnMut(InterruptVector, u32));

    /// Calls `each` with the vectors of boards that were disabled because their interrupts did not
    /// end, and how often each was; see [`Switch::stuck`](crate::Switch::stuck).
    fn each_stuck(&self, each: &mut dyn FnMut(InterruptVector, u32));
}

impl<B, C, S, const F: usize> InterruptEntry for Switch<B, C, S, F>
where
    B: Bus + Sync,
    C: InterruptController + Sync,
    S: DeviceSet + Sync,
{
    fn serve_interrupts(&self) {
        self.on_interrupt();
    }

    fn counts(&self) -> InterruptCounts {
        self.interrupt_counts()
    }

    fn each_unhandled(&self, each: &mut dyn FnMut(InterruptVector, u32)) {
        self.unhandled()
            .for_each(|(vector, count)| each(vector, count));
    }

    fn each_stuck(&self, each: &mut dyn FnMut(InterruptVector, u32)) {
        self.stuck().for_each(|(vector, count)| each(vector, count));
    }
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
