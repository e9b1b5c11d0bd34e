use super::{Batch, Code, Refusal, Request, Response, VERSION};
use crate::queue::{Identity, Owner};
use crate::trajectory::{JointStream, StreamError};

/// The stream of a request that runs, whose points come by message. It has room for N points of J
/// joints that are ahead of its time.
#[derive(Clone, Debug)]
pub struct StreamRequest<const J: usize, const N: usize> {
    identity: Identity,
    owner: Owner,
    /// The stream, which moves the robot.
    pub stream: JointStream<J, N>,
}

impl<const J: usize, const N: usize> StreamRequest<J, N> {
    /// Makes the stream of a request, whose points `owner` sends.
    #[must_use]
    pub const fn new(identity: Identity, owner: Owner, stream: JointStream<J, N>) -> Self {
        Self {
            identity,
            owner,
            stream,
        }
    }

    /// Takes points that came by message, for [`MotionsPost::answer`](super::MotionsPost::answer).
    /// Returns `None` if they are not of this stream.
    pub fn take(&mut self, sender: Owner, request: &Request) -> Option<Response> {
        if request.version != VERSION || request.identity() != self.identity || self.owner != sender
        {
            return None;
        }
        let stream = &mut self.stream;
        let body = request.body();
        let Some(batch) = body.and_then(|body| Batch::read(stream.mask(), body)) else {
            return Some(Response::new(Code::Wrong, 0));
        };
        let pushed = stream.push(batch.sequence, &batch.points, batch.is_last);
        #[allow(clippy::cast_sign_loss, reason = "times are not below zero")]
        let until = (stream.until() * 1000.0) as u32;
        Some(match pushed {
            Ok(()) => Response::new(Code::Done, until),
            Err(StreamError::Full { .. }) => Response::new(Code::Busy, until),
            // What has become of it is soon known.
            Err(StreamError::Ended) if stream.has_ended() => Response::new(Code::Pending, until),
            Err(error) => Response {
                refusal: Refusal::of(error),
                ..Response::new(Code::Refused, 0)
            },
        })
    }
}
