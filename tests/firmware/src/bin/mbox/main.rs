//! `condor-mbox`: two processors send each other messages, on two harts or in one core.
//!
//! The *leader* makes the checks. The *follower* has nothing else to do than to obey: it serves as the leader's
//! [`Order`](follower::Order) says, which is a word in the follower's `data`. Both are
//! [residents](resident::Resident) with the same vectors.
#![no_std]
#![no_main]

#[cfg(target_arch = "arm")]
mod arm;
#[cfg(target_arch = "arm")]
mod bell;
#[cfg(feature = "conformance")]
mod conformance;
mod follower;
mod kept;
mod map;
mod memory;
mod messages;
mod resident;
#[cfg(target_arch = "riscv64")]
mod riscv64;

use core::time::Duration;

#[cfg(target_arch = "arm")]
use bell::Bell;
use condor_mbox::{Clock as _, CriticalSection, Mailbox, Messenger as _, Processor};

/// The processors of the system.
const PROCESSORS: usize = 2;
/// The processor that makes the checks.
const LEADER: Processor = Processor(0);
/// The processor that obeys orders.
const FOLLOWER: Processor = Processor(1);

/// The doorbell of a hart.
#[cfg(target_arch = "riscv64")]
type Bell = &'static condor_mbox::riscv::MsipDoorbell<PROCESSORS>;
/// The memory of either.
type Window = condor_mbox::StaticWindow<'static>;
/// The mailbox of either. The critical section masks its own core alone: nothing that it guards is shared with
/// another one.
type Mail<'v> = Mailbox<'v, (Window, Bell, CriticalSection), PROCESSORS>;

/// Nothing here takes as long, unless something is broken.
const PATIENCE: Duration = Duration::from_secs(20);

/// Serves until `done`, or for too long; returns true if it is done.
fn served_until(mailbox: &Mail<'_>, mut done: impl FnMut() -> bool) -> bool {
    let deadline = mailbox.doorbell().now().after(PATIENCE);
    while !done() {
        if mailbox.doorbell().now() >= deadline || mailbox.serve(Duration::from_millis(1)).is_err()
        {
            return done();
        }
    }
    true
}
