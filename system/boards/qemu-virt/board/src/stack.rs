//! The greatest depth that the stack of a program has had.
//!
//! The stack is filled with paint before the program begins, and the paint stays on the part that has not
//! been used. A frame shows only by the bytes that are written: bytes at the bottom of a frame that are
//! never written do not count, except those that only align the stack pointer.

use qemu_virt_host::map::STACK_BYTES;

use crate::hart::Hart;
use crate::machine::RAM;

/// The size of the stack of a program, in bytes.
pub const BYTES: u32 = STACK_BYTES;
/// The word with which the unused part of a stack is filled, so that the used part can be recognized.
pub const PAINT: u64 = 0xc0de_d00d_5eed_f00d;

/// The alignment of the stack pointer by the calling convention, in bytes.
const ALIGNED: u32 = 16;

/// Returns the greatest number of bytes of stack that the calling program has used since it began. `hart` is the
/// calling hart.
#[must_use]
pub fn deepest(hart: &Hart) -> u32 {
    let words = STACK_BYTES as usize / 8;
    let end = RAM.wrapping_add(hart.map().stack_end(hart.hart()) as usize);
    let begin = end.wrapping_sub(STACK_BYTES as usize) as *const u64;
    // SAFETY: the stack of this hart is there, and what the program uses of it is not read but counted:
    // reading stops at the first word that is not paint.
    let painted =
        (0..words).take_while(|&word| unsafe { begin.add(word).read_volatile() } == PAINT);
    (STACK_BYTES - 8 * painted.count() as u32).next_multiple_of(ALIGNED)
}
