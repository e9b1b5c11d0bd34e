//! [`Trouble`]: what ends an exercise early.

use core::error::Error;
use core::fmt;

use crate::text::Text;

/// A call that must succeed did not: why.
#[derive(PartialEq, Eq)]
pub(crate) struct Trouble(Text<64>);

impl Trouble {
    pub(crate) fn new(why: &str) -> Self {
        Self(Text::of(&why))
    }
}

impl<E: Error> From<E> for Trouble {
    fn from(error: E) -> Self {
        Self(Text::of(&error))
    }
}

impl fmt::Debug for Trouble {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(str::from_utf8(self.0.bytes()).unwrap_or_default())
    }
}
