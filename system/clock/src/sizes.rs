//! Sizes, which a program for any processor can name: also one that lays out memory for another.

/// The number of lines of a page, one for each participant: the greatest number of participants.
pub const LINES: usize = 32;
/// The number of bytes of a page, which is aligned to 64 bytes.
pub const PAGE_BYTES: u32 = 64 + 64 * LINES as u32;
/// The greatest number of loops of a processor for which a computing time can be declared.
pub const LOOPS: usize = 8;
