//! Operations on what a file holds.

use std::mem::MaybeUninit;
use std::os::fd::OwnedFd;

use condor_mbox::MemoryWindow;
use condor_mbox::layout::BELL_BYTES;
use rustix::fs::{RawDir, SeekFrom};

use super::error::Stop;
use super::limit::check_file_limit;
use super::log::{Log, Outcome};
use super::tree::{OWN, about};
use super::{Job, Server, Step, Steps};
use crate::errno::Errno;
use crate::wire::{Operation, halves, whole};

impl<S: Steps> Server<S> {
    pub(super) fn read(&self, job: &Job<'_>) -> Result<u64, Stop> {
        let opened = self.opened(job)?;
        self.transfer(job, job.request.position, |position, offset, len| {
            job.window
                .read_file(opened.for_reading()?, position, offset, len)
                .map_err(Stop::from)
        })
    }

    /// Writes at the position, or at the end that was recorded.
    pub(super) fn write(&self, job: &Job<'_>, log: &Log<'_>) -> Result<u64, Stop> {
        let opened = self.opened(job)?;
        let file = opened.for_writing()?;
        job.check_buffer()?;
        let position = if job.operation == Operation::Append {
            self.end_of_file(job, log, file)?
        } else {
            self.begin(job)?;
            job.request.position
        };
        let len = u64::from(job.request.buffer.len);
        if len > 0 {
            let end = position.checked_add(len).ok_or(Errno::FBIG)?;
            check_file_limit(end)?;
            self.admit(file, end)?;
        }
        self.transfer(job, position, |position, offset, len| {
            Ok(job.window.write_file(file, position, offset, len)?)
        })
    }

    /// Where an append begins, in this life of the server and in the next ones.
    fn end_of_file(&self, job: &Job<'_>, log: &Log<'_>, file: &OwnedFd) -> Result<u64, Stop> {
        self.begin(job)?;
        if let Some(staged) = log.staged()? {
            let [low, high, ..] = staged.evidence;
            return Ok(whole(low, high));
        }
        let size = about(file, c"")?.1.size;
        log.stage(&halves(size))?;
        self.reached(job, Step::Staged);
        Ok(size)
    }

    /// Moves data until all is moved, or no more can be; what was moved before an error is a result.
    fn transfer(
        &self,
        job: &Job<'_>,
        mut position: u64,
        mut part: impl FnMut(u64, u32, usize) -> Result<usize, Stop>,
    ) -> Result<u64, Stop> {
        job.check_buffer()?;
        let buffer = job.request.buffer;
        let mut moved = 0;
        while moved < buffer.len {
            // Inside of the window, as was checked. The kernel may stop anywhere, the window wants
            // whole words: what lies before the next word is moved again.
            let back = moved % 4;
            let offset = BELL_BYTES + buffer.offset + moved - back;
            let len = (buffer.len - moved + back) as usize;
            let from = position - u64::from(back);
            match part(from, offset, len) {
                Ok(count) if count <= back as usize => break,
                Ok(count) => {
                    let count = count as u32 - back;
                    moved += count;
                    position += u64::from(count);
                    self.reached(job, Step::Part);
                }
                Err(Stop::Errno(Errno::INTR)) => {}
                Err(_) if moved > 0 => break,
                Err(error) => return Err(error),
            }
        }
        Ok(u64::from(moved))
    }

    pub(super) fn truncate(&self, job: &Job<'_>) -> Result<(), Stop> {
        let opened = self.opened(job)?;
        let file = opened.for_writing().map_err(|_| Errno::INVAL)?;
        let size = job.request.position;
        if i64::try_from(size).is_err() {
            return Err(Errno::INVAL.into());
        }
        self.begin(job)?;
        if size > about(file, c"")?.1.size {
            check_file_limit(size)?;
        }
        self.admit(file, size)?;
        rustix::fs::ftruncate(file, size)?;
        Ok(())
    }

    pub(super) fn sync(&self, job: &Job<'_>) -> Result<(), Stop> {
        Ok(rustix::fs::fsync(&self.opened(job)?.file)?)
    }

    pub(super) fn file_status(&self, job: &Job<'_>) -> Result<Outcome, Stop> {
        Ok(Outcome {
            value: 0,
            about: Some(about(&self.opened(job)?.file, c"")?),
        })
    }

    pub(super) fn read_directory(&self, job: &Job<'_>) -> Result<u64, Stop> {
        let opened = self.opened(job)?;
        let file = opened.for_reading()?;
        job.check_buffer()?;
        let room = job.request.buffer.len as usize;
        rustix::fs::seek(file, SeekFrom::Start(job.request.position))?;
        let mut memory = vec![MaybeUninit::uninit(); 32 * 1024];
        let mut directory = RawDir::new(file, &mut memory);
        let (mut entries, mut full) = (Vec::with_capacity(room.min(32 * 1024)), false);
        while let Some(entry) = directory.next() {
            let entry = entry?;
            let name = entry.file_name().to_bytes();
            if name == OWN {
                continue;
            }
            let padded = name.len().next_multiple_of(4);
            if entries.len() + 16 + padded > room {
                full = true;
                break;
            }
            let [low, high] = halves(entry.next_entry_cookie());
            let kind = entry.file_type().as_raw_mode() >> 12 & 0xf;
            for word in [low, high, kind, name.len() as u32] {
                entries.extend(word.to_le_bytes());
            }
            entries.extend(name);
            entries.resize(entries.len() + padded - name.len(), 0);
        }
        if entries.is_empty() && full {
            return Err(Errno::INVAL.into());
        }
        job.region.write(job.request.buffer.offset, &entries)?;
        Ok(entries.len() as u64)
    }
}

impl Job<'_> {
    /// Nothing is touched for the sake of a buffer that is not in the window.
    pub(super) fn check_buffer(&self) -> Result<(), Stop> {
        let buffer = self.request.buffer;
        Ok(self.region.check(buffer.offset, buffer.len as usize)?)
    }
}
