use super::{MotionError, MotionGuard};

/// The ticket of a primitive that a [`Generator`](super::Generator) has accepted. Calls and events
/// name the primitive by its ticket.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct MotionTicket(pub u32);

/// An event in the course of a primitive: it has started, has ended, or was refused.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionEvent {
    /// The ticket of the primitive.
    pub ticket: MotionTicket,
    /// The kind of event.
    pub happening: Happening,
}

/// The thing that has happened to a primitive, in a [`MotionEvent`].
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

/// The way in which a primitive has ended.
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

/// The progress of a primitive that waits in the queue or is in motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MotionProgress {
    /// The primitive waits in the queue.
    Queued {
        /// The number of primitives before it.
        before: usize,
    },
    /// The primitive is in motion.
    Running {
        /// The fraction of its time that has passed, in 0..=1.
        fraction: f64,
        /// The ratio of its present speed to that of its profile; below 1 while it stops or
        /// continues.
        rate: f64,
    },
}
