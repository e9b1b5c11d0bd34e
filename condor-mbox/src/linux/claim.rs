//! [`Claim`]: a number, held.

use std::os::fd::OwnedFd;
use std::path::PathBuf;

use super::doorbell::LinuxDoorbell;
use super::error::SystemError;
use super::system::Objects;
use super::window::{Access, LinuxWindow};
use crate::id::Processor;
use crate::layout::header;
use crate::window::{MemoryWindow, StoreOrder};
use crate::windows::Windows;

/// A number of a [`System`](super::System) that this process holds, with all that a mailbox needs.
///
/// The number is free again when the claim, its doorbells and all clones of the own `mail` are
/// dropped: whoever could still write the `mail` holds the number.
#[derive(Clone, Debug)]
pub struct Claim<const N: usize> {
    number: Processor,
    windows: [Windows<LinuxWindow>; N],
    doorbell: LinuxDoorbell<N>,
}

impl<const N: usize> Claim<N> {
    /// The number that is held.
    #[must_use]
    pub fn number(&self) -> Processor {
        self.number
    }

    /// The windows of all processors, by number: `data` for reading and writing, `mail` for
    /// reading, except one's own.
    #[must_use]
    pub fn windows(&self) -> &[Windows<LinuxWindow>; N] {
        &self.windows
    }

    /// The doorbell of this number.
    #[must_use]
    pub fn doorbell(&self) -> &LinuxDoorbell<N> {
        &self.doorbell
    }

    /// The windows and the doorbell, which go on to hold the number.
    #[must_use]
    pub fn into_parts(self) -> ([Windows<LinuxWindow>; N], LinuxDoorbell<N>) {
        (self.windows, self.doorbell)
    }

    /// Maps everything, for the holder of the lock on `held`; `None` if the directory is gone.
    pub(super) fn new(
        number: Processor,
        held: OwnedFd,
        objects: &Objects<'_>,
        mail_bytes: u32,
        data_bytes: u32,
    ) -> Result<Option<Self>, SystemError> {
        let own = number.index();
        let path = objects.path(own, "mail");
        let own_mail = LinuxWindow::map_and_keep(held, 0, mail_bytes, Access::ReadWrite)
            .map_err(|source| SystemError::Map { path, source })?;
        // Only for people; memory that is gone is noticed by who uses the claim.
        let _ = own_mail.store(header::PROCESS_ID, std::process::id(), StoreOrder::Relaxed);
        let (mut windows, mut bells) = (Vec::new(), Vec::new());
        let (mut mails, mut pipes) = (Vec::new(), Vec::new());
        for peer in 0..N {
            let (Some(mail_file), Some(data_file), Some(pipe)) = (
                objects.mail(peer, mail_bytes, Access::ReadOnly)?,
                objects.data(peer, data_bytes)?,
                objects.bell(peer)?,
            ) else {
                return Ok(None);
            };
            let mail = if peer == own {
                own_mail.clone()
            } else {
                map(
                    &mail_file,
                    mail_bytes,
                    Access::ReadOnly,
                    objects.path(peer, "mail"),
                )?
            };
            let path = objects.path(peer, "data");
            let data = map(&data_file, data_bytes, Access::ReadWrite, path)?;
            bells.push(data.clone());
            windows.push(Windows { mail, data });
            mails.push(mail_file);
            pipes.push(pipe);
        }
        let doorbell = LinuxDoorbell::new(
            number,
            own_mail,
            one_for_each(bells),
            one_for_each(mails),
            one_for_each(pipes),
        )
        .map_err(SystemError::os("duplicate", objects.path(own, "bell")))?;
        Ok(Some(Self {
            number,
            windows: one_for_each(windows),
            doorbell,
        }))
    }
}

/// The error for a number whose `mail` somebody has locked.
pub(super) fn taken(number: Processor, mail: &OwnedFd) -> SystemError {
    let mut word = [0; 4];
    // Only for people: what cannot be read is zero.
    let _ = rustix::io::pread(mail, &mut word, u64::from(header::PROCESS_ID));
    SystemError::NumberTaken {
        number,
        process_id: u32::from_le_bytes(word),
    }
}

fn map(
    file: &OwnedFd,
    bytes: u32,
    access: Access,
    path: PathBuf,
) -> Result<LinuxWindow, SystemError> {
    LinuxWindow::map(file, 0, bytes, access).map_err(|source| SystemError::Map { path, source })
}

fn one_for_each<T, const N: usize>(all: Vec<T>) -> [T; N] {
    let Ok(array) = all.try_into() else {
        unreachable!("the loop over the numbers pushes one for each");
    };
    array
}
