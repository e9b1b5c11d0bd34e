//! [`Tracer`]: the host's side of the commands.

use std::time::{Duration, Instant};

use condor_mbox::{AccessError, MemoryWindow, Region};

use crate::area::{self, Area, DebugRequest, Entry, HoldReason, Trigger};

/// The time that a processor may take to execute a command.
const PATIENCE: Duration = Duration::from_secs(3);
/// The time after which a processor is rung again: a ring may go to its program.
const RING_AGAIN: Duration = Duration::from_millis(20);
/// The number of looks of the host before it sleeps between looks, and below the time that it sleeps.
const LOOKS: u32 = 500;
const NAP: Duration = Duration::from_micros(50);

/// The state of a processor's program: it runs, or it is held, that is, stopped until a debugger
/// resumes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProgramState {
    /// The program runs, or the processor has none.
    Runs,
    /// The program is held.
    Held(HoldReason),
}

/// A place at which a program is stopped, by a breakpoint instruction or by a hardware trigger.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Breakpoint {
    /// A breakpoint instruction at this address.
    Instruction(u64),
    /// A trigger of the hardware.
    Trigger(Trigger),
}

impl Breakpoint {
    /// Returns the address of the breakpoint instruction, or of the first byte that the trigger
    /// watches.
    #[must_use]
    pub const fn address(self) -> u64 {
        match self {
            Self::Instruction(address) => address,
            Self::Trigger(trigger) => trigger.address,
        }
    }

    fn change(self, what: u32) -> Entry {
        let it = match self {
            Self::Instruction(_) => area::INSTRUCTION,
            Self::Trigger(trigger) => trigger.word(),
        };
        Entry {
            address: self.address(),
            words: [what, it],
        }
    }
}

/// A breakpoint that is planted in a program, with the instruction that it replaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlantedBreakpoint {
    /// The kind and address of the breakpoint.
    pub breakpoint: Breakpoint,
    /// The instruction that a breakpoint instruction replaces; 0 for a trigger.
    pub original: u32,
}

/// The reason why a processor has not executed a command of a [`Tracer`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum TracerError {
    /// The processor has not executed a command in time.
    #[error(
        "the processor did not answer within {} s: its program masks interrupts, or its machine is off",
        PATIENCE.as_secs()
    )]
    NoAnswer,
    /// The processor refuses a breakpoint.
    #[error(
        "cannot set a breakpoint at {address:#x}: the address does not allow one, or all {} breakpoints are in use; \
         a processor has few hardware triggers, if any",
        area::MOST_PLANTED
    )]
    Refused {
        /// The address of the breakpoint.
        address: u64,
    },
    /// The area cannot be accessed.
    #[error(transparent)]
    Access(#[from] AccessError),
}

/// The access of a debugger on the host to one processor: it sends commands to the
/// [`Stub`](crate::Stub) of that processor, and reads the state and registers of the program. Only
/// the process that holds the debugger lock of the processor may send commands.
pub struct Tracer<W> {
    area: Area<W>,
    ring: Box<dyn Fn() + Send>,
}

impl<W> core::fmt::Debug for Tracer<W> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Tracer").finish_non_exhaustive()
    }
}

impl<W: MemoryWindow> Tracer<W> {
    /// Makes the tracer of the processor that has the debug area `area`. `ring` must raise the interrupt in which the
    /// stub of that processor executes commands.
    pub fn new(area: Region<W>, ring: impl Fn() + Send + 'static) -> Self {
        Self {
            area: Area::new(area),
            ring: Box::new(ring),
        }
    }

    /// Returns the debug mode of the processor: the events at which its program is held.
    ///
    /// # Errors
    /// [`TracerError::Access`] if the area cannot be accessed.
    pub fn mode(&self) -> Result<DebugRequest, TracerError> {
        Ok(self.area.mode()?)
    }

    /// Sets the debug mode of the processor, which applies from its next trap on.
    ///
    /// # Errors
    /// [`TracerError::Access`] if the area cannot be accessed.
    pub fn set_mode(&self, mode: DebugRequest) -> Result<(), TracerError> {
        Ok(self.area.set(area::MODE, mode.word())?)
    }

    /// Returns the state of the processor's program: it runs, or it is held for a reason.
    ///
    /// # Errors
    /// [`TracerError::Access`] if the area cannot be accessed.
    pub fn state(&self) -> Result<ProgramState, TracerError> {
        // Acquire: the frame is that of this hold.
        if self.area.word(area::STATE)? != area::HELD {
            return Ok(ProgramState::Runs);
        }
        let reason = HoldReason::from_word(self.area.word(area::REASON)?);
        Ok(ProgramState::Held(reason))
    }

    /// Returns the number of times that programs of the processor were held. The count wraps.
    ///
    /// # Errors
    /// [`TracerError::Access`] if the area cannot be accessed.
    pub fn holds(&self) -> Result<u32, TracerError> {
        Ok(self.area.word(area::HOLDS)?)
    }

    /// Stops the program, and waits until it is held. Returns the reason why it is held, which is
    /// another one if the program was held already.
    ///
    /// # Errors
    /// [`TracerError::NoAnswer`] if the processor does not answer in time; [`TracerError::Access`] if the
    /// area cannot be accessed.
    pub fn stop(&self) -> Result<HoldReason, TracerError> {
        if let ProgramState::Held(reason) = self.state()? {
            return Ok(reason);
        }
        self.command(area::STOP, &[])?;
        self.wait(|| {
            Ok(match self.state()? {
                ProgramState::Held(reason) => Some(reason),
                ProgramState::Runs => None,
            })
        })
    }

    /// Replaces the planted breakpoints by those of `wanted`. Then resumes the program if `resumes`
    /// is true.
    ///
    /// # Errors
    /// [`TracerError::Refused`] if a breakpoint cannot be planted; the program is not resumed then.
    /// [`TracerError::NoAnswer`] if the processor does not answer in time; [`TracerError::Access`] if the
    /// area cannot be accessed.
    pub fn plant(&self, wanted: &[Breakpoint], resumes: bool) -> Result<(), TracerError> {
        let planted = self.planted()?;
        let gone = planted.iter().map(|planted| planted.breakpoint);
        let gone = gone.filter(|it| !wanted.contains(it));
        let is_new = |it: &Breakpoint| !planted.iter().any(|planted| planted.breakpoint == *it);
        let new = wanted.iter().copied().filter(is_new);
        let changes = gone.map(|it| it.change(area::REMOVE));
        let changes: Vec<Entry> = changes
            .chain(new.map(|it| it.change(area::PLANT)))
            .collect();
        let (most, mut refused) = (area::MOST_CHANGES as usize, Ok(()));
        let mut rest = changes.as_slice();
        while rest.len() > most || (!rest.is_empty() && !resumes) {
            let (some, others) = rest.split_at(rest.len().min(most));
            refused = refused.and(self.made(0, some)?);
            rest = others;
        }
        if resumes && refused.is_ok() {
            refused = refused.and(self.made(area::RESUME, rest)?);
        }
        refused
    }

    /// Removes all breakpoints, and resumes the program if it is held. From then on no debugger is attached to the
    /// processor.
    ///
    /// # Errors
    /// [`TracerError::NoAnswer`] if the processor does not answer in time; [`TracerError::Access`] if the
    /// area cannot be accessed.
    pub fn release(&self) -> Result<(), TracerError> {
        self.set_mode(self.mode()?.left())?;
        self.command(area::RELEASE, &[])
    }

    /// Releases the processor as [`release`](Self::release) does, but in several calls, none of which waits. Returns
    /// true when the processor is released; call this method until then.
    ///
    /// # Errors
    /// [`TracerError::Access`] if the area cannot be accessed.
    pub fn try_release(&self) -> Result<bool, TracerError> {
        let mode = self.mode()?;
        if !self.is_done()? {
            (self.ring)();
            return Ok(false);
        }
        if self.area.word(area::ACTION)? == area::RELEASE && !mode.attached {
            return Ok(true);
        }
        self.set_mode(mode.left())?;
        self.give(area::RELEASE, &[])?;
        Ok(false)
    }

    /// Returns the breakpoints that are planted in the processor's program.
    ///
    /// # Errors
    /// [`TracerError::Access`] if the area cannot be accessed.
    pub fn planted(&self) -> Result<Vec<PlantedBreakpoint>, TracerError> {
        let mut all = Vec::new();
        for place in 0..area::MOST_PLANTED {
            let Entry { address, words } = self.area.planted(place)?;
            let breakpoint = match words[1] {
                area::INSTRUCTION => Some(Breakpoint::Instruction(address)),
                what => Trigger::from_word(address, what).map(Breakpoint::Trigger),
            };
            if let Some(breakpoint) = breakpoint {
                let original = words[0];
                all.push(PlantedBreakpoint {
                    breakpoint,
                    original,
                });
            }
        }
        Ok(all)
    }

    /// Returns true if `address` is closed to breakpoints. The stub in the running program reports such addresses
    /// when the program begins.
    ///
    /// # Errors
    /// [`TracerError::Access`] if the area cannot be accessed.
    pub fn is_closed(&self, address: u64) -> Result<bool, TracerError> {
        Ok(self.area.closed()?.contains(&address))
    }

    /// Returns the register at `place` in the frame, the saved registers of the program. The
    /// processor's trap handler defines the places. The value is that of the program only while the
    /// program is held.
    ///
    /// # Errors
    /// [`TracerError::Access`] if the area cannot be accessed.
    pub fn register(&self, place: u32) -> Result<u64, TracerError> {
        Ok(self.area.register(place)?)
    }

    /// Sets the register at `place` in the frame, the saved registers of the program. The program
    /// has this value when it is resumed.
    ///
    /// # Errors
    /// [`TracerError::Access`] if the area cannot be accessed.
    pub fn set_register(&self, place: u32, value: u64) -> Result<(), TracerError> {
        Ok(self.area.set_register(place, value)?)
    }

    /// As [`command`](Self::command), with the change that was refused apart from other errors.
    fn made(&self, action: u32, changes: &[Entry]) -> Result<Result<(), TracerError>, TracerError> {
        self.command(action, changes)?;
        let result = self.area.word(area::RESULT)? as usize;
        let refused = result.checked_sub(1).and_then(|place| changes.get(place));
        Ok(refused.map_or(Ok(()), |change| {
            let address = change.address;
            Err(TracerError::Refused { address })
        }))
    }

    /// Sends a command, and waits until it is executed.
    fn command(&self, action: u32, changes: &[Entry]) -> Result<(), TracerError> {
        let done = || Ok(self.is_done()?.then_some(()));
        // That of whoever died.
        self.wait(done)?;
        self.give(action, changes)?;
        self.wait(done)
    }

    fn give(&self, action: u32, changes: &[Entry]) -> Result<(), TracerError> {
        let command = self.area.word(area::COMMAND)?;
        for (place, change) in (0..).zip(changes) {
            self.area.set_change(place, *change)?;
        }
        self.area.set(area::CHANGES, changes.len() as u32)?;
        self.area.set(area::ACTION, action)?;
        // Release: the stub that sees it sees the command.
        self.area.set(area::COMMAND, command.wrapping_add(1))?;
        (self.ring)();
        Ok(())
    }

    fn is_done(&self) -> Result<bool, TracerError> {
        Ok(self.area.word(area::DONE)? == self.area.word(area::COMMAND)?)
    }

    /// Waits until `look` finds something.
    fn wait<T>(&self, look: impl Fn() -> Result<Option<T>, TracerError>) -> Result<T, TracerError> {
        for _ in 0..LOOKS {
            if let Some(found) = look()? {
                return Ok(found);
            }
            core::hint::spin_loop();
        }
        let begun = Instant::now();
        let mut rung = begun;
        loop {
            if let Some(found) = look()? {
                return Ok(found);
            }
            if begun.elapsed() >= PATIENCE {
                return Err(TracerError::NoAnswer);
            }
            if rung.elapsed() >= RING_AGAIN {
                (self.ring)();
                rung = Instant::now();
            }
            std::thread::sleep(NAP);
        }
    }
}
