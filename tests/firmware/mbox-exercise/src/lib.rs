//! Uses every call of `condor-mbox` that runs without an operating system, over any
//! doorbell.
//!
//! Two processors take part. The *leader* makes the checks. The *follower* has nothing else to
//! do than to obey: it serves, or does not, as the leader's [`Order`] says, which is a word in
//! the follower's `data`. Both are [residents](Resident) with the same vectors.
#![no_std]

#[cfg(feature = "conformance")]
mod conformance;
mod follower;
mod locks;
mod map;
mod memory;
mod messages;
mod resident;
mod states;

pub use ::checks::Checks;
#[cfg(feature = "conformance")]
pub use conformance::{doorbell, memories};
pub use follower::{Order, turn};
use map::{Window, windows};
pub use memory::memory;
pub use messages::messages;
pub use resident::{Resident, reside};
pub use states::{first_incarnation, give, last_order, second_incarnation};

use condor_mbox::{CriticalSection, Mailbox, Processor};
use core::time::Duration;

/// The processors of the system.
pub const PROCESSORS: usize = 2;
/// The processor that makes the checks.
pub const LEADER: Processor = Processor(0);
/// The processor that obeys orders.
pub const FOLLOWER: Processor = Processor(1);

/// The mailbox of either.
pub type Mbox<'v, D> = Mailbox<'v, (Window, D, CriticalSection), PROCESSORS>;

/// Nothing here takes as long, unless something is broken.
const PATIENCE: Duration = Duration::from_secs(20);
