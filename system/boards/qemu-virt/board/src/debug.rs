//! The debugger's stub on a hart: traps come here from `trap.s`, with all registers in the frame.

use core::arch::asm;
use core::cell::UnsafeCell;
use core::ops::Range;

use condor_debug::{Arch, Stub, TrapOutcome, Trigger, TriggerAccess};
use qemu_virt_host::{Map, map};
use riscv::register::{mhartid, mie};

use crate::machine::{RAM, cause};
use crate::memory::{LEAST_BYTES, memory};
use crate::msip::{HARTS, ring_hart};
use crate::trap::{self, BREAKPOINT, C_EBREAK, STACK_BYTES, control, stub};
use crate::triggers;

/// `ebreak`, and the bits that say that an instruction has 32 bits.
const EBREAK: [u16; 2] = [0x0073, 0x0010];
const LONG: u16 = 0b11;
/// The place of the program counter in the frame, in words of 64 bits.
const PC: usize = 31;

/// A place for each hart, whatever image it runs: the monitor is one for all.
#[repr(C, align(16))]
struct Stacks(UnsafeCell<[u8; HARTS * STACK_BYTES]>);

// SAFETY: each hart uses its own part, as the stack of its trap handler alone.
unsafe impl Sync for Stacks {}

#[unsafe(export_name = "condor_debug_stacks")]
static STACKS: Stacks = Stacks(UnsafeCell::new([0; HARTS * STACK_BYTES]));

unsafe extern "C" {
    /// The trap entry, up to its end.
    static condor_trap_entry: u8;
    static condor_trap_end: u8;
}

/// Forgets what a debugger wanted of the former program of this hart.
pub(crate) fn forget(hart: u32) {
    let area = control(hart as usize).and_then(|control| control.debug_area());
    if let Some((area, this)) = area.ok().zip(ThisHart::new(hart as usize)) {
        // The page of the hart is there.
        let _ = Stub::new(area).begin(&this);
    }
}

/// Stops the program that begins, if a debugger wants it.
pub(crate) fn start(hart: u32) {
    let hart = hart as usize;
    let holds = stub(hart).and_then(|stub| stub.start(&ThisHart::new(hart)?).ok());
    if holds == Some(true) {
        // SAFETY: the stub holds the program and lets it go on behind; without a debugger it ends.
        unsafe { asm!("ebreak") };
    }
}

/// Exceptions, and interrupts in which the debugger has called, come here from `trap.s`, with interrupts masked.
/// Returns true if the program goes on, with the registers of the frame.
///
/// Breakpoints in what runs from here on do not stop it: `trap.s` lifts them. What it has saved is in its
/// arguments, since that changes a register such as `mcause`.
#[unsafe(no_mangle)]
extern "C" fn condor_exception(cause: usize, pc: usize) -> bool {
    let hart = mhartid::read();
    let (Some(stub), Some(this)) = (stub(hart), ThisHart::new(hart)) else {
        return false;
    };
    let enabled = mie::read();
    let outcome = if cause == cause::SOFTWARE {
        stub.obey(&this).map(|()| TrapOutcome::Resume)
    } else {
        stub.exception(&this, (cause == BREAKPOINT).then_some(pc as u64))
    };
    // SAFETY: as the program had it.
    unsafe { mie::write(enabled) };
    // A ring that came meanwhile was for the program, too.
    ring_hart(hart);
    match outcome {
        Ok(TrapOutcome::Resume) => true,
        Ok(TrapOutcome::ResumeBehind) => {
            go_behind(hart, pc);
            true
        }
        Ok(TrapOutcome::Fatal) | Err(_) => false,
    }
}

/// Has the program go on behind the breakpoint at `pc`, if it is to go on there.
fn go_behind(hart: usize, pc: usize) {
    let frame = RAM + (Map::control(hart as u32) + map::BOARD) as usize;
    let place = (frame + 8 * PC) as *mut usize;
    // SAFETY: the frame of this hart is there.
    unsafe {
        if place.read_volatile() == pc {
            let long = (pc as *const u16).read_volatile() & LONG == LONG;
            place.write_volatile(pc.wrapping_add(if long { 4 } else { 2 }));
        }
    }
}

/// This hart, as its stub uses it.
struct ThisHart {
    /// The addresses of its program.
    program: Range<u64>,
}

impl ThisHart {
    fn new(hart: usize) -> Option<Self> {
        let map = Map::read(&memory(LEAST_BYTES)).ok()?;
        let begin = RAM as u64 + u64::from(map.programs.at(hart as u32));
        let end = begin.saturating_add(map.program_bytes().into());
        Some(Self {
            program: begin..end,
        })
    }

    /// The place of half an instruction at an address, where a breakpoint can be.
    fn place(&self, address: u64) -> Option<*mut u16> {
        let can_be = address.is_multiple_of(2)
            && self.program.contains(&address)
            && !self.closed().contains(&address);
        can_be.then_some(address as *mut u16)
    }
}

impl Arch for ThisHart {
    /// The trap entry.
    fn closed(&self) -> Range<u64> {
        (&raw const condor_trap_entry) as u64..(&raw const condor_trap_end) as u64
    }

    fn original(&self, address: u64) -> Option<u32> {
        // SAFETY: it lies in the program of this hart, and is aligned.
        self.place(address)
            .map(|place| u32::from(unsafe { place.read_volatile() }))
    }

    /// The short breakpoint, which replaces the first half of a longer instruction.
    fn plant(&self, address: u64) {
        self.restore(address, C_EBREAK.into());
    }

    fn restore(&self, address: u64, original: u32) {
        if let Some(place) = self.place(address) {
            // SAFETY: as above; the program is the debugger's to change.
            unsafe { place.write_volatile(original as u16) };
        }
    }

    fn is_breakpoint(&self, address: u64) -> bool {
        if !address.is_multiple_of(2) || !self.program.contains(&address) {
            return false;
        }
        let place = address as *const u16;
        // SAFETY: it lies in the program of this hart, and the half behind it in its range.
        let halves = unsafe { [place.read_volatile(), place.wrapping_add(1).read_volatile()] };
        halves == EBREAK || halves[0] == C_EBREAK
    }

    fn arm(&self, trigger: Trigger) -> bool {
        // Instructions of the trap entry itself cannot be stopped.
        let can_be =
            trigger.access != TriggerAccess::Execute || self.place(trigger.address).is_some();
        can_be && triggers::arm(trigger)
    }

    fn disarm(&self, trigger: Trigger) {
        triggers::disarm(trigger);
    }

    fn synchronize(&self) {
        // SAFETY: it changes nothing but what is fetched.
        unsafe { asm!("fence.i", options(nostack)) };
    }

    fn wait(&self) {
        // SAFETY: interrupts are masked, so that these only end the wait; `condor_exception` restores
        // what the program had.
        unsafe {
            asm!("csrw mie, {}", in(reg) trap::AWAITED, options(nostack));
        }
        riscv::asm::wfi();
        trap::heed(mhartid::read());
        trap::poll_line();
    }
}
