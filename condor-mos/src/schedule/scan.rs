//! [`Grids`]: the next event of any set of rates, computed when it is needed.

use super::set::Set;
use super::{Grid, ScheduleEvent};
use crate::clock::ClockSpec;
use crate::error::RateError;

/// The instants of each loop of a set, by rank.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grids<const L: usize> {
    grids: [Grid; L],
    /// Ticks until each loop is due.
    remaining: [u64; L],
}

impl<const L: usize> Grids<L> {
    /// Every loop is due after its phase.
    pub(super) const fn new(set: &Set<L>, clock: ClockSpec) -> Result<Self, RateError> {
        let mut this = Self {
            grids: [Grid::NONE; L],
            // Ranks without a loop are due in hundreds of years.
            remaining: [u64::MAX; L],
        };
        let mut rank = 0;
        while rank < L {
            let Some((rate, phase)) = set.at_rank(rank) else {
                break;
            };
            let frequency = clock.frequency();
            let Some(grid) = Grid::new(rate, frequency) else {
                return Err(RateError::TooFast { rate, frequency });
            };
            if phase as u64 >= grid.whole() {
                return Err(RateError::Phase { rate, phase });
            }
            this.grids[rank] = grid;
            this.remaining[rank] = phase as u64;
            rank += 1;
        }
        Ok(this)
    }

    /// Goes back to the beginning.
    pub(super) fn restart(&mut self, set: &Set<L>) {
        self.grids.iter_mut().for_each(Grid::restart);
        for (rank, remaining) in self.remaining.iter_mut().enumerate() {
            *remaining = set
                .at_rank(rank)
                .map_or(u64::MAX, |(_, phase)| phase.into());
        }
    }

    /// The event that is due now; the next one is at most `longest` ticks away.
    pub(super) const fn advance(&mut self, longest: u32) -> ScheduleEvent {
        let mut ranks = 0;
        let mut gap = longest as u64;
        let mut rank = 0;
        while rank < L {
            if self.remaining[rank] == 0 {
                ranks |= 1 << rank;
                self.remaining[rank] = self.grids[rank].step();
            }
            if self.remaining[rank] < gap {
                gap = self.remaining[rank];
            }
            rank += 1;
        }
        let mut rank = 0;
        while rank < L {
            self.remaining[rank] -= gap;
            rank += 1;
        }
        ScheduleEvent {
            ranks,
            gap: gap as u32,
        }
    }

    /// Takes over when the loops are due from `before`, a schedule of `was`: those with the same
    /// rate also keep their grid.
    pub(super) fn take_over(&mut self, set: &Set<L>, before: &Self, was: &Set<L>) {
        for (rank, former) in was.former_ranks(set).into_iter().enumerate() {
            let former = usize::from(former);
            if let (Some(place), Some(remaining)) =
                (self.remaining.get_mut(rank), before.remaining.get(former))
            {
                *place = *remaining;
            }
            let rate = |set: &Set<L>, rank| set.at_rank(rank).map(|(rate, _)| rate);
            if let (true, Some(place), Some(grid)) = (
                rate(set, rank) == rate(was, former),
                self.grids.get_mut(rank),
                before.grids.get(former),
            ) {
                *place = *grid;
            }
        }
    }
}
