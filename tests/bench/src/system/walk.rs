//! [`Walk`]: which rates of the ladder a load is tried at, and what is found.

use crate::measure::Estimate;

/// The rates, Hz.
pub(super) const LADDER: [u32; 16] = [
    1_000, 2_000, 5_000, 10_000, 15_000, 20_000, 25_000, 30_000, 40_000, 50_000, 75_000, 100_000,
    125_000, 150_000, 200_000, 250_000,
];

/// Begins at a rate and goes up until one is certainly not clean; if none was clean, then down until
/// one is.
#[derive(Clone, Debug)]
pub(super) struct Walk {
    start: Option<usize>,
    next: Option<usize>,
    going_up: bool,
    found: Vec<(u32, Estimate)>,
}

impl Walk {
    /// Begins at the highest rate of the ladder that is at most `rate_hz`.
    pub(super) fn from(rate_hz: u32) -> Self {
        let start = LADDER.iter().rposition(|rung| *rung <= rate_hz);
        Self {
            start,
            next: start,
            going_up: true,
            found: Vec::new(),
        }
    }

    /// Returns the rate to try, if there is any left.
    pub(super) fn next(&self) -> Option<u32> {
        LADDER.get(self.next?).copied()
    }

    /// Records the finding at the present rate, and moves on: `excess` is the number of skips that a round had
    /// more than the control.
    pub(super) fn found(&mut self, excess: Estimate) {
        let (Some(tried), Some(rate)) = (self.next, self.next()) else {
            return;
        };
        self.found.push((rate, excess));
        let above = Some(tried + 1).filter(|above| *above < LADDER.len());
        self.next = match above.filter(|_| self.going_up && excess.low <= 0.0) {
            Some(above) => Some(above),
            None if self.found.iter().any(|(_, excess)| excess.value <= 0.0) => None,
            None => {
                let from = if self.going_up { self.start } else { self.next };
                self.going_up = false;
                from.and_then(|from| from.checked_sub(1))
            }
        };
    }

    /// Returns the highest clean rate, Hz, with the highest that is certainly clean and the highest that is
    /// not certainly unclean; 0 for none.
    pub(super) fn highest_clean(&self) -> Estimate {
        let highest = |is_clean: fn(&Estimate) -> bool| {
            let clean = self.found.iter().filter(|(_, excess)| is_clean(excess));
            f64::from(clean.map(|(rate, _)| *rate).max().unwrap_or(0))
        };
        Estimate {
            value: highest(|excess| excess.value <= 0.0),
            low: highest(|excess| excess.high <= 0.0),
            high: highest(|excess| excess.low <= 0.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the rates that are tried from `start` on if rates up to `clean` are clean and those above
    /// `limit` certainly not, and the findings.
    fn walk(start: u32, clean: u32, limit: u32) -> (Vec<u32>, [f64; 3]) {
        let mut walk = Walk::from(start);
        let mut tried = Vec::new();
        while let Some(rate) = walk.next() {
            tried.push(rate);
            let value = if rate <= clean { 0.0 } else { 9.0 };
            let low = if rate <= limit { -1.0 } else { 3.0 };
            let high = if rate <= 2_000 { 0.0 } else { 99.0 };
            walk.found(Estimate { value, low, high });
        }
        let Estimate { value, low, high } = walk.highest_clean();
        (tried, [low, value, high])
    }

    #[test]
    fn it_goes_up_to_the_first_rate_that_is_certainly_not_clean() {
        let (tried, found) = walk(20_000, 26_000, 31_000);
        assert_eq!(tried, [20_000, 25_000, 30_000, 40_000]);
        assert!(found.iter().eq(&[0.0, 25_000.0, 30_000.0]), "{found:?}");
        let (tried, found) = walk(200_000, u32::MAX, u32::MAX);
        assert_eq!(tried, [200_000, 250_000]);
        assert!(found.iter().eq(&[0.0, 250_000.0, 250_000.0]), "{found:?}");
    }

    #[test]
    fn it_goes_down_to_the_first_rate_that_is_clean() {
        let (tried, found) = walk(20_000, 10_000, 20_000);
        assert_eq!(tried, [20_000, 25_000, 15_000, 10_000]);
        assert!(found.iter().eq(&[0.0, 10_000.0, 20_000.0]), "{found:?}");
        let (tried, found) = walk(5_000, 0, 0);
        assert_eq!(tried, [5_000, 2_000, 1_000]);
        assert!(found.iter().eq(&[2_000.0, 0.0, 0.0]), "{found:?}");
    }
}
