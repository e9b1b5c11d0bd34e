//! The arguments of the parts of a program: [`HandlerCall`] for a handler, [`LoopTick`] for a loop, and
//! [`Background`].

use core::cell::{Cell, RefCell};
use core::fmt::{self, Write as _};
use core::ops::Deref;
use core::time::Duration;

use condor_dev::InterruptEntry;
use condor_fs::{Area, FileSystem};
use condor_mbox::published::Publisher;
use condor_mbox::{self as mbox, Clock as _, Doorbell as _, Exclusion, Instant, MemoryWindow};
use condor_mbox::{Allocator, Messenger, Processor, Region, Vector};
use condor_mos::{LoopError, LoopId, Loops, Statistics};
use condor_tty::Terminal;

use crate::error::ProgramError;
use crate::interrupts::Interrupts;
use crate::loops::LoopReport;
use crate::machine::{Machine, MailboxOf};
use crate::numbers;
use crate::servo::LOOPS;
use crate::shared_log;
use crate::supervisor::Supervisor;
use crate::variables::RateParam;

/// Characters that can be typed ahead.
const TYPED: usize = 128;
/// The greatest number of host files that a program can have open at a time.
pub const FILES: usize = 4;
/// The time that the file service may take, with restarts of it.
const FILES_TIMEOUT: Duration = Duration::from_secs(30);
/// The time between two reports of the counts of the loops, in nanoseconds.
const REPORT_NS: u64 = 50_000_000;

/// The type of the terminal that a program has on machine `M`;
/// [`Setup::console`](crate::Setup::console) makes it.
pub type ConsoleOf<M> = Terminal<<M as Machine>::Window, <M as Machine>::Exclusion, TYPED>;
/// The type of the client of the file service that a program has on machine `M`;
/// [`Background::files`] returns it.
pub type FilesOf<'m, M> = FileSystem<'m, MailboxOf<'m, M>, <M as Machine>::Window, FILES>;

/// A terminal that never waits, without its type.
pub(crate) trait Screen: Sync {
    fn print(&self, messenger: &dyn Messenger, text: fmt::Arguments<'_>);
}

impl<W: MemoryWindow + Sync, X: Exclusion + Sync, const IN: usize> Screen for Terminal<W, X, IN> {
    fn print(&self, messenger: &dyn Messenger, text: fmt::Arguments<'_>) {
        // The terminal counts the text for which it has no room.
        let _ = self.poster(messenger).write_fmt(text);
    }
}

/// The argument of a message handler. It dereferences to the [call](mbox::Call) of the mailbox, which has the sender,
/// the vector and the data of the message, and can send messages. It can also print on the program's terminal.
pub struct HandlerCall<'c> {
    pub(crate) call: &'c mbox::Call<'c>,
    pub(crate) screen: Option<&'c dyn Screen>,
}

impl<'c> Deref for HandlerCall<'c> {
    type Target = mbox::Call<'c>;

    fn deref(&self) -> &mbox::Call<'c> {
        self.call
    }
}

impl HandlerCall<'_> {
    /// Prints on the program's terminal without waiting; does nothing if the program has no
    /// terminal.
    pub fn print(&self, text: fmt::Arguments<'_>) {
        if let Some(screen) = self.screen {
            screen.print(self.call, text);
        }
    }
}

/// The argument of a loop's body: one run of the loop, in which the body can print and send
/// messages.
pub struct LoopTick<'t> {
    /// The instant at which the run was due, in nanoseconds of the machine's clock.
    pub due: Instant,
    /// The number of runs before this one; wraps to 0 after 2³² runs.
    pub number: u32,
    pub(crate) messenger: &'t (dyn Messenger + Sync),
    pub(crate) screen: Option<&'t dyn Screen>,
}

impl LoopTick<'_> {
    /// Prints on the program's terminal without waiting; does nothing if the program has no
    /// terminal.
    pub fn print(&self, text: fmt::Arguments<'_>) {
        if let Some(screen) = self.screen {
            screen.print(self.messenger, text);
        }
    }

    /// Sends the word `data` on `vector` to the processor `to`, without a reply and without
    /// waiting.
    ///
    /// # Errors
    /// [`mbox::MailboxError::NoSlot`] if there is no room for the message now,
    /// [`mbox::MailboxError::NotConnected`] if the receiver has not joined; otherwise an error of
    /// [`Messenger::send`].
    pub fn send(&self, to: Processor, vector: Vector, data: u32) -> Result<(), mbox::MailboxError> {
        self.messenger.send(to, vector, data, Duration::ZERO)
    }
}

/// The reports of a program about its interrupts and its loops.
pub(crate) type Reports<M> = (
    Option<Publisher<Interrupts, Region<<M as Machine>::Window>>>,
    heapless::Vec<LoopReport<<M as Machine>::Window>, LOOPS>,
);

/// A loop whose rate others may set, the parameter by which they do, and the rate that was set last, in Hz.
pub(crate) type FollowedRate<'b> = (LoopId, &'b RateParam<'b>, Cell<f64>);

/// The argument of a program's background: the machine, mailbox, terminal, files and loops of the
/// running program. Loops and handlers may interrupt the background.
pub struct Background<'b, M: Machine> {
    pub(crate) machine: &'b M,
    pub(crate) mailbox: &'b MailboxOf<'b, M>,
    pub(crate) console: Option<&'b ConsoleOf<M>>,
    pub(crate) area: Option<Area<FILES>>,
    pub(crate) asks: Option<&'b Allocator>,
    pub(crate) own: &'b Region<M::Window>,
    pub(crate) loops: Option<&'b dyn Loops<Instant = u64>>,
    pub(crate) names: &'b [&'b str],
    pub(crate) rates: &'b [FollowedRate<'b>],
    pub(crate) interrupts: Option<&'b dyn InterruptEntry>,
    /// The processor whose messages the program hears.
    pub(crate) listens: Option<Processor>,
    pub(crate) reports: RefCell<(Instant, Reports<M>)>,
}

impl<'b, M: Machine> Background<'b, M> {
    /// Returns the machine on which the program runs.
    #[must_use]
    pub const fn machine(&self) -> &'b M {
        self.machine
    }

    /// Returns the mailbox of the program, which has already joined the system.
    #[must_use]
    pub const fn mailbox(&self) -> &'b MailboxOf<'b, M> {
        self.mailbox
    }

    /// Returns the program's terminal, for reading and writing.
    ///
    /// # Errors
    /// [`ProgramError::Missing`] if the program did not call
    /// [`Setup::console`](crate::Setup::console).
    pub fn console(&self) -> Result<&'b ConsoleOf<M>, ProgramError> {
        self.console
            .ok_or(ProgramError::Missing { what: "console" })
    }

    /// Prints on the program's terminal; does nothing if the program has no terminal.
    pub fn print(&self, text: fmt::Arguments<'_>) {
        if let Some(console) = self.console {
            // The terminal counts the text for which it has no room.
            let _ = console.console(self.mailbox).write_fmt(text);
        }
    }

    /// Appends a line to the log of the system, with the name of this processor and the time. All processors append to
    /// it, processes and harts alike; `condor log --shared` shows it. Of a text longer than
    /// [`TEXT_BYTES`](condor_mbox::SharedLog::TEXT_BYTES) the beginning is kept. The call waits for 100 ms at most; meanwhile
    /// messages are not served where no interrupt serves them.
    ///
    /// The log lies in the memory that belongs to no processor, at its [beginning](crate::shared_log::BYTES).
    ///
    /// # Errors
    /// [`ProgramError::SharedMemory`] if the system has no such memory, or too little; [`ProgramError::SharedLog`] if
    /// others did not let this program append, or the memory holds something else.
    pub fn log(&self, text: fmt::Arguments<'_>) -> Result<(), ProgramError> {
        shared_log::append(self.machine, self.mailbox, text)
    }

    /// Connects to the file service, and returns a client with which the background opens the
    /// host's files.
    ///
    /// # Errors
    /// [`ProgramError::Missing`] if the program did not call [`Setup::files`](crate::Setup::files);
    /// [`ProgramError::Files`] if [`FileSystem::connect`] fails.
    pub fn files(&self) -> Result<FilesOf<'b, M>, ProgramError> {
        let area = self.area.ok_or(ProgramError::Missing { what: "files" })?;
        let (own, server) = (self.own.clone(), numbers::FILES);
        Ok(FileSystem::connect(
            self.mailbox,
            server,
            own,
            area,
            FILES_TIMEOUT,
        )?)
    }

    /// Returns a client that asks the supervisor to restart and load the programs of processors. A
    /// program may have only one such client at a time.
    ///
    /// # Errors
    /// [`ProgramError::Missing`] if the program did not call [`Setup::supervisor`](crate::Setup::supervisor);
    /// [`ProgramError::Access`] if the processor's own memory cannot be accessed.
    pub fn supervisor(&self) -> Result<Supervisor<'b, M>, ProgramError> {
        let what = "supervisor";
        let allocator = self.asks.ok_or(ProgramError::Missing { what })?.clone();
        Supervisor::new(self.mailbox, self.own.clone(), allocator)
    }

    /// Returns the present counts of the loop called `name`, such as its releases and its worst
    /// lateness.
    ///
    /// # Errors
    /// [`ProgramError::Missing`] if the program has no loops, [`ProgramError::Loop`] with
    /// [`LoopError::NoSuchLoop`] if no loop has this name.
    pub fn statistics(&self, name: &str) -> Result<Statistics, ProgramError> {
        let (loops, id) = self.servo(name)?;
        Ok(loops.statistics(id)?)
    }

    /// Resets the counts and times in the [`statistics`](Self::statistics) of the loop called
    /// `name` to 0.
    ///
    /// # Errors
    /// [`ProgramError::Missing`] if the program has no loops, [`ProgramError::Loop`] with
    /// [`LoopError::NoSuchLoop`] if no loop has this name.
    pub fn reset_statistics(&self, name: &str) -> Result<(), ProgramError> {
        let (loops, id) = self.servo(name)?;
        Ok(loops.reset_statistics(id)?)
    }

    /// Enables or disables the loop called `name`; a disabled loop is not released.
    ///
    /// # Errors
    /// [`ProgramError::Missing`] if the program has no loops, [`ProgramError::Loop`] with
    /// [`LoopError::NoSuchLoop`] if no loop has this name.
    pub fn set_enabled(&self, name: &str, enabled: bool) -> Result<(), ProgramError> {
        let (loops, id) = self.servo(name)?;
        Ok(if enabled {
            loops.enable(id)
        } else {
            loops.disable(id)
        }?)
    }

    /// Returns true if the program has been told to stop, so that the background must return.
    #[must_use]
    pub fn is_stopping(&self) -> bool {
        self.machine.is_stopping()
    }

    /// Waits for messages while their handlers run, until messages were served or `time` has
    /// passed. Then publishes the counts of the loops as [`show`](Self::show) does.
    ///
    /// # Errors
    /// [`ProgramError::Mailbox`] with [`mbox::MailboxError::Window`], or [`ProgramError::Access`], if the processor's
    /// own memory cannot be accessed.
    pub fn serve(&self, time: Duration) -> Result<(), ProgramError> {
        let bell = self.machine.doorbell();
        if self.machine.mail_interrupts() {
            bell.wait(bell.prepare(), bell.now().after(time), None);
            self.mailbox.beat()?;
        } else {
            self.mailbox.serve(time)?;
        }
        self.show()
    }

    /// Publishes the counts of the loops, applies rates of loops that other programs have set, and begins to
    /// [listen](crate::Setup::listen) as soon as it can.
    /// Does nothing if it has done so less than 50 ms ago. Call this in a background that never
    /// calls [`serve`](Self::serve), which does the same.
    ///
    /// # Errors
    /// [`ProgramError::Access`] if the processor's own memory cannot be accessed.
    pub fn show(&self) -> Result<(), ProgramError> {
        let now = self.machine.doorbell().now();
        if let Ok(mut reports) = self.reports.try_borrow_mut()
            && now.ns_since(reports.0) >= REPORT_NS
        {
            reports.0 = now;
            self.listen();
            if let Some(loops) = self.loops {
                self.follow_rates(loops);
            }
            self.show_now(&mut reports.1)?;
        }
        Ok(())
    }

    /// Asks the processor that the program listens to, until that has answered once.
    pub(crate) fn listen(&self) {
        if self.listens.is_some() && self.mailbox.listens_to().is_none() {
            // The next report asks again, if that processor is not up or has not answered yet.
            let _ = self.mailbox.listen(self.listens, Duration::ZERO);
        }
    }

    /// Changes the rates of loops to those that others have set.
    pub(crate) fn follow_rates(&self, loops: &dyn Loops<Instant = u64>) {
        for (id, rate, last) in self.rates {
            let hz = rate.wanted();
            let former = last.replace(hz);
            if former.to_bits() == hz.to_bits() {
                continue;
            }
            // Bounds keep out every rate that has no schedule. A loop that rests for another reason goes on resting.
            let _ = match (rate.rate_of(former), rate.rate_of(hz)) {
                (_, None) => loops.disable(*id),
                (Some(_), Some(new)) => loops.set_rate(*id, new),
                (None, Some(new)) => loops.set_rate(*id, new).and_then(|()| loops.enable(*id)),
            };
        }
    }

    fn servo(&self, name: &str) -> Result<(&'b dyn Loops<Instant = u64>, LoopId), ProgramError> {
        let loops = self.loops.ok_or(ProgramError::Missing { what: "servo" })?;
        let place = self.names.iter().position(|known| *known == name);
        let no_such = LoopError::NoSuchLoop {
            id: LoopId(u8::MAX),
            loops: self.names.len() as u8,
        };
        Ok((loops, LoopId(place.ok_or(no_such)? as u8)))
    }

    pub(crate) fn show_now(
        &self,
        (interrupts, reports): &mut Reports<M>,
    ) -> Result<(), ProgramError> {
        if let Some((shown, entry)) = interrupts.as_mut().zip(self.interrupts) {
            shown.publish(&Interrupts::of(entry, self.machine.unhandled_causes()))?;
        }
        if let Some(loops) = self.loops {
            for (number, report) in (0..).zip(reports) {
                let id = LoopId(number);
                report.publish(&loops.statistics(id)?, &loops.histograms(id)?.into())?;
            }
        }
        Ok(())
    }
}
