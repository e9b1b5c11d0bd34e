//! [`Faulty`]: a program that ends by a trap.

use core::arch::asm;

use condor_rt::{Error, Machine, Program};

/// Joins, as any program does, and then does what its first argument says: `illegal`, `access`,
/// `misaligned`, `stack` or `spin`, for ever.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Faulty;

impl Program for Faulty {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), Error> {
        drills::joined(machine, || match machine.argument(0) {
            // SAFETY: the monitor takes the hart back.
            Some("illegal") => unsafe { asm!("unimp") },
            // SAFETY: nothing is there, and the monitor takes the hart back.
            Some("access") => unsafe { asm!("ld zero, 0(zero)") },
            // SAFETY: nothing is changed before it traps, and the monitor takes the hart back.
            Some("misaligned") => unsafe {
                asm!("addi t0, sp, 1", "amoadd.w zero, zero, (t0)", out("t0") _);
            },
            Some("stack") => {
                descend(u64::MAX);
            }
            Some("spin") => loop {
                core::hint::spin_loop();
            },
            _ => {}
        })
    }
}

/// Goes deeper than any stack.
#[allow(unconditional_recursion, reason = "that is what it is for")]
#[inline(never)]
fn descend(level: u64) -> u64 {
    let frame = core::hint::black_box([level; 64]);
    descend(frame.first().copied().unwrap_or(0).wrapping_sub(1)) ^ core::hint::black_box(frame)[0]
}
