#![doc = include_str!("../LAYOUT.md")]

use static_assertions::const_assert;

/// The word that marks a `mail` that has this layout: "CNDR" in little-endian order.
pub const MAGIC: u32 = u32::from_le_bytes(*b"CNDR");
/// The version of the layout that this crate reads and writes.
pub const VERSION: u32 = 2;
/// The size of a cache line that the layout assumes, in bytes.
pub const LINE: u32 = 64;
/// The number of slots of a ring, which holds the messages from one processor to another; also the
/// number of reply cells for them. It is a power of two.
pub const SLOTS: u32 = if cfg!(condor_loom) { 2 } else { 8 };
/// The number of vectors that each processor has.
pub const VECTORS: usize = if cfg!(condor_loom) { 2 } else { 64 };
/// The greatest length of a vector's name, in bytes.
pub const NAME_BYTES: usize = 32;
/// The value of the word at [`header::INCARNATION`] while a processor joins and clears its rings.
pub const JOINING: u32 = u32::MAX;
/// The number of bytes at the beginning of each `data` that belong to the doorbell.
pub const BELL_BYTES: u32 = LINE;
/// The byte offset in `data` of the word that has a bit for each line by which boards that are memory
/// interrupt the processor.
pub const BOARD_LINES: u32 = 8;

const_assert!(SLOTS.is_power_of_two());

/// Byte offsets of the words of the header, which is at the beginning of `mail`.
pub mod header {
    /// The byte offset in `mail` of the word that holds [`MAGIC`](super::MAGIC), which is stored
    /// last when a `mail` is formatted.
    pub const MAGIC: u32 = 0;
    /// The byte offset in `mail` of the word that holds [`VERSION`](super::VERSION).
    pub const VERSION: u32 = 4;
    /// The byte offset in `mail` of the number of processors of the system.
    pub const PROCESSORS: u32 = 8;
    /// The byte offset in `mail` of the number of the processor that owns the `mail`.
    pub const NUMBER: u32 = 12;
    /// The byte offset in `mail` of the word that holds [`SLOTS`](super::SLOTS).
    pub const SLOTS: u32 = 16;
    /// The byte offset in `mail` of the word that holds [`VECTORS`](super::VECTORS).
    pub const VECTORS: u32 = 20;
    /// The byte offset in `mail` of the size of the processor's `data`, in bytes.
    pub const DATA_SIZE: u32 = 24;
    /// The byte offset in `mail` of the processor's present incarnation. This word is 0 if the
    /// processor has not joined, and [`JOINING`](super::JOINING) while it joins.
    pub const INCARNATION: u32 = 28;
    /// The byte offset in `mail` of the processor's latest incarnation, which stays there when the
    /// processor leaves.
    pub const LAST_INCARNATION: u32 = 32;
    /// The byte offset in `mail` of the set of processors that listen to this processor's number:
    /// bit *p* stands for processor *p*.
    pub const LISTENERS: u32 = 36;
    /// The byte offset in `mail` of the process id of the program that holds the number. It is for
    /// people; nothing depends on it.
    pub const PROCESS_ID: u32 = 40;
    /// The byte offset in `mail` of the heartbeat, a count that the processor increments while it
    /// serves or waits. It has a cache line of its own.
    pub const HEARTBEAT: u32 = super::LINE;
    /// The byte offset in `mail` of the notify flag. This word is not 0 if senders must ring the
    /// processor's doorbell. It has a cache line of its own.
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

/// Returns the size of each `mail`, in bytes, in a system of `processors` processors.
#[must_use]
pub const fn mail_bytes(processors: u32) -> u32 {
    pairs(processors) + processors * PAIR_BYTES
}

/// Returns the byte offset of two words in the `mail` of a listener: the epoch of the messages from
/// `sender`, and the count of these messages that the listener has taken.
#[must_use]
pub const fn listen(sender: u32) -> u32 {
    LISTEN + sender * 8
}

/// Byte offsets of the fields of an entry of the vector table, from the beginning of the entry.
pub mod vector {
    /// The byte offset, in an entry of the vector table, of the vector's name: UTF-8, padded with
    /// zeros.
    pub const NAME: u32 = 0;
    /// The byte offset, in an entry of the vector table, of the number of messages that this
    /// processor sent to the vector with this number on any processor.
    pub const SENT: u32 = super::NAME_BYTES as u32;
    /// The byte offset, in an entry of the vector table, of the number of messages that this
    /// processor's handler of the vector has handled.
    pub const HANDLED: u32 = SENT + 4;
    /// The byte offset, in an entry of the vector table, of the number of messages that this
    /// processor sent to the vector with this number on any processor, and that ended in an error.
    pub const FAILED: u32 = SENT + 8;
    /// The byte offset, in an entry of the vector table, of the longest time that the vector's
    /// handler took, in ns.
    pub const WORST: u32 = SENT + 12;
}

/// Returns the byte offset in `mail` of the entry of `vector` in the vector table, in a system of
/// `processors` processors.
#[must_use]
pub const fn vector_entry(processors: u32, vector: u32) -> u32 {
    vectors(processors) + vector * VECTOR_BYTES
}

/// Returns the byte offset, in the `mail` of a processor, of the part for its messages with `peer`,
/// in a system of `processors` processors. The first word of this part is the incarnation of `peer`
/// that the processor has acknowledged.
#[must_use]
pub const fn acknowledged(processors: u32, peer: u32) -> u32 {
    pairs(processors) + peer * PAIR_BYTES
}

/// Returns the byte offset, in the `mail` of a processor, of the count of requests of `peer` that
/// it has taken, in a system of `processors` processors.
#[must_use]
pub const fn taken(processors: u32, peer: u32) -> u32 {
    taken_in(acknowledged(processors, peer))
}

/// Offset of the count of taken requests in the pair that begins at offset `pair`.
#[inline(always)]
pub(crate) const fn taken_in(pair: u32) -> u32 {
    pair + 4
}

/// The kinds of requests, as they stand in the kind word of a slot. The low byte of this word is
/// the vector, and the third byte the number of the reply cell.
pub mod kind {
    /// The kind of a message without reply: the receiver runs the handler of the vector.
    pub const SEND: u32 = 1 << 8;
    /// The kind of a message with reply: the receiver runs the handler of the vector and replies.
    pub const CALL: u32 = 2 << 8;
    /// The kind of a request to listen: from now on, the receiver lets the sender receive every
    /// message that is sent to the receiver's number.
    pub const LISTEN: u32 = 3 << 8;
    /// The kind of a request to end listening: the receiver no longer lets the sender receive the
    /// messages that are sent to the receiver's number.
    pub const IGNORE: u32 = 4 << 8;
    /// The number of the bit in a kind word at which the number of the reply cell begins.
    pub const CELL_SHIFT: u32 = 16;
}

/// The outcomes of a request, as they stand in the kind word of its reply cell.
pub mod status {
    /// The outcome of a request whose handler has returned: the value in the cell is the handler's
    /// result.
    pub const DONE: u32 = 1;
    /// The outcome of a request to a vector without a handler.
    pub const NO_HANDLER: u32 = 2;
    /// The outcome of a request whose handler did not return, because it panicked.
    pub const HANDLER_FAILED: u32 = 3;
    /// The outcome of a request that its handler refused: the value in the cell is the handler's
    /// error code.
    pub const REFUSED: u32 = 4;
}

/// Returns the byte offset, in the `mail` of a sender, of the slot for its request number
/// `sequence` to `peer`, in a system of `processors` processors.
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

/// Returns the byte offset, in the `mail` of a receiver, of the reply cell number `cell` for
/// requests of `peer`, in a system of `processors` processors.
#[must_use]
pub const fn cell(processors: u32, peer: u32, cell: u32) -> u32 {
    cell_in(acknowledged(processors, peer), cell)
}

/// Byte offsets of the words of a request slot or a reply cell, from its beginning.
pub mod entry {
    /// The byte offset, in a slot or cell, of the word of the message or the value of the reply.
    pub const VALUE: u32 = 0;
    /// The byte offset, in a slot or cell, of the epoch of the sender and the receiver; see
    /// [`epoch`](super::epoch).
    pub const EPOCH: u32 = 4;
    /// The byte offset, in a slot, of the kind word with the request's kind, vector and cell; in a
    /// cell, of the [`status`](super::status).
    pub const KIND: u32 = 8;
    /// The byte offset, in a slot or cell, of the sequence number of the request, which is stored
    /// last.
    pub const SEQUENCE: u32 = 12;
    /// The size of a slot or cell, in bytes.
    pub const BYTES: u32 = 16;
}

/// Returns the epoch of the requests from a sender in incarnation `sender` to a receiver in
/// incarnation `receiver`: a number, never 0, that marks these requests. Requests with another
/// epoch are ignored.
#[must_use]
pub const fn epoch(sender: u32, receiver: u32) -> u32 {
    let mixed = sender
        .wrapping_mul(0x9E37_79B1)
        .wrapping_add(receiver.wrapping_mul(0x85EB_CA77));
    if mixed == 0 { 1 } else { mixed }
}
