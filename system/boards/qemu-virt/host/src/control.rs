//! [`Control`]: what the host wants of a hart, and how the hart is.

use condor_clock::LOOPS;
use condor_mbox::{AccessError, MemoryWindow, Region};

use super::map::{BOARD, Map, PAGE};

/// The greatest total size of the arguments of a hart's program, in bytes, including a zero byte
/// after each argument.
pub const ARGUMENT_BYTES: usize = 512;

/// The greatest size of the error text that a hart's program leaves for the host, in bytes.
pub const ERROR_BYTES: usize = 240;

/// Written by the host.
mod host {
    pub(super) const WANTED: u32 = 0;
    pub(super) const ASKED: u32 = 4;
    pub(super) const ABANDONED: u32 = 8;
    pub(super) const ENTRY: u32 = 12;
    pub(super) const LEN: u32 = 16;
    pub(super) const ARGUMENTS: u32 = 20;
    pub(super) const SIMULATED: u32 = 532;
    /// Two words for each loop, the lower one first.
    pub(super) const WORK: u32 = 536;
    pub(super) const FLOATS: u32 = 600;
}

/// Written by the hart.
mod hart {
    pub(super) const STATE: u32 = 1024;
    pub(super) const START: u32 = 1028;
    pub(super) const STATUS: u32 = 1032;
    pub(super) const FAULT: u32 = 1040;
    pub(super) const ERROR_LEN: u32 = 1320;
    pub(super) const ERROR: u32 = 1324;
}

const WAITS: u32 = 1;
const RUNS: u32 = 2;
const ENDED: u32 = 3;
const ABANDONED: u32 = 4;
const FAULTED: u32 = 5;

/// The state of a hart, as its [`Control`] page shows it. A *start* is the number of a start of a
/// program on the hart, counted from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HartState {
    /// The hart has not reached the monitor, its first program, since the machine was switched on.
    Off,
    /// The hart is in the monitor, the program that waits for orders of the host, and has run no
    /// other program.
    Waits,
    /// The hart runs a program.
    Runs {
        /// The number of the start.
        start: u32,
    },
    /// The program has ended by itself; the hart is in the monitor again.
    Ended {
        /// The number of the start.
        start: u32,
        /// The status that the program returned; 0 is success.
        status: u32,
    },
    /// The host took the program off the hart, which is in the monitor again.
    Abandoned {
        /// The number of the start.
        start: u32,
    },
    /// The program made a trap that it does not handle, which [`Control::fault`] returns; the hart
    /// is in the monitor again.
    Faulted {
        /// The number of the start.
        start: u32,
    },
}

/// The host's order to start a program on a hart, for [`Control::order`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StartOrder<'a> {
    /// The place of the program's first instruction, in bytes from the beginning of the memory.
    pub entry: u32,
    /// The arguments, each with a zero after it: at most [`ARGUMENT_BYTES`] bytes.
    pub arguments: &'a [u8],
    /// The simulated duration of one run of each loop of the program, in nanoseconds, the fastest
    /// loop first; `None` if the program runs by the real clock.
    pub simulated: Option<[u64; LOOPS]>,
    /// Whether a floating-point exception in a loop of the program ends the
    /// program.
    pub float_exceptions: bool,
}

/// The registers of a hart when its program caused a trap that it does not handle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HartFault {
    /// `mcause`: the cause of the trap.
    pub cause: u64,
    /// `mepc`: the address of the instruction.
    pub pc: u64,
    /// `mtval`: the address that could not be accessed, or the instruction.
    pub value: u64,
    /// `mstatus`: the state of the hart.
    pub status: u64,
    /// The registers `x1` to `x31`.
    pub registers: [u64; 31],
}

impl HartFault {
    /// Returns the meaning of the cause in words, such as "load access fault".
    #[must_use]
    pub const fn name(&self) -> &'static str {
        cause_name(self.cause)
    }
}

/// Returns the meaning of `cause`, a value of the register `mcause`, in words such as "load access
/// fault"; "unknown trap" for other values.
///
/// Source: RISC-V Privileged Architecture 1.12, table 3.6.
#[must_use]
pub const fn cause_name(cause: u64) -> &'static str {
    match cause {
        0 => "instruction address misaligned",
        1 => "instruction access fault",
        2 => "illegal instruction",
        3 => "breakpoint",
        4 => "load address misaligned",
        5 => "load access fault",
        6 => "store address misaligned",
        7 => "store access fault",
        8..=11 => "environment call",
        12 => "instruction page fault",
        13 => "load page fault",
        15 => "store page fault",
        _ => "unknown trap",
    }
}

/// The page of shared memory by which the host controls a hart: the host writes its orders there,
/// and the hart its state. Both use this type.
#[derive(Clone, Debug)]
pub struct Control<W> {
    page: Region<W>,
}

impl<W: MemoryWindow + Clone> Control<W> {
    /// Makes the control of the hart with index `hart`, counted from 0. `memory` is the whole
    /// memory of the machine.
    ///
    /// # Errors
    /// [`AccessError`] if the memory is too small.
    pub fn new(memory: &Region<W>, hart: u32) -> Result<Self, AccessError> {
        let page = memory.part(Map::control(hart), PAGE)?;
        Ok(Self { page })
    }

    /// Returns the debug area of the hart: the memory for the registers of a stopped program, and
    /// for the words by which a debugger controls it (see [`condor_debug`]).
    ///
    /// # Errors
    /// [`AccessError`] if the memory is too small.
    pub fn debug_area(&self) -> Result<Region<W>, AccessError> {
        self.page.part(BOARD, condor_debug::AREA_BYTES)
    }

    /// Returns the state of the hart: whether it runs a program, or how its last program ended.
    ///
    /// # Errors
    /// [`AccessError`] if the memory cannot be accessed.
    pub fn state(&self) -> Result<HartState, AccessError> {
        let state = self.page.word(hart::STATE)?;
        let start = self.page.word(hart::START)?;
        Ok(match state {
            WAITS => HartState::Waits,
            RUNS => HartState::Runs { start },
            ENDED => HartState::Ended {
                start,
                status: self.page.word(hart::STATUS)?,
            },
            ABANDONED => HartState::Abandoned { start },
            FAULTED => HartState::Faulted { start },
            _ => HartState::Off,
        })
    }

    /// Requests the start of the program that the host has put into the hart's memory, and returns
    /// the number of the start. The host calls this while the hart is in the monitor, and must ring
    /// the hart's doorbell afterwards.
    ///
    /// Arguments that are too long are cut off at [`ARGUMENT_BYTES`].
    ///
    /// # Errors
    /// [`AccessError`] if the memory cannot be accessed.
    pub fn order(&self, order: StartOrder<'_>) -> Result<u32, AccessError> {
        let arguments = order.arguments;
        let arguments = arguments.split_at(arguments.len().min(ARGUMENT_BYTES)).0;
        self.page.set_word(host::ENTRY, order.entry)?;
        self.page.set_word(host::LEN, arguments.len() as u32)?;
        self.page.write(host::ARGUMENTS, arguments)?;
        let simulated = order.simulated;
        self.page
            .set_word(host::SIMULATED, simulated.is_some().into())?;
        self.set_doubles(host::WORK, simulated.into_iter().flatten())?;
        self.page
            .set_word(host::FLOATS, order.float_exceptions.into())?;
        // A start that was ordered before and never made had this number, too.
        self.page.set_word(host::ASKED, 0)?;
        self.page.set_word(host::ABANDONED, 0)?;
        let start = self.page.word(hart::START)?.wrapping_add(1).max(1);
        self.page.set_word(host::WANTED, start)?;
        Ok(start)
    }

    /// Asks the program with the start number `start` to end:
    /// [`is_asked_to_end`](Self::is_asked_to_end) then returns true on the hart. The host calls
    /// this.
    ///
    /// # Errors
    /// [`AccessError`] if the memory cannot be accessed.
    pub fn ask_to_end(&self, start: u32) -> Result<(), AccessError> {
        self.page.set_word(host::ASKED, start)
    }

    /// Takes the hart away from the program with the start number `start`, whatever the program
    /// does, unless it masks interrupts; the hart goes back to the monitor. The host calls this,
    /// and must ring the hart's doorbell afterwards.
    ///
    /// # Errors
    /// [`AccessError`] if the memory cannot be accessed.
    pub fn abandon(&self, start: u32) -> Result<(), AccessError> {
        self.page.set_word(host::ABANDONED, start)
    }

    /// Returns the trap that ended the last program. The host calls this if the
    /// [`state`](Self::state) is [`Faulted`](HartState::Faulted).
    ///
    /// # Errors
    /// [`AccessError`] if the memory cannot be accessed.
    pub fn fault(&self) -> Result<HartFault, AccessError> {
        let double = |place: u32| self.double(hart::FAULT + 8 * place);
        let mut fault = HartFault {
            cause: double(0)?,
            pc: double(1)?,
            value: double(2)?,
            status: double(3)?,
            registers: [0; 31],
        };
        for (place, register) in (4..).zip(&mut fault.registers) {
            *register = double(place)?;
        }
        Ok(fault)
    }

    /// Copies the error text that the program left into the beginning of `into`, and returns the
    /// length of the text in bytes; 0 if there is none. The host calls this.
    ///
    /// # Errors
    /// [`AccessError`] if the memory cannot be accessed.
    pub fn error(&self, into: &mut [u8; ERROR_BYTES]) -> Result<usize, AccessError> {
        let len = self.page.word(hart::ERROR_LEN)? as usize;
        let len = len.min(ERROR_BYTES);
        self.page.read(hart::ERROR, into.split_at_mut(len).0)?;
        Ok(len)
    }

    /// Sets the state to [`Waits`](HartState::Waits) if it is [`Off`](HartState::Off). Other states
    /// stay, because they tell how the last program ended. The monitor calls this when it begins.
    ///
    /// # Errors
    /// [`AccessError`] if the memory cannot be accessed.
    pub fn wait(&self) -> Result<(), AccessError> {
        match self.state()? {
            HartState::Off => self.page.set_word(hart::STATE, WAITS),
            _ => Ok(()),
        }
    }

    /// Returns the start that the host has [ordered](Self::order) and that has not been made yet:
    /// its number, and the place of the program's first instruction in bytes from the beginning of
    /// the memory. Returns `None` if there is no such order. The monitor calls this.
    ///
    /// # Errors
    /// [`AccessError`] if the memory cannot be accessed.
    pub fn wanted(&self) -> Result<Option<(u32, u32)>, AccessError> {
        let wanted = self.page.word(host::WANTED)?;
        if wanted == self.page.word(hart::START)? {
            return Ok(None);
        }
        Ok(Some((wanted, self.page.word(host::ENTRY)?)))
    }

    /// Sets the state to [`Runs`](HartState::Runs) with the start number `start`, and clears the
    /// error text. The monitor calls this before it starts the program.
    ///
    /// # Errors
    /// [`AccessError`] if the memory cannot be accessed.
    pub fn begin(&self, start: u32) -> Result<(), AccessError> {
        self.page.set_word(hart::ERROR_LEN, 0)?;
        self.page.set_word(hart::START, start)?;
        self.page.set_word(hart::STATE, RUNS)
    }

    /// Copies the arguments of the program, each with a zero byte after it, into the beginning of
    /// `into`. Returns the total length in bytes, including the zeros.
    ///
    /// # Errors
    /// [`AccessError`] if the memory cannot be accessed.
    pub fn arguments(&self, into: &mut [u8; ARGUMENT_BYTES]) -> Result<usize, AccessError> {
        let len = self.page.word(host::LEN)? as usize;
        let len = len.min(ARGUMENT_BYTES);
        self.page.read(host::ARGUMENTS, into.split_at_mut(len).0)?;
        Ok(len)
    }

    /// Returns the simulated duration of one run of each loop of the program, in nanoseconds, the
    /// fastest loop first; `None` if the program runs by the real clock. The program calls this.
    ///
    /// # Errors
    /// [`AccessError`] if the memory cannot be accessed.
    pub fn simulated(&self) -> Result<Option<[u64; LOOPS]>, AccessError> {
        if self.page.word(host::SIMULATED)? == 0 {
            return Ok(None);
        }
        let mut work = [0; LOOPS];
        for (place, work) in (0..).zip(&mut work) {
            *work = self.double(host::WORK + 8 * place)?;
        }
        Ok(Some(work))
    }

    /// Returns true if a floating-point exception in a loop of the program ends the
    /// program. The program calls this.
    ///
    /// # Errors
    /// [`AccessError`] if the memory cannot be accessed.
    pub fn float_exceptions(&self) -> Result<bool, AccessError> {
        Ok(self.page.word(host::FLOATS)? != 0)
    }

    /// Returns true if the host has [asked](Self::ask_to_end) the present program to end. The
    /// program calls this.
    ///
    /// # Errors
    /// [`AccessError`] if the memory cannot be accessed.
    pub fn is_asked_to_end(&self) -> Result<bool, AccessError> {
        Ok(self.page.word(host::ASKED)? == self.page.word(hart::START)?)
    }

    /// Returns true if the host has [abandoned](Self::abandon) the present program. The hart calls
    /// this when it is rung.
    ///
    /// # Errors
    /// [`AccessError`] if the memory cannot be accessed.
    pub fn is_abandoned(&self) -> Result<bool, AccessError> {
        Ok(self.page.word(host::ABANDONED)? == self.page.word(hart::START)?)
    }

    /// Stores the text of the error with which the program fails. The program calls this before
    /// [`end`](Self::end).
    ///
    /// A text that is too long is cut off at [`ERROR_BYTES`].
    ///
    /// # Errors
    /// [`AccessError`] if the memory cannot be accessed.
    pub fn set_error(&self, error: &str) -> Result<(), AccessError> {
        let error = error.as_bytes();
        let error = error.split_at(error.len().min(ERROR_BYTES)).0;
        self.page.write(hart::ERROR, error)?;
        self.page.set_word(hart::ERROR_LEN, error.len() as u32)
    }

    /// Sets the state to [`Ended`](HartState::Ended) with `status`, which is 0 for success. The
    /// hart calls this when its program has returned.
    ///
    /// # Errors
    /// [`AccessError`] if the memory cannot be accessed.
    pub fn end(&self, status: u32) -> Result<(), AccessError> {
        self.page.set_word(hart::STATUS, status)?;
        self.page.set_word(hart::STATE, ENDED)
    }

    /// Sets the state to [`Abandoned`](HartState::Abandoned). The monitor calls this after the host
    /// took the program off the hart.
    ///
    /// # Errors
    /// [`AccessError`] if the memory cannot be accessed.
    pub fn leave(&self) -> Result<(), AccessError> {
        self.page.set_word(hart::STATE, ABANDONED)
    }

    /// Stores the registers at a trap that the program did not handle, for [`fault`](Self::fault).
    /// The monitor calls this before [`fail`](Self::fail).
    ///
    /// # Errors
    /// [`AccessError`] if the memory cannot be accessed.
    pub fn set_fault(&self, fault: &HartFault) -> Result<(), AccessError> {
        let heads = [fault.cause, fault.pc, fault.value, fault.status];
        self.set_doubles(hart::FAULT, heads.into_iter().chain(fault.registers))
    }

    /// Sets the state to [`Faulted`](HartState::Faulted). The monitor calls this after
    /// [`set_fault`](Self::set_fault).
    ///
    /// # Errors
    /// [`AccessError`] if the memory cannot be accessed.
    pub fn fail(&self) -> Result<(), AccessError> {
        self.page.set_word(hart::STATE, FAULTED)
    }

    fn double(&self, at: u32) -> Result<u64, AccessError> {
        let (low, high) = (self.page.word(at)?, self.page.word(at + 4)?);
        Ok(u64::from(high) << 32 | u64::from(low))
    }

    fn set_doubles(
        &self,
        at: u32,
        values: impl IntoIterator<Item = u64>,
    ) -> Result<(), AccessError> {
        for (place, value) in (0..).zip(values) {
            let at = at + 8 * place;
            self.page.set_word(at, value as u32)?;
            self.page.set_word(at + 4, (value >> 32) as u32)?;
        }
        Ok(())
    }
}
