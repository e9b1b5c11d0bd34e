//! [`Sink`]: where the output of a terminal goes, and [`Tee`]: to two places.

use std::io;

/// Where the output of a terminal goes, and where its input comes from.
///
/// # For implementers
/// Nothing here may wait. What cannot be taken now is offered again.
pub trait Sink {
    /// Takes a prefix of `bytes`, and says how many.
    ///
    /// # Errors
    /// The sink's; then nothing of `bytes` was taken.
    fn take(&mut self, bytes: &[u8]) -> io::Result<usize>;

    /// `bytes` before those that come next were overwritten before they could be read.
    ///
    /// # Errors
    /// The sink's.
    fn overwritten(&mut self, bytes: u32) -> io::Result<()> {
        let _ = bytes;
        Ok(())
    }

    /// What has been typed here; says how many bytes it put into `into`.
    ///
    /// # Errors
    /// The sink's.
    fn typed(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let _ = into;
        Ok(0)
    }

    /// The host sends what is typed from now on: `taken` characters have been taken in this `life` of
    /// the terminal, whoever sent them, which wraps, and `waiting` of those that
    /// [`typed`](Self::typed) gave come next. For input that outlives its host: none of a former host
    /// is under way any more.
    ///
    /// # Errors
    /// The sink's; the host asks again.
    fn typing(&mut self, life: u32, taken: u32, waiting: usize) -> io::Result<()> {
        let _ = (life, taken, waiting);
        Ok(())
    }

    /// Somebody has interrupted: when `taken` characters had been taken, the next `count` of those that
    /// [`typed`](Self::typed) gave were dropped.
    ///
    /// # Errors
    /// The sink's; nothing more is sent then until the host could say it.
    fn dropped(&mut self, taken: u32, count: usize) -> io::Result<()> {
        let _ = (taken, count);
        Ok(())
    }

    /// What was offered and not taken will not be offered again: the terminal has begun a new life.
    fn restarted(&mut self) {}

    /// The host has attached to the terminal in its present `life`; what is offered next begins at
    /// byte `position` of that life's output, which wraps, and
    /// [`overwritten`](Self::overwritten) moves it on. For a sink that outlives its host: what it
    /// took last may not have been acknowledged, and then is offered again.
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

/// Two sinks that get the same; each may itself be a `Tee`.
///
/// The one that takes less holds the terminal; the other one is at most a buffer ahead of it. What is
/// typed at one or the other is not told apart, so neither hears what of it was taken.
#[derive(Debug)]
pub struct Tee<A, B> {
    /// One of them.
    pub first: A,
    /// The other one.
    pub second: B,
    /// Bytes that each has taken of what is offered next; one of the two is 0.
    ahead: [usize; 2],
}

impl<A: Sink, B: Sink> Tee<A, B> {
    /// Both of them.
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
