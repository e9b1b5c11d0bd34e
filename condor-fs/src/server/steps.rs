//! [`Steps`]: where a server can be made to die.

use crate::wire::Operation;

/// A point in an operation at which a server may be killed, in the order in which they are reached.
/// Not every operation has all of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Step {
    /// The request was copied and is not done.
    Taken,
    /// The journal says that it is in progress.
    Begun,
    /// A directory was made, or a file without a name.
    Made,
    /// The intent is recorded.
    Staged,
    /// A file was given its name, or a rename was done.
    Moved,
    /// An open file was moved to the unique name.
    Aside,
    /// That it was is recorded.
    Marked,
    /// Part of the data was moved.
    Part,
    /// All has been done.
    Acted,
    /// The result is in the slot.
    Recorded,
}

impl Step {
    /// All of them.
    pub const ALL: [Self; 10] = [
        Self::Taken,
        Self::Begun,
        Self::Made,
        Self::Staged,
        Self::Moved,
        Self::Aside,
        Self::Marked,
        Self::Part,
        Self::Acted,
        Self::Recorded,
    ];
}

/// Is told of every step of a server, which goes on only when it returns: for tests that kill the
/// server there. `()` does nothing, and costs nothing.
pub trait Steps: Sync {
    /// `operation` has come to `step`.
    fn reached(&self, operation: Operation, step: Step);
}

impl Steps for () {
    #[inline(always)]
    fn reached(&self, _: Operation, _: Step) {}
}
