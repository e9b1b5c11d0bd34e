//! [`Analysis`]: whether a set of loops can be scheduled, and the response time of each loop.

use core::fmt;

use crate::process::LoopId;
use crate::rate::Rate;
use crate::statistics::Statistics;

/// Steps after which a response is [`ResponseTime::Undecided`]. A step passes at least one release of
/// a faster loop, so that only rates which differ by more than this factor come here.
const MOST_STEPS: u32 = 1 << 20;

/// The demands of one loop on the processor, as input of an [`Analysis`]. Times are in ticks of the
/// clock that the analysis is made for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Load {
    /// The rate of the loop.
    pub rate: Rate,
    /// The longest time of one run, in ticks, without the loops that interrupt it.
    pub worst_run: u32,
    /// The longest time, in ticks, for which a slower loop or the background delays this loop:
    /// while it masks interrupts, or holds a [`LoopLock`](crate::LoopLock) that this loop or a
    /// faster one uses. Each run is delayed at most once in this way.
    pub blocking: u32,
    /// The time from the release to the latest end that is allowed, in ticks. If the period is
    /// shorter, the period counts.
    pub deadline: u32,
}

impl Load {
    /// Makes the load of a loop that computes for at most `worst_run` ticks, is not delayed by
    /// slower contexts, and must end within its period.
    #[must_use]
    pub const fn new(rate: Rate, worst_run: u32) -> Self {
        Self {
            rate,
            worst_run,
            blocking: 0,
            deadline: u32::MAX,
        }
    }

    /// Sets [`blocking`](Self::blocking), the longest time in ticks for which slower contexts delay
    /// the loop.
    #[must_use]
    pub const fn blocked(self, blocking: u32) -> Self {
        Self { blocking, ..self }
    }

    /// Sets the deadline of the loop to `deadline` ticks after its release. If that is longer than
    /// the period, the period is the deadline.
    ///
    /// Deadlines do not change priorities, which follow from the rates alone; so a loop with a
    /// short deadline and a low rate may need a higher rate.
    #[must_use]
    pub const fn within(self, deadline: u32) -> Self {
        Self { deadline, ..self }
    }

    /// Makes the load of a loop from its statistics: its rate, and its longest run so far. The load
    /// has no blocking, because that is not measured.
    #[must_use]
    pub const fn measured(statistics: &Statistics) -> Self {
        Self::new(statistics.rate, statistics.worst_run)
    }
}

/// The response time of a loop: the longest time from a release of the loop to the end of its run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResponseTime {
    /// The response time is at most this number of ticks, which is within the deadline.
    Within(u64),
    /// The response time exceeds the deadline, at least when all loops are released at once.
    Late,
    /// The response time was not found in 2^20 steps: the rates differ by more than that, and the
    /// processor is almost fully loaded.
    Undecided,
}

/// The response-time analysis of `L` loops, of which faster ones interrupt slower ones: it tells
/// whether every loop always ends before its deadline. It is exact for the given loads, in whole
/// ticks, also for periods that are fractions.
///
/// A loop ends latest when all are due at once (C. L. Liu, J. W. Layland, "Scheduling algorithms for
/// multiprogramming in a hard-real-time environment", Journal of the ACM 20(1), 1973). Its response
/// *R* is then the least solution of *R* = *B* + *C* + Σ ⌈*R* / *Tⱼ*⌉ *Cⱼ* over the faster loops *j*
/// (M. Joseph, P. Pandya, "Finding response times in a real-time system", The Computer Journal 29(5),
/// 1986), with blocking *B* (N. Audsley, A. Burns, M. Richardson, K. Tindell, A. Wellings, "Applying
/// new scheduling theory to static priority pre-emptive scheduling", Software Engineering Journal
/// 8(5), 1993). An overhead counts for the releases of *all* loops, since the timer interrupts
/// the faster loops for the slower ones, too.
///
/// The result holds for every overrun policy, and also while loops are disabled.
///
/// In a constant, a set that cannot be scheduled is an error of compilation:
///
/// ```
/// use condor_mos::{Analysis, Load, LoopId, Rate, ResponseTime};
///
/// const MICROSECONDS: Rate = Rate::hz(1_000_000);
/// const HAND: Analysis<3> = Analysis::new(
///     MICROSECONDS,
///     [
///         Load::new(Rate::hz(400), 900),
///         Load::new(Rate::hz(100), 2_000),
///         Load::new(Rate::hz(50), 3_000).blocked(50), // by the background
///     ],
/// );
/// const { assert!(HAND.is_schedulable()) };
/// assert_eq!(HAND.response(LoopId(2)), Some(ResponseTime::Within(8_650)));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Analysis<const L: usize> {
    frequency: Rate,
    /// By rank, from the fastest on, as is what follows.
    numbers: [u8; L],
    loads: [Load; L],
    responses: [ResponseTime; L],
}

impl<const L: usize> Analysis<L> {
    /// Analyses loops with the loads `loads`, without overhead. `loads[n]` is the load of loop *n*.
    /// Times are in ticks of a clock with `frequency` ticks per second.
    ///
    /// For times in nanoseconds, pass `Rate::hz(1_000_000_000)`.
    #[must_use]
    pub const fn new(frequency: Rate, loads: [Load; L]) -> Self {
        Self::with_overhead(frequency, loads, 0)
    }

    /// Analyses loops as [`new`](Self::new) does, but with an overhead: each release takes
    /// `overhead` more ticks, for the timer's interrupt, and for the start and the end of the loop.
    #[must_use]
    pub const fn with_overhead(frequency: Rate, loads: [Load; L], overhead: u32) -> Self {
        const { assert!(L >= 1 && L <= 32, "an analysis is of 1 to 32 loops") };
        let mut analysis = Self {
            frequency,
            numbers: [0; L],
            loads,
            responses: [ResponseTime::Late; L],
        };
        let mut placed = 0;
        while placed < L {
            // The order of a schedule: equal rates stay in the order of their numbers.
            let load = loads[placed];
            let mut rank = placed;
            while rank > 0 && load.rate.is_faster_than(analysis.loads[rank - 1].rate) {
                analysis.loads[rank] = analysis.loads[rank - 1];
                analysis.numbers[rank] = analysis.numbers[rank - 1];
                rank -= 1;
            }
            analysis.loads[rank] = load;
            analysis.numbers[rank] = placed as u8;
            placed += 1;
        }
        let mut rank = 0;
        while rank < L {
            analysis.responses[rank] = analysis.respond(rank, overhead);
            rank += 1;
        }
        analysis
    }

    /// Analyses the loops of one scheduler with their measured run times, without overhead.
    /// `loops[n]` are the statistics of loop *n*. The result does not cover runs that are longer
    /// than the longest measured ones.
    #[must_use]
    pub fn measured(loops: &[Statistics; L]) -> Self {
        let frequency = loops.first().map_or(Rate::hz(1), |first| first.frequency);
        Self::new(frequency, loops.each_ref().map(Load::measured))
    }

    /// Returns true if the analysis proves that every loop always ends within its period and its
    /// deadline.
    #[must_use]
    pub const fn is_schedulable(&self) -> bool {
        self.first_late().is_none()
    }

    /// Returns the fastest loop whose response time is not [`ResponseTime::Within`]; `None` if all
    /// loops end in time.
    #[must_use]
    pub const fn first_late(&self) -> Option<LoopId> {
        let mut rank = 0;
        while rank < L {
            if !matches!(self.responses[rank], ResponseTime::Within(_)) {
                return Some(LoopId(self.numbers[rank]));
            }
            rank += 1;
        }
        None
    }

    /// Returns the response time of the loop `id`; `None` if there is no such loop.
    #[must_use]
    pub const fn response(&self, id: LoopId) -> Option<ResponseTime> {
        let mut rank = 0;
        while rank < L {
            if self.numbers[rank] == id.0 {
                return Some(self.responses[rank]);
            }
            rank += 1;
        }
        None
    }

    /// Returns the fraction of the processor's time that the loops take, without overhead: 1 is all
    /// of the time.
    #[must_use]
    pub fn utilisation(&self) -> f64 {
        let parts = self
            .loads
            .iter()
            .map(|load| f64::from(load.worst_run) * load.rate.as_hz() / self.frequency.as_hz());
        parts.sum()
    }

    /// Solves the equation for the loop at `rank`, from below: all loops are due at once.
    const fn respond(&self, rank: usize, overhead: u32) -> ResponseTime {
        let own = self.loads[rank];
        let alone = own.worst_run as u64 + own.blocking as u64;
        let mut response = 0;
        let mut step = 0;
        while step < MOST_STEPS {
            let mut needed = alone;
            let mut other = 0;
            while other < L {
                let load = self.loads[other];
                let each = if other < rank { load.worst_run } else { 0 } as u64 + overhead as u64;
                let time = self.releases(load.rate, response).saturating_mul(each);
                needed = needed.saturating_add(time);
                other += 1;
            }
            if needed > own.deadline as u64 && own.deadline != u32::MAX
                || !self.is_within_period(own.rate, needed)
            {
                return ResponseTime::Late;
            }
            if needed == response {
                return ResponseTime::Within(response);
            }
            response = needed;
            step += 1;
        }
        ResponseTime::Undecided
    }

    /// The most releases in `ticks`, of which the first one is at their beginning.
    ///
    /// The scheduler rounds an instant t to ⌊t + ½⌋, which lies in a window of whole ticks if
    /// t lies in a window of the same length half a tick before: as many as with exact instants.
    const fn releases(&self, rate: Rate, ticks: u64) -> u64 {
        let (ticks_of, parts) = self.period(rate);
        let passed = ticks as u128 * parts as u128;
        // Also one at the beginning of no time at all.
        match passed.saturating_sub(1).checked_div(ticks_of as u128) {
            Some(periods) if periods < u64::MAX as u128 => periods as u64 + 1,
            _ => u64::MAX,
        }
    }

    const fn is_within_period(&self, rate: Rate, ticks: u64) -> bool {
        let (ticks_of, parts) = self.period(rate);
        ticks as u128 * parts as u128 <= ticks_of as u128
    }

    /// The period in ticks, as a fraction: a product of two 32-bit numbers is one of 64.
    const fn period(&self, rate: Rate) -> (u64, u64) {
        (
            rate.denominator() as u64 * self.frequency.numerator() as u64,
            rate.numerator() as u64 * self.frequency.denominator() as u64,
        )
    }
}

/// Prints a table of the loops from the fastest on, and the verdict.
impl<const L: usize> fmt::Display for Analysis<L> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let microseconds = |ticks: f64| ticks * 1e6 / self.frequency.as_hz();
        writeln!(
            f,
            "{:>14} {:>5} {:>12} {:>12} {:>12} {:>12}",
            "rate", "loop", "run µs", "blocked µs", "response µs", "period µs"
        )?;
        let rows = self.numbers.iter().zip(&self.loads).zip(&self.responses);
        for ((number, load), response) in rows {
            write!(
                f,
                "{:>14} {number:>5} {:>12.1} {:>12.1} ",
                load.rate,
                microseconds(load.worst_run.into()),
                microseconds(load.blocking.into()),
            )?;
            match response {
                // Below 2^53 ticks nothing is lost.
                #[allow(clippy::cast_precision_loss)]
                ResponseTime::Within(ticks) => write!(f, "{:>12.1}", microseconds(*ticks as f64))?,
                ResponseTime::Late => write!(f, "{:>12}", "late")?,
                ResponseTime::Undecided => write!(f, "{:>12}", "undecided")?,
            }
            writeln!(f, " {:>12.1}", 1e6 / load.rate.as_hz())?;
        }
        match self.first_late() {
            None => write!(f, "schedulable")?,
            Some(id) => write!(f, "not schedulable, from loop {} on", id.0)?,
        }
        write!(f, "; utilisation {:.1} %", 100.0 * self.utilisation())
    }
}
