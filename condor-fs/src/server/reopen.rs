//! Files whose mode has come to exclude the server's user, and which the server opens once more.
//!
//! A file that is open stays usable on Unix, whatever its mode becomes. A new incarnation of the server has
//! to open it again: it grants the owner the permission for a moment. Before, it notes the former mode in
//! the slot and the operation in the journal, so that the next incarnation can restore the mode.

use std::ffi::CString;
use std::os::fd::OwnedFd;

use rustix::fs::{Mode, OFlags};

use super::error::Stop;
use super::open_files::Block;
use super::tree::{about, path_of};
use super::{FileServer, Job, Step, Steps};
use crate::errno::Errno;
use crate::wire::{FileIdentity, Operation, slot};

/// The permissions that the server needs.
const OWNERS: u32 = 0o600;
/// The bits that are given back; the others stay what they are.
const BITS: u32 = 0o1777;

/// The place of a file that was opened before.
pub(super) enum Former {
    Path(Vec<u8>),
    /// A unique name in the server's directory.
    Aside(CString),
}

impl<S: Steps> FileServer<S> {
    /// Opens the file that has the evidence `is` once more.
    pub(super) fn reopen(
        &self,
        job: &Job<'_>,
        place: &Former,
        flags: OFlags,
        is: FileIdentity,
    ) -> Result<OwnedFd, Stop> {
        let noted = job.noted_mode()?;
        let opened = self.open_former(place, flags);
        if !matches!(opened, Err(Errno::ACCES)) && noted.is_none() {
            return Ok(opened.map_err(stale)?);
        }
        // A client that may change nothing gets no permission by this way.
        self.check_writable(job).map_err(|_| Errno::ACCES)?;
        let found = self.find_former(place).map_err(stale)?;
        let (evidence, status) = about(&found, c"")?;
        if evidence != is {
            return Err(Errno::STALE.into());
        }
        if !status.is_file() {
            return Ok(opened?);
        }
        let mode = noted.unwrap_or(status.mode & 0o7777);
        let opened = match opened {
            Err(Errno::ACCES) => {
                self.begin(job)?;
                job.note_mode(mode | slot::MODE_CHANGED)?;
                change_mode(&found, status.mode & 0o7777 | OWNERS).map_err(|_| Errno::ACCES)?;
                self.reached(job, Step::Widened);
                self.open_former(place, flags)
            }
            opened => opened,
        };
        give_back(&found, mode)?;
        job.note_mode(0)?;
        Ok(opened.map_err(stale)?)
    }

    /// Restores a mode that an incarnation noted for a request that is given up now.
    pub(super) fn give_mode_back(&self, job: &Job<'_>) -> Result<(), Stop> {
        let Some(mode) = job.noted_mode()? else {
            return Ok(());
        };
        self.check_writable(job)?;
        let place = if job.operation == Operation::Open {
            Former::Path(job.path(job.request.path)?)
        } else {
            let block = self.block(job)?.ok_or(Errno::BADF)?;
            job.former(&block)?
        };
        give_back(&self.find_former(&place)?, mode)?;
        job.note_mode(0)
    }

    fn open_former(&self, place: &Former, flags: OFlags) -> Result<OwnedFd, Errno> {
        match place {
            Former::Path(path) => self.tree.open_path(path, flags, 0),
            Former::Aside(name) => {
                let flags = flags | OFlags::CLOEXEC | OFlags::NOFOLLOW;
                (self.tree).open_at(self.tree.stage(), name, flags, Mode::empty())
            }
        }
    }

    /// The file without opening it, which needs no permission of its own.
    fn find_former(&self, place: &Former) -> Result<OwnedFd, Errno> {
        match place {
            Former::Path(path) => self.tree.find(path),
            Former::Aside(_) => self.open_former(place, OFlags::PATH),
        }
    }
}

impl Job<'_> {
    /// Returns the place of the file of a block.
    pub(super) fn former(&self, block: &Block) -> Result<Former, Stop> {
        Ok(if block.has_path() {
            Former::Path(self.path(block.path())?)
        } else {
            Former::Aside(block.unique_name(self.processor))
        })
    }

    /// The mode that a former incarnation noted for this request.
    fn noted_mode(&self) -> Result<Option<u32>, Stop> {
        let incarnations = self.region.word(self.slot + slot::INCARNATIONS)?;
        let noted = self.region.word(self.slot + slot::MODE)?;
        // The first incarnation finds what is left of other requests.
        let changed = incarnations > 1 && noted & slot::MODE_CHANGED != 0;
        Ok(changed.then_some(noted & BITS))
    }

    fn note_mode(&self, mode: u32) -> Result<(), Stop> {
        Ok(self.region.set_word(self.slot + slot::MODE, mode)?)
    }
}

/// The errors that say that a file is not where it was.
fn stale(errno: Errno) -> Errno {
    match errno {
        Errno::NOENT | Errno::ISDIR | Errno::NOTDIR | Errno::LOOP => Errno::STALE,
        other => other,
    }
}

fn give_back(found: &OwnedFd, mode: u32) -> Result<(), Stop> {
    let present = about(found, c"")?.1.mode & 0o7777;
    Ok(change_mode(found, present & !BITS | mode & BITS)?)
}

/// By way of /proc: what was found by its path is not open.
fn change_mode(found: &OwnedFd, mode: u32) -> Result<(), Errno> {
    Ok(rustix::fs::chmod(
        path_of(found),
        Mode::from_raw_mode(mode),
    )?)
}
