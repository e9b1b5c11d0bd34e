//! Operations on what a file holds.

use std::fs::File;
use std::io::{self, ErrorKind};
use std::mem::MaybeUninit;
use std::ops::Range;
use std::os::fd::OwnedFd;
use std::os::unix::fs::FileExt;

use condor_mbox::MemoryWindow;
use condor_mbox::layout::BELL_BYTES;
use memchr::memmem::Finder;
use rustix::fs::{Mode, OFlags, RawDir, SeekFrom};

use super::error::Stop;
use super::limit::check_file_limit;
use super::log::{Log, Outcome};
use super::tree::{OWN, about, path_of};
use super::{FileServer, Job, Step, Steps};
use crate::errno::Errno;
use crate::wire::{halves, open as flag, whole};

/// The number of bytes that are searched at once.
const PIECE: u64 = 64 * 1024;

impl<S: Steps> FileServer<S> {
    pub(super) fn read(&self, job: &Job<'_>) -> Result<u64, Stop> {
        let opened = self.opened(job)?;
        self.transfer(job, job.request.position, |position, offset, len| {
            job.window
                .read_file(opened.for_reading()?, position, offset, len)
                .map_err(Stop::from)
        })
    }

    pub(super) fn write(&self, job: &Job<'_>) -> Result<u64, Stop> {
        let opened = self.opened(job)?;
        let file = opened.for_writing()?;
        job.check_buffer()?;
        if opened.flags & flag::APPEND != 0 {
            return Err(Errno::INVAL.into()); // Linux would write at the end.
        }
        self.begin(job)?;
        let position = job.request.position;
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

    /// Writes at the end, wherever that is: the kernel finds it and writes there in one step, so that
    /// nothing is overwritten that a program of the host appends at the same time.
    pub(super) fn append(&self, job: &Job<'_>, log: &Log<'_>) -> Result<u64, Stop> {
        let opened = self.opened(job)?;
        let file = opened.for_writing()?;
        job.check_buffer()?;
        if opened.flags & flag::APPEND == 0 {
            return Err(Errno::INVAL.into()); // Linux would write at the position.
        }
        self.begin(job)?;
        let buffer = job.request.buffer;
        if buffer.len == 0 {
            return Ok(0);
        }
        let end = about(file, c"")?.1.size;
        if let Some([low, high, ..]) = log.staged()? {
            let appended = job.appended(file, whole(low, high)..end)?;
            if appended > 0 {
                return Ok(appended);
            }
        }
        let new_end = end.checked_add(u64::from(buffer.len)).ok_or(Errno::FBIG)?;
        check_file_limit(new_end)?;
        self.admit(file, new_end)?;
        if log.staged()?.is_none() {
            log.stage(&halves(end))?;
            self.reached(job, Step::Staged);
        }
        let (offset, len) = (BELL_BYTES + buffer.offset, buffer.len as usize);
        loop {
            match job.window.write_file(file, end, offset, len) {
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                // The part that had room is a result; more bytes of it would not be next to it.
                outcome => {
                    let written = outcome?;
                    self.reached(job, Step::Part);
                    return Ok(written as u64);
                }
            }
        }
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
        let before = about(file, c"")?.1.size;
        if size > before {
            check_file_limit(size)?;
        }
        self.admit(file, size)?;
        rustix::fs::ftruncate(file, size)?;
        self.quota.release(before.saturating_sub(size));
        Ok(())
    }

    pub(super) fn sync(&self, job: &Job<'_>) -> Result<(), Stop> {
        Ok(rustix::fs::fsync(&self.opened(job)?.file)?)
    }

    pub(super) fn file_status(&self, job: &Job<'_>) -> Result<Outcome, Stop> {
        let (evidence, mut status) = about(&self.opened(job)?.file, c"")?;
        if self.block(job)?.is_some_and(|block| !block.has_path()) {
            // The name by which the server keeps it is none.
            status.links = status.links.saturating_sub(1);
        }
        Ok(Outcome::of((evidence, status)))
    }

    pub(super) fn read_directory(&self, job: &Job<'_>) -> Result<u64, Stop> {
        let opened = self.opened(job)?;
        let file = opened.for_reading()?;
        job.check_buffer()?;
        let room = job.request.buffer.len as usize;
        let top = self.tree.is_root(file)?;
        rustix::fs::seek(file, SeekFrom::Start(job.request.position))?;
        let mut memory = vec![MaybeUninit::uninit(); 32 * 1024];
        let mut directory = RawDir::new(file, &mut memory);
        let (mut entries, mut full) = (Vec::with_capacity(room.min(32 * 1024)), false);
        while let Some(entry) = directory.next() {
            let entry = entry?;
            let name = entry.file_name().to_bytes();
            if top && name == OWN {
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
    /// Returns the number of bytes of an append that a former incarnation has written to the range behind
    /// the end that it recorded, where programs of the host may have appended, too.
    pub(super) fn appended(&self, file: &OwnedFd, range: Range<u64>) -> Result<u64, Stop> {
        let buffer = self.request.buffer;
        let (start, len) = (range.start, range.end.saturating_sub(range.start));
        let mut ours = vec![0; buffer.len as usize];
        self.region.read(buffer.offset, &mut ours)?;
        // The file may be open for writing alone.
        let flags = OFlags::RDONLY | OFlags::CLOEXEC | OFlags::NONBLOCK;
        let Ok(file) = rustix::fs::open(path_of(file), flags, Mode::empty()).map(File::from) else {
            return Ok(len.min(ours.len() as u64)); // There is nothing to go by but its length.
        };
        let read = |position: u64, len: u64| -> io::Result<Vec<u8>> {
            let mut bytes = vec![0; len as usize];
            file.read_exact_at(&mut bytes, position)?;
            Ok(bytes)
        };
        if len <= ours.len() as u64 && ours.starts_with(&read(start, len)?) {
            return Ok(len);
        }
        // Programs of the host have appended, too, and ours may be anywhere among it.
        let ours = Finder::new(&ours);
        let whole = ours.needle().len() as u64;
        let mut at = 0;
        while at + whole <= len {
            let piece = (whole + PIECE).min(len - at);
            if ours.find(&read(start + at, piece)?).is_some() {
                return Ok(whole);
            }
            at += PIECE + 1;
        }
        Ok(0)
    }

    /// Nothing is touched for the sake of a buffer that is not in the window.
    pub(super) fn check_buffer(&self) -> Result<(), Stop> {
        let buffer = self.request.buffer;
        Ok(self.region.check(buffer.offset, buffer.len as usize)?)
    }
}
