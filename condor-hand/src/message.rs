//! Servos as objects that answer messages, and [motions] by message (feature `mbox`).
//!
//! Any processor can enable, disable, query and restart any servo (memo, sections 3.5 and 4.2). A
//! servo processor owns a [`ServoObject`]. Its [`ServoHandler`] answers messages in the background;
//! its [`HandLoop`] controls the fingers in the servo loop. The loop never serves and never waits.
//! The handler stores a request as a *state* in private memory of the object, and the loop takes it
//! over at the beginning of a tick. If a state changes twice between two ticks, only the last
//! change takes effect; restarts are counted all the same. The loop also stores its results there,
//! so a query costs it nothing. While nothing changes, a tick reads one word for each finger, and
//! the set-points.
//!
//! The set-points of the master, 50 times a second, are not messages: a [`SetPoints`] publishes
//! them in the window of the servo processor, and the loop polls them there. With them come the motion
//! of each joint and what stops it, which the loop checks in every tick. [`GraspLayout`] are
//! for orders to a [`DistributedGrasp`](crate::grasp::distributed::DistributedGrasp) and its reports.
//!
//! # The protocol
//!
//! A request is a block in the users' region of the servo processor's `data`. There is one block of
//! [`BLOCK_BYTES`] for each processor of the system: [`REQUEST_WORDS`] words of request, then as
//! many of response, all 32 bits and little-endian. A number is an IEEE 754 double in two words,
//! the low one first. The sender sends a message to [`SERVO`] with the offset of its block. The
//! reply is 1 when the response has been written, and 0 for an offset that is not that of the
//! sender's block.
//!
//! | word of the request | content |
//! |---|---|
//! | 0 | a [`ServoOperation`] |
//! | 1 | the finger of the hand, from 0 |
//! | 2 | the joint, from 0; or [`ALL_JOINTS`] |
//! | 3 | the argument |
//! | 4 … | numbers |
//!
//! | operation | argument | numbers | response from word 1 on |
//! |---|---|---|---|
//! | `Hello` | | | version, a bit for each finger that the processor serves, joints of a finger, servo ticks in a second, names of the hand (4 words) and of the finger (4 words) |
//! | `Mode` | [`ServoMode`](crate::servo::ServoMode) | | number of the order |
//! | `Target` | [`ServoMode`](crate::servo::ServoMode) | tensions of flexor and extensor, N; or torque, N m; or position, velocity, acceleration, rad and s; or position, stiffness, damping, rad, N m and s | number of the order |
//! | `ServoStatus` | | | 16 words of [`ServoStatus`], then the ticks of the loop |
//! | `Restart` | | | number of the order |
//! | `Outcome` | number of an order | word 4: 0 mode or target, 1 restart | |
//!
//! Word 0 of the response is 0 for success. It is 1 if another request was being answered and this
//! one was ignored. For `Outcome` it is 2 until the loop has processed the order, and 3 if a later
//! order replaced it. Any other number is the code of a [`ServoRefusal`](crate::servo::ServoRefusal), whose
//! values follow.
//!
//! The numbers of an order are checked once, in the copy that the handler makes, by the loop when it processes
//! the order: only the servo knows, for example, whether a position is within its limits, or whether the finger
//! rests after a fault. `Outcome` returns the result. An order that was refused is not tried again.

mod client;
mod error;
mod finger_request;
mod grasp;
mod handler;
mod layout;
mod memory;
pub mod motions;
mod object;
mod refusal;
mod servo_loop;
mod status;
mod values;
mod words;

pub use client::{Hello, ServoClient};
pub use error::ClientError;
pub use finger_request::FingerRequest;
pub use grasp::{GraspEnd, GraspLayout};
pub use handler::{HandIdentity, ServoHandler};
pub use layout::{ServoLayout, SetPoints};
pub use object::{ServoEnds, ServoObject};
pub use servo_loop::HandLoop;
pub use status::ServoStatus;

use condor_mbox::Vector;

/// The vector of the messages that carry requests to the servos of a processor. Register the
/// [`ServoHandler`] of the servo processor at this vector.
pub const SERVO: Vector = Vector(32);
/// The version of this protocol of servos. A client refuses a servo processor with another version.
pub const VERSION: u32 = 6;
/// The joint number that stands for all joints of a finger at once, in requests that permit it.
pub const ALL_JOINTS: u32 = u32::MAX;
/// The number of 32-bit words of a request to a servo; a response has as many.
pub const REQUEST_WORDS: usize = 32;
/// The size of a block in shared memory, in bytes. A block contains one request and its response.
pub const BLOCK_BYTES: u32 = 8 * REQUEST_WORDS as u32;

/// The operation that a request asks of a servo, in word 0 of the request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u32)]
pub enum ServoOperation {
    /// Asks for the names of the hand and the finger.
    Hello = 1,
    /// Sets another mode, in which the joint keeps its present position, torque or tensions; `Off`
    /// disables it.
    Mode = 2,
    /// Sets a target, and its mode.
    Target = 3,
    /// Asks for the state of a finger.
    Status = 4,
    /// Clears the latched faults.
    Restart = 5,
    /// Asks for the result of an order: a request that the servo loop carries out.
    Outcome = 6,
}

impl ServoOperation {
    /// Returns the operation with this number in the protocol; `None` if no operation has it.
    #[must_use]
    pub const fn from_number(number: u32) -> Option<Self> {
        match number {
            1 => Some(Self::Hello),
            2 => Some(Self::Mode),
            3 => Some(Self::Target),
            4 => Some(Self::Status),
            5 => Some(Self::Restart),
            6 => Some(Self::Outcome),
            _ => None,
        }
    }
}

/// A request as it lies in its block.
pub(crate) type Request = [u32; REQUEST_WORDS];
/// A response as it lies in its block.
pub(crate) type Response = [u32; REQUEST_WORDS];

/// The part of the finger that an order changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
enum Part {
    Drive = 0,
    Restart = 1,
}

/// Word 0 of a response that is not a refusal.
mod state {
    pub(crate) const DONE: u32 = 0;
    pub(crate) const BUSY: u32 = 1;
    pub(crate) const PENDING: u32 = 2;
    pub(crate) const SUPERSEDED: u32 = 3;
}
