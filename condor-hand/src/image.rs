//! The header of images: of bytes that a processor loads, or has linked in.

use core::convert::Infallible;
use core::fmt::{self, Write as _};

use crc::{CRC_32_ISO_HDLC, Crc, Table};
use serde::Serialize;
use serde::de::DeserializeOwned;
use thiserror::Error;

use crate::Subject;

/// Magic, version, fields of the kind of image, the length of what follows, and the checksum of all
/// but itself.
pub(crate) const HEADER_BYTES: usize = 20;

/// The usual 32-bit checksum with a small table: images are read once.
const CRC: Crc<u32, Table<1>> = Crc::<u32, Table<1>>::new(&CRC_32_ISO_HDLC);

/// A kind of image.
pub(crate) struct Format {
    pub(crate) magic: [u8; 4],
    /// Another order of fields is another version.
    pub(crate) version: u16,
}

/// The reason why bytes are not an image, or there is no room for one. `E` is the error that its content can have.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum ImageError<E = Infallible> {
    /// The buffer is too short for the image.
    #[error(
        "the compiled file (the image) does not fit into {len} bytes; shorten its source file, or lengthen the buffer"
    )]
    BufferTooShort {
        /// The length of the buffer, bytes.
        len: usize,
    },
    /// The number of bytes is not the one that the image itself states, or that all such images have.
    #[error("the image must have {needed} bytes, but there are {len}; copy it again, as a whole")]
    Length {
        /// The number of bytes that the image must have.
        needed: usize,
        /// The number of bytes that were given.
        len: usize,
    },
    /// The bytes do not begin like an image of this kind.
    #[error(
        "the image begins with \"{}\" instead of \"{}\": it is another kind of file",
        Letters(.found),
        Letters(.wanted)
    )]
    Magic {
        /// The first four bytes.
        found: [u8; 4],
        /// The first four bytes of an image of this kind.
        wanted: [u8; 4],
    },
    /// The image has a version that this program does not read.
    #[error(
        "the image has version {found} of the format, this program has {wanted}; make the image again"
    )]
    Version {
        /// The version of the image.
        found: u32,
        /// The version that the program reads.
        wanted: u32,
    },
    /// The bytes have changed since they were written.
    #[error(
        "the checksum of the image is {computed:#010x}, it should be {stored:#010x}; make the image again"
    )]
    Checksum {
        /// The checksum in the image.
        stored: u32,
        /// The checksum of its bytes.
        computed: u32,
    },
    /// The image has another number of parts than the program, or more than it has room for.
    #[error(
        "the image (the binary file) is for {found} {of}, but this program for {wanted}; build both for the same number"
    )]
    Count {
        /// The kind of part.
        of: &'static str,
        /// The number in the image; for joints of a hand, the greatest number in one finger.
        found: u32,
        /// The number for which the program is made.
        wanted: usize,
    },
    /// The checksum is right, but the content is malformed.
    #[error("{}the content of the image is malformed; make the image again", .at.prefix())]
    Malformed {
        /// The part of the image that is malformed.
        at: Subject,
    },
    /// The content cannot be used.
    #[error("{}{error}", .at.prefix())]
    Content {
        /// The part of the image that cannot be used.
        at: Subject,
        /// The reason.
        error: E,
    },
}

/// The four bytes with which an image begins, as letters; others than letters and digits are dots.
struct Letters<'b>(&'b [u8; 4]);

impl fmt::Display for Letters<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|&byte| {
            let is_letter = byte.is_ascii_alphanumeric();
            f.write_char(if is_letter { char::from(byte) } else { '.' })
        })
    }
}

impl<E> From<E> for ImageError<E> {
    fn from(error: E) -> Self {
        let at = Subject::Whole;
        Self::Content { at, error }
    }
}

impl Format {
    /// The fields and the body of an image of exactly these bytes.
    pub(crate) fn open<'a, E>(
        &self,
        image: &'a [u8],
    ) -> Result<([u8; 6], &'a [u8]), ImageError<E>> {
        let len = image.len();
        let needed = HEADER_BYTES;
        let Some((header, body)) = image.split_first_chunk::<HEADER_BYTES>() else {
            return Err(ImageError::Length { needed, len });
        };
        let [
            a,
            b,
            c,
            d,
            v0,
            v1,
            fields @ ..,
            l0,
            l1,
            l2,
            l3,
            s0,
            s1,
            s2,
            s3,
        ] = *header;
        let (found, wanted) = ([a, b, c, d], self.magic);
        if found != wanted {
            return Err(ImageError::Magic { found, wanted });
        }
        let (found, wanted) = (u16::from_le_bytes([v0, v1]).into(), self.version.into());
        if found != wanted {
            return Err(ImageError::Version { found, wanted });
        }
        let bytes = u32::from_le_bytes([l0, l1, l2, l3]);
        let needed =
            usize::try_from(bytes).map_or(usize::MAX, |bytes| bytes.saturating_add(needed));
        if len != needed {
            return Err(ImageError::Length { needed, len });
        }
        let stored = u32::from_le_bytes([s0, s1, s2, s3]);
        let computed = checksum(header, body);
        if stored != computed {
            return Err(ImageError::Checksum { stored, computed });
        }
        Ok((fields, body))
    }

    /// Writes the image of a value to the front of `buffer`, and returns its length in bytes.
    pub(crate) fn write<E>(
        &self,
        fields: [u8; 6],
        value: &impl Serialize,
        buffer: &mut [u8],
    ) -> Result<usize, ImageError<E>> {
        let len = buffer.len();
        let halves = buffer.split_first_chunk_mut::<HEADER_BYTES>();
        let written = halves.and_then(|(header, body)| {
            let body = postcard::to_slice(value, body).ok()?;
            self.seal(fields, header, body);
            Some(HEADER_BYTES + body.len())
        });
        written.ok_or(ImageError::BufferTooShort { len })
    }

    /// Reads a value from the body of an image.
    pub(crate) fn value<E, T: DeserializeOwned>(body: &[u8]) -> Result<T, ImageError<E>> {
        match postcard::take_from_bytes(body) {
            Ok((value, [])) => Ok(value),
            _ => Err(ImageError::Malformed { at: Subject::Whole }),
        }
    }

    /// Fills in the header of a body.
    pub(crate) fn seal(&self, fields: [u8; 6], header: &mut [u8; HEADER_BYTES], body: &[u8]) {
        let [a, b, c, d] = self.magic;
        let [v0, v1] = self.version.to_le_bytes();
        let [f0, f1, f2, f3, f4, f5] = fields;
        let bytes = u32::try_from(body.len()).unwrap_or(u32::MAX);
        let [l0, l1, l2, l3] = bytes.to_le_bytes();
        *header = [
            a, b, c, d, v0, v1, f0, f1, f2, f3, f4, f5, l0, l1, l2, l3, 0, 0, 0, 0,
        ];
        let checksum = checksum(header, body).to_le_bytes();
        let [.., s0, s1, s2, s3] = header;
        [*s0, *s1, *s2, *s3] = checksum;
    }
}

/// Returns the checksum of the body and of all but the last four bytes of the header.
fn checksum(header: &[u8; HEADER_BYTES], body: &[u8]) -> u32 {
    let [fields @ .., _, _, _, _] = header;
    let mut digest = CRC.digest();
    digest.update(fields);
    digest.update(body);
    digest.finalize()
}
