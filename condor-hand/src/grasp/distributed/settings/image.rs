//! The image of the settings of a grasp: bytes that a processor loads.
//!
//! The header is that of all images, with "CNDG", version 1 and six bytes of zeros; then the settings
//! follow in the encoding of `postcard`.

use thiserror::Error;

use super::GraspSettings;
use crate::grasp::GraspError;
use crate::image::{Format, HEADER_BYTES, HeaderError};

const FORMAT: Format = Format {
    magic: *b"CNDG",
    version: 1,
};

/// The reason why bytes are not the image of a grasp, or a grasp cannot become an image.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum GraspImageError {
    /// The bytes are no image, or there is no room for one.
    #[error(transparent)]
    Header(#[from] HeaderError),
    /// The checksum is right, but the bytes are not a grasp.
    #[error("the bytes of the image are not those of a grasp")]
    Malformed,
    /// A grasp cannot be like that.
    #[error("no grasp can have the numbers of the image")]
    Grasp(GraspError),
}

impl GraspSettings {
    /// The greatest length of the image of grasp settings, in bytes. A buffer of this size is
    /// always enough for [`to_image`](Self::to_image).
    pub const IMAGE_BYTES: usize = HEADER_BYTES + 1 + 8 * (2 * 36 + 6);

    /// Writes the settings as an image, which [`from_image`](Self::from_image) reads, to the front of `buffer`. Returns
    /// the length of the image in bytes.
    ///
    /// # Errors
    /// * [`Grasp`](GraspImageError::Grasp) if a grasp cannot be like that.
    /// * [`Header`](GraspImageError::Header) if the buffer is too short; its content is then useless.
    pub fn to_image(&self, buffer: &mut [u8]) -> Result<usize, GraspImageError> {
        self.check().map_err(GraspImageError::Grasp)?;
        let too_short = HeaderError::BufferTooShort { len: buffer.len() };
        let Some((header, body)) = buffer.split_first_chunk_mut::<HEADER_BYTES>() else {
            return Err(too_short.into());
        };
        let body = postcard::to_slice(self, body).map_err(|_| too_short)?;
        FORMAT.seal([0; 6], header, body);
        Ok(HEADER_BYTES + body.len())
    }

    /// Reads settings from an image that [`to_image`](Self::to_image) wrote, and checks them.
    /// `image` must be exactly the bytes of the image, without any after them.
    ///
    /// # Errors
    /// [`GraspImageError::Header`] if the bytes are no image of a grasp,
    /// [`GraspImageError::Malformed`] or [`GraspImageError::Grasp`] if it is not a possible one. No
    /// bytes make this panic.
    pub fn from_image(image: &[u8]) -> Result<Self, GraspImageError> {
        let ([0, 0, 0, 0, 0, 0], body) = FORMAT.open(image)? else {
            return Err(GraspImageError::Malformed);
        };
        let Ok((settings, [])) = postcard::take_from_bytes::<Self>(body) else {
            return Err(GraspImageError::Malformed);
        };
        settings.check().map_err(GraspImageError::Grasp)?;
        Ok(settings)
    }
}
