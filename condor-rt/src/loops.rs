//! The counts of a processor's servo loops, for whoever watches.
//!
//! The program's background publishes them, and any process that maps the window reads them.
//! The object has a row for each loop: its name (16 bytes), then a
//! [`Published`] record of 22 words: rate and tick frequency as numerator and denominator, flags
//! (bit 0 enabled, bit 1 faulted), the worst lateness and run, then the counts in the order of
//! [`Statistics`] (`running` and `pending` in one word each, the others in two, low one first), and
//! a zero.

use condor_mbox::published::{Publisher, ReadError};
use condor_mbox::{AccessError, MemoryWindow, Places, Published, Region};
use condor_mos::{Rate, Statistics};

use crate::directory::{Directory, DirectoryError, Entry, Kind, Name};

type Row = [u32; 22];

const NAME_BYTES: u32 = 16;
const ROW_BYTES: u32 = NAME_BYTES + Published::<Row>::BYTES;
const ENABLED: u32 = 1 << 0;
const FAULTED: u32 = 1 << 1;

/// The program's end: the counts of its `L` loops.
#[derive(Debug)]
pub struct LoopReports<W, const L: usize> {
    rows: heapless::Vec<Publisher<Row, Region<W>>, L>,
}

impl<W: MemoryWindow + Clone, const L: usize> LoopReports<W, L> {
    /// Rows for loops of these names, of which the first `L` count, entered in `directory`.
    ///
    /// # Errors
    /// No room in the window or in the directory.
    pub fn new<'n>(
        region: &Region<W>,
        places: &mut Places,
        directory: &mut Directory<W>,
        names: impl IntoIterator<Item = &'n str, IntoIter: Clone>,
    ) -> Result<Self, DirectoryError> {
        let names = names.into_iter().take(L);
        let len = names.clone().count() as u32 * ROW_BYTES;
        let offset = places.bytes(len as usize)?;
        let mut rows = heapless::Vec::new();
        for (number, name) in (0_u32..).zip(names) {
            let at = offset + number * ROW_BYTES;
            region.write(at, Name::new(name).bytes())?;
            let row = Published::at(at + NAME_BYTES).publisher(region.clone())?;
            // As many as there are names.
            let _ = rows.push(row);
        }
        directory.enter("loops", Kind::Loops, offset, len)?;
        Ok(Self { rows })
    }

    /// Publishes the counts of a loop; of one that there is not, nothing.
    ///
    /// # Errors
    /// The memory's.
    pub fn publish(&mut self, number: usize, counts: &Statistics) -> Result<(), AccessError> {
        if let Some(row) = self.rows.get_mut(number) {
            row.publish(&words(counts))?;
        }
        Ok(())
    }
}

/// The counts of the loop `number` in an object of [`Kind::Loops`], and its name; `None` after the
/// last, and for one whose program has published nothing yet, or publishes just now.
///
/// # Errors
/// The memory's; an object is where its entry says, and that may be anywhere.
pub fn read<W: MemoryWindow + Clone>(
    region: &Region<W>,
    entry: &Entry,
    number: u32,
) -> Result<Option<(Name, Statistics)>, AccessError> {
    if number >= entry.len / ROW_BYTES {
        return Ok(None);
    }
    let at = entry
        .offset
        .saturating_add(number.saturating_mul(ROW_BYTES));
    let mut name = [0; NAME_BYTES as usize];
    region.read(at, &mut name)?;
    let row = Published::<Row>::at(at.saturating_add(NAME_BYTES)).subscriber(region.clone())?;
    match row.read() {
        Ok(latest) => Ok(counts(&latest.value).map(|counts| (Name::from_bytes(name), counts))),
        Err(ReadError::Access(error)) => Err(error),
        Err(_) => Ok(None),
    }
}

/// How many loops an object of [`Kind::Loops`] has.
#[must_use]
pub const fn count(entry: &Entry) -> u32 {
    entry.len / ROW_BYTES
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
