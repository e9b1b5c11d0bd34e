//! [`Interrupts`]: what became of the interrupts of a machine.

use core::mem::offset_of;

use condor_dev::{InterruptCounts, Vector};
use condor_vars::{Described, Field, Kind};
use zerocopy::{FromBytes, Immutable, IntoBytes};

/// How many vectors without a driver are named.
const NAMED: usize = 8;
/// No vector.
const NONE: i32 = -1;

/// What became of the interrupts of a machine so far, but for those of its timer and of its mailbox. Counts
/// wrap. A program that [`Setup`](crate::Setup) makes shows it as `interrupts`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct Interrupts {
    /// A board had asked and was served.
    pub served: u32,
    /// There was nothing to claim.
    pub spurious: u32,
    /// None of the boards of the vector had asked.
    pub unclaimed: u32,
    /// No board has the vector.
    pub unhandled: u32,
    /// Vectors that were disabled because they would not end.
    pub stuck: u32,
    /// The first vectors that no board has; -1 where there is none.
    pub unhandled_vectors: [i32; NAMED],
    /// Causes for which the processor has no handler, as the bits of their numbers; they are disabled.
    pub unhandled_causes: u32,
}

impl Interrupts {
    /// What a [`Switch`](condor_dev::Switch) counts, and its vectors that no board has.
    #[must_use]
    pub fn new(
        counts: InterruptCounts,
        unhandled: &mut dyn Iterator<Item = (Vector, u32)>,
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

impl Described for Interrupts {
    const FIELDS: &'static [Field] = &[
        Field::new("served", "", Kind::U32, offset_of!(Self, served)),
        Field::new("spurious", "", Kind::U32, offset_of!(Self, spurious)),
        Field::new("unclaimed", "", Kind::U32, offset_of!(Self, unclaimed)),
        Field::new("unhandled", "", Kind::U32, offset_of!(Self, unhandled)),
        Field::new("stuck", "", Kind::U32, offset_of!(Self, stuck)),
        Field::new(
            "unhandled_vector",
            "",
            Kind::I32,
            offset_of!(Self, unhandled_vectors),
        )
        .repeated(NAMED)
        .about("-1 is none."),
        Field::new(
            "unhandled_causes",
            "",
            Kind::U32,
            offset_of!(Self, unhandled_causes),
        )
        .about("Bits of the numbers of causes."),
    ];
}
