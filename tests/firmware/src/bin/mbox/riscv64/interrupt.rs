//! Serving from the mailbox interrupt.

use core::ptr;
use core::sync::atomic::{AtomicPtr, AtomicU32, Ordering};
use core::time::Duration;

use condor_mbox::Messenger as _;
use riscv::interrupt::Interrupt;
use riscv::register::{mepc, mhartid, mie, mstatus};
use riscv_rt::core_interrupt;

use crate::{Mail, PROCESSORS};

/// The mailbox that each hart's interrupt serves, or null.
static MAILBOX: [AtomicPtr<Mail<'static>>; PROCESSORS] =
    [const { AtomicPtr::new(ptr::null_mut()) }; PROCESSORS];
/// The number of requests that each hart's interrupt has served.
static SERVED: [AtomicU32; PROCESSORS] = [const { AtomicU32::new(0) }; PROCESSORS];

/// Runs `body` while the mailbox interrupt of this hart serves `mailbox`.
pub(crate) fn served_by_interrupt<R>(mailbox: &Mail<'_>, body: impl FnOnce() -> R) -> R {
    let of_this_hart = MAILBOX.get(mhartid::read());
    if let Some(slot) = of_this_hart {
        // The handler runs on this hart: program order suffices.
        slot.store(ptr::from_ref(mailbox).cast_mut().cast(), Ordering::Relaxed);
        // SAFETY: the handler is below, and no critical section is in progress here.
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

/// Returns the number of requests that the interrupt of hart `hart` has served.
pub(crate) fn served_on(hart: usize) -> u32 {
    SERVED
        .get(hart)
        .map_or(0, |served| served.load(Ordering::Relaxed))
}

/// Handles the mailbox interrupt of either hart.
#[core_interrupt(Interrupt::MachineSoft)]
fn ring() {
    let hart = mhartid::read();
    let (Some(mailbox), Some(count)) = (MAILBOX.get(hart), SERVED.get(hart)) else {
        return;
    };
    // SAFETY: `served_by_interrupt`, in progress on this hart, borrows the mailbox it stored,
    // and takes it away again before it returns.
    let Some(mailbox) = (unsafe { mailbox.load(Ordering::Relaxed).as_ref() }) else {
        return;
    };
    mailbox.doorbell().acknowledge();
    let (instruction, status) = (mepc::read(), mstatus::read());
    // This interrupt outranks the timer: it masks itself alone, and lets all others in.
    // SAFETY: no critical section is in progress: an interrupt came.
    unsafe {
        mie::clear_msoft();
        mstatus::set_mie();
    }
    let served = mailbox.serve(Duration::ZERO).unwrap_or(0);
    // SAFETY: as the trap left it, with interrupts masked.
    unsafe {
        mstatus::write(status);
        mie::set_msoft();
        mepc::write(instruction);
    }
    count.store(
        count.load(Ordering::Relaxed).wrapping_add(served as u32),
        Ordering::Relaxed,
    );
}
