//! [`CdrWriter`] and [`Reader`]: little-endian CDR (version 1), as ROS 2 transmits it.

use core::str::{Utf8Error, from_utf8};

/// The beginning of each message: CDR, little-endian, no options.
const HEADER: [u8; 4] = [0, 1, 0, 0];

/// The bytes of a message in CDR, the encoding of ROS 2, while the message is written; see
/// [`RosMessage::write`](crate::RosMessage::write).
///
/// Each number is aligned to its own size, counted from the end of the 4 bytes that begin the
/// message.
#[derive(Debug)]
pub struct CdrWriter {
    bytes: Vec<u8>,
}

/// The reason why the bytes of a message cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DecodeError {
    /// The message is not little-endian CDR.
    #[error(
        "the message begins with {found:02x?}, but little-endian CDR begins with {HEADER:02x?}"
    )]
    Header {
        /// The first bytes of the message, four at most.
        found: Vec<u8>,
    },
    /// The message ends too early.
    #[error("the message has {found} bytes, but needs at least {needed}")]
    Short {
        /// The number of bytes of the message.
        found: usize,
        /// The least number of bytes that the message should have.
        needed: usize,
    },
    /// A text is not UTF-8.
    #[error("a text at byte {at} is not UTF-8: {source}")]
    Text {
        /// The offset at which the text begins in the message, in bytes.
        at: usize,
        /// The reason.
        source: Utf8Error,
    },
}

impl CdrWriter {
    pub(crate) fn new() -> Self {
        Self {
            bytes: HEADER.to_vec(),
        }
    }

    pub(crate) fn finish(self) -> Vec<u8> {
        self.bytes
    }

    /// Writes a number of N bytes, given in little-endian order; N is 1, 2, 4 or 8.
    pub(crate) fn number<const N: usize>(&mut self, bytes: [u8; N]) {
        let len = HEADER.len() + (self.bytes.len() - HEADER.len()).next_multiple_of(N);
        self.bytes.resize(len, 0);
        self.bytes.extend(bytes);
    }

    pub(crate) fn u32(&mut self, value: u32) {
        self.number(value.to_le_bytes());
    }

    /// Writes a number of elements, or of bytes of a text.
    fn len(&mut self, len: usize) {
        self.u32(u32::try_from(len).unwrap_or(u32::MAX));
    }

    pub(crate) fn text(&mut self, text: &str) {
        // The terminating zero counts.
        self.len(text.len() + 1);
        self.bytes.extend(text.bytes());
        self.bytes.push(0);
    }

    pub(crate) fn sequence<T>(&mut self, all: &[T], mut write: impl FnMut(&mut Self, &T)) {
        self.len(all.len());
        for one in all {
            write(self, one);
        }
    }

    pub(crate) fn floats(&mut self, all: &[f64]) {
        self.sequence(all, |to, one| to.number(one.to_le_bytes()));
    }
}

/// A message that is being read.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reader<'m> {
    body: &'m [u8],
    at: usize,
}

impl<'m> Reader<'m> {
    pub(crate) fn new(message: &'m [u8]) -> Result<Self, DecodeError> {
        match message.strip_prefix(&HEADER) {
            Some(body) => Ok(Self { body, at: 0 }),
            None => Err(DecodeError::Header {
                found: message.iter().take(HEADER.len()).copied().collect(),
            }),
        }
    }

    /// Returns the bytes of the message behind its header.
    pub(crate) const fn body(&self) -> &'m [u8] {
        self.body
    }

    pub(crate) fn number<const N: usize>(&mut self) -> Result<[u8; N], DecodeError> {
        self.at = self.at.next_multiple_of(N);
        let mut number = [0; N];
        number.copy_from_slice(self.take(N)?);
        Ok(number)
    }

    pub(crate) fn u32(&mut self) -> Result<u32, DecodeError> {
        self.number().map(u32::from_le_bytes)
    }

    pub(crate) fn text(&mut self) -> Result<String, DecodeError> {
        let len = self.u32()?;
        let at = HEADER.len() + self.at;
        let bytes = self.take(usize::try_from(len).unwrap_or(usize::MAX))?;
        let text = from_utf8(bytes.strip_suffix(&[0]).unwrap_or(bytes));
        let text = text.map_err(|source| DecodeError::Text { at, source })?;
        Ok(text.to_owned())
    }

    fn take(&mut self, len: usize) -> Result<&'m [u8], DecodeError> {
        let end = self.at.saturating_add(len);
        let Some(bytes) = self.body.get(self.at..end) else {
            return Err(short(self.body, end));
        };
        self.at = end;
        Ok(bytes)
    }
}

/// The error for a message whose body should have `needed` bytes.
pub(crate) fn short(body: &[u8], needed: usize) -> DecodeError {
    DecodeError::Short {
        found: HEADER.len() + body.len(),
        needed: needed.saturating_add(HEADER.len()),
    }
}
