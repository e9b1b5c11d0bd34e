//! [`Console`] and [`Poster`]: a terminal for programs that read and write.

use core::fmt;
use core::time::Duration;

use condor_mbox::{AccessError, Exclusion, Instant, MemoryWindow, Messenger, Processor, Vector};
use embedded_io::{BufRead, ErrorType, Read, ReadExactError, ReadReady, Write, WriteReady};

use crate::error::ConsoleError;
use crate::terminal::Terminal;

/// Characters that a console holds for [`BufRead`].
const HELD: usize = 64;

/// The longest sleep of a wait for room or for input: what a host that died before its message
/// costs.
const LONGEST_NAP: Duration = Duration::from_millis(10);

impl<W: MemoryWindow, X: Exclusion, const IN: usize> Terminal<W, X, IN> {
    /// Returns a [`Console`], by which the background reads from and writes to this terminal.
    /// `messenger` is the mailbox of this processor.
    pub const fn console<'t, M: Messenger>(&'t self, messenger: &'t M) -> Console<'t, W, X, M, IN> {
        Console {
            terminal: self,
            messenger,
            read_timeout: Duration::from_secs(1),
            held: [0; HELD],
            begin: 0,
            end: 0,
        }
    }

    /// Returns a [`Poster`], by which servo loops, handlers and interrupts write to this terminal
    /// without waiting. `messenger` is the mailbox of this processor.
    pub const fn poster<'t, M: Messenger + ?Sized>(
        &'t self,
        messenger: &'t M,
    ) -> Poster<'t, W, X, M, IN> {
        Poster {
            terminal: self,
            messenger,
        }
    }
}

/// The access of the background to a [`Terminal`]. A read or a write that must wait serves the
/// messages of the mailbox meanwhile.
///
/// * [`Write`]: follows the terminal's [`Policy`](crate::Policy). Under
///   [`Policy::Block`](crate::Policy::Block), `write` loses nothing; `write_all` and formatted
///   writes have one timeout for all their bytes; bytes that are left then are dropped and counted.
///   `flush` waits until the host has acknowledged everything, if the policy is `Block` and a host
///   is attached.
/// * [`Read`], [`BufRead`]: return at least one byte, and in cooked mode at most a line; 0 bytes
///   mean that the character for the end of the file was typed. They fail with
///   [`ConsoleError::TimedOut`] after the time of [`with_read_timeout`](Self::with_read_timeout).
/// * [`fmt::Write`]: bytes that cannot be written are counted as lost, and are not an error.
///
/// A console may hold up to 64 characters after [`BufRead::fill_buf`]; those that were not consumed
/// are lost when the console is dropped.
#[derive(Debug)]
pub struct Console<'t, W, X, M, const IN: usize> {
    terminal: &'t Terminal<W, X, IN>,
    messenger: &'t M,
    read_timeout: Duration,
    held: [u8; HELD],
    /// The index in `held` of the first byte that has not been consumed.
    begin: usize,
    end: usize,
}

impl<W: MemoryWindow, X: Exclusion, M: Messenger, const IN: usize> Console<'_, W, X, M, IN> {
    /// Sets how long a read waits for input; the default is one second.
    #[must_use]
    pub const fn with_read_timeout(self, read_timeout: Duration) -> Self {
        Self {
            read_timeout,
            ..self
        }
    }

    fn ring(&self) -> Result<(), AccessError> {
        ring(self.terminal, self.messenger)
    }

    /// Writes at least one byte of `from`, which is not empty, or drops bytes if the policy demands
    /// it. Returns the number of bytes that were written or dropped, which may be 0.
    ///
    /// `begun` is when the write found no room, and its timeout began.
    fn write_some(&self, from: &[u8], begun: &mut Option<Instant>) -> Result<usize, ConsoleError> {
        let written = self.terminal.put_text(from)?;
        if written > 0 {
            self.ring()?;
            return Ok(written);
        }
        let Some(timeout) = self.terminal.waits()? else {
            self.terminal.output().count_lost(from.len())?;
            return Ok(from.len());
        };
        let now = self.messenger.now();
        let deadline = begun.get_or_insert(now).after(timeout);
        // Looked at here, too: a host that comes and goes ends each wait at once.
        if now >= deadline {
            return Err(ConsoleError::TimedOut { lost: 0 });
        }
        let needed = room_for(from);
        self.wait(deadline, || {
            Ok(self.terminal.output().room()? >= needed || self.terminal.waits()?.is_none())
        })?;
        Ok(0)
    }

    /// Waits until `done` returns true. Meanwhile a word in shared memory shows the host that a
    /// context waits.
    fn wait(
        &self,
        deadline: Instant,
        done: impl Fn() -> Result<bool, AccessError>,
    ) -> Result<(), ConsoleError> {
        self.terminal.output().set_waiting(true)?;
        let outcome = match self.terminal.attached() {
            Ok(host) => self.pause_until(deadline, host, done),
            Err(error) => Err(error.into()),
        };
        self.terminal.output().set_waiting(false)?;
        outcome
    }

    /// Serves messages until `done` returns true, which needs an action of the host or a typed
    /// character.
    fn pause_until(
        &self,
        deadline: Instant,
        host: Option<Processor>,
        done: impl Fn() -> Result<bool, AccessError>,
    ) -> Result<(), ConsoleError> {
        while !done()? {
            let left = Duration::from_nanos(deadline.ns_since(self.messenger.now()));
            if left.is_zero() {
                return Err(ConsoleError::TimedOut { lost: 0 });
            }
            match host {
                Some(host) => self.messenger.serve_for(host, left.min(LONGEST_NAP))?,
                None => self.messenger.serve(left.min(LONGEST_NAP))?,
            };
        }
        Ok(())
    }

    /// Fills the empty buffer; leaves it empty at the end of the file.
    fn fill(&mut self) -> Result<(), ConsoleError> {
        let mut held = [0; HELD];
        self.begin = 0;
        self.end = 0;
        self.end = self.read_into(&mut held)?;
        self.held = held;
        Ok(())
    }

    fn read_into(&self, into: &mut [u8]) -> Result<usize, ConsoleError> {
        let deadline = self.messenger.now().after(self.read_timeout);
        loop {
            if self.terminal.take_interrupt() {
                return Err(ConsoleError::Interrupted);
            }
            let post = |to, vector, data| {
                // If it cannot be sent, the host looks by itself a little later.
                let _ = self.messenger.send(to, vector, data, Duration::ZERO);
            };
            if let Some(count) = self.terminal.take(into, post)? {
                return Ok(count);
            }
            self.pause_until(deadline, None, || Ok(self.terminal.has_input()))?;
        }
    }
}

impl<W, X, M, const IN: usize> ErrorType for Console<'_, W, X, M, IN> {
    type Error = ConsoleError;
}

impl<W: MemoryWindow, X: Exclusion, M: Messenger, const IN: usize> Write
    for Console<'_, W, X, M, IN>
{
    fn write(&mut self, from: &[u8]) -> Result<usize, ConsoleError> {
        if from.is_empty() {
            return Ok(0);
        }
        let mut begun = None;
        loop {
            match self.write_some(from, &mut begun)? {
                0 => {}
                written => return Ok(written),
            }
        }
    }

    fn write_all(&mut self, mut from: &[u8]) -> Result<(), ConsoleError> {
        let mut begun = None;
        while !from.is_empty() {
            match self.write_some(from, &mut begun) {
                Ok(written) => from = from.get(written..).unwrap_or(&[]),
                Err(error) => {
                    self.terminal.output().count_lost(from.len())?;
                    return Err(match error {
                        ConsoleError::TimedOut { .. } => {
                            ConsoleError::TimedOut { lost: from.len() }
                        }
                        error => error,
                    });
                }
            }
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<(), ConsoleError> {
        let Some(timeout) = self.terminal.waits()? else {
            return Ok(());
        };
        self.wait(self.messenger.now().after(timeout), || {
            Ok(self.terminal.unread()? == 0 || self.terminal.waits()?.is_none())
        })
    }
}

impl<W: MemoryWindow, X: Exclusion, M: Messenger, const IN: usize> WriteReady
    for Console<'_, W, X, M, IN>
{
    /// Returns true if a write of one byte would not wait.
    fn write_ready(&mut self) -> Result<bool, ConsoleError> {
        let room = self.terminal.output().room()?;
        Ok(room >= room_for(b"\n") || self.terminal.waits()?.is_none())
    }
}

impl<W: MemoryWindow, X: Exclusion, M: Messenger, const IN: usize> Read
    for Console<'_, W, X, M, IN>
{
    fn read(&mut self, into: &mut [u8]) -> Result<usize, ConsoleError> {
        if into.is_empty() {
            return Ok(0);
        }
        let held = self.held.get(self.begin..self.end).unwrap_or(&[]);
        if held.is_empty() {
            return self.read_into(into);
        }
        let count = held.len().min(into.len());
        for (place, byte) in into.iter_mut().zip(held) {
            *place = *byte;
        }
        self.consume(count);
        Ok(count)
    }

    // The default of `embedded-io`, without its path that panics.
    fn read_exact(&mut self, into: &mut [u8]) -> Result<(), ReadExactError<ConsoleError>> {
        let mut rest = into;
        while !rest.is_empty() {
            rest = match self.read(rest)? {
                0 => return Err(ReadExactError::UnexpectedEof),
                count => rest.get_mut(count..).unwrap_or_default(),
            };
        }
        Ok(())
    }
}

impl<W: MemoryWindow, X: Exclusion, M: Messenger, const IN: usize> ReadReady
    for Console<'_, W, X, M, IN>
{
    fn read_ready(&mut self) -> Result<bool, ConsoleError> {
        Ok(self.begin < self.end || self.terminal.has_input())
    }
}

impl<W: MemoryWindow, X: Exclusion, M: Messenger, const IN: usize> BufRead
    for Console<'_, W, X, M, IN>
{
    fn fill_buf(&mut self) -> Result<&[u8], ConsoleError> {
        if self.begin >= self.end {
            self.fill()?;
        }
        Ok(self.held.get(self.begin..self.end).unwrap_or(&[]))
    }

    fn consume(&mut self, count: usize) {
        self.begin = self.begin.saturating_add(count).min(self.end);
    }
}

impl<W: MemoryWindow, X: Exclusion, M: Messenger, const IN: usize> fmt::Write
    for Console<'_, W, X, M, IN>
{
    fn write_str(&mut self, text: &str) -> fmt::Result {
        match Write::write_all(self, text.as_bytes()) {
            Ok(()) | Err(ConsoleError::TimedOut { .. }) => Ok(()),
            Err(_) => Err(fmt::Error),
        }
    }
}

/// The access of servo loops, handlers and interrupts to a [`Terminal`]: writes that never wait.
///
/// Bytes for which there is no room are lost and counted. Under
/// [`Policy::DropOld`](crate::Policy::DropOld) new bytes overwrite the oldest ones instead. A write
/// takes as long as copying its bytes; interrupts are masked for a few dozen instructions of that
/// time.
#[derive(Debug)]
pub struct Poster<'t, W, X, M: ?Sized, const IN: usize> {
    terminal: &'t Terminal<W, X, IN>,
    messenger: &'t M,
}

impl<W: MemoryWindow, X: Exclusion, M: Messenger + ?Sized, const IN: usize>
    Poster<'_, W, X, M, IN>
{
    /// Writes as many bytes as there is room for, and returns their number. The rest is lost, and
    /// [`Terminal::lost`] counts it.
    ///
    /// # Errors
    /// [`AccessError`] if the terminal's memory cannot be accessed.
    pub fn post(&self, bytes: &[u8]) -> Result<usize, AccessError> {
        let mut written = 0;
        // Once, unless it overwrites: then as often as the bytes fill the ring.
        while let Some(rest) = bytes.get(written..)
            && !rest.is_empty()
        {
            match self.terminal.put_text(rest)? {
                0 => break,
                count => written += count,
            }
        }
        self.terminal
            .output()
            .count_lost(bytes.len().saturating_sub(written))?;
        if written > 0 {
            ring(self.terminal, self.messenger)?;
        }
        Ok(written)
    }
}

impl<W, X, M: ?Sized, const IN: usize> ErrorType for Poster<'_, W, X, M, IN> {
    type Error = ConsoleError;
}

impl<W: MemoryWindow, X: Exclusion, M: Messenger + ?Sized, const IN: usize> Write
    for Poster<'_, W, X, M, IN>
{
    /// Takes all of `from`: what is not written is lost and counted.
    fn write(&mut self, from: &[u8]) -> Result<usize, ConsoleError> {
        self.post(from)?;
        Ok(from.len())
    }

    /// As [`write`](Write::write), which takes all.
    fn write_all(&mut self, from: &[u8]) -> Result<(), ConsoleError> {
        self.post(from)?;
        Ok(())
    }

    /// Does nothing: it would have to wait.
    fn flush(&mut self) -> Result<(), ConsoleError> {
        Ok(())
    }
}

impl<W: MemoryWindow, X: Exclusion, M: Messenger + ?Sized, const IN: usize> fmt::Write
    for Poster<'_, W, X, M, IN>
{
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.post(text.as_bytes()).map(drop).map_err(|_| fmt::Error)
    }
}

/// Sends the host one message, if it can be sent now.
pub(crate) fn ring<W: MemoryWindow, X: Exclusion, M: Messenger + ?Sized, const IN: usize>(
    terminal: &Terminal<W, X, IN>,
    messenger: &M,
) -> Result<(), AccessError> {
    terminal.ring(|to: Processor, vector: Vector, data: u32| {
        // The cursors in shared memory already tell what the message would tell.
        let _ = messenger.send(to, vector, data, Duration::ZERO);
    })
}

/// Room without which nothing of `from` can be written: two bytes for a newline.
pub(crate) fn room_for(from: &[u8]) -> u32 {
    if from.first() == Some(&b'\n') { 2 } else { 1 }
}
