//! The greatest depth that the stack of a program has had.
//!
//! The stack is filled with paint before the program begins, and the paint stays on the part that has not
//! been used. A frame shows only by the bytes that are written: bytes at the bottom of a frame that are
//! never written do not count, except those that only align the stack pointer.

use core::arch::asm;

use qemu_virt_host::map::STACK_BYTES;

use crate::hart::Hart;
use crate::machine::{CLINT, RAM};

/// The size of the stack of a program, in bytes.
pub const BYTES: u32 = STACK_BYTES;
/// The word with which the unused part of a stack is filled, so that the used part can be recognized.
pub const PAINT: u64 = 0xc0de_d00d_5eed_f00d;

/// The alignment of the stack pointer by the calling convention, in bytes.
const ALIGNED: u32 = 16;
/// The greatest distance to which [`taken`] looks, in bytes.
const REACH: usize = 64 * 1024;
const MTIME: usize = CLINT + 0xbff8;

/// Returns the greatest number of bytes of stack that the calling program has used since it began, or since the last
/// [`paint`]. `hart` is the calling hart.
#[must_use]
pub fn deepest(hart: &Hart) -> u32 {
    let words = STACK_BYTES as usize / 8;
    let begin = begin(hart) as *const u64;
    // SAFETY: the stack of this hart is there, and what the program uses of it is not read but counted:
    // reading stops at the first word that is not paint.
    let painted =
        (0..words).take_while(|&word| unsafe { begin.add(word).read_volatile() } == PAINT);
    (STACK_BYTES - 8 * painted.count() as u32).next_multiple_of(ALIGNED)
}

/// Fills the unused part of the calling program's stack with [`PAINT`], so that [`deepest`] counts anew. `hart` is the
/// calling hart.
#[inline(never)]
pub fn paint(hart: &Hart) {
    let begin = begin(hart);
    // An interrupt would leave its frames there.
    critical_section::with(|_| {
        // SAFETY: what lies below the stack pointer is nobody's.
        unsafe {
            asm!(
                "2:",
                "sd {paint}, 0({at})",
                "addi {at}, {at}, 8",
                "bltu {at}, sp, 2b",
                at = inout(reg) begin => _,
                paint = in(reg) PAINT,
                options(nostack),
            );
        }
    });
}

/// Measures how many bytes of stack interrupts take: idles for `ticks` ticks of `mtime` with interrupts unmasked, and
/// returns the greatest number of bytes that they took below the caller's frame. `hart` is the calling hart.
///
/// The result is exact up to 64 KiB, since the stack pointer is at the same place whenever an interrupt comes.
#[must_use]
#[inline(never)]
pub fn taken(hart: &Hart, ticks: u64) -> u32 {
    let taken: usize;
    // SAFETY: what lies below the stack pointer is nobody's, down to where the stack begins. Handlers are
    // there for what is enabled; the caller, who may have masked interrupts, has no section in progress,
    // as it calls this. Memory that handlers use is stored before.
    unsafe {
        asm!(
            "csrrci {masked}, mstatus, 8",
            "sub {low}, sp, {low}",
            "bgeu {low}, {begin}, 1f",
            "mv {low}, {begin}",
            "1:",
            "mv {at}, {low}",
            "2:",
            "sd {paint}, 0({at})",
            "addi {at}, {at}, 8",
            "bltu {at}, sp, 2b",
            "ld {at}, 0({mtime})",
            "add {until}, {until}, {at}",
            "csrsi mstatus, 8",
            "3:",
            "ld {at}, 0({mtime})",
            "bltu {at}, {until}, 3b",
            "csrci mstatus, 8",
            "mv {at}, {low}",
            "4:",
            "ld {until}, 0({at})",
            "bne {until}, {paint}, 5f",
            "addi {at}, {at}, 8",
            "bltu {at}, sp, 4b",
            "5:",
            "sub {at}, sp, {at}",
            "andi {masked}, {masked}, 8",
            "csrs mstatus, {masked}",
            masked = out(reg) _,
            low = inout(reg) REACH => _,
            begin = in(reg) begin(hart),
            at = out(reg) taken,
            until = inout(reg) ticks => _,
            mtime = in(reg) MTIME,
            paint = in(reg) PAINT,
        );
    }
    (taken as u32).next_multiple_of(ALIGNED)
}

fn begin(hart: &Hart) -> usize {
    let end = RAM.wrapping_add(hart.map().stack_end(hart.hart()) as usize);
    end.wrapping_sub(STACK_BYTES as usize)
}
