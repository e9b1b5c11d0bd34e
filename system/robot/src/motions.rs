//! The motion queue of a controller, served by message.
//!
//! A client opens a session and takes control. Then it offers motions, each with a [`RequestIdentity`] of its
//! own, and asks for their states. If a message is lost, the client sends the same request again: the
//! [queue](crate::queue) runs no identity twice. [`MotionsClient`] does this.
//!
//! The controller has a [`MotionsPost`], whose [`answer`](MotionsPost::answer) is the handler of [`MOTIONS`],
//! and a [`MotionsServer`] in its background. The handler answers requests that can be answered at once, and
//! keeps the others for the background, which may wait while the ledger is written. The controller knows the
//! motions and joints of its robot, and moves them: it makes the data of a request from an [`Offer`], and
//! begins and ends the [next request](MotionsServer::next_request).
//!
//! A [`MotionRequest`] and its [`MotionResponse`] lie, each in a [`Packet`], in the [blocks](MotionsBlocks) of the
//! controller.
//!
//! A stream is a request like any other, but its points come while it runs: batches with numbers, so
//! that one that is sent again changes nothing. The time of the points begins with the first batch. A
//! batch is refused as a whole if a joint would leave its limits
//! ([`JointStream`](condor_hand::trajectory::JointStream)). When the next point has not come in time, the
//! joints brake from the last one within their limits, and the request is aborted with
//! [`RefusalReason::Starved`](crate::queue::RefusalReason::Starved). A [`StreamRequest`] takes the points.
//!
//! A session belongs to the processor that opened it, and to its incarnation: other processors get
//! [`MotionResponse::NotYours`], except for `Look`, and for an `Offer` of a request that the controller has already.
//! When that incarnation ends, the controller closes the session, and its control with it; the next incarnation of
//! the processor cannot use it even before that. The session's requests in the queue go on, unless the client has bound
//! them to the session; then all motion ends. A request that the
//! controller has not received by then never runs ([`QueueAnswer::Never`]). When the controller's program ends, the
//! requests that it had accepted are lost or broken off; the sessions stay.

mod batch;
mod client;
mod post;
mod server;
mod stream;

pub use batch::{BATCH, Batch, PackedBatch};
pub use client::{MotionsClient, SentPoints};
pub use post::MotionsPost;
pub use server::{LedgerStore, MotionsEvent, MotionsServer};
pub use stream::StreamRequest;

use condor_hand::trajectory::JointStreamError;
use condor_mbox::Vector;
use condor_mbox::exchange::Blocks;
use heapless::Vec;
use serde::{Deserialize, Serialize};

use crate::packet::Packet;
use crate::queue::{InControl, QueueAnswer, RequestIdentity};

/// The vector of the messages that carry requests to the motion queue of a controller.
pub const MOTIONS: Vector = Vector(33);
/// The version of this protocol of motions.
pub const VERSION: u32 = 5;
/// The greatest number of bytes of the motions of one request.
pub const BODY_BYTES: usize = 480;

/// The blocks in the `data` of a controller through which clients send their requests and get the
/// answers; one for each processor.
pub type MotionsBlocks = Blocks<MotionRequestPacket, MotionResponsePacket>;
/// A request in a block.
pub type MotionRequestPacket = Packet<MotionRequest, VERSION, 504>;
/// A response in a block.
pub type MotionResponsePacket = Packet<MotionResponse, VERSION, 56>;

/// A request to a motion queue.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum MotionRequest {
    /// Opens a session. The answer is [`MotionResponse::Opened`], or [`MotionResponse::Exhausted`].
    Open,
    /// Takes control. The answer is [`MotionResponse::Done`], or [`MotionResponse::InControl`] if another session is in
    /// control.
    Control {
        /// The session for which the client takes control.
        session: u32,
        /// True to take control from another session, too.
        from_other: bool,
    },
    /// Ends the control of a session. The answer is [`MotionResponse::Done`].
    GiveUp {
        /// The session whose control is to end.
        session: u32,
    },
    /// Ends all motion, if the session is in control. The answer is [`MotionResponse::Done`] when the controller has
    /// ended all motion and recorded it in the ledger, or [`MotionResponse::InControl`].
    Abort {
        /// The session that is in control.
        session: u32,
    },
    /// Binds the requests of a session to it: if the session is closed, since its client has ended, while one of them
    /// waits or runs, all motion ends. The answer is [`MotionResponse::Done`].
    Bind {
        /// The session of the requests.
        session: u32,
    },
    /// Asks for the state of a request. The answer is [`MotionResponse::Request`].
    Look(RequestIdentity),
    /// Enqueues motions or a stream. The answer is [`MotionResponse::Request`] when the queue has accepted or refused
    /// it.
    Offer(RequestIdentity, Offer),
    /// Withdraws a request: if the queue does not have it yet, it never runs. The answer is [`MotionResponse::Request`].
    Withdraw(RequestIdentity),
    /// Sends points of a stream. The answer is [`MotionResponse::Points`], [`MotionResponse::Refused`], or
    /// [`MotionResponse::Request`] once the stream has ended.
    Points(RequestIdentity, PackedBatch),
}

impl MotionRequest {
    /// Returns the session of the request; `None` if it opens one.
    const fn session(&self) -> Option<u32> {
        Some(match self {
            Self::Open => return None,
            Self::Control { session, .. }
            | Self::GiveUp { session }
            | Self::Abort { session }
            | Self::Bind { session }
            | Self::Look(RequestIdentity { session, .. })
            | Self::Offer(RequestIdentity { session, .. }, _)
            | Self::Withdraw(RequestIdentity { session, .. })
            | Self::Points(RequestIdentity { session, .. }, _) => *session,
        })
    }
}

/// The motions or the stream that a client offers to the queue.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[expect(
    clippy::large_enum_variant,
    reason = "nothing is allocated, and few offers are there at a time"
)]
pub enum Offer {
    /// Motions, in bytes that the controller reads.
    Motions(Vec<u8, BODY_BYTES>),
    /// A stream of the joints in this mask: bit *i* is joint *i*. The mask is not checked: the robot may not
    /// have these joints.
    Stream(u32),
}

/// The answer to a [`MotionRequest`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum MotionResponse {
    /// The controller has no time or no room for the request: ask again.
    Busy,
    /// The controller has the request, and has not decided: ask again.
    Pending,
    /// The operation is done.
    Done,
    /// The session of this number is open.
    Opened(u32),
    /// The session is not in control, and this is.
    InControl(InControl),
    /// The queue's answer about a request.
    Request(RequestProgress),
    /// The stream has points until this time, ms.
    Points(u32),
    /// All points of the batch are refused.
    Refused(JointStreamError),
    /// The session is that of another processor, or of an earlier incarnation of this one.
    NotYours,
    /// The ledger has the last number that a session can have: none can be opened until the ledger is removed.
    Exhausted,
    /// The request has number 0, or a batch is none of its stream's.
    Invalid,
}

/// The state of a request in the queue, and the part of its motion that is done.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RequestProgress {
    /// The queue's answer about the request.
    pub answer: QueueAnswer,
    /// The number of requests that run or wait before it, while it waits.
    pub before: u32,
    /// The part of the request that is done, in 0..=1; `None` if the request does not run, or if the controller
    /// does not know the part. It does not for a stream: only the client knows how many points are still to
    /// come.
    pub progress: Option<f64>,
}

impl RequestProgress {
    /// The state of a request that neither runs nor waits.
    const fn of(answer: QueueAnswer) -> Self {
        Self {
            answer,
            before: 0,
            progress: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use condor_hand::Requirement;
    use condor_hand::trajectory::StreamQuantity;

    use super::*;
    use crate::queue::{RefusalReason, RequestState};

    #[test]
    fn the_longest_messages_fit_into_their_packets() {
        let identity = RequestIdentity {
            session: u32::MAX,
            number: u32::MAX,
        };
        for request in [
            MotionRequest::Offer(identity, Offer::Motions([7; BODY_BYTES].into())),
            MotionRequest::Points(
                identity,
                PackedBatch {
                    sequence: u32::MAX,
                    is_last: true,
                    numbers: [1.0; BODY_BYTES / 8].into(),
                },
            ),
        ] {
            let packet = MotionRequestPacket::new(&request).unwrap();
            assert_eq!(packet.value(), Ok(request));
        }
        for response in [
            MotionResponse::Refused(JointStreamError::Joint {
                joint: usize::MAX,
                time: 1.0,
                quantity: StreamQuantity::RepeatedVelocity,
                value: 1.0,
                must: Requirement::Within(1.0, 2.0),
            }),
            MotionResponse::Request(RequestProgress {
                answer: QueueAnswer::Known(RequestState::BrokenOff, RefusalReason::Starved),
                before: u32::MAX,
                progress: Some(1.0),
            }),
        ] {
            let packet = MotionResponsePacket::new(&response).unwrap();
            assert_eq!(packet.value(), Ok(response));
        }
    }
}
