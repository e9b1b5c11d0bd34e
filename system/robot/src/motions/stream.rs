use condor_hand::trajectory::{JointStream, JointStreamError};

use super::{MotionResponse, PackedBatch};
use crate::queue::{RequestIdentity, SessionOwner};

/// The stream of a request that runs, with the checks for its points, which come by message. The
/// stream has room for N points of J joints that are ahead of its time.
#[derive(Clone, Debug)]
pub struct StreamRequest<const J: usize, const N: usize> {
    identity: RequestIdentity,
    owner: SessionOwner,
    /// The stream, which moves the robot.
    pub stream: JointStream<J, N>,
}

impl<const J: usize, const N: usize> StreamRequest<J, N> {
    /// Makes the stream of the request `identity`. Only points that `owner` sends are taken.
    #[must_use]
    pub const fn new(
        identity: RequestIdentity,
        owner: SessionOwner,
        stream: JointStream<J, N>,
    ) -> Self {
        Self {
            identity,
            owner,
            stream,
        }
    }

    /// Takes the points in `batch`, if they belong to this stream and come from its owner, and returns the answer for
    /// the client. Returns `None` if they are for another stream. Call it in the closure of
    /// [`MotionsPost::answer`](super::MotionsPost::answer).
    pub fn take(
        &mut self,
        sender: SessionOwner,
        identity: RequestIdentity,
        batch: &PackedBatch,
    ) -> Option<MotionResponse> {
        if identity != self.identity || self.owner != sender {
            return None;
        }
        let stream = &mut self.stream;
        let Some(batch) = batch.unpack(stream.mask()) else {
            return Some(MotionResponse::Invalid);
        };
        let pushed = stream.push(batch.sequence, &batch.points, batch.is_last);
        #[allow(clippy::cast_sign_loss, reason = "times are not below zero")]
        let until = (stream.until() * 1000.0) as u32;
        Some(match pushed {
            Ok(()) => MotionResponse::Points(until),
            Err(JointStreamError::Full { .. }) => MotionResponse::Busy,
            // The queue will soon know how the stream has ended.
            Err(JointStreamError::Ended) if stream.has_ended() => MotionResponse::Pending,
            Err(error) => MotionResponse::Refused(error),
        })
    }
}
