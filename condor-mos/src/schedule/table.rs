//! [`EventTable`]: every event until the rates repeat, computed beforehand.

use super::scan::Grids;
use super::set::Set;
use super::{Grid, ScheduleEvent};
use crate::clock::ClockSpec;
use crate::error::RateError;
use crate::rate::Rate;

/// The largest number of entries that are counted one by one, for an error or a constant.
const MOST_COUNTED: usize = 1 << 15;

/// The schedule of up to `L` loops as a table of events: every instant at which loops are due,
/// until the releases of all loops repeat (memo, section 3.2.2). It has room for `E` entries;
/// [`entries`] returns how many a set of rates needs. With `E` = 0 it is a [`Scan`].
///
/// The time after which releases repeat is the *hyperperiod*, the inverse of the rates' greatest
/// common divisor. If it is not a whole number of ticks, the fraction is carried from one
/// hyperperiod to the next, so a release is never more than one tick from its exact instant. Loops
/// that are due at the same instant share an event. A time that is too long for the timer's counter
/// is divided by entries at which no loop is due.
///
/// A changed rate takes effect at the beginning of a later hyperperiod, one at which no loop is
/// unfinished. If the table has no room for the new rates, the schedule is a [`Scan`] from then on.
///
/// ```
/// use condor_mos::{ClockSpec, EventTable, Rate};
///
/// const MICROSECONDS: ClockSpec = ClockSpec::of::<u64>(Rate::hz(1_000_000));
/// const RATES: [Rate; 2] = [Rate::every_seconds(10), Rate::every_seconds(5)];
/// const ENTRIES: usize = condor_mos::entries(&RATES, MICROSECONDS);
/// const SLOW: EventTable<2, ENTRIES> = EventTable::new(&RATES, MICROSECONDS);
/// let gaps: Vec<u32> = SLOW.events().iter().map(|event| event.gap).collect();
/// assert_eq!(gaps, [5_000_000, 5_000_000]);
/// ```
///
/// A table that does not fit is an error of compilation:
///
/// ```compile_fail
/// # use condor_mos::{ClockSpec, EventTable, Rate};
/// # const MICROSECONDS: ClockSpec = ClockSpec::of::<u64>(Rate::hz(1_000_000));
/// const TOO_SMALL: EventTable<3, 43> =
///     EventTable::new(&[Rate::hz(400), Rate::hz(60), Rate::hz(50)], MICROSECONDS);
/// # let _ = TOO_SMALL;
/// ```
#[derive(Clone, Copy, Debug)]
pub struct EventTable<const L: usize, const E: usize> {
    clock: ClockSpec,
    set: Set<L>,
    wanted: Set<L>,
    change: Change,
    /// Computes the events of `set` where there is no table, else entries for `wanted`.
    grids: Grids<L>,
    /// Ticks that the entries for `wanted` lack.
    missing: u64,
    /// The one in use, and the one that is built for other rates.
    halves: [Half; 2],
    entries: [[ScheduleEvent; E]; 2],
    active: usize,
    /// The index of the next event's entry, counted through both halves, and the indices at which its
    /// hyperperiod ends and begins. All three lie behind the last entry where there is no table.
    next: usize,
    end: usize,
    begin: usize,
    /// Whether the next turn is back to the beginning, and nothing else.
    repeats: bool,
}

/// The schedule of up to `L` loops without a table: each event is computed when it is due. Use it
/// for sets of rates whose table would be too large, such as 400, 60 and 59.94 Hz.
///
/// An event costs a pass over the loops, without divisions. A changed rate takes effect at the
/// first event at which no loop is unfinished. The loop is due at that event only if it would have
/// been due at its old rate.
///
/// ```
/// use condor_mos::{ClockSpec, Rate, Scan};
///
/// const NANOSECONDS: ClockSpec = ClockSpec::of::<u64>(Rate::hz(1_000_000_000));
/// const VIDEO: Scan<3> = Scan::new(
///     &[Rate::hz(400), Rate::hz(60), Rate::fraction(60_000, 1001)],
///     NANOSECONDS,
/// );
/// # let _ = VIDEO;
/// ```
pub type Scan<const L: usize> = EventTable<L, 0>;

/// The progress of a change of rates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Change {
    None,
    /// Entries are being added to the half that is not active.
    Building,
    /// The wanted rates may take effect.
    Ready,
}

#[derive(Clone, Copy, Debug)]
struct Half {
    len: usize,
    /// The beginnings of the hyperperiods.
    cycle: Grid,
    /// The gap of the last entry, if the hyperperiod has no tick carried.
    last_gap: u32,
}

impl Half {
    const NONE: Self = Self {
        len: 0,
        cycle: Grid::NONE,
        last_gap: 0,
    };
}

/// Returns how many entries an [`EventTable`] needs for these rates and this clock. A result above
/// 32 768 is an upper bound. If the entries cannot be counted, the result is `usize::MAX`.
///
/// # Panics
/// If a rate has a period of less than one tick of the clock, or if there are not 1 to 32 rates; in
/// a constant, that is an error of compilation.
#[must_use]
pub const fn entries(rates: &[Rate], clock: ClockSpec) -> usize {
    match Set::<32>::new(rates, &[]) {
        Ok(set) => match Grids::new(&set, clock) {
            Ok(_) => needed(&set, clock),
            Err(error) => panic!("{}", error.message()),
        },
        Err(error) => panic!("{}", error.message()),
    }
}

/// As [`entries`], of any set.
const fn needed<const L: usize>(set: &Set<L>, clock: ClockSpec) -> usize {
    let (Some(mut cycle), Ok(mut grids)) = (set.cycle(clock), Grids::new(set, clock)) else {
        return usize::MAX;
    };
    let longest = clock.longest_gap();
    let ticks = cycle.step();
    let (mut missing, mut len) = (ticks, 0);
    while missing > 0 && len < MOST_COUNTED {
        missing -= grids.advance(least(missing, longest)).gap as u64;
        len += 1;
    }
    if missing == 0 {
        return len;
    }
    // One for each release, and what bridges the time.
    let mut most = match ticks.checked_div(longest as u64) {
        Some(bridges) => bridges,
        None => u64::MAX,
    };
    let mut rank = 0;
    while let Some((rate, _)) = set.at_rank(rank) {
        let releases = match Grid::new(rate, clock.frequency()) {
            Some(grid) => ticks / if grid.whole() == 0 { 1 } else { grid.whole() },
            None => 0,
        };
        most = most.saturating_add(releases).saturating_add(1);
        rank += 1;
    }
    if most > usize::MAX as u64 {
        usize::MAX
    } else {
        most as usize
    }
}

/// The lesser of both.
const fn least(ticks: u64, longest: u32) -> u32 {
    if ticks < longest as u64 {
        ticks as u32
    } else {
        longest
    }
}

impl<const L: usize, const E: usize> EventTable<L, E> {
    /// Makes the table of loops with these rates: `rates[n]` is the rate of loop *n* (its
    /// [`LoopId`](crate::LoopId)). The rates may be in any order.
    ///
    /// # Panics
    /// If there are not 1 to `L` rates, if a period is shorter than a tick, or if the events do not
    /// fit; in a constant, that is an error of compilation.
    #[must_use]
    pub const fn new(rates: &[Rate], clock: ClockSpec) -> Self {
        match Self::try_new(rates, clock) {
            Ok(table) => table,
            Err(error) => panic!("{}", error.message()),
        }
    }

    /// Makes the table as [`new`](Self::new) does, for rates that are known only at run time.
    ///
    /// # Errors
    /// [`RateError::Loops`] unless there are 1 to `L` rates, [`RateError::TooFast`] if a period is
    /// shorter than a tick, [`RateError::TooManyEvents`] if the events do not fit.
    pub const fn try_new(rates: &[Rate], clock: ClockSpec) -> Result<Self, RateError> {
        Self::phased(rates, &[], clock)
    }

    /// Makes the table of loops with phases: loop *n* has the rate `rates[n]`, and is due first
    /// `phases[n]` ticks after the start. A loop for which `phases` is too short is due at the
    /// start. So loops of one rate can take turns, and fewer are due at once.
    ///
    /// # Errors
    /// [`RateError::Loops`] unless there are 1 to `L` rates, [`RateError::TooFast`] if a period is
    /// shorter than a tick, [`RateError::TooManyEvents`] if the events do not fit,
    /// [`RateError::Phase`] if a phase is not within the first period.
    pub const fn phased(
        rates: &[Rate],
        phases: &[u32],
        clock: ClockSpec,
    ) -> Result<Self, RateError> {
        match Self::or_scan(rates, phases, clock) {
            Ok(this) if E > 0 && this.is_scan() => Err(Self::too_many(&this.set, clock)),
            result => result,
        }
    }

    /// Makes the table as [`phased`](Self::phased) does if the table has room for the rates.
    /// Otherwise makes a schedule that computes events when they are due, as a [`Scan`] does, also
    /// after rates change.
    ///
    /// # Errors
    /// [`RateError::Loops`] unless there are 1 to `L` rates, [`RateError::TooFast`] if a period is
    /// shorter than a tick, [`RateError::Phase`] if a phase is not within the first period.
    pub const fn or_scan(
        rates: &[Rate],
        phases: &[u32],
        clock: ClockSpec,
    ) -> Result<Self, RateError> {
        let set = match Set::new(rates, phases) {
            Ok(set) => set,
            Err(error) => return Err(error),
        };
        let grids = match Grids::new(&set, clock) {
            Ok(grids) => grids,
            Err(error) => return Err(error),
        };
        let mut this = Self {
            clock,
            set,
            wanted: set,
            change: Change::None,
            grids,
            missing: 0,
            halves: [Half::NONE; 2],
            entries: [[ScheduleEvent { ranks: 0, gap: 0 }; E]; 2],
            active: 1,
            next: 2 * E,
            begin: 2 * E,
            end: 2 * E,
            repeats: false,
        };
        if E > 0
            && let Some(cycle) = set.cycle(clock)
        {
            this.begin_half(cycle);
            while matches!(this.change, Change::Building) {
                this.add_entry();
            }
            if this.halves[0].len > 0 {
                this.active = 0;
                this.begin = 0;
                // The beginning of a hyperperiod carries the first tick.
                this.next = this.halves[0].len;
                this.end = this.next;
            } else {
                this.grids = grids;
            }
            this.change = Change::None;
        }
        Ok(this)
    }

    /// Returns the events of one hyperperiod in the order of time; the slice is empty if the
    /// schedule is a [`Scan`].
    #[must_use]
    pub const fn events(&self) -> &[ScheduleEvent] {
        let active = self.active & 1;
        let entries = &self.entries[active];
        match entries.split_at_checked(self.halves[active].len) {
            Some((events, _)) => events,
            None => entries,
        }
    }

    /// Returns true if the schedule computes events when they are due, as a [`Scan`] does; false if
    /// it has a table.
    #[must_use]
    pub const fn is_scan(&self) -> bool {
        self.begin >= 2 * E
    }

    /// Returns the clock for which the schedule was made.
    #[must_use]
    pub const fn clock(&self) -> ClockSpec {
        self.clock
    }

    /// Returns the rates at which the loops are due now; the index is the loop's number.
    #[must_use]
    pub const fn rates(&self) -> &[Rate] {
        self.set.rates()
    }

    #[inline]
    pub(crate) const fn set(&self) -> &Set<L> {
        &self.set
    }

    /// Returns the reason why there is no table for a set.
    const fn too_many(set: &Set<L>, clock: ClockSpec) -> RateError {
        RateError::TooManyEvents {
            needed: needed(set, clock),
            capacity: E,
        }
    }

    /// Begins entries for the wanted rates, which repeat after `cycle`.
    const fn begin_half(&mut self, cycle: Grid) {
        let mut first = cycle;
        self.missing = first.step();
        self.halves[self.active & 1 ^ 1] = Half {
            len: 0,
            cycle,
            last_gap: 0,
        };
        self.change = Change::Building;
    }

    /// Adds an entry for the wanted rates. If there is no place, they are ready without a table.
    const fn add_entry(&mut self) {
        let spare = self.active & 1 ^ 1;
        let len = self.halves[spare].len;
        let event = self
            .grids
            .advance(least(self.missing, self.clock.longest_gap()));
        let half = &mut self.halves[spare];
        if len >= E {
            half.len = 0;
            self.change = Change::Ready;
            return;
        }
        self.entries[spare][len] = event;
        half.len = len + 1;
        self.missing -= event.gap as u64;
        if self.missing == 0 {
            let mut first = half.cycle;
            half.last_gap = event.gap - first.carry() as u32;
            self.change = Change::Ready;
        }
    }

    /// Has [`is_at_turn`](Self::is_at_turn) true until the next turn.
    pub(crate) fn park(&mut self) {
        self.next = self.end;
        self.repeats = false;
    }

    /// To be called when what `repeats` depends on has changed.
    fn note_repeats(&mut self) {
        let cycle = &self.halves[self.active & 1].cycle;
        self.repeats = !self.is_scan() && cycle.is_whole() && self.change == Change::None;
    }

    /// Goes back to the beginning.
    pub(crate) fn restart(&mut self) {
        // Wanted rates wait for the first event: here a loop may be in progress.
        if self.is_scan() {
            self.grids.restart(&self.set);
        } else {
            self.halves[self.active & 1].cycle.restart();
            self.next = self.end;
        }
        self.note_repeats();
    }

    /// The next event and its index, if it is in the table and no [`turn`](Self::turn) comes before it that
    /// does more than go back to the beginning.
    #[inline(always)]
    pub(crate) fn peek(&self) -> Option<(ScheduleEvent, usize)> {
        let mut next = self.next;
        if self.is_at_turn() {
            if !self.repeats {
                return None;
            }
            next = self.begin;
        }
        let event = self.entries.as_flattened().get(next)?;
        Some((*event, next))
    }

    /// Goes on to the event behind that index.
    #[inline(always)]
    pub(crate) fn pass(&mut self, index: usize) {
        self.next = index + 1;
    }

    /// Returns true if [`turn`](Self::turn) must be called before the next event.
    #[inline]
    pub(crate) fn is_at_turn(&self) -> bool {
        self.next >= self.end
    }

    /// Goes to a place where changed rates may take effect.
    ///
    /// They do if `idle`, that is if no loop is unfinished: ranks are not changed under a loop that is in
    /// progress. Then the result has, for each new rank, the one that its loop had before.
    #[inline]
    pub(crate) fn turn(&mut self, idle: bool) -> Option<[u8; L]> {
        let changes = self.change == Change::Ready && idle;
        let former = changes.then(|| self.take_effect());
        self.next = self.begin;
        let half = &mut self.halves[self.active & 1];
        if half.cycle.is_whole() {
            return former;
        }
        // The last gap is that of the hyperperiod which begins.
        let carried = half.cycle.carry() as u32;
        let last = self.end.wrapping_sub(1);
        if let Some(last) = self.entries.as_flattened_mut().get_mut(last) {
            last.gap = half.last_gap + carried;
        }
        former
    }

    /// Puts the wanted rates in force.
    #[cold]
    fn take_effect(&mut self) -> [u8; L] {
        let former = self.set.former_ranks(&self.wanted);
        self.change = Change::None;
        if !self.is_scan() {
            self.active = self.active & 1 ^ 1;
            self.begin = self.active * E;
            self.end = self.begin + self.halves[self.active & 1].len;
            if self.begin == self.end {
                // No room: from the beginning of this hyperperiod on, events are computed.
                self.halves = [Half::NONE; 2];
                (self.begin, self.end) = (2 * E, 2 * E);
                if let Ok(grids) = Grids::new(&self.wanted, self.clock) {
                    self.grids = grids;
                }
            }
        } else if let Ok(mut grids) = Grids::new(&self.wanted, self.clock) {
            grids.take_over(&self.wanted, &self.grids, &self.set);
            self.grids = grids;
        }
        self.set = self.wanted;
        self.note_repeats();
        former
    }

    /// The next event.
    pub(crate) fn next_event(&mut self) -> ScheduleEvent {
        match self.entries.as_flattened().get(self.next) {
            Some(event) => {
                self.next += 1;
                *event
            }
            None => self.grids.advance(self.clock.longest_gap()),
        }
    }

    /// Asks for another rate of a loop. It takes effect, together with all that were asked for
    /// since, after [`continue_change`](Self::continue_change) has said that everything is ready.
    pub(crate) fn begin_change(&mut self, number: usize, rate: Rate) -> Result<(), RateError> {
        let before = match self.change {
            Change::None => self.set,
            Change::Building | Change::Ready => self.wanted,
        };
        let wanted = before.with_rate(number, rate);
        let grids = Grids::new(&wanted, self.clock)?;
        if self.is_scan() {
            self.wanted = wanted;
            self.change = Change::Ready;
            return Ok(());
        }
        (self.wanted, self.grids) = (wanted, grids);
        if let Some(cycle) = wanted.cycle(self.clock) {
            self.begin_half(cycle);
        } else {
            self.halves[self.active & 1 ^ 1].len = 0;
            self.change = Change::Ready;
        }
        self.repeats = false;
        Ok(())
    }

    /// Does a short piece of what a change needs, and says whether everything is ready.
    pub(crate) fn continue_change(&mut self) -> bool {
        if self.change == Change::Building {
            self.add_entry();
        }
        self.change != Change::Building
    }

    /// Returns true if rates that were asked for have not taken effect yet.
    pub(crate) fn is_changing(&self) -> bool {
        self.change != Change::None
    }
}
