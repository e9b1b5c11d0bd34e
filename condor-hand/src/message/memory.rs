//! The private memory through which the two parts of a servo object pass states to each other.

use condor_mbox::{Published, Region, StaticMemory, StaticWindow};

use super::refusal;
use super::status::Report;

/// The memory of one finger that both ends share.
#[derive(Debug)]
pub(super) struct FingerMemory<const N: usize> {
    words: StaticMemory<16>,
    report: StaticMemory<{ Published::<Report>::BYTES as usize / 4 }>,
    pub(super) joints: [JointMemory; N],
    /// The number of joints that the finger has; the places after them are empty.
    pub(super) count: usize,
}

/// The memory of one joint that both ends share.
#[derive(Debug)]
pub(super) struct JointMemory {
    order: StaticMemory<{ Published::<Order>::BYTES as usize / 4 }>,
    outcome: StaticMemory<{ Published::<Outcome>::BYTES as usize / 4 }>,
}

/// The order to a joint: its number, a [`kind`], mode and three numbers.
pub(super) type Order = [u32; 9];

/// The outcome of an order: the number of the order and a refusal.
pub(super) type Outcome = [u32; 1 + refusal::WORDS];

/// The kinds of a joint's orders.
pub(super) mod kind {
    pub(in super::super) const MODE: u32 = 1;
    pub(in super::super) const TARGET: u32 = 2;
}

/// Words of a finger, by byte offset.
pub(super) mod word {
    /// The number of the last order; stored after all that belongs to it.
    pub(in super::super) const ORDERS: u32 = 0;
    /// The number of restarts that were asked for.
    pub(in super::super) const RESTARTS: u32 = 4;
    /// The ticks of the loop.
    pub(in super::super) const TICKS: u32 = 8;
}

impl<const N: usize> FingerMemory<N> {
    pub(super) const fn new() -> Self {
        Self {
            words: StaticMemory::new(),
            report: StaticMemory::new(),
            joints: [const { JointMemory::new() }; N],
            count: N,
        }
    }

    pub(super) fn words(&self) -> Region<StaticWindow<'_>> {
        Region::whole(self.words.window())
    }

    pub(super) fn report(&self) -> (Published<Report>, StaticWindow<'_>) {
        (Published::at(0), self.report.window())
    }
}

impl JointMemory {
    const fn new() -> Self {
        Self {
            order: StaticMemory::new(),
            outcome: StaticMemory::new(),
        }
    }

    pub(super) fn order(&self) -> (Published<Order>, StaticWindow<'_>) {
        (Published::at(0), self.order.window())
    }

    pub(super) fn outcome(&self) -> (Published<Outcome>, StaticWindow<'_>) {
        (Published::at(0), self.outcome.window())
    }

    /// The last order; zeros before the first. None while it cannot be read whole.
    pub(super) fn last_order(&self) -> Option<Order> {
        let (cell, window) = self.order();
        match cell.subscriber(window).ok()?.read() {
            Ok(latest) => Some(latest.value),
            Err(condor_mbox::published::PublishedReadError::Unpublished) => {
                Some([0; size_of::<Order>() / 4])
            }
            Err(_) => None,
        }
    }
}
