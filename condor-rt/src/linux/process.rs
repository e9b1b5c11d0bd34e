//! [`Process`]: a process of Linux as a processor.

use std::fs::File;
use std::num::NonZeroU64;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use condor_dev::linux::{Access, LinuxBus};
use condor_mbox::linux::{Claim, LinuxDoorbell, LinuxWindow, System, SystemError};
use condor_mbox::{CriticalSection, Processor, Waiting, Windows};
use condor_mos::linux::{Privileges, RealTime, Signals};
use signal_hook::consts::{SIGINT, SIGTERM};

use super::bell::ProcessBell;
use super::bus::ProcessBus;
use super::environment::{BusFile, Environment, Loops};
use super::error::ProcessError;
use super::spinner::Spinner;
use super::timer::{Kind, ProcessTimer};
use crate::machine::Machine;
use crate::numbers::PROCESSORS;
use crate::silent::Silent;

/// How long a number may still be held by a program that is being taken apart.
const SUCCESSION: Duration = Duration::from_secs(5);
/// How often it is looked for.
const LOOK: Duration = Duration::from_millis(5);

/// A process of Linux as a processor: the [`Machine`] of its program.
///
/// It holds the number until it, and all that came from it, are dropped.
pub struct Process {
    number: Processor,
    windows: [Windows<LinuxWindow>; PROCESSORS],
    doorbell: LinuxDoorbell<PROCESSORS>,
    /// There if loops are spun.
    spinner: Option<Arc<Spinner>>,
    bus: ProcessBus,
    arguments: Vec<String>,
    stopping: Arc<AtomicBool>,
    privileges: Privileges,
}

impl Process {
    /// The processor that `environment` describes, with the program's arguments.
    ///
    /// Claims the number, for which it waits a few seconds if somebody still holds it; asks the kernel
    /// for core and priority, which count for the calling thread; and handles SIGTERM and SIGINT.
    ///
    /// # Safety
    /// If `environment` has loops run in signals: whatever is connected to the
    /// [platform](Machine::platform) of this machine keeps the contract of [`Signals::new`]. In short: loops neither allocate, print, lock nor wait; all of them
    /// fit on the stack of the thread; and the background stays on that stack.
    ///
    /// # Errors
    /// [`ProcessError`].
    pub unsafe fn new(
        environment: &Environment,
        arguments: impl IntoIterator<Item = String>,
    ) -> Result<Self, ProcessError> {
        Self::with_loops(environment, environment.loops, arguments)
    }

    /// As [`new`](Self::new), with loops that are spun, whatever `environment` says of them.
    ///
    /// # Errors
    /// [`ProcessError`].
    pub fn spinning(
        environment: &Environment,
        arguments: impl IntoIterator<Item = String>,
    ) -> Result<Self, ProcessError> {
        Self::with_loops(environment, Loops::Spin, arguments)
    }

    fn with_loops(
        environment: &Environment,
        loops: Loops,
        arguments: impl IntoIterator<Item = String>,
    ) -> Result<Self, ProcessError> {
        let system = System::at(&environment.system, environment.window_bytes)?;
        let bus = match &environment.bus {
            Some(bus) => ProcessBus::Mapped(map(bus)?),
            None => ProcessBus::Silent(Silent),
        };
        let stopping = Arc::new(AtomicBool::new(false));
        for signal in [SIGTERM, SIGINT] {
            signal_hook::flag::register(signal, stopping.clone())
                .map_err(ProcessError::Stopping)?;
        }
        let number = environment.processor;
        let (windows, doorbell) = succeed(&system, number)?.into_parts();
        Ok(Self {
            number,
            windows,
            doorbell,
            spinner: (loops == Loops::Spin).then(|| Arc::new(Spinner::new())),
            bus,
            arguments: arguments.into_iter().collect(),
            stopping,
            privileges: wishes(environment).request(),
        })
    }

    /// What the kernel said to core and priority.
    #[must_use]
    pub fn privileges(&self) -> &Privileges {
        &self.privileges
    }
}

fn wishes(environment: &Environment) -> RealTime {
    let mut wishes = RealTime::none().timer_slack(NonZeroU64::MIN);
    if let Some(cpu) = environment.cpu {
        wishes = wishes.pinned_to(cpu);
    }
    if let Some(priority) = environment.priority {
        wishes = wishes.priority(priority);
    }
    wishes
}

/// Claims a number that its former program may still hold while it is taken apart.
fn succeed(
    system: &System<PROCESSORS>,
    number: Processor,
) -> Result<Claim<PROCESSORS>, SystemError> {
    let begun = Instant::now();
    loop {
        match system.claim(number) {
            Err(SystemError::NumberTaken { .. }) if begun.elapsed() < SUCCESSION => {
                thread::sleep(LOOK);
            }
            other => return other,
        }
    }
}

fn map(bus: &BusFile) -> Result<LinuxBus, ProcessError> {
    let path = &bus.path;
    let open = || {
        let file = File::options().read(true).write(true).open(path)?;
        let len = file.metadata()?.len();
        Ok((file, len))
    };
    let (file, len) = open().map_err(|source| ProcessError::OpenBus {
        path: path.clone(),
        source,
    })?;
    let len = bus.bytes.unwrap_or(len.saturating_sub(bus.offset));
    let len = usize::try_from(len).unwrap_or(usize::MAX);
    LinuxBus::map(&file, bus.offset, 0, len, Access::ReadWrite).map_err(|source| {
        ProcessError::MapBus {
            path: path.clone(),
            source,
        }
    })
}

impl Machine for Process {
    type Window = LinuxWindow;
    type Doorbell = ProcessBell;
    type Exclusion = CriticalSection;
    type Platform = ProcessTimer;
    type Bus = ProcessBus;

    fn number(&self) -> Processor {
        self.number
    }

    fn windows(&self) -> [Windows<LinuxWindow>; PROCESSORS] {
        self.windows.clone()
    }

    fn doorbell(&self) -> ProcessBell {
        ProcessBell {
            doorbell: self.doorbell.clone(),
            spinner: self.spinner.clone(),
        }
    }

    fn exclusion(&self) -> CriticalSection {
        CriticalSection
    }

    fn platform(&self) -> ProcessTimer {
        ProcessTimer(match &self.spinner {
            // SAFETY: whoever made this machine with loops in signals has promised what is asked for.
            None => Kind::Signals(unsafe { Signals::new() }),
            Some(spinner) => Kind::Spin {
                spinner: spinner.clone(),
                clock: self.doorbell.clone(),
            },
        })
    }

    fn bus(&self) -> ProcessBus {
        self.bus.clone()
    }

    /// A mailbox that is spun waits at its doorbell, where nothing but the timer is between two looks.
    fn waiting(&self) -> Waiting {
        match self.spinner {
            None => Waiting::default(),
            Some(_) => Waiting::Sleep,
        }
    }

    fn argument(&self, index: usize) -> Option<&str> {
        self.arguments.get(index).map(String::as_str)
    }

    fn is_stopping(&self) -> bool {
        self.stopping.load(Ordering::Relaxed)
    }
}
