//! [`Terminal`]: the processor's side of a terminal.

use core::time::Duration;

use condor_mbox::{
    AccessError, Allocator, Call, Exclusion, MemoryWindow, Messenger as _, Processor, Region,
    Vector,
};

use crate::error::TerminalError;
use crate::input::{Input, InputResult};
use crate::layout::{self, ALIGNMENT, BLOCK_BYTES, TerminalVectors, reply};
use crate::output::Output;
use crate::policy::Policy;
use crate::settings::TerminalSettings;

/// A virtual terminal of this processor (memo, section 3.6.3), which a host shows, for example on a
/// pseudo-terminal or in a log. Output waits in a ring in memory that is shared with the host.
///
/// `W` is the type of the window on that memory, `X` the [`Exclusion`] between the contexts of the
/// processor, and `IN` the size of the queue for typed characters, a power of two. All methods take
/// `&self`, and the background, handlers and servo loops may interrupt each other in them.
///
/// | context | reads and writes through |
/// |---|---|
/// | background | a [`Console`](crate::Console), which waits as the [`Policy`] says, and serves messages meanwhile |
/// | handler, interrupt, servo loop | a [`Poster`](crate::Poster), which never waits: bytes without room are lost and counted |
///
/// The initial settings are [`TerminalSettings::COOKED`] and [`Policy::DropNew`].
///
/// ```
/// use std::time::Duration;
///
/// use condor_mbox::sim::SimSystem;
/// use condor_mbox::{Call, CriticalSection, MemoryWindow, Allocator, Processor, Region};
/// use condor_tty::{Terminal, TerminalVectors};
/// use embedded_io::{Read, Write};
///
/// # const HOST: Processor = Processor(0);
/// const HAND: Processor = Processor(1);
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// # let system = SimSystem::<2>::in_virtual_time(4096);
/// // The terminal before the mailbox, whose handlers borrow it.
/// let [_, windows] = system.windows(HAND);
/// let ram = Region::users(windows.data)?;
/// let mut allocator = Allocator::new(ram.size()); // one for all that the processor has there
/// let terminal = Terminal::<_, _, 128>::new(ram.clone(), &mut allocator, 1024, CriticalSection)?;
/// let receive = |call: &Call<'_>| terminal.receive(call);
/// let mut hand = system.mailbox(HAND)?;
/// hand.set_vector(TerminalVectors::DEFAULT.input, &receive, "terminal input")?;
/// hand.set_vector(TerminalVectors::DEFAULT.room, &receive, "terminal room")?;
/// hand.join()?;
///
/// let mut console = terminal.console(&hand).with_read_timeout(Duration::from_secs(1));
/// write!(console, "joint {} is at {:.3} rad\n", 3, 0.25)?;
/// let mut line = [0; 80];
/// assert!(console.read(&mut line).is_err()); // nobody types here
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct Terminal<W, X, const IN: usize> {
    output: Output<W, X>,
    input: Input<IN>,
    vectors: TerminalVectors,
}

impl<W: MemoryWindow, X: Exclusion, const IN: usize> Terminal<W, X, IN> {
    /// Makes a terminal with a ring of `capacity` bytes, a power of two. `own` is the processor's
    /// [`Region::users`]; `allocator` allocates the memory in it. All terminals of a processor must
    /// share one allocator.
    ///
    /// A host that was attached to an earlier terminal at the same offset notices the change, and
    /// attaches again.
    ///
    /// # Errors
    /// [`TerminalError::Capacity`] if the size of the ring is not allowed,
    /// [`TerminalError::Offset`] if the terminal would begin at 1 GiB or more in the region,
    /// [`TerminalError::Access`] if there is no room.
    pub fn new(
        own: Region<W>,
        allocator: &mut Allocator,
        capacity: u32,
        exclusion: X,
    ) -> Result<Self, TerminalError> {
        if !layout::is_capacity(capacity) {
            return Err(TerminalError::Capacity { capacity });
        }
        let offset = allocator.bytes((BLOCK_BYTES + capacity) as usize)?;
        let this = Self {
            output: Output::new(own, offset, capacity, exclusion)?,
            input: Input::new(),
            vectors: TerminalVectors::DEFAULT,
        };
        this.output.set_mode(this.input.mode_word())?;
        Ok(this)
    }

    /// Uses other vectors than [`TerminalVectors::DEFAULT`]; the host must use the same.
    #[must_use]
    pub fn with_vectors(self, vectors: TerminalVectors) -> Self {
        Self { vectors, ..self }
    }

    /// Returns the offset of the terminal in the processor's [`Region::users`], in bytes. A host
    /// needs it to attach.
    #[must_use]
    pub const fn offset(&self) -> u32 {
        self.output.offset()
    }

    /// Handles a message of the host. Call it from the mailbox's handlers for the vectors
    /// [`input`](TerminalVectors::input) and [`room`](TerminalVectors::room).
    ///
    /// The handler must return the result, which is the reply to the host: [`reply::NO_TERMINAL`]
    /// if the message is for another terminal of this processor; the handler then calls `receive`
    /// of the next one.
    pub fn receive(&self, call: &Call<'_>) -> u32 {
        self.receive_and(call, || ())
    }

    /// Handles a message as [`receive`](Self::receive) does, and calls `on_interrupt` if its
    /// character is the one that interrupts.
    pub fn receive_and(&self, call: &Call<'_>, on_interrupt: impl FnOnce()) -> u32 {
        if call.vector() == self.vectors.room {
            // The message has ended the wait of the context that it was for.
            return reply::ACCEPTED;
        }
        let [character, ..] = call.data().to_le_bytes();
        if call.data() >> 8 != self.offset() / ALIGNMENT {
            return reply::NO_TERMINAL;
        }
        let post = |to, vector, data| {
            // The cursors in shared memory already tell what the message would tell.
            let _ = call.send(to, vector, data, Duration::ZERO);
        };
        // A terminal whose memory is gone has nothing to show, but still takes what is typed.
        let accepted = self
            .accept_and(character, post)
            .unwrap_or(InputResult::Taken);
        if accepted != InputResult::Full {
            // Before the reply: a host that dies without it leaves the count to the next one.
            let _ = self.output.count_typed();
        }
        match accepted {
            InputResult::Full => reply::FULL,
            InputResult::Taken => reply::ACCEPTED,
            InputResult::Interrupts => {
                on_interrupt();
                reply::ACCEPTED
            }
        }
    }

    /// Takes a character that was typed somewhere else than at the host, such as at a serial line.
    /// Returns [`InputResult::Full`] if there is no room; the caller must then keep the character.
    ///
    /// The echo of the character waits in the ring until the host reads the next time; no message
    /// is sent for it.
    ///
    /// # Errors
    /// [`AccessError`] if the memory cannot be accessed; even then the character has been taken.
    pub fn accept(&self, character: u8) -> Result<InputResult, AccessError> {
        self.accept_and(character, |_, _, _| ())
    }

    fn accept_and(
        &self,
        character: u8,
        post: impl Fn(Processor, Vector, u32),
    ) -> Result<InputResult, AccessError> {
        let ((accepted, echo), told) = self.telling_mode(|| self.input.accept(character));
        told?;
        // No line has more columns than two for each place of the queue.
        let shown = (0..echo.times).try_for_each(|_| self.put_or_lose(echo.text()));
        // An interrupt reaches the program even if its echo does not reach the host.
        if shown.is_ok() && echo.times > 0 {
            let _ = self.ring(post);
        }
        Ok(accepted)
    }

    fn put_or_lose(&self, bytes: &[u8]) -> Result<(), AccessError> {
        let written = self.output.put(bytes, false)?;
        self.output.count_lost(bytes.len().saturating_sub(written))
    }

    /// Writes as many of `bytes` as there is room for now, with newlines as the settings demand,
    /// and returns their number.
    pub(crate) fn put_text(&self, bytes: &[u8]) -> Result<usize, AccessError> {
        if !self.exclusive(|| self.input.settings()).newlines {
            return self.put_raw(bytes);
        }
        let mut written = 0;
        let mut rest = bytes;
        while !rest.is_empty() {
            let newline = rest.iter().position(|byte| *byte == b'\n');
            let (text, after) = newline
                .and_then(|at| rest.split_at_checked(at))
                .unwrap_or((rest, &[]));
            let put = self.put_raw(text)?;
            written += put;
            if put < text.len() {
                break;
            }
            let Some((_, next)) = after.split_first() else {
                break;
            };
            if self.output.put(b"\r\n", true)? == 0 {
                break;
            }
            written += 1;
            rest = next;
        }
        Ok(written)
    }

    /// Writes bytes as they are, in as many pieces as the ring makes of them.
    fn put_raw(&self, bytes: &[u8]) -> Result<usize, AccessError> {
        let mut written = 0;
        while let Some(rest) = bytes.get(written..)
            && !rest.is_empty()
        {
            match self.output.put(rest, false)? {
                0 => break,
                count => written += count,
            }
        }
        Ok(written)
    }

    /// Tells the host, if one is attached, that there is output.
    pub(crate) fn ring(&self, post: impl Fn(Processor, Vector, u32)) -> Result<(), AccessError> {
        if let Some(host) = self.output.attached()? {
            post(host, self.vectors.output, self.offset());
        }
        Ok(())
    }

    /// A read's worth of what has been typed, in pieces that are taken in one section each; `None`
    /// if there is nothing. `post` tells a host that keeps a character.
    pub(crate) fn take(
        &self,
        into: &mut [u8],
        post: impl Fn(Processor, Vector, u32),
    ) -> Result<Option<usize>, AccessError> {
        let was_full = self.exclusive(|| self.input.is_full());
        let (mut count, mut ended) = (0, false);
        for piece in into.chunks_mut(TAKEN_AT_ONCE) {
            let ((more, last), told) = self.telling_mode(|| self.input.take(piece));
            told?;
            count += more;
            ended = last;
            if last || more < piece.len() {
                break;
            }
        }
        if was_full {
            self.ring(post)?;
        }
        Ok((ended || count > 0).then_some(count))
    }

    /// Tells the host of the mode if `body`, which runs alone, changed it.
    fn telling_mode<R>(&self, body: impl FnOnce() -> R) -> (R, Result<(), AccessError>) {
        self.exclusive(|| {
            let before = self.input.mode_word();
            let outcome = body();
            let mode = self.input.mode_word();
            let told = if mode == before {
                Ok(())
            } else {
                self.output.set_mode(mode)
            };
            (outcome, told)
        })
    }

    /// Changes the settings. They apply to characters that are typed from now on.
    ///
    /// With [`InputMode::Raw`](crate::InputMode::Raw) or
    /// [`InputMode::Cbreak`](crate::InputMode::Cbreak) the program can also read the unfinished
    /// line that was being edited.
    ///
    /// # Errors
    /// [`AccessError`] if the memory cannot be accessed; even then the settings apply.
    pub fn configure(&self, settings: &TerminalSettings) -> Result<(), AccessError> {
        self.telling_mode(|| self.input.configure(settings)).1
    }

    /// Returns the settings that apply now.
    pub fn settings(&self) -> TerminalSettings {
        self.exclusive(|| self.input.settings())
    }

    /// Sets the policy for output for which the ring has no room.
    ///
    /// # Errors
    /// [`AccessError`] if the memory cannot be accessed.
    pub fn set_policy(&self, policy: Policy) -> Result<(), AccessError> {
        self.output.set_policy(policy)
    }

    /// Returns the policy for output for which the ring has no room.
    pub fn policy(&self) -> Policy {
        self.output.policy()
    }

    /// Returns true if the character that interrupts has been typed since an interrupt was last
    /// reported, by this method or as the error of a read.
    pub fn take_interrupt(&self) -> bool {
        self.exclusive(|| self.input.take_interrupt())
    }

    /// Returns the number of the host that is attached; `None` if there is none. A host that died
    /// without detaching still counts as attached.
    ///
    /// # Errors
    /// [`AccessError`] if the memory cannot be accessed.
    pub fn attached(&self) -> Result<Option<Processor>, AccessError> {
        self.output.attached()
    }

    /// Returns how many bytes in the ring the host has not acknowledged; at most the ring's
    /// capacity.
    ///
    /// # Errors
    /// [`AccessError`] if the memory cannot be accessed.
    pub fn unread(&self) -> Result<u32, AccessError> {
        self.output.unread()
    }

    /// Returns the number of bytes that have been written to the ring, echo included, since the
    /// terminal was made; wraps. While this number does not change, the cursor on the screen does
    /// not move.
    pub fn written(&self) -> u32 {
        self.output.written()
    }

    /// Returns the number of bytes of output that were dropped because the ring had no room; wraps.
    /// Bytes that [`Policy::DropOld`] overwrites are not in it: the host counts them, since only
    /// the host knows which it has read.
    pub fn lost(&self) -> u32 {
        self.output.lost()
    }

    /// Returns the number of invalid values of the host's position in the output that the processor
    /// has found in shared memory; wraps. Normally it is 0.
    ///
    /// Each such value was ignored. A correct host can cause one only if it comes back late after
    /// the policy changed from [`Policy::DropOld`].
    pub fn ignored(&self) -> u32 {
        self.output.ignored()
    }

    /// Returns the number of typed characters that were dropped because the unfinished line filled
    /// the queue of `IN` characters; wraps.
    pub fn overlong(&self) -> u32 {
        self.exclusive(|| self.input.overlong())
    }

    /// For how long a write waits for room, if it does.
    pub(crate) fn waits(&self) -> Result<Option<Duration>, AccessError> {
        match self.policy() {
            Policy::Block { timeout } if self.attached()?.is_some() => Ok(Some(timeout)),
            _ => Ok(None),
        }
    }

    pub(crate) const fn output(&self) -> &Output<W, X> {
        &self.output
    }

    pub(crate) fn has_input(&self) -> bool {
        self.exclusive(|| self.input.is_ready() || self.input.is_interrupted())
    }

    pub(crate) fn exclusive<R>(&self, body: impl FnOnce() -> R) -> R {
        self.output.exclusion().with(body)
    }
}

/// Characters that are taken out in one exclusive section.
const TAKEN_AT_ONCE: usize = 16;
