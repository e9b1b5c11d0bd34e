use heapless::Vec;

use super::BODY_BYTES;
use crate::trajectory::StreamPoint;

/// The greatest number of points that a [`Batch`] can have.
pub const BATCH: usize = 16;

/// The number of bytes before the points.
const HEAD: usize = 8;

/// Successive points of a stream, which a client sends in one message. The robot has J joints.
///
/// In the message come a word with the number of the batch, and a word that is 1 for the last batch and otherwise 0.
/// Then come the points, each with its time and the position and velocity of each joint in the mask, as IEEE 754
/// doubles. All numbers are little-endian.
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
    /// joint *i*).
    #[must_use]
    pub const fn room(mask: u32) -> usize {
        let room = (BODY_BYTES - HEAD) / (8 + 16 * mask.count_ones() as usize);
        if room < BATCH { room } else { BATCH }
    }

    /// Writes the batch of a stream of the joints in `mask`; returns its length, or `None` if it has more
    /// points than there is [room](Self::room) for.
    pub(super) fn write(&self, mask: u32, into: &mut [u8; BODY_BYTES]) -> Option<usize> {
        let mut len = 0;
        let mut put = |bytes: &[u8]| {
            into.get_mut(len..)?
                .get_mut(..bytes.len())?
                .copy_from_slice(bytes);
            len += bytes.len();
            Some(())
        };
        put(&self.sequence.to_le_bytes())?;
        put(&u32::from(self.is_last).to_le_bytes())?;
        for point in &self.points {
            put(&point.time.to_le_bytes())?;
            let joints = point.positions.iter().zip(&point.velocities).enumerate();
            for (_, (position, velocity)) in joints.filter(|(joint, _)| mask >> joint & 1 == 1) {
                put(&position.to_le_bytes())?;
                put(&velocity.to_le_bytes())?;
            }
        }
        Some(len)
    }

    /// Reads a batch that [`write`](Self::write) wrote; `None` if the bytes are not a batch.
    pub(super) fn read(mask: u32, bytes: &[u8]) -> Option<Self> {
        let (sequence, rest) = bytes.split_first_chunk::<4>()?;
        let (is_last, rest) = rest.split_first_chunk::<4>()?;
        let (mut numbers, left) = rest.as_chunks::<8>();
        let mut points = Vec::new();
        let mut next = || {
            let (number, rest) = numbers.split_first()?;
            numbers = rest;
            Some(f64::from_le_bytes(*number))
        };
        while let Some(time) = next() {
            let mut point = StreamPoint {
                time,
                positions: [0.0; J],
                velocities: [0.0; J],
            };
            let joints = point
                .positions
                .iter_mut()
                .zip(&mut point.velocities)
                .enumerate();
            for (_, (position, velocity)) in joints.filter(|(joint, _)| mask >> joint & 1 == 1) {
                (*position, *velocity) = (next()?, next()?);
            }
            points.push(point).ok()?;
        }
        left.is_empty().then_some(Self {
            sequence: u32::from_le_bytes(*sequence),
            is_last: u32::from_le_bytes(*is_last) != 0,
            points,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read() {
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
            let mut bytes = [0; BODY_BYTES];
            let len = batch.write(mask, &mut bytes).unwrap();
            assert_eq!(Batch::<16>::read(mask, &bytes[..len]).unwrap(), batch);
            assert_eq!(Batch::<16>::read(mask, &bytes[..len - 1]), None);
        }
        assert_eq!(Batch::<16>::room(0xffff), 1);
        assert_eq!(Batch::<16>::read(1, &[0; 7]), None);
    }
}
