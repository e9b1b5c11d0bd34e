#![doc = include_str!("../WIRE.md")]

use static_assertions::const_assert;

use condor_mbox::Vector;
use condor_mbox::layout::LINE;

/// The word that marks a terminal's block: "CTTY" in little-endian order.
pub const MAGIC: u32 = u32::from_le_bytes(*b"CTTY");
/// The version of this layout.
pub const VERSION: u32 = 1;
/// The number of bytes of a block before its ring of output: the processor's cache line and the
/// host's.
pub const BLOCK_BYTES: u32 = 2 * LINE;
/// The alignment of terminals, in bytes: offsets of blocks are multiples of it, so that the word of
/// a message has room for a character beside the offset.
pub const ALIGNMENT: u32 = LINE;
/// The least size of a ring, in bytes.
pub const MIN_CAPACITY: u32 = 8;
/// The greatest size of a ring, in bytes.
pub const MAX_CAPACITY: u32 = 1 << 30;

/// Offsets, in bytes from the beginning of a block, of the words that the processor writes.
pub mod processor {
    /// The offset of the word that holds [`MAGIC`](super::MAGIC).
    pub const MAGIC: u32 = 0;
    /// The offset of the word that holds [`VERSION`](super::VERSION).
    pub const VERSION: u32 = 4;
    /// The incarnation of the terminal: a number that changes each time a program makes the terminal anew.
    /// It is 0 while the block is being initialised.
    pub const INCARNATION: u32 = 8;
    /// The size of the ring in bytes, a power of two.
    pub const CAPACITY: u32 = 12;
    /// The position in the output up to which writing has begun: a count of bytes of this incarnation.
    pub const RESERVED: u32 = 16;
    /// The position in the output up to which bytes have been written.
    pub const HEAD: u32 = 20;
    /// The number of bytes for which there was no room.
    pub const LOST: u32 = 24;
    /// The [`policy`](super::policy) for output for which there is no room.
    pub const POLICY: u32 = 28;
    /// The bits of the [`mode`](super::mode), and the character that interrupts.
    pub const MODE: u32 = 32;
    /// Whether a program waits for room: 1 or 0.
    pub const WAITING: u32 = 36;
    /// The number of values of the host's cursor that were ignored as invalid.
    pub const IGNORED: u32 = 40;
    /// The number of characters of input messages that have been taken.
    pub const TYPED: u32 = 44;
}

/// Offsets, in bytes from the beginning of a block, of the words that the host writes.
pub mod host {
    use super::LINE;

    /// The position in the output up to which the host has acknowledged bytes.
    pub const TAIL: u32 = LINE;
    /// The attached host: its number plus one in bits 0–7, 0 if none is attached; above them a count
    /// of attachments.
    pub const ATTACHED: u32 = LINE + 4;
    /// The incarnation of the terminal to which these words belong.
    pub const INCARNATION: u32 = LINE + 8;
    /// The offsets of two records of two words each: a value of [`TAIL`], then the number of bytes
    /// before it that were overwritten. The record whose first word equals the present tail is
    /// valid; the host writes the other one before it stores the next tail.
    pub const RECORDS: [u32; 2] = [LINE + 16, LINE + 24];
}

/// The values of the word [`processor::POLICY`].
pub mod policy {
    /// The value for [`Policy::Block`](crate::Policy::Block).
    pub const BLOCK: u32 = 0;
    /// The value for [`Policy::DropNew`](crate::Policy::DropNew).
    pub const DROP_NEW: u32 = 1;
    /// The value for [`Policy::DropOld`](crate::Policy::DropOld).
    pub const DROP_OLD: u32 = 2;
}

/// The bits of the word [`processor::MODE`].
pub mod mode {
    /// The terminal edits lines on the processor before the program gets them.
    pub const COOKED: u32 = 1;
    /// A person has stopped the output, by the character for that.
    pub const STOPPED: u32 = 2;
    /// The terminal has refused a character for lack of room, and the program has read nothing
    /// since.
    pub const FULL: u32 = 4;
    /// The position of the character that interrupts in the word, in bits; the character is 0 if
    /// there is none.
    pub const INTERRUPT_SHIFT: u32 = 8;
}

/// The replies of a processor to an input message.
pub mod reply {
    /// There is no such terminal.
    pub const NO_TERMINAL: u32 = 0;
    /// The character has been taken.
    pub const ACCEPTED: u32 = 1;
    /// There is no room: keep the character and try again.
    pub const FULL: u32 = 2;
}

/// The vectors of the messages between processor and host; both sides must use the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TerminalVectors {
    /// A message to the host: bytes have been written; its word is the terminal's offset.
    pub output: Vector,
    /// A message to the processor: a character, packed by [`input_data`].
    pub input: Vector,
    /// A message to the processor: there is room again; its word is the terminal's offset.
    pub room: Vector,
}

impl TerminalVectors {
    /// The default vectors: 56, 57 and 58.
    pub const DEFAULT: Self = Self {
        output: Vector(56),
        input: Vector(57),
        room: Vector(58),
    };
}

impl Default for TerminalVectors {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Returns the word of an input message: `character` for the terminal at `offset`.
#[must_use]
pub const fn input_data(offset: u32, character: u8) -> u32 {
    (offset / ALIGNMENT) << 8 | character as u32
}

/// Returns true if a terminal can begin at `offset`: a multiple of a line, below 1 GiB.
#[must_use]
pub const fn is_offset(offset: u32) -> bool {
    offset.is_multiple_of(ALIGNMENT) && offset / ALIGNMENT < 1 << 24
}

/// Returns true if a ring can have `capacity` bytes.
#[must_use]
pub const fn is_capacity(capacity: u32) -> bool {
    capacity.is_power_of_two() && capacity >= MIN_CAPACITY && capacity <= MAX_CAPACITY
}

const_assert!(processor::TYPED + 4 <= LINE);
const_assert!(host::RECORDS[1] + 8 <= BLOCK_BYTES);
