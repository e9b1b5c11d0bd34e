//! The beginning and the end of a program.

use condor_rt::ProgramError;

use crate::hart::Hart;
use crate::resident::{self, Return};
use crate::{debug, trap};

/// Makes a function the program of this image. The function gets the [`Hart`](crate::Hart) and
/// returns a status, which is 0 for success.
#[macro_export]
macro_rules! program {
    ($main:path) => {
        /// The first instructions: `a0` is the hart, `a1` where its stack ends. The monitor has masked
        /// interrupts, and `mscratch` is set. Floating point is made on and initial, and the stack
        /// painted, to see later how deep it was.
        #[unsafe(naked)]
        #[unsafe(no_mangle)]
        #[unsafe(link_section = ".init")]
        extern "C" fn _start() -> ! {
            core::arch::naked_asm!(
                ".option push",
                ".option norelax",
                "lla gp, __global_pointer$",
                ".option pop",
                "mv sp, a1",
                "li t0, 0x6000",
                "csrs mstatus, t0",
                "csrw fcsr, zero",
                "li t0, 0x4000",
                "csrc mstatus, t0",
                "lla t0, condor_trap_entry",
                "addi t0, t0, 1",
                "csrw mtvec, t0",
                "li t0, {stack_bytes}",
                "sub t0, sp, t0",
                "li t1, {paint}",
                "2:",
                "sd t1, 0(t0)",
                "addi t0, t0, 8",
                "bltu t0, sp, 2b",
                "tail condor_program",
                stack_bytes = const $crate::stack::BYTES,
                paint = const $crate::stack::PAINT,
            )
        }

        /// Where the hart comes from its first instructions.
        #[unsafe(no_mangle)]
        extern "C" fn condor_program(hart: u32) -> ! {
            $crate::start(hart, $main)
        }
    };
}

/// Runs `main` on the calling hart, whose index is `hart`, and then goes back to the monitor with the status that
/// `main` returns, 0 for success. [`program!`](crate::program!) makes the call.
pub fn start(hart: u32, main: fn(Hart) -> u32) -> ! {
    resident::prepare(Return::Ended, hart);
    debug::start(hart);
    // Without, the monitor says that it has failed.
    if let Some(hart) = Hart::new(hart) {
        hart.forget_boards();
        let control = hart.control().clone();
        // The page of the hart is there.
        let _ = control.end(main(hart));
    }
    trap::leave(Return::Ended)
}

/// Returns the status with which a program must end after `outcome`: 0 for success, otherwise [the status of the
/// error](condor_rt::Error::exit_status). On failure it also stores the text of the error, which the host writes to its
/// log.
#[must_use]
pub fn status(outcome: &Result<(), ProgramError>, hart: &Hart) -> u32 {
    let Err(error) = outcome else { return 0 };
    hart.leave(error);
    error.exit_status().into()
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    condor_firmware_panicked()
}

/// The name that is searched for in the linked image: it is there only if something can panic.
#[unsafe(no_mangle)]
#[inline(never)]
extern "C" fn condor_firmware_panicked() -> ! {
    // SAFETY: an illegal instruction, which the monitor reports.
    unsafe { core::arch::asm!("unimp", options(noreturn)) }
}
