//! [`Account`]: what has become of each byte.

use std::fmt;
use std::time::Duration;

use super::board::Acknowledged;
use super::byte_at;

#[derive(Debug, Default)]
pub(crate) struct Account {
    pub(crate) kills: u32,
    pub(crate) took: Duration,
    /// What the processor says that it has written.
    pub(crate) written: u64,
    /// Bytes that were shown at their place, and acknowledged.
    delivered: u64,
    /// Bytes that the processor counted: they found no room.
    pub(crate) lost: u32,
    /// Cursors that the processor did not believe, of which a true host writes none.
    pub(crate) ignored: u32,
    /// Bytes that the hosts counted.
    overwritten: u64,
    /// Bytes that were shown, and not acknowledged when their host was killed: the next one shows
    /// them again, or counts them if they have been overwritten meanwhile.
    again: u64,
    /// Hosts that were killed with such bytes.
    doubtful: u32,
    /// Bytes that were not what belonged there, and acknowledgements of what was not shown.
    wrong: u64,
}

impl Account {
    /// Enters what a host left: `journal`, and what was acknowledged before it and after it.
    pub(crate) fn enter(&mut self, journal: &[u8], before: Acknowledged, after: Acknowledged) {
        let advanced = after.tail.wrapping_sub(before.tail);
        let overwritten = after.overwritten.wrapping_sub(before.overwritten);
        let acknowledged = advanced.wrapping_sub(overwritten);
        // How far from the tail before the journal goes, and what was skipped up to the tail after.
        let mut at = 0_u32;
        let mut skipped_before = 0_u32;
        let mut shown = 0_u32;
        let mut rest = journal;
        while let Some((record, others)) = next(rest) {
            rest = others;
            at = at.wrapping_add(record.skipped);
            if at <= advanced && (at < advanced || record.bytes.is_empty()) {
                skipped_before = skipped_before.wrapping_add(record.skipped);
            }
            for byte in record.bytes {
                let right = byte_at(before.tail.wrapping_add(at));
                self.wrong += u64::from(*byte != right);
                at = at.wrapping_add(1);
                shown = shown.wrapping_add(1);
            }
        }
        let was_shown = advanced <= at && skipped_before == overwritten && acknowledged <= shown;
        self.wrong += u64::from(!was_shown);
        let again = shown.saturating_sub(acknowledged);
        self.delivered += u64::from(acknowledged);
        self.overwritten += u64::from(overwritten);
        self.again += u64::from(again);
        self.doubtful += u32::from(again > 0);
    }

    fn counted(&self) -> u64 {
        u64::from(self.lost) + self.overwritten
    }

    /// Bytes that are not accounted for, or not right.
    pub(crate) fn discrepancies(&self) -> u64 {
        self.wrong
            + u64::from(self.ignored)
            + self.written.abs_diff(self.delivered + self.counted())
    }
}

impl fmt::Display for Account {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} kills in {:.1} s; {} B written = {} delivered + {} lost + {} overwritten; \
             {} B shown and not acknowledged, in {} kills; {} wrong, {} ignored",
            self.kills,
            self.took.as_secs_f64(),
            self.written,
            self.delivered,
            self.lost,
            self.overwritten,
            self.again,
            self.doubtful,
            self.wrong,
            self.ignored
        )
    }
}

struct Record<'j> {
    skipped: u32,
    bytes: &'j [u8],
}

/// The record at the beginning of `journal`, whose host may have been killed while it wrote.
fn next(journal: &[u8]) -> Option<(Record<'_>, &[u8])> {
    let (skipped, rest) = journal.split_first_chunk()?;
    let (len, rest) = rest.split_first_chunk()?;
    let len = (u32::from_le_bytes(*len) as usize).min(rest.len());
    let (bytes, rest) = rest.split_at(len);
    let skipped = u32::from_le_bytes(*skipped);
    Some((Record { skipped, bytes }, rest))
}
