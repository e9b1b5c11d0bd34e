//! A processor that is simulated: a program of words that counts, and an interrupt for rings.

use core::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Condvar, Mutex, PoisonError};

use condor_mbox::sim::SimWindow;
use condor_mbox::{AccessError, Region};

use crate::area::Area;
use crate::{AREA_BYTES, Arch, Stub, TrapOutcome, Trigger, TriggerAccess};

/// The instruction that adds 1 to the counter of a [`SimProcessor`]. Each instruction takes one
/// word; a word that is not an instruction raises an exception.
pub const COUNT: u32 = 1;
/// The instruction that continues at address 0.
pub const JUMP: u32 = 2;
/// The breakpoint instruction of a [`SimProcessor`].
pub const BREAKPOINT: u32 = 3;
/// The instruction that stores the counter, in 32 bits, into the word behind the instruction, and
/// continues behind that word.
pub const STORE: u32 = 4;

/// The place of the program counter in the frame, the saved registers of a stopped program.
pub const PC: u32 = 0;
/// The place of the counter in the frame, the saved registers of a stopped program.
pub const COUNTER: u32 = 1;

const INSTRUCTION_BYTES: u64 = 4;

/// A simulated processor for tests of debuggers. It has a debug area, and a memory that begins at address 0 and
/// contains its program.
pub struct SimProcessor {
    area: Region<SimWindow>,
    memory: Region<SimWindow>,
    rung: Mutex<bool>,
    rings: Condvar,
    ends: AtomicBool,
    /// The only trigger that it has room for.
    trigger: Mutex<Option<Trigger>>,
}

impl core::fmt::Debug for SimProcessor {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("SimProcessor").finish_non_exhaustive()
    }
}

impl SimProcessor {
    /// Makes a processor whose memory has the words `program`: instructions, such as [`COUNT`], and
    /// data.
    ///
    /// # Errors
    /// [`AccessError`] if the program does not fit into a window.
    pub fn new(program: &[u32]) -> Result<Self, AccessError> {
        let memory = Region::whole(SimWindow::new(4 * program.len() as u32));
        for (place, word) in (0..).zip(program) {
            memory.set_word(4 * place, *word)?;
        }
        let area = Region::whole(SimWindow::new(AREA_BYTES));
        let processor = Self {
            area,
            memory,
            rung: Mutex::new(false),
            rings: Condvar::new(),
            ends: AtomicBool::new(false),
            trigger: Mutex::new(None),
        };
        let stub = Stub::new(processor.area.clone());
        stub.begin(&processor)?;
        // Its debugger comes later.
        let _ = stub.start(&processor)?;
        Ok(processor)
    }

    /// Returns the debug area, through which a debugger sends commands to this processor.
    #[must_use]
    pub const fn area(&self) -> &Region<SimWindow> {
        &self.area
    }

    /// Returns the memory of the processor, which contains its program.
    #[must_use]
    pub const fn memory(&self) -> &Region<SimWindow> {
        &self.memory
    }

    /// Raises the interrupt by which a debugger announces a command.
    pub fn ring(&self) {
        *self.rung.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.rings.notify_all();
    }

    /// Makes [`run`](Self::run) return. If the program is held, `run` returns only after a debugger
    /// has resumed it.
    pub fn end(&self) {
        self.ends.store(true, Ordering::Relaxed);
        self.ring();
    }

    /// Runs the program until [`end`](Self::end) is called, or until an exception for which no debugger holds the
    /// program. Returns the value of the counter.
    ///
    /// # Errors
    /// [`AccessError`] if the debug area cannot be accessed.
    pub fn run(&self) -> Result<u64, AccessError> {
        let stub = Stub::new(self.area.clone());
        let (mut pc, mut counter) = (0, 0_u64);
        while !self.ends.load(Ordering::Relaxed) {
            if self.take_ring() && stub.has_command()? {
                self.save(pc, counter)?;
                stub.obey(self)?;
                (pc, counter) = self.saved()?;
            }
            match self.instruction(pc) {
                Some(COUNT) => {
                    counter = counter.wrapping_add(1);
                    pc += INSTRUCTION_BYTES;
                }
                Some(JUMP) => pc = 0,
                Some(STORE) if !self.triggers(pc + INSTRUCTION_BYTES) => {
                    let place = u32::try_from(pc + INSTRUCTION_BYTES).unwrap_or(u32::MAX);
                    // Behind the memory is nothing to store into.
                    let _ = self.memory.set_word(place, counter as u32);
                    pc += 2 * INSTRUCTION_BYTES;
                }
                other => {
                    self.save(pc, counter)?;
                    let breakpoint = matches!(other, Some(BREAKPOINT | STORE)).then_some(pc);
                    let outcome = stub.exception(self, breakpoint)?;
                    if outcome == TrapOutcome::Fatal {
                        return Ok(counter);
                    }
                    let before = pc;
                    (pc, counter) = self.saved()?;
                    if outcome == TrapOutcome::ResumeBehind && pc == before {
                        pc = pc.wrapping_add(INSTRUCTION_BYTES);
                    }
                }
            }
        }
        Ok(counter)
    }

    fn take_ring(&self) -> bool {
        let mut rung = self.rung.lock().unwrap_or_else(PoisonError::into_inner);
        core::mem::take(&mut *rung)
    }

    fn instruction(&self, address: u64) -> Option<u32> {
        let address = u32::try_from(address).ok()?;
        self.memory.word(address).ok()
    }

    /// Whether a store of a word at `address` is to stop the program.
    fn triggers(&self, address: u64) -> bool {
        let trigger = *self.trigger.lock().unwrap_or_else(PoisonError::into_inner);
        trigger.is_some_and(|it| {
            let word = address..address.saturating_add(INSTRUCTION_BYTES);
            matches!(it.access, TriggerAccess::Write | TriggerAccess::ReadWrite)
                && word.contains(&it.address)
        })
    }

    fn frame(&self) -> Area<SimWindow> {
        Area::new(self.area.clone())
    }

    fn save(&self, pc: u64, counter: u64) -> Result<(), AccessError> {
        self.frame().set_register(PC, pc)?;
        self.frame().set_register(COUNTER, counter)
    }

    fn saved(&self) -> Result<(u64, u64), AccessError> {
        let frame = self.frame();
        Ok((frame.register(PC)?, frame.register(COUNTER)?))
    }
}

impl Arch for SimProcessor {
    fn closed(&self) -> Range<u64> {
        0..0
    }

    fn original(&self, address: u64) -> Option<u32> {
        self.instruction(address)
    }

    fn plant(&self, address: u64) {
        self.restore(address, BREAKPOINT);
    }

    fn restore(&self, address: u64, original: u32) {
        if let Ok(address) = u32::try_from(address) {
            // Outside of the memory is nothing to store.
            let _ = self.memory.set_word(address, original);
        }
    }

    fn is_breakpoint(&self, address: u64) -> bool {
        self.instruction(address) == Some(BREAKPOINT)
    }

    fn arm(&self, trigger: Trigger) -> bool {
        let mut armed = self.trigger.lock().unwrap_or_else(PoisonError::into_inner);
        let is_free = armed.is_none() && trigger.access != TriggerAccess::Execute;
        if is_free {
            *armed = Some(trigger);
        }
        is_free
    }

    fn disarm(&self, trigger: Trigger) {
        let mut armed = self.trigger.lock().unwrap_or_else(PoisonError::into_inner);
        armed.take_if(|it| *it == trigger);
    }

    fn synchronize(&self) {}

    fn wait(&self) {
        let rung = self.rung.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = self.rings.wait_while(rung, |rung| !*rung);
        *waited.unwrap_or_else(PoisonError::into_inner) = false;
    }
}
