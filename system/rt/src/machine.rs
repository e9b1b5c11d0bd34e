//! [`Machine`]: the parts of a processor that a program uses.

use core::time::Duration;

use condor_dev::{Bus, InterruptController, InterruptEntry};
use condor_mbox::spin_lock::TestAndSet;
use condor_mbox::{
    self as mbox, AccessError, Doorbell, Exclusion, Mailbox, MemoryWindow, Processor, Region,
    Waiting, Windows,
};
use condor_mos::{Loops, Rate};

use crate::error::ProgramError;
use crate::numbers::PROCESSORS;
use crate::servo::ServoLoop;

/// The type of the mailbox that a program has on machine `M`.
pub type MailboxOf<'v, M> = Mailbox<
    'v,
    (
        <M as Machine>::Window,
        <M as Machine>::Doorbell,
        <M as Machine>::Exclusion,
    ),
    PROCESSORS,
>;

/// The processor on which a program runs: a process of Linux, one of several processors in virtual
/// time, or a hart without an operating system.
///
/// A program that is generic over `Machine` runs unchanged on all of them. The program makes its
/// mailbox, its scheduler, its terminal and its files from the parts that the machine has; see
/// [`Program`].
pub trait Machine: Sync {
    /// The memory that processors and host share.
    type Window: MemoryWindow + Clone + Send + Sync;
    /// The mailbox interrupt. Its clock is the clock of the program.
    type Doorbell: Doorbell + Clone + Sync;
    /// The critical sections that keep background, handlers and loops apart.
    type Exclusion: Exclusion + Clone + Sync;
    /// The bus to which the boards are connected.
    type Bus: Bus + Clone + Send + Sync;
    /// The form of locks in memory that processors share; it is the same one on all processors of a system.
    type TestAndSet: TestAndSet;
    /// The controller of the boards' interrupts.
    type Controller: InterruptController + Clone + Send + Sync;

    /// Returns the number of this processor.
    fn number(&self) -> Processor;

    /// Returns the windows of all processors; the index in the array is the number of a processor.
    fn windows(&self) -> [Windows<Self::Window>; PROCESSORS];

    /// Returns the doorbell of this processor.
    fn doorbell(&self) -> Self::Doorbell;

    /// Returns the critical sections of this processor.
    fn exclusion(&self) -> Self::Exclusion;

    /// Returns the number of ticks per second of the timer that releases the loops.
    fn timer_frequency(&self) -> Rate;

    /// Returns the bus to which the boards are connected.
    fn bus(&self) -> Self::Bus;

    /// Returns the controller of the boards' interrupts, for a [`Switch`](condor_dev::Switch).
    fn interrupt_controller(&self) -> Self::Controller;

    /// Runs `background`, and serves the boards' interrupts by `entry` meanwhile. They interrupt background and message
    /// handlers, and servo loops interrupt them. In a program that [`Setup`](crate::Setup) makes, call
    /// [`Setup::interrupts`](crate::Setup::interrupts).
    ///
    /// | machine | what serves |
    /// |---|---|
    /// | a process whose loops run in threads or signals | a thread, as soon as the processor is rung |
    /// | a process that spins | the background, at the points where it polls |
    /// | a processor in simulated time | the background where it waits, at the instant of the interrupt: after the loops of that instant and before its messages |
    /// | a hart | an interrupt of the hart |
    ///
    /// # Errors
    /// [`ProgramError`] if interrupts cannot be served; `background` has not run then.
    fn with_interrupts<R>(
        &self,
        entry: &dyn InterruptEntry,
        background: impl FnOnce() -> R,
    ) -> Result<R, ProgramError>;

    /// Returns the set of causes of traps for which the processor has no handler, and which are now disabled: bit *n*
    /// stands for cause *n*.
    fn unhandled_causes(&self) -> u32 {
        0
    }

    /// Returns the memory that belongs to no processor and that all processors and the host can
    /// access; `None` if the system has none.
    ///
    /// The memory consists of zeros when the system begins, and keeps its contents when a program is restarted. If
    /// programs [log](crate::Background::log), its first [`BYTES`](crate::shared_log::BYTES) are for the log. Otherwise
    /// the programs agree among themselves on the offsets in it.
    fn shared_memory(&self) -> Option<Region<Self::Window>> {
        None
    }

    /// Returns the lock at `offset` bytes of `memory`, for a [`SpinLock`](mbox::SpinLock) that protects a structure of
    /// several processors there. All processors must agree on the offset. The lock takes 2112 bytes at most.
    ///
    /// # For implementers
    ///
    /// [`NativeSwap`](mbox::spin_lock::NativeSwap) if all processors of the system have compare-and-swap, and
    /// [`Bakery`](mbox::spin_lock::Bakery) for [`PROCESSORS`] processors otherwise.
    ///
    /// # Errors
    /// [`AccessError`] if the lock is misaligned or not inside.
    fn test_and_set(
        &self,
        memory: Region<Self::Window>,
        offset: u32,
    ) -> Result<Self::TestAndSet, AccessError>;

    /// Returns the way in which the mailbox of the program waits.
    fn waiting(&self) -> Waiting {
        Waiting::default()
    }

    /// Makes the mailbox of this processor, which has not joined yet.
    ///
    /// # Errors
    /// [`mbox::MailboxError::Layout`] if the memory was laid out for another system or by another version;
    /// [`mbox::MailboxError::Window`] if it cannot be accessed.
    fn mailbox<'v>(&self) -> Result<MailboxOf<'v, Self>, mbox::MailboxError>
    where
        Self: Sized,
    {
        let (windows, doorbell) = (self.windows(), self.doorbell());
        let mut mailbox = Mailbox::new(self.number(), windows, doorbell, self.exclusion())?;
        mailbox.set_waiting(self.waiting());
        Ok(mailbox)
    }

    /// Returns argument `index` of the program, counted from 0, as the system description lists it; `None`
    /// if there are fewer arguments. The system description is the file that lists the processors.
    fn argument(&self, index: usize) -> Option<&str>;

    /// Returns true if the program must end. The background of the program must ask at least every
    /// 100 ms.
    fn is_stopping(&self) -> bool;

    /// Returns true if a floating-point exception that a servo loop has raised is fatal: a program that
    /// [`Setup`](crate::Setup) runs looks after each run of a loop, and then [fails](Self::fail). The default returns false.
    /// [`FloatExceptions`](condor_platform::FloatExceptions) says which exceptions count; a conversion of a number that is
    /// too large for an integer type does, too.
    fn is_float_exception_fatal(&self) -> bool {
        false
    }

    /// Ends the program at once because of a fatal error, of which its supervisor is told, or has it wait for a debugger.
    /// It may be called where a loop runs. A machine that has no way to do this, such as the default, does nothing.
    fn fail(&self, error: &ProgramError) {
        let _ = error;
    }

    /// Returns true if messages are served while the background computes: by the mailbox interrupt
    /// of a hart, or by a thread.
    fn mail_interrupts(&self) -> bool {
        false
    }

    /// Runs `background`. If [`mail_interrupts`](Self::mail_interrupts) is true, it also calls
    /// `serve` at each ring of the doorbell.
    ///
    /// `serve` calls [`Messenger::serve`](condor_mbox::Messenger::serve) with a timeout of zero
    /// and returns how many messages it served. Its mailbox must want [all
    /// rings](condor_mbox::Mailbox::ring_always). Servo loops are more urgent than `serve`.
    /// `background` begins by ringing this processor, so that rings from before this call are not
    /// lost.
    ///
    /// If `mail_interrupts` is false, the background serves messages where it waits. If it is true,
    /// the background must not serve: it [waits for rings](condor_mbox::Doorbell::wait) and then
    /// looks what the handlers have done. If it served, an interrupt could come after the
    /// background has taken a message and before the handler of that message starts, and serve a
    /// later message first. (A process keeps the order even then: only one thread at a time serves,
    /// and the background is rung again after handlers have run.)
    ///
    /// # Errors
    /// [`ProgramError`] if messages cannot be served; `background` has not run then.
    fn with_mail<R>(
        &self,
        serve: impl Fn() -> usize + Sync,
        background: impl FnOnce() -> R,
    ) -> Result<R, ProgramError> {
        let _ = serve;
        Ok(background())
    }

    /// Runs `loops` and `background`. The number of a loop is its index in `loops`. `background`
    /// gets a [`Loops`], by which it can ask for the counts of loops and change their rates.
    ///
    /// The loops are released `ahead` of the instants in the middle of the periods of the fastest of them; see
    /// [`Setup::ahead`](crate::Setup::ahead).
    ///
    /// Machines whose loops interrupt the background on its stack implement this by
    /// [`on_one_stack`](crate::on_one_stack).
    ///
    /// # Errors
    /// [`ProgramError::Rate`] if the rates cannot be scheduled, [`ProgramError::Loop`] or [`ProgramError::Start`] if
    /// the loops cannot start; `background` has not run then.
    fn with_loops<R>(
        &self,
        loops: &mut [ServoLoop<'_>],
        ahead: Duration,
        background: impl FnOnce(&dyn Loops<Instant = u64>) -> R,
    ) -> Result<R, ProgramError>;
}

/// A program for any [`Machine`].
///
/// The loops of a program neither wait, allocate, print nor lock: on most machines they are interrupts. On other
/// machines they run at the same time as the background and the handlers. Data that they share must lie in the windows,
/// in an atomic or in a [`Latest`](crate::Latest), or be used only inside critical sections: those of the machine's
/// [exclusion](Machine::exclusion) or of the `critical-section` crate.
///
/// ```
/// use condor_rt::{Machine, Processor, Program, ProgramError, Rate, Setup, sim::VirtualSystem};
///
/// struct Servo;
///
/// impl Program for Servo {
///     fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
///         let mut runs = 0;
///         Setup::new(machine)?.servo("servo", Rate::hz(400), &mut |_tick| runs += 1).run()?;
///         println!("{runs} ticks");
///         Ok(())
///     }
/// }
///
/// let mut system = VirtualSystem::new(16384)?;
/// system.spawn(Processor(1), &Servo)?;
/// system.run_until(1_000_000_000)?;
/// # Ok::<_, condor_rt::sim::SimError>(())
/// ```
pub trait Program {
    /// Runs until [`Machine::is_stopping`] returns true.
    ///
    /// # Errors
    /// [`ProgramError`] if the program has failed; its starter, such as a supervisor, decides what
    /// follows. A program makes an error of its own by [`ProgramError::program`].
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError>;
}
