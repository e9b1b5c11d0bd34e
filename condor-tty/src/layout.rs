#![doc = include_str!("../WIRE.md")]

use static_assertions::const_assert;

use condor_mbox::Vector;
use condor_mbox::layout::LINE;

/// The word at the beginning of a terminal's block in shared memory, which marks it as such: "CTTY"
/// in little-endian order.
pub const MAGIC: u32 = u32::from_le_bytes(*b"CTTY");
/// The version of the layout of terminals in shared memory that this module describes.
pub const VERSION: u32 = 1;
/// The number of bytes of a terminal's block before its ring of output: a cache line that the
/// processor writes, and one that the host writes.
pub const BLOCK_BYTES: u32 = 2 * LINE;
/// The alignment of terminals' blocks, in bytes: the offset of a block is a multiple of this. So
/// one word of a message has room for both the offset and a character.
pub const ALIGNMENT: u32 = LINE;
/// The least size of a terminal's ring of output, in bytes.
pub const MIN_CAPACITY: u32 = 8;
/// The greatest size of a terminal's ring of output, in bytes.
pub const MAX_CAPACITY: u32 = 1 << 30;

/// The offsets of the words in a terminal's block that the processor writes, in bytes from the
/// beginning of the block.
pub mod processor {
    /// The offset of the word with the constant [`MAGIC`](super::MAGIC), which marks the block as a
    /// terminal.
    pub const MAGIC: u32 = 0;
    /// The offset of the word with the version of the layout, [`VERSION`](super::VERSION).
    pub const VERSION: u32 = 4;
    /// The offset of the word with the incarnation of the terminal: a number that changes each time
    /// a program makes the terminal anew. It is 0 while the block is being initialised.
    pub const INCARNATION: u32 = 8;
    /// The offset of the word with the size of the ring in bytes, a power of two.
    pub const CAPACITY: u32 = 12;
    /// The offset of the word with the position up to which the processor has begun to write. A
    /// position is a count of all bytes of output of this incarnation.
    pub const RESERVED: u32 = 16;
    /// The offset of the word with the position up to which the processor has written bytes, which
    /// the host may read.
    pub const HEAD: u32 = 20;
    /// The offset of the count of bytes of output that were dropped because the ring had no room.
    pub const LOST: u32 = 24;
    /// The offset of the word with the [`policy`](super::policy) for output for which there is no
    /// room.
    pub const POLICY: u32 = 28;
    /// The offset of the word with the bits of the [`mode`](super::mode), and the character that
    /// interrupts.
    pub const MODE: u32 = 32;
    /// The offset of the word with the number of contexts that wait for the host: while it is not
    /// 0, the host must send a message when it has made room.
    pub const WAITING: u32 = 36;
    /// The offset of the count of invalid values of the host's word [`TAIL`](super::host::TAIL),
    /// which the processor ignored.
    pub const IGNORED: u32 = 40;
    /// The offset of the count of characters that the terminal has taken from input messages.
    pub const TYPED: u32 = 44;
}

/// The offsets of the words in a terminal's block that the host writes, in bytes from the beginning
/// of the block.
pub mod host {
    use super::LINE;

    /// The offset of the word with the position in the output up to which the host has acknowledged
    /// bytes.
    pub const TAIL: u32 = LINE;
    /// The offset of the word with the attached host: bits 0–7 are the host's number plus one, or 0
    /// if none is attached; the bits above them count attachments.
    pub const ATTACHED: u32 = LINE + 4;
    /// The offset of the word with the incarnation of the terminal to which the host's words
    /// belong.
    pub const INCARNATION: u32 = LINE + 8;
    /// The offsets of two records, of two words each: a position, and the number of bytes before it
    /// that were overwritten unread. The record whose position equals the value of [`TAIL`] is
    /// valid. The host writes the other record before it stores the next value of `TAIL`.
    pub const RECORDS: [u32; 2] = [LINE + 16, LINE + 24];
}

/// The possible values of the word at [`processor::POLICY`].
pub mod policy {
    /// The value for [`Policy::Block`](crate::Policy::Block).
    pub const BLOCK: u32 = 0;
    /// The value for [`Policy::DropNew`](crate::Policy::DropNew).
    pub const DROP_NEW: u32 = 1;
    /// The value for [`Policy::DropOld`](crate::Policy::DropOld).
    pub const DROP_OLD: u32 = 2;
}

/// The bits of the word at [`processor::MODE`].
pub mod mode {
    /// The bit that is set if the terminal edits lines on the processor before the program gets
    /// them.
    pub const COOKED: u32 = 1;
    /// The bit that is set while the output is stopped, by the character that a person types for
    /// that.
    pub const STOPPED: u32 = 2;
    /// The bit that is set after the terminal has refused a character for lack of room, until the
    /// program reads.
    pub const FULL: u32 = 4;
    /// The number of the lowest of the eight bits that are the character that interrupts; the
    /// character is 0 if there is none.
    pub const INTERRUPT_SHIFT: u32 = 8;
}

/// The replies of a processor to a message with a typed character.
pub mod reply {
    /// The reply if there is no terminal at the offset in the message.
    pub const NO_TERMINAL: u32 = 0;
    /// The reply if the terminal has taken the character.
    pub const ACCEPTED: u32 = 1;
    /// The reply if the terminal has no room: the host must keep the character and try again.
    pub const FULL: u32 = 2;
}

/// The vectors of the messages between a processor's terminals and the host. Both sides must use
/// the same ones.
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
    /// The vectors that terminals and hosts use by default: 56 for output, 57 for input and 58 for
    /// room.
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

/// Returns the word of a message that passes the typed `character` to the terminal at `offset`.
#[must_use]
pub const fn input_data(offset: u32, character: u8) -> u32 {
    (offset / ALIGNMENT) << 8 | character as u32
}

/// Returns true if a terminal's block can begin at `offset`: it must be a multiple of [`ALIGNMENT`]
/// below 1 GiB.
#[must_use]
pub const fn is_offset(offset: u32) -> bool {
    offset.is_multiple_of(ALIGNMENT) && offset / ALIGNMENT < 1 << 24
}

/// Returns true if a ring can have `capacity` bytes: a power of two from [`MIN_CAPACITY`] to
/// [`MAX_CAPACITY`].
#[must_use]
pub const fn is_capacity(capacity: u32) -> bool {
    capacity.is_power_of_two() && capacity >= MIN_CAPACITY && capacity <= MAX_CAPACITY
}

const_assert!(processor::TYPED + 4 <= LINE);
const_assert!(host::RECORDS[1] + 8 <= BLOCK_BYTES);
