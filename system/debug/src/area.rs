//! The words of the debug area: README.md says who writes them, and in which order.

use condor_mbox::{AccessError, MemoryWindow, Region};

/// The size in bytes of the debug area: the memory through which the host and the stub of a
/// processor exchange commands and the registers of a stopped program.
pub const AREA_BYTES: u32 = 2048;
/// The greatest number of registers in a frame, the saved registers of a stopped program. The frame
/// is at the beginning of the debug area, and each register takes 8 bytes.
pub const FRAME_REGISTERS: u32 = 128;

pub(crate) const COMMAND: u32 = 1024;
pub(crate) const ACTION: u32 = 1028;
pub(crate) const CHANGES: u32 = 1032;
pub(crate) const MODE: u32 = 1036;
/// First and end.
const CLOSED: [u32; 2] = [1040, 1048];
pub(crate) const DONE: u32 = 1056;
pub(crate) const RESULT: u32 = 1060;
pub(crate) const STATE: u32 = 1064;
pub(crate) const HOLDS: u32 = 1068;
pub(crate) const REASON: u32 = 1072;
const CHANGE: u32 = 1088;
/// The offset in bytes of the table of planted breakpoints in the debug area. A trap entry can read the table to put an
/// instruction back without the stub. Each entry has 16 bytes: an address (8 bytes), the original instruction there (4
/// bytes), and a word (4 bytes) that is 1 if a breakpoint instruction is planted there.
pub const PLANTED: u32 = 1344;

/// The number of entries of the table at [`PLANTED`]: the greatest number of breakpoints and
/// triggers at a time.
pub const MOST_PLANTED: u32 = 40;
/// The greatest number of changes of a command.
pub(crate) const MOST_CHANGES: u32 = 16;
const ENTRY_BYTES: u32 = 16;

/// Values of `ACTION`; 0 does nothing.
pub(crate) const STOP: u32 = 1;
pub(crate) const RESUME: u32 = 2;
pub(crate) const RELEASE: u32 = 3;
/// Values of a change.
pub(crate) const PLANT: u32 = 1;
pub(crate) const REMOVE: u32 = 2;
/// A value of `STATE`; 0 runs.
pub(crate) const HELD: u32 = 1;
/// The word of a change or a planted entry that is a breakpoint instruction; other words are those of a
/// [`Trigger`].
pub(crate) const INSTRUCTION: u32 = 1;

/// A hardware trigger of a processor, which stops a program at an address without a breakpoint instruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Trigger {
    /// The address of the instruction or of the first byte.
    pub address: u64,
    /// The accesses that stop the program, before they are made.
    pub access: TriggerAccess,
    /// The number of bytes: 1, 2, 4 or 8; of an instruction, 2 or 4.
    pub bytes: u8,
}

/// The accesses at which a [`Trigger`] stops a program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TriggerAccess {
    /// An instruction is executed.
    Execute,
    /// A value is stored.
    Write,
    /// A value is loaded.
    Read,
    /// A value is loaded or stored.
    ReadWrite,
}

impl Trigger {
    /// The word of a change: the access, and the number of bytes above it.
    #[cfg(feature = "gateway")]
    pub(crate) fn word(self) -> u32 {
        let access = match self.access {
            TriggerAccess::Execute => 2,
            TriggerAccess::Write => 4,
            TriggerAccess::Read => 8,
            TriggerAccess::ReadWrite => 12,
        };
        access | u32::from(self.bytes) << 8
    }

    /// The trigger of a word; `None` if there is none such.
    pub(crate) const fn from_word(address: u64, word: u32) -> Option<Self> {
        let access = match word & 0xff {
            2 => TriggerAccess::Execute,
            4 => TriggerAccess::Write,
            8 => TriggerAccess::Read,
            12 => TriggerAccess::ReadWrite,
            _ => return None,
        };
        let bytes = match word >> 8 {
            bytes @ (1 | 2 | 4 | 8) => bytes as u8,
            _ => return None,
        };
        Some(Self {
            address,
            access,
            bytes,
        })
    }
}

/// The debug mode of a processor: the events at which its program is held, that is, stopped until a
/// debugger resumes it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DebugRequest {
    /// A debugger is attached: breakpoints and fatal exceptions hold the program.
    pub attached: bool,
    /// A fatal exception holds the program, also while no debugger is attached.
    pub hold_exceptions: bool,
    /// The next program is held before its first statement, if a debugger is attached.
    pub hold_start: bool,
}

impl DebugRequest {
    pub(crate) const fn from_word(word: u32) -> Self {
        Self {
            attached: word & 1 != 0,
            hold_exceptions: word & 2 != 0,
            hold_start: word & 4 != 0,
        }
    }

    /// Returns the mode after a debugger has gone.
    #[cfg(feature = "gateway")]
    pub(crate) const fn left(self) -> Self {
        Self {
            attached: false,
            hold_start: false,
            ..self
        }
    }

    #[cfg(feature = "gateway")]
    pub(crate) fn word(self) -> u32 {
        u32::from(self.attached)
            | u32::from(self.hold_exceptions) << 1
            | u32::from(self.hold_start) << 2
    }
}

/// The reason why a program is held, that is, stopped until a debugger resumes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HoldReason {
    /// The debugger has stopped the program.
    Stopped,
    /// The program has come to a breakpoint.
    Breakpoint,
    /// The program has made a trap that it does not handle.
    Exception,
    /// The program has come to a [`Trigger`].
    Trigger,
}

impl HoldReason {
    pub(crate) const fn word(self) -> u32 {
        match self {
            Self::Stopped => 1,
            Self::Breakpoint => 2,
            Self::Exception => 3,
            Self::Trigger => 4,
        }
    }

    #[cfg(feature = "gateway")]
    pub(crate) const fn from_word(word: u32) -> Self {
        match word {
            2 => Self::Breakpoint,
            3 => Self::Exception,
            4 => Self::Trigger,
            _ => Self::Stopped,
        }
    }
}

/// An entry of one of the tables.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Entry {
    pub(crate) address: u64,
    pub(crate) words: [u32; 2],
}

/// The area, as either side sees it.
#[derive(Clone, Debug)]
pub(crate) struct Area<W>(Region<W>);

impl<W: MemoryWindow> Area<W> {
    pub(crate) const fn new(region: Region<W>) -> Self {
        Self(region)
    }

    pub(crate) fn word(&self, at: u32) -> Result<u32, AccessError> {
        self.0.word(at)
    }

    pub(crate) fn set(&self, at: u32, value: u32) -> Result<(), AccessError> {
        self.0.set_word(at, value)
    }

    pub(crate) fn mode(&self) -> Result<DebugRequest, AccessError> {
        self.word(MODE).map(DebugRequest::from_word)
    }

    pub(crate) fn change(&self, place: u32) -> Result<Entry, AccessError> {
        self.entry(CHANGE, place, MOST_CHANGES)
    }

    pub(crate) fn planted(&self, place: u32) -> Result<Entry, AccessError> {
        self.entry(PLANTED, place, MOST_PLANTED)
    }

    pub(crate) fn set_planted(&self, place: u32, entry: Entry) -> Result<(), AccessError> {
        self.set_entry(PLANTED, place, MOST_PLANTED, entry)
    }

    #[cfg(feature = "gateway")]
    pub(crate) fn closed(&self) -> Result<core::ops::Range<u64>, AccessError> {
        Ok(self.double(CLOSED[0])?..self.double(CLOSED[1])?)
    }

    pub(crate) fn set_closed(&self, closed: &core::ops::Range<u64>) -> Result<(), AccessError> {
        self.set_double(CLOSED[0], closed.start)?;
        self.set_double(CLOSED[1], closed.end)
    }

    #[cfg(feature = "gateway")]
    pub(crate) fn set_change(&self, place: u32, entry: Entry) -> Result<(), AccessError> {
        self.set_entry(CHANGE, place, MOST_CHANGES, entry)
    }

    #[cfg(any(feature = "gateway", feature = "sim"))]
    pub(crate) fn register(&self, place: u32) -> Result<u64, AccessError> {
        self.double(8 * place.min(FRAME_REGISTERS - 1))
    }

    #[cfg(any(feature = "gateway", feature = "sim"))]
    pub(crate) fn set_register(&self, place: u32, value: u64) -> Result<(), AccessError> {
        self.set_double(8 * place.min(FRAME_REGISTERS - 1), value)
    }

    fn entry(&self, table: u32, place: u32, most: u32) -> Result<Entry, AccessError> {
        let at = table + ENTRY_BYTES * place.min(most - 1);
        Ok(Entry {
            address: self.double(at)?,
            words: [self.word(at + 8)?, self.word(at + 12)?],
        })
    }

    fn set_entry(&self, table: u32, place: u32, most: u32, it: Entry) -> Result<(), AccessError> {
        let at = table + ENTRY_BYTES * place.min(most - 1);
        self.set_double(at, it.address)?;
        self.set(at + 8, it.words[0])?;
        self.set(at + 12, it.words[1])
    }

    fn double(&self, at: u32) -> Result<u64, AccessError> {
        Ok(u64::from(self.word(at + 4)?) << 32 | u64::from(self.word(at)?))
    }

    fn set_double(&self, at: u32, value: u64) -> Result<(), AccessError> {
        self.set(at, value as u32)?;
        self.set(at + 4, (value >> 32) as u32)
    }
}
