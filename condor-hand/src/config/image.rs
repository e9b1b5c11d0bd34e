//! The image of a hand: bytes that a processor loads, or has linked in.

use super::{Hand, Mistake, PROCESSORS};
use crate::Subject;
use crate::image::{Format, ImageError};

const FORMAT: Format = Format {
    magic: *b"CNDH",
    version: 7,
};

impl<const FINGERS: usize, const JOINTS: usize, const ACTUATORS: usize>
    Hand<FINGERS, JOINTS, ACTUATORS>
{
    /// Writes the image of the hand, which [`from_image`](Self::from_image) reads, to the front of `buffer`. Returns
    /// the length of the image in bytes.
    ///
    /// The image does not depend on `FINGERS`, `JOINTS` and `ACTUATORS`: a program with other capacities can read it if they are
    /// large enough.
    ///
    /// # Errors
    /// [`ImageError::Content`] if the hand breaks a rule, [`ImageError::BufferTooShort`] if the buffer is too
    /// short; its content is then useless.
    pub fn to_image(&self, buffer: &mut [u8]) -> Result<usize, ImageError<Mistake>> {
        self.check()?;
        FORMAT.write(self.counts(), self, buffer)
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
        let (counts, body) = FORMAT.open::<Mistake>(image)?;
        let [fingers, processors, j0, j1, a0, a1] = counts;
        let (joints, actuators) = ([j0, j1], [a0, a1]);
        let needed = [
            u16::from(fingers),
            u16::from_le_bytes(joints),
            u16::from_le_bytes(actuators),
            u16::from(processors),
        ];
        let capacities = [
            ("fingers", FINGERS),
            ("joints in a finger", JOINTS),
            ("actuators in a finger", ACTUATORS),
            ("processors", PROCESSORS),
        ];
        for (needed, (of, capacity)) in needed.into_iter().zip(capacities) {
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

    /// The least capacities for this hand, as the header has them: fingers, processors, and the joints and the actuators
    /// of one finger, which have two bytes.
    fn counts(&self) -> [u8; 6] {
        let byte = |count: usize| u8::try_from(count).unwrap_or(u8::MAX);
        let most = |count: Option<usize>| u16::try_from(count.unwrap_or(0)).unwrap_or(u16::MAX);
        let joints = self.fingers.iter().map(|finger| finger.joints.len());
        let actuators = (self.fingers.iter()).map(|finger| finger.actuators.len());
        let [j0, j1] = most(joints.max()).to_le_bytes();
        let [a0, a1] = most(actuators.max()).to_le_bytes();
        let (fingers, processors) = (byte(self.fingers.len()), byte(self.processors.len()));
        [fingers, processors, j0, j1, a0, a1]
    }
}
