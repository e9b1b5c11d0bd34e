//! [`Merge`]: rows of several processors in one order of time.

use std::collections::VecDeque;
use std::time::Duration;

use condor_mbox::Instant;

/// A merge of the rows of several sources, each in the order of time, into one order of time.
///
/// A source is a loop of some processor. The earliest row is returned as soon as every other source
/// has delivered a later one, so that no earlier row can come. A source may be silent, because its
/// loop was stopped or its watcher selects rarely. A silent source does not hold the others back
/// for ever: a row that is older than the newest by more than the *horizon* is returned all the
/// same. A row that comes later than that may be returned after a later one.
///
/// ```
/// use std::time::Duration;
/// use condor_mbox::Instant;
/// use condor_vars::Merge;
///
/// let mut merge = Merge::new(2, Duration::from_millis(10));
/// merge.push(0, Instant::from_ns(1_000), "a");
/// assert!(merge.pop().is_none()); // source 1 may still have something earlier
/// merge.push(1, Instant::from_ns(1_500), "b");
/// assert_eq!(merge.pop().unwrap().item, "a");
/// assert!(merge.pop().is_none());
/// assert_eq!(merge.finish().next().unwrap().item, "b");
/// ```
#[derive(Debug)]
pub struct Merge<T> {
    sources: Vec<Source<T>>,
    horizon: Duration,
    /// The time of the newest row that was added.
    newest: Instant,
}

#[derive(Debug)]
struct Source<T> {
    /// The time of the last row that was added.
    last: Option<Instant>,
    waiting: VecDeque<(Instant, T)>,
}

/// A row that a [`Merge`] has put into the common order of time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MergedRow<T> {
    /// The index of the source.
    pub source: usize,
    /// The time of the row.
    pub at: Instant,
    /// The row that was passed to [`Merge::push`].
    pub item: T,
}

impl<T> Merge<T> {
    /// Makes a merge of `sources` sources, which have the indices from 0 on. A row waits for silent
    /// sources until a row of another source is later by more than `horizon`.
    #[must_use]
    pub fn new(sources: usize, horizon: Duration) -> Self {
        let source = || Source {
            last: None,
            waiting: VecDeque::new(),
        };
        Self {
            sources: (0..sources).map(|_| source()).collect(),
            horizon,
            newest: Instant::from_ns(0),
        }
    }

    /// Adds the row `item` of the source with index `source`. `at` is the time of the row. Returns
    /// `None`; returns the row if there is no such source.
    pub fn push(&mut self, source: usize, at: Instant, item: T) -> Option<T> {
        let Some(source) = self.sources.get_mut(source) else {
            return Some(item);
        };
        source.last = Some(at);
        source.waiting.push_back((at, item));
        self.newest = self.newest.max(at);
        None
    }

    /// Removes and returns the earliest row, if no earlier row can come, or if this row is older
    /// than the newest row by more than the horizon. Returns `None` otherwise.
    pub fn pop(&mut self) -> Option<MergedRow<T>> {
        let (earliest, at) = self.earliest()?;
        let others = self.sources.iter().enumerate();
        let mut others = others.filter(|(number, _)| *number != earliest);
        let is_first = others.all(|(_, source)| source.last.is_some_and(|last| last >= at));
        let is_old = Duration::from_nanos(self.newest.ns_since(at)) > self.horizon;
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

    fn earliest(&self) -> Option<(usize, Instant)> {
        let sources = self.sources.iter().enumerate();
        let fronts = sources.filter_map(|(number, it)| Some((number, it.waiting.front()?.0)));
        fronts.min_by_key(|(_, at)| *at)
    }

    fn take(&mut self, source: usize) -> Option<MergedRow<T>> {
        let (at, item) = self.sources.get_mut(source)?.waiting.pop_front()?;
        Some(MergedRow { source, at, item })
    }
}
