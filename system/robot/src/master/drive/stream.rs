//! The stream of points that moves the hand, beside the generator.

use condor_hand::NumberError;
use condor_hand::trajectory::{JointStream, ProfileLimits, SetPoint, StreamEnd};

use super::{ALL, Drive};
use crate::FINGERS;
use crate::motions::{MotionResponse, PackedBatch, StreamRequest};
use crate::queue::{RequestIdentity, SessionOwner};

/// The time for which a stream waits for its first points, s.
const FIRST_POINTS_S: f64 = 2.0;
/// The points for which there is room, ahead of the stream's time.
const HORIZON: usize = 32;

/// The request whose points come while it runs.
pub(in crate::master) struct Streaming {
    request: StreamRequest<ALL, HORIZON>,
    /// Joints of fingers that have come loose since it began: it moves them no more.
    cut: u32,
}

impl<W> Drive<'_, W> {
    /// Begins a stream of the joints in a mask, from where they rest. Its first points have two seconds.
    pub(in crate::master) fn begin_stream(
        &mut self,
        identity: RequestIdentity,
        owner: SessionOwner,
        mask: u32,
        limits: &[ProfileLimits; ALL],
    ) -> Result<(), NumberError> {
        let positions = self.generator.set_points().map(|point| point.position);
        #[allow(clippy::cast_sign_loss, reason = "both are above zero")]
        let patience = (FIRST_POINTS_S / self.period_s) as u32 + 1;
        let stream = JointStream::new(mask, *limits, positions, self.period_s, patience)?;
        self.stream_end = None;
        self.stream = Some(Streaming {
            request: StreamRequest::new(identity, owner, stream),
            cut: 0,
        });
        Ok(())
    }

    /// Returns true if a request may begin: no stream moves, and before a stream nothing else does.
    pub(in crate::master) fn is_free(&self, for_stream: bool) -> bool {
        let generator = &self.generator;
        let rests = generator.is_idle() && !generator.is_paused();
        self.stream.is_none() && (rests || !for_stream)
    }

    /// Brakes the stream, if one runs. Returns whether one does.
    pub(in crate::master) fn abort_stream(&mut self) -> bool {
        if let Some(streaming) = &mut self.stream {
            streaming.request.stream.abort();
        }
        self.stream.is_some()
    }

    /// Returns the end of the last stream, once.
    pub(in crate::master) fn take_stream_end(&mut self) -> Option<StreamEnd> {
        self.stream_end.take()
    }

    /// Takes points by message; `None` if their stream does not run here.
    pub(in crate::master) fn take_points(
        &mut self,
        sender: SessionOwner,
        identity: RequestIdentity,
        batch: &PackedBatch,
    ) -> Option<MotionResponse> {
        let stream = self.stream.as_mut()?;
        stream.request.take(sender, identity, batch)
    }

    /// One tick of the stream: the generator has its joints where they are. Returns their set-points.
    pub(in crate::master) fn stream(&mut self) -> Option<(u32, [SetPoint; ALL])> {
        let Streaming { request, cut } = self.stream.as_mut()?;
        let stream = &mut request.stream;
        for finger in (0..FINGERS).filter(|finger| self.loose >> finger & 1 == 1) {
            *cut |= self.numbers.mask(finger);
        }
        if *cut & stream.mask() != 0 {
            stream.abort();
        }
        let mask = stream.mask() & !*cut;
        let points = stream.tick();
        let positions = points.map(|point| point.position);
        // All of them are finite.
        let _ = self.generator.hold(mask, &positions);
        if let Some(end) = stream.end() {
            self.stream_end = Some(end);
            self.stream = None;
        }
        Some((mask, points))
    }
}
