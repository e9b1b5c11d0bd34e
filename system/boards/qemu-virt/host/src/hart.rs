//! [`HartLauncher`]: a processor of another machine, whose memory this one sees.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use condor_debug::gateway::Cleaner;
use condor_debug::{DebugRequest, ProgramState, Tracer, TracerError};
use condor_mbox::linux::{LinuxDoorbell, LinuxWindow};
use condor_mbox::{Doorbell as _, Processor};
use condor_platform::linux::read_regular;

use condor_host::supervisor::{
    ChildProcess, Exit, Launch, LaunchError, ProgramImage, RunState, StopMethod,
};

use crate::debuggee;
use crate::{
    ARGUMENT_BYTES, Control, ERROR_BYTES, HartFault, HartImageError, HartState, LOOPS,
    MachineMemory, Map, MemoryError, StartOrder, cause_name,
};
use condor_rt::numbers::PROCESSORS;

/// The time that a hart may take to come back to its monitor.
const BACK: Duration = Duration::from_secs(3);

/// The end of a program that was taken off its hart.
const ABANDONED: &str = "killed; its hart can run another program";
/// The end of a program whose hart does not answer.
const UNREACHABLE: &str = "its hart no longer answers; restart the service `machine`";

/// A record of whether a machine is on. The code that switches the machine on and off calls
/// [`switch`](Self::switch), and the machine's [`HartLauncher`]s read the record. Clones share one
/// record.
#[derive(Clone, Debug, Default)]
pub struct Power(Arc<AtomicU32>);

impl Power {
    /// Makes the record of a machine that is switched off.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Records that the machine was switched on (`true`) or off (`false`). Programs that ran on its
    /// harts before count as lost, also after a call with the same value.
    pub fn switch(&self, on: bool) {
        let count = self.count();
        let next = count.wrapping_add(if Self::is_on(count) == on { 2 } else { 1 });
        self.0.store(next, Ordering::Relaxed);
    }

    /// Odd while it is on; another one each time it was switched.
    fn count(&self) -> u32 {
        self.0.load(Ordering::Relaxed)
    }

    const fn is_on(count: u32) -> bool {
        count % 2 == 1
    }
}

/// The reason why a [`HartLauncher`] cannot run a program on its hart.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum HartError {
    /// The hart belongs to a machine that is not on, or has not come up.
    #[error("its machine is not running, or its hart {hart} has not started yet")]
    Off {
        /// The index of the hart.
        hart: u32,
    },
    /// The file is not a program that the hart can run.
    #[error("hart {hart} cannot run {file:?}: {source}")]
    Image {
        /// The index of the hart.
        hart: u32,
        /// The path of the file.
        file: PathBuf,
        /// The reason why the hart cannot run it.
        source: HartImageError,
    },
    /// The file cannot be read.
    #[error("cannot read {file:?}: {source}")]
    Unreadable {
        /// The path of the file.
        file: PathBuf,
        /// The error of the operating system.
        source: std::io::Error,
    },
    /// The arguments are longer than a hart takes.
    #[error(
        "the arguments need {found} bytes, with a zero after each; a hart has room for {ARGUMENT_BYTES}"
    )]
    Arguments {
        /// The size of the arguments in bytes, with a zero after each.
        found: usize,
    },
    /// The debug area of the hart cannot be accessed.
    #[error(transparent)]
    Debugger(#[from] TracerError),
    /// The memory of the machine cannot be used, or has no such hart.
    #[error(transparent)]
    Memory(#[from] MemoryError),
}

impl From<MemoryError> for LaunchError {
    fn from(error: MemoryError) -> Self {
        HartError::from(error).into()
    }
}

impl From<HartError> for LaunchError {
    fn from(error: HartError) -> Self {
        Self::Other(Box::new(error))
    }
}

/// A launcher that runs programs on a hart, for the supervisor of a system. It copies a program
/// into the memory of the hart, and controls the hart through its [`Control`] page.
#[derive(Debug)]
pub struct HartLauncher {
    number: Processor,
    place: u32,
    memory: MachineMemory,
    control: Control<LinuxWindow>,
    doorbell: LinuxDoorbell<PROCESSORS>,
    tracer: Tracer<LinuxWindow>,
    cleaner: Cleaner,
    power: Power,
    program: Option<LoadedProgram>,
    running: Option<Running>,
    ended: Option<Exit>,
    /// The report of a fault, or the error of the program itself, that is shown beside the way in which it
    /// ended.
    report: Option<String>,
}

#[derive(Debug)]
struct LoadedProgram {
    file: PathBuf,
    image: crate::HartImage,
    arguments: Vec<u8>,
    simulated: Option<[u64; LOOPS]>,
    hold_exceptions: bool,
    float_exceptions: bool,
}

#[derive(Clone, Copy, Debug)]
struct Running {
    start: u32,
    power: u32,
    abandoned: Option<Instant>,
}

impl HartLauncher {
    /// Makes a launcher for the hart with index `hart` of the machine with this `memory`, without a
    /// program. `doorbell` may be that of any processor of the system; the launcher uses it to ring
    /// the hart. `power` tells whether the machine is on.
    ///
    /// # Errors
    /// [`HartError::Memory`] if the machine has no such hart, or its memory cannot be accessed.
    pub fn new(
        memory: MachineMemory,
        hart: u32,
        doorbell: LinuxDoorbell<PROCESSORS>,
        power: Power,
    ) -> Result<Self, HartError> {
        let map = memory.map();
        let number = usize::try_from(hart)
            .ok()
            .and_then(|hart| map.numbers.get(hart).copied());
        let number = number.ok_or_else(|| HartImageError::no_hart(hart, map));
        let number = Processor(number.map_err(MemoryError::from)?);
        let control = memory.control(hart)?;
        Ok(Self {
            number,
            place: hart,
            tracer: debuggee::tracer(&memory, &control, number, doorbell.clone())?,
            cleaner: Cleaner::new(),
            control,
            memory,
            doorbell,
            power,
            program: None,
            running: None,
            ended: None,
            report: None,
        })
    }

    fn reach(&self, stop: StopMethod, running: Running) -> Result<(), HartError> {
        let said = match stop {
            StopMethod::Ask => self.control.ask_to_end(running.start),
            StopMethod::Force => self.control.abandon(running.start),
        };
        said.map_err(self.memory.at())?;
        self.doorbell.ring(self.number);
        Ok(())
    }

    /// Returns the end of the program, if it has ended.
    fn exit(&mut self, running: Running) -> Option<Exit> {
        if self.power.count() != running.power {
            return Some(Exit::Lost);
        }
        // The memory is gone: nobody can say what the hart does.
        let Ok(state) = self.control.state() else {
            return Some(Exit::Unknown);
        };
        match state {
            HartState::Ended { start, status } if start == running.start => {
                self.report = self.said();
                Some(Exit::Status(status.cast_signed()))
            }
            HartState::Abandoned { start } if start == running.start => {
                Some(Exit::Other(ABANDONED.into()))
            }
            HartState::Faulted { start } if start == running.start => {
                let fault = self.control.fault().unwrap_or_default();
                let text = self.fault_text(&fault);
                self.report = Some(match self.said() {
                    Some(said) => format!("{said}; {text}"),
                    None => text,
                });
                let HartFault { pc, value, .. } = fault;
                let name = cause_name(fault.cause);
                Some(Exit::Other(format!("{name} at {pc:#x}, value {value:#x}")))
            }
            _ => {
                let since = running.abandoned?;
                (since.elapsed() >= BACK).then(|| Exit::Other(UNREACHABLE.into()))
            }
        }
    }

    /// Lets go of a program that a debugger held which has died.
    fn clean_up(&mut self) {
        let lock = debuggee::lock(&self.memory, self.number);
        // Without the memory there is nothing to be released.
        if self.cleaner.look(&self.tracer, &lock) == Ok(true) {
            self.report = Some("its debugger has died, so its breakpoints were removed".into());
        }
    }

    /// Returns the error text that the program has left, if there is one.
    fn said(&self) -> Option<String> {
        let mut error = [0; ERROR_BYTES];
        let len = self.control.error(&mut error).unwrap_or(0);
        let error = error.get(..len).filter(|error| !error.is_empty())?;
        Some(String::from_utf8_lossy(error).into_owned())
    }

    fn fault_text(&self, fault: &HartFault) -> String {
        let [ra, sp, ..] = fault.registers;
        let linked = |address| {
            let program = self.program.as_ref()?;
            let linked = program.image.linked(address)?;
            let file = program.file.file_name().unwrap_or_default();
            Some(format!(" ({linked:#x} in {})", file.display()))
        };
        let (at, from) = (linked(fault.pc), linked(ra));
        format!(
            "{} (cause {:#x}) at {:#x}{}, value {:#x}; ra {ra:#x}{}, sp {sp:#x}, mstatus {:#x}",
            fault.name(),
            fault.cause,
            fault.pc,
            at.unwrap_or_default(),
            fault.value,
            from.unwrap_or_default(),
            fault.status,
        )
    }
}

/// The program in `file` for a hart, without putting it anywhere.
fn read(file: &Path, map: &Map, hart: u32) -> Result<crate::HartImage, HartError> {
    let bytes = read_regular(file).map_err(|source| HartError::Unreadable {
        file: file.into(),
        source,
    })?;
    crate::HartImage::new(&bytes, map, hart).map_err(|source| HartError::Image {
        hart,
        file: file.into(),
        source,
    })
}

/// Arguments as a hart is given them.
pub(crate) fn flat(arguments: &[String]) -> Result<Vec<u8>, HartError> {
    let mut flat = Vec::new();
    for argument in arguments {
        flat.extend(argument.as_bytes());
        flat.push(0);
    }
    let found = flat.len();
    if found > ARGUMENT_BYTES {
        return Err(HartError::Arguments { found });
    }
    Ok(flat)
}

impl Launch for HartLauncher {
    fn check(&self, image: &ProgramImage) -> Result<(), LaunchError> {
        read(&image.file, self.memory.map(), self.place)?;
        flat(&image.arguments)?;
        Ok(())
    }

    fn load(&mut self, image: &ProgramImage) -> Result<(), LaunchError> {
        if self.running.is_some() {
            return Err(LaunchError::Runs);
        }
        self.program = Some(LoadedProgram {
            file: image.file.clone(),
            image: read(&image.file, self.memory.map(), self.place)?,
            arguments: flat(&image.arguments)?,
            simulated: image
                .environment
                .clock
                .as_ref()
                .map(|_| image.environment.work_ns),
            hold_exceptions: image.environment.hold_exceptions,
            float_exceptions: image.environment.float_exceptions,
        });
        Ok(())
    }

    /// The program is copied anew each time: it changes its data as it runs.
    fn start(&mut self) -> Result<(), LaunchError> {
        let program = self.program.as_ref().ok_or(LaunchError::NotLoaded)?;
        let power = self.power.count();
        match self.control.state().map_err(self.memory.at())? {
            HartState::Runs { .. } => return Err(LaunchError::Runs),
            HartState::Off => return Err(HartError::Off { hart: self.place }.into()),
            _ if !Power::is_on(power) => return Err(HartError::Off { hart: self.place }.into()),
            _ => {}
        }
        let mode = self.tracer.mode().map_err(HartError::from)?;
        let mode = DebugRequest {
            hold_exceptions: program.hold_exceptions,
            ..mode
        };
        self.tracer.set_mode(mode).map_err(HartError::from)?;
        let region = self.memory.region();
        program.image.load(region).map_err(self.memory.at())?;
        let order = StartOrder {
            entry: program.image.entry(),
            arguments: &program.arguments,
            simulated: program.simulated,
            float_exceptions: program.float_exceptions,
        };
        let start = self.control.order(order).map_err(self.memory.at())?;
        self.doorbell.ring(self.number);
        self.ended = None;
        self.running = Some(Running {
            start,
            power,
            abandoned: None,
        });
        Ok(())
    }

    fn stop(&mut self, how: StopMethod) -> Result<(), LaunchError> {
        let Some(running) = self.running else {
            return Ok(());
        };
        self.reach(how, running)?;
        if let Some(running) = &mut self.running
            && how == StopMethod::Force
        {
            running.abandoned.get_or_insert_with(Instant::now);
        }
        Ok(())
    }

    fn is_held(&self) -> bool {
        self.running.is_some() && matches!(self.tracer.state(), Ok(ProgramState::Held(_)))
    }

    fn is_ready(&self) -> bool {
        let is_up = self
            .control
            .state()
            .is_ok_and(|state| state != HartState::Off);
        is_up && Power::is_on(self.power.count())
    }

    fn state(&mut self) -> RunState {
        if let Some(running) = self.running {
            let Some(exit) = self.exit(running) else {
                self.clean_up();
                return RunState::Runs;
            };
            self.cleaner.forget();
            self.running = None;
            self.ended = Some(exit);
        }
        self.ended.clone().map_or(RunState::Idle, RunState::Ended)
    }

    fn output(&mut self, line: &mut dyn FnMut(&str)) -> bool {
        if let Some(report) = self.report.take() {
            line(&report);
        }
        false
    }
}

/// The process that is a machine, or dies with it.
pub(crate) struct MachineProcess {
    process: ChildProcess,
    memory: MachineMemory,
    power: Power,
}

impl MachineProcess {
    pub(crate) fn new(memory: MachineMemory, power: Power) -> Self {
        Self {
            process: ChildProcess::new(),
            memory,
            power,
        }
    }
}

impl Launch for MachineProcess {
    fn load(&mut self, image: &ProgramImage) -> Result<(), LaunchError> {
        self.process.load(image)
    }

    fn start(&mut self) -> Result<(), LaunchError> {
        // The states of harts from before the machine was switched off are out of date.
        self.memory.reset()?;
        self.process.start()?;
        self.power.switch(true);
        Ok(())
    }

    fn stop(&mut self, how: StopMethod) -> Result<(), LaunchError> {
        self.process.stop(how)
    }

    fn state(&mut self) -> RunState {
        let state = self.process.state();
        if state != RunState::Runs && Power::is_on(self.power.count()) {
            self.power.switch(false);
        }
        state
    }

    fn ended(&self) -> Option<std::os::fd::BorrowedFd<'_>> {
        self.process.ended()
    }

    fn output(&mut self, line: &mut dyn FnMut(&str)) -> bool {
        self.process.output(line)
    }

    fn has_output(&self) -> Option<std::os::fd::BorrowedFd<'_>> {
        self.process.has_output()
    }

    fn process(&self) -> Option<u32> {
        self.process.process()
    }
}
