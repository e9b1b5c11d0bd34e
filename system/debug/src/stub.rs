//! [`Stub`]: the part of the debugger that runs on the processor.

use condor_mbox::{AccessError, MemoryWindow, Region};

use crate::arch::Arch;
use crate::area::{self, Area, Entry, HoldReason, Trigger};

/// The action that a trap handler must take after [`Stub::exception`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[must_use]
pub enum TrapOutcome {
    /// Restore all registers from the frame.
    Resume,
    /// Restore all registers from the frame, but go on behind the breakpoint instruction, which belongs to the program
    /// itself. If the debugger has changed the program counter, go on there.
    ResumeBehind,
    /// No debugger wants the program: it ends by the exception.
    Fatal,
}

/// The part of a debugger that runs on a processor, in its trap handler: it executes commands of
/// the host, and holds a stopped program.
#[derive(Clone, Debug)]
pub struct Stub<W> {
    area: Area<W>,
}

impl<W: MemoryWindow> Stub<W> {
    /// Makes the stub that uses the debug area `area`, of [`AREA_BYTES`](crate::AREA_BYTES) bytes.
    pub const fn new(area: Region<W>) -> Self {
        Self {
            area: Area::new(area),
        }
    }

    /// Forgets commands, breakpoints and triggers that are left from the previous program. Call it before each program
    /// starts.
    ///
    /// # Errors
    /// [`AccessError`] if the area cannot be accessed.
    pub fn begin(&self, arch: &impl Arch) -> Result<(), AccessError> {
        for place in 0..area::MOST_PLANTED {
            let Entry { address, words } = self.area.planted(place)?;
            if let Some(trigger) = Trigger::from_word(address, words[1]) {
                arch.disarm(trigger);
            }
            self.area.set_planted(place, Entry::default())?;
        }
        self.area.set(area::STATE, 0)?;
        self.area.set(area::DONE, self.area.word(area::COMMAND)?)
    }

    /// Reports to the host at which addresses the program cannot have breakpoints. Call it where the program begins. If
    /// it returns true, the program must be held before its first statement: execute a breakpoint instruction there.
    ///
    /// # Errors
    /// [`AccessError`] if the area cannot be accessed.
    pub fn start(&self, arch: &impl Arch) -> Result<bool, AccessError> {
        self.area.set_closed(&arch.closed())?;
        Ok(self.area.mode()?.hold_start)
    }

    /// Returns true if the debugger has sent a command that is not executed yet. Call it in the interrupt of a ring. If
    /// it returns true, save the program's registers in the frame and call [`obey`](Self::obey).
    ///
    /// # Errors
    /// [`AccessError`] if the area cannot be accessed.
    pub fn has_command(&self) -> Result<bool, AccessError> {
        Ok(self.area.word(area::COMMAND)? != self.area.word(area::DONE)?)
    }

    /// Executes the command that the debugger has sent, if there is one. Call it with the registers of the program in
    /// the frame and with interrupts masked. If the command stops the program, this method returns only when the
    /// debugger resumes the program.
    ///
    /// # Errors
    /// [`AccessError`] if the area cannot be accessed.
    pub fn obey(&self, arch: &impl Arch) -> Result<(), AccessError> {
        match self.execute(arch)? {
            Some(area::STOP) => self.hold(arch, HoldReason::Stopped),
            _ => Ok(()),
        }
    }

    /// Handles an exception of the program, whose registers must be in the frame. `breakpoint` is the address of the
    /// instruction if a breakpoint or a trigger has raised the exception; `None` if something else has. If a debugger
    /// holds the program, this method returns only when the debugger resumes the program.
    ///
    /// # Errors
    /// [`AccessError`] if the area cannot be accessed.
    pub fn exception(
        &self,
        arch: &impl Arch,
        breakpoint: Option<u64>,
    ) -> Result<TrapOutcome, AccessError> {
        // The table counts, not the instruction in memory: the trap entry may have lifted it.
        let is_planted = match breakpoint {
            Some(address) => self.find(address, area::INSTRUCTION)?.is_some(),
            None => false,
        };
        if breakpoint.is_some_and(|address| !is_planted && !arch.is_breakpoint(address)) {
            if self.is_triggered()? {
                self.hold(arch, HoldReason::Trigger)?;
            } else {
                // The breakpoint was removed after the processor had fetched it.
                arch.synchronize();
            }
            return Ok(TrapOutcome::Resume);
        }
        let mode = self.area.mode()?;
        // A breakpoint of a debugger that has gone waits for whoever releases the program.
        if !mode.attached && !mode.hold_exceptions && !is_planted {
            return Ok(TrapOutcome::Fatal);
        }
        let reason = match breakpoint {
            Some(_) => HoldReason::Breakpoint,
            None => HoldReason::Exception,
        };
        self.hold(arch, reason)?;
        Ok(if breakpoint.is_none() || is_planted {
            TrapOutcome::Resume
        } else {
            TrapOutcome::ResumeBehind
        })
    }

    /// Holds the program, whose registers are in the frame, until the debugger resumes it.
    fn hold(&self, arch: &impl Arch, reason: HoldReason) -> Result<(), AccessError> {
        let holds = self.area.word(area::HOLDS)?;
        self.area.set(area::REASON, reason.word())?;
        self.area.set(area::HOLDS, holds.wrapping_add(1))?;
        // Release: the host that sees it sees the frame.
        self.area.set(area::STATE, area::HELD)?;
        loop {
            match self.execute(arch)? {
                Some(area::RESUME | area::RELEASE) => return Ok(()),
                _ => arch.wait(),
            }
        }
    }

    /// Executes the debugger's command and returns its action; `None` if there is none.
    fn execute(&self, arch: &impl Arch) -> Result<Option<u32>, AccessError> {
        // Acquire, and so its words are those of the command or of a later one.
        let command = self.area.word(area::COMMAND)?;
        if command == self.area.word(area::DONE)? {
            return Ok(None);
        }
        let mut action = self.area.word(area::ACTION)?;
        let changes = self.area.word(area::CHANGES)?.min(area::MOST_CHANGES);
        let mut result = 0;
        for place in 0..changes {
            let change = self.area.change(place)?;
            let is_made = match change.words[0] {
                area::PLANT => self.plant(arch, change.address, change.words[1])?,
                area::REMOVE => self.remove(arch, change.address, change.words[1])?,
                _ => false,
            };
            if !is_made && result == 0 {
                result = place + 1;
            }
        }
        if action == area::RELEASE {
            for place in 0..area::MOST_PLANTED {
                self.remove_at(arch, place)?;
            }
        }
        if changes > 0 || action == area::RELEASE {
            arch.synchronize();
        }
        if action == area::RESUME && result != 0 {
            action = 0;
        }
        if matches!(action, area::RESUME | area::RELEASE) {
            self.area.set(area::STATE, 0)?;
        }
        self.area.set(area::RESULT, result)?;
        // Release: whoever sees it sees what was done.
        self.area.set(area::DONE, command)?;
        Ok(Some(action))
    }

    fn plant(&self, arch: &impl Arch, address: u64, what: u32) -> Result<bool, AccessError> {
        if self.find(address, what)?.is_some() {
            return Ok(true);
        }
        for place in 0..area::MOST_PLANTED {
            if self.area.planted(place)?.words[1] != 0 {
                continue;
            }
            if what != area::INSTRUCTION {
                let trigger = Trigger::from_word(address, what);
                let is_armed = trigger.is_some_and(|trigger| arch.arm(trigger));
                if is_armed {
                    let words = [0, what];
                    self.area.set_planted(place, Entry { address, words })?;
                }
                return Ok(is_armed);
            }
            let Some(original) = arch.original(address) else {
                return Ok(false);
            };
            // First the entry: from the next instruction on, this may come to the breakpoint itself.
            let words = [original, what];
            self.area.set_planted(place, Entry { address, words })?;
            arch.plant(address);
            return Ok(true);
        }
        Ok(false)
    }

    fn remove(&self, arch: &impl Arch, address: u64, what: u32) -> Result<bool, AccessError> {
        match self.find(address, what)? {
            Some(place) => self.remove_at(arch, place).map(|()| true),
            None => Ok(false),
        }
    }

    fn remove_at(&self, arch: &impl Arch, place: u32) -> Result<(), AccessError> {
        let Entry { address, words } = self.area.planted(place)?;
        match words[1] {
            0 => return Ok(()),
            area::INSTRUCTION => arch.restore(address, words[0]),
            what => {
                if let Some(trigger) = Trigger::from_word(address, what) {
                    arch.disarm(trigger);
                }
            }
        }
        self.area.set_planted(place, Entry::default())
    }

    fn find(&self, address: u64, what: u32) -> Result<Option<u32>, AccessError> {
        for place in 0..area::MOST_PLANTED {
            let planted = self.area.planted(place)?;
            if planted.words[1] == what && planted.address == address && what != 0 {
                return Ok(Some(place));
            }
        }
        Ok(None)
    }

    /// Whether a trigger may have made an exception.
    fn is_triggered(&self) -> Result<bool, AccessError> {
        for place in 0..area::MOST_PLANTED {
            if self.area.planted(place)?.words[1] > area::INSTRUCTION {
                return Ok(true);
            }
        }
        Ok(false)
    }
}
