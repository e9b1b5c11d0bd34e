//! [`LinuxProcess`]: a process of Linux as a processor.

use std::num::NonZeroU64;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use condor_clock::LocalClock;
use condor_dev::InterruptEntry;
use condor_dev::linux::{LinuxBus, MapAccess, UioInterrupts};
use condor_mbox::linux::{LinuxDoorbell, LinuxSystem, LinuxWindow};
use condor_mbox::spin_lock::NativeSwap;
use condor_mbox::{AccessError, Clock as _, Doorbell as _, Processor, Region, Waiting, Windows};
use condor_mos::linux::{Privileges, RealTime, SignalPlatform, Threads};
use condor_mos::{Histograms, Loops, Rate};
use condor_platform::linux::{end_by_arithmetic, hold_at_fatal_errors, hold_for_debugger};
use signal_hook::consts::{SIGINT, SIGTERM};

use super::bell::{ProcessBell, Ringing};
use super::bus::ProcessBus;
use super::clock::{Bells, MappedPage, ProcessClock};
use super::environment::{Environment, FileRange, LoopContext};
use super::error::ProcessError;
use super::interrupts::{self, ProcessInterrupts};
use super::sections::{ProcessSections, Sections, Server};
use super::serial::{SerialPort, Tty};
use super::spinner::Spinner;
use super::timer::{NANOSECONDS, ProcessTimer};
use crate::error::ProgramError;
use crate::lines::{BoardLines, LineState, SERVED_TWICE};
use crate::machine::Machine;
use crate::numbers::{self, PROCESSORS};
use crate::servo::{self, LOOPS, ServoLoop, on_one_stack};
use crate::simulated::{self, SimulatedBell, SimulatedSection, SimulatedTimer};
use crate::text::ShortText;

/// The longest wait for a number whose previous owner is exiting.
const SUCCESSION: Duration = Duration::from_secs(5);
/// The time between two looks for rings that the memory cannot tell of.
const LOOK: Duration = Duration::from_millis(5);
/// The number of times in a row that boards may ask again at once.
const MOST_IN_A_ROW: u32 = 16;
/// The longest text of a fatal error, in bytes.
const FAILURE_BYTES: usize = 240;
/// The longest sleep of a thread that serves.
const NAP: Duration = Duration::from_millis(100);

/// A process of Linux as a processor: the [`Machine`] of its program.
///
/// It holds the processor's number: no other process can claim that number until this machine and
/// all windows, doorbells and other parts that it returned are dropped.
pub struct LinuxProcess {
    number: Processor,
    windows: [Windows<LinuxWindow>; PROCESSORS],
    doorbell: LinuxDoorbell<PROCESSORS>,
    way: LoopPlatform,
    bus: Option<LinuxBus>,
    serial: Option<Arc<SerialPort>>,
    lines: Arc<LineState>,
    uio: Option<Arc<UioInterrupts>>,
    shared_memory: Option<Region<LinuxWindow>>,
    arguments: Vec<String>,
    stopping: Arc<AtomicBool>,
    float_exceptions: bool,
}

/// The context in which loops run.
enum LoopPlatform {
    /// In threads, of which the fastest has this priority; one thread at a time serves messages.
    Threads(Option<u8>, Arc<Server>),
    /// In signals: the code that made the machine has promised the contract of [`SignalPlatform::new`].
    Signals,
    /// In the background, at the points where it polls.
    Spin(Arc<Spinner>),
    /// In simulated time, where the background waits.
    Simulated(ProcessClock),
}

impl LinuxProcess {
    /// Makes the processor that `environment` describes. `arguments` are the program's arguments,
    /// without its name.
    ///
    /// This function claims the processor's number; while another process still holds the number,
    /// it retries for up to 5 s. It asks the kernel to apply the core and the priority to the
    /// calling thread and to threads that this thread starts. A request that the kernel refuses is
    /// printed to standard error, and is not an error. From then on SIGTERM and SIGINT make
    /// [`is_stopping`](Machine::is_stopping) true.
    ///
    /// # Errors
    /// [`ProcessError::Wrong`] if the environment says that loops run in signals, which only
    /// [`allowing_signals`](Self::allowing_signals) permits; [`ProcessError::Open`] or
    /// [`ProcessError::MapBus`] if the bus cannot be mapped; [`ProcessError::Open`] if a device or the serial port
    /// cannot be opened; [`ProcessError::Open`] or [`ProcessError::MapShared`] if another shared memory cannot be mapped;
    /// [`ProcessError::ClockPlace`] or [`ProcessError::Clock`] if that memory holds no page of a
    /// simulated clock; [`ProcessError::Stopping`] or
    /// [`ProcessError::Fatal`] if signals cannot be handled;
    /// [`ProcessError::System`] if the memory cannot be opened or the number cannot be claimed.
    pub fn new(
        environment: &Environment,
        arguments: impl IntoIterator<Item = String>,
    ) -> Result<Self, ProcessError> {
        if environment.loops == LoopContext::Signals {
            let problem = "`loops` must be `threads` or `spin`, since this program's `main` does not allow signals";
            return Err(ProcessError::wrong(&problem));
        }
        Self::of(environment, arguments)
    }

    /// Makes the processor as [`new`](Self::new) does, and also permits loops in signal handlers.
    /// They run there if `environment` says so.
    ///
    /// # Safety
    /// If `environment` says so, all loops that run [on this machine](Machine::with_loops) must
    /// keep the contract of [`SignalPlatform::new`]. In short: loops neither allocate, print, lock nor
    /// wait; all of them together fit on the stack of the thread; and the background stays on that
    /// stack.
    ///
    /// # Errors
    /// Those of [`new`](Self::new), but for that of signals.
    pub unsafe fn allowing_signals(
        environment: &Environment,
        arguments: impl IntoIterator<Item = String>,
    ) -> Result<Self, ProcessError> {
        Self::of(environment, arguments)
    }

    fn of(
        environment: &Environment,
        arguments: impl IntoIterator<Item = String>,
    ) -> Result<Self, ProcessError> {
        if environment.hold_exceptions {
            hold_at_fatal_errors().map_err(ProcessError::Fatal)?;
        }
        if environment.hold_at_start {
            hold_for_debugger();
        }
        let system = LinuxSystem::at(&environment.system, environment.window_bytes)?;
        let bus = environment.bus.as_ref().map(map).transpose()?;
        let shared_memory = environment.shared_memory.as_ref().map(FileRange::window);
        let shared_memory = shared_memory.transpose()?;
        // The interrupts of devices have no simulated time.
        let devices = environment.clock.is_none().then_some(&environment.uio);
        let uio = interrupts::open(devices.map_or(&[], Vec::as_slice))?;
        let tty = environment.serial.as_deref().map(Tty::open).transpose()?;
        let stopping = Arc::new(AtomicBool::new(false));
        for signal in [SIGTERM, SIGINT] {
            signal_hook::flag::register(signal, stopping.clone())
                .map_err(ProcessError::Stopping)?;
        }
        let number = environment.processor;
        let (windows, doorbell) = system.claim_within(number, SUCCESSION)?.into_parts();
        let (way, own_priority) = match (&environment.clock, environment.loops) {
            (Some(clock), _) => {
                let page = MappedPage::open(clock)?;
                let by = Bells::new(page.clone(), doorbell.clone());
                let clock = LocalClock::new(number.0, page, by, environment.work_ns);
                (LoopPlatform::Simulated(Arc::new(clock)), None)
            }
            (None, LoopContext::Threads) => (
                LoopPlatform::Threads(environment.priority, Arc::default()),
                None,
            ),
            (None, LoopContext::Signals) => (LoopPlatform::Signals, environment.priority),
            (None, LoopContext::Spin) => (
                LoopPlatform::Spin(Arc::new(Spinner::new())),
                environment.priority,
            ),
        };
        // Threads inherit these settings from the thread that starts them.
        let mut wishes = urgent(own_priority).timer_slack(NonZeroU64::MIN);
        if let Some(cpu) = environment.cpu {
            wishes = wishes.pinned_to(cpu);
        }
        let mut machine = Self {
            number,
            windows,
            doorbell,
            way,
            bus,
            serial: None,
            lines: Arc::default(),
            uio,
            shared_memory,
            arguments: arguments.into_iter().collect(),
            stopping,
            float_exceptions: environment.float_exceptions,
        };
        machine.tell(&wishes.request());
        let lines = machine.interrupt_controller().lines;
        lines.clear();
        machine.serial = tty.map(|tty| Arc::new(SerialPort::new(tty, lines)));
        if let LoopPlatform::Simulated(clock) = &machine.way {
            clock.announce(0);
            // Nobody goes on before it has seen that all are there.
            machine.doorbell.ring(numbers::SUPERVISOR);
            clock.begin();
        }
        Ok(machine)
    }

    /// Runs `background`, and beside it a thread that calls `serve` at each ring. `below` is the difference of its
    /// priority from that of the fastest loop. `serve` says whether there was something to serve.
    fn with_thread<R>(
        &self,
        name: &'static str,
        below: usize,
        serve: impl Fn() -> bool + Sync,
        background: impl FnOnce() -> R,
    ) -> Result<R, ProgramError> {
        let bell = &self.doorbell;
        let attend = |ended: &AtomicBool| {
            // Relaxed: it comes with a ring, and no later than a nap.
            while !ended.load(Ordering::Relaxed) {
                let seen = bell.prepare();
                while !ended.load(Ordering::Relaxed) && serve() {
                    // The background was rung before this was served, and now looks again.
                    bell.ring(self.number);
                }
                // Without a ring nothing is served: then the heart beats only if the background does.
                while bell.prepare() == seen && !ended.load(Ordering::Relaxed) {
                    let until = bell.now().after(NAP);
                    bell.wait(seen, until, None);
                    if bell.prepare() == seen && bell.now() < until {
                        // A signal, or memory that is gone.
                        thread::sleep(LOOK);
                    }
                }
            }
        };
        self.beside(name, below, attend, background)
    }

    /// Runs `background`, and beside it a thread that serves the interrupts of devices.
    fn with_devices<R>(
        &self,
        devices: &UioInterrupts,
        entry: &dyn InterruptEntry,
        background: impl FnOnce() -> R,
    ) -> Result<R, ProgramError> {
        let attend = |ended: &AtomicBool| {
            while !ended.load(Ordering::Relaxed) {
                if let Ok(true) = devices.wait(Instant::now() + NAP) {
                    entry.serve_interrupts();
                    self.doorbell.ring(self.number);
                }
                if let Ok(true) | Err(_) = devices.wait(Instant::now()) {
                    // An entry that takes nothing, or descriptors that are gone.
                    thread::sleep(LOOK);
                }
            }
        };
        self.beside("devices", LOOPS, attend, background)
    }

    /// Runs `background`, and beside it `attend` in a thread, until its argument is true.
    fn beside<R>(
        &self,
        name: &'static str,
        below: usize,
        attend: impl Fn(&AtomicBool) + Sync,
        background: impl FnOnce() -> R,
    ) -> Result<R, ProgramError> {
        let (bell, ended) = (&self.doorbell, AtomicBool::new(false));
        let attend = || {
            if let LoopPlatform::Threads(priority, _) = self.way {
                let below = |highest: u8| highest.saturating_sub(below as u8).max(1);
                self.tell(&urgent(priority.map(below)).request());
            }
            let _stop = StopOnPanic(&self.stopping);
            attend(&ended);
        };
        thread::scope(|scope| {
            let thread = thread::Builder::new().name(name.into());
            let attending = thread.spawn_scoped(scope, attend);
            attending.map_err(|error| {
                ProgramError::program(&format_args!("cannot start the thread `{name}`: {error}"))
            })?;
            let _end = End {
                ended: &ended,
                bell,
            };
            Ok(background())
        })
    }

    /// Says on standard error what the kernel has refused.
    fn tell(&self, privileges: &Privileges) {
        for (what, error) in privileges.refused() {
            eprintln!(
                "{}: the kernel refuses {what}: {error}; the program runs without it",
                self.number
            );
        }
    }
}

impl Drop for LinuxProcess {
    fn drop(&mut self) {
        // A process that has failed keeps the turn until it is buried: time stands for the next one.
        if let LoopPlatform::Simulated(clock) = &self.way
            && !thread::panicking()
        {
            clock.leave();
        }
    }
}

fn urgent(priority: Option<u8>) -> RealTime {
    priority.map_or(RealTime::none(), |one| RealTime::none().priority(one))
}

/// Ends a thread that serves, also when the background unwinds.
struct End<'e> {
    ended: &'e AtomicBool,
    bell: &'e LinuxDoorbell<PROCESSORS>,
}

impl Drop for End<'_> {
    fn drop(&mut self) {
        self.ended.store(true, Ordering::Relaxed);
        self.bell.ring(self.bell.number());
    }
}

/// Has the program end when what serves has panicked, as it does where that runs in the background.
struct StopOnPanic<'s>(&'s AtomicBool);

impl Drop for StopOnPanic<'_> {
    fn drop(&mut self) {
        if thread::panicking() {
            self.0.store(true, Ordering::Relaxed);
        }
    }
}

fn map(bus: &FileRange) -> Result<LinuxBus, ProcessError> {
    let (file, len) = bus.open("bus")?;
    let len = usize::try_from(len).unwrap_or(usize::MAX);
    LinuxBus::map(&file, bus.offset, 0, len, MapAccess::ReadWrite).map_err(|source| {
        ProcessError::MapBus {
            path: bus.path.clone(),
            source,
        }
    })
}

impl Machine for LinuxProcess {
    type Window = LinuxWindow;
    type Doorbell = ProcessBell;
    type Exclusion = ProcessSections;
    type Bus = ProcessBus;
    type TestAndSet = NativeSwap<Region<LinuxWindow>>;
    type Controller = ProcessInterrupts;

    fn number(&self) -> Processor {
        self.number
    }

    fn windows(&self) -> [Windows<LinuxWindow>; PROCESSORS] {
        self.windows.clone()
    }

    fn doorbell(&self) -> ProcessBell {
        ProcessBell {
            doorbell: self.doorbell.clone(),
            ringing: match &self.way {
                LoopPlatform::Spin(spinner) => Ringing::Spun(spinner.clone()),
                LoopPlatform::Simulated(clock) => Ringing::Simulated(SimulatedBell(clock.clone())),
                LoopPlatform::Threads(..) | LoopPlatform::Signals => Ringing::Real,
            },
        }
    }

    fn exclusion(&self) -> ProcessSections {
        ProcessSections(match &self.way {
            LoopPlatform::Threads(_, server) => Sections::Threads(server.clone()),
            LoopPlatform::Signals | LoopPlatform::Spin(_) => Sections::OneThread,
            LoopPlatform::Simulated(clock) => Sections::Simulated(SimulatedSection(clock.clone())),
        })
    }

    fn shared_memory(&self) -> Option<Region<LinuxWindow>> {
        self.shared_memory.clone()
    }

    fn test_and_set(
        &self,
        memory: Region<LinuxWindow>,
        offset: u32,
    ) -> Result<Self::TestAndSet, AccessError> {
        NativeSwap::new(memory, offset)
    }

    fn bus(&self) -> ProcessBus {
        ProcessBus {
            mapped: self.bus.clone(),
            serial: self.serial.clone(),
        }
    }

    fn interrupt_controller(&self) -> Self::Controller {
        let data = self.windows[self.number.index()].data.clone();
        ProcessInterrupts {
            lines: BoardLines::new(self.number, data, self.doorbell(), self.lines.clone()),
            uio: self.uio.clone(),
            serial: self.serial.clone(),
        }
    }

    fn with_interrupts<R>(
        &self,
        entry: &dyn InterruptEntry,
        background: impl FnOnce() -> R,
    ) -> Result<R, ProgramError> {
        let ProcessInterrupts { lines, uio, serial } = self.interrupt_controller();
        let serve = || {
            let pending = lines.is_pending();
            if pending {
                entry.serve_interrupts();
            }
            pending
        };
        let in_a_row = AtomicU32::new(0);
        let serve_slowly = || {
            let served = serve();
            if served && lines.is_pending() {
                // A peer that asks again and again, or an entry that takes nothing.
                if in_a_row.fetch_add(1, Ordering::Relaxed) >= MOST_IN_A_ROW {
                    thread::sleep(LOOK);
                }
            } else {
                in_a_row.store(0, Ordering::Relaxed);
            }
            served
        };
        let background = || match serial {
            Some(serial) => self.beside("serial", LOOPS, |ended| serial.attend(ended), background),
            None => Ok(background()),
        };
        let background = || match uio {
            Some(uio) => self.with_devices(&uio, entry, background)?,
            None => background(),
        };
        match &self.way {
            LoopPlatform::Threads(..) | LoopPlatform::Signals => {
                lines.serving(|| self.with_thread("boards", LOOPS, serve_slowly, background))?
            }
            LoopPlatform::Spin(spinner) => {
                let serve = || {
                    serve();
                };
                let served = lines.serving(|| spinner.with_boards(serve, background))?;
                served.map_err(|_| SERVED_TWICE)
            }
            LoopPlatform::Simulated(clock) => {
                simulated::with_interrupts(clock, &lines, entry, background)
            }
        }?
    }

    /// A mailbox that is spun waits at its doorbell, where nothing but the timer is between two looks.
    fn waiting(&self) -> Waiting {
        match self.way {
            LoopPlatform::Threads(..) | LoopPlatform::Signals => Waiting::default(),
            LoopPlatform::Spin(_) | LoopPlatform::Simulated(_) => Waiting::Sleep,
        }
    }

    fn argument(&self, index: usize) -> Option<&str> {
        self.arguments.get(index).map(String::as_str)
    }

    fn is_stopping(&self) -> bool {
        self.stopping.load(Ordering::Relaxed)
            || matches!(&self.way, LoopPlatform::Simulated(clock) if clock.is_stopping())
    }

    fn is_float_exception_fatal(&self) -> bool {
        self.float_exceptions
    }

    fn fail(&self, error: &ProgramError) {
        let text = ShortText::<FAILURE_BYTES>::of(&format_args!("{}: {error}", self.number));
        end_by_arithmetic(text.as_str());
    }

    /// With loops in threads, messages are served in one, too.
    fn mail_interrupts(&self) -> bool {
        matches!(self.way, LoopPlatform::Threads(..))
    }

    fn with_mail<R>(
        &self,
        serve: impl Fn() -> usize + Sync,
        background: impl FnOnce() -> R,
    ) -> Result<R, ProgramError> {
        if !self.mail_interrupts() {
            return Ok(background());
        }
        self.with_thread("mail", LOOPS + 1, || serve() > 0, background)
    }

    fn timer_frequency(&self) -> Rate {
        NANOSECONDS
    }

    fn with_loops<R>(
        &self,
        loops: &mut [ServoLoop<'_>],
        ahead: Duration,
        background: impl FnOnce(&dyn Loops<Instant = u64>) -> R,
    ) -> Result<R, ProgramError> {
        match &self.way {
            LoopPlatform::Threads(priority, _) => {
                let rates = servo::rates(loops)?;
                let now = self.doorbell.now().as_ns();
                let start = servo::first_release(now, NANOSECONDS, &rates, ahead);
                let threads = Threads::<Histograms>::keeping(&rates, &[], urgent(*priority))?;
                servo::run(&threads, loops, start, || {
                    self.tell(&threads.privileges());
                    background(&threads)
                })
            }
            LoopPlatform::Signals => {
                // SAFETY: whoever allowed signals for this machine has promised what is asked for.
                let timer = ProcessTimer::Signals(unsafe { SignalPlatform::new() });
                on_one_stack(timer, loops, ahead, background)
            }
            LoopPlatform::Spin(spinner) => {
                let (spinner, clock) = (spinner.clone(), self.doorbell.clone());
                on_one_stack(
                    ProcessTimer::Spin { spinner, clock },
                    loops,
                    ahead,
                    background,
                )
            }
            LoopPlatform::Simulated(clock) => {
                on_one_stack(SimulatedTimer(clock.clone()), loops, ahead, background)
            }
        }
    }
}
