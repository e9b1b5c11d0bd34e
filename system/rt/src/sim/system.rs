//! [`VirtualSystem`]: processors, their programs, and a run of all of them.

use core::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;

use condor_clock::{LINES, LocalClock, NEVER, Page};
use condor_dev::Bus;
use condor_mbox::linux::{self, LinuxWindow};
use condor_mbox::{self as mbox, Region};

use super::error::{Cause, SimError, SimFailure};
use super::files;
use super::processor::{SimMachine, TurnHandover};
use crate::machine::Program;
use crate::numbers::{self, PROCESSORS};
use crate::silent::Silent;

/// A system of processors in virtual time, all in this process. Add programs to it, then run it; it
/// can be run once.
///
/// ```
/// use condor_rt::{Machine, sim};
/// use condor_mbox::{Clock, Processor};
///
/// let mut system = sim::VirtualSystem::new(4096)?;
/// system.arguments(Processor(2), ["a"])?;
/// system.host(Processor(2), |machine| {
///     assert_eq!(machine.argument(0), Some("a"));
///     while !machine.is_stopping() {
///         machine.work(1_000_000);
///     }
///     Ok::<_, String>(())
/// })?;
/// // A virtual hour, in which there is little to do.
/// let ended_at = system.run_until(3_600_000_000_000)?;
/// assert_eq!(ended_at, 3_600_000_000_000);
/// # Ok::<(), condor_rt::sim::SimError>(())
/// ```
pub struct VirtualSystem<'env, B = Silent> {
    memory: linux::LinuxSystem<PROCESSORS>,
    shared_memory: Option<Region<LinuxWindow>>,
    bus: B,
    all_settings: [ProcessorSettings<'env, B>; PROCESSORS],
}

type Task<'env, B> = Box<dyn FnOnce(&SimMachine<B>) -> Result<(), String> + Send + 'env>;

/// The settings of a processor before the run.
struct ProcessorSettings<'env, B> {
    arguments: Vec<String>,
    work: [u64; condor_clock::LOOPS],
    begins_at: u64,
    task: Option<Task<'env, B>>,
}

impl VirtualSystem<'_> {
    /// Makes a system without boards. The users' region of each processor's `data`, in which its
    /// program places objects, has `window_bytes` bytes.
    ///
    /// # Errors
    /// [`SimError::System`] if the memory cannot be made.
    pub fn new(window_bytes: u32) -> Result<Self, SimError> {
        Self::with_bus(window_bytes, Silent)
    }
}

impl<'env, B: Bus + Clone + Send + Sync> VirtualSystem<'env, B> {
    /// Makes a system as [`new`](VirtualSystem::new) does, with boards on `bus`, which all processors share.
    ///
    /// # Errors
    /// [`SimError::System`] if the memory cannot be made.
    pub fn with_bus(window_bytes: u32, bus: B) -> Result<Self, SimError> {
        let settings = |_| ProcessorSettings {
            arguments: Vec::new(),
            work: [0; condor_clock::LOOPS],
            begins_at: 0,
            task: None,
        };
        Ok(Self {
            memory: linux::LinuxSystem::family(window_bytes)?,
            shared_memory: None,
            bus,
            all_settings: core::array::from_fn(settings),
        })
    }

    /// Adds a memory of `bytes` bytes that belongs to no processor;
    /// [`Machine::shared_memory`](crate::Machine::shared_memory) returns it to all programs.
    ///
    /// # Errors
    /// [`SimError::System`] if the memory cannot be made.
    pub fn share_memory(&mut self, bytes: u32) -> Result<(), SimError> {
        const OWNER: mbox::Processor = mbox::Processor(0);
        let memory = linux::LinuxSystem::<1>::family(bytes)?;
        self.shared_memory = Some(memory.claim(OWNER)?.region(OWNER)?);
        Ok(())
    }

    /// Sets the arguments of the program on processor `number`, which reads them by
    /// [`Machine::argument`](crate::Machine::argument).
    ///
    /// # Errors
    /// [`SimError::NoSuchProcessor`] if no processor has the number.
    pub fn arguments<A: Into<String>>(
        &mut self,
        number: mbox::Processor,
        arguments: impl IntoIterator<Item = A>,
    ) -> Result<(), SimError> {
        self.settings(number)?.arguments = arguments.into_iter().map(Into::into).collect();
        Ok(())
    }

    /// Declares how many nanoseconds of virtual time pass in each run of a loop of processor
    /// `number`, after the body of the loop. `rank` selects the loop: the fastest loop has rank 0.
    /// A rank that no loop has is ignored.
    ///
    /// # Errors
    /// [`SimError::NoSuchProcessor`] if no processor has the number.
    pub fn set_work(
        &mut self,
        number: mbox::Processor,
        rank: u32,
        ns: u64,
    ) -> Result<(), SimError> {
        if let Some(work) = self.settings(number)?.work.get_mut(rank as usize) {
            *work = ns;
        }
        Ok(())
    }

    /// Sets the instant at which the program of `number` begins, in nanoseconds; the default is 0.
    /// Programs that begin at the same instant do so in the order of their processor numbers.
    ///
    /// # Errors
    /// [`SimError::NoSuchProcessor`] if no processor has the number.
    pub fn begin_at(&mut self, number: mbox::Processor, ns: u64) -> Result<(), SimError> {
        self.settings(number)?.begins_at = ns;
        Ok(())
    }

    /// Makes processor `number` run `program` when the system [runs](Self::run).
    ///
    /// # Errors
    /// [`SimError::NoSuchProcessor`] if no processor has the number, [`SimError::Taken`] if it has a program already.
    pub fn spawn<P: Program + Sync>(
        &mut self,
        number: mbox::Processor,
        program: &'env P,
    ) -> Result<(), SimError> {
        self.host(number, |machine| program.run(machine))
    }

    /// Makes processor `number` run the closure `body` when the system [runs](Self::run). Use it
    /// for parts of the host, such as a service, and for tests.
    ///
    /// # Errors
    /// [`SimError::NoSuchProcessor`] if no processor has the number, [`SimError::Taken`] if it has a program already.
    pub fn host<E: fmt::Display>(
        &mut self,
        number: mbox::Processor,
        body: impl FnOnce(&SimMachine<B>) -> Result<(), E> + Send + 'env,
    ) -> Result<(), SimError> {
        let task = &mut self.settings(number)?.task;
        if task.is_some() {
            return Err(SimError::Taken { number });
        }
        *task = Some(Box::new(|machine| {
            body(machine).map_err(|error| error.to_string())
        }));
        Ok(())
    }

    /// Makes the processor [`FILES`](numbers::FILES) run a file service, through which programs
    /// open files in the directory `root`.
    ///
    /// # Errors
    /// [`SimError::Taken`] if that processor has a program already. If the directory cannot be
    /// served, the run fails.
    pub fn files(&mut self, root: impl Into<PathBuf>) -> Result<(), SimError> {
        let root = root.into();
        self.host(numbers::FILES, move |machine| files::serve(machine, &root))
    }

    /// Runs all programs until they end by themselves. Returns the instant at which the last one
    /// ended, in nanoseconds.
    ///
    /// When one program fails, all others are told to stop.
    ///
    /// # Errors
    /// [`SimError::Failed`] if programs failed; [`SimError::System`] if a number cannot be claimed;
    /// [`SimError::Thread`] if a thread cannot be started, in which case the other programs were
    /// told to stop at once.
    pub fn run(self) -> Result<u64, SimError> {
        self.run_until(NEVER)
    }

    /// Runs all programs as [`run`](Self::run) does, and tells all of them to stop at the instant
    /// `ns`, in nanoseconds since the beginning of the run.
    ///
    /// # Errors
    /// [`SimError::Failed`] if programs failed; [`SimError::System`] if a number cannot be claimed;
    /// [`SimError::Thread`] if a thread cannot be started.
    pub fn run_until(self, ns: u64) -> Result<u64, SimError> {
        const { assert!(PROCESSORS == LINES, "each has a line") };
        let page = Arc::new(Page::new());
        // Nobody runs before all have entered.
        page.await_request(OUTSIDE, 0, &TurnHandover::new());
        let mut programs = Vec::new();
        for (number, settings) in (0..).map(mbox::Processor).zip(self.all_settings) {
            let Some(task) = settings.task else {
                continue;
            };
            // The doorbell of Linux goes; the windows go on to hold the number.
            let (windows, _) = self.memory.claim(number)?.into_parts();
            page.announce(number.0, settings.begins_at);
            let shared = (windows, self.shared_memory.clone(), self.bus.clone());
            programs.push((number, settings.work, shared, settings.arguments, task));
        }
        let outcome = Mutex::new(Outcome::default());
        let started = thread::scope(|threads| {
            let mut started = Ok(());
            for (number, work, shared, arguments, task) in programs {
                let (own, outcome) = (page.clone(), &outcome);
                let program = move || {
                    // Here, for the clock belongs to the thread that makes it.
                    let clock = LocalClock::new(number.0, own, TurnHandover::new(), work);
                    let (windows, memory, bus) = shared;
                    let machine = SimMachine::new(clock, windows, memory, bus, arguments);
                    run_one(&machine, task, outcome);
                };
                let result = thread::Builder::new()
                    .name(number.to_string())
                    .spawn_scoped(threads, program);
                if let Err(source) = result {
                    // Those that have a thread are told to stop at once.
                    page.give_up(number.0, &TurnHandover::new());
                    started = Err(SimError::Thread { number, source });
                }
            }
            page.set_stop_at(if started.is_ok() { ns } else { 0 });
            page.finish(OUTSIDE, &TurnHandover::new());
            started
        });
        started?;
        let outcome = outcome.into_inner().unwrap_or_else(PoisonError::into_inner);
        if outcome.failures.is_empty() {
            Ok(outcome.ended_at)
        } else {
            Err(SimError::Failed(outcome.failures))
        }
    }

    fn settings(
        &mut self,
        number: mbox::Processor,
    ) -> Result<&mut ProcessorSettings<'env, B>, SimError> {
        let settings = self.all_settings.get_mut(number.index());
        settings.ok_or(SimError::NoSuchProcessor { number })
    }
}

#[derive(Default)]
struct Outcome {
    ended_at: u64,
    failures: Vec<SimFailure>,
}

/// A number that belongs to no participant.
const OUTSIDE: u8 = 0xf0;

/// The thread of a processor.
fn run_one<B>(machine: &SimMachine<B>, task: Task<'_, B>, outcome: &Mutex<Outcome>) {
    let clock = machine.clock();
    let number = mbox::Processor(clock.number());
    clock.page().first_turn(number.0, clock.handover());
    let ended = catch_unwind(AssertUnwindSafe(|| task(machine)));
    let cause = match ended {
        Ok(Ok(())) => None,
        Ok(Err(text)) => Some(Cause::Error(text)),
        Err(payload) => Some(Cause::of(payload)),
    };
    let at_ns = machine.now();
    let failed = cause.is_some();
    {
        let mut outcome = outcome.lock().unwrap_or_else(PoisonError::into_inner);
        outcome.ended_at = outcome.ended_at.max(at_ns);
        outcome.failures.extend(cause.map(|cause| SimFailure {
            number,
            at_ns,
            cause,
        }));
    }
    if failed && at_ns < clock.page().stop_at() {
        clock.page().set_stop_at(at_ns);
    }
    clock.leave();
}
