//! [`Interrupts`]: what became of the interrupts of a program's boards.

use condor_dev::{InterruptEntry, InterruptVector};
use condor_vars::cell_struct;
use zerocopy::{FromBytes, Immutable, IntoBytes};

/// The greatest number of vectors that are named.
const NAMED: usize = 8;
/// No vector.
const NONE: i32 = -1;

/// Counts of the interrupts that a program's boards raised. Interrupts of the machine's timer and
/// of its mailbox are not counted. The counts wrap.
///
/// A program with [`Setup::interrupts`](crate::Setup::interrupts) publishes these counts in a cell
/// called `interrupts`, which other programs can read.
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
    /// The number of times that a vector was disabled because its interrupts did not end.
    pub stuck: u32,
    /// The numbers of the first vectors that interrupted and belong to no board; unused elements
    /// are -1.
    pub unhandled_vectors: [i32; NAMED],
    /// The numbers of the first vectors that were disabled because their interrupts did not end;
    /// unused elements are -1.
    pub stuck_vectors: [i32; NAMED],
    /// The set of causes of traps for which the processor has no handler, and which are now
    /// disabled: bit *n* stands for cause *n*.
    pub unhandled_causes: u32,
}

impl Interrupts {
    /// The name of the cell in the object table of a processor.
    pub const NAME: &str = "interrupts";

    /// Makes the record of an entry, and keeps the first 8 of the vectors that it names.
    #[must_use]
    pub fn of(entry: &dyn InterruptEntry, unhandled_causes: u32) -> Self {
        let counts = entry.counts();
        Self {
            served: counts.served,
            spurious: counts.spurious,
            unclaimed: counts.unclaimed,
            unhandled: counts.unhandled,
            stuck: counts.stuck,
            unhandled_vectors: first(|each| entry.each_unhandled(each)),
            stuck_vectors: first(|each| entry.each_stuck(each)),
            unhandled_causes,
        }
    }
}

/// The first vectors that `all` calls its argument with.
fn first(all: impl FnOnce(&mut dyn FnMut(InterruptVector, u32))) -> [i32; NAMED] {
    let mut named = [NONE; NAMED];
    let mut places = named.iter_mut();
    all(&mut |vector, _| {
        if let Some(place) = places.next() {
            *place = vector.0.into();
        }
    });
    named
}

cell_struct!(Interrupts {
    "served": served, "";
    "spurious": spurious, "";
    "unclaimed": unclaimed, "";
    "unhandled": unhandled, "";
    "stuck": stuck, "";
    "unhandled_vector": unhandled_vectors, "", "-1 is none.";
    "stuck_vector": stuck_vectors, "", "-1 is none.";
    "unhandled_causes": unhandled_causes, "", "Bits of the numbers of causes.";
});
