//! [`Faulty`]: a program that ends by a trap.

use core::arch::asm;
use core::hint::black_box;
use core::time::Duration;

use condor_dev::drivers::Uart16550;
use condor_dev::{Location, Switch, device_switch};
use condor_rt::{Background, Interrupts, LoopTick, Machine, Program, ProgramError, Rate, Setup};

device_switch! {
    /// A board that the program never looks for.
    struct Boards { port: Uart16550 = [Location::at(0)] }
}

/// Joins, as any program does, and then does what its first argument says: `illegal`, `access`,
/// `misaligned`, `stack`, `float`, in a servo loop, `spin`, for ever, or `interrupt`.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Faulty;

impl Program for Faulty {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        let (bus, controller) = (machine.bus(), machine.interrupt_controller());
        let switch = Switch::<_, _, _, 0>::new(bus, controller, Boards::new());
        let mut divide = |_: &mut LoopTick<'_>| {
            black_box(black_box(0.0_f64) / black_box(0.0));
        };
        let mut setup = Setup::new(machine)?;
        if machine.argument(0) == Some("float") {
            setup.servo("divide", Rate::hz(100), &mut divide);
        }
        setup
            .console()?
            .interrupts(&switch)
            .background(|background| {
                background.serve(Duration::from_millis(100))?;
                match machine.argument(0) {
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
                    Some("float") => serve(background)?,
                    Some("interrupt") => {
                        interrupt();
                        let seen = Interrupts::of(&switch, machine.unhandled_causes());
                        let ([vector, ..], causes) =
                            (seen.unhandled_vectors, seen.unhandled_causes);
                        background.print(format_args!(
                            "not handled: vector {vector}, causes {causes:#x}\r\n"
                        ));
                        serve(background)?;
                    }
                    Some("spin") => loop {
                        core::hint::spin_loop();
                    },
                    _ => {}
                }
                Ok(())
            })
    }
}

/// Serves until the program is to end.
fn serve<M: Machine>(background: &Background<'_, M>) -> Result<(), ProgramError> {
    while !background.is_stopping() {
        background.serve(Duration::from_millis(100))?;
    }
    Ok(())
}

/// Has a supervisor's software interrupt come, which nobody handles, and on hart 0 that of the clock of the
/// day, of which there is no driver: the registers are those of Goldfish's, by whose source, 11, the
/// machine's device tree says.
fn interrupt() {
    const CLOCK: usize = 0x10_1000;
    const PLIC: usize = 0x0c00_0000;
    const SOURCE: usize = 11;
    let registers = [
        (PLIC + 4 * SOURCE, 1),
        (PLIC + 0x2000, 1 << SOURCE),
        // Its interrupt enabled, and an alarm in the past: high word, low word.
        (CLOCK + 0x10, 1),
        (CLOCK + 0xc, 0),
        (CLOCK + 0x8, 1),
    ];
    for (address, value) in registers {
        // SAFETY: the machine has these registers, which have four bytes; nobody else has this context of
        // the PLIC, or is at the clock.
        unsafe { (address as *mut u32).write_volatile(value) };
    }
    // SAFETY: whoever does not handle it has it come no more.
    unsafe { asm!("csrs mie, {bit}", "csrs mip, {bit}", bit = in(reg) 2) };
}

/// Goes deeper than any stack.
#[allow(unconditional_recursion, reason = "that is what it is for")]
#[inline(never)]
fn descend(level: u64) -> u64 {
    let frame = core::hint::black_box([level; 64]);
    descend(frame.first().copied().unwrap_or(0).wrapping_sub(1)) ^ core::hint::black_box(frame)[0]
}
