//! [`Sink`]: a destination of a terminal's output; and [`Tee`], which combines two.

use std::io;

/// A destination of a terminal's output, and a source of its input.
///
/// # For implementers
/// No method may wait. Bytes that are not taken now are offered again.
pub trait Sink {
    /// Takes the first bytes of `bytes`, and returns their number.
    ///
    /// # Errors
    /// The sink's error; it must have taken nothing then.
    fn take(&mut self, bytes: &[u8]) -> io::Result<usize>;

    /// Notes that, before the next bytes that are offered, `bytes` bytes were overwritten unread.
    ///
    /// # Errors
    /// The sink's error.
    fn overwritten(&mut self, bytes: u32) -> io::Result<()> {
        let _ = bytes;
        Ok(())
    }

    /// Copies characters that have been typed here into `into`, and returns their number.
    ///
    /// # Errors
    /// The sink's error.
    fn typed(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let _ = into;
        Ok(0)
    }

    /// Notes the state of the input before the host begins to send. `taken` is the number of
    /// characters from any host that the terminal has taken in this `life`; it wraps. `waiting` is
    /// the number of characters that [`typed`](Self::typed) has returned and that come next. No
    /// character of a former host is under way any more. A sink needs this if its input outlives
    /// its host.
    ///
    /// # Errors
    /// The sink's error; the host calls again.
    fn typing(&mut self, life: u32, taken: u32, waiting: usize) -> io::Result<()> {
        let _ = (life, taken, waiting);
        Ok(())
    }

    /// Notes that an interrupt dropped characters: after `taken` characters had been taken, the
    /// next `count` characters that [`typed`](Self::typed) had returned were dropped.
    ///
    /// # Errors
    /// The sink's error; the host sends no more input until this call succeeds.
    fn dropped(&mut self, taken: u32, count: usize) -> io::Result<()> {
        let _ = (taken, count);
        Ok(())
    }

    /// Notes that the terminal has begun a new life: bytes that were offered but not taken do not
    /// come again.
    fn restarted(&mut self) {}

    /// Notes that the host has attached to the terminal in its present `life`. The next byte that
    /// is offered is byte `position` of that life's output, which wraps;
    /// [`overwritten`](Self::overwritten) advances it. A sink needs this if it outlives its host:
    /// bytes that it took last may not have been acknowledged, and are offered again then.
    fn attached(&mut self, life: u32, position: u32) {
        let _ = (life, position);
    }
}

impl<S: Sink + ?Sized> Sink for Box<S> {
    fn take(&mut self, bytes: &[u8]) -> io::Result<usize> {
        (**self).take(bytes)
    }

    fn overwritten(&mut self, bytes: u32) -> io::Result<()> {
        (**self).overwritten(bytes)
    }

    fn typed(&mut self, into: &mut [u8]) -> io::Result<usize> {
        (**self).typed(into)
    }

    fn typing(&mut self, life: u32, taken: u32, waiting: usize) -> io::Result<()> {
        (**self).typing(life, taken, waiting)
    }

    fn dropped(&mut self, taken: u32, count: usize) -> io::Result<()> {
        (**self).dropped(taken, count)
    }

    fn restarted(&mut self) {
        (**self).restarted();
    }

    fn attached(&mut self, life: u32, position: u32) {
        (**self).attached(life, position);
    }
}

/// Two sinks that get the same output; each may itself be a `Tee`.
///
/// The slower sink determines the pace; the other one is at most one buffer ahead of it. Characters
/// that are typed at the two are not distinguished, so neither sink learns which of its characters
/// were taken.
#[derive(Debug)]
pub struct Tee<A, B> {
    /// The first sink.
    pub first: A,
    /// The second sink.
    pub second: B,
    /// Bytes that each has taken of what is offered next; one of the two is 0.
    ahead: [usize; 2],
}

impl<A: Sink, B: Sink> Tee<A, B> {
    /// Combines two sinks.
    pub const fn new(first: A, second: B) -> Self {
        Self {
            first,
            second,
            ahead: [0, 0],
        }
    }
}

impl<A: Sink, B: Sink> Sink for Tee<A, B> {
    fn take(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let [first, second] = &mut self.ahead;
        // An error of one does not undo what the other one has taken.
        let outcome =
            give(&mut self.first, bytes, first).and(give(&mut self.second, bytes, second));
        let both = (*first).min(*second);
        if both == 0 {
            outcome?;
        }
        *first -= both;
        *second -= both;
        Ok(both)
    }

    fn overwritten(&mut self, bytes: u32) -> io::Result<()> {
        let first = self.first.overwritten(bytes);
        self.second.overwritten(bytes).and(first)
    }

    fn typed(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let count = self.first.typed(into)?;
        Ok(count
            + self
                .second
                .typed(into.get_mut(count..).unwrap_or_default())?)
    }

    fn restarted(&mut self) {
        self.ahead = [0, 0];
        self.first.restarted();
        self.second.restarted();
    }

    fn attached(&mut self, life: u32, position: u32) {
        self.first.attached(life, position);
        self.second.attached(life, position);
    }
}

/// Offers a sink what it has not taken yet.
fn give(sink: &mut impl Sink, bytes: &[u8], taken: &mut usize) -> io::Result<()> {
    let rest = bytes.get(*taken..).unwrap_or_default();
    if !rest.is_empty() {
        *taken += sink.take(rest)?.min(rest.len());
    }
    Ok(())
}
