//! The image of a hand: bytes that a processor loads, or has linked in.

use super::{Hand, Mistake, PROCESSORS};
use crate::Subject;
use crate::image::{Format, ImageError};

const FORMAT: Format = Format {
    magic: *b"CNDH",
    version: 5,
};

impl<const FINGERS: usize, const JOINTS: usize> Hand<FINGERS, JOINTS> {
    /// Writes the image of the hand, which [`from_image`](Self::from_image) reads, to the front of `buffer`. Returns
    /// the length of the image in bytes.
    ///
    /// The image does not depend on `FINGERS` and `JOINTS`: a program with other capacities can read it if they are
    /// large enough.
    ///
    /// # Errors
    /// [`ImageError::Content`] if the hand breaks a rule, [`ImageError::BufferTooShort`] if the buffer is too
    /// short; its content is then useless.
    pub fn to_image(&self, buffer: &mut [u8]) -> Result<usize, ImageError<Mistake>> {
        self.check()?;
        let [[f0, f1], [j0, j1], [p0, p1]] = self.counts().map(u16::to_le_bytes);
        FORMAT.write([f0, f1, j0, j1, p0, p1], self, buffer)
    }

    /// Reads a hand from an image that [`to_image`](Self::to_image) wrote, and checks the hand again. `image` must be
    /// exactly the bytes of the image, without any after them.
    ///
    /// # Errors
    /// [`ImageError::Length`], [`ImageError::Magic`], [`ImageError::Version`] or [`ImageError::Checksum`] if the
    /// bytes are no image of a hand, [`ImageError::Count`] if the hand has more parts than its type has room
    /// for, [`ImageError::Malformed`] or [`ImageError::Content`] if it is not a valid hand. No bytes make this
    /// panic.
    pub fn from_image(image: &[u8]) -> Result<Self, ImageError<Mistake>> {
        let ([f0, f1, j0, j1, p0, p1], body) = FORMAT.open::<Mistake>(image)?;
        let counts = [[f0, f1], [j0, j1], [p0, p1]].map(u16::from_le_bytes);
        let capacities = [
            ("fingers", FINGERS),
            ("joints in a finger", JOINTS),
            ("processors", PROCESSORS),
        ];
        for (needed, (of, capacity)) in counts.into_iter().zip(capacities) {
            if usize::from(needed) > capacity {
                return Err(ImageError::Count {
                    of,
                    found: needed.into(),
                    wanted: capacity,
                });
            }
        }
        let hand: Self = Format::value(body)?;
        if hand.counts() != counts {
            return Err(ImageError::Malformed { at: Subject::Whole });
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
