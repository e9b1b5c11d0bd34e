//! [`Plic`]: the platform-level interrupt controller.

use crate::bus::{Bus, Registers};
use crate::interrupt::{InterruptController, InterruptLevel, InterruptVector};

const PRIORITY: usize = 0;
const ENABLE: usize = 0x2000;
const ENABLE_STRIDE: usize = 0x80;
const CONTEXT: usize = 0x20_0000;
const CONTEXT_STRIDE: usize = 0x1000;
const THRESHOLD: usize = 0;
const CLAIM: usize = 4;

/// Sources that a PLIC can have, the number 0 included, which is none.
const MOST_SOURCES: u16 = 1024;
/// Contexts for which there are registers.
const MOST_CONTEXTS: u16 = 15_872;

/// The number of a target of a PLIC's interrupts, which is usually a hart (a RISC-V hardware
/// thread) in one of its privilege modes. The machine's device tree lists the numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Context(u16);

impl Context {
    /// Makes a context from its number; returns `None` if `number` is 15 872 or more, since no PLIC
    /// has so many.
    #[must_use]
    pub const fn new(number: u16) -> Option<Self> {
        if number < MOST_CONTEXTS {
            Some(Self(number))
        } else {
            None
        }
    }
}

/// The [`InterruptController`] of RISC-V machines, the PLIC, for one of its contexts. Its sources
/// are the vectors, and its priorities are the levels.
///
/// A level above the highest priority is the highest. Priorities belong to a source, not to a
/// context: if two contexts enable the same source, the later one changes its level for both.
///
/// If the bus does not answer, the PLIC behaves as if it had no interrupt.
///
/// Source: RISC-V Platform-Level Interrupt Controller Specification 1.0.0.
#[derive(Clone, Copy, Debug)]
pub struct Plic<B> {
    bus: B,
    base: usize,
    context: Context,
    sources: u16,
    highest: InterruptLevel,
}

impl<B: Bus> Plic<B> {
    /// Makes a driver of the PLIC at the address `base` of `bus`, for the context `context`. The
    /// PLIC has sources 1 to `sources`, at most 1023, and priorities up to `highest`.
    ///
    /// Each hart must use a context of its own, because the registers of a context are changed in
    /// critical sections, which protect against interrupts of that hart only.
    #[must_use]
    pub const fn new(
        bus: B,
        base: usize,
        context: Context,
        sources: u16,
        highest: InterruptLevel,
    ) -> Self {
        let sources = if sources < MOST_SOURCES {
            sources
        } else {
            MOST_SOURCES - 1
        };
        Self {
            bus,
            base,
            context,
            sources,
            highest,
        }
    }

    /// Completes and disables the sources that the context has enabled, and sets its threshold to 0. Call it
    /// at start-up, since an earlier program may have left sources enabled, or in service.
    ///
    /// # Errors
    /// Returns the bus's error if an access fails.
    pub fn reset(&self) -> Result<(), B::Error> {
        self.set_threshold(self.highest)?;
        for word in 0..=self.sources / 32 {
            let at = self.enable_word(word.into());
            let enabled = self.registers().read32(at)?;
            for source in (0..32).filter(|bit| enabled >> bit & 1 != 0) {
                let complete = self.of_context(CLAIM);
                let source = u32::from(32 * word) + source;
                self.registers().write32(complete, source)?;
            }
            self.registers().write32(at, 0)?;
        }
        self.set_threshold(InterruptLevel(0))
    }

    /// Sets the threshold of the context: only vectors of a higher level than `level` interrupt.
    ///
    /// # Errors
    /// Returns the bus's error if an access fails.
    pub fn set_threshold(&self, level: InterruptLevel) -> Result<(), B::Error> {
        let level = level.min(self.highest);
        self.registers()
            .write32(self.of_context(THRESHOLD), level.0.into())
    }

    fn registers(&self) -> Registers<'_, B> {
        Registers::new(&self.bus, self.base)
    }

    fn enable_word(&self, word: usize) -> usize {
        ENABLE + ENABLE_STRIDE * usize::from(self.context.0) + 4 * word
    }

    fn of_context(&self, register: usize) -> usize {
        CONTEXT + CONTEXT_STRIDE * usize::from(self.context.0) + register
    }

    fn is_source(&self, vector: InterruptVector) -> bool {
        (1..=self.sources).contains(&vector.0)
    }

    /// Enables or disables, in a critical section; says whether it was enabled.
    fn switch(&self, vector: InterruptVector, on: bool) -> Result<bool, B::Error> {
        let word = self.enable_word(usize::from(vector.0 / 32));
        let bit = 1_u32 << (vector.0 % 32);
        let before = self.registers().read32(word)?;
        let after = if on { before | bit } else { before & !bit };
        if after != before {
            self.registers().write32(word, after)?;
        }
        Ok(before & bit != 0)
    }

    fn try_complete(&self, vector: InterruptVector) -> Result<(), B::Error> {
        // The PLIC ignores the completion of a source that is not enabled, and would never
        // let it interrupt again.
        let enabled = self.switch(vector, true)?;
        let completed = self
            .registers()
            .write32(self.of_context(CLAIM), vector.0.into());
        if !enabled {
            self.switch(vector, false)?;
        }
        completed
    }
}

impl<B: Bus> InterruptController for Plic<B> {
    fn enable(&self, vector: InterruptVector, level: InterruptLevel) {
        if !self.is_source(vector) {
            return;
        }
        let level = level.min(self.highest);
        let priority = PRIORITY + 4 * usize::from(vector.0);
        critical_section::with(|_| {
            // A PLIC that does not answer has no interrupts to let through.
            let _ = self.registers().write32(priority, level.0.into());
            let _ = self.switch(vector, true);
        });
    }

    fn disable(&self, vector: InterruptVector) {
        if self.is_source(vector) {
            // A PLIC that does not answer has no interrupts to stop.
            let _ = critical_section::with(|_| self.switch(vector, false));
        }
    }

    fn claim(&self) -> Option<InterruptVector> {
        let claimed = self.registers().read32(self.of_context(CLAIM)).ok()?;
        u16::try_from(claimed)
            .ok()
            .filter(|&source| source != 0)
            .map(InterruptVector)
    }

    fn complete(&self, vector: InterruptVector) {
        if self.is_source(vector) {
            // A PLIC that does not answer has nothing to complete.
            let _ = critical_section::with(|_| self.try_complete(vector));
        }
    }
}
