//! The checks of [`Bus`].

use core::fmt;

use crate::bus::{Bus, BusError, BusErrorKind, Width};

/// The addresses that [`bus()`] accesses while it checks a bus.
#[derive(Clone, Copy, Debug)]
pub struct BusMemory {
    /// The address, a multiple of 8, of eight bytes that keep what is written to them.
    pub memory: usize,
    /// The address, a multiple of 8, of eight bytes where nothing answers. `None` skips this check,
    /// for a bus that cannot detect that nothing answers.
    pub absent: Option<usize>,
    /// Whether the bus refuses misaligned accesses. A bus with the error type
    /// [`Infallible`](core::convert::Infallible) cannot refuse any; `false` skips this check.
    pub refuses_misaligned: bool,
}

/// The access that [`bus()`] was making when a check failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BusAccess {
    /// A read of one register.
    Read,
    /// A write of this value.
    Write(u32),
    /// A call of [`Bus::answers`]; the result is 1 for yes.
    Answers,
    /// A block of this many bytes, written and read; the result is 1 if the bytes read are those
    /// written.
    Block(usize),
}

/// The first check of [`bus()`] that failed, with the access that showed it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{check}: {access} of {} bits at {address:#x} returned {}, expected {}",
    8 * *.width as u32,
    OutcomeText(.found),
    OutcomeText(.expected),
)]
pub struct BusFailure {
    /// The rule that is broken.
    pub check: &'static str,
    /// The access that showed it.
    pub access: BusAccess,
    /// The width of the access.
    pub width: Width,
    /// The bus address of the access.
    pub address: usize,
    /// The result of the access: a value (zero for a write), or a kind of error.
    pub found: Result<u32, BusErrorKind>,
    /// The required result; if several errors are allowed, one of them.
    pub expected: Result<u32, BusErrorKind>,
}

impl fmt::Display for BusAccess {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Read => f.write_str("a read"),
            Self::Write(value) => write!(f, "a write of {value:#x}"),
            Self::Answers => f.write_str("a question for an answer"),
            Self::Block(bytes) => write!(f, "a block of {bytes} bytes"),
        }
    }
}

/// The result of an access in words.
struct OutcomeText<'o>(&'o Result<u32, BusErrorKind>);

impl fmt::Display for OutcomeText<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Ok(value) => write!(f, "{value:#x}"),
            Err(kind) => write!(f, "\"{kind}\""),
        }
    }
}

const WIDTHS: [Width; 3] = [Width::Bits8, Width::Bits16, Width::Bits32];
const BACKGROUND: [u32; 2] = [0x0123_4567, 0x89ab_cdef];

/// Checks that `bus` follows the rules for implementers of [`Bus`], by accesses to the addresses in
/// `ground`. The eight bytes at `ground.memory` are overwritten.
///
/// # Errors
/// [`BusFailure`] for the first check that fails.
pub fn bus<B: Bus>(bus: &B, ground: BusMemory) -> Result<(), BusFailure> {
    let suite = Suite { bus, ground };
    suite.values_are_kept()?;
    suite.neighbours_are_left_alone()?;
    suite.widths_agree()?;
    suite.blocks_are_bytes_in_order()?;
    if ground.refuses_misaligned {
        suite.misaligned_accesses_are_refused()?;
    }
    if let Some(absent) = ground.absent {
        suite.nothing_answers(absent)?;
    }
    Ok(())
}

struct Suite<'b, B> {
    bus: &'b B,
    ground: BusMemory,
}

impl<B: Bus> Suite<'_, B> {
    fn values_are_kept(&self) -> Result<(), BusFailure> {
        let check = "a read returns the bytes that were written, also after a probe";
        for width in WIDTHS {
            for offset in (0..8).step_by(width.bytes()) {
                for pattern in [0, u32::MAX, 0x8182_8384, 0x1020_4080] {
                    let value = pattern & width.mask();
                    self.expect(check, BusAccess::Write(value), width, offset, Ok(0))?;
                    self.expect(check, BusAccess::Answers, width, offset, Ok(1))?;
                    self.expect(check, BusAccess::Read, width, offset, Ok(value))?;
                }
            }
        }
        Ok(())
    }

    fn neighbours_are_left_alone(&self) -> Result<(), BusFailure> {
        let check = "a write changes only its own bytes";
        for width in WIDTHS {
            for offset in (0..8).step_by(width.bytes()) {
                let mut bytes = self.lay_background(check)?;
                self.expect(check, BusAccess::Write(0), width, offset, Ok(0))?;
                for byte in bytes.iter_mut().skip(offset).take(width.bytes()) {
                    *byte = 0;
                }
                self.expect_bytes(check, bytes)?;
            }
        }
        Ok(())
    }

    fn widths_agree(&self) -> Result<(), BusFailure> {
        let check = "accesses of all widths see the same memory, in the processor's byte order";
        let bytes = self.lay_background(check)?;
        self.expect_bytes(check, bytes)?;
        let (pairs, _) = bytes.as_chunks::<2>();
        for (offset, pair) in (0..).step_by(2).zip(pairs) {
            let value = u16::from_ne_bytes(*pair).into();
            self.expect(check, BusAccess::Read, Width::Bits16, offset, Ok(value))?;
        }
        Ok(())
    }

    fn blocks_are_bytes_in_order(&self) -> Result<(), BusFailure> {
        let check = "a block transfer moves exactly the bytes from its address on, in order";
        for first in 0..8 {
            for len in 0..8 - first {
                let mut bytes = self.lay_background(check)?;
                let address = self.ground.memory.wrapping_add(first);
                let block = bytes.iter_mut().skip(first).take(len);
                block.for_each(|byte| *byte = byte.wrapping_add(0x55));
                let part = bytes.get(first..first + len).unwrap_or_default();
                let mut found = [0; 8];
                let into = found.get_mut(..len).unwrap_or_default();
                let moved = self.bus.write_block(address, part);
                let moved = moved.and_then(|()| self.bus.read_block(address, into));
                let found = moved.map(|()| u32::from(into == part));
                let found = found.map_err(|error| error.kind());
                let at = (BusAccess::Block(len), Width::Bits8, address);
                compare(check, at, found, Ok(1))?;
                self.expect_bytes(check, bytes)?;
            }
        }
        Ok(())
    }

    fn misaligned_accesses_are_refused(&self) -> Result<(), BusFailure> {
        let check = "a misaligned access returns `Misaligned` and changes nothing";
        let bytes = self.lay_background(check)?;
        let refused = Err(BusErrorKind::Misaligned);
        for (width, offset) in [
            (Width::Bits16, 1),
            (Width::Bits16, 3),
            (Width::Bits32, 1),
            (Width::Bits32, 2),
            (Width::Bits32, 3),
        ] {
            self.expect(check, BusAccess::Read, width, offset, refused)?;
            self.expect(check, BusAccess::Write(0), width, offset, refused)?;
            self.expect(check, BusAccess::Answers, width, offset, Ok(0))?;
        }
        self.expect_bytes(check, bytes)
    }

    fn nothing_answers(&self, absent: usize) -> Result<(), BusFailure> {
        let check = "an access to an address without a device returns an error";
        for width in WIDTHS {
            for offset in (0..8).step_by(width.bytes()) {
                let address = absent.wrapping_add(offset);
                for access in [BusAccess::Read, BusAccess::Write(0), BusAccess::Answers] {
                    let found = match self.make(access, width, address) {
                        // Any of these would do.
                        Err(BusErrorKind::OutOfRange | BusErrorKind::Lost) => {
                            Err(BusErrorKind::NoAnswer)
                        }
                        found => found,
                    };
                    let expected = match access {
                        BusAccess::Answers => Ok(0),
                        _ => Err(BusErrorKind::NoAnswer),
                    };
                    compare(check, (access, width, address), found, expected)?;
                }
            }
        }
        Ok(())
    }

    /// Fills the memory, and returns the bytes that it then holds.
    fn lay_background(&self, check: &'static str) -> Result<[u8; 8], BusFailure> {
        let mut bytes = [0; 8];
        let (words, _) = bytes.as_chunks_mut::<4>();
        for ((offset, value), word) in (0..).step_by(4).zip(BACKGROUND).zip(words) {
            self.expect(check, BusAccess::Write(value), Width::Bits32, offset, Ok(0))?;
            *word = value.to_ne_bytes();
        }
        Ok(bytes)
    }

    fn expect_bytes(&self, check: &'static str, bytes: [u8; 8]) -> Result<(), BusFailure> {
        for (offset, byte) in bytes.into_iter().enumerate() {
            self.expect(
                check,
                BusAccess::Read,
                Width::Bits8,
                offset,
                Ok(byte.into()),
            )?;
        }
        Ok(())
    }

    fn expect(
        &self,
        check: &'static str,
        access: BusAccess,
        width: Width,
        offset: usize,
        expected: Result<u32, BusErrorKind>,
    ) -> Result<(), BusFailure> {
        let address = self.ground.memory.wrapping_add(offset);
        let found = self.make(access, width, address);
        compare(check, (access, width, address), found, expected)
    }

    fn make(&self, access: BusAccess, width: Width, address: usize) -> Result<u32, BusErrorKind> {
        let bus = self.bus;
        let result = match access {
            BusAccess::Read => bus.read(address, width),
            BusAccess::Write(value) => bus.write(address, width, value).map(|()| 0),
            BusAccess::Answers | BusAccess::Block(_) => Ok(bus.answers(address, width).into()),
        };
        result.map_err(|error| error.kind())
    }
}

fn compare(
    check: &'static str,
    (access, width, address): (BusAccess, Width, usize),
    found: Result<u32, BusErrorKind>,
    expected: Result<u32, BusErrorKind>,
) -> Result<(), BusFailure> {
    if found == expected {
        return Ok(());
    }
    Err(BusFailure {
        check,
        access,
        width,
        address,
        found,
        expected,
    })
}
