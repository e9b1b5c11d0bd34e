//! [`Interrupts`]: counts of a machine's interrupts.

use condor_dev::{InterruptCounts, InterruptVector};
use condor_vars::cell_struct;
use zerocopy::{FromBytes, Immutable, IntoBytes};

/// The greatest number of vectors without a driver that are named.
const NAMED: usize = 8;
/// No vector.
const NONE: i32 = -1;

/// Counts of the interrupts that a machine's boards raised. Interrupts of the machine's timer and
/// of its mailbox are not counted. The counts wrap.
///
/// On a machine whose boards can interrupt, a program that [`Setup`](crate::Setup) makes publishes
/// these counts in a cell called `interrupts`, which other programs can read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct Interrupts {
    /// The number of interrupts that a board had raised and that were served.
    pub served: u32,
    /// The number of interrupts after which the controller had no vector to claim.
    pub spurious: u32,
    /// The number of interrupts of a vector for which all boards said that they had not raised one.
    pub unclaimed: u32,
    /// The number of interrupts of a vector that belongs to no board.
    pub unhandled: u32,
    /// The number of vectors that were disabled because their interrupt stayed pending.
    pub stuck: u32,
    /// The numbers of the first vectors that interrupted and belong to no board; unused elements
    /// are -1.
    pub unhandled_vectors: [i32; NAMED],
    /// The set of causes of traps for which the processor has no handler, and which are now
    /// disabled: bit *n* stands for cause *n*.
    pub unhandled_causes: u32,
}

impl Interrupts {
    /// Makes the record from `counts`, the counts of a [`Switch`](condor_dev::Switch), and from
    /// `unhandled`, the vectors that interrupted and belong to no board. Keeps the first 8 of these
    /// vectors, without their counts. `unhandled_causes` begins as 0.
    #[must_use]
    pub fn new(
        counts: InterruptCounts,
        unhandled: &mut dyn Iterator<Item = (InterruptVector, u32)>,
    ) -> Self {
        let mut unhandled_vectors = [NONE; NAMED];
        for (place, (vector, _)) in unhandled_vectors.iter_mut().zip(unhandled) {
            *place = vector.0.into();
        }
        Self {
            served: counts.served,
            spurious: counts.spurious,
            unclaimed: counts.unclaimed,
            unhandled: counts.unhandled,
            stuck: counts.stuck,
            unhandled_vectors,
            unhandled_causes: 0,
        }
    }
}

cell_struct!(Interrupts {
    "served": served, "";
    "spurious": spurious, "";
    "unclaimed": unclaimed, "";
    "unhandled": unhandled, "";
    "stuck": stuck, "";
    "unhandled_vector": unhandled_vectors, "", "-1 is none.";
    "unhandled_causes": unhandled_causes, "", "Bits of the numbers of causes.";
});
