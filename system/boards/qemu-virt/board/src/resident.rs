//! The part of the monitor that programs do not have: it comes up, starts programs, and is where they end.

use core::time::Duration;

use condor_mos::Timer as _;
use qemu_virt_host::map::{BOARD, GUARD_BYTES, STACK_BYTES};
use qemu_virt_host::{HartFault, Map};

use crate::machine::{RAM, SWITCH};
pub use crate::trap::Return;
use crate::{debug, hart, hooks, msip, trap};

/// The place where the trap entry saves the registers `x1` to `x31` on an exception: an offset in bytes in the hart's
/// [`Control`](qemu_virt_host::Control) page. The register `mscratch` holds the address of this place.
pub const SAVED: usize = BOARD as usize;

/// Forgets what a debugger has requested for the former program of hart `hart`, the calling one. The monitor calls this
/// when it begins.
pub fn forget_debugger(hart: u32) {
    debug::forget(hart);
}

/// Prepares the calling hart, `hart`, for a new program: removes the interrupt handlers of the former one, disarms the
/// timer, and enables the mailbox interrupt and, on hart 0, the interrupt of the serial port. If `why` is
/// [`Return::Cold`], hart 0 first resets the serial link and the interrupt controller.
///
/// Call it before anything else, with interrupts masked and the trap entry set. Interrupts are enabled when it returns.
pub fn prepare(why: Return, hart: u32) {
    if why == Return::Cold {
        trap::reset();
    }
    trap::listen();
    hooks::change(hooks::Hooks::clear);
    if let Some(clint) = hart::clint(hart as usize) {
        clint.disarm();
    }
    may_panic(hart as usize);
    trap::open();
}

/// Panics, if built to: the search for panicking paths must find this one.
fn may_panic(index: usize) {
    if cfg!(feature = "panicking") {
        let table = core::hint::black_box([0_u8; 4]);
        core::hint::black_box(table[core::hint::black_box(index)]);
    }
}

/// Makes every access of the calling hart, `hart`, to the guard bytes below its stack a fault, until the machine is
/// reset.
///
/// Source: RISC-V Privileged Architecture 1.12, section 3.7; a locked entry counts in machine mode, too.
pub fn guard_stack(map: &Map, hart: u32) {
    let guard = RAM + (map.stack_end(hart) - STACK_BYTES - GUARD_BYTES) as usize;
    // Naturally aligned power of two, locked, without any access.
    let address = guard >> 2 | (GUARD_BYTES as usize / 8 - 1);
    let configuration = 0b1001_1000_usize;
    // SAFETY: nothing of this program lies there, and the entry is one that nobody else uses.
    unsafe {
        core::arch::asm!(
            "csrw pmpaddr0, {address}",
            "csrs pmpcfg0, {configuration}",
            address = in(reg) address,
            configuration = in(reg) configuration,
        );
    }
}

/// Starts the program that the host has put into the memory of `hart`, the calling hart, on a new stack. `entry` is the
/// place of the program's first instruction, in bytes from the beginning of the RAM.
pub fn start(map: &Map, hart: u32, entry: u32) -> ! {
    let stack = RAM + map.stack_end(hart) as usize;
    renew(map, hart);
    // SAFETY: the host vouches for the program; it never comes back here, and this stack is begun anew.
    unsafe {
        core::arch::asm!(
            "csrci mstatus, 8",
            "csrw mie, zero",
            "fence",
            "fence.i",
            "jr {entry}",
            entry = in(reg) RAM + entry as usize,
            in("a0") hart,
            in("a1") stack,
            options(noreturn),
        )
    }
}

/// Stores what the host has put into this hart's range once more. An emulator that keeps translations of
/// the program before sees the stores of its harts, and not those of the host.
fn renew(map: &Map, hart: u32) {
    let begin = (RAM + map.programs.at(hart) as usize) as *mut u64;
    for place in 0..map.program_bytes() as usize / 8 {
        // SAFETY: the range is this hart's alone while it has no program, and made of whole pages.
        unsafe {
            let word = begin.add(place);
            word.write_volatile(word.read_volatile());
        }
    }
}

/// Returns the cause and the registers of the trap that ended the program of `hart`, the calling hart. Call it before
/// another trap occurs.
#[must_use]
pub fn fault(hart: u32) -> HartFault {
    let saved = (RAM + Map::control(hart) as usize + SAVED) as *const u64;
    // SAFETY: the trap entry of this hart has saved them there, and nobody else knows the place.
    let word = |place| unsafe { saved.add(place).read_volatile() };
    let [pc, status, cause, value] = [31, 32, 33, 34].map(word);
    HartFault {
        cause,
        pc,
        value,
        status,
        registers: core::array::from_fn(word),
    }
}

/// Waits until another processor rings the doorbell of `hart`, the calling hart, but for at most 100 ms. This also
/// works while the memory has no map.
pub fn nap(hart: u32) {
    use condor_mbox::{Clock as _, Doorbell as _};
    if let Some(bell) = msip::of(hart as usize) {
        bell.wait(
            bell.prepare(),
            bell.now().after(Duration::from_millis(100)),
            None,
        );
    }
}

/// Switches the machine off, which ends QEMU with exit status 0 if `success` is true, otherwise 1.
pub fn switch_off(success: bool) -> ! {
    let word: u32 = if success { 0x5555 } else { 0x3333 | 1 << 16 };
    loop {
        // SAFETY: the machine has its switch there.
        unsafe { (SWITCH as *mut u32).write_volatile(word) };
    }
}
