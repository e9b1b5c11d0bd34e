//! [`Sink`]: a destination of a terminal's output, and a source of its input.

use std::io;

/// A piece of a terminal's output, which a host offers to a [`Sink`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Piece<'a> {
    /// The incarnation of the terminal that wrote it: a number that changes each time a program makes the
    /// terminal anew.
    pub incarnation: u32,
    /// The number of bytes of output of the same incarnation that came before this piece; wraps.
    pub position: u32,
    /// The number of bytes directly before this piece that are missing, because they were
    /// overwritten unread.
    pub overwritten: u32,
    /// The bytes of output. The slice is empty if all new bytes have been overwritten.
    pub bytes: &'a [u8],
}

impl<'a, T: AsRef<[u8]> + ?Sized> From<&'a T> for Piece<'a> {
    /// Makes a piece of bytes that do not come from a terminal.
    fn from(bytes: &'a T) -> Self {
        Self {
            bytes: bytes.as_ref(),
            ..Self::default()
        }
    }
}

/// A place where a terminal's output is shown or kept, and where a person types its input. A
/// [`TerminalHost`](super::TerminalHost) calls it.
///
/// # For implementers
/// No method may wait. Bytes that are not taken now are offered again. The bytes that a sink took
/// last may not have been acknowledged when a host ends; the next host then offers them again. A
/// sink that outlives its host recognizes them by their positions.
pub trait Sink {
    /// Takes the first bytes of `piece`, and returns their number. The overwritten bytes that `piece` counts
    /// before them are not reported again.
    ///
    /// # Errors
    /// Returns the sink's error if it fails; it must have taken nothing then.
    fn take(&mut self, piece: Piece<'_>) -> io::Result<usize>;

    /// Copies characters that have been typed here into `into`, and returns their number.
    ///
    /// # Errors
    /// Returns the sink's error if it fails.
    fn typed(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let _ = into;
        Ok(0)
    }

    /// Returns true if the host may send `character` now. The host calls this just before it sends,
    /// so a sink that records when characters are sent does so here. `character` is the first of
    /// the last `waiting` characters that [`typed`](Self::typed) has returned. If the processor
    /// does not take the character, the host asks again.
    ///
    /// # Errors
    /// Returns the sink's error if it fails; the character is not sent then.
    fn sends(&mut self, character: u8, waiting: usize) -> io::Result<bool> {
        let _ = (character, waiting);
        Ok(true)
    }

    /// Notes how much input the terminal has taken. The host calls this at moments when no
    /// character is on its way: before it begins to send, and when an interrupt has dropped
    /// characters. `taken` is the number of characters from any host that the terminal has taken
    /// since its program made it, in the incarnation with the number `incarnation`; it wraps. Of the characters
    /// that [`typed`](Self::typed) has returned, the last `waiting` come next. A sink needs this if
    /// its input outlives its host.
    ///
    /// # Errors
    /// Returns the sink's error if it fails; the host sends no input until this call succeeds.
    fn typing(&mut self, incarnation: u32, taken: u32, waiting: usize) -> io::Result<()> {
        let _ = (incarnation, taken, waiting);
        Ok(())
    }
}

/// Takes everything, and shows it nowhere.
impl Sink for () {
    fn take(&mut self, piece: Piece<'_>) -> io::Result<usize> {
        Ok(piece.bytes.len())
    }
}
