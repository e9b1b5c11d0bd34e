//! The image of a hand: bytes that a processor loads, or has linked in.

use thiserror::Error;

use super::{Hand, Mistake, PROCESSORS};
use crate::image::{Format, HEADER_BYTES, HeaderError};

const FORMAT: Format = Format {
    magic: *b"CNDH",
    version: 4,
};

/// The reason why bytes are not the image of a hand, or a hand cannot become an image.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum HandImageError {
    /// The bytes are no image, or there is no room for one.
    #[error(transparent)]
    Header(#[from] HeaderError),
    /// The hand has more parts than its type has room for.
    #[error("the hand has {needed} {of}, this program has room for {capacity}")]
    Capacity {
        /// The kind of part.
        of: &'static str,
        /// The number in the hand; for joints, the greatest number in one finger.
        needed: u16,
        /// The number for which the type has room.
        capacity: usize,
    },
    /// The checksum is right, but the bytes are not a hand.
    #[error("the bytes of the image are not those of a hand")]
    Malformed,
    /// The hand breaks a rule.
    #[error(transparent)]
    Mistake(#[from] Mistake),
}

impl<const FINGERS: usize, const JOINTS: usize> Hand<FINGERS, JOINTS> {
    /// Writes the image of the hand, which [`from_image`](Self::from_image) reads, to the front of `buffer`. Returns
    /// the length of the image in bytes.
    ///
    /// The image does not depend on `FINGERS` and `JOINTS`: a program with other capacities can read it if they are
    /// large enough.
    ///
    /// # Errors
    /// * [`Mistake`](HandImageError::Mistake) if the hand breaks a rule.
    /// * [`Header`](HandImageError::Header) if the buffer is too short; its content is then useless.
    pub fn to_image(&self, buffer: &mut [u8]) -> Result<usize, HandImageError> {
        self.check()?;
        let too_short = HeaderError::BufferTooShort { len: buffer.len() };
        let Some((header, body)) = buffer.split_first_chunk_mut::<HEADER_BYTES>() else {
            return Err(too_short.into());
        };
        let body = postcard::to_slice(self, body).map_err(|_| too_short)?;
        let [[f0, f1], [j0, j1], [p0, p1]] = self.counts().map(u16::to_le_bytes);
        FORMAT.seal([f0, f1, j0, j1, p0, p1], header, body);
        Ok(HEADER_BYTES + body.len())
    }

    /// Reads a hand from an image that [`to_image`](Self::to_image) wrote, and checks the hand again. `image` must be
    /// exactly the bytes of the image, without any after them.
    ///
    /// # Errors
    /// [`HandImageError::Header`] if the bytes are no image of a hand, [`HandImageError::Capacity`] if the
    /// hand has more parts than its type has room for, [`HandImageError::Malformed`] or
    /// [`HandImageError::Mistake`] if it is not a valid hand. No bytes make this panic.
    pub fn from_image(image: &[u8]) -> Result<Self, HandImageError> {
        let ([f0, f1, j0, j1, p0, p1], body) = FORMAT.open(image)?;
        let counts = [[f0, f1], [j0, j1], [p0, p1]].map(u16::from_le_bytes);
        let capacities = [
            ("fingers", FINGERS),
            ("joints in a finger", JOINTS),
            ("processors", PROCESSORS),
        ];
        for (needed, (of, capacity)) in counts.into_iter().zip(capacities) {
            if usize::from(needed) > capacity {
                return Err(HandImageError::Capacity {
                    of,
                    needed,
                    capacity,
                });
            }
        }
        let Ok((hand, [])) = postcard::take_from_bytes::<Self>(body) else {
            return Err(HandImageError::Malformed);
        };
        if hand.counts() != counts {
            return Err(HandImageError::Malformed);
        }
        hand.check()?;
        Ok(hand)
    }

    /// The least capacities for this hand: fingers, joints of one finger, processors.
    fn counts(&self) -> [u16; 3] {
        let joints = self.fingers.iter().map(|finger| finger.joints.len()).max();
        [
            self.fingers.len(),
            joints.unwrap_or(0),
            self.processors.len(),
        ]
        .map(|count| u16::try_from(count).unwrap_or(u16::MAX))
    }
}
