//! The objects of a family: one process creates them, its descendants inherit them.

use std::os::fd::{AsFd, BorrowedFd, OwnedFd, RawFd};
use std::path::{Path, PathBuf};

use rustix::fs::{CWD, MemfdFlags, OFlags, SealFlags};
use rustix::io::{Errno, FdFlags};
use rustix::pipe::PipeFlags;

use super::directory::{expect_kind, expect_size, fill, open_again, reopen};
use super::error::{FileKind, SystemError};
use super::window::WindowAccess;

const SEALS: SealFlags = SealFlags::SHRINK.union(SealFlags::GROW);

/// Sealed memory and a pipe for every processor.
///
/// Inherited descriptors are one open file description in all processes, and would be one holder
/// of locks; so everybody opens them anew before using them.
#[derive(Debug)]
pub(super) struct Family {
    members: Vec<Member>,
}

#[derive(Debug)]
struct Member {
    mail: OwnedFd,
    data: OwnedFd,
    bell: OwnedFd,
}

impl Family {
    pub(super) fn new(
        processors: usize,
        mail_bytes: u32,
        data_bytes: u32,
    ) -> Result<Self, SystemError> {
        let member = |number| {
            // A pipe, unlike an eventfd, can be opened anew: whether writing blocks is then
            // everybody's own affair.
            let (bell, _) = rustix::pipe::pipe_with(PipeFlags::CLOEXEC | PipeFlags::NONBLOCK)
                .map_err(SystemError::os("create", label(number, "bell")))?;
            Ok(Member {
                mail: memory(&label(number, "mail"), mail_bytes)?,
                data: memory(&label(number, "data"), data_bytes)?,
                bell,
            })
        };
        Ok(Self {
            members: (0..processors).map(member).collect::<Result<_, _>>()?,
        })
    }

    /// The family whose descriptors have these numbers in this process.
    ///
    /// The numbers are only opened anew, so a wrong one does no harm.
    pub(super) fn inherit(
        descriptors: &[RawFd],
        mail_bytes: u32,
        data_bytes: u32,
    ) -> Result<Self, SystemError> {
        let mut members = Vec::new();
        for &[mail, data, bell] in descriptors.as_chunks().0 {
            let path = inherited_path(bell);
            let pipe = inherited(bell)?;
            let stat = rustix::fs::fstat(&pipe).map_err(SystemError::os("examine", &path))?;
            expect_kind(&path, &stat, FileKind::Fifo)?;
            members.push(Member {
                mail: inherited_memory(mail, mail_bytes)?,
                data: inherited_memory(data, data_bytes)?,
                bell: pipe,
            });
        }
        Ok(Self { members })
    }

    /// In the order that [`inherit`](Self::inherit) wants.
    pub(super) fn descriptors(&self) -> impl Iterator<Item = BorrowedFd<'_>> {
        self.members.iter().flat_map(|member| {
            [
                member.mail.as_fd(),
                member.data.as_fd(),
                member.bell.as_fd(),
            ]
        })
    }

    /// Lets the descriptors through the next `exec`; for a child between `fork` and `exec`.
    pub(super) fn keep_through_exec(&self) -> rustix::io::Result<()> {
        self.descriptors()
            .try_for_each(|descriptor| rustix::io::fcntl_setfd(descriptor, FdFlags::empty()))
    }

    pub(super) fn mail(&self, number: usize, access: WindowAccess) -> Result<OwnedFd, Errno> {
        reopen(self.members[number].mail.as_fd(), access)
    }

    pub(super) fn data(&self, number: usize) -> Result<OwnedFd, Errno> {
        reopen(self.members[number].data.as_fd(), WindowAccess::ReadWrite)
    }

    pub(super) fn bell(&self, number: usize) -> Result<OwnedFd, Errno> {
        reopen(self.members[number].bell.as_fd(), WindowAccess::ReadWrite)
    }
}

/// Returns the name that stands for a path in errors.
pub(super) fn label(number: usize, object: &str) -> PathBuf {
    PathBuf::from(format!("condor-{number}.{object}"))
}

fn memory(label: &Path, bytes: u32) -> Result<OwnedFd, SystemError> {
    let flags = MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING;
    let create = || {
        let memory = rustix::fs::memfd_create(label, flags)?;
        fill(&memory, bytes.into())?;
        rustix::fs::fcntl_add_seals(&memory, SEALS | SealFlags::SEAL)?;
        Ok::<_, Errno>(memory)
    };
    create().map_err(SystemError::os("create", label))
}

fn inherited_path(descriptor: RawFd) -> PathBuf {
    PathBuf::from(format!("/proc/self/fd/{descriptor}"))
}

fn inherited(descriptor: RawFd) -> Result<OwnedFd, SystemError> {
    let path = format!("/proc/self/fd/{descriptor}");
    open_again(CWD, &path, WindowAccess::ReadWrite, OFlags::empty())
        .map_err(SystemError::os("open", path))
}

fn inherited_memory(descriptor: RawFd, bytes: u32) -> Result<OwnedFd, SystemError> {
    let path = inherited_path(descriptor);
    let memory = inherited(descriptor)?;
    let stat = rustix::fs::fstat(&memory).map_err(SystemError::os("examine", &path))?;
    expect_kind(&path, &stat, FileKind::File)?;
    expect_size(&path, &stat, bytes)?;
    let seals = rustix::fs::fcntl_get_seals(&memory)
        .map_err(SystemError::os("examine the seals of", &path))?;
    if !seals.contains(SEALS) {
        return Err(SystemError::BadDescription {
            description: descriptor.to_string(),
            reason: "the memory is not sealed",
        });
    }
    Ok(memory)
}

#[cfg(test)]
mod tests {
    use std::os::fd::AsRawFd;

    use super::*;

    #[test]
    fn memory_of_a_family_keeps_its_size() {
        let memory = memory(&label(0, "mail"), 4096).expect("it is created");
        let again = reopen(memory.as_fd(), WindowAccess::ReadWrite).expect("it can be opened anew");
        for size in [0, 4095, 4097] {
            assert_eq!(
                rustix::fs::ftruncate(&again, size),
                Err(Errno::PERM),
                "{size}"
            );
        }
    }

    #[test]
    fn memory_that_is_not_sealed_is_refused() {
        let plain = rustix::fs::memfd_create("plain", MemfdFlags::ALLOW_SEALING).expect("memory");
        fill(&plain, 64).expect("it has memory");
        let error = inherited_memory(plain.as_raw_fd(), 64).expect_err("it could be truncated");
        assert!(
            matches!(error, SystemError::BadDescription { .. }),
            "{error}"
        );
        let error = inherited_memory(plain.as_raw_fd(), 68).expect_err("it has another size");
        assert!(matches!(error, SystemError::WrongSize { .. }), "{error}");
    }
}
