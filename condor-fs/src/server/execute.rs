//! The dispatch of each operation, and the steps that all operations share.

use rustix::fs::Dir;
use rustix::rand::GetRandomFlags;

use super::error::Stop;
use super::journal::Record;
use super::log::{Log, Outcome};
use super::{FileServer, Job, Step, Steps};
use crate::errno::Errno;
use crate::wire::{self, Operation};

impl<S: Steps> FileServer<S> {
    pub(super) fn execute(&self, job: &Job<'_>, log: &Log<'_>) -> Result<Outcome, Stop> {
        let nothing = |()| Outcome::default();
        let value = |value| Outcome {
            value,
            ..Outcome::default()
        };
        match job.operation {
            Operation::Session => self.session(job).map(value),
            Operation::Open => self.open(job, log),
            Operation::Close => self.close(job).map(nothing),
            Operation::Read => self.read(job).map(value),
            Operation::Write => self.write(job).map(value),
            Operation::Append => self.append(job, log).map(value),
            Operation::Truncate => self.truncate(job).map(nothing),
            Operation::Sync => self.sync(job).map(nothing),
            Operation::FileStatus => self.file_status(job),
            Operation::PathStatus => self.path_status(job),
            Operation::ReadDirectory => self.read_directory(job).map(value),
            Operation::MakeDirectory => self.make_directory(job, log).map(nothing),
            Operation::RemoveDirectory => self.remove_directory(job, log).map(nothing),
            Operation::Unlink => self.unlink(job, log).map(nothing),
            Operation::Rename => self.rename(job, log).map(nothing),
            Operation::FileMode => self.file_mode(job).map(nothing),
            Operation::PathMode => self.path_mode(job).map(nothing),
            Operation::FileTimes => self.file_times(job).map(nothing),
            Operation::PathTimes => self.path_times(job).map(nothing),
            Operation::Space => self.space(),
            Operation::Find => self.find(job).map(value),
            Operation::Allocate => self.allocate(job).map(nothing),
        }
    }

    /// From here on a next incarnation of the server must finish this before it does anything else.
    pub(super) fn begin(&self, job: &Job<'_>) -> Result<(), Stop> {
        // Only what has been asked already: nothing else may be served from here on.
        let table = match job.operation {
            Operation::Open
            | Operation::MakeDirectory
            | Operation::RemoveDirectory
            | Operation::PathMode
            | Operation::PathTimes => wire::NONE,
            _ => self.table(job)?,
        };
        let record = Record {
            processor: job.processor,
            session: job.request.session,
            sequence: job.request.sequence,
            slot: job.slot,
            table,
        };
        self.journal.begin(&self.tree, &record)?;
        self.reached(job, Step::Begun);
        Ok(())
    }

    pub(super) fn check_writable(&self, job: &Job<'_>) -> Result<(), Errno> {
        let options = &self.options;
        if options.read_only || options.read_only_for.contains(job.processor) {
            Err(Errno::ROFS)
        } else {
            Ok(())
        }
    }

    /// A number that no session had, and the end of all former ones of this processor.
    fn session(&self, job: &Job<'_>) -> Result<u64, Stop> {
        if job.request.session != wire::NO_SESSION {
            return Err(Errno::INVAL.into());
        }
        self.open.forget_all(job.processor);
        let prefix = format!("{:02x}-", job.processor.0);
        let mut left = Vec::new();
        for entry in Dir::read_from(self.tree.stage())? {
            let entry = entry?;
            if entry.file_name().to_bytes().starts_with(prefix.as_bytes()) {
                left.push(entry.file_name().to_owned());
            }
        }
        for name in left {
            self.discard(&name)?;
        }
        loop {
            let mut bytes = [0; 8];
            rustix::rand::getrandom(&mut bytes, GetRandomFlags::empty())?;
            let session = u64::from_le_bytes(bytes);
            if session != wire::NO_SESSION {
                return Ok(session);
            }
        }
    }
}
