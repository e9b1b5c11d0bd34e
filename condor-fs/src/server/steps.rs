//! [`Steps`]: the points at which a test can kill a server.

use crate::wire::Operation;

/// A point in an operation of a server, at which tests kill the server. The variants are in the
/// order in which they are reached; not every operation reaches all of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Step {
    /// The request was copied, and its result is not in the slot yet.
    Taken,
    /// The journal records that the request is in progress.
    Begun,
    /// The mode of a file was changed for a moment, so that it can be opened once more.
    Widened,
    /// A directory was made, or a file that has no name yet (`O_TMPFILE`).
    Made,
    /// The slot records the operation and its arguments, before the operation is done.
    Staged,
    /// A file was given its name, or a rename was done.
    Moved,
    /// A file that was unlinked or replaced while it was open was moved to a unique name.
    Aside,
    /// The move to the unique name is recorded in the memory of the client.
    Marked,
    /// Part of the data was moved.
    Part,
    /// Everything has been done, and the result is not in the slot yet.
    Acted,
    /// The result is in the slot.
    Recorded,
}

impl Step {
    /// All steps, in the order in which they are reached.
    pub const ALL: [Self; 11] = [
        Self::Taken,
        Self::Begun,
        Self::Widened,
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

/// A callback for tests, which a server calls at every [`Step`] of an operation. The server goes on
/// when the call returns; a test can kill it in the call. `()` is a callback that does nothing, and
/// costs nothing.
pub trait Steps: Sync {
    /// Notes that `operation` has reached `step`.
    fn reached(&self, operation: Operation, step: Step);
}

impl Steps for () {
    #[inline(always)]
    fn reached(&self, _: Operation, _: Step) {}
}
