//! The image of the settings of a grasp: bytes that a processor loads.
//!
//! The header is that of all images, with "CNDG", version 1 and six bytes of zeros; then the settings
//! follow in the encoding of `postcard`.

use super::GraspSettings;
use crate::Subject;
use crate::grasp::GraspError;
use crate::image::{Format, HEADER_BYTES, ImageError};

const FORMAT: Format = Format {
    magic: *b"CNDG",
    version: 1,
};

impl GraspSettings {
    /// The greatest length of the image of grasp settings, in bytes. A buffer of this size is
    /// always enough for [`to_image`](Self::to_image).
    pub const IMAGE_BYTES: usize = HEADER_BYTES + 1 + 8 * (2 * 36 + 6);

    /// Writes the settings as an image, which [`from_image`](Self::from_image) reads, to the front of `buffer`. Returns
    /// the length of the image in bytes.
    ///
    /// # Errors
    /// [`ImageError::Content`] if a grasp cannot be like that, [`ImageError::BufferTooShort`] if the buffer is too
    /// short; its content is then useless.
    pub fn to_image(&self, buffer: &mut [u8]) -> Result<usize, ImageError<GraspError>> {
        self.check()?;
        FORMAT.write([0; 6], self, buffer)
    }

    /// Reads settings from an image that [`to_image`](Self::to_image) wrote, and checks them.
    /// `image` must be exactly the bytes of the image, without any after them.
    ///
    /// # Errors
    /// [`ImageError::Length`], [`ImageError::Magic`], [`ImageError::Version`] or [`ImageError::Checksum`] if the
    /// bytes are no image of a grasp, [`ImageError::Malformed`] or [`ImageError::Content`] if it is not a
    /// possible one. No bytes make this panic.
    pub fn from_image(image: &[u8]) -> Result<Self, ImageError<GraspError>> {
        let ([0, 0, 0, 0, 0, 0], body) = FORMAT.open(image)? else {
            return Err(ImageError::Malformed { at: Subject::Whole });
        };
        let settings: Self = Format::value(body)?;
        settings.check()?;
        Ok(settings)
    }
}
