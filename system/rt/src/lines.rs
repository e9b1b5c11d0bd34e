//! [`BoardLines`]: the interrupts of boards that are memory; [`Raiser`] raises them.
//!
//! Each processor has a word with a bit for each line. Whoever is the board sets the bit and rings the processor,
//! which takes the bit when it claims the interrupt. So a request is an edge: one that comes while the line is served
//! makes it pending once more.

use core::num::NonZeroU32;
use core::ops::Deref;
use core::sync::atomic::{AtomicU32, Ordering};

use condor_dev::{InterruptController, InterruptLevel, InterruptVector, Location};
use condor_mbox::layout::BOARD_LINES;
#[cfg(not(target_has_atomic = "32"))]
use condor_mbox::{CriticalSection, Exclusion as _};
use condor_mbox::{Doorbell, MemoryWindow, Processor};

use crate::error::ProgramError;
use crate::machine::Machine;
use crate::numbers::PROCESSORS;

/// The vector of the first line of boards that are memory. Lower ones are for the interrupt controllers of machines.
pub const FIRST_LINE: InterruptVector = InterruptVector(128);
/// The place of a processor's serial port on its bus, and its vector: a 16550 whose registers are one byte apart, for the
/// driver [`Uart16550`](condor_dev::drivers::Uart16550). Its clock has 1.8432 MHz: a divisor of 1 is 115 200 baud, which
/// is the fastest. A processor whose description names no serial port has no board there; neither has a hart in
/// simulated time. A process in simulated time has it, but what comes there comes in real time, so that runs differ.
///
/// The line is a terminal device of the host. A driver hears of no errors of its characters, no breaks and no modem
/// lines; and bytes that have left the board may still be in buffers of the host. If the device fails, accesses do.
pub const SERIAL: Location = Location::at(0x4000_0000).interrupting(SERIAL_VECTOR.0, 1);
/// The vector of a serial port, that of the last line: use that line for no other board.
pub const SERIAL_VECTOR: InterruptVector = InterruptVector(FIRST_LINE.0 + 31);
/// The reason why a second entry is refused.
pub(crate) const SERVED_TWICE: ProgramError = ProgramError::Twice {
    what: "entry of interrupts",
};

/// The number of levels, as many as those of a VME bus.
const LEVELS: usize = 7;

/// The word of a processor's lines, in its `data`; `None` if the memory cannot be accessed by plain words.
#[inline]
fn raised<W: MemoryWindow>(data: &W) -> Option<&AtomicU32> {
    data.words()?.get().get((BOARD_LINES / 4) as usize)
}

/// Sets bits of a word, and returns what the word was; what was written before is seen by who clears them.
#[inline]
fn set(word: &AtomicU32, bits: u32) -> u32 {
    #[cfg(target_has_atomic = "32")]
    return word.fetch_or(bits, Ordering::AcqRel);
    // Such processors share no memory in which another one raises interrupts.
    #[cfg(not(target_has_atomic = "32"))]
    return alone(word, |before| before | bits);
}

/// Clears bits of a word, and returns what the word was; what was written before they were set is seen.
#[inline]
fn clear(word: &AtomicU32, bits: u32) -> u32 {
    #[cfg(target_has_atomic = "32")]
    return word.fetch_and(!bits, Ordering::AcqRel);
    #[cfg(not(target_has_atomic = "32"))]
    return alone(word, |before| before & !bits);
}

#[cfg(not(target_has_atomic = "32"))]
fn alone(word: &AtomicU32, change: impl FnOnce(u32) -> u32) -> u32 {
    CriticalSection.with(|| {
        let before = word.load(Ordering::Acquire);
        word.store(change(before), Ordering::Release);
        before
    })
}

/// The bit of a vector; `None` if no line has it.
fn bit(vector: InterruptVector) -> Option<u32> {
    1_u32.checked_shl(vector.0.checked_sub(FIRST_LINE.0)?.into())
}

/// The levels of a processor's lines, and which of them are being served, for [`BoardLines`].
#[derive(Debug)]
pub struct LineState {
    /// The lines that each level enables, from level 1 on, and those that any does.
    levels: [AtomicU32; LEVELS],
    enabled: AtomicU32,
    /// The lines that are claimed and not completed.
    claimed: AtomicU32,
    /// Not 0 while an entry serves them.
    served: AtomicU32,
}

impl LineState {
    /// Makes the state of lines that are all enabled at level 1: a board that interrupts without a driver is counted
    /// and named.
    #[must_use]
    pub const fn new() -> Self {
        let mut levels = [const { AtomicU32::new(0) }; LEVELS];
        levels[0] = AtomicU32::new(u32::MAX);
        Self {
            levels,
            enabled: AtomicU32::new(u32::MAX),
            claimed: AtomicU32::new(0),
            served: AtomicU32::new(0),
        }
    }

    /// Returns the bit of the most urgent one of some lines, the first of those of its level; `None` if none of them
    /// has a level.
    fn most_urgent(&self, lines: NonZeroU32) -> Option<NonZeroU32> {
        let mut levels = self.levels.iter().rev();
        levels.find_map(|level| {
            let urgent = lines.get() & level.load(Ordering::Relaxed);
            NonZeroU32::new(urgent & urgent.wrapping_neg())
        })
    }
}

impl Default for LineState {
    fn default() -> Self {
        Self::new()
    }
}

/// The [`InterruptController`] of boards that are memory, such as those of a simulated robot: vectors 128 to 159, and
/// levels 1 to 7; a level above 7 is 7.
///
/// `W` is the window of the processor's `data`, `D` its doorbell, and `S` leads to the [`LineState`] of the processor.
/// Its requests are edges.
#[derive(Clone, Copy, Debug)]
pub struct BoardLines<W, D, S> {
    number: Processor,
    data: W,
    bell: D,
    state: S,
}

impl<W, D, S> BoardLines<W, D, S>
where
    W: MemoryWindow,
    S: Deref<Target = LineState>,
{
    /// Makes the controller of processor `number`, whose `data` and doorbell these are.
    pub const fn new(number: Processor, data: W, bell: D, state: S) -> Self {
        Self {
            number,
            data,
            bell,
            state,
        }
    }

    /// Runs `background`, while an entry serves the lines.
    ///
    /// # Errors
    /// [`ProgramError::Twice`] if one does already; `background` has not run then.
    pub fn serving<R>(&self, background: impl FnOnce() -> R) -> Result<R, ProgramError> {
        let served = &self.state.served;
        if set(served, 1) != 0 {
            return Err(SERVED_TWICE);
        }
        let _served = Served(served);
        Ok(background())
    }

    /// Forgets all requests, such as those to a program that has ended.
    pub fn clear(&self) {
        if let Some(raised) = raised(&self.data) {
            raised.store(0, Ordering::Relaxed);
        }
    }

    /// Requests an interrupt of this processor itself by `vector`, or withdraws the request, for a board that asks until
    /// it is served. A request ends when the interrupt is claimed: call this again after each
    /// [`complete`](InterruptController::complete) while the board asks.
    pub fn set_level(&self, vector: InterruptVector, asks: bool)
    where
        D: Doorbell,
    {
        let (Some(raised), Some(bit)) = (raised(&self.data), bit(vector)) else {
            return;
        };
        if asks {
            set(raised, bit);
            self.bell.ring(self.number);
        } else {
            clear(raised, bit);
        }
    }

    /// Returns true if [`claim`](InterruptController::claim) would return a vector.
    #[inline]
    #[must_use]
    pub fn is_pending(&self) -> bool {
        raised(&self.data).is_some_and(|raised| self.pending(raised) != 0)
    }

    #[inline]
    fn pending(&self, raised: &AtomicU32) -> u32 {
        let (enabled, claimed) = (&self.state.enabled, &self.state.claimed);
        let [raised, enabled, claimed] =
            [raised, enabled, claimed].map(|word| word.load(Ordering::Relaxed));
        raised & enabled & !claimed
    }
}

/// Ends the service, also when the background unwinds.
struct Served<'s>(&'s AtomicU32);

impl Drop for Served<'_> {
    fn drop(&mut self) {
        clear(self.0, 1);
    }
}

impl<W, D, S> InterruptController for BoardLines<W, D, S>
where
    W: MemoryWindow,
    D: Doorbell,
    S: Deref<Target = LineState>,
{
    fn enable(&self, vector: InterruptVector, level: InterruptLevel) {
        let Some(bit) = bit(vector) else { return };
        let wanted = usize::from(level.0).min(LEVELS);
        for (level, lines) in (1..).zip(&self.state.levels) {
            if level == wanted {
                set(lines, bit);
            } else {
                clear(lines, bit);
            }
        }
        if wanted == 0 {
            clear(&self.state.enabled, bit);
            return;
        }
        set(&self.state.enabled, bit);
        // A ring from before was in vain.
        if self.is_pending() {
            self.bell.ring(self.number);
        }
    }

    fn disable(&self, vector: InterruptVector) {
        self.enable(vector, InterruptLevel(0));
    }

    #[inline]
    fn claim(&self) -> Option<InterruptVector> {
        let raised = raised(&self.data)?;
        let line = match NonZeroU32::new(self.pending(raised))? {
            only if only.is_power_of_two() => only,
            several => self.state.most_urgent(several)?,
        };
        let (bit, claimed) = (line.get(), &self.state.claimed);
        // Another context that claims at the same time looks again when it has served.
        if set(claimed, bit) & bit != 0 {
            return None;
        }
        // Pairs with `raise`, so that a driver sees the board as it was then.
        if clear(raised, bit) & bit == 0 {
            clear(claimed, bit);
            return None;
        }
        Some(InterruptVector(FIRST_LINE.0 + line.trailing_zeros() as u16))
    }

    #[inline]
    fn complete(&self, vector: InterruptVector) {
        if let Some(bit) = bit(vector) {
            clear(&self.state.claimed, bit);
        }
    }
}

/// Raises the interrupts of boards that are memory, for whoever simulates them.
#[derive(Debug)]
pub struct Raiser<M: Machine> {
    data: [M::Window; PROCESSORS],
    bell: M::Doorbell,
}

impl<M: Machine> Raiser<M> {
    /// Makes the raiser of a processor that simulates boards.
    #[must_use]
    pub fn new(machine: &M) -> Self {
        Self {
            data: machine.windows().map(|windows| windows.data),
            bell: machine.doorbell(),
        }
    }

    /// Requests an interrupt of a processor by a vector from 128 to 159, of which 159 is for [serial ports](SERIAL).
    /// What was written before is seen by the driver that serves it. Does nothing if there is no such processor or vector.
    pub fn raise(&self, processor: Processor, vector: InterruptVector) {
        let raised = self.data.get(processor.index()).and_then(raised);
        let (Some(raised), Some(bit)) = (raised, bit(vector)) else {
            return;
        };
        // Pairs with `claim`. It may be raised already by one that has died before it rang.
        set(raised, bit);
        self.bell.ring(processor);
    }
}
