//! Sequences of motions as bytes, which a processor can load, record and save without allocation.
//!
//! All numbers are little-endian, and positions are IEEE 754 doubles.
//!
//! | offset | content |
//! |---|---|
//! | 0 | "CNDM" |
//! | 4 | version of the format, 1 (two bytes) |
//! | 6 | joints, `J` (two bytes) |
//! | 8 | number of primitives |
//! | 12 | length of the primitives in bytes |
//! | 16 | CRC-32 (ISO-HDLC) of everything except these four bytes |
//! | 20 | the primitives, one after another |
//!
//! A primitive consists of: its mask, and the mask of its relative targets (four bytes each); kind
//! of pace (0 duration, 1 speed), profile, begin, end, conditions of the start, conditions of the
//! stop (bit 0 torque, 1 tension, 2 time, 3 contact), number of via points, and 0 (a byte each);
//! pace and blend; the limits of the conditions; the targets of the joints in the mask; and for
//! each via point its time and the positions of these joints. Values for other joints are not
//! written.

use thiserror::Error;

use super::{Begin, Guards, OnEnd, Pace, Primitive, PrimitiveError, Profile, Target, Via};
use crate::image::{self, Format, HeaderError};

const FORMAT: Format = Format {
    magic: *b"CNDM",
    version: 1,
};

/// The size of an image without primitives, in bytes.
pub const HEADER_BYTES: usize = image::HEADER_BYTES;

const TORQUE: u8 = 1 << 0;
const TENSION: u8 = 1 << 1;
const TIME: u8 = 1 << 2;
const CONTACT: u8 = 1 << 3;

/// The reason for which bytes are not a sequence of motions, or a sequence cannot become bytes.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum ImageError {
    /// The bytes are no image, or there is no room for one.
    #[error(transparent)]
    Header(#[from] HeaderError),
    /// The motions are for another number of joints.
    #[error("the motions are for {found} joints, this program has {joints}")]
    Joints {
        /// The number of joints in the image.
        found: u16,
        /// The number of joints of the type.
        joints: usize,
    },
    /// The checksum is right, but a primitive is malformed.
    #[error("motion {index}: its bytes are not those of a motion")]
    Malformed {
        /// The primitive, from 0.
        index: u32,
    },
    /// No generator can run the primitive.
    #[error("motion {index}: {error}")]
    Primitive {
        /// The primitive, from 0.
        index: u32,
        /// The reason.
        error: PrimitiveError,
    },
}

/// A checked sequence of primitives of `J` joints, in the bytes of its image.
#[derive(Clone, Copy, Debug)]
pub struct Motions<'a, const J: usize> {
    body: &'a [u8],
    count: u32,
}

impl<'a, const J: usize> Motions<'a, J> {
    /// Reads the sequence in exactly these bytes, and checks every primitive.
    ///
    /// # Errors
    /// Any [`ImageError`]. No bytes make it panic.
    pub fn new(image: &'a [u8]) -> Result<Self, ImageError> {
        let this = Self::unchecked(image)?;
        let mut taken = Taken(this.body);
        for index in 0..this.count {
            let primitive = taken
                .primitive::<J>()
                .ok_or(ImageError::Malformed { index })?;
            primitive
                .check()
                .map_err(|error| ImageError::Primitive { index, error })?;
        }
        if taken.0.is_empty() {
            Ok(this)
        } else {
            Err(ImageError::Malformed { index: this.count })
        }
    }

    /// The same without a look at the primitives.
    fn unchecked(image: &'a [u8]) -> Result<Self, ImageError> {
        let ([j0, j1, count @ ..], body) = FORMAT.open(image)?;
        let found = u16::from_le_bytes([j0, j1]);
        if usize::from(found) != J {
            return Err(ImageError::Joints { found, joints: J });
        }
        let count = u32::from_le_bytes(count);
        Ok(Self { body, count })
    }

    /// Returns the number of primitives.
    #[must_use]
    pub const fn len(&self) -> u32 {
        self.count
    }

    /// Returns whether there are no primitives.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Iterates over the primitives in their order.
    pub fn iter(&self) -> impl Iterator<Item = Primitive<J>> + use<'a, J> {
        let mut taken = Taken(self.body);
        (0..self.count).map_while(move |_| taken.primitive())
    }
}

/// Writes the image of a sequence to the front of `buffer`, and returns its length in bytes.
///
/// # Errors
/// [`ImageError::Header`] if the buffer is too short; [`ImageError::Primitive`] if no generator can
/// run a primitive. The content of the buffer is useless then.
pub fn encode<'m, const J: usize>(
    motions: impl IntoIterator<Item = &'m Primitive<J>>,
    buffer: &mut [u8],
) -> Result<usize, ImageError> {
    write(motions, buffer, HEADER_BYTES, 0)
}

/// Appends a primitive to the image in the first `len` bytes of `buffer`, and returns the new
/// length of the image. If `len` is 0, it begins an image.
///
/// # Errors
/// Those of [`encode`] and [`Motions::new`]; the image does not change then.
pub fn append<const J: usize>(
    primitive: &Primitive<J>,
    buffer: &mut [u8],
    len: usize,
) -> Result<usize, ImageError> {
    if len == 0 {
        return encode([primitive], buffer);
    }
    let short = HeaderError::BufferTooShort { len: buffer.len() };
    let count = Motions::<J>::unchecked(buffer.get(..len).ok_or(short)?)?.count;
    write([primitive], buffer, len, count)
}

/// Writes motions into an image from byte `at` on, after as many as `count`.
fn write<'m, const J: usize>(
    motions: impl IntoIterator<Item = &'m Primitive<J>>,
    buffer: &mut [u8],
    at: usize,
    mut count: u32,
) -> Result<usize, ImageError> {
    let short = HeaderError::BufferTooShort { len: buffer.len() };
    let (header, body) = buffer.split_first_chunk_mut().ok_or(short)?;
    let mut put = Put {
        bytes: body,
        at: at.saturating_sub(HEADER_BYTES),
    };
    for primitive in motions {
        let index = count;
        primitive
            .check()
            .map_err(|error| ImageError::Primitive { index, error })?;
        put.primitive(primitive).ok_or(short)?;
        count = count.saturating_add(1);
    }
    let end = put.at;
    let (body, _) = body.split_at_checked(end).ok_or(short)?;
    let [j0, j1] = u16::try_from(J).unwrap_or(u16::MAX).to_le_bytes();
    let [c0, c1, c2, c3] = count.to_le_bytes();
    FORMAT.seal([j0, j1, c0, c1, c2, c3], header, body);
    Ok(HEADER_BYTES + end)
}

/// Takes values from the front of bytes.
struct Taken<'a>(&'a [u8]);

impl Taken<'_> {
    fn bytes<const K: usize>(&mut self) -> Option<[u8; K]> {
        let (first, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*first)
    }

    fn word(&mut self) -> Option<u32> {
        self.bytes().map(u32::from_le_bytes)
    }

    fn number(&mut self) -> Option<f64> {
        self.bytes().map(f64::from_le_bytes)
    }

    /// `None` for what is none.
    fn primitive<const J: usize>(&mut self) -> Option<Primitive<J>> {
        let (mask, relative) = (self.word()?, self.word()?);
        if relative & !mask != 0 || (J < 32 && mask >> J != 0) {
            return None;
        }
        let [pace, profile, begin, on_end, start, stop, vias, 0] = self.bytes()? else {
            return None;
        };
        let number = self.number()?;
        let pace = match pace {
            0 => Pace::Duration(number),
            1 => Pace::Speed(number),
            _ => return None,
        };
        let profile = match profile {
            0 => Profile::Cubic,
            1 => Profile::MinimumJerk,
            2 => Profile::Trapezoid,
            3 => Profile::JerkLimited,
            _ => return None,
        };
        let mut primitive = Primitive::new(pace, profile);
        primitive.mask = mask;
        primitive.begin = match begin {
            0 => Begin::After,
            1 => Begin::Beside,
            2 => Begin::Now,
            _ => return None,
        };
        primitive.on_end = match on_end {
            0 => OnEnd::Next,
            1 => OnEnd::Hold,
            _ => return None,
        };
        primitive.blend = self.number()?;
        primitive.start = self.guards(start)?;
        primitive.stop = self.guards(stop)?;
        for (joint, target) in primitive.targets.iter_mut().enumerate() {
            if mask >> joint & 1 == 1 {
                let number = self.number()?;
                *target = if relative >> joint & 1 == 1 {
                    Target::Relative(number)
                } else {
                    Target::Absolute(number)
                };
            }
        }
        for _ in 0..vias {
            let mut via = Via {
                at: self.number()?,
                positions: [0.0; J],
            };
            for (joint, position) in via.positions.iter_mut().enumerate() {
                if mask >> joint & 1 == 1 {
                    *position = self.number()?;
                }
            }
            primitive.vias.push(via).ok()?;
        }
        Some(primitive)
    }

    fn guards(&mut self, flags: u8) -> Option<Guards<f64>> {
        if flags & !(TORQUE | TENSION | TIME | CONTACT) != 0 {
            return None;
        }
        let mut guards = Guards::none();
        for (flag, place) in [
            (TORQUE, &mut guards.torque),
            (TENSION, &mut guards.tension),
            (TIME, &mut guards.time),
        ] {
            if flags & flag != 0 {
                *place = Some(self.number()?);
            }
        }
        guards.contact = flags & CONTACT != 0;
        Some(guards)
    }
}

/// Puts values one after another, each whole or not at all.
struct Put<'b> {
    bytes: &'b mut [u8],
    at: usize,
}

impl Put<'_> {
    fn bytes<const K: usize>(&mut self, bytes: [u8; K]) -> Option<()> {
        let place = self.bytes.get_mut(self.at..)?.first_chunk_mut()?;
        *place = bytes;
        self.at += K;
        Some(())
    }

    fn number(&mut self, number: f64) -> Option<()> {
        self.bytes(number.to_le_bytes())
    }

    /// `None` if there is no room.
    fn primitive<const J: usize>(&mut self, primitive: &Primitive<J>) -> Option<()> {
        let relative = primitive.joints().fold(0, |relative, (joint, target)| {
            relative | u32::from(matches!(target, Target::Relative(_))) << joint
        });
        self.bytes(primitive.mask.to_le_bytes())?;
        self.bytes(relative.to_le_bytes())?;
        let (pace, number) = match primitive.pace {
            Pace::Duration(duration) => (0, duration),
            Pace::Speed(speed) => (1, speed),
        };
        let profile = match primitive.profile {
            Profile::Cubic => 0,
            Profile::MinimumJerk => 1,
            Profile::Trapezoid => 2,
            Profile::JerkLimited => 3,
        };
        let begin = match primitive.begin {
            Begin::After => 0,
            Begin::Beside => 1,
            Begin::Now => 2,
        };
        let on_end = match primitive.on_end {
            OnEnd::Next => 0,
            OnEnd::Hold => 1,
        };
        let (start, stop) = (flags(&primitive.start), flags(&primitive.stop));
        // There are at most MAX_VIAS.
        let vias = primitive.vias.len() as u8;
        self.bytes([pace, profile, begin, on_end, start, stop, vias, 0])?;
        self.number(number)?;
        self.number(primitive.blend)?;
        for guards in [&primitive.start, &primitive.stop] {
            let limits = [guards.torque, guards.tension, guards.time];
            for limit in limits.into_iter().flatten() {
                self.number(limit)?;
            }
        }
        for (_, Target::Absolute(number) | Target::Relative(number)) in primitive.joints() {
            self.number(number)?;
        }
        for via in &primitive.vias {
            self.number(via.at)?;
            for (joint, position) in via.positions.iter().enumerate() {
                if primitive.mask >> joint & 1 == 1 {
                    self.number(*position)?;
                }
            }
        }
        Some(())
    }
}

fn flags(guards: &Guards<f64>) -> u8 {
    let flag = |is: bool, flag: u8| if is { flag } else { 0 };
    flag(guards.torque.is_some(), TORQUE)
        | flag(guards.tension.is_some(), TENSION)
        | flag(guards.time.is_some(), TIME)
        | flag(guards.contact, CONTACT)
}
