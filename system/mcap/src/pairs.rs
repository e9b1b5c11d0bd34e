//! [`NamePairs`]: names with values, as a file has them.

/// The names and values of a record, such as [`McapRecord::Metadata`](crate::McapRecord::Metadata),
/// in the order in which the file has them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NamePairs<'b>(&'b [u8]);

impl<'b> NamePairs<'b> {
    /// Splits a map from `body`; `None` if it is not whole, or has anything but pairs of strings.
    pub(crate) fn split(body: &'b [u8]) -> Option<(Self, &'b [u8])> {
        let (pairs, rest) = bytes(body)?;
        let mut left = pairs;
        while !left.is_empty() {
            left = pair(left)?.1;
        }
        Some((Self(pairs), rest))
    }

    /// Iterates over the pairs of a name and its value, in the order in which the file has them.
    pub fn iter(&self) -> impl Iterator<Item = (&'b str, &'b str)> + use<'b> {
        let mut left = self.0;
        core::iter::from_fn(move || {
            let (pair, rest) = pair(left)?;
            left = rest;
            Some(pair)
        })
    }

    /// Returns the value of the first pair called `name`; `None` if no pair has this name.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&'b str> {
        self.iter().find(|pair| pair.0 == name).map(|pair| pair.1)
    }
}

fn pair(from: &[u8]) -> Option<((&str, &str), &[u8])> {
    let (name, rest) = text(from)?;
    let (value, rest) = text(rest)?;
    Some(((name, value), rest))
}

/// Splits bytes with their length before them.
pub(crate) fn bytes(from: &[u8]) -> Option<(&[u8], &[u8])> {
    let (len, rest) = from.split_first_chunk()?;
    rest.split_at_checked(usize::try_from(u32::from_le_bytes(*len)).ok()?)
}

/// Splits a text with its length before it.
pub(crate) fn text(from: &[u8]) -> Option<(&str, &[u8])> {
    let (text, rest) = bytes(from)?;
    Some((core::str::from_utf8(text).ok()?, rest))
}
