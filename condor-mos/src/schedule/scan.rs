//! [`Scan`]: the next event is computed when it is needed.

use super::{Event, Grid, Schedule, former_ranks};
use crate::clock::Clock;
use crate::error::RateError;
use crate::rate::Rate;

/// Computes every event from the loops' own grids: for sets of rates whose
/// [`EventTable`](super::EventTable) would not fit, such as 400, 60 and 59.94 Hz.
///
/// An event costs a pass over the loops, with divisions nowhere. A changed rate takes effect at the
/// first event at which no loop is unfinished; the loop is due there when it was due anyway.
///
/// ```
/// use condor_mos::{Clock, Rate, Scan};
///
/// const NANOSECONDS: Clock = Clock::of::<u64>(Rate::hz(1_000_000_000));
/// const VIDEO: Scan<3> = Scan::new(
///     [Rate::hz(400), Rate::hz(60), Rate::fraction(60_000, 1001)],
///     NANOSECONDS,
/// );
/// # let _ = VIDEO;
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Scan<const L: usize> {
    clock: Clock,
    rates: [Rate; L],
    wanted: Option<[Rate; L]>,
    ranks: [u8; L],
    /// By rank, as is what follows.
    grids: [Grid; L],
    /// Ticks until each loop is due.
    remaining: [u64; L],
}

impl<const L: usize> Scan<L> {
    /// A schedule of loops with these rates, which may stand in any order.
    ///
    /// # Panics
    /// If a rate has a period of less than one tick of the clock; in a constant, that is an error
    /// of compilation. For rates from outside there is [`try_new`](Self::try_new).
    #[must_use]
    pub const fn new(rates: [Rate; L], clock: Clock) -> Self {
        match Self::try_new(rates, clock) {
            Ok(scan) => scan,
            Err(error) => panic!("{}", error.message()),
        }
    }

    /// A schedule of loops with these rates.
    ///
    /// # Errors
    /// [`RateError::TooFast`].
    pub const fn try_new(rates: [Rate; L], clock: Clock) -> Result<Self, RateError> {
        const { assert!(L >= 1 && L <= 32, "a schedule is of 1 to 32 loops") };
        let mut scan = Self {
            clock,
            rates,
            wanted: None,
            ranks: [0; L],
            grids: [Grid::NONE; L],
            remaining: [0; L],
        };
        // By rank, as is what follows; no index comes out of a table, so that none can be wrong.
        let mut sorted = rates;
        let mut placed = 0;
        while placed < L {
            // Insertion from the end: equal rates stay in the order of their numbers.
            let mut rank = placed;
            while rank > 0 && rates[placed].is_faster_than(sorted[rank - 1]) {
                sorted[rank] = sorted[rank - 1];
                scan.ranks[rank] = scan.ranks[rank - 1];
                rank -= 1;
            }
            sorted[rank] = rates[placed];
            scan.ranks[rank] = placed as u8;
            placed += 1;
        }
        let mut rank = 0;
        while rank < L {
            let rate = sorted[rank];
            scan.grids[rank] = match Grid::new(rate, clock.frequency()) {
                Some(grid) => grid,
                None => {
                    return Err(RateError::TooFast {
                        rate,
                        frequency: clock.frequency(),
                    });
                }
            };
            rank += 1;
        }
        Ok(scan)
    }

    pub(super) const fn clock(&self) -> Clock {
        self.clock
    }

    pub(super) const fn rates(&self) -> &[Rate; L] {
        &self.rates
    }

    pub(super) const fn ranks(&self) -> &[u8; L] {
        &self.ranks
    }

    /// The rates of the fastest loop and of the slowest.
    pub(super) const fn extremes(&self) -> [Rate; 2] {
        let [mut fastest, mut slowest] = [self.rates[0]; 2];
        let mut number = 1;
        while number < L {
            let rate = self.rates[number];
            if rate.is_faster_than(fastest) {
                fastest = rate;
            }
            if slowest.is_faster_than(rate) {
                slowest = rate;
            }
            number += 1;
        }
        [fastest, slowest]
    }

    /// The event that is due now.
    pub(super) const fn advance(&mut self) -> Event {
        let mut ranks = 0;
        let mut gap = self.clock.longest_gap() as u64;
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
        Event {
            ranks,
            gap: gap as u32,
        }
    }

    /// Whether every loop is due now.
    pub(super) const fn is_at_beginning(&self) -> bool {
        let mut rank = 0;
        while rank < L && self.remaining[rank] == 0 {
            rank += 1;
        }
        rank == L
    }

    /// Takes the wanted rates; each loop is due when it was due anyway.
    fn take_effect(&mut self) -> Option<[u8; L]> {
        // They were tried when they were asked for.
        let mut changed = Self::try_new(self.wanted.take()?, self.clock).ok()?;
        let former = former_ranks(&self.ranks, &changed.ranks);
        let numbers = changed.ranks;
        for (rank, (&before, number)) in former.iter().zip(numbers).enumerate() {
            let (before, number) = (usize::from(before), usize::from(number));
            let rate = |scan: &Self| scan.rates.get(number).copied();
            let same_rate = rate(&changed) == rate(self);
            if let (Some(place), Some(remaining)) =
                (changed.remaining.get_mut(rank), self.remaining.get(before))
            {
                *place = *remaining;
            }
            if let (true, Some(place), Some(grid)) = (
                same_rate,
                changed.grids.get_mut(rank),
                self.grids.get(before),
            ) {
                *place = *grid;
            }
        }
        *self = changed;
        Some(former)
    }
}

impl<const L: usize> Schedule<L> for Scan<L> {
    fn clock(&self) -> Clock {
        self.clock
    }

    fn ranks(&self) -> &[u8; L] {
        &self.ranks
    }

    fn rates(&self) -> &[Rate; L] {
        &self.rates
    }

    fn restart(&mut self) {
        // Wanted rates wait for the first event: here a loop may be in progress.
        self.grids.iter_mut().for_each(Grid::restart);
        self.remaining = [0; L];
    }

    fn is_at_turn(&self) -> bool {
        self.wanted.is_some()
    }

    fn turn(&mut self, idle: bool) -> Option<[u8; L]> {
        if idle { self.take_effect() } else { None }
    }

    fn next_event(&mut self) -> Event {
        self.advance()
    }

    fn begin_change(&mut self, number: usize, rate: Rate) -> Result<(), RateError> {
        let mut wanted = self.wanted.unwrap_or(self.rates);
        if let Some(place) = wanted.get_mut(number) {
            *place = rate;
        }
        Self::try_new(wanted, self.clock)?;
        self.wanted = Some(wanted);
        Ok(())
    }

    fn continue_change(&mut self) -> Result<bool, RateError> {
        Ok(true)
    }

    fn is_changing(&self) -> bool {
        self.wanted.is_some()
    }
}
