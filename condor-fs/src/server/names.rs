//! Operations on names, each done once: see "How the server does each thing once" in WIRE.md.

use std::ffi::CString;
use std::os::fd::OwnedFd;

use rustix::fs::{AtFlags, Mode, OFlags, RenameFlags};
use rustix::io::Errno as Linux;

use super::error::Stop;
use super::log::{Log, Outcome};
use super::open_files::{OpenFile, system_flags, unique_name};
use super::reopen::Former;
use super::tree::{NameIn, OWN, about};
use super::{FileServer, Job, Step, Steps};
use crate::errno::Errno;
use crate::wire::{FileIdentity, FileStatus, MAX_PATH, Span, make_directory, open as flag, rename};

impl<S: Steps> FileServer<S> {
    pub(super) fn open(&self, job: &Job<'_>, log: &Log<'_>) -> Result<Outcome, Stop> {
        let request = &job.request;
        let flags = request.flags;
        let has = |flag: u32| flags & flag != 0;
        if flags & !flag::ALL != 0
            || !has(flag::READ | flag::WRITE)
            || (has(flag::APPEND | flag::TRUNCATE) && !has(flag::WRITE))
            || (has(flag::MODE) && !has(flag::CREATE))
            || (has(flag::EXCLUSIVE) && !has(flag::CREATE))
            || (has(flag::DIRECTORY) && flags != flag::DIRECTORY | flag::READ)
        {
            return Err(Errno::INVAL.into());
        }
        let path = job.path(request.path)?;
        if has(flag::WRITE | flag::CREATE) {
            self.check_writable(job)?;
        }
        let mode = if has(flag::MODE) {
            job.mode(true)?
        } else {
            self.options.file_mode
        };
        if has(flag::CREATE | flag::TRUNCATE) {
            self.begin(job)?;
        }
        let file = if has(flag::EXCLUSIVE) {
            self.make_file(job, log, &path, mode)?
        } else if has(flag::CREATE) {
            self.find_or_make(job, log, &path, mode)?
        } else {
            self.tree.open_path(&path, system_flags(flags), 0)?
        };
        let mut found = about(&file, c"")?;
        if has(flag::TRUNCATE) {
            rustix::fs::ftruncate(&file, 0)?;
            self.quota.release(found.1.size);
            found = about(&file, c"")?;
        }
        self.open
            .keep(job, request.sequence, OpenFile { file, flags });
        Ok(Outcome::of(found))
    }

    /// Opens a file, which is made if it is not there.
    fn find_or_make(
        &self,
        job: &Job<'_>,
        log: &Log<'_>,
        path: &[u8],
        mode: u32,
    ) -> Result<OwnedFd, Stop> {
        let flags = system_flags(job.request.flags);
        // The maker of a file has it open, but a next incarnation may not be allowed to open it.
        if !may_open(mode)
            && let Ok(place) = self.tree.place(path)
        {
            match (place.about(), log.staged()?) {
                (Err(Linux::NOENT), None) => {
                    log.stage(&[0; 8])?;
                    self.reached(job, Step::Staged);
                }
                // By a former incarnation: there was nothing before it.
                (Ok((found, status)), Some(_)) if status.is_file() => {
                    return self.reopen(job, &Former::Path(path.into()), flags, found);
                }
                _ => {}
            }
        }
        self.admit_new(path)?;
        Ok(self.tree.open_path(path, flags | OFlags::CREATE, mode)?)
    }

    /// Makes a file without a name, then names it: it appears with all its properties, and an attempt that
    /// is broken off leaves nothing.
    fn make_file(
        &self,
        job: &Job<'_>,
        log: &Log<'_>,
        path: &[u8],
        mode: u32,
    ) -> Result<OwnedFd, Stop> {
        let place = self.tree.place(path)?.named(Errno::EXIST, Errno::EXIST)?;
        if place.directory {
            return Err(Errno::ISDIR.into());
        }
        let flags = system_flags(job.request.flags);
        match (place.about(), log.staged()?) {
            (Err(Linux::NOENT), _) => {}
            (Err(errno), _) => return Err(errno.into()),
            // By a former incarnation.
            (Ok((found, _)), Some(staged)) if FileIdentity::from_words(&staged) == found => {
                return self.reopen(job, &Former::Path(path.into()), flags, found);
            }
            (Ok(_), _) => return Err(Errno::EXIST.into()),
        }
        self.admit_name()?;
        // No file without a name is made for reading alone; what the client may do with it is in
        // its flags.
        let access = if flags.contains(OFlags::WRONLY) {
            flags
        } else {
            flags | OFlags::RDWR
        };
        let file = place.make_unnamed(access, mode)?;
        self.reached(job, Step::Made);
        log.stage(&about(&file, c"")?.0.to_words())?;
        self.reached(job, Step::Staged);
        place.give_name(&file)?;
        self.reached(job, Step::Moved);
        Ok(file)
    }

    pub(super) fn path_status(&self, job: &Job<'_>) -> Result<Outcome, Stop> {
        let path = job.path(job.request.path)?;
        let place = self.tree.place(&path)?;
        let found = if place.is_directory() {
            about(self.tree.open_directory(&path, OFlags::PATH)?, c"")?
        } else {
            place.about()?
        };
        Ok(Outcome::of(found))
    }

    /// Makes a directory at once in its place: what the one above it passes on, and permissions
    /// that keep the server itself out, forbid to make it elsewhere and to move it.
    pub(super) fn make_directory(&self, job: &Job<'_>, log: &Log<'_>) -> Result<(), Stop> {
        let path = job.path(job.request.path)?;
        let mode = match job.request.flags {
            0 => self.options.directory_mode,
            make_directory::MODE => job.mode(false)?,
            _ => return Err(Errno::INVAL.into()),
        };
        self.check_writable(job)?;
        self.begin(job)?;
        let place = self.tree.place(&path)?.named(Errno::EXIST, Errno::EXIST)?;
        let staged = log.staged()?.is_some();
        match place.about() {
            Err(Linux::NOENT) => {}
            Err(errno) => return Err(errno.into()),
            // By a former incarnation: there was nothing before it.
            Ok((_, status)) if staged && status.is_directory() => return Ok(()),
            Ok(_) => return Err(Errno::EXIST.into()),
        }
        if !staged {
            self.admit_name()?;
            log.stage(&[0; 8])?;
            self.reached(job, Step::Staged);
        }
        let mode = Mode::from_raw_mode(mode);
        rustix::fs::mkdirat(&place.parent, &*place.name, mode)?;
        self.reached(job, Step::Made);
        Ok(())
    }

    pub(super) fn remove_directory(&self, job: &Job<'_>, log: &Log<'_>) -> Result<(), Stop> {
        let path = job.path(job.request.path)?;
        self.check_writable(job)?;
        self.begin(job)?;
        let place = self.tree.place(&path);
        let place = place.and_then(|place| place.named(Errno::INVAL, Errno::NOTEMPTY));
        let Some((place, evidence, status)) = remaining(place, log)? else {
            return Ok(());
        };
        if !status.is_directory() {
            return Err(Errno::NOTDIR.into());
        }
        log.stage(&evidence.to_words())?;
        self.reached(job, Step::Staged);
        rustix::fs::unlinkat(&place.parent, &*place.name, AtFlags::REMOVEDIR)?;
        self.quota.release_name(&status);
        Ok(())
    }

    pub(super) fn unlink(&self, job: &Job<'_>, log: &Log<'_>) -> Result<(), Stop> {
        let path = job.path(job.request.path)?;
        self.check_writable(job)?;
        self.table(job)?; // Before anything is begun: the client may have to be asked.
        self.begin(job)?;
        if self.finish_aside(job, log)? {
            return Ok(());
        }
        let place = self.tree.place(&path);
        let place = place.and_then(|place| place.named(Errno::ISDIR, Errno::ISDIR));
        let Some((place, evidence, status)) = remaining(place, log)? else {
            return Ok(());
        };
        if status.is_directory() {
            return Err(Errno::ISDIR.into());
        }
        if place.directory {
            return Err(Errno::NOTDIR.into());
        }
        // A table that is none is found before anything is touched.
        let open = self.is_open(job, evidence)?;
        log.stage(&evidence.to_words())?;
        self.reached(job, Step::Staged);
        if open {
            self.set_aside(job, &place, evidence)
        } else {
            rustix::fs::unlinkat(&place.parent, &*place.name, AtFlags::empty())?;
            self.quota.release_name(&status);
            Ok(())
        }
    }

    pub(super) fn rename(&self, job: &Job<'_>, log: &Log<'_>) -> Result<(), Stop> {
        let request = &job.request;
        let exchanges = request.flags == rename::EXCHANGE;
        if !exchanges && request.flags & !rename::NO_REPLACE != 0 {
            return Err(Errno::INVAL.into());
        }
        let replaces = request.flags & rename::NO_REPLACE == 0;
        let (from, to) = (job.path(request.path)?, job.path(request.second_path)?);
        self.check_writable(job)?;
        self.table(job)?;
        self.begin(job)?;
        if self.finish_aside(job, log)? {
            return Ok(());
        }
        let places = (self.tree.place(&from)).and_then(|from| Ok((from, self.tree.place(&to)?)));
        if let Some(staged) = log.staged()?
            && self.finish_rename(job, &places, FileIdentity::from_words(&staged))?
        {
            return Ok(());
        }
        let (from, to) = places?;
        let from = from.named(Errno::BUSY, Errno::BUSY)?;
        let busy = if replaces { Errno::BUSY } else { Errno::EXIST };
        let to = to.named(busy, busy)?;
        let (source, status) = from.about()?;
        let target = match to.about() {
            Ok(_) if !replaces => return Err(Errno::EXIST.into()),
            Ok(target) => Some(target),
            Err(Linux::NOENT) if !exchanges => None,
            Err(errno) => return Err(errno.into()),
        };
        // A slash is after what a name leads to, and that is another thing after an exchange.
        let beyond = match target {
            Some((_, target)) if exchanges => target,
            _ => status,
        };
        if (from.directory && !status.is_directory()) || (to.directory && !beyond.is_directory()) {
            return Err(Errno::NOTDIR.into());
        }
        let target = target.filter(|(target, _)| *target != source);
        let open = match target {
            Some((target, about)) if about.is_file() && !status.is_directory() && !exchanges => {
                self.is_open(job, target)?
            }
            _ => false,
        };
        log.stage(&source.to_words())?;
        self.reached(job, Step::Staged);
        let flags = match (open, replaces) {
            _ if exchanges => RenameFlags::EXCHANGE,
            // An open file must not be without a name, nor its new name without a file.
            (true, _) => RenameFlags::EXCHANGE,
            (false, true) => RenameFlags::empty(),
            (false, false) => RenameFlags::NOREPLACE,
        };
        match rustix::fs::renameat_with(&from.parent, &*from.name, &to.parent, &*to.name, flags) {
            // Of directories it says that one is inside of the other.
            Err(Linux::INVAL) if exchanges && status.is_file() && beyond.is_file() => {
                return Err(Errno::OPNOTSUPP.into());
            }
            outcome => outcome?,
        }
        self.reached(job, Step::Moved);
        match target {
            Some((target, _)) if open => self.set_exchanged_aside(job, &from, &to, target),
            Some(_) if exchanges => Ok(()),
            Some((_, status)) => {
                self.quota.release_name(&status);
                Ok(())
            }
            None => Ok(()),
        }
    }

    /// Whether a former incarnation has renamed what has the evidence `source`; then finishes that.
    pub(super) fn finish_rename(
        &self,
        job: &Job<'_>,
        places: &Result<(NameIn, NameIn), Errno>,
        source: FileIdentity,
    ) -> Result<bool, Stop> {
        let found = match places {
            Ok((from, to)) => from.about().map(|found| (from, to, found)),
            Err(errno) => return gone(*errno),
        };
        match found {
            Ok((_, _, (found, _))) if found == source => Ok(false),
            Ok((from, to, (left, status))) => {
                // The open file may have been left at the old name.
                if job.request.flags != rename::EXCHANGE
                    && status.is_file()
                    && to.about().is_ok_and(|(found, _)| found == source)
                    && self.is_open(job, left)?
                {
                    self.set_exchanged_aside(job, from, to, left)?;
                }
                Ok(true)
            }
            Err(errno) => gone(errno.into()),
        }
    }

    /// Sets an open file aside that has changed its name with the one that replaces it.
    fn set_exchanged_aside(
        &self,
        job: &Job<'_>,
        from: &NameIn,
        to: &NameIn,
        target: FileIdentity,
    ) -> Result<(), Stop> {
        self.set_aside(job, from, target).inspect_err(|_| {
            // A directory that lets only owners remove what is theirs. If it cannot be undone, both
            // files are there.
            let flags = RenameFlags::EXCHANGE;
            let _ =
                rustix::fs::renameat_with(&from.parent, &*from.name, &to.parent, &*to.name, flags);
        })
    }

    /// Takes the name from a file that is open: it stays until it is closed.
    fn set_aside(&self, job: &Job<'_>, place: &NameIn, evidence: FileIdentity) -> Result<(), Stop> {
        self.tree.set_aside(place, &job.unique_name())?;
        self.reached(job, Step::Aside);
        self.mark_or_discard(job, evidence)?;
        self.reached(job, Step::Marked);
        Ok(())
    }

    fn mark_or_discard(&self, job: &Job<'_>, evidence: FileIdentity) -> Result<(), Stop> {
        // A table that has become none by now has no files.
        if !self.mark_silly(job, evidence).unwrap_or(false) {
            self.discard(&job.unique_name())?;
        }
        Ok(())
    }

    /// Finishes what a former incarnation has set aside; whether it has.
    pub(super) fn finish_aside(&self, job: &Job<'_>, log: &Log<'_>) -> Result<bool, Stop> {
        if log.staged()?.is_some()
            && let Some((evidence, _)) = self.tree.aside(&job.unique_name())?
        {
            self.mark_or_discard(job, evidence)?;
            return Ok(true);
        }
        Ok(false)
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
        // Also when it only leads through.
        let mut names = path.split(|byte| *byte == b'/');
        if names.find(|name| !matches!(*name, b"" | b".")) == Some(OWN) {
            return Err(Errno::NOENT.into());
        }
        Ok(path)
    }

    pub(super) fn unique_name(&self) -> CString {
        unique_name(self.processor, self.request.session, self.request.sequence)
    }
}

/// Whether the owner of a file with this mode may read and write it.
const fn may_open(mode: u32) -> bool {
    mode & 0o600 == 0o600
}

/// Whether what a former incarnation has staged is not where it was.
fn gone(errno: Errno) -> Result<bool, Stop> {
    match errno {
        Errno::NOENT | Errno::NOTDIR => Ok(true),
        errno => Err(errno.into()),
    }
}

/// Returns the file to remove; nothing if a former incarnation has removed it.
pub(super) fn remaining(
    place: Result<NameIn, Errno>,
    log: &Log<'_>,
) -> Result<Option<(NameIn, FileIdentity, FileStatus)>, Stop> {
    let staged = log.staged()?;
    let found = place.and_then(|place| {
        let (evidence, status) = place.about()?;
        Ok((place, evidence, status))
    });
    match (found, staged) {
        (Ok((_, found, _)), Some(staged)) if FileIdentity::from_words(&staged) != found => Ok(None),
        (Err(errno), Some(_)) if gone(errno)? => Ok(None),
        (found, _) => Ok(Some(found?)),
    }
}
