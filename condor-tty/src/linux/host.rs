//! [`Host`]: the host's side of a processor's terminal.

use std::collections::VecDeque;
use std::io;
use std::time::Duration;

use condor_mbox::{
    AccessError, Error as MailboxError, MemoryWindow, Messenger, Pending, Processor, Region,
};

use super::sink::Sink;
use crate::layout::{Vectors, input_data, reply};
use crate::reader::{Reader, ReaderError, Status};

/// A terminal of a processor, attached to a sink.
///
/// No call waits. The host's loop serves its mailbox, sleeps there or until a descriptor is ready,
/// and calls [`serve`](Self::serve) for each terminal. Its handler for [`Vectors::output`] need not
/// do anything: the message only ends the sleep.
#[derive(Debug)]
pub struct Host<W, S> {
    region: Region<W>,
    reader: Reader<W>,
    to: Processor,
    me: Processor,
    vectors: Vectors,
    /// The sink, which gets the terminal's output.
    pub sink: S,
    /// What has been read and not been taken by the sink: from `begin` to `end`.
    buffer: Box<[u8]>,
    begin: usize,
    end: usize,
    typed: VecDeque<u8>,
    settled: Settled,
    /// Characters that an interrupt has dropped, and that the sink has not been told of.
    interrupted: usize,
    /// A character whose reply has not come.
    sent: Option<Sent>,
    may_type: bool,
}

#[derive(Debug)]
struct Sent {
    character: u8,
    pending: Pending,
    /// It is to be kept if there is no room for it: nobody has interrupted since.
    keep: bool,
}

/// Whether a character of a former host may be under way.
#[derive(Debug)]
enum Settled {
    No,
    /// The reply to this comes after it.
    Asked(Pending),
    Yes,
}

/// The result of [`Host::serve`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Served {
    /// The number of bytes that the sink has taken.
    pub output: usize,
    /// The number of bytes that had been overwritten.
    pub overwritten: u32,
    /// The number of characters that the processor has accepted.
    pub input: usize,
    /// Whether another call would find more to do at once.
    pub more: bool,
    /// Whether a character waits only for being [allowed](Host::may_type).
    pub types: bool,
}

/// The reason for which a host cannot serve a terminal.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum HostError {
    /// The terminal cannot be read.
    #[error(transparent)]
    Reader(#[from] ReaderError),
    /// The sink returned this error.
    #[error("the sink of a terminal fails: {0}")]
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
/// Characters that are kept for a processor that does not take them.
const TYPED: usize = 64 * 1024;
/// How often one call looks at the ring.
const LOOKS: usize = 16;

impl<W: MemoryWindow + Clone, S: Sink> Host<W, S> {
    /// Attaches `me` to the terminal at `offset` of `region`, the users' region of `to`.
    ///
    /// # Errors
    /// Those of [`Reader::attach`].
    pub fn attach(
        region: Region<W>,
        offset: u32,
        to: Processor,
        me: Processor,
        mut sink: S,
    ) -> Result<Self, HostError> {
        let reader = Reader::attach(region.clone(), offset, me)?;
        sink.attached(reader.life(), reader.position());
        Ok(Self {
            region,
            reader,
            to,
            me,
            vectors: Vectors::DEFAULT,
            sink,
            buffer: vec![0; BUFFER].into_boxed_slice(),
            begin: 0,
            end: 0,
            typed: VecDeque::new(),
            settled: Settled::No,
            interrupted: 0,
            sent: None,
            may_type: true,
        })
    }

    /// Uses these vectors instead of [`Vectors::DEFAULT`].
    #[must_use]
    pub fn with_vectors(self, vectors: Vectors) -> Self {
        Self { vectors, ..self }
    }

    /// Says whether characters may be sent to the processor from now on; at first they may. In
    /// simulated time a host sends them only while it has the turn.
    pub fn may_type(&mut self, may_type: bool) {
        self.may_type = may_type;
    }

    /// Types characters, like those that the sink's [`typed`](Sink::typed) returns. A user
    /// interface calls this.
    ///
    /// The character that interrupts overtakes all other characters that wait, and drops them. A
    /// character for which there is no room in the queue is dropped.
    ///
    /// # Errors
    /// [`HostError::Reader`] if the terminal's memory cannot be accessed.
    pub fn type_in(&mut self, characters: &[u8]) -> Result<(), HostError> {
        let interrupt = self.reader.status()?.interrupt;
        for character in characters {
            if interrupt == Some(*character) {
                self.interrupted += self.typed.len();
                self.typed.clear();
                if let Some(sent) = &mut self.sent {
                    sent.keep = false;
                }
            }
            if self.typed.len() < TYPED {
                self.typed.push_back(*character);
            }
        }
        Ok(())
    }

    /// Moves output and input as far as possible now, without waiting.
    ///
    /// If the processor began a new life, it attaches again. It is not an error if the processor is
    /// not there or takes no messages: typed characters are kept for it.
    ///
    /// # Errors
    /// [`HostError::Reader`] with [`ReaderError::Displaced`] if another host has attached, or with
    /// [`ReaderError::Broken`] or [`ReaderError::Access`] if the terminal is invalid or cannot be
    /// accessed; [`HostError::Sink`] if the sink fails; [`HostError::Mailbox`] if this mailbox has
    /// not joined or its memory is gone. Nothing is lost by these errors.
    pub fn serve(&mut self, mailbox: &dyn Messenger) -> Result<Served, HostError> {
        let mut served = Served::default();
        match self.serve_output(mailbox, &mut served) {
            Err(HostError::Reader(ReaderError::Restarted { .. })) => self.attach_again()?,
            other => other?,
        }
        self.serve_input(mailbox, &mut served)?;
        Ok(served)
    }

    fn attach_again(&mut self) -> Result<(), HostError> {
        match Reader::attach(self.region.clone(), self.reader.offset(), self.me) {
            Ok(reader) => {
                self.reader = reader;
                self.settled = Settled::No;
                self.begin = 0;
                self.end = 0;
                self.sink.restarted();
                self.sink
                    .attached(self.reader.life(), self.reader.position());
                Ok(())
            }
            // The processor is at it.
            Err(ReaderError::NotReady { .. }) => Ok(()),
            Err(error) => Err(error.into()),
        }
    }

    fn serve_output(
        &mut self,
        mailbox: &dyn Messenger,
        served: &mut Served,
    ) -> Result<(), HostError> {
        for _ in 0..LOOKS {
            served.more = false;
            if self.reader.status()?.stopped {
                // To notice a new life also while nothing is read.
                self.reader.acknowledge(0)?;
                return Ok(());
            }
            if self.begin == self.end && !self.fetch(served)? {
                return Ok(());
            }
            let offered = self.buffer.get(self.begin..self.end).unwrap_or_default();
            let taken = self.sink.take(offered)?.min(offered.len());
            self.begin += taken;
            served.output += taken;
            self.acknowledge(mailbox, taken)?;
            if self.begin < self.end {
                return Ok(());
            }
            served.more = true;
        }
        Ok(())
    }

    /// Fills the buffer; says whether there is anything in it.
    fn fetch(&mut self, served: &mut Served) -> Result<bool, HostError> {
        let fetched = self.reader.fetch(&mut self.buffer)?;
        self.begin = 0;
        self.end = fetched.len;
        served.overwritten = served.overwritten.wrapping_add(fetched.skipped);
        if fetched.skipped > 0 {
            self.sink.overwritten(fetched.skipped)?;
        }
        Ok(fetched.len > 0 || fetched.skipped > 0)
    }

    fn acknowledge(&mut self, mailbox: &dyn Messenger, taken: usize) -> Result<(), HostError> {
        if self.reader.acknowledge(taken)? && taken > 0 {
            // If it cannot be sent, the processor looks by itself a little later.
            let offset = self.reader.offset();
            let _ = mailbox.send(self.to, self.vectors.room, offset, Duration::ZERO);
        }
        Ok(())
    }

    fn serve_input(
        &mut self,
        mailbox: &dyn Messenger,
        served: &mut Served,
    ) -> Result<(), HostError> {
        if let Some(sent) = self.sent.take() {
            match mailbox.poll_pending(&sent.pending) {
                Ok(None) => {
                    self.sent = Some(sent);
                    return Ok(());
                }
                Ok(Some(reply)) => {
                    if reply == reply::FULL {
                        self.keep(&sent);
                    } else {
                        served.input += 1;
                    }
                }
                // It was not answered, and its program has gone; the next one gets it.
                Err(error) => {
                    self.keep(&sent);
                    fatal(error, self.me)?;
                }
            }
            mailbox.abandon(&sent.pending);
        }
        if !self.settle(mailbox)? {
            return Ok(());
        }
        if self.typed.len() < PIECE {
            let mut characters = [0; PIECE];
            let count = self.sink.typed(&mut characters)?;
            let characters = characters.get(..count).unwrap_or_default();
            self.type_in(characters)?;
        }
        if self.interrupted > 0 {
            // Nothing is under way: the count is exact.
            let taken = self.reader.status()?.typed;
            self.sink.dropped(taken, self.interrupted)?;
            self.interrupted = 0;
        }
        self.send_next(mailbox, served)
    }

    /// Waits, over several calls, for what a former host had under way; says whether that is over.
    fn settle(&mut self, mailbox: &dyn Messenger) -> Result<bool, HostError> {
        match core::mem::replace(&mut self.settled, Settled::No) {
            Settled::Yes => {}
            Settled::No => {
                let offset = self.reader.offset();
                match mailbox.begin(self.to, self.vectors.room, offset, Duration::ZERO) {
                    Ok(ticket) => {
                        self.settled = ticket.detach().map_or(Settled::No, Settled::Asked);
                    }
                    Err(error) => fatal(error, self.me)?,
                }
                return Ok(false);
            }
            Settled::Asked(pending) => {
                let settled = match mailbox.poll_pending(&pending) {
                    Ok(None) => {
                        self.settled = Settled::Asked(pending);
                        return Ok(false);
                    }
                    Ok(Some(_)) => Ok(true),
                    // Its program has gone, and with it what was under way; the next one is asked.
                    Err(error) => fatal(error, self.me).map(|()| false),
                };
                mailbox.abandon(&pending);
                if !settled? {
                    return Ok(false);
                }
                let taken = self.reader.status()?.typed;
                self.sink
                    .typing(self.reader.life(), taken, self.typed.len())?;
                self.interrupted = 0;
            }
        }
        self.settled = Settled::Yes;
        Ok(true)
    }

    /// Puts a character that was not taken before all others, unless somebody interrupted since.
    fn keep(&mut self, sent: &Sent) {
        if sent.keep {
            self.typed.push_front(sent.character);
        } else {
            self.interrupted += 1;
        }
    }

    /// Sends the next character, if it can be sent now.
    fn send_next(&mut self, mailbox: &dyn Messenger, served: &mut Served) -> Result<(), HostError> {
        let Some(&character) = self.typed.front() else {
            return Ok(());
        };
        let status = self.reader.status()?;
        if status.full && status.interrupt != Some(character) {
            // The processor sends a message when its program has read.
            return Ok(());
        }
        if !self.may_type {
            served.types = true;
            return Ok(());
        }
        let data = input_data(self.reader.offset(), character);
        match mailbox.begin(self.to, self.vectors.input, data, Duration::ZERO) {
            Ok(ticket) => {
                self.typed.pop_front();
                self.sent = ticket.detach().map(|pending| Sent {
                    character,
                    pending,
                    keep: true,
                });
                Ok(())
            }
            Err(error) => fatal(error, self.me),
        }
    }

    /// Returns the state of the terminal, apart from its output.
    ///
    /// # Errors
    /// [`AccessError`] if the terminal's memory cannot be accessed.
    pub fn status(&self) -> Result<Status, AccessError> {
        self.reader.status()
    }

    /// Returns the number of characters that wait for the processor to take them.
    #[must_use]
    pub fn waiting_input(&self) -> usize {
        self.typed.len() + usize::from(self.sent.is_some())
    }

    /// Detaches, and returns the sink. If a host is dropped without this, writers on the processor
    /// wait for it as for a dead one.
    ///
    /// # Errors
    /// [`HostError::Reader`] with the errors of [`Reader::detach`].
    pub fn detach(self) -> Result<S, HostError> {
        self.reader.detach()?;
        Ok(self.sink)
    }
}

/// Errors of this mailbox, in contrast to those of whom it sends to.
fn fatal(error: MailboxError, me: Processor) -> Result<(), HostError> {
    match error {
        MailboxError::NotJoined { .. }
        | MailboxError::NoSuchProcessor { .. }
        | MailboxError::NoSuchVector { .. } => Err(error.into()),
        MailboxError::Window { processor, .. } if processor == me => Err(error.into()),
        _ => Ok(()),
    }
}
