//! [`History`]: the values of one variable, for some time back and in bounded memory.

use std::collections::VecDeque;

/// The spans that a level keeps.
const SPANS: usize = 2048;
/// The spans of a level that make one of the next.
const MERGED: usize = 4;
/// The levels: with 1000 samples a second the last one reaches back for 35 minutes.
const LEVELS: usize = 6;

/// The least and the greatest value from one instant to another; both are NaN if the values of that
/// time are not known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Span {
    pub(crate) from_ns: u64,
    pub(crate) to_ns: u64,
    pub(crate) low: f64,
    pub(crate) high: f64,
}

impl Span {
    pub(crate) const fn is_gap(&self) -> bool {
        self.low.is_nan()
    }

    const fn with(self, later: Self) -> Self {
        Self {
            from_ns: self.from_ns,
            to_ns: later.to_ns,
            low: self.low.min(later.low),
            high: self.high.max(later.high),
        }
    }
}

/// A resolution in time. The first level has each sample; a span of another one is up to
/// [`MERGED`] spans of the level before it.
#[derive(Clone, Debug, Default)]
struct Level {
    spans: VecDeque<Span>,
    /// The spans of the level before that do not make a whole one yet, as one, and their number.
    part: Option<(Span, usize)>,
    /// Whether spans have been dropped.
    is_full: bool,
}

impl Level {
    fn reaches(&self, instant_ns: u64) -> bool {
        let first = self.spans.front();
        !self.is_full || first.is_some_and(|span| span.from_ns <= instant_ns)
    }

    /// Returns the place of the first span that ends after an instant.
    fn after(&self, instant_ns: u64) -> usize {
        self.spans.partition_point(|span| span.to_ns <= instant_ns)
    }
}

/// The values of a variable. It keeps at most [`SPANS`] spans on each of [`LEVELS`] levels: 384 KiB.
#[derive(Clone, Debug, Default)]
pub(crate) struct History {
    levels: [Level; LEVELS],
    newest_ns: Option<u64>,
}

impl History {
    /// Adds the value of an instant. A value that is not finite is a gap. If time has gone back, all
    /// earlier values are forgotten: they are of another run.
    pub(crate) fn push(&mut self, at_ns: u64, value: f64) {
        if self.newest_ns.is_some_and(|newest| at_ns < newest) {
            *self = Self::default();
        }
        self.newest_ns = Some(at_ns);
        let value = if value.is_finite() { value } else { f64::NAN };
        let span = Span {
            from_ns: at_ns,
            to_ns: at_ns,
            low: value,
            high: value,
        };
        let [first, ..] = &self.levels;
        let was_gap = first.spans.back().is_none_or(Span::is_gap);
        if !(span.is_gap() && was_gap) {
            add(&mut self.levels, span);
        }
    }

    /// Returns the instant of the newest value, or gap.
    pub(crate) const fn newest_ns(&self) -> Option<u64> {
        self.newest_ns
    }

    /// Iterates over the spans that touch a time, with one more on each side, in the finest
    /// resolution that reaches back to its begin and has at most about `most` spans in it.
    pub(crate) fn spans(
        &self,
        from_ns: u64,
        to_ns: u64,
        most: usize,
    ) -> impl Iterator<Item = Span> + '_ {
        let count = |level: &Level| level.after(to_ns).saturating_sub(level.after(from_ns));
        let reaching = self.levels.iter().enumerate();
        let mut reaching = reaching.filter(|(_, level)| level.reaches(from_ns));
        let chosen = reaching.find(|(_, level)| count(level) <= most);
        let place = chosen.map_or(LEVELS - 1, |(place, _)| place);
        // Values that are too new for a whole span of this level are in the parts, the coarsest first.
        let parts = self.levels.iter().take(place + 1).rev();
        let parts = parts.filter_map(|level| level.part).map(|(part, _)| part);
        let level = self.levels.get(place);
        let begin = level.map_or(0, |level| level.after(from_ns).saturating_sub(1));
        let whole = level
            .into_iter()
            .flat_map(move |it| it.spans.range(begin..));
        let mut is_over = false;
        whole.copied().chain(parts).take_while(move |span| {
            let take = !is_over;
            is_over = span.from_ns > to_ns;
            take
        })
    }

    /// Returns the least and the greatest value of the finest span that is known of an instant: the
    /// value itself unless it is long ago. `None` in a gap, and before the first value.
    pub(crate) fn at(&self, instant_ns: u64) -> Option<(f64, f64)> {
        let level = self.levels.iter().find(|it| it.reaches(instant_ns))?;
        let after = level
            .spans
            .partition_point(|span| span.from_ns <= instant_ns);
        let span = level.spans.get(after.checked_sub(1)?)?;
        (!span.is_gap()).then_some((span.low, span.high))
    }
}

/// Adds a span to the first of some levels, and what becomes whole by it to those behind.
fn add(levels: &mut [Level], span: Span) {
    let Some((level, coarser)) = levels.split_first_mut() else {
        return;
    };
    if level.spans.len() == SPANS {
        level.spans.pop_front();
        level.is_full = true;
    }
    level.spans.push_back(span);
    let Some(next) = coarser.first_mut() else {
        return;
    };
    if span.is_gap() {
        if let Some((part, _)) = next.part.take() {
            add(coarser, part);
        }
        return add(coarser, span);
    }
    let (merged, count) = match next.part.take() {
        Some((part, count)) => (part.with(span), count + 1),
        None => (span, 1),
    };
    if count == MERGED {
        add(coarser, merged);
    } else {
        next.part = Some((merged, count));
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// A sample a millisecond, as the reference keeps it; `None` is a gap.
    type Samples = Vec<Option<i16>>;

    fn history(samples: &Samples) -> History {
        let mut history = History::default();
        for (at, value) in samples.iter().enumerate() {
            history.push(at as u64, value.map_or(f64::NAN, f64::from));
        }
        history
    }

    fn samples() -> impl Strategy<Value = Samples> {
        let value = prop_oneof![30 => any::<i16>().prop_map(Some), 1 => Just(None)];
        proptest::collection::vec(value, 1..9000)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn spans_have_the_least_and_the_greatest_of_their_samples(
            samples in samples(),
            from in 0..9000_u64,
            length in 0..9000_u64,
            most in 1..3000_usize,
        ) {
            let history = history(&samples);
            let to = from + length;
            let mut next = None;
            for span in history.spans(from, to, most) {
                let range = span.from_ns as usize..=span.to_ns as usize;
                let of_span = &samples[range];
                if span.is_gap() {
                    prop_assert_eq!(of_span, &[None]);
                } else {
                    let values: Option<Vec<f64>> =
                        of_span.iter().map(|value| value.map(f64::from)).collect();
                    let values = values.expect("no gap is within a span");
                    let low = values.iter().copied().fold(f64::MAX, f64::min);
                    let high = values.iter().copied().fold(f64::MIN, f64::max);
                    let bits = |low: f64, high: f64| [low.to_bits(), high.to_bits()];
                    prop_assert_eq!(bits(span.low, span.high), bits(low, high));
                }
                // No sample is left out; of several gaps in a row only the first is kept.
                if let Some(next) = next {
                    let skipped = &samples[next as usize..span.from_ns as usize];
                    prop_assert!(skipped.iter().all(Option::is_none), "{:?}", skipped);
                } else if span.from_ns > from {
                    let before = &samples[from as usize..span.from_ns as usize];
                    prop_assert!(before.iter().all(Option::is_none), "{:?}", before);
                }
                next = Some(span.to_ns + 1);
            }
            let end = samples.len().min(to as usize + 1);
            let left = &samples[(next.unwrap_or(from) as usize).min(end)..end];
            prop_assert!(left.iter().all(Option::is_none), "{:?}", left);
        }

        #[test]
        fn a_value_is_that_of_its_instant(samples in samples(), back in 0..SPANS as u64) {
            let history = history(&samples);
            let newest = samples.len() as u64 - 1;
            let at = newest.saturating_sub(back);
            let value = samples[at as usize].map(f64::from);
            // A gap is kept where it begins, so the finest level reaches at least as far back.
            prop_assert_eq!(history.at(at), value.map(|value| (value, value)));
        }
    }

    #[test]
    fn memory_is_bounded_and_reaches_back() {
        let mut history = History::default();
        let hour_ms = 3_600_000_u64;
        for at in 0..hour_ms {
            history.push(at, 0.0);
        }
        assert!(history.levels.iter().all(|it| it.spans.len() <= SPANS));
        assert_eq!(LEVELS * SPANS * size_of::<Span>(), 384 << 10);
        let back = hour_ms - 34 * 60_000;
        assert_eq!(history.at(back), Some((0.0, 0.0)));
        let seen = hour_ms - 60_000;
        assert!(history.spans(seen, hour_ms, 400).count() <= 400 + 2 + LEVELS);
        assert_eq!(history.at(0), None);
    }

    #[test]
    fn a_new_run_forgets_the_former_one() {
        let mut history = History::default();
        history.push(1000, 1.0);
        history.push(10, 2.0);
        assert_eq!(history.at(2000), Some((2.0, 2.0)));
        assert_eq!(history.spans(0, 2000, 10).count(), 1);
        assert_eq!(history.newest_ns(), Some(10));
    }
}
