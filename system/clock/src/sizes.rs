//! Sizes, which a program for any processor can name: also one that lays out memory for another.

/// The greatest number of participants of one simulated time. The page has one line for each.
pub const LINES: usize = 32;
/// The number of bytes of a page, which must begin at an address that is a multiple of 64.
pub const PAGE_BYTES: u32 = 64 + 64 * LINES as u32;
/// The greatest number of loops of a processor for which a duration in simulated time can be
/// declared.
pub const LOOPS: usize = 8;
