//! The interrupts in which the follower runs, nested into the leader's background.

use core::ptr;
use core::sync::atomic::{AtomicPtr, AtomicU32, Ordering};
use core::time::Duration;

use condor_mbox::{Messenger, Processor};
use cortex_m_rt::exception;

use crate::follower::{obey, order, turn};
use crate::resident::Resident;
use crate::{FOLLOWER, LEADER, Mail};

/// A processor that can be run from elsewhere.
pub(crate) struct Runnable<'r, 'v> {
    pub(crate) mailbox: &'r Mail<'v>,
    pub(crate) resident: &'r Resident,
}

static LEADER_RUNS: AtomicPtr<Runnable<'static, 'static>> = AtomicPtr::new(ptr::null_mut());
static FOLLOWER_RUNS: AtomicPtr<Runnable<'static, 'static>> = AtomicPtr::new(ptr::null_mut());
/// The number of requests that were served in interrupts.
static SERVED: AtomicU32 = AtomicU32::new(0);

/// Runs `body` while others can run `processor`.
pub(crate) fn running<R>(runnable: &Runnable<'_, '_>, body: impl FnOnce() -> R) -> R {
    let slot = if runnable.mailbox.number() == LEADER {
        &LEADER_RUNS
    } else {
        &FOLLOWER_RUNS
    };
    // One core: program order suffices.
    slot.store(ptr::from_ref(runnable).cast_mut().cast(), Ordering::Relaxed);
    let result = body();
    slot.store(ptr::null_mut(), Ordering::Relaxed);
    result
}

/// Returns the number of requests that were served in interrupts.
pub(crate) fn served() -> u32 {
    SERVED.load(Ordering::Relaxed)
}

/// Serves on behalf of the processor that is not `me`, which waits in an interrupt.
pub(crate) fn serve_other(me: Processor) {
    if me == FOLLOWER {
        with(&LEADER_RUNS, |leader| {
            // The leader was there when it was published; if its memory is gone, nothing is served.
            let _ = leader.mailbox.serve(Duration::ZERO);
        });
    } else {
        serve_follower();
    }
}

fn with(slot: &AtomicPtr<Runnable<'static, 'static>>, body: impl FnOnce(&Runnable<'_, '_>)) {
    // SAFETY: `running`, in progress on this core, borrows what it stored, and takes it away
    // again before it returns.
    if let Some(runnable) = unsafe { slot.load(Ordering::Relaxed).as_ref() } {
        body(runnable);
    }
}

fn serve_follower() {
    with(&FOLLOWER_RUNS, |follower| {
        obey(follower.resident, order(follower.resident));
        let served = follower.mailbox.serve(Duration::ZERO).unwrap_or(0);
        let sum = SERVED.load(Ordering::Relaxed).wrapping_add(served as u32);
        SERVED.store(sum, Ordering::Relaxed);
    });
}

/// Serves the follower's mailbox interrupt.
#[exception]
fn PendSV() {
    serve_follower();
}

/// Runs the follower's servo loop; it also looks for messages that came without a ring.
#[exception]
fn SysTick() {
    with(&FOLLOWER_RUNS, |follower| {
        // Memory that is gone stops the mailbox, too.
        let _ = turn(follower.mailbox, follower.resident);
    });
    serve_follower();
}
