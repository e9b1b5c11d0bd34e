//! The work of the follower between messages.

use core::time::Duration;

use condor_mbox::{AccessError, Doorbell, Messenger};

use crate::map::MAP;
use crate::memory::count_some;
use crate::resident::{Resident, TICK};
use crate::{LEADER, Mbox};

/// An order of the leader to the follower.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Serve while waiting, and do nothing else.
    Serve,
    /// Take [turns](turn) and look for messages in between.
    Poll,
    /// Serve nothing.
    Hold,
    /// Compute and send; the mailbox interrupt serves.
    Interrupts,
    /// End without leaving the system.
    Stop,
}

impl Order {
    const ALL: [Self; 5] = [
        Self::Serve,
        Self::Poll,
        Self::Hold,
        Self::Interrupts,
        Self::Stop,
    ];
}

impl Resident {
    /// Returns the present order of the leader; [`Order::Stop`] if the memory is gone.
    #[must_use]
    pub fn order(&self) -> Order {
        let word = self.ram.word(MAP.order);
        let mut orders = Order::ALL.into_iter();
        // Memory that is gone orders nothing more.
        orders
            .find(|order| word == Ok(*order as u32))
            .unwrap_or(Order::Stop)
    }

    /// Tells the leader that `order` is obeyed.
    pub fn obey(&self, order: Order) {
        // If the memory is gone, nobody reads it.
        let _ = self.ram.set_word(MAP.obeyed, order as u32);
    }
}

/// The number of turns before the follower sends again: the leader has more to do than to serve.
const TURNS_PER_TICK: u32 = 64;

/// Makes one pass of the follower's background: publishes, counts under the lock and, if the mailbox
/// interrupt serves, sends. Never waits.
///
/// # Errors
/// Returns an [`AccessError`] if the memory is gone.
pub fn turn<D: Doorbell>(mailbox: &Mbox<'_, D>, resident: &Resident) -> Result<(), AccessError> {
    count_some(mailbox)?;
    let mut publisher = MAP.sample.publisher(&resident.ram)?;
    let sample = resident.ram.word(MAP.obeyed)?;
    let next = publisher.publish(&[sample; 6])?;
    publisher.publish(&[next; 6])?;
    if resident.order() == Order::Interrupts && next % TURNS_PER_TICK < 2 {
        // In the middle of this the mailbox interrupt may come; a full ring is left alone.
        let _ = mailbox.send(LEADER, TICK, next, Duration::ZERO);
    }
    Ok(())
}
