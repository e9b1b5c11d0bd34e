//! How deep the stack of a program was.

use condor_host::harts::map::STACK_BYTES;

use crate::hart::Hart;
use crate::machine::RAM;

/// Bytes of a stack.
pub const BYTES: u32 = STACK_BYTES;
/// What lies where the stack has not been.
pub const PAINT: u64 = 0xc0de_d00d_5eed_f00d;

/// The most bytes of its stack that the program of `hart`, which runs this, has used since it began or
/// since [`paint`].
#[must_use]
pub fn deepest(hart: &Hart) -> u32 {
    let end = end(hart);
    let words = STACK_BYTES as usize / 8;
    let begin = end.wrapping_sub(STACK_BYTES as usize) as *const u64;
    // SAFETY: the stack of this hart is there, and what the program uses of it is not read but counted:
    // reading stops at the first word that is not paint.
    let painted =
        (0..words).take_while(|&word| unsafe { begin.add(word).read_volatile() } == PAINT);
    STACK_BYTES - 8 * painted.count() as u32
}

/// Paints what is below the frames that are in use, but for some bytes that this call needs itself.
pub fn paint(hart: &Hart) {
    let marker = 0_u64;
    let most = core::ptr::from_ref(&marker) as usize - 512;
    let mut at = end(hart).wrapping_sub(STACK_BYTES as usize);
    while at < most {
        // SAFETY: it lies in the stack of this hart, below all frames: an interrupt's come and go.
        unsafe { (at as *mut u64).write_volatile(PAINT) };
        at += 8;
    }
}

/// How many bytes are in use where this is called.
#[must_use]
pub fn used(hart: &Hart) -> u32 {
    let marker = 0_u64;
    (end(hart).wrapping_sub(core::ptr::from_ref(&marker) as usize)) as u32
}

fn end(hart: &Hart) -> usize {
    RAM.wrapping_add(hart.map().stack_end(hart.hart()) as usize)
}
