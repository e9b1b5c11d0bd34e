//! [`Claim`]: a processor's number that this process holds.

use std::os::fd::OwnedFd;

use super::LinuxMailbox;
use super::doorbell::LinuxDoorbell;
use super::error::SystemError;
use super::objects::Objects;
use super::window::{LinuxWindow, WindowAccess};
use crate::error::MailboxError;
use crate::exclusion::{CriticalSection, Exclusion};
use crate::id::Processor;
use crate::layout::{BELL_BYTES, header};
use crate::region::{Allocator, Region};
use crate::window::{MemoryWindow, StoreOrder};
use crate::windows::Windows;

/// A processor's number in a [`LinuxSystem`](super::LinuxSystem) that this process holds, with the
/// windows and the doorbell that a mailbox needs.
///
/// The number becomes free when the claim, its doorbells and all clones of its own `mail` are
/// dropped: as long as a process can write the `mail`, it holds the number.
#[derive(Debug)]
pub struct Claim<const N: usize> {
    number: Processor,
    allocator: Option<Allocator>,
    windows: [Windows<LinuxWindow>; N],
    doorbell: LinuxDoorbell<N>,
}

impl<const N: usize> Claim<N> {
    /// Returns the processor's number that this claim holds.
    #[must_use]
    pub fn number(&self) -> Processor {
        self.number
    }

    /// Returns the windows of all processors; the index is the processor's number. Every `data` is
    /// mapped for reading and writing; every `mail` but the claim's own is mapped for reading only.
    #[must_use]
    pub fn windows(&self) -> &[Windows<LinuxWindow>; N] {
        &self.windows
    }

    /// Returns the doorbell of the claimed number: it rings other processors, and waits for rings
    /// of this one.
    #[must_use]
    pub fn doorbell(&self) -> &LinuxDoorbell<N> {
        &self.doorbell
    }

    /// Returns the allocator of this processor's own memory, the users' region of its `data`.
    ///
    /// There is only one allocator for a claim, so the parts that are taken from it cannot overlap.
    /// Lend it to every part of the program that needs such memory.
    ///
    /// # Errors
    /// [`SystemError::PlacesTaken`] if this function has returned the allocator before.
    pub fn places(&mut self) -> Result<Allocator, SystemError> {
        let number = self.number;
        self.allocator
            .take()
            .ok_or(SystemError::PlacesTaken { number })
    }

    /// Returns the users' region of the `data` of `processor`: the part that is for programs.
    ///
    /// # Errors
    /// [`SystemError::NoSuchProcessor`] if no processor has the number.
    pub fn region(&self, processor: Processor) -> Result<Region<LinuxWindow>, SystemError> {
        let windows = self.windows.get(processor.index());
        windows
            .and_then(|windows| Region::users(windows.data.clone()).ok())
            .ok_or(SystemError::NoSuchProcessor {
                number: processor,
                processors: N,
            })
    }

    /// Makes the mailbox of this number, which all threads of the process may use. It has not
    /// joined yet.
    ///
    /// # Errors
    /// [`MailboxError::Layout`] if the memory was laid out for another system or by another version;
    /// [`MailboxError::Window`] if it cannot be accessed.
    pub fn mailbox<'v>(self) -> Result<LinuxMailbox<'v, N>, MailboxError> {
        self.mailbox_with(CriticalSection)
    }

    /// Makes the mailbox of this number as [`mailbox`](Self::mailbox) does, but with `exclusion` in
    /// the place of [`CriticalSection`].
    ///
    /// # Errors
    /// [`MailboxError::Layout`] if the memory was laid out for another system or by another version;
    /// [`MailboxError::Window`] if it cannot be accessed.
    pub fn mailbox_with<'v, X: Exclusion>(
        self,
        exclusion: X,
    ) -> Result<LinuxMailbox<'v, N, X>, MailboxError> {
        LinuxMailbox::new(self.number, self.windows, self.doorbell, exclusion)
    }

    /// Returns the windows and the doorbell, from which a mailbox with another doorbell can be
    /// made. They continue to hold the number.
    #[must_use]
    pub fn into_parts(self) -> ([Windows<LinuxWindow>; N], LinuxDoorbell<N>) {
        (self.windows, self.doorbell)
    }

    /// Maps everything, for a caller that has locked `held`; returns `None` if the directory was
    /// removed.
    pub(super) fn new(
        number: Processor,
        held: OwnedFd,
        objects: &Objects<'_>,
        mail_bytes: u32,
        data_bytes: u32,
    ) -> Result<Option<Self>, SystemError> {
        let own = number.index();
        let own_mail = objects.map_own_mail(own, held, mail_bytes)?;
        // Only for people; memory that is gone is noticed by who uses the claim.
        let _ = own_mail.store(header::PROCESS_ID, std::process::id(), StoreOrder::Relaxed);
        let (mut windows, mut bells) = (Vec::new(), Vec::new());
        let (mut mails, mut pipes) = (Vec::new(), Vec::new());
        for peer in 0..N {
            let (Some(lock), Some(data), Some(pipe)) = (
                objects.lock(peer, mail_bytes, WindowAccess::ReadOnly)?,
                objects.map_data(peer, data_bytes)?,
                objects.bell(peer)?,
            ) else {
                return Ok(None);
            };
            let mail = if peer == own {
                own_mail.clone()
            } else {
                objects.map_peers_mail(peer, &lock, mail_bytes)?
            };
            bells.push(data.clone());
            windows.push(Windows { mail, data });
            mails.push(lock);
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
            allocator: Some(Allocator::new(data_bytes.saturating_sub(BELL_BYTES))),
            windows: one_for_each(windows),
            doorbell,
        }))
    }
}

fn one_for_each<T, const N: usize>(all: Vec<T>) -> [T; N] {
    let Ok(array) = all.try_into() else {
        unreachable!("the loop over the numbers pushes one for each");
    };
    array
}
