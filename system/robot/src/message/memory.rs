//! The private memory through which the two parts of a servo object pass states to each other.

use condor_hand::servo::{JointTarget, ServoMode, ServoRefusal};
use condor_mbox::published::PublishedReadError;
use condor_mbox::{Published, Region, StaticMemory, StaticWindow};
use serde::{Deserialize, Serialize};

use super::ServoStatus;
use crate::packet::Packet;

/// The memory of one finger that both ends share.
#[derive(Debug)]
pub(super) struct FingerMemory<const N: usize> {
    words: StaticMemory<16>,
    report: StaticMemory<REPORT_WORDS>,
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

/// The last report of the loop about a finger.
pub(super) type Report<const N: usize> = Packet<ServoStatus<N>, 0, REPORT_BYTES>;
/// The last order to a joint.
pub(super) type Order = Packet<JointOrder, 0, 48>;
/// The outcome of an order.
pub(super) type Outcome = Packet<JointOutcome, 0, 48>;

const REPORT_BYTES: usize = 112;
const REPORT_WORDS: usize = Published::<Packet<(), 0, REPORT_BYTES>>::BYTES as usize / 4;

/// An order to a joint. Number 0 is that of none.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct JointOrder {
    pub(super) number: u32,
    pub(super) drive: JointDrive,
}

/// The change of a joint for which an order asks.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) enum JointDrive {
    Mode(ServoMode),
    Target(JointTarget),
    /// The effort of an actuator of the joint, N or N m.
    Effort {
        actuator: u32,
        effort: f64,
    },
}

/// The outcome of an order in the loop.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct JointOutcome {
    pub(super) number: u32,
    pub(super) refusal: Option<ServoRefusal>,
}

impl JointOrder {
    pub(super) const NONE: Self = Self {
        number: 0,
        drive: JointDrive::Mode(ServoMode::Off),
    };
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

impl JointOutcome {
    pub(super) const NONE: Self = Self {
        number: 0,
        refusal: None,
    };
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

    pub(super) fn report(&self) -> (Published<Report<N>>, StaticWindow<'_>) {
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

    /// The last order; `None` while it cannot be read whole.
    pub(super) fn last_order(&self) -> Option<JointOrder> {
        let (cell, window) = self.order();
        match cell.subscriber(window).ok()?.read() {
            Ok(latest) => latest.value.value().ok(),
            Err(PublishedReadError::Unpublished) => Some(JointOrder::NONE),
            Err(_) => None,
        }
    }
}
