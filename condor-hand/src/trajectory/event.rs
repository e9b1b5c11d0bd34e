use super::{MotionError, MotionGuard};

/// The number of an accepted primitive, by which calls and events name it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct MotionTicket(pub u32);

/// An event of a primitive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionEvent {
    /// The ticket of the primitive.
    pub ticket: MotionTicket,
    /// The kind of event.
    pub happening: Happening,
}

/// The kind of a primitive's event.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Happening {
    /// The primitive has begun to move its joints.
    Started {
        /// Whether it runs in a changed form, since the limits do not permit it from the present
        /// state.
        adjusted: bool,
    },
    /// The primitive has ended, for this reason.
    Ended(MotionEnd),
    /// The primitive's turn has come, but it cannot run from the present state of its joints.
    Refused(MotionError),
}

/// The reason why a primitive has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MotionEnd {
    /// The primitive has reached its targets.
    Reached,
    /// This condition of its guards has stopped the primitive.
    Stopped(MotionGuard),
    /// The primitive was aborted, running or not.
    Aborted,
    /// Another primitive has taken the last of its joints.
    Superseded {
        /// The ticket of the other primitive.
        by: MotionTicket,
    },
}

/// The progress of a primitive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MotionProgress<T> {
    /// The primitive waits in the queue.
    Queued {
        /// The number of primitives before it.
        before: usize,
    },
    /// The primitive is in motion.
    Running {
        /// The fraction of its time that has passed, in 0..=1.
        fraction: T,
        /// The ratio of its present speed to that of its profile; below 1 while it stops or
        /// continues.
        rate: T,
    },
}
