//! Operations on names, each done once: see "How the server does each thing once" in WIRE.md.

use std::ffi::{CStr, CString};

use rustix::fs::{AtFlags, Dir, Mode, OFlags, RenameFlags};
use rustix::io::Errno as Linux;

use super::error::Stop;
use super::log::{Log, Outcome};
use super::open_files::{Opened, system_flags, unique_name};
use super::tree::{OWN, Place, about};
use super::{Job, Server, Step, Steps};
use crate::errno::Errno;
use crate::wire::{Evidence, MAX_PATH, Operation, Span, Status, open as flag, rename};

/// The steps of a removal.
const TAKEN: u32 = 2;
const GIVEN_BACK: u32 = 3;

impl<S: Steps> Server<S> {
    pub(super) fn open(&self, job: &Job<'_>, log: &Log<'_>) -> Result<Outcome, Stop> {
        let request = &job.request;
        let flags = request.flags;
        let has = |flag: u32| flags & flag != 0;
        if flags & !flag::ALL != 0
            || !has(flag::READ | flag::WRITE)
            || (has(flag::APPEND | flag::CREATE | flag::TRUNCATE) && !has(flag::WRITE))
            || (has(flag::EXCLUSIVE) && !has(flag::CREATE))
            || (has(flag::DIRECTORY) && flags != flag::DIRECTORY | flag::READ)
        {
            return Err(Errno::INVAL.into());
        }
        let path = job.path(request.path)?;
        if has(flag::WRITE) {
            self.check_writable(job)?;
        }
        if has(flag::CREATE | flag::TRUNCATE) {
            self.begin(job)?;
        }
        let mut system = system_flags(flags);
        if has(flag::EXCLUSIVE) {
            self.make_at_once(job, log, &path)?;
        } else if has(flag::CREATE) {
            system |= OFlags::CREATE;
        }
        if has(flag::TRUNCATE) {
            system |= OFlags::TRUNC;
        }
        let file = self.tree.open_path(&path, system, self.options.file_mode)?;
        let found = about(&file, c"")?;
        if let Some(staged) = log.staged()?
            && Evidence::from_words(&staged.evidence) != found.0
        {
            return Err(Errno::STALE.into());
        }
        self.open
            .keep(job, request.sequence, Opened { file, flags });
        Ok(Outcome {
            value: 0,
            about: Some(found),
        })
    }

    pub(super) fn path_status(&self, job: &Job<'_>) -> Result<Outcome, Stop> {
        let path = job.path(job.request.path)?;
        let found = match self.tree.place(&path) {
            Ok(place) => look(&place)?,
            // It ends with "." or "..".
            Err(Errno::BUSY) => {
                let file = self
                    .tree
                    .open_path(&path, OFlags::PATH | OFlags::DIRECTORY, 0)?;
                about(&file, c"")?
            }
            Err(errno) => return Err(errno.into()),
        };
        Ok(Outcome {
            value: 0,
            about: Some(found),
        })
    }

    pub(super) fn make_directory(&self, job: &Job<'_>, log: &Log<'_>) -> Result<(), Stop> {
        let path = job.path(job.request.path)?;
        self.check_writable(job)?;
        self.begin(job)?;
        self.make_at_once(job, log, &path)
    }

    /// Makes a file or directory under its unique name, then gives it its path.
    fn make_at_once(&self, job: &Job<'_>, log: &Log<'_>, path: &[u8]) -> Result<(), Stop> {
        let unique = job.unique_name();
        let place;
        if log.staged()?.is_some() {
            if self.tree.staged(&unique)?.is_none() {
                return Ok(());
            }
            place = self.tree.place(path)?;
        } else {
            place = match self.tree.place(path) {
                Err(Errno::BUSY) => return Err(Errno::EXIST.into()),
                place => place?,
            };
            if place.directory && job.operation == Operation::Open {
                return Err(Errno::ISDIR.into());
            }
            match about(&place.parent, &place.name) {
                Err(Linux::NOENT) => {}
                Ok(_) => return Err(Errno::EXIST.into()),
                Err(errno) => return Err(errno.into()),
            }
            match self.make(job, &unique) {
                // By a former life.
                Ok(()) | Err(Linux::EXIST) => {}
                Err(errno) => return Err(errno.into()),
            }
            self.reached(job, Step::Made);
            let (evidence, _) = about(self.tree.stage(), &unique)?;
            log.stage(&evidence.to_words())?;
            self.reached(job, Step::Staged);
        }
        self.tree.put(&unique, &place)?;
        self.reached(job, Step::Moved);
        Ok(())
    }

    fn make(&self, job: &Job<'_>, unique: &CStr) -> Result<(), Linux> {
        let stage = self.tree.stage();
        if job.operation == Operation::MakeDirectory {
            let mode = Mode::from_raw_mode(self.options.directory_mode);
            return rustix::fs::mkdirat(stage, unique, mode);
        }
        let mode = Mode::from_raw_mode(self.options.file_mode);
        let flags = OFlags::WRONLY | OFlags::CREATE | OFlags::EXCL | OFlags::CLOEXEC;
        rustix::fs::openat(stage, unique, flags, mode).map(drop)
    }

    /// Unlink and remove directory.
    pub(super) fn remove(&self, job: &Job<'_>, log: &Log<'_>) -> Result<(), Stop> {
        let path = job.path(job.request.path)?;
        self.check_writable(job)?;
        if job.operation == Operation::Unlink {
            self.table(job)?; // Before anything is begun: the client may have to be asked.
        }
        self.begin(job)?;
        let unique = job.unique_name();
        let staged = log.staged()?;
        if staged.is_none() {
            let place = self.tree.place(&path)?;
            let (evidence, status) = look(&place)?;
            match (job.operation == Operation::Unlink, status.is_directory()) {
                (true, true) => return Err(Errno::ISDIR.into()),
                (false, false) => return Err(Errno::NOTDIR.into()),
                (false, true) => check_empty(&place)?,
                (true, false) => {}
            }
            if job.operation == Operation::Unlink {
                self.open_blocks(job)?; // A table that is none is found before anything is touched.
            }
            log.stage(&evidence.to_words())?;
            self.reached(job, Step::Staged);
        }
        let step = staged.map_or(1, |staged| staged.step);
        if step < TAKEN {
            // A former life may have moved it, and died before it said so.
            if self.tree.staged(&unique)?.is_none() {
                self.tree.take(&self.tree.place(&path)?, &unique)?;
                self.reached(job, Step::Moved);
            }
            log.step(TAKEN)?;
            self.reached(job, Step::Marked);
        }
        let Some((evidence, status)) = self.tree.staged(&unique)? else {
            return if step == GIVEN_BACK {
                Err(Errno::NOTEMPTY.into())
            } else {
                Ok(())
            };
        };
        if status.is_directory() {
            return self.remove_taken(job, log, &unique, &path, step);
        }
        // A table that has become none by now has no files.
        if !self.mark_silly(job, evidence).unwrap_or(false) {
            rustix::fs::unlinkat(self.tree.stage(), &*unique, AtFlags::empty())?;
        }
        Ok(())
    }

    /// Removes a directory that was moved; if somebody has put something into it since it was
    /// found empty, it goes back.
    fn remove_taken(
        &self,
        job: &Job<'_>,
        log: &Log<'_>,
        unique: &CStr,
        path: &[u8],
        step: u32,
    ) -> Result<(), Stop> {
        if step != GIVEN_BACK {
            match rustix::fs::unlinkat(self.tree.stage(), unique, AtFlags::REMOVEDIR) {
                Ok(()) => return Ok(()),
                Err(Linux::NOTEMPTY | Linux::EXIST) => log.step(GIVEN_BACK)?,
                Err(errno) => return Err(errno.into()),
            }
        }
        self.tree.put(unique, &self.tree.place(path)?)?;
        self.reached(job, Step::Moved);
        Err(Errno::NOTEMPTY.into())
    }

    pub(super) fn rename(&self, job: &Job<'_>, log: &Log<'_>) -> Result<(), Stop> {
        let request = &job.request;
        if request.flags & !rename::NO_REPLACE != 0 {
            return Err(Errno::INVAL.into());
        }
        let (from, to) = (job.path(request.path)?, job.path(request.second_path)?);
        self.check_writable(job)?;
        self.table(job)?;
        self.begin(job)?;
        let staged = log.staged()?;
        let places = self
            .tree
            .place(&from)
            .and_then(|from| Ok((from, self.tree.place(&to)?)));
        let evidence = staged.map(|staged| Evidence::from_words(&staged.evidence));
        let present = places
            .as_ref()
            .ok()
            .and_then(|(from, _)| about(&from.parent, &from.name).ok());
        if let Some(evidence) = evidence
            && present.is_none_or(|(found, _)| found != evidence)
        {
            return Ok(()); // It has gone to its new name.
        }
        let (from, to) = places?;
        let (evidence, status) = look(&from)?;
        if to.directory && !status.is_directory() {
            return Err(Errno::NOTDIR.into());
        }
        if staged.is_none() {
            log.stage(&evidence.to_words())?;
            self.reached(job, Step::Staged);
        }
        let flags = if request.flags & rename::NO_REPLACE == 0 {
            self.keep_open_target(job, &to, evidence)?;
            RenameFlags::empty()
        } else {
            RenameFlags::NOREPLACE
        };
        rustix::fs::renameat_with(&from.parent, &*from.name, &to.parent, &*to.name, flags)?;
        self.reached(job, Step::Moved);
        Ok(())
    }

    /// Gives the file that is to be replaced a silly name, if it is open.
    fn keep_open_target(&self, job: &Job<'_>, to: &Place, source: Evidence) -> Result<(), Stop> {
        let Ok((target, status)) = about(&to.parent, &to.name) else {
            return Ok(());
        };
        if target == source || !status.is_file() {
            return Ok(());
        }
        let unique = job.unique_name();
        if self.tree.staged(&unique)?.is_none() {
            if !self.is_open(job, target)? {
                return Ok(());
            }
            let stage = self.tree.stage();
            rustix::fs::linkat(&to.parent, &*to.name, stage, &*unique, AtFlags::empty())?;
            self.reached(job, Step::Made);
        }
        self.mark_silly(job, target)?;
        self.reached(job, Step::Marked);
        Ok(())
    }
}

impl Job<'_> {
    /// A path, checked.
    pub(super) fn path(&self, span: Span) -> Result<Vec<u8>, Stop> {
        match span.len {
            0 => return Err(Errno::NOENT.into()),
            1..=MAX_PATH => {}
            _ => return Err(Errno::NAMETOOLONG.into()),
        }
        let path = self.bytes_of(span)?;
        if path.contains(&0) {
            return Err(Errno::INVAL.into());
        }
        for name in path.split(|byte| *byte == b'/') {
            if name == OWN {
                return Err(Errno::NOENT.into());
            }
            if name.len() > 255 {
                return Err(Errno::NAMETOOLONG.into());
            }
        }
        Ok(path)
    }

    pub(super) fn unique_name(&self) -> CString {
        unique_name(self.processor, self.request.session, self.request.sequence)
    }
}

fn check_empty(place: &Place) -> Result<(), Stop> {
    let flags = OFlags::DIRECTORY | OFlags::NOFOLLOW | OFlags::CLOEXEC;
    let directory = rustix::fs::openat(&place.parent, &*place.name, flags, Mode::empty())?;
    for entry in Dir::read_from(&directory)? {
        if !matches!(entry?.file_name().to_bytes(), b"." | b"..") {
            return Err(Errno::NOTEMPTY.into());
        }
    }
    Ok(())
}

/// What a name stands for; a name with a slash behind it is a directory's.
fn look(place: &Place) -> Result<(Evidence, Status), Stop> {
    let found = about(&place.parent, &place.name)?;
    if place.directory && !found.1.is_directory() {
        return Err(Errno::NOTDIR.into());
    }
    Ok(found)
}
