//! [`TerminalHost`]: the host's side of a processor's terminal.

use std::collections::VecDeque;
use std::io;
use std::time::Duration;

use condor_mbox::{
    AccessError, MailboxError, MemoryWindow, Messenger, PendingReply, Processor, Region,
};

use super::sink::{Piece, Sink};
use crate::layout::{TerminalVectors, input_data, reply};
use crate::reader::{FetchedOutput, TerminalReader, TerminalReaderError, TerminalStatus};

/// The host's end of one terminal of a processor. It moves the terminal's output to a [`Sink`], such as a
/// pseudo-terminal, and the characters that are typed there to the terminal.
///
/// No call waits. The host's main loop serves the host's mailbox, sleeps until a message comes or a descriptor is
/// ready, and calls [`serve`](Self::serve) for each terminal. The handler for [`TerminalVectors::output`] need not do
/// anything: the message only ends the sleep.
#[derive(Debug)]
pub struct TerminalHost<W> {
    reader: TerminalReader<W>,
    to: Processor,
    me: Processor,
    vectors: TerminalVectors,
    /// The bytes that were read last. The sink has taken the first `taken` of them.
    buffer: Box<[u8]>,
    fetched: FetchedOutput,
    taken: usize,
    /// Characters of the sink that have not been sent yet.
    typed: VecDeque<u8>,
    /// Whether no character of a former host is under way any more.
    settled: bool,
    /// Whether the sink knows which of its characters come next.
    told: bool,
    /// The message whose reply has not come: a character, or none to settle.
    pending_reply: Option<(Option<u8>, PendingReply)>,
}

/// The result of [`TerminalHost::serve`]: what was moved, and what is left to do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ServedTerminal {
    /// The number of bytes that the sink has taken.
    pub output: usize,
    /// The number of characters that the processor has accepted.
    pub input: usize,
    /// Whether another call would find more to do at once.
    pub more: bool,
    /// Whether a character was sent to the processor.
    pub sent: bool,
    /// Whether a character waits because the sink did not let it be [sent](Sink::sends).
    pub held: bool,
}

/// The reason why [`TerminalHost::serve`] failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum HostError {
    /// The terminal cannot be read.
    #[error(transparent)]
    Reader(#[from] TerminalReaderError),
    /// The sink returned this error.
    #[error("cannot pass on the output of a terminal: {0}")]
    Sink(#[from] io::Error),
    /// The mailbox returned this error.
    #[error(transparent)]
    Mailbox(#[from] MailboxError),
}

impl From<AccessError> for HostError {
    fn from(error: AccessError) -> Self {
        Self::Reader(error.into())
    }
}

/// Bytes that are read at once.
const BUFFER: usize = 64 * 1024;
/// Characters that are taken from the sink at once.
const PIECE: usize = 256;
/// The number of times that one call looks at the ring.
const LOOKS: usize = 16;

impl<W: MemoryWindow + Clone> TerminalHost<W> {
    /// Attaches a host to a terminal of the processor `to`. `region` is the processor's [`Region::users`], `offset` the
    /// place of the terminal in it in bytes ([`Terminal::offset`](crate::Terminal::offset)), and `me` the host's own
    /// number.
    ///
    /// # Errors
    /// [`TerminalReaderError::NoTerminal`] if there is no terminal, [`TerminalReaderError::NotReady`] or
    /// [`TerminalReaderError::Restarted`] if it is being made, [`TerminalReaderError::Broken`] if a word is
    /// invalid, [`TerminalReaderError::Access`] if the memory cannot be accessed.
    pub fn attach(
        region: Region<W>,
        offset: u32,
        to: Processor,
        me: Processor,
    ) -> Result<Self, TerminalReaderError> {
        Ok(Self {
            reader: TerminalReader::attach(region, offset, me)?,
            to,
            me,
            vectors: TerminalVectors::DEFAULT,
            buffer: vec![0; BUFFER].into_boxed_slice(),
            fetched: FetchedOutput::default(),
            taken: 0,
            typed: VecDeque::new(),
            settled: false,
            told: false,
            pending_reply: None,
        })
    }

    /// Uses other vectors than [`TerminalVectors::DEFAULT`]; the processor's terminal must use the same.
    #[must_use]
    pub fn with_vectors(self, vectors: TerminalVectors) -> Self {
        Self { vectors, ..self }
    }

    /// Moves output to `sink`, and input from it, as far as possible now, without waiting. `mailbox` is the host's own;
    /// `sink` must be the same in every call.
    ///
    /// The character that interrupts overtakes all other characters that wait, and drops them. If
    /// the processor's program has restarted and made the terminal anew, the host attaches again.
    /// It is not an error if the processor is not there or takes no messages: typed characters are
    /// kept for it.
    ///
    /// # Errors
    /// [`HostError::Reader`] with [`TerminalReaderError::Displaced`] if another host has attached, or with
    /// [`TerminalReaderError::Broken`] or [`TerminalReaderError::Access`] if the terminal is invalid or cannot be
    /// accessed; [`HostError::Sink`] if the sink fails; [`HostError::Mailbox`] if this mailbox has
    /// not joined or its memory is gone. Nothing is lost by these errors.
    pub fn serve(
        &mut self,
        mailbox: &dyn Messenger,
        sink: &mut dyn Sink,
    ) -> Result<ServedTerminal, HostError> {
        let mut served = ServedTerminal::default();
        match self.serve_output(mailbox, sink, &mut served) {
            Err(HostError::Reader(TerminalReaderError::Restarted { .. })) => self.attach_again()?,
            other => other?,
        }
        self.serve_input(mailbox, sink, &mut served)?;
        Ok(served)
    }

    fn attach_again(&mut self) -> Result<(), TerminalReaderError> {
        match TerminalReader::attach(self.reader.region.clone(), self.reader.offset(), self.me) {
            Ok(reader) => {
                self.reader = reader;
                self.fetched = FetchedOutput::default();
                self.taken = 0;
                self.settled = false;
                self.told = false;
                Ok(())
            }
            // The processor is at it.
            Err(TerminalReaderError::NotReady { .. }) => Ok(()),
            Err(error) => Err(error),
        }
    }

    fn serve_output(
        &mut self,
        mailbox: &dyn Messenger,
        sink: &mut dyn Sink,
        served: &mut ServedTerminal,
    ) -> Result<(), HostError> {
        for _ in 0..LOOKS {
            if self.reader.status()?.stopped {
                // To notice a new incarnation also while nothing is read.
                self.reader.acknowledge(0)?;
                return Ok(());
            }
            if self.taken == self.fetched.len {
                let fetched = self.reader.fetch(&mut self.buffer)?;
                self.fetched = fetched;
                self.taken = 0;
                if fetched == FetchedOutput::default() {
                    return Ok(());
                }
            }
            let piece = Piece {
                incarnation: self.reader.incarnation(),
                position: self.reader.position().wrapping_add(self.fetched.skipped),
                overwritten: self.fetched.skipped,
                bytes: self
                    .buffer
                    .get(self.taken..self.fetched.len)
                    .unwrap_or_default(),
            };
            let count = sink.take(piece)?.min(piece.bytes.len());
            self.taken += count;
            self.fetched.skipped = 0;
            served.output += count;
            if self.reader.acknowledge(count)? && count > 0 {
                // If it cannot be sent, the processor looks by itself a little later.
                let offset = self.reader.offset();
                let _ = mailbox.send(self.to, self.vectors.room, offset, Duration::ZERO);
            }
            if self.taken < self.fetched.len {
                return Ok(());
            }
        }
        served.more = true;
        Ok(())
    }

    fn serve_input(
        &mut self,
        mailbox: &dyn Messenger,
        sink: &mut dyn Sink,
        served: &mut ServedTerminal,
    ) -> Result<(), HostError> {
        if let Some((character, pending)) = self.pending_reply {
            let answer = mailbox.poll_pending(&pending);
            if answer == Ok(None) {
                return Ok(());
            }
            mailbox.abandon(&pending);
            self.pending_reply = None;
            match (character, answer) {
                // All that a former host has sent was taken before this.
                (None, answer) => self.settled = answer.is_ok(),
                (Some(_), Ok(Some(reply))) if reply != reply::FULL => served.input += 1,
                // There is no room; or its program has gone, and the next one gets it.
                (Some(character), _) => self.typed.push_front(character),
            }
            if let Err(error) = answer {
                fatal(error, self.me)?;
            }
        }
        // From here on nothing is under way.
        if !self.settled {
            return self.ask(mailbox, None);
        }
        let status = self.reader.status()?;
        if status.full && status.interrupt.is_none() {
            // The terminal takes nothing; the sink keeps characters that may be for the next incarnation. The
            // processor sends a message when its program has read.
            return Ok(());
        }
        self.tell(sink)?;
        if self.typed.len() < PIECE {
            self.read_typed(sink)?;
            self.tell(sink)?;
        }
        let Some(&character) = self.typed.front() else {
            return Ok(());
        };
        let status = self.reader.status()?;
        if status.full && status.interrupt != Some(character) {
            // The processor sends a message when its program has read.
            return Ok(());
        }
        if !sink.sends(character, self.typed.len())? {
            served.held = true;
            return Ok(());
        }
        self.ask(mailbox, Some(character))?;
        served.sent = self.pending_reply.is_some();
        Ok(())
    }

    fn read_typed(&mut self, sink: &mut dyn Sink) -> Result<(), HostError> {
        let mut characters = [0; PIECE];
        let count = sink.typed(&mut characters)?;
        let interrupt = self.reader.status()?.interrupt;
        for character in characters.into_iter().take(count) {
            if interrupt == Some(character) && !self.typed.is_empty() {
                self.typed.clear();
                self.told = false;
            }
            self.typed.push_back(character);
        }
        Ok(())
    }

    /// Tells the sink which characters come next, unless it knows.
    fn tell(&mut self, sink: &mut dyn Sink) -> Result<(), HostError> {
        if !self.told {
            let taken = self.reader.status()?.typed;
            sink.typing(self.reader.incarnation(), taken, self.typed.len())?;
            self.told = true;
        }
        Ok(())
    }

    /// Sends the character at the front, or a message that comes after those of a former host, if
    /// that is possible now.
    fn ask(&mut self, mailbox: &dyn Messenger, character: Option<u8>) -> Result<(), HostError> {
        let offset = self.reader.offset();
        let (vector, data) = match character {
            Some(character) => (self.vectors.input, input_data(offset, character)),
            None => (self.vectors.room, offset),
        };
        match mailbox.begin(self.to, vector, data, Duration::ZERO) {
            Ok(ticket) => {
                self.pending_reply = ticket.detach().map(|pending| (character, pending));
                if character.is_some() {
                    self.typed.pop_front();
                }
                Ok(())
            }
            Err(error) => fatal(error, self.me),
        }
    }

    /// Returns the counts and modes of the terminal.
    ///
    /// # Errors
    /// [`AccessError`] if the terminal's memory cannot be accessed.
    pub fn status(&self) -> Result<TerminalStatus, AccessError> {
        self.reader.status()
    }

    /// Returns the offset of the terminal in its processor's [`Region::users`], in bytes.
    #[must_use]
    pub const fn offset(&self) -> u32 {
        self.reader.offset()
    }

    /// Returns the number of typed characters that the processor has not taken yet.
    #[must_use]
    pub fn waiting_input(&self) -> usize {
        let sent = matches!(self.pending_reply, Some((Some(_), _)));
        self.typed.len() + usize::from(sent)
    }

    /// Detaches this host, so that no program waits for it. If a host is dropped without this call, writers with
    /// [`Policy::Block`](crate::Policy::Block) still wait for it, up to their timeouts.
    ///
    /// # Errors
    /// [`TerminalReaderError::Displaced`] if another host has attached, [`TerminalReaderError::Restarted`] if the
    /// terminal was made anew, [`TerminalReaderError::Access`] if the memory cannot be accessed.
    pub fn detach(self) -> Result<(), TerminalReaderError> {
        self.reader.detach()
    }
}

/// Returns an error of this host's own mailbox; ignores an error that concerns only the processor
/// to which it sends.
fn fatal(error: MailboxError, me: Processor) -> Result<(), HostError> {
    match error {
        MailboxError::NotJoined { .. }
        | MailboxError::NoSuchProcessor { .. }
        | MailboxError::NoSuchVector { .. } => Err(error.into()),
        MailboxError::Window { processor, .. } if processor == me => Err(error.into()),
        _ => Ok(()),
    }
}
