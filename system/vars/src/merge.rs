//! [`Merge`]: rows of several processors in one order of time.

use std::collections::VecDeque;
use std::time::Duration;

use condor_mbox::Instant;

/// A merge of the rows of several sources, each in the order of its own clock, into one order of
/// time.
///
/// A source is a loop of some processor. The earliest row is returned as soon as every other source
/// has delivered a later one, so that no earlier row can come. A source may be silent, because its
/// loop was stopped or its watcher selects rarely. A silent source does not hold the others back
/// for ever: a row that is older than the newest by more than the *horizon* is returned all the
/// same.
///
/// ```
/// use std::time::Duration;
/// use condor_mbox::Instant;
/// use condor_vars::Merge;
///
/// let mut merge = Merge::new(2, Duration::from_millis(10));
/// merge.set_offset(1, -500); // the clock of source 1 is 500 ns ahead
/// merge.push(0, Instant::from_ns(1_000), "a");
/// assert!(merge.pop().is_none()); // source 1 may still have something earlier
/// merge.push(1, Instant::from_ns(2_000), "b");
/// assert_eq!(merge.pop().unwrap().item, "a");
/// assert!(merge.pop().is_none());
/// assert_eq!(merge.finish().next().unwrap().at_ns, 1_500);
/// ```
#[derive(Debug)]
pub struct Merge<T> {
    sources: Vec<Source<T>>,
    horizon_ns: i128,
    /// The times of the last row that was returned, and of the newest that was added.
    given_ns: i128,
    newest_ns: i128,
}

#[derive(Debug)]
struct Source<T> {
    offset_ns: i64,
    /// The time of the last row that was added.
    last_ns: i128,
    waiting: VecDeque<(i128, T)>,
}

/// A row that a [`Merge`] has put into the common order of time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MergedRow<T> {
    /// The index of the source.
    pub source: usize,
    /// The time in nanoseconds: the time on the clock of the source plus the source's offset.
    pub at_ns: i128,
    /// True if a later row was returned before this one: this row came later than the horizon allows, or the
    /// offset of its clock has changed.
    pub is_late: bool,
    /// The row that was passed to [`Merge::push`].
    pub item: T,
}

impl<T> Merge<T> {
    /// Makes a merge of `sources` sources, which have the indices from 0 on. A row waits for silent
    /// sources until a row of another source is later by more than `horizon`.
    #[must_use]
    pub fn new(sources: usize, horizon: Duration) -> Self {
        let source = || Source {
            offset_ns: 0,
            last_ns: i128::MIN,
            waiting: VecDeque::new(),
        };
        Self {
            sources: (0..sources).map(|_| source()).collect(),
            horizon_ns: i128::try_from(horizon.as_nanos()).unwrap_or(i128::MAX),
            given_ns: i128::MIN,
            newest_ns: i128::MIN,
        }
    }

    /// Sets the offset of the source with index `source`, in nanoseconds. Later calls of
    /// [`push`](Self::push) add it to the times of this source. Does nothing if there is no such
    /// source.
    pub fn set_offset(&mut self, source: usize, offset_ns: i64) {
        if let Some(source) = self.sources.get_mut(source) {
            source.offset_ns = offset_ns;
        }
    }

    /// Adds the row `item` of the source with index `source`. `at` is the time of the row on the
    /// clock of that source. Returns `None`; returns the row if there is no such source.
    pub fn push(&mut self, source: usize, at: Instant, item: T) -> Option<T> {
        let Some(source) = self.sources.get_mut(source) else {
            return Some(item);
        };
        let at_ns = i128::from(at.as_ns()) + i128::from(source.offset_ns);
        source.last_ns = at_ns;
        source.waiting.push_back((at_ns, item));
        self.newest_ns = self.newest_ns.max(at_ns);
        None
    }

    /// Removes and returns the earliest row, if no earlier row can come, or if this row is older
    /// than the newest row by more than the horizon. Returns `None` otherwise.
    pub fn pop(&mut self) -> Option<MergedRow<T>> {
        let (earliest, at_ns) = self.earliest()?;
        let others = self.sources.iter().enumerate();
        let mut others = others.filter(|(number, _)| *number != earliest);
        let is_first = others.all(|(_, source)| source.last_ns >= at_ns);
        let is_old = self.newest_ns.saturating_sub(at_ns) > self.horizon_ns;
        if is_first || is_old {
            self.take(earliest)
        } else {
            None
        }
    }

    /// Removes and returns all remaining rows, one after the other in order of time. Call it when
    /// no more rows come.
    pub fn finish(&mut self) -> impl Iterator<Item = MergedRow<T>> + '_ {
        core::iter::from_fn(|| {
            let (earliest, _) = self.earliest()?;
            self.take(earliest)
        })
    }

    fn earliest(&self) -> Option<(usize, i128)> {
        let sources = self.sources.iter().enumerate();
        let fronts = sources.filter_map(|(number, it)| Some((number, it.waiting.front()?.0)));
        fronts.min_by_key(|(_, at_ns)| *at_ns)
    }

    fn take(&mut self, number: usize) -> Option<MergedRow<T>> {
        let (at_ns, item) = self.sources.get_mut(number)?.waiting.pop_front()?;
        let is_late = at_ns < self.given_ns;
        self.given_ns = self.given_ns.max(at_ns);
        Some(MergedRow {
            source: number,
            at_ns,
            is_late,
            item,
        })
    }
}
