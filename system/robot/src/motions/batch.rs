use condor_hand::trajectory::StreamPoint;
use heapless::Vec;
use serde::{Deserialize, Serialize};

use super::BODY_BYTES;

/// The greatest number of points that a [`Batch`] can have.
pub const BATCH: usize = 16;

/// The greatest number of numbers in a batch: as many as take the room of motions.
const NUMBERS: usize = BODY_BYTES / size_of::<f64>();

/// Successive points of a stream, which a client sends in one message. The robot has J joints.
#[derive(Clone, Debug, PartialEq)]
pub struct Batch<const J: usize> {
    /// The number of the batch, counted from 0.
    pub sequence: u32,
    /// True if the stream ends with this batch, at rest.
    pub is_last: bool,
    /// The points in order of time, at most as many as there is [room](Self::room) for.
    pub points: Vec<StreamPoint<J>, BATCH>,
}

impl<const J: usize> Batch<J> {
    /// Returns the greatest number of points that one batch can have, in a stream of the joints in `mask` (bit *i* is
    /// joint *i*); 0 for 30 joints or more.
    #[must_use]
    pub const fn room(mask: u32) -> usize {
        let room = NUMBERS / numbers(mask);
        if room < BATCH { room } else { BATCH }
    }

    /// Packs the batch of a stream of the joints in `mask`; returns `None` if it has more points than there is
    /// [room](Self::room) for.
    pub(super) fn pack(&self, mask: u32) -> Option<PackedBatch> {
        let mut numbers = Vec::new();
        for point in &self.points {
            numbers.push(point.time).ok()?;
            for joint in joints::<J>(mask) {
                numbers.push(*point.positions.get(joint)?).ok()?;
                numbers.push(*point.velocities.get(joint)?).ok()?;
            }
        }
        Some(PackedBatch {
            sequence: self.sequence,
            is_last: self.is_last,
            numbers,
        })
    }
}

/// A [`Batch`] as it lies in a message.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PackedBatch {
    /// The number of the batch, counted from 0.
    pub sequence: u32,
    /// True if the stream ends with this batch, at rest.
    pub is_last: bool,
    /// The time of each point, s, and then the position (rad) and velocity (rad/s) of each joint of the stream.
    pub numbers: Vec<f64, NUMBERS>,
}

impl PackedBatch {
    /// Unpacks the batch of a stream of the joints in `mask`; returns `None` if it has too many points, or a part of
    /// one.
    pub(super) fn unpack<const J: usize>(&self, mask: u32) -> Option<Batch<J>> {
        let mut points = Vec::new();
        for point in self.numbers.chunks(numbers(mask)) {
            let (&time, of_joints) = point.split_first()?;
            let mut of_joints = of_joints.iter();
            let mut point = StreamPoint {
                time,
                positions: [0.0; J],
                velocities: [0.0; J],
            };
            for joint in joints::<J>(mask) {
                *point.positions.get_mut(joint)? = *of_joints.next()?;
                *point.velocities.get_mut(joint)? = *of_joints.next()?;
            }
            points.push(point).ok()?;
        }
        Some(Batch {
            sequence: self.sequence,
            is_last: self.is_last,
            points,
        })
    }
}

/// Returns the number of numbers of a point.
const fn numbers(mask: u32) -> usize {
    1 + 2 * mask.count_ones() as usize
}

/// Iterates over the joints of a mask.
fn joints<const J: usize>(mask: u32) -> impl Iterator<Item = usize> {
    (0..J).filter(move |joint| mask >> joint & 1 == 1)
}

#[cfg(test)]
mod tests {
    use super::super::{MotionRequest, MotionRequestPacket};
    use super::*;
    use crate::queue::RequestIdentity;

    const IDENTITY: RequestIdentity = RequestIdentity {
        session: u32::MAX,
        number: u32::MAX,
    };

    #[test]
    fn what_is_packed_is_unpacked() {
        for mask in [1, 0x8001, 0x0f0f, 0xffff] {
            let mut batch = Batch::<16> {
                sequence: 7,
                is_last: true,
                points: Vec::new(),
            };
            let room = Batch::<16>::room(mask) as u32;
            for index in 0..room {
                let of = |joint: usize| {
                    let value = f64::from(index) + f64::from(joint as u32) * 0.125;
                    if mask >> joint & 1 == 1 { value } else { 0.0 }
                };
                let point = StreamPoint {
                    time: 1.0 + f64::from(index),
                    positions: core::array::from_fn(of),
                    velocities: core::array::from_fn(|joint| -of(joint)),
                };
                batch.points.push(point).unwrap();
            }
            let mut packed = batch.pack(mask).unwrap();
            assert_eq!(packed.unpack::<16>(mask), Some(batch.clone()));
            let request = MotionRequest::Points(IDENTITY, packed.clone());
            assert_eq!(
                MotionRequestPacket::new(&request).unwrap().value(),
                Ok(request)
            );
            packed.numbers.pop();
            assert_eq!(packed.unpack::<16>(mask), None);
        }
        assert_eq!(Batch::<16>::room(0xffff), 1);
    }
}
