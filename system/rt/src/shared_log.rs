//! The log of a system, in the memory that belongs to no processor.

use core::fmt;
use core::time::Duration;

use condor_mbox::shared_log::{SharedLogError, SharedLogReader};
use condor_mbox::spin_lock::{Bakery, SpinLockError};
use condor_mbox::{AccessError, Clock as _, Doorbell as _, MemoryWindow, Region};
use condor_mbox::{SharedLog, SpinLock};

use crate::error::ProgramError;
use crate::machine::{Machine, MailboxOf};
use crate::numbers::PROCESSORS;
use crate::text::ShortText;

/// The bytes that the log takes at the beginning of the memory. Structures of programs may lie behind them.
pub const BYTES: u32 = 20_480;
/// The number of lines that the log keeps.
pub const LINES: u32 = 128;
/// The place of the lock: the end of the entries.
pub const LOCK: u32 = 64 + LINES * 128;
const _: () = assert!(LOCK as usize + Bakery::bytes(PROCESSORS as u8) <= BYTES as usize);
/// The longest time for which others may keep a program from appending, and the time between two attempts.
const PATIENCE: Duration = Duration::from_millis(100);
const PAUSE: Duration = Duration::from_micros(20);

/// Makes a reader of the log in `memory`, the memory of a system that belongs to no processor.
///
/// # Errors
/// [`AccessError`] of the kind `OutOfBounds` if the memory has less than [`BYTES`].
pub fn reader<W>(memory: &Region<W>) -> Result<SharedLogReader<W>, AccessError>
where
    W: MemoryWindow + Clone,
{
    SharedLogReader::new(entries(memory)?)
}

fn entries<W: MemoryWindow + Clone>(memory: &Region<W>) -> Result<Region<W>, AccessError> {
    memory.part(0, LOCK)
}

/// Appends a text, or waits until it can.
pub(crate) fn append<M: Machine>(
    machine: &M,
    mailbox: &MailboxOf<'_, M>,
    text: fmt::Arguments<'_>,
) -> Result<(), ProgramError> {
    let memory = machine.shared_memory();
    let found = memory.as_ref().map_or(0, Region::size);
    let Some(memory) = memory.filter(|_| found >= BYTES) else {
        let needed = BYTES;
        return Err(ProgramError::SharedMemory { needed, found });
    };
    let lock = SpinLock::new(machine.test_and_set(memory.clone(), LOCK)?);
    let log = SharedLog::new(entries(&memory)?, lock)?;
    let text = ShortText::<{ SharedLog::TEXT_BYTES }>::of(&text);
    let (me, bell) = (mailbox.owner()?, machine.doorbell());
    let deadline = bell.now().after(PATIENCE);
    loop {
        let (now, seen) = (bell.now(), bell.prepare());
        match log.try_append(me, mailbox, &bell, text.as_str()) {
            Err(SharedLogError::Lock(
                // Another one may recover it just now.
                SpinLockError::Busy { .. } | SpinLockError::OwnerDead { .. },
            )) if now < deadline => bell.wait(seen, now.after(PAUSE), None),
            appended => return Ok(appended.map(drop)?),
        }
    }
}
