//! Estimates with intervals, and goals, from figures of single rounds.
//!
//! Two programs, or one program on two mappings of memory, differ by chance more than the
//! things that are compared. So everything is a ratio of two figures of the *same* round, and
//! what is reported is the median of these ratios over the rounds with an interval that holds
//! the true median in at least 95 of 100 runs, whatever the distribution (order statistics).

use std::fmt;

/// The chance that an interval may miss the median.
const RISK: f64 = 0.05;

/// Returns the `quantile` (0 to 1) of `values`, which it sorts; 0 if there are none.
pub(crate) fn quantile<T: Copy + Into<f64>>(values: &mut [T], quantile: f64) -> f64 {
    values.sort_unstable_by(|a, b| (*a).into().total_cmp(&(*b).into()));
    let rank = (values.len() as f64 * quantile).ceil().max(1.0);
    // Not negative, and at most the number of values.
    #[allow(clippy::cast_sign_loss)]
    let index = rank as usize - 1;
    values.get(index).map_or(0.0, |value| (*value).into())
}

/// A median over rounds, and the interval that holds the true one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Estimate {
    /// The median.
    pub(crate) value: f64,
    /// The lower end of the interval.
    pub(crate) low: f64,
    /// The upper end of the interval.
    pub(crate) high: f64,
}

impl Estimate {
    /// Makes an estimate from one value a round.
    pub(crate) fn of(rounds: impl IntoIterator<Item = f64>) -> Self {
        let mut values: Vec<f64> = rounds.into_iter().collect();
        let value = {
            let lower = quantile(&mut values, 0.5);
            let upper = values.get(values.len() / 2).copied().unwrap_or_default();
            f64::midpoint(lower, upper)
        };
        let outside = ranks_outside(values.len());
        Self {
            value,
            low: values.get(outside).copied().unwrap_or_default(),
            high: values
                .iter()
                .rev()
                .nth(outside)
                .copied()
                .unwrap_or_default(),
        }
    }

    /// Returns the estimate of a figure that is the same every time.
    pub(crate) fn exactly(value: f64) -> Self {
        let (low, high) = (value, value);
        Self { value, low, high }
    }

    /// Makes an estimate from the ratio of two figures of every round.
    pub(crate) fn ratio(
        these: impl IntoIterator<Item = f64>,
        to: impl IntoIterator<Item = f64>,
    ) -> Self {
        Self::of(these.into_iter().zip(to).map(|(this, to)| this / to))
    }
}

impl fmt::Display for Estimate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let digits = f.precision().unwrap_or(2);
        let Self { value, low, high } = *self;
        let [value, low, high] = [value, low, high].map(|figure| number(figure, digits));
        let text = format!("{value} [{low}, {high}]");
        // The precision was for the numbers; `pad` would cut the text to it.
        write!(f, "{text:<width$}", width = f.width().unwrap_or(0))
    }
}

/// Returns the number with `digits` digits after the point, or as a power of ten where those would all be
/// zero.
fn number(value: f64, digits: usize) -> String {
    if value != 0.0 && value.abs() < 0.1_f64.powi(i32::try_from(digits).unwrap_or(i32::MAX)) {
        format!("{value:.1e}")
    } else {
        format!("{value:.digits$}")
    }
}

/// Returns how many of `count` sorted values may be left out at either end of the interval.
fn ranks_outside(count: usize) -> usize {
    let mut outside = 0;
    // Binomial with probability 1/2: the chance that at most `outside` values lie below.
    let mut term = 0.5_f64.powi(i32::try_from(count).unwrap_or(i32::MAX));
    let mut below = term;
    while outside < count / 2 {
        term *= (count - outside) as f64 / (outside + 1) as f64;
        below += term;
        if 2.0 * below > RISK {
            break;
        }
        outside += 1;
    }
    outside
}

/// The direction in which a figure should go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Better {
    /// Small figures are good.
    Lower,
    /// Large figures are good.
    Higher,
}

/// The result of the comparison of a figure with its goal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// The median reaches the goal.
    Met,
    /// The median does not, but the goal is inside the interval.
    Open,
    /// The whole interval is beyond the goal.
    Short,
}

/// A figure with a goal.
#[derive(Clone, Debug)]
pub(crate) struct Goal {
    /// The name of the figure, as reports print it.
    pub(crate) name: &'static str,
    /// The figure that was measured.
    pub(crate) estimate: Estimate,
    /// The value that the figure should reach.
    pub(crate) limit: f64,
    /// The side of `limit` on which the figure should be.
    better: Better,
}

impl Goal {
    /// Makes a goal of a figure that should be at most `limit`.
    pub(crate) fn most(name: &'static str, estimate: Estimate, limit: f64) -> Self {
        Self::new(name, estimate, limit, Better::Lower)
    }

    /// Makes a goal of a figure that should be at least `limit`.
    pub(crate) fn least(name: &'static str, estimate: Estimate, limit: f64) -> Self {
        Self::new(name, estimate, limit, Better::Higher)
    }

    fn new(name: &'static str, estimate: Estimate, limit: f64, better: Better) -> Self {
        Self {
            name,
            estimate,
            limit,
            better,
        }
    }

    /// Compares the figure with its goal.
    pub(crate) fn verdict(&self) -> Verdict {
        let Estimate { value, low, high } = self.estimate;
        let (median, best) = match self.better {
            Better::Lower => (value <= self.limit, low <= self.limit),
            Better::Higher => (value >= self.limit, high >= self.limit),
        };
        match (median, best) {
            (true, _) => Verdict::Met,
            (false, true) => Verdict::Open,
            (false, false) => Verdict::Short,
        }
    }
}

/// The findings of a sub-command.
#[derive(Debug)]
pub(crate) struct Report {
    /// Tables and remarks for people.
    pub(crate) text: String,
    /// The figures that have goals.
    pub(crate) goals: Vec<Goal>,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)?;
        if self.goals.is_empty() {
            return Ok(());
        }
        writeln!(f, "\n{:38} {:22} {:>7}", "goal", "median [95 %]", "goal")?;
        for goal in &self.goals {
            let sign = match goal.better {
                Better::Lower => '≤',
                Better::Higher => '≥',
            };
            let verdict = match goal.verdict() {
                Verdict::Met => "met",
                Verdict::Open => "not shown: the goal is inside the interval",
                Verdict::Short => "FALLS SHORT",
            };
            writeln!(
                f,
                "{:38} {:22} {sign} {:>5}  {verdict}",
                goal.name,
                goal.estimate,
                number(goal.limit, 2)
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interval_of_the_median_has_the_ranks_of_the_binomial() {
        assert_eq!([6, 7, 8, 9, 15, 31].map(ranks_outside), [0, 0, 0, 1, 3, 9]);
        assert_eq!(ranks_outside(0), 0);
    }

    #[test]
    fn estimate_takes_the_middle() {
        let odd = Estimate::of((1..=9).map(f64::from));
        assert_eq!(
            odd,
            Estimate {
                value: 5.0,
                low: 2.0,
                high: 8.0
            }
        );
        assert_eq!(
            Estimate::of([4.0, 1.0, 3.0, 2.0]),
            Estimate {
                value: 2.5,
                low: 1.0,
                high: 4.0
            }
        );
        let ratio = Estimate::ratio([2.0, 6.0], [1.0, 2.0]);
        assert_eq!(
            ratio,
            Estimate {
                value: 2.5,
                low: 2.0,
                high: 3.0
            }
        );
    }

    #[test]
    fn quantiles_are_ranks() {
        let mut values: Vec<u32> = (1..=100).rev().collect();
        let ranks = [0.0, 0.5, 0.99, 1.0].map(|rank| quantile(&mut values, rank));
        assert!(ranks.iter().eq(&[1.0, 50.0, 99.0, 100.0]), "{ranks:?}");
        assert!(quantile::<u32>(&mut [], 0.5).total_cmp(&0.0).is_eq());
    }

    #[test]
    fn a_goal_falls_short_when_the_whole_interval_is_beyond_it() {
        type Make = fn(&'static str, Estimate, f64) -> Goal;
        let verdict =
            |make: Make, low, value, high| make("x", Estimate { value, low, high }, 2.0).verdict();
        assert_eq!(verdict(Goal::most, 1.0, 1.5, 3.0), Verdict::Met);
        assert_eq!(verdict(Goal::most, 1.0, 2.5, 3.0), Verdict::Open);
        assert_eq!(verdict(Goal::most, 2.1, 2.5, 3.0), Verdict::Short);
        assert_eq!(verdict(Goal::least, 1.0, 1.5, 1.9), Verdict::Short);
        assert_eq!(verdict(Goal::least, 1.0, 1.5, 2.9), Verdict::Open);
    }

    #[test]
    fn small_figures_are_no_zeros() {
        let figures = [0.0, 0.0123, 1.5, 3.3e-16].map(|figure| number(figure, 2));
        assert_eq!(figures, ["0.00", "0.01", "1.50", "3.3e-16"]);
        assert_eq!(number(-1e-12, 4), "-1.0e-12");
    }
}
