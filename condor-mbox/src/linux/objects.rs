//! [`Objects`]: what belongs to the processors of a system, wherever it is.

use std::os::fd::OwnedFd;
use std::path::PathBuf;

use super::directory::OpenDirectory;
use super::error::SystemError;
use super::family::{Family, label};
use super::memory::{LOCK_BYTES, Memory};
use super::window::{LinuxWindow, WindowAccess, WindowMapError};
use crate::id::Processor;
use crate::layout::header;

/// Opens and maps the objects of a system; `None` stands for a directory that was removed meanwhile.
pub(super) enum Objects<'a> {
    Directory {
        place: OpenDirectory,
        /// The place of the windows, if not in files of the directory.
        memory: Option<OpenMemory>,
    },
    Family(&'a Family),
}

/// A memory, and its file.
#[derive(Debug)]
pub(super) struct OpenMemory {
    pub(super) memory: Memory,
    pub(super) file: OwnedFd,
}

impl Objects<'_> {
    /// The file whose lock is the number: the `mail`, or a file that stands for it.
    pub(super) fn lock(
        &self,
        number: usize,
        mail_bytes: u32,
        access: WindowAccess,
    ) -> Result<Option<OwnedFd>, SystemError> {
        match self {
            Self::Directory { place, memory } => {
                let bytes = memory.as_ref().map_or(mail_bytes, |_| LOCK_BYTES);
                place.object(&file_name(number, "mail"), bytes, access)
            }
            Self::Family(family) => self.opened(number, "mail", family.mail(number, access)),
        }
    }

    /// The `mail` of the number whose lock this process holds by `held`, as long as it is mapped.
    pub(super) fn map_own_mail(
        &self,
        number: usize,
        held: OwnedFd,
        bytes: u32,
    ) -> Result<LinuxWindow, SystemError> {
        let Some(OpenMemory { memory, file }) = self.in_memory() else {
            let duplicate = held.try_clone().map_err(|source| WindowMapError::System {
                doing: "duplicate a descriptor",
                source,
            });
            let window = duplicate.and_then(|file| {
                LinuxWindow::map_and_keep(file, 0, bytes, WindowAccess::ReadWrite, held)
            });
            return self.mapped(number, "mail", window);
        };
        let offset = memory.mail_at(number);
        let window = LinuxWindow::map_and_keep(file, offset, bytes, WindowAccess::ReadWrite, held);
        self.mapped(number, "mail", window)
    }

    /// The error for a number whose `lock` somebody has.
    pub(super) fn taken(&self, number: Processor, lock: &OwnedFd) -> SystemError {
        let (file, offset) = self.mail(number.index(), lock);
        let mut word = [0; 4];
        // Only for people: what cannot be read is zero.
        let _ = rustix::io::pread(file, &mut word, offset + u64::from(header::PROCESS_ID));
        SystemError::NumberTaken {
            number,
            process_id: u32::from_le_bytes(word),
        }
    }

    /// The `mail` of a number, whose file that is locked is `lock`.
    pub(super) fn map_peers_mail(
        &self,
        number: usize,
        lock: &OwnedFd,
        bytes: u32,
    ) -> Result<LinuxWindow, SystemError> {
        let (file, offset) = self.mail(number, lock);
        let window = LinuxWindow::map(file, offset, bytes, WindowAccess::ReadOnly);
        self.mapped(number, "mail", window)
    }

    /// The `data` of a number.
    pub(super) fn map_data(
        &self,
        number: usize,
        bytes: u32,
    ) -> Result<Option<LinuxWindow>, SystemError> {
        let map = |file: &OwnedFd, offset| {
            let window = LinuxWindow::map(file, offset, bytes, WindowAccess::ReadWrite);
            self.mapped(number, "data", window).map(Some)
        };
        if let Some(OpenMemory { memory, file }) = self.in_memory() {
            return map(file, memory.data_at(number));
        }
        let file = match self {
            Self::Directory { place, .. } => {
                place.object(&file_name(number, "data"), bytes, WindowAccess::ReadWrite)?
            }
            Self::Family(family) => self.opened(number, "data", family.data(number))?,
        };
        file.map_or(Ok(None), |file| map(&file, 0))
    }

    pub(super) fn bell(&self, number: usize) -> Result<Option<OwnedFd>, SystemError> {
        match self {
            Self::Directory { place, .. } => place.fifo(&file_name(number, "bell")),
            Self::Family(family) => self.opened(number, "bell", family.bell(number)),
        }
    }

    pub(super) fn path(&self, number: usize, object: &str) -> PathBuf {
        match self {
            Self::Directory { place, .. } => place.path_of(&file_name(number, object)),
            Self::Family(_) => label(number, object),
        }
    }

    pub(super) fn is_current(&self) -> Result<bool, SystemError> {
        match self {
            Self::Directory { place, .. } => place.is_current(),
            Self::Family(_) => Ok(true),
        }
    }

    /// The file of a `mail`, and where in it that begins.
    fn mail<'o>(&'o self, number: usize, lock: &'o OwnedFd) -> (&'o OwnedFd, u64) {
        match self.in_memory() {
            None => (lock, 0),
            Some(OpenMemory { memory, file }) => (file, memory.mail_at(number)),
        }
    }

    const fn in_memory(&self) -> Option<&OpenMemory> {
        match self {
            Self::Directory { memory, .. } => memory.as_ref(),
            Self::Family(_) => None,
        }
    }

    fn mapped(
        &self,
        number: usize,
        object: &str,
        window: Result<LinuxWindow, WindowMapError>,
    ) -> Result<LinuxWindow, SystemError> {
        window.map_err(|source| SystemError::Map {
            path: match self.in_memory() {
                None => self.path(number, object),
                Some(opened) => opened.memory.file.clone(),
            },
            source,
        })
    }

    fn opened(
        &self,
        number: usize,
        object: &str,
        result: rustix::io::Result<OwnedFd>,
    ) -> Result<Option<OwnedFd>, SystemError> {
        result
            .map(Some)
            .map_err(SystemError::os("open", self.path(number, object)))
    }
}

pub(super) fn file_name(number: usize, object: &str) -> String {
    format!("{number}.{object}")
}
