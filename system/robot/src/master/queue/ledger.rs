//! The ledger of the queue in its file.
//!
//! The file is made as a whole, under another name first; then each change overwrites one row. Both are
//! on the disk of the host before the change is in force, so they survive a failure of its power, too.

use core::time::Duration;

use condor_fs::{Errno, FileError, OpenOptions};
use condor_rt::{FilesOf, Machine};
use embedded_io::Write as _;

use super::Queue;
use crate::file;
use crate::master::FILES_TIMEOUT;
use crate::master::words::{LEDGER, RowError};
use crate::motions::LedgerStore;
use crate::queue::{LedgerRow, ROW_BYTES};

/// The file while it is made.
const HALF: &str = "motions.ledger.half";
const BYTES: usize = ROW_BYTES * Queue::ROWS;
/// The timeout of one operation: a record that is not written by then is tried again, and the terminal must not
/// wait for it.
const TIMEOUT: Duration = Duration::from_millis(200);
/// The greatest least number of a session, if the clock of the host is far ahead.
const LATEST: u32 = 0xe000_0000;

/// The file in which the queue keeps its ledger.
pub(in crate::master) struct LedgerFile<'r, M: Machine>(pub(super) &'r FilesOf<'r, M>);

impl<M: Machine> LedgerFile<'_, M> {
    fn within<R>(&self, work: impl FnOnce(&FilesOf<'_, M>) -> R) -> R {
        self.0.set_timeout(TIMEOUT);
        let done = work(self.0);
        self.0.set_timeout(FILES_TIMEOUT);
        done
    }
}

impl<M: Machine> LedgerStore for LedgerFile<'_, M> {
    type Error = RowError;

    fn read<T>(&mut self, restore: impl FnOnce(&[u8], u32) -> T) -> Result<T, RowError> {
        // One that is longer is refused.
        let mut bytes = [0; BYTES + 1];
        let (len, time) = self.within(|files| {
            let options = OpenOptions::new().write().create().truncate();
            let mut half = files.open(HALF, options)?;
            half.write_all(&[0])?;
            let time = half.status()?.modified_s;
            half.close()?;
            let time = u32::try_from(time).unwrap_or(LATEST).min(LATEST);
            match file::read(files, LEDGER, OpenOptions::new().read(), &mut bytes) {
                Err(error) if error.errno() == Some(Errno::NOENT) => Ok((0, time)),
                len => Ok::<_, FileError>((len?, time)),
            }
        })?;
        Ok(restore(bytes.get(..len).unwrap_or(&[]), time))
    }

    fn replace(&mut self, rows: impl Iterator<Item = LedgerRow>) -> Result<(), RowError> {
        let mut bytes = [0; BYTES];
        let (places, _) = bytes.as_chunks_mut::<ROW_BYTES>();
        for (place, row) in places.iter_mut().zip(rows) {
            *place = row;
        }
        Ok(self.within(|files| {
            let options = OpenOptions::new().write().create().truncate();
            let mut half = files.open(HALF, options)?;
            half.write_all(&bytes)?;
            half.sync()?;
            half.close()?;
            files.rename(HALF, LEDGER)
        })?)
    }

    fn write(&mut self, row: usize, bytes: &LedgerRow) -> Result<(), RowError> {
        self.within(|files| {
            let file = files.open(LEDGER, OpenOptions::new().write())?;
            let found = file.status()?.size;
            if found != BYTES as u64 {
                file.close()?;
                return Err(RowError::Length { found, size: BYTES });
            }
            // A row does not cross a page, and comes as a whole or not at all.
            file::write_all_at(&file, bytes, (row * ROW_BYTES) as u64)?;
            file.sync()?;
            Ok(file.close()?)
        })
    }
}
