//! The image of a hand: bytes that a processor loads, or has linked in.

use crc::{CRC_32_ISO_HDLC, Crc, Table};
use thiserror::Error;

use super::{Hand, Mistake, PROCESSORS};

/// What an image begins with.
const MAGIC: [u8; 4] = *b"CNDH";

/// The version of the format; another order of fields is another version.
const VERSION: u16 = 2;

/// Magic, version, the least capacities, the length of what follows, and the checksum of all but
/// itself.
const HEADER: usize = 20;

/// Where the checksum is.
const CHECKSUM: usize = 16;

/// The usual 32-bit checksum with a small table: images are read once.
const CRC: Crc<u32, Table<1>> = Crc::<u32, Table<1>>::new(&CRC_32_ISO_HDLC);

/// The reason for which bytes are not the image of a hand, or a hand cannot become an image.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum ImageError {
    /// The buffer is too short for the image.
    #[error("the image does not fit into {len} bytes")]
    BufferTooShort {
        /// The length of the buffer, bytes.
        len: usize,
    },
    /// There are fewer bytes than the image has.
    #[error("the image has {needed} bytes, there are {len}")]
    Truncated {
        /// The required number of bytes.
        needed: usize,
        /// The number of bytes.
        len: usize,
    },
    /// There are more bytes than the image has.
    #[error("the image has {needed} bytes, there are {len}")]
    TooLong {
        /// The required number of bytes.
        needed: usize,
        /// The number of bytes.
        len: usize,
    },
    /// The bytes do not begin like an image.
    #[error("no image of a hand: it begins with {found:02x?} instead of {MAGIC:02x?}")]
    Magic {
        /// The first four bytes.
        found: [u8; 4],
    },
    /// The image has another version, for other programs.
    #[error("the image has version {found} of the format, this program has {VERSION}")]
    Version {
        /// The version of the image.
        found: u16,
    },
    /// The bytes have changed since they were written.
    #[error("the checksum of the image is {computed:#010x}, it should be {stored:#010x}")]
    Checksum {
        /// The checksum in the image.
        stored: u32,
        /// The checksum of its bytes.
        computed: u32,
    },
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
    /// Writes the image of the hand to the front of `buffer`, and returns its length in bytes.
    ///
    /// The image of a hand does not depend on the capacities of its type.
    ///
    /// # Errors
    ///
    /// * [`Mistake`](ImageError::Mistake) if the hand breaks a rule.
    /// * [`BufferTooShort`](ImageError::BufferTooShort) if the buffer is too short; its content is
    ///   then useless.
    pub fn to_image(&self, buffer: &mut [u8]) -> Result<usize, ImageError> {
        self.check()?;
        let too_short = ImageError::BufferTooShort { len: buffer.len() };
        let Some((header, body)) = buffer.split_first_chunk_mut::<HEADER>() else {
            return Err(too_short);
        };
        let Ok(body) = postcard::to_slice(self, body) else {
            return Err(too_short);
        };
        let Ok(len) = u32::try_from(body.len()) else {
            return Err(too_short);
        };
        let [fingers, joints, processors] = self.counts();
        let fields = MAGIC
            .into_iter()
            .chain(VERSION.to_le_bytes())
            .chain(fingers.to_le_bytes())
            .chain(joints.to_le_bytes())
            .chain(processors.to_le_bytes())
            .chain(len.to_le_bytes());
        for (place, byte) in header.iter_mut().zip(fields) {
            *place = byte;
        }
        if let Some((fields, stored)) = header.split_last_chunk_mut::<4>() {
            *stored = checksum(fields, body).to_le_bytes();
        }
        Ok(HEADER + body.len())
    }

    /// Reads a hand from exactly the bytes of its image, and checks it again.
    ///
    /// # Errors
    ///
    /// Any [`ImageError`] but [`BufferTooShort`](ImageError::BufferTooShort). No bytes make it
    /// panic.
    pub fn from_image(image: &[u8]) -> Result<Self, ImageError> {
        let len = image.len();
        let truncated = |needed| ImageError::Truncated { needed, len };
        let Some((header, body)) = image.split_first_chunk::<HEADER>() else {
            return Err(truncated(HEADER));
        };
        let [
            a,
            b,
            c,
            d,
            v0,
            v1,
            f0,
            f1,
            j0,
            j1,
            p0,
            p1,
            l0,
            l1,
            l2,
            l3,
            s0,
            s1,
            s2,
            s3,
        ] = *header;
        let found = [a, b, c, d];
        if found != MAGIC {
            return Err(ImageError::Magic { found });
        }
        let found = u16::from_le_bytes([v0, v1]);
        if found != VERSION {
            return Err(ImageError::Version { found });
        }
        let needed = u32::from_le_bytes([l0, l1, l2, l3]);
        let needed = usize::try_from(needed)
            .unwrap_or(usize::MAX)
            .saturating_add(HEADER);
        if len < needed {
            return Err(truncated(needed));
        }
        if len > needed {
            return Err(ImageError::TooLong { needed, len });
        }
        let stored = u32::from_le_bytes([s0, s1, s2, s3]);
        let computed = checksum(header.split_at(CHECKSUM).0, body);
        if stored != computed {
            return Err(ImageError::Checksum { stored, computed });
        }
        let counts = [[f0, f1], [j0, j1], [p0, p1]].map(u16::from_le_bytes);
        let capacities = [
            ("fingers", FINGERS),
            ("joints in a finger", JOINTS),
            ("processors", PROCESSORS),
        ];
        for (needed, (of, capacity)) in counts.into_iter().zip(capacities) {
            if usize::from(needed) > capacity {
                return Err(ImageError::Capacity {
                    of,
                    needed,
                    capacity,
                });
            }
        }
        let Ok((hand, [])) = postcard::take_from_bytes::<Self>(body) else {
            return Err(ImageError::Malformed);
        };
        if hand.counts() != counts {
            return Err(ImageError::Malformed);
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

fn checksum(fields: &[u8], body: &[u8]) -> u32 {
    let mut digest = CRC.digest();
    digest.update(fields);
    digest.update(body);
    digest.finalize()
}
