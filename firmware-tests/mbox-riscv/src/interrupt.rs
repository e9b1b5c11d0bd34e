//! Serving from the mailbox interrupt.

use core::ptr;
use core::sync::atomic::{AtomicPtr, AtomicU32, Ordering};
use core::time::Duration;

use condor_mbox::Messenger;
use mbox_exercise::PROCESSORS;
use riscv::register::{mhartid, mie, mstatus};

use crate::machine::{print, switch_off};
use crate::{Bell, Mail};

/// The mailbox that each hart's interrupt serves, or null.
static MAILBOX: [AtomicPtr<Mail<'static>>; PROCESSORS] =
    [const { AtomicPtr::new(ptr::null_mut()) }; PROCESSORS];
/// How many requests each hart's interrupt has served.
static SERVED: [AtomicU32; PROCESSORS] = [const { AtomicU32::new(0) }; PROCESSORS];

const SOFTWARE_INTERRUPT: usize = 1 << (usize::BITS - 1) | 3;

/// Runs `body` while the mailbox interrupt of this hart serves `mailbox`.
pub(crate) fn served_by_interrupt<R>(mailbox: &Mail<'_>, body: impl FnOnce() -> R) -> R {
    let of_this_hart = MAILBOX.get(mhartid::read());
    if let Some(slot) = of_this_hart {
        // The handler runs on this hart: program order suffices.
        slot.store(ptr::from_ref(mailbox).cast_mut().cast(), Ordering::Relaxed);
        // SAFETY: the trap entry is set up, and no critical section is in progress here.
        unsafe {
            mie::set_msoft();
            mstatus::set_mie();
        }
    }
    let result = body();
    // SAFETY: masking breaks nobody's section.
    unsafe {
        mstatus::clear_mie();
        mie::clear_msoft();
    }
    if let Some(slot) = of_this_hart {
        slot.store(ptr::null_mut(), Ordering::Relaxed);
    }
    result
}

/// How many requests the interrupt of hart `hart` has served.
pub(crate) fn served_on(hart: usize) -> u32 {
    SERVED
        .get(hart)
        .map_or(0, |served| served.load(Ordering::Relaxed))
}

/// Every trap of both harts comes here, with interrupts masked.
#[unsafe(no_mangle)]
extern "C" fn trap(cause: usize) {
    if cause != SOFTWARE_INTERRUPT {
        print("an exception, or an interrupt that nobody enabled\n");
        switch_off(false);
    }
    let hart = mhartid::read();
    let (Some(mailbox), Some(count)) = (MAILBOX.get(hart), SERVED.get(hart)) else {
        return;
    };
    // SAFETY: `served_by_interrupt`, in progress on this hart, borrows the mailbox it stored,
    // and takes it away again before it returns.
    let Some(mailbox) = (unsafe { mailbox.load(Ordering::Relaxed).as_ref() }) else {
        return;
    };
    let bell: &Bell = mailbox.doorbell();
    bell.acknowledge();
    // This interrupt outranks the timer: it masks itself alone, and lets all others in. The
    // entry has saved what they change.
    // SAFETY: no critical section is in progress: an interrupt came.
    unsafe {
        mie::clear_msoft();
        mstatus::set_mie();
    }
    spoil_floating_point();
    let served = mailbox.serve(Duration::ZERO).unwrap_or(0);
    // SAFETY: as the entry left it.
    unsafe {
        mstatus::clear_mie();
        mie::set_msoft();
    }
    count.store(
        count.load(Ordering::Relaxed).wrapping_add(served as u32),
        Ordering::Relaxed,
    );
}

/// Uses registers that a handler with floating point would use.
fn spoil_floating_point() {
    // SAFETY: the registers are declared.
    unsafe {
        core::arch::asm!(
            "fcvt.d.w ft0, zero",
            "fcvt.d.w ft1, zero",
            "fcvt.d.w fa0, zero",
            "fcvt.d.w fa1, zero",
            "fcvt.d.w fa5, zero",
            out("ft0") _, out("ft1") _, out("fa0") _, out("fa1") _, out("fa5") _,
            options(nomem, nostack),
        );
    }
}
