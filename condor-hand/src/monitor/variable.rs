use core::fmt::{self, Write};

use condor_mbox::{AccessError, MemoryWindow, Region};

use super::layout::ENTRY_BYTES;

const NAME_BYTES: usize = 48;
const UNIT_BYTES: usize = 12;

/// A variable that can be watched.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Variable {
    /// Its name, unique in its monitor.
    pub name: heapless::String<NAME_BYTES>,
    /// Its unit; empty for plain numbers.
    pub unit: heapless::String<UNIT_BYTES>,
    /// How its words are read.
    pub kind: Kind,
}

/// How the word of a value is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Kind {
    /// An IEEE 754 single, in the variable's unit.
    Real = 0,
    /// An unsigned number, or bits.
    Bits = 1,
}

impl Variable {
    /// A variable; of names longer than 48 bytes and units longer than 12 there is only the
    /// beginning.
    #[must_use]
    pub fn new(name: fmt::Arguments<'_>, unit: &str, kind: Kind) -> Self {
        let mut text = Truncated(heapless::String::new());
        // It never fails: what has no room is left out.
        let _ = text.write_fmt(name);
        let mut unit_text = Truncated(heapless::String::new());
        let _ = unit_text.write_str(unit);
        Self {
            name: text.0,
            unit: unit_text.0,
            kind,
        }
    }

    pub(super) fn write<W: MemoryWindow>(
        &self,
        region: &Region<W>,
        at: u32,
    ) -> Result<(), AccessError> {
        let mut bytes = [0; ENTRY_BYTES as usize];
        let text = self
            .name
            .bytes()
            .chain(core::iter::repeat(0))
            .take(NAME_BYTES);
        let unit = self
            .unit
            .bytes()
            .chain(core::iter::repeat(0))
            .take(UNIT_BYTES);
        let kind = (self.kind as u32).to_le_bytes();
        for (byte, value) in bytes.iter_mut().zip(text.chain(unit).chain(kind)) {
            *byte = value;
        }
        for (word, offset) in bytes.chunks_exact(4).zip((at..).step_by(4)) {
            let word = word.first_chunk().copied().unwrap_or_default();
            region.set_word(offset, u32::from_le_bytes(word))?;
        }
        Ok(())
    }

    /// The variable that is described there; none if that is no text or no kind.
    pub(super) fn read<W: MemoryWindow>(
        region: &Region<W>,
        at: u32,
    ) -> Result<Option<Self>, AccessError> {
        let mut bytes = [0; ENTRY_BYTES as usize];
        for (part, offset) in bytes.chunks_exact_mut(4).zip((at..).step_by(4)) {
            part.copy_from_slice(&region.word(offset)?.to_le_bytes());
        }
        let (name, rest) = bytes.split_at(NAME_BYTES);
        let (unit, kind) = rest.split_at(UNIT_BYTES);
        let text = |bytes| {
            let bytes: &[u8] = bytes;
            let used = bytes.split(|&byte| byte == 0).next().unwrap_or(&[]);
            core::str::from_utf8(used).ok()
        };
        let kind = match kind {
            [0, 0, 0, 0] => Kind::Real,
            [1, 0, 0, 0] => Kind::Bits,
            _ => return Ok(None),
        };
        let (Some(name), Some(unit)) = (text(name), text(unit)) else {
            return Ok(None);
        };
        Ok(Some(Self::new(format_args!("{name}"), unit, kind)))
    }
}

/// Text that loses its end where there is no room.
struct Truncated<const BYTES: usize>(heapless::String<BYTES>);

impl<const BYTES: usize> Write for Truncated<BYTES> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for letter in text.chars() {
            if self.0.push(letter).is_err() {
                break;
            }
        }
        Ok(())
    }
}
