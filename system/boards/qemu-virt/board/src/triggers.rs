//! Triggers of the hardware: addresses whose accesses make an exception.
//!
//! Source: RISC-V Debug Specification 0.13.2, chapter 5, "Trigger Module": a trigger of type 2 compares an
//! address. All of this is done with interrupts masked, in a trap, whose `mepc` and `mstatus` are saved.

use core::arch::asm;

use condor_debug::{Trigger, TriggerAccess};

/// No hart has more.
const MOST: usize = 16;
/// The fields of `tdata1`.
const TYPE: u64 = 2 << 60;
const TYPE_MASK: u64 = 15 << 60;
const ONLY_DEBUG_MODE: u64 = 1 << 59;
/// In machine mode, at which everything runs here.
const MACHINE: u64 = 1 << 6;
const EXECUTE: u64 = 1 << 2;
const STORE: u64 = 1 << 1;
const LOAD: u64 = 1;

/// Arms a trigger that is not in use for these accesses. Returns true if there is one that can stop at
/// them.
pub(crate) fn arm(trigger: Trigger) -> bool {
    let wanted = control(trigger);
    for _ in places() {
        // SAFETY: triggers change nothing that this program counts on before they are armed.
        unsafe {
            let now = tdata1();
            if now & TYPE_MASK != TYPE || now & (EXECUTE | STORE | LOAD | ONLY_DEBUG_MODE) != 0 {
                continue;
            }
            asm!("csrw tdata2, {}", in(reg) trigger.address, options(nostack));
            set_tdata1(wanted);
            if tdata1() == wanted {
                return true;
            }
            // This trigger can only do other things.
            set_tdata1(TYPE);
        }
    }
    false
}

/// Has the trigger that was armed like this stop nothing.
pub(crate) fn disarm(trigger: Trigger) {
    let armed = control(trigger);
    for _ in places() {
        let address: u64;
        // SAFETY: it is read, and a trigger that stops nothing is what there was before.
        unsafe {
            asm!("csrr {}, tdata2", out(reg) address, options(nostack));
            if tdata1() == armed && address == trigger.address {
                set_tdata1(TYPE);
                return;
            }
        }
    }
}

/// The numbers of the triggers, each of which is selected while it is its turn.
fn places() -> impl Iterator<Item = usize> {
    let most = if are_there() { MOST } else { 0 };
    (0..most).take_while(|&place| {
        select(place);
        let selected: usize;
        // SAFETY: reads a register that is there.
        unsafe { asm!("csrr {}, tselect", out(reg) selected, options(nostack)) };
        selected == place
    })
}

fn select(place: usize) {
    // SAFETY: triggers are there, and which of them is selected means nothing by itself.
    unsafe { asm!("csrw tselect, {}", in(reg) place, options(nostack)) };
}

/// # Safety
/// Triggers are there.
unsafe fn tdata1() -> u64 {
    let value;
    // SAFETY: reads a register that is there.
    unsafe { asm!("csrr {}, tdata1", out(reg) value, options(nostack)) };
    value
}

/// # Safety
/// Triggers are there, and the program can be stopped by what it arms.
unsafe fn set_tdata1(value: u64) {
    // SAFETY: writes a register that is there.
    unsafe { asm!("csrw tdata1, {}", in(reg) value, options(nostack)) };
}

/// `tdata1` of a trigger that makes an exception before the access.
fn control(trigger: Trigger) -> u64 {
    let access = match trigger.access {
        TriggerAccess::Execute => EXECUTE,
        TriggerAccess::Write => STORE,
        TriggerAccess::Read => LOAD,
        TriggerAccess::ReadWrite => LOAD | STORE,
    };
    // An instruction is fetched in pieces of any size.
    let size = match (trigger.access, trigger.bytes) {
        (TriggerAccess::Execute, _) => 0,
        (_, 1) => 1,
        (_, 2) => 2,
        (_, 4) => 3,
        _ => 5,
    };
    TYPE | MACHINE | access | (size & 3) << 16 | (size >> 2) << 21
}

/// Whether the hart has triggers: their registers make an exception otherwise.
fn are_there() -> bool {
    let found: usize;
    // SAFETY: interrupts are masked; the exception comes to the end of this piece, and nothing needs what
    // it changes.
    unsafe {
        asm!(
            "lla {entry}, 2f",
            "csrrw {entry}, mtvec, {entry}",
            "li {found}, 0",
            "csrr {read}, tselect",
            "li {found}, 1",
            ".balign 4",
            "2: csrw mtvec, {entry}",
            entry = out(reg) _,
            read = out(reg) _,
            found = out(reg) found,
            options(nostack),
        );
    }
    found == 1
}
