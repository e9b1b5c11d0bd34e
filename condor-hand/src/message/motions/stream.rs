use super::{Batch, Code, MotionRequest, MotionResponse, StreamRefusal, VERSION};
use crate::queue::{RequestIdentity, SessionOwner};
use crate::trajectory::{JointStream, JointStreamError};

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

    /// Takes the points in `request`, if they belong to this stream and come from its owner, and
    /// returns the answer for the client. Returns `None` if the request is for another stream. Call
    /// it in the closure of [`MotionsPost::answer`](super::MotionsPost::answer).
    pub fn take(
        &mut self,
        sender: SessionOwner,
        request: &MotionRequest,
    ) -> Option<MotionResponse> {
        if request.version != VERSION || request.identity() != self.identity || self.owner != sender
        {
            return None;
        }
        let stream = &mut self.stream;
        let body = request.body();
        let Some(batch) = body.and_then(|body| Batch::read(stream.mask(), body)) else {
            return Some(MotionResponse::new(Code::Wrong, 0));
        };
        let pushed = stream.push(batch.sequence, &batch.points, batch.is_last);
        #[allow(clippy::cast_sign_loss, reason = "times are not below zero")]
        let until = (stream.until() * 1000.0) as u32;
        Some(match pushed {
            Ok(()) => MotionResponse::new(Code::Done, until),
            Err(JointStreamError::Full { .. }) => MotionResponse::new(Code::Busy, until),
            // The queue will soon know how the stream has ended.
            Err(JointStreamError::Ended) if stream.has_ended() => {
                MotionResponse::new(Code::Pending, until)
            }
            Err(error) => MotionResponse {
                refusal: StreamRefusal::of(error),
                ..MotionResponse::new(Code::Refused, 0)
            },
        })
    }
}
