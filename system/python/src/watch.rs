//! [`Watch`]: rows of variables, kept until Python reads them.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use condor_host::watching::{CatalogEntry, RowSource, Rows, SourceRow};
use condor_vars::ValueKind;
use pyo3::prelude::*;
use pyo3::types::{PyByteArray, PyList};

use crate::failure::{Failure, seconds};
use crate::values::types;

/// The time between two looks whether somebody has pressed Ctrl-C.
pub(crate) const SLICE: Duration = Duration::from_millis(100);

/// The rows that the thread of a system reads and Python takes.
pub(crate) struct WatchState {
    kept: Mutex<KeptRow>,
    more: Condvar,
    is_closed: AtomicBool,
}

struct KeptRow {
    sources: Vec<Series>,
    changes: Vec<String>,
    failure: Option<Failure>,
}

/// The rows of one loop or cell, until Python takes them.
struct Series {
    name: String,
    columns: Vec<Column>,
    capacity: usize,
    ticks: Vec<u64>,
    released_ns: Vec<u64>,
    lost: Vec<u64>,
    words: Vec<u32>,
    /// The number of rows that were lost since the last row in this list, for lack of room here or before.
    overflow: u64,
}

struct Column {
    name: String,
    kind: ValueKind,
    unit: String,
    labels: Vec<String>,
}

impl WatchState {
    /// Makes room for `most` rows of each source in `rows`. `labels` are the names of `columns` for Python.
    pub(crate) fn new(
        rows: &Rows<'_>,
        columns: &[&CatalogEntry],
        labels: &[String],
        most: usize,
    ) -> Self {
        let series = |source: &RowSource| {
            let fields = source.fields().iter();
            let columns = fields.filter_map(|field| {
                let place = *field.columns.first()?;
                let one = columns.get(place)?;
                Some(Column {
                    name: labels.get(place)?.clone(),
                    kind: field.kind,
                    unit: one.entry.unit.to_string(),
                    labels: one.of.labels.clone(),
                })
            });
            Series {
                name: source.name(),
                columns: columns.collect(),
                capacity: most,
                ticks: Vec::new(),
                released_ns: Vec::new(),
                lost: Vec::new(),
                words: Vec::new(),
                overflow: 0,
            }
        };
        Self {
            kept: Mutex::new(KeptRow {
                sources: rows.sources.iter().map(series).collect(),
                changes: Vec::new(),
                failure: None,
            }),
            more: Condvar::new(),
            is_closed: AtomicBool::new(false),
        }
    }

    /// Returns true if Python wants no more rows, or if no more can come.
    pub(crate) fn is_closed(&self) -> bool {
        self.is_closed.load(Ordering::Relaxed)
    }

    /// Adds all rows that `rows` has now.
    pub(crate) fn fill(&self, rows: &mut Rows<'_>) {
        let mut kept = self.lock();
        let read = rows.read(|source, row| {
            if let Some(series) = kept.sources.get_mut(source) {
                series.push(row);
            }
        });
        let changes = rows.changes().into_iter().map(|change| change.text);
        kept.changes.extend(changes);
        if let Err(error) = read {
            kept.failure = Some(error.into());
            self.is_closed.store(true, Ordering::Relaxed);
        }
        drop(kept);
        self.more.notify_all();
    }

    fn lock(&self) -> MutexGuard<'_, KeptRow> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Series {
    fn push(&mut self, row: &SourceRow<'_>) {
        let lost = self.overflow.saturating_add(row.lost.into());
        if self.ticks.len() >= self.capacity {
            self.overflow = lost.saturating_add(1);
            return;
        }
        self.overflow = 0;
        self.ticks.push(row.tick);
        self.released_ns.push(row.released.as_ns());
        self.lost.push(lost);
        self.words.extend(row.words);
    }

    /// Returns true if there are at least `rows` rows, and at least `span_ns` between the first and the last.
    fn has(&self, rows: usize, span_ns: u64) -> bool {
        let span = match (self.released_ns.first(), self.released_ns.last()) {
            (Some(first), Some(last)) => last.saturating_sub(*first),
            _ => 0,
        };
        self.ticks.len() >= rows && span >= span_ns
    }

    /// Returns the rows so far, and begins a new list.
    fn take(&mut self) -> Self {
        let columns = self.columns.iter().map(|column| Column {
            name: column.name.clone(),
            kind: column.kind,
            unit: column.unit.clone(),
            labels: column.labels.clone(),
        });
        Self {
            name: self.name.clone(),
            columns: columns.collect(),
            ticks: core::mem::take(&mut self.ticks),
            released_ns: core::mem::take(&mut self.released_ns),
            lost: core::mem::take(&mut self.lost),
            words: core::mem::take(&mut self.words),
            ..*self
        }
    }

    /// Returns `(name, ticks, times, losses, columns)`; a column is `(name, unit, labels, type of the bytes, type,
    /// bytes)`.
    fn to_python<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let numbers = |all: &[u64]| {
            let bytes: Vec<u8> = all.iter().flat_map(|it| it.to_le_bytes()).collect();
            PyByteArray::new(py, &bytes)
        };
        let all: usize = self.columns.iter().map(|column| column.kind.words()).sum();
        let columns = PyList::empty(py);
        let mut at = 0;
        for column in &self.columns {
            let own = column.kind.words();
            let rows = self.words.chunks_exact(all.max(1));
            let words = rows.filter_map(|row| row.get(at..at + own)).flatten();
            let bytes: Vec<u8> = words.flat_map(|word| word.to_le_bytes()).collect();
            at += own;
            let (stored, wanted) = types(column.kind);
            let (name, unit, labels) = (&column.name, &column.unit, &column.labels);
            columns.append((
                name,
                unit,
                labels,
                stored,
                wanted,
                PyByteArray::new(py, &bytes),
            ))?;
        }
        let times = numbers(&self.released_ns);
        let lost = numbers(&self.lost);
        let all = (&self.name, numbers(&self.ticks), times, lost, columns);
        Ok(all.into_pyobject(py)?.into_any())
    }
}

/// Variables whose rows a thread reads and keeps, whatever Python does meanwhile.
#[pyclass(frozen)]
pub(crate) struct Watch {
    pub(crate) shared: Arc<WatchState>,
}

#[pymethods]
impl Watch {
    /// Waits until each source has at least `rows` rows, and at least `span` seconds between its first and last one.
    /// Returns all rows since the last call.
    fn read<'py>(
        &self,
        py: Python<'py>,
        rows: usize,
        span: f64,
        timeout: f64,
    ) -> PyResult<Bound<'py, PyList>> {
        let span_ns = seconds("seconds", span)?.as_nanos() as u64;
        let limit = seconds("timeout", timeout)?;
        let begun = Instant::now();
        let taken: Vec<Series> = loop {
            let left = limit.saturating_sub(begun.elapsed());
            let taken = py.detach(|| self.shared.wait(rows, span_ns, left.min(SLICE)));
            if let Some(taken) = taken? {
                break taken;
            }
            if begun.elapsed() >= limit {
                return Err(self.shared.late(rows, span, span_ns, limit).into());
            }
            py.check_signals()?;
        };
        let all = PyList::empty(py);
        for series in &taken {
            all.append(series.to_python(py)?)?;
        }
        Ok(all)
    }

    /// Returns a text for each source whose program has ended, is back, or cannot be read, since the last call.
    fn changes(&self) -> Vec<String> {
        core::mem::take(&mut self.shared.lock().changes)
    }

    /// Stops watching. The slots of the loops become free soon after.
    fn close(&self) {
        self.shared.is_closed.store(true, Ordering::Relaxed);
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        self.close();
    }
}

impl WatchState {
    /// Returns the rows of all sources if there are enough within `limit`; `None` otherwise.
    fn wait(
        &self,
        rows: usize,
        span_ns: u64,
        limit: Duration,
    ) -> Result<Option<Vec<Series>>, Failure> {
        let has_enough = |kept: &KeptRow| kept.sources.iter().all(|it| it.has(rows, span_ns));
        let lacks = |kept: &mut KeptRow| kept.failure.is_none() && !has_enough(kept);
        let waited = self.more.wait_timeout_while(self.lock(), limit, lacks);
        let (mut kept, _) = waited.unwrap_or_else(PoisonError::into_inner);
        match &kept.failure {
            // Rows that came before the failure are read first.
            Some(failure) if rows == 0 && span_ns == 0 || !has_enough(&kept) => {
                Err(failure.clone())
            }
            None if !has_enough(&kept) => Ok(None),
            _ => Ok(Some(kept.sources.iter_mut().map(Series::take).collect())),
        }
    }

    /// Makes the error that names the sources with too few rows.
    fn late(&self, rows: usize, span: f64, span_ns: u64, limit: Duration) -> Failure {
        let kept = self.lock();
        let late = kept.sources.iter().filter(|it| !it.has(rows, span_ns));
        let late: Vec<_> = late
            .map(|it| format!("{} ({} rows)", it.name, it.ticks.len()))
            .collect();
        let (late, limit) = (late.join(", "), limit.as_secs_f64());
        Failure::timed_out(format!(
            "{late}: {rows} rows that span {span} s have not come within {limit} s; `top` shows whether the loop is \
             enabled"
        ))
    }
}
