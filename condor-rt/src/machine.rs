//! [`Machine`]: what a program needs to know of the processor on which it runs.

use condor_dev::Bus;
use condor_mbox::{
    self as mbox, Doorbell, Exclusion, Mailbox, MemoryWindow, Processor, Region, Waiting, Windows,
};
use condor_mos::{Loops, Rate};

use crate::error::Error;
use crate::interrupts::Interrupts;
use crate::numbers::PROCESSORS;
use crate::servo::ServoLoop;

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
    /// The bus on which the boards are.
    type Bus: Bus + Clone + Sync;

    /// The number of this processor.
    fn number(&self) -> Processor;

    /// The windows of all processors, by number.
    fn windows(&self) -> [Windows<Self::Window>; PROCESSORS];

    /// The doorbell of this processor.
    fn doorbell(&self) -> Self::Doorbell;

    /// What keeps the contexts of this processor apart.
    fn exclusion(&self) -> Self::Exclusion;

    /// Ticks per second of the timer by which loops are due.
    fn timer_frequency(&self) -> Rate;

    /// The bus on which the boards are.
    fn bus(&self) -> Self::Bus;

    /// Returns the memory that belongs to no processor, which all processors and the host reach; `None` if
    /// the system has none.
    ///
    /// It is zeros when the system begins, and stays as it is when a program starts anew. What lies where
    /// in it, programs agree among themselves.
    fn shared_memory(&self) -> Option<Region<Self::Window>> {
        None
    }

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

    /// Whether [`with_mail`](Self::with_mail) serves messages: by the mailbox interrupt of a hart, or by a
    /// thread.
    fn mail_interrupts(&self) -> bool {
        false
    }

    /// Runs `background`, and serves messages meanwhile, if this machine [does](Self::mail_interrupts):
    /// each ring calls `serve`, which is [`Messenger::serve`](condor_mbox::Messenger::serve) with a
    /// time-out of zero, of a mailbox that wants [all rings](condor_mbox::Mailbox::ring_always), and
    /// returns how many messages it has served. Servo loops are more urgent. For rings that came before,
    /// `background` begins by ringing this processor.
    ///
    /// A machine that does not, serves messages where the background waits. On one that does, the
    /// background [waits for rings](condor_mbox::Doorbell::wait) and looks what handlers have done,
    /// instead of serving: an interrupt between a message that the background has taken and the start of
    /// its handler would serve a later one first. (A process keeps the order even then: one thread at a
    /// time serves, and the background is rung again when handlers have run.)
    ///
    /// # Errors
    /// Nothing can serve; `background` has not run then.
    fn with_mail<R>(
        &self,
        serve: impl Fn() -> usize + Sync,
        background: impl FnOnce() -> R,
    ) -> Result<R, Error> {
        let _ = serve;
        Ok(background())
    }

    /// What became of the interrupts of its boards so far; `None` if none interrupts.
    fn interrupts(&self) -> Option<Interrupts> {
        None
    }

    /// Runs loops, by their numbers in `loops`, and `background`, which is given what it may ask of them.
    ///
    /// Where loops interrupt the background on its stack, this is [`on_one_stack`](crate::on_one_stack).
    ///
    /// # Errors
    /// The rates cannot be scheduled, or the loops cannot start; `background` has not run then.
    fn with_loops<R>(
        &self,
        loops: &mut [ServoLoop<'_>],
        background: impl FnOnce(&dyn Loops<Instant = u64>) -> R,
    ) -> Result<R, Error>;
}

/// A program for any [`Machine`].
///
/// Its loops neither wait, nor allocate, print or lock: on most machines they are interrupts. On others
/// they run beside the background and the handlers at the same time. What they share lies in the windows,
/// in an atomic, in a [`Latest`](condor_mos::Latest), in a [`LoopLock`](condor_mos::LoopLock), or is used
/// in sections of the [exclusion](Machine::exclusion) or of `critical-section`.
pub trait Program {
    /// Runs until the machine [is stopping](Machine::is_stopping).
    ///
    /// # Errors
    /// The program has failed, and whoever started it decides what follows. An error of its own enters by
    /// [`Error::program`].
    fn run<M: Machine>(&self, machine: &M) -> Result<(), Error>;
}
