//! [`Machine`]: what a program needs to know of the processor on which it runs.

use condor_dev::Bus;
use condor_mbox::{
    self as mbox, Doorbell, Exclusion, Mailbox, MemoryWindow, Processor, Waiting, Windows,
};
use condor_mos::{Loops, Platform};

use crate::error::Error;
use crate::interrupts::Interrupts;
use crate::numbers::PROCESSORS;
use crate::servo::{self, ServoLoop};

/// The mailbox of a program on machine `M`.
pub type MailboxOf<'v, M> = Mailbox<
    'v,
    (
        <M as Machine>::Window,
        <M as Machine>::Doorbell,
        <M as Machine>::Exclusion,
    ),
    PROCESSORS,
>;

/// The processor on which a program runs, whatever it is: a process of Linux, one of several
/// processors in virtual time, or a hart without an operating system.
///
/// A program that is written for any `Machine` is the same text on all of them. It makes its mailbox,
/// its scheduler, its terminal and its files of the parts that the machine has; see
/// [`Program`].
pub trait Machine: Sync {
    /// The memory that processors and host share.
    type Window: MemoryWindow + Clone + Send + Sync;
    /// The mailbox interrupt; its clock is that of the program.
    type Doorbell: Doorbell + Clone + Sync;
    /// How background, handlers and loops keep apart.
    type Exclusion: Exclusion + Clone + Sync;
    /// The timer, and how loops nest.
    type Platform: Platform<Instant = u64> + Sync;
    /// The bus on which the boards are.
    type Bus: Bus + Clone + Sync;

    /// Whether messages come with an interrupt, which [`with_mail`](Self::with_mail) has serve them.
    const MAIL_INTERRUPTS: bool = false;

    /// The number of this processor.
    fn number(&self) -> Processor;

    /// The windows of all processors, by number.
    fn windows(&self) -> [Windows<Self::Window>; PROCESSORS];

    /// The doorbell of this processor.
    fn doorbell(&self) -> Self::Doorbell;

    /// What keeps the contexts of this processor apart.
    fn exclusion(&self) -> Self::Exclusion;

    /// The timer for a scheduler; one scheduler at a time has it.
    fn platform(&self) -> Self::Platform;

    /// The bus on which the boards are.
    fn bus(&self) -> Self::Bus;

    /// How the mailbox of the program waits.
    fn waiting(&self) -> Waiting {
        Waiting::default()
    }

    /// The mailbox of this processor, which has not joined yet.
    ///
    /// # Errors
    /// Those of [`Mailbox::new`].
    fn mailbox<'v>(&self) -> Result<MailboxOf<'v, Self>, mbox::Error>
    where
        Self: Sized,
    {
        let (windows, doorbell) = (self.windows(), self.doorbell());
        let mut mailbox = Mailbox::new(self.number(), windows, doorbell, self.exclusion())?;
        mailbox.set_waiting(self.waiting());
        Ok(mailbox)
    }

    /// An argument that the system description gives to the program, counted from 0.
    fn argument(&self, index: usize) -> Option<&str>;

    /// Whether the program is to end; its background looks at least every 100 ms.
    fn is_stopping(&self) -> bool;

    /// Runs `background`, while the mailbox interrupt, if there is [one](Self::MAIL_INTERRUPTS), calls
    /// `serve`: [`Messenger::serve`](condor_mbox::Messenger::serve) with a time-out of zero, of a
    /// mailbox that wants [all rings](condor_mbox::Mailbox::ring_always). Servo loops interrupt it.
    ///
    /// Without it messages are served where the background waits. With it, messages of one sender stay
    /// in order only if the background does not serve, too: it polls instead of waiting.
    fn with_mail<R>(&self, serve: impl Fn() + Sync, background: impl FnOnce() -> R) -> R {
        let _ = serve;
        background()
    }

    /// What became of the interrupts of its boards so far; `None` if none interrupts.
    fn interrupts(&self) -> Option<Interrupts> {
        None
    }

    /// Runs loops, by their numbers in `loops`, and `background`, which is given what it may ask of them.
    ///
    /// On one stack, which they interrupt; a machine with another way to run loops has its own.
    ///
    /// # Errors
    /// The rates cannot be scheduled, or the loops cannot start; `background` has not run then.
    fn with_loops<R>(
        &self,
        loops: &mut [ServoLoop<'_>],
        background: impl FnOnce(&dyn Loops<Instant = u64>) -> R,
    ) -> Result<R, Error>
    where
        Self: Sized,
    {
        servo::on_one_stack(self.platform(), loops, background)
    }
}

/// A program for any [`Machine`].
///
/// Its loops neither wait, nor allocate, print or lock: on most machines they are interrupts. What they
/// and the background share lies in the windows, in a [`LoopLock`](condor_mos::LoopLock) or in a
/// [`Latest`](condor_mos::Latest).
pub trait Program {
    /// Runs until the machine [is stopping](Machine::is_stopping).
    ///
    /// # Errors
    /// The program has failed, and whoever started it decides what follows. An error of its own enters by
    /// [`Error::program`].
    fn run<M: Machine>(&self, machine: &M) -> Result<(), Error>;
}
