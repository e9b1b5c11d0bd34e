//! The work of the follower between messages.

use core::time::Duration;

use condor_mbox::{AccessError, Messenger as _};
use firmware::Checks;

use crate::map::MAP;
use crate::memory::count_up;
use crate::resident::{NOTE, Resident, TICK};
use crate::{FOLLOWER, LEADER, Mail, served_until};

/// An order of the leader to the follower.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Order {
    /// Serve while waiting, and do nothing else.
    Serve,
    /// Take [turns](turn) and look for messages in between.
    Poll,
    /// Take turns and send; the mailbox interrupt serves.
    Interrupts,
}

/// Returns the present order of the leader.
pub(crate) fn order(resident: &Resident) -> Order {
    let word = resident.ram.word(MAP.order);
    let orders = [Order::Serve, Order::Poll, Order::Interrupts];
    // Memory that is gone orders nothing more.
    let order = orders.into_iter().find(|order| word == Ok(*order as u32));
    order.unwrap_or(Order::Serve)
}

/// Tells the leader that `order` is obeyed.
pub(crate) fn obey(resident: &Resident, order: Order) {
    // If the memory is gone, nobody reads it.
    let _ = resident.ram.set_word(MAP.obeyed, order as u32 + 1);
}

/// Sends an order and waits until it is obeyed.
pub(crate) fn give(checks: &mut Checks, mailbox: &Mail<'_>, order: Order) {
    let Ok(ram) = mailbox.region(FOLLOWER) else {
        return checks.that(false);
    };
    checks.same(ram.set_word(MAP.order, order as u32), Ok(()));
    // A follower that waits for messages looks for orders after each; one that does not take
    // this one now looks anyway.
    let _ = mailbox.send(FOLLOWER, NOTE, 0, Duration::ZERO);
    let obeyed = served_until(mailbox, || ram.word(MAP.obeyed) == Ok(order as u32 + 1));
    checks.that(obeyed);
}

/// The number of turns before the follower sends again: the leader has more to do than to serve.
const TURNS_PER_TICK: u32 = 64;

/// Makes one pass of the follower's background: counts under the lock, publishes and, if the mailbox interrupt
/// serves, sends. Never waits.
///
/// # Errors
/// Returns an [`AccessError`] if the memory is gone.
pub(crate) fn turn(mailbox: &Mail<'_>, resident: &Resident) -> Result<(), AccessError> {
    if let Ok(ram) = mailbox.region(FOLLOWER) {
        count_up(mailbox, ram, Duration::ZERO)?;
    }
    let mut publisher = MAP.sample.publisher(&resident.ram)?;
    let next = publisher.publish(&[0; 6])?;
    publisher.publish(&[next; 6])?;
    if order(resident) == Order::Interrupts && next % TURNS_PER_TICK < 2 {
        // In the middle of this the mailbox interrupt may come; a full ring is left alone.
        let _ = mailbox.send(LEADER, TICK, next, Duration::ZERO);
    }
    Ok(())
}
