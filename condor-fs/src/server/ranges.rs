//! Operations on the room that ranges of a file take: where its data and holes are, and what they
//! may become.

use rustix::fs::{FallocateFlags, SeekFrom};
use rustix::io::Errno as Linux;

use super::error::Stop;
use super::limit::check_file_limit;
use super::tree::about;
use super::{FileServer, Job, Step, Steps};
use crate::errno::Errno;
use crate::wire::{allocate, find};

/// The ways of allocating that a repetition does not do twice.
const ALLOCATIONS: [(u32, FallocateFlags); 5] = [
    (0, FallocateFlags::empty()),
    (allocate::KEEP_SIZE, FallocateFlags::KEEP_SIZE),
    (
        allocate::PUNCH_HOLE | allocate::KEEP_SIZE,
        FallocateFlags::PUNCH_HOLE.union(FallocateFlags::KEEP_SIZE),
    ),
    (allocate::ZERO, FallocateFlags::ZERO_RANGE),
    (
        allocate::ZERO | allocate::KEEP_SIZE,
        FallocateFlags::ZERO_RANGE.union(FallocateFlags::KEEP_SIZE),
    ),
];

impl<S: Steps> FileServer<S> {
    /// Returns the place where the next data or the next hole begins.
    pub(super) fn find(&self, job: &Job<'_>) -> Result<u64, Stop> {
        let opened = self.opened(job)?;
        let position = job.request.position;
        // Linux has them as signed numbers, of which none that is negative is in a file.
        if i64::try_from(position).is_err() {
            return Err(Errno::NXIO.into());
        }
        let from = match job.request.flags {
            find::DATA => SeekFrom::Data(position),
            find::HOLE => SeekFrom::Hole(position),
            _ => return Err(Errno::INVAL.into()),
        };
        // Of all that the server does with a file, only this and the reading of a directory depend
        // on its own position, and both set it first.
        match rustix::fs::seek(&opened.file, from) {
            // The position is a good one: it is the filesystem that does not know the word.
            Err(Linux::INVAL) => Err(Errno::OPNOTSUPP.into()),
            outcome => Ok(outcome?),
        }
    }

    /// Takes room for a range, or releases it. A repetition does the same to the same bytes: the next
    /// incarnation does it before any other operation.
    pub(super) fn allocate(&self, job: &Job<'_>) -> Result<(), Stop> {
        let opened = self.opened(job)?;
        let file = opened.for_writing()?;
        let (position, len) = (job.request.position, job.request.range_len());
        let ways = ALLOCATIONS.iter();
        let way = ways.clone().find(|(flags, _)| *flags == job.request.flags);
        let &(flags, way) = way.ok_or(Errno::OPNOTSUPP)?;
        if len == 0 || i64::try_from(position).is_err() || i64::try_from(len).is_err() {
            return Err(Errno::INVAL.into());
        }
        let end = position.checked_add(len).ok_or(Errno::FBIG)?;
        self.begin(job)?;
        if flags & allocate::PUNCH_HOLE == 0 {
            let present = about(file, c"")?.1.size;
            if flags & allocate::KEEP_SIZE == 0 {
                check_file_limit(end)?;
                self.admit(file, end)?;
            } else if end > present && self.is_limited() {
                // Room behind the end would be counted by nobody.
                return Err(Errno::OPNOTSUPP.into());
            }
        }
        loop {
            match rustix::fs::fallocate(file, way, position, len) {
                Err(Linux::INTR) => {}
                outcome => {
                    outcome?;
                    self.reached(job, Step::Part);
                    return Ok(());
                }
            }
        }
    }

    /// Whether the sizes of files are limited.
    fn is_limited(&self) -> bool {
        self.options.max_file_bytes.is_some() || self.options.quota_bytes.is_some()
    }
}
