//! [`EventTable`]: every event until the rates repeat, computed beforehand.

use super::{Event, Grid, Scan, Schedule, former_ranks};
use crate::clock::Clock;
use crate::error::RateError;
use crate::rate::{Rate, greatest_common_divisor};

/// The events of one hyperperiod, after which a set of `L` rates repeats, in at most `E` entries
/// (memo, section 3.2.2).
///
/// The hyperperiod is the inverse of the rates' greatest common divisor. Its fraction of a tick is
/// carried from one to the next, so a release is never more than one tick from its exact instant.
/// Equal instants are one event. A time too long for the timer's counter is bridged by entries at
/// which nothing is due.
///
/// A changed rate takes effect at the beginning of a hyperperiod: all loops are due there, so all
/// that are in time are finished. If one is not, it is tried again at the next.
///
/// ```
/// use condor_mos::{Clock, EventTable, Rate};
///
/// const MICROSECONDS: Clock = Clock::of::<u64>(Rate::hz(1_000_000));
/// const SLOW: EventTable<2, 2> =
///     EventTable::new([Rate::every_seconds(10), Rate::every_seconds(5)], MICROSECONDS);
/// let gaps: Vec<u32> = SLOW.events().iter().map(|event| event.gap).collect();
/// assert_eq!(gaps, [5_000_000, 5_000_000]);
/// ```
///
/// A table that does not fit is an error of compilation:
///
/// ```compile_fail
/// # use condor_mos::{Clock, EventTable, Rate};
/// # const MICROSECONDS: Clock = Clock::of::<u64>(Rate::hz(1_000_000));
/// const TOO_SMALL: EventTable<3, 43> =
///     EventTable::new([Rate::hz(400), Rate::hz(60), Rate::hz(50)], MICROSECONDS);
/// # let _ = TOO_SMALL;
/// ```
#[derive(Clone, Copy, Debug)]
pub struct EventTable<const L: usize, const E: usize> {
    /// The one in use, and the one that is built for other rates.
    halves: [Half<L>; 2],
    entries: [[Event; E]; 2],
    active: usize,
    /// The entry of the next event, counted from the first half's first, and where its hyperperiod ends.
    next: usize,
    end: usize,
    change: Progress,
}

/// How far a change of rates is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Progress {
    None,
    /// Entries are being added to the half that is not active.
    Building,
    /// That half may become the active one.
    Ready,
}

#[derive(Clone, Copy, Debug)]
struct Half<const L: usize> {
    plan: Plan<L>,
    len: usize,
    /// The gap of the last entry, if the hyperperiod has no tick carried.
    last_gap: u32,
}

/// What is known before the first entry.
#[derive(Clone, Copy, Debug)]
struct Plan<const L: usize> {
    /// Gives the entries while they are added.
    scan: Scan<L>,
    /// Releases that are not in the entries yet.
    missing: u64,
    /// The beginnings of the hyperperiods.
    cycle: Grid,
}

impl<const L: usize, const E: usize> EventTable<L, E> {
    /// The table of loops with these rates, which may stand in any order.
    ///
    /// # Panics
    /// As [`try_new`](Self::try_new) has errors; in a constant, that is an error of compilation.
    #[must_use]
    pub const fn new(rates: [Rate; L], clock: Clock) -> Self {
        match Self::try_new(rates, clock) {
            Ok(table) => table,
            Err(error) => panic!("{}", error.message()),
        }
    }

    /// The table of loops with these rates.
    ///
    /// # Errors
    /// [`RateError::TooFast`], [`RateError::TooManyEvents`].
    pub const fn try_new(rates: [Rate; L], clock: Clock) -> Result<Self, RateError> {
        let plan = match Plan::new(rates, clock, E) {
            Ok(plan) => plan,
            Err(error) => return Err(error),
        };
        let mut half = Half {
            plan,
            len: 0,
            last_gap: 0,
        };
        let mut entries = [Event { ranks: 0, gap: 0 }; E];
        loop {
            match half.add_event(&mut entries) {
                Ok(true) => break,
                Ok(false) => {}
                Err(error) => return Err(error),
            }
        }
        Ok(Self {
            halves: [half; 2],
            entries: [entries; 2],
            active: 0,
            // The beginning of a hyperperiod carries the first tick.
            next: half.len,
            end: half.len,
            change: Progress::None,
        })
    }

    /// The events of one hyperperiod.
    #[must_use]
    pub const fn events(&self) -> &[Event] {
        let active = self.active & 1;
        let entries = &self.entries[active];
        match entries.split_at_checked(self.halves[active].len) {
            Some((events, _)) => events,
            None => entries,
        }
    }

    #[inline]
    fn half(&self) -> &Half<L> {
        &self.halves[self.active & 1]
    }

    fn spare(&mut self) -> &mut Half<L> {
        &mut self.halves[self.active & 1 ^ 1]
    }
}

impl<const L: usize> Plan<L> {
    const fn new(rates: [Rate; L], clock: Clock, capacity: usize) -> Result<Self, RateError> {
        let scan = match Scan::try_new(rates, clock) {
            Ok(scan) => scan,
            Err(error) => return Err(error),
        };
        let [fastest, _] = scan.extremes();
        // The greatest common divisor, as a fraction.
        let (mut numerator, mut denominator) = (0, 1);
        let mut number = 0;
        while number < L {
            let rate = rates[number];
            let too_many = RateError::TooManyEvents {
                rate,
                fastest,
                capacity,
            };
            let divisor = greatest_common_divisor(denominator, rate.denominator() as u64);
            numerator = greatest_common_divisor(numerator, rate.numerator() as u64);
            let product = match denominator.checked_div(divisor) {
                Some(quotient) => quotient.checked_mul(rate.denominator() as u64),
                None => None,
            };
            denominator = match product {
                Some(product) => product,
                None => return Err(too_many),
            };
            // A loop's releases are at as many events.
            match Self::releases(fastest, numerator, denominator) {
                Some(releases) if releases <= capacity as u64 => {}
                _ => return Err(too_many),
            }
            number += 1;
        }
        let mut missing = 0;
        let mut number = 0;
        while number < L {
            // At most `capacity` for each loop.
            if let Some(releases) = Self::releases(rates[number], numerator, denominator) {
                missing += releases;
            }
            number += 1;
        }
        let frequency = clock.frequency();
        let ticks = (frequency.numerator() as u64).checked_mul(denominator);
        let parts = numerator * frequency.denominator() as u64;
        let cycle = match ticks {
            Some(ticks) => Grid::of_fraction(ticks, parts),
            None => None,
        };
        let Some(cycle) = cycle else {
            return Err(RateError::TooFast {
                rate: fastest,
                frequency,
            });
        };
        Ok(Self {
            scan,
            missing,
            cycle,
        })
    }

    /// How often a loop of `rate` is due while one of `numerator` / `denominator` is due once.
    const fn releases(rate: Rate, numerator: u64, denominator: u64) -> Option<u64> {
        let product = match denominator.checked_div(rate.denominator() as u64) {
            Some(quotient) => quotient.checked_mul(rate.numerator() as u64),
            None => None,
        };
        match product {
            Some(product) => product.checked_div(numerator),
            None => None,
        }
    }
}

impl<const L: usize> Half<L> {
    /// Adds an entry and says whether it was the last.
    const fn add_event<const E: usize>(
        &mut self,
        entries: &mut [Event; E],
    ) -> Result<bool, RateError> {
        let event = self.plan.scan.advance();
        self.plan.missing -= event.ranks.count_ones() as u64;
        if self.len >= E {
            let [fastest, rate] = self.plan.scan.extremes();
            return Err(RateError::TooManyEvents {
                rate,
                fastest,
                capacity: E,
            });
        }
        entries[self.len] = event;
        self.len += 1;
        // What remains after the last release may be too long for one entry.
        if self.plan.missing > 0 || !self.plan.scan.is_at_beginning() {
            return Ok(false);
        }
        let mut first = self.plan.cycle;
        self.last_gap = event.gap - first.carry() as u32;
        Ok(true)
    }
}

impl<const L: usize, const E: usize> Schedule<L> for EventTable<L, E> {
    fn clock(&self) -> Clock {
        self.half().plan.scan.clock()
    }

    #[inline]
    fn ranks(&self) -> &[u8; L] {
        self.half().plan.scan.ranks()
    }

    fn rates(&self) -> &[Rate; L] {
        self.half().plan.scan.rates()
    }

    fn restart(&mut self) {
        self.halves[self.active & 1].plan.cycle.restart();
        self.next = self.end;
    }

    #[inline(always)]
    fn is_at_turn(&self) -> bool {
        self.next >= self.end
    }

    #[cold]
    fn turn(&mut self, idle: bool) -> Option<[u8; L]> {
        let former = *self.ranks();
        let changes = self.change == Progress::Ready && idle;
        if changes {
            self.active ^= 1;
            self.change = Progress::None;
        }
        let half = &mut self.halves[self.active & 1];
        self.next = (self.active & 1) * E;
        self.end = self.next + half.len;
        // The last gap is that of the hyperperiod which begins.
        let carried = half.plan.cycle.carry() as u32;
        let last = self.end.wrapping_sub(1);
        if let Some(last) = self.entries.as_flattened_mut().get_mut(last) {
            last.gap = half.last_gap + carried;
        }
        changes.then(|| former_ranks(&former, self.ranks()))
    }

    #[inline(always)]
    fn next_event(&mut self) -> Event {
        let event = self.entries.as_flattened().get(self.next).copied();
        self.next += 1;
        event.unwrap_or_default()
    }

    fn begin_change(&mut self, number: usize, rate: Rate) -> Result<(), RateError> {
        let mut wanted = *match self.change {
            Progress::None => self.half().plan.scan.rates(),
            Progress::Building | Progress::Ready => self.spare().plan.scan.rates(),
        };
        if let Some(place) = wanted.get_mut(number) {
            *place = rate;
        }
        let clock = self.half().plan.scan.clock();
        let plan = Plan::new(wanted, clock, E)?;
        let spare = self.spare();
        spare.plan = plan;
        spare.len = 0;
        self.change = Progress::Building;
        Ok(())
    }

    fn continue_change(&mut self) -> Result<bool, RateError> {
        if self.change != Progress::Building {
            return Ok(true);
        }
        let spare = self.active & 1 ^ 1;
        match self.halves[spare].add_event(&mut self.entries[spare]) {
            Ok(false) => Ok(false),
            Ok(true) => {
                self.change = Progress::Ready;
                Ok(true)
            }
            Err(error) => {
                self.change = Progress::None;
                Err(error)
            }
        }
    }

    fn is_changing(&self) -> bool {
        self.change != Progress::None
    }
}
