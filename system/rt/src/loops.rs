//! The counts of a processor's servo loops, for programs that watch it.
//!
//! The program's background publishes the counts, and any process that maps the window reads them.
//! Each loop is an object of [`ObjectKind::Loop`] under its name. The object is a [`Published`] record of
//! 150 words: the rate and the tick frequency, each as numerator and denominator; flags (bit 0:
//! enabled, bit 1: faulted, bit 2: computed); the worst lateness and the worst run time in ticks; then the counts in
//! the order of [`Statistics`] (`running` and `pending` take one word each, the others two, low
//! word first); a zero; and the classes of the [`Histogram`]s of lateness and of run times, 64 each.

use condor_mbox::published::{PublishedReadError, Publisher};
use condor_mbox::{AccessError, Allocator, MemoryWindow, Published, Region};
use condor_mos::{Histogram, Histograms, Rate, Statistics};
use zerocopy::little_endian::U64;
use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::objects::{ObjectError, ObjectKind, ObjectTable, SharedObject};

/// The words of the record.
#[derive(Clone, Copy, Debug, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
struct Row {
    rate: [u32; 2],
    frequency: [u32; 2],
    flags: u32,
    worst_lateness: u32,
    worst_run: u32,
    released: U64,
    run: U64,
    skipped: U64,
    running: u32,
    pending: u32,
    total_run: U64,
    released_before: U64,
    total_before: U64,
    zero: u32,
    lateness: [u32; 64],
    runs: [u32; 64],
}

const _: () = assert!(size_of::<Row>() == 150 * 4);

const ENABLED: u32 = 1 << 0;
const FAULTED: u32 = 1 << 1;
const COMPUTED: u32 = 1 << 2;

/// The publisher of the counts of one servo loop, such as its releases and its worst lateness. The
/// program of the loop holds this object; other processors and the host [`read`] the counts.
#[derive(Debug)]
pub struct LoopReport<W>(Publisher<Row, Region<W>>);

impl<W: MemoryWindow + Clone> LoopReport<W> {
    /// Takes room from `allocator` for the counts of a loop, and enters them in `table` as the loop
    /// `name`, so that others can find them. `region` is the users' region of the program's own
    /// `data`, in which `allocator` hands out room.
    ///
    /// # Errors
    /// [`ObjectError::Access`] if there is no room or the memory cannot be written;
    /// [`ObjectError::Name`] if the name is too long; [`ObjectError::Taken`] if the table has a
    /// loop of this name.
    pub fn new(
        region: &Region<W>,
        allocator: &mut Allocator,
        table: &mut ObjectTable<W>,
        name: &str,
    ) -> Result<Self, ObjectError> {
        let row = table.cell::<Row>(allocator, name, ObjectKind::Loop)?;
        Ok(Self(row.publisher(region.clone())?))
    }

    /// Publishes `counts` and `times` in place of those that were published before.
    ///
    /// # Errors
    /// [`AccessError`] if the memory cannot be written.
    pub fn publish(&mut self, counts: &Statistics, times: &LoopTimes) -> Result<(), AccessError> {
        self.0.publish(&Row::of(counts, times))?;
        Ok(())
    }
}

/// The distributions of the times of a loop, in ticks, since it began or its counts were reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LoopTimes {
    /// The times from releases to the starts of their runs.
    pub lateness: Histogram,
    /// The times of runs, without the loops that interrupted them.
    pub runs: Histogram,
}

impl From<Histograms> for LoopTimes {
    fn from(kept: Histograms) -> Self {
        Self {
            lateness: *kept.lateness(),
            runs: *kept.run(),
        }
    }
}

/// Reads the latest counts and times of a loop that another program has published. `region` is the users'
/// region of the processor on which that program runs, and `object` is the loop's entry in the
/// object table of that processor. Returns `None` if nothing has been published yet, or if the
/// program is publishing at this moment.
///
/// # Errors
/// [`AccessError`] if the memory cannot be read, or if the entry in the table names a place outside of the
/// region.
pub fn read<W: MemoryWindow + Clone>(
    region: &Region<W>,
    object: &SharedObject,
) -> Result<Option<(Statistics, LoopTimes)>, AccessError> {
    let row = Published::<Row>::at(object.offset).subscriber(region.clone())?;
    match row.read() {
        Ok(latest) => Ok(latest.value.counts().zip(Some(latest.value.times()))),
        Err(PublishedReadError::Access(error)) => Err(error),
        Err(_) => Ok(None),
    }
}

impl Row {
    fn of(counts: &Statistics, times: &LoopTimes) -> Self {
        let flag = |is_set, flag| if is_set { flag } else { 0 };
        Self {
            rate: [counts.rate.numerator(), counts.rate.denominator()],
            frequency: [counts.frequency.numerator(), counts.frequency.denominator()],
            flags: flag(counts.enabled, ENABLED)
                | flag(counts.faulted, FAULTED)
                | flag(counts.computed, COMPUTED),
            worst_lateness: counts.worst_lateness,
            worst_run: counts.worst_run,
            released: counts.released.into(),
            run: counts.run.into(),
            skipped: counts.skipped.into(),
            running: counts.running as u32,
            pending: counts.pending as u32,
            total_run: counts.total_run.into(),
            released_before: counts.released_before.into(),
            total_before: counts.total_before.into(),
            zero: 0,
            lateness: *times.lateness.classes(),
            runs: *times.runs.classes(),
        }
    }

    const fn times(&self) -> LoopTimes {
        LoopTimes {
            lateness: Histogram::new(self.lateness),
            runs: Histogram::new(self.runs),
        }
    }

    /// None if no scheduler wrote these words.
    fn counts(&self) -> Option<Statistics> {
        let rate = |[numerator, denominator]: [u32; 2]| Rate::new(numerator, denominator);
        Some(Statistics {
            rate: rate(self.rate)?,
            frequency: rate(self.frequency)?,
            enabled: self.flags & ENABLED != 0,
            faulted: self.flags & FAULTED != 0,
            computed: self.flags & COMPUTED != 0,
            released: self.released.get(),
            run: self.run.get(),
            skipped: self.skipped.get(),
            running: self.running.into(),
            pending: self.pending.into(),
            worst_lateness: self.worst_lateness,
            worst_run: self.worst_run,
            total_run: self.total_run.get(),
            released_before: self.released_before.get(),
            total_before: self.total_before.get(),
        })
    }
}
