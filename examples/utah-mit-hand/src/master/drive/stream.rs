//! The stream of points that moves the hand, beside the generator.

use condor_hand::queue::{Identity, Owner};
use condor_hand::trajectory::{
    JointStream, Limits, SetPoint, StreamEnd, StreamError, TrajectoryError,
};
use condor_mbox::Processor;

use super::{ALL, Drive};
use crate::motions::{Batch, Code, HORIZON, Request, Response, VERSION};
use crate::{FINGERS, JOINTS};

/// How long a stream waits for its first points, s.
const FIRST_POINTS_S: f64 = 2.0;

/// The request whose points come while it runs.
pub(in crate::master) struct Streaming {
    identity: Identity,
    owner: Owner,
    stream: JointStream<ALL, HORIZON>,
    /// Joints of fingers that have come loose since it began: it moves them no more.
    cut: u32,
}

impl<W> Drive<'_, W> {
    /// Begins a stream of the joints in a mask, from where they rest. Its first points have two seconds.
    pub(in crate::master) fn begin_stream(
        &mut self,
        identity: Identity,
        owner: Owner,
        mask: u32,
        limits: &[Limits<f64>; ALL],
    ) -> Result<(), TrajectoryError> {
        let positions = self.generator.set_points().map(|point| point.position);
        #[allow(clippy::cast_sign_loss, reason = "both are above zero")]
        let patience = (FIRST_POINTS_S / self.period_s) as u32 + 1;
        let stream = JointStream::new(mask, *limits, positions, self.period_s, patience)?;
        self.stream_end = None;
        self.stream = Some(Streaming {
            identity,
            owner,
            stream,
            cut: 0,
        });
        Ok(())
    }

    /// Whether a request may begin: no stream moves, and before a stream nothing else does.
    pub(in crate::master) fn is_free(&self, for_stream: bool) -> bool {
        let generator = &self.generator;
        let rests = generator.is_idle() && !generator.is_paused();
        self.stream.is_none() && (rests || !for_stream)
    }

    /// Brakes the stream, if one runs. Returns whether one does.
    pub(in crate::master) fn abort_stream(&mut self) -> bool {
        if let Some(streaming) = &mut self.stream {
            streaming.stream.abort();
        }
        self.stream.is_some()
    }

    /// How the stream has ended, once.
    pub(in crate::master) fn take_stream_end(&mut self) -> Option<StreamEnd> {
        self.stream_end.take()
    }

    /// Takes points by message; `None` if their stream does not run here.
    pub(in crate::master) fn take_points(
        &mut self,
        sender: Processor,
        request: &Request,
    ) -> Option<Response> {
        let streaming = self.stream.as_mut();
        let streaming = streaming.filter(|it| it.identity == request.identity())?;
        if request.version != VERSION || streaming.owner.processor != u32::from(sender.0) {
            return None;
        }
        let stream = &mut streaming.stream;
        let batch = request
            .body()
            .and_then(|body| Batch::read(stream.mask(), body));
        let Some(batch) = batch else {
            return Some(Response::new(Code::Wrong, 0));
        };
        let pushed = stream.push(batch.sequence, &batch.points, batch.is_last);
        #[allow(clippy::cast_sign_loss, reason = "times are not below zero")]
        let until = (stream.until() * 1000.0) as u32;
        Some(match pushed {
            Ok(()) => Response::new(Code::Done, until),
            Err(StreamError::Full { .. }) => Response::new(Code::Busy, until),
            Err(StreamError::Joint { joint, .. }) => Response::new(Code::Refused, joint as u32),
            // What has become of it is soon known.
            Err(StreamError::Ended) if stream.has_ended() => Response::new(Code::Pending, until),
            Err(_) => Response::new(Code::Refused, u32::MAX),
        })
    }

    /// One tick of the stream: the generator has its joints where they are. Returns their set-points.
    pub(in crate::master) fn stream(&mut self) -> Option<(u32, [SetPoint<f64>; ALL])> {
        let streaming = self.stream.as_mut()?;
        for finger in (0..FINGERS).filter(|finger| self.loose >> finger & 1 == 1) {
            streaming.cut |= ((1 << JOINTS) - 1) << (finger * JOINTS);
        }
        if streaming.cut & streaming.stream.mask() != 0 {
            streaming.stream.abort();
        }
        let mask = streaming.stream.mask() & !streaming.cut;
        let points = streaming.stream.tick();
        let positions = points.map(|point| point.position);
        // All of them are finite.
        let _ = self.generator.hold(mask, &positions);
        if let Some(end) = streaming.stream.end() {
            self.stream_end = Some(end);
            self.stream = None;
        }
        Some((mask, points))
    }
}
