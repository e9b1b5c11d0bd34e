//! Interrupts: one entry for all vectors (memo, section 3.1.1).

use core::num::NonZeroU32;

use crate::bus::Bus;
use crate::driver::{Attention, Driver};
use crate::interrupt::{InterruptController, InterruptVector};
use crate::record::{Answer, ENDLESS, InterruptCounts, VectorRecord};
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
        let Some((vector, answer)) = self.poll_next() else {
            return self.interrupts.count_spurious();
        };
        self.complete(vector, answer, false);
        self.serve_others();
    }

    /// Serves what is still pending after the first interrupt, and what comes meanwhile.
    // Apart from the first one: what a loop needs is not saved on the way to its driver.
    #[inline(never)]
    fn serve_others(&self) {
        let mut claims = 1_u32;
        while let Some((vector, answer)) = self.poll_next() {
            claims = claims.saturating_add(1);
            if claims == CALM {
                self.lose_calm();
            }
            self.complete(vector, answer, claims >= CALM);
        }
    }

    /// Claims the most urgent vector, and polls its boards; `None` if none is pending.
    fn poll_next(&self) -> Option<(InterruptVector, Answer)> {
        let vector = self.controller.claim()?;
        Some((vector, self.poll(vector)))
    }

    /// Counts an interrupt whose boards were polled, and completes it.
    fn complete(&self, vector: InterruptVector, answer: Answer, storm: bool) {
        let stuck = match self.find(vector) {
            Some((_, line)) => line.is_stuck(answer, storm),
            None => self.interrupts.is_stuck(vector),
        };
        self.controller.complete(vector);
        // Not before it is completed: some controllers ignore that of a disabled vector.
        if stuck {
            self.controller.disable(vector);
        }
    }

    /// Begins to look for a vector that does not stop.
    #[cold]
    fn lose_calm(&self) {
        for line in self.devices.lines() {
            line.calm();
        }
    }

    /// Returns the links from the first board of a vector on, and the record of the vector; `None` if no
    /// board has it.
    fn find(&self, vector: InterruptVector) -> Option<(&'static [Link], &VectorRecord)> {
        let first = S::CHAIN.partition_point(|link| link.vector < vector);
        let chain = S::CHAIN.get(first..)?;
        let line = self.devices.lines().get(first)?;
        (chain.first()?.vector == vector).then_some((chain, line))
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

    /// Polls the boards of a vector.
    fn poll(&self, vector: InterruptVector) -> Answer {
        match self.find(vector) {
            Some((chain @ [one, other, ..], line)) if one.vector == other.vector => {
                self.poll_until_quiet(chain, line)
            }
            // Of a line of its own, the board has seen to all it had to ask.
            Some(([only, ..], _)) if self.has_asked(*only) => Answer::Somebody,
            _ => Answer::Nobody,
        }
    }

    #[inline]
    fn has_asked(&self, board: Link) -> bool {
        self.devices.visit(board.slot, Poll(&self.bus)) == Some(true)
    }

    /// Polls the boards of the first vector of `chain` in turn until each, since the latest that asked,
    /// has said that it does not.
    ///
    /// Between the poll of one board and that of the next, the former may ask again: a shared line
    /// that is edge-triggered tells of it only if all of them had been quiet at once.
    // Apart from a vector of one board, which is on the shortest way to its driver.
    #[inline(never)]
    fn poll_until_quiet(&self, chain: &[Link], line: &VectorRecord) -> Answer {
        let first = chain.first().map(|link| link.vector);
        let of_first = |link: &&Link| Some(link.vector) == first;
        let boards = chain.iter().take_while(of_first);
        let Some(count) = NonZeroU32::new(boards.clone().count() as u32) else {
            return Answer::Nobody;
        };
        let mut answer = Answer::Nobody;
        let mut quiet = 0;
        for (link, polled) in boards.cycle().skip(line.next(count)).zip(1..) {
            if self.has_asked(*link) {
                answer = Answer::Somebody;
                quiet = 0;
            } else {
                quiet += 1;
            }
            if quiet >= count.get() {
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
