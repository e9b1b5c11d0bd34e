//! [`Set`]: the rates of a schedule, and their order.

use super::Grid;
use crate::clock::ClockSpec;
use crate::error::RateError;
use crate::rate::{Rate, greatest_common_divisor};

/// Up to `L` loops: their rates and phases by number, and their ranks by speed.
///
/// Ranks number the loops from the fastest, 0, on; loops of one rate in their own order.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Set<const L: usize> {
    count: usize,
    rates: [Rate; L],
    /// Ticks from the start to the first release.
    phases: [u32; L],
    /// The number of the loop at each rank; [`NOBODY`] behind the last loop.
    ranks: [u8; L],
}

/// No loop has this number.
const NOBODY: u8 = u8::MAX;

impl<const L: usize> Set<L> {
    /// The set of loops with these rates, and with these phases as far as there are any.
    pub(super) const fn new(rates: &[Rate], phases: &[u32]) -> Result<Self, RateError> {
        const { assert!(L >= 1 && L <= 32, "a schedule is of 1 to 32 loops") };
        if rates.is_empty() || rates.len() > L {
            return Err(RateError::Loops {
                loops: rates.len(),
                capacity: L,
            });
        }
        let mut set = Self {
            count: rates.len(),
            rates: [const { Rate::hz(1) }; L],
            phases: [0; L],
            ranks: [NOBODY; L],
        };
        let mut number = 0;
        while number < L && number < rates.len() {
            set.rates[number] = rates[number];
            if number < phases.len() {
                set.phases[number] = phases[number];
            }
            number += 1;
        }
        set.sort();
        Ok(set)
    }

    /// Puts the ranks in order.
    const fn sort(&mut self) {
        // No index comes out of a table, so that none can be wrong.
        let mut sorted = self.rates;
        let mut placed = 0;
        while placed < L && placed < self.count {
            // Insertion from the end: equal rates stay in the order of their numbers.
            let mut rank = placed;
            while rank > 0 && self.rates[placed].is_faster_than(sorted[rank - 1]) {
                sorted[rank] = sorted[rank - 1];
                self.ranks[rank] = self.ranks[rank - 1];
                rank -= 1;
            }
            sorted[rank] = self.rates[placed];
            self.ranks[rank] = placed as u8;
            placed += 1;
        }
    }

    /// The same loops, one of them at another rate.
    pub(super) fn with_rate(mut self, number: usize, rate: Rate) -> Self {
        if let Some(place) = self.rates.get_mut(number) {
            *place = rate;
        }
        self.sort();
        self
    }

    /// The rates by number.
    pub(crate) const fn rates(&self) -> &[Rate] {
        match self.rates.split_at_checked(self.count) {
            Some((rates, _)) => rates,
            None => &self.rates,
        }
    }

    /// The number of the loop at each rank, as far as there are any.
    #[inline]
    pub(crate) const fn ranks(&self) -> &[u8; L] {
        &self.ranks
    }

    /// The rank of a loop.
    pub(crate) fn rank(&self, number: usize) -> Option<usize> {
        let same = |other: &u8| usize::from(*other) == number;
        self.ranks.iter().position(same)
    }

    /// For each rank of `after`, the rank that its loop has here.
    pub(super) fn former_ranks(&self, after: &Self) -> [u8; L] {
        after
            .ranks
            .map(|number| self.rank(usize::from(number)).unwrap_or(0) as u8)
    }

    /// The rate and the phase of the loop at a rank.
    pub(crate) const fn at_rank(&self, rank: usize) -> Option<(Rate, u32)> {
        if rank >= L {
            return None;
        }
        let number = self.ranks[rank] as usize;
        if number >= L {
            return None;
        }
        Some((self.rates[number], self.phases[number]))
    }

    /// The hyperperiod in ticks: the inverse of the rates' greatest common divisor; `None` if it is
    /// too long to be counted.
    pub(super) const fn cycle(&self, clock: ClockSpec) -> Option<Grid> {
        let (mut numerator, mut denominator) = (0, 1_u64);
        let mut number = 0;
        while number < L && number < self.count {
            let rate = self.rates[number];
            let divisor = greatest_common_divisor(denominator, rate.denominator() as u64);
            numerator = greatest_common_divisor(numerator, rate.numerator() as u64);
            let Some(quotient) = denominator.checked_div(divisor) else {
                return None;
            };
            denominator = match quotient.checked_mul(rate.denominator() as u64) {
                Some(product) => product,
                None => return None,
            };
            number += 1;
        }
        let frequency = clock.frequency();
        // Not above the product of the two 32-bit numbers that it divides.
        let parts = numerator * frequency.denominator() as u64;
        match (frequency.numerator() as u64).checked_mul(denominator) {
            Some(ticks) => Grid::of_fraction(ticks, parts),
            None => None,
        }
    }
}
