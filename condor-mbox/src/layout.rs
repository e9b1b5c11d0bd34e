#![doc = include_str!("../LAYOUT.md")]

use static_assertions::const_assert;

/// The word that marks a formatted `mail`: "CNDR" in little-endian order.
pub const MAGIC: u32 = u32::from_le_bytes(*b"CNDR");
/// The version of this layout.
pub const VERSION: u32 = 2;
/// The size of a cache line that the layout assumes, in bytes.
pub const LINE: u32 = 64;
/// The number of slots of a ring, and of reply cells of a pair of processors; a power of two.
pub const SLOTS: u32 = if cfg!(condor_loom) { 2 } else { 8 };
/// The number of vectors of a processor.
pub const VECTORS: usize = if cfg!(condor_loom) { 2 } else { 64 };
/// The greatest length of a vector's name, in bytes.
pub const NAME_BYTES: usize = 32;
/// The value of the incarnation word while a processor joins and clears its rings.
pub const JOINING: u32 = u32::MAX;
/// The number of bytes at the beginning of `data` that belong to the doorbell.
pub const BELL_BYTES: u32 = LINE;

const_assert!(SLOTS.is_power_of_two());

/// Byte offsets of the words of the header, from the beginning of `mail`.
pub mod header {
    /// The offset of the word that holds [`MAGIC`](super::MAGIC), which is stored last when a file
    /// is formatted.
    pub const MAGIC: u32 = 0;
    /// The offset of the word that holds [`VERSION`](super::VERSION).
    pub const VERSION: u32 = 4;
    /// The number of processors of the system.
    pub const PROCESSORS: u32 = 8;
    /// The processor's own number.
    pub const NUMBER: u32 = 12;
    /// The offset of the word that holds [`SLOTS`](super::SLOTS).
    pub const SLOTS: u32 = 16;
    /// The offset of the word that holds [`VECTORS`](super::VECTORS).
    pub const VECTORS: u32 = 20;
    /// The size of `data`, in bytes.
    pub const DATA_SIZE: u32 = 24;
    /// The present incarnation; 0 if the processor has not joined, [`JOINING`](super::JOINING)
    /// while it joins.
    pub const INCARNATION: u32 = 28;
    /// The latest incarnation, which is kept when the processor leaves.
    pub const LAST_INCARNATION: u32 = 32;
    /// A set of the processors that listen to this number: bit *p* stands for processor *p*.
    pub const LISTENERS: u32 = 36;
    /// The process id of the program that holds the number, for people; nothing depends on it.
    pub const PROCESS_ID: u32 = 40;
    /// The heartbeat, in a cache line of its own: a count that the processor increments while it
    /// serves or waits.
    pub const HEARTBEAT: u32 = super::LINE;
    /// The notify flag, in a cache line of its own: not 0 if senders shall ring the processor.
    pub const NOTIFY: u32 = 2 * super::LINE;
}

const LISTEN: u32 = 3 * LINE;
pub(crate) const VECTOR_BYTES: u32 = NAME_BYTES as u32 + 16;
const SLOT_BYTES: u32 = entry::BYTES;
const RING_BYTES: u32 = SLOTS * SLOT_BYTES;
const PAIR_BYTES: u32 = LINE + 2 * RING_BYTES;

const fn whole_lines(bytes: u32) -> u32 {
    bytes.div_ceil(LINE) * LINE
}

const fn vectors(processors: u32) -> u32 {
    LISTEN + whole_lines(processors * 8)
}

const fn pairs(processors: u32) -> u32 {
    vectors(processors) + whole_lines(VECTORS as u32 * VECTOR_BYTES)
}

/// Returns the size of `mail` in bytes, in a system of `processors`.
#[must_use]
pub const fn mail_bytes(processors: u32) -> u32 {
    pairs(processors) + processors * PAIR_BYTES
}

/// Returns the byte offset in a listener's `mail` of its two words for `sender`: the epoch, and the
/// count of the requests of `sender` that it has taken.
#[must_use]
pub const fn listen(sender: u32) -> u32 {
    LISTEN + sender * 8
}

/// Byte offsets of the fields of an entry of the vector table, from the beginning of the entry.
pub mod vector {
    /// The name: UTF-8, padded with zeros.
    pub const NAME: u32 = 0;
    /// The number of messages that this processor sent to this vector of any processor.
    pub const SENT: u32 = super::NAME_BYTES as u32;
    /// The number of messages to this vector that this processor handled.
    pub const HANDLED: u32 = SENT + 4;
    /// The number of messages of this processor to this vector, of any processor, that ended in an
    /// error.
    pub const FAILED: u32 = SENT + 8;
    /// The longest time of the vector's handler, in ns.
    pub const WORST: u32 = SENT + 12;
}

/// Returns the byte offset in `mail` of the entry of `vector` in the vector table.
#[must_use]
pub const fn vector_entry(processors: u32, vector: u32) -> u32 {
    vectors(processors) + vector * VECTOR_BYTES
}

/// Returns the byte offset in `mail` of the part for `peer`. Its first word is the incarnation of
/// `peer` that the owner has acknowledged.
#[must_use]
pub const fn acknowledged(processors: u32, peer: u32) -> u32 {
    pairs(processors) + peer * PAIR_BYTES
}

/// Returns the byte offset in `mail` of the count of requests of `peer` that the owner has taken.
#[must_use]
pub const fn taken(processors: u32, peer: u32) -> u32 {
    taken_in(acknowledged(processors, peer))
}

/// Offset of the count of taken requests in the pair that begins at offset `pair`.
#[inline(always)]
pub(crate) const fn taken_in(pair: u32) -> u32 {
    pair + 4
}

/// The kinds of requests in a kind word. Its low byte is the vector, its third byte the reply cell.
pub mod kind {
    /// The receiver runs the handler.
    pub const SEND: u32 = 1 << 8;
    /// The receiver runs the handler and replies.
    pub const CALL: u32 = 2 << 8;
    /// The receiver tells the sender of each message that comes for the vectors to which it listens, from now on.
    pub const LISTEN: u32 = 3 << 8;
    /// The receiver no longer tells the sender of messages.
    pub const IGNORE: u32 = 4 << 8;
    /// The position of the reply cell's number in a kind word, in bits.
    pub const CELL_SHIFT: u32 = 16;
}

/// The outcome of a request, in the kind word of its reply cell.
pub mod status {
    /// The handler's result is the value.
    pub const DONE: u32 = 1;
    /// There is no handler for the vector.
    pub const NO_HANDLER: u32 = 2;
    /// The handler did not return.
    pub const HANDLER_FAILED: u32 = 3;
    /// The handler refused; its error code is the value.
    pub const REFUSED: u32 = 4;
}

/// Returns the byte offset in `mail` of the slot for the request to `peer` with the number
/// `sequence`.
#[must_use]
pub const fn slot(processors: u32, peer: u32, sequence: u32) -> u32 {
    slot_in(acknowledged(processors, peer), sequence)
}

/// Offset of the slot for request `sequence` in the pair that begins at offset `pair`.
#[inline(always)]
pub(crate) const fn slot_in(pair: u32, sequence: u32) -> u32 {
    pair + LINE + (sequence % SLOTS) * SLOT_BYTES
}

/// Offset of reply cell `cell` in the pair that begins at offset `pair`.
#[inline(always)]
pub(crate) const fn cell_in(pair: u32, cell: u32) -> u32 {
    pair + LINE + RING_BYTES + (cell % SLOTS) * SLOT_BYTES
}

/// Returns the byte offset in `mail` of reply cell `cell` for requests of `peer`.
#[must_use]
pub const fn cell(processors: u32, peer: u32, cell: u32) -> u32 {
    cell_in(acknowledged(processors, peer), cell)
}

/// Byte offsets of the words of a request slot or a reply cell, from its beginning.
pub mod entry {
    /// The data of a request, the value of a reply.
    pub const VALUE: u32 = 0;
    /// The epoch of the sender and the receiver; see [`epoch`](super::epoch).
    pub const EPOCH: u32 = 4;
    /// Kind, vector and cell of a request; status of a reply.
    pub const KIND: u32 = 8;
    /// The sequence number, stored last.
    pub const SEQUENCE: u32 = 12;
    /// The size of an entry, in bytes.
    pub const BYTES: u32 = 16;
}

/// Returns the epoch of the incarnations `sender` and `receiver`: a number, never 0, that marks the
/// requests of that sender to that receiver.
#[must_use]
pub const fn epoch(sender: u32, receiver: u32) -> u32 {
    let mixed = sender
        .wrapping_mul(0x9E37_79B1)
        .wrapping_add(receiver.wrapping_mul(0x85EB_CA77));
    if mixed == 0 { 1 } else { mixed }
}
