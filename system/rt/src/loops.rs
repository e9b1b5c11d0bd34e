//! The counts of a processor's servo loops, for programs that watch it.
//!
//! The program's background publishes the counts, and any process that maps the window reads them.
//! Each loop is an object of [`ObjectKind::Loop`] under its name. The object is a [`Published`] record of
//! 22 words: the rate and the tick frequency, each as numerator and denominator; flags (bit 0:
//! enabled, bit 1: faulted); the worst lateness and the worst run time in ticks; then the counts in
//! the order of [`Statistics`] (`running` and `pending` take one word each, the others two, low
//! word first); and a zero.

use condor_mbox::published::{PublishedReadError, Publisher};
use condor_mbox::{AccessError, Allocator, MemoryWindow, Published, Region};
use condor_mos::{Rate, Statistics};

use crate::objects::{ObjectError, ObjectKind, ObjectTable, SharedObject};

type Row = [u32; 22];

const ENABLED: u32 = 1 << 0;
const FAULTED: u32 = 1 << 1;

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

    /// Publishes `counts` in place of the counts that were published before.
    ///
    /// # Errors
    /// [`AccessError`] if the memory cannot be written.
    pub fn publish(&mut self, counts: &Statistics) -> Result<(), AccessError> {
        self.0.publish(&words(counts))?;
        Ok(())
    }
}

/// Reads the latest counts of a loop that another program has published. `region` is the users'
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
) -> Result<Option<Statistics>, AccessError> {
    let row = Published::<Row>::at(object.offset).subscriber(region.clone())?;
    match row.read() {
        Ok(latest) => Ok(counts(&latest.value)),
        Err(PublishedReadError::Access(error)) => Err(error),
        Err(_) => Ok(None),
    }
}

fn words(counts: &Statistics) -> Row {
    let low = |count: u64| count as u32;
    let high = |count: u64| (count >> 32) as u32;
    let flags = if counts.enabled { ENABLED } else { 0 } | if counts.faulted { FAULTED } else { 0 };
    [
        counts.rate.numerator(),
        counts.rate.denominator(),
        counts.frequency.numerator(),
        counts.frequency.denominator(),
        flags,
        counts.worst_lateness,
        counts.worst_run,
        low(counts.released),
        high(counts.released),
        low(counts.run),
        high(counts.run),
        low(counts.skipped),
        high(counts.skipped),
        low(counts.running),
        low(counts.pending),
        low(counts.total_run),
        high(counts.total_run),
        low(counts.released_before),
        high(counts.released_before),
        low(counts.total_before),
        high(counts.total_before),
        0,
    ]
}

/// None if no scheduler wrote these words.
fn counts(row: &Row) -> Option<Statistics> {
    let &[
        rate,
        per,
        frequency,
        in_,
        flags,
        worst_lateness,
        worst_run,
        ref counts @ ..,
    ] = row;
    let &[
        released,
        released_high,
        run,
        run_high,
        skipped,
        skipped_high,
        ..,
    ] = counts;
    let &[
        ..,
        running,
        pending,
        total,
        total_high,
        former,
        former_high,
        before,
        before_high,
        _,
    ] = counts;
    let wide = |low: u32, high: u32| u64::from(high) << 32 | u64::from(low);
    Some(Statistics {
        rate: Rate::new(rate, per)?,
        frequency: Rate::new(frequency, in_)?,
        enabled: flags & ENABLED != 0,
        faulted: flags & FAULTED != 0,
        released: wide(released, released_high),
        run: wide(run, run_high),
        skipped: wide(skipped, skipped_high),
        running: running.into(),
        pending: pending.into(),
        worst_lateness,
        worst_run,
        total_run: wide(total, total_high),
        released_before: wide(former, former_high),
        total_before: wide(before, before_high),
    })
}
