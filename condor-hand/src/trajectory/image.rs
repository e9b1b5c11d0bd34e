//! Sequences of motions as bytes, which a processor can load, record and save without allocation.
//!
//! All numbers are little-endian, and positions are IEEE 754 doubles.
//!
//! | offset | content |
//! |---|---|
//! | 0 | "CNDM" |
//! | 4 | version of the format, 2 (two bytes) |
//! | 6 | joints, `J` (two bytes) |
//! | 8 | number of primitives |
//! | 12 | length of the primitives in bytes |
//! | 16 | CRC-32 (ISO-HDLC) of everything except these four bytes |
//! | 20 | the primitives, one after another |
//!
//! A primitive is, in the encoding of `postcard`: its mask, pace, profile, begin, blend, conditions of
//! the start and of the stop, end, and the number of via points; the targets of the joints in the
//! mask; and for each via point its time and the positions of these joints. Values for other joints
//! are not written.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::{Begin, Guards, MotionError, OnEnd, Pace, Primitive, Profile, Via};
use crate::Subject;
use crate::image::{self, Format, ImageError};

const FORMAT: Format = Format {
    magic: *b"CNDM",
    version: 2,
};

/// The size of the header of an image, in bytes, which is also the size of an image without
/// primitives.
pub const HEADER_BYTES: usize = image::HEADER_BYTES;

/// A sequence of primitives of `J` joints that were read from an image and checked. The bytes of
/// the image are borrowed, so nothing is allocated.
#[derive(Clone, Copy, Debug)]
pub struct MotionSequence<'a, const J: usize> {
    body: &'a [u8],
    count: u32,
}

impl<'a, const J: usize> MotionSequence<'a, J> {
    /// Opens the image of a sequence for a program that has `joints` joints, at most `J`, and checks every primitive in
    /// it. `image` must be exactly the bytes of the image, without any after them.
    ///
    /// # Errors
    /// [`ImageError::Length`], [`ImageError::Magic`], [`ImageError::Version`] or [`ImageError::Checksum`] if the
    /// bytes are no image of motions, [`ImageError::Count`] if they are for another number of joints or `joints` is
    /// more than `J`, [`ImageError::Malformed`] or [`ImageError::Content`] if a primitive is wrong. No bytes make this
    /// panic.
    pub fn new(joints: usize, image: &'a [u8]) -> Result<Self, ImageError<MotionError>> {
        let this = Self::open(joints, image)?;
        let mut rest = this.body;
        for index in 0..this.count {
            let at = Subject::Motion(index);
            let primitive = take::<J>(&mut rest).filter(|it| !moves_beyond(it, joints));
            let primitive = primitive.ok_or(ImageError::Malformed { at })?;
            primitive
                .check()
                .map_err(|error| ImageError::Content { at, error })?;
        }
        if rest.is_empty() {
            Ok(this)
        } else {
            let at = Subject::Motion(this.count);
            Err(ImageError::Malformed { at })
        }
    }

    /// Opens an image whose primitives were checked before, for a program that has `joints` joints, at most `J`.
    /// Primitives that are malformed all the same end the sequence.
    ///
    /// # Errors
    /// Returns the same variants as [`new`](Self::new), but for [`ImageError::Malformed`] and
    /// [`ImageError::Content`].
    pub fn open(joints: usize, image: &'a [u8]) -> Result<Self, ImageError<MotionError>> {
        let ([j0, j1, count @ ..], body) = FORMAT.open(image)?;
        let found = u16::from_le_bytes([j0, j1]);
        if joints > J {
            return Err(other_joints(joints as u32, J));
        }
        if usize::from(found) != joints {
            return Err(other_joints(found.into(), joints));
        }
        let count = u32::from_le_bytes(count);
        Ok(Self { body, count })
    }

    /// Returns the number of primitives in the sequence.
    #[must_use]
    pub const fn len(&self) -> u32 {
        self.count
    }

    /// Returns true if the sequence has no primitives.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Returns the primitive at `place`, and moves `place` to the next one; `None` after the last one. The first one is
    /// at 0.
    pub fn read(&self, place: &mut usize) -> Option<Primitive<J>> {
        let mut rest = self.body.get(*place..)?;
        let primitive = take(&mut rest);
        *place = self.body.len() - rest.len();
        primitive
    }

    /// Iterates over the primitives of the sequence in their order.
    pub fn iter(&self) -> impl Iterator<Item = Primitive<J>> + use<'a, J> {
        let mut rest = self.body;
        (0..self.count).map_while(move |_| take(&mut rest))
    }
}

/// Writes the image of a sequence of primitives for a program that has `joints` joints, at most `J`, to the front of
/// `buffer`; [`MotionSequence::new`] reads it. Returns the length of the image in bytes.
///
/// # Errors
/// [`ImageError::BufferTooShort`] if the buffer is too short; [`ImageError::Count`] if `joints` is more than `J`;
/// [`ImageError::Content`] if no generator can run a primitive, with [`MotionError::Mask`] if it moves a joint from
/// `joints` on. The content of the buffer is useless then.
pub fn encode<'m, const J: usize>(
    joints: usize,
    motions: impl IntoIterator<Item = &'m Primitive<J>>,
    buffer: &mut [u8],
) -> Result<usize, ImageError<MotionError>> {
    if joints > J {
        let found = u32::try_from(joints).unwrap_or(u32::MAX);
        return Err(other_joints(found, J));
    }
    write(motions, buffer, HEADER_BYTES, 0, joints)
}

/// Appends a primitive to the image for `joints` joints in the first `len` bytes of `buffer`; a `len` of 0 begins a new
/// image. Returns the new length of the image in bytes.
///
/// # Errors
/// [`ImageError::Length`], [`ImageError::Magic`], [`ImageError::Version`] or [`ImageError::Checksum`] if `buffer` has no
/// image in its first `len` bytes; [`ImageError::Count`] if that image is for another number of joints; otherwise the
/// same variants as [`encode`]. The image does not change then.
pub fn append<const J: usize>(
    joints: usize,
    primitive: &Primitive<J>,
    buffer: &mut [u8],
    len: usize,
) -> Result<usize, ImageError<MotionError>> {
    if len == 0 {
        return encode(joints, [primitive], buffer);
    }
    let short = ImageError::BufferTooShort { len: buffer.len() };
    let image = buffer.get(..len).ok_or(short)?;
    let count = MotionSequence::<J>::open(joints, image)?.count;
    write([primitive], buffer, len, count, joints)
}

/// Returns true if a primitive moves a joint from `joints` on.
fn moves_beyond<const J: usize>(primitive: &Primitive<J>, joints: usize) -> bool {
    (joints..J.min(32)).any(|joint| primitive.mask >> joint & 1 == 1)
}

fn other_joints(found: u32, wanted: usize) -> ImageError<MotionError> {
    ImageError::Count {
        of: "joints",
        found,
        wanted,
    }
}

/// Writes motions of `joints` joints into an image from byte `at` on, after as many as `count`.
fn write<'m, const J: usize>(
    motions: impl IntoIterator<Item = &'m Primitive<J>>,
    buffer: &mut [u8],
    at: usize,
    mut count: u32,
    joints: usize,
) -> Result<usize, ImageError<MotionError>> {
    let short = ImageError::BufferTooShort { len: buffer.len() };
    let (header, body) = buffer.split_first_chunk_mut().ok_or(short)?;
    let mut end = at.saturating_sub(HEADER_BYTES);
    for primitive in motions {
        let at = Subject::Motion(count);
        let content = |error| ImageError::Content { at, error };
        primitive.check().map_err(content)?;
        if moves_beyond(primitive, joints) {
            let mask = primitive.mask;
            return Err(content(MotionError::Mask { mask, joints }));
        }
        put(primitive, body, &mut end).ok_or(short)?;
        count = count.saturating_add(1);
    }
    let (body, _) = body.split_at_checked(end).ok_or(short)?;
    let [j0, j1] = u16::try_from(joints).unwrap_or(u16::MAX).to_le_bytes();
    let [c0, c1, c2, c3] = count.to_le_bytes();
    FORMAT.seal([j0, j1, c0, c1, c2, c3], header, body);
    Ok(HEADER_BYTES + end)
}

/// The part of a primitive that does not depend on its joints.
#[derive(Serialize, Deserialize)]
struct Head {
    mask: u32,
    pace: Pace,
    profile: Profile,
    begin: Begin,
    blend: f64,
    start: Guards,
    stop: Guards,
    on_end: OnEnd,
    vias: u8,
}

/// Takes a primitive from the front of bytes; `None` for what is none.
fn take<const J: usize>(bytes: &mut &[u8]) -> Option<Primitive<J>> {
    let head: Head = take_value(bytes)?;
    if J < 32 && head.mask >> J != 0 {
        return None;
    }
    let moves = |joint: &usize| head.mask >> joint & 1 == 1;
    let mut primitive = Primitive::new(head.pace, head.profile);
    (primitive.mask, primitive.begin, primitive.blend) = (head.mask, head.begin, head.blend);
    (primitive.start, primitive.stop, primitive.on_end) = (head.start, head.stop, head.on_end);
    let targets = primitive.targets.iter_mut().enumerate();
    for (_, target) in targets.filter(|(joint, _)| moves(joint)) {
        *target = take_value(bytes)?;
    }
    for _ in 0..head.vias {
        let at = take_value(bytes)?;
        let mut positions = [0.0; J];
        for (_, position) in positions
            .iter_mut()
            .enumerate()
            .filter(|(joint, _)| moves(joint))
        {
            *position = take_value(bytes)?;
        }
        primitive.vias.push(Via { at, positions }).ok()?;
    }
    Some(primitive)
}

fn take_value<V: DeserializeOwned>(bytes: &mut &[u8]) -> Option<V> {
    let (value, rest) = postcard::take_from_bytes(bytes).ok()?;
    *bytes = rest;
    Some(value)
}

/// Puts a primitive behind the first `at` bytes; `None` if there is no room.
fn put<const J: usize>(primitive: &Primitive<J>, bytes: &mut [u8], at: &mut usize) -> Option<()> {
    let mut put = ImageWriter { bytes, at };
    put.value(&Head {
        mask: primitive.mask,
        pace: primitive.pace,
        profile: primitive.profile,
        begin: primitive.begin,
        blend: primitive.blend,
        start: primitive.start,
        stop: primitive.stop,
        on_end: primitive.on_end,
        // There are at most MAX_VIAS.
        vias: primitive.vias.len() as u8,
    })?;
    for (_, target) in primitive.joints() {
        put.value(&target)?;
    }
    for via in &primitive.vias {
        put.value(&via.at)?;
        for (joint, _) in primitive.joints() {
            put.value(via.positions.get(joint)?)?;
        }
    }
    Some(())
}

/// Puts values one after another.
struct ImageWriter<'b> {
    bytes: &'b mut [u8],
    at: &'b mut usize,
}

impl ImageWriter<'_> {
    fn value(&mut self, value: &impl Serialize) -> Option<()> {
        let used = postcard::to_slice(value, self.bytes.get_mut(*self.at..)?);
        *self.at += used.ok()?.len();
        Some(())
    }
}
